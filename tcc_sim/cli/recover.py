"""`tcc-sim recover`: make a complete, indexed bag from a recording that was cut short or damaged."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.errors import counted, one_line, printable
from tcc_sim.output.terminal import say

TOPICS_SHOWN = 100
"""Largest number of topics listed."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the recording and the new directory."""
    parser.add_argument_group("recording").add_argument(
        "recording", metavar="RUN", type=Path, help="bag directory or .mcap file, which stays unchanged")
    parser.add_argument_group("output").add_argument(
        "--out", metavar="DIR", type=Path, help="directory to create (default: RUN_recovered beside it)")


def run(arguments: argparse.Namespace) -> int:
    """Recover the recording and print the missing parts."""
    from tcc_sim.recording.reader import open_run
    from tcc_sim.recording.recovery import default_directory, recover

    recording = open_run(arguments.recording)
    result = recover(recording, arguments.out or default_directory(arguments.recording))
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
