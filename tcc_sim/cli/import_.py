"""`tcc-sim import`: write a foreign or compressed bag as a recording of this package."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import DRIVELINE, FORMS, driveline_of
from tcc_sim.cli.options import Form, command, of
from tcc_sim.errors import counted, one_line, printable
from tcc_sim.output.terminal import say

IMPORT = "tcc_sim.recording.importer:import_bag"


@command(of(IMPORT, FORMS, DRIVELINE), forms={"bag": Form("BAG", Path), "recording": Form("RUN", Path)})
def run(arguments: argparse.Namespace, bag: Path, recording: Path) -> int:
    """Import the bag and print what it holds and what is unknown.

    Parameters
    ----------
    bag : a bag in SQLite, of ROS 1, compressed, or of another program in MCAP; it stays unchanged
    recording : directory to create
    """
    from tcc_sim.recording.importer import import_bag

    result = import_bag(bag, recording, **driveline_of(arguments))
    say(printable(f"imported {counted(result.states, 'state')} of {counted(result.runs, 'run')} into "
                  f"{result.directory}"))
    for sentence in result.notes:
        say(f"  note: {one_line(sentence)}")
    return 0
