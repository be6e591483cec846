"""`tcc-sim import`: write a foreign or compressed bag as a recording of this package."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import DRIVELINE, FORMS, driveline_of
from tcc_sim.cli.options import add_options
from tcc_sim.errors import counted, one_line, printable
from tcc_sim.output.terminal import say

IMPORT = "tcc_sim.recording.importer:import_bag"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the bag, the new recording, and the choice of a driveline."""
    parser.add_argument("bag", metavar="BAG", type=Path, help="a bag in SQLite, of ROS 1, compressed, or of another "
                        "program in MCAP; it stays unchanged")
    parser.add_argument("recording", metavar="RUN", type=Path, help="directory to create")
    add_options(parser, IMPORT, FORMS, DRIVELINE)


def run(arguments: argparse.Namespace) -> int:
    """Import the bag and print what it holds and what is unknown."""
    from tcc_sim.recording.importer import import_bag

    result = import_bag(arguments.bag, arguments.recording, **driveline_of(arguments))
    say(printable(f"imported {counted(result.states, 'state')} of {counted(result.runs, 'run')} into "
                  f"{result.directory}"))
    for sentence in result.notes:
        say(f"  note: {one_line(sentence)}")
    return 0
