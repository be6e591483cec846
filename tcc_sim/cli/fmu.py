"""`tcc-sim fmu`: the real-time tick of a scene in C, as a co-simulation FMU."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import add_scene, new_file, number, scene_of
from tcc_sim.errors import check_suffix
from tcc_sim.output.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The scene, the version of FMI and where the FMU goes."""
    add_scene(parser)
    parser.add_argument("--fmi", type=int, choices=(2, 3), default=2, help="version of FMI (2)")
    parser.add_argument("--step", metavar="S", type=number(5e-5, 1.0, "s"), help="a tick (default: the scene's rate)")
    parser.add_argument("--sources-only", action="store_true", help="leave the binary for this machine out")
    parser.add_argument("--out", metavar="FILE.fmu", type=Path, help="file to write (default: tcc_sim_SCENE.fmu)")


def run(arguments: argparse.Namespace) -> int:
    """Write the FMU and say what is in it."""
    scene = scene_of(arguments)
    from tcc_sim.fmu.export import compiler, export

    if arguments.out is not None:
        check_suffix(arguments.out, (".fmu",), "--out ")
    path = new_file(arguments.out or Path(f"tcc_sim_{scene.name}.fmu"))
    folder = export(scene, path, arguments.fmi, arguments.step, sources_only=arguments.sources_only)
    if folder:
        held = f"sources in C99 and a binary for {folder}"
    elif arguments.sources_only or compiler() is not None:
        held = "sources in C99; importers compile them"
    else:
        held = "sources in C99; there is no C compiler here, so importers compile them"
    say(f"{path}: FMI {arguments.fmi}.0 for co-simulation, {held}")
    return 0
