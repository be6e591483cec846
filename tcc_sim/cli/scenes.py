"""`tcc-sim scenes`: list the bundled scenes, or print one as a parameter file."""

from __future__ import annotations

import argparse
import sys

from tcc_sim.cli.arguments import add_changes
from tcc_sim.cli.options import command
from tcc_sim.errors import InputError
from tcc_sim.output.terminal import say
from tcc_sim.parameter_file import description_in
from tcc_sim.scene import bundled_scenes, load_scene, parse_assignments


@command(add_changes)
def run(arguments: argparse.Namespace, show: str | None = None) -> int:
    """Print name and description of every bundled scene, or one scene in full.

    Parameters
    ----------
    show : print this scene (or a file) as a parameter file with every key
    """
    if show is not None:
        sys.stdout.write(load_scene(show).with_changes(parse_assignments(arguments.set)).text())
        return 0
    if arguments.set:
        raise InputError("--set changes the scene that --show prints; give --show NAME too")
    scenes = bundled_scenes()
    width = max(map(len, scenes), default=0)
    for name, path in scenes.items():
        say(f"{name:<{width}}  {description_in(path.read_text(encoding='utf-8'))}")
    return 0
