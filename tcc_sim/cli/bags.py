"""`tcc-sim recover` and `tcc-sim import`: a complete bag from a damaged one, and a recording from a foreign one."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.arguments import DRIVELINE, FORMS, driveline_of
from tcc_sim.cli.options import Form, command, of
from tcc_sim.errors import counted, one_line, printable
from tcc_sim.output.terminal import say

TOPICS_SHOWN = 100
"""Largest number of topics listed."""


@command(forms={"recording": Form("RUN", Path), "out": Form("DIR", Path)})
def recover(arguments: argparse.Namespace, recording: Path, out: Path | None = None) -> int:
    """Recover the recording and print the missing parts.

    Parameters
    ----------
    recording : bag directory or .mcap file, which stays unchanged
    out : directory to create (default: RUN_recovered beside it)
    """
    from tcc_sim.recording import recovery
    from tcc_sim.recording.reader import open_run

    result = recovery.recover(open_run(recording), out or recovery.default_directory(recording))
    say(printable(f"recovered {counted(sum(result.messages.values()), 'message')} into {result.directory}"))
    for topic, count in list(result.messages.items())[:TOPICS_SHOWN]:
        say(f"  {one_line(topic)}: {count}")
    if len(result.messages) > TOPICS_SHOWN:
        say(f"  and {counted(len(result.messages) - TOPICS_SHOWN, 'more topic')}")
    for sentence in result.missing:
        say(f"  note: {one_line(sentence)}")
    if not result.missing:
        say("  nothing is missing; the original was complete" if result.complete else "  nothing is missing")
    return 0


@command(of("tcc_sim.recording.importer:import_bag", FORMS, DRIVELINE),
         forms={"bag": Form("BAG", Path), "recording": Form("RUN", Path)})
def import_(arguments: argparse.Namespace, bag: Path, recording: Path) -> int:
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
