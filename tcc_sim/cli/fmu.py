"""`tcc-sim fmu`: export the real-time step of a scene in C as a co-simulation FMU."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import add_scene, new_file, number, scene_of, warn_of
from tcc_sim.cli.options import Form, command, of
from tcc_sim.errors import check_suffix
from tcc_sim.output.terminal import say


@command(add_scene, of("tcc_sim.functions:fmu_file", {
    "step": Form("S", number(5e-5, 1.0, "s")), "out": Form("FILE.fmu", Path)}))
def run(arguments: argparse.Namespace) -> int:
    """Write the FMU and print its contents."""
    scene = scene_of(arguments)
    from tcc_sim.fmi.export import compiler, export

    if arguments.out is not None:
        check_suffix(arguments.out, (".fmu",), "--out ")
    path = new_file(arguments.out or Path(f"tcc_sim_{scene.name}.fmu"))
    warn_of(scene)
    folder = export(scene, path, arguments.fmi, arguments.step, sources_only=arguments.sources_only)
    if folder:
        held = f"sources in C99 and a binary for {folder}"
    elif arguments.sources_only or compiler() is not None:
        held = "sources in C99; importers compile them"
    else:
        held = "sources in C99; no C compiler was found here, so importers compile them"
    say(f"{path}: FMI {arguments.fmi}.0 for co-simulation, {held}")
    return 0
