"""`tcc-sim fmu`: export the real-time step of a scene in C as a co-simulation FMU."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import add_scene, number, scene_of, warn_of
from tcc_sim.cli.options import Form, command, keywords_of, of, options_in
from tcc_sim.output.terminal import say

FMU = "tcc_sim.functions:fmu_file"


@command(add_scene, of(FMU, {"step": Form("S", number(5e-5, 1.0, "s")), "out": Form("FILE.fmu", Path)}))
def run(arguments: argparse.Namespace) -> int:
    """Write the FMU and print its contents."""
    from tcc_sim.fmi.export import compiler, folder_of_binary
    from tcc_sim.functions import fmu_file

    scene = scene_of(arguments)
    path = fmu_file(scene, **keywords_of(arguments, options_in(FMU)))
    warn_of(scene)
    if folder := folder_of_binary(path):
        held = f"sources in C99 and a binary for {folder}"
    elif arguments.sources_only or compiler() is not None:
        held = "sources in C99; importers compile them"
    else:
        held = "sources in C99; no C compiler was found here, so importers compile them"
    say(f"{path}: FMI {arguments.fmi}.0 for co-simulation, {held}")
    return 0
