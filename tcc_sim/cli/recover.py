"""`tcc-sim recover`: make a complete, indexed bag from a recording that was cut short or damaged."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.cli.options import Form, command
from tcc_sim.errors import counted, one_line, printable
from tcc_sim.output.terminal import say

TOPICS_SHOWN = 100
"""Largest number of topics listed."""


@command(forms={"recording": Form("RUN", Path), "out": Form("DIR", Path)})
def run(arguments: argparse.Namespace, recording: Path, out: Path | None = None) -> int:
    """Recover the recording and print the missing parts.

    Parameters
    ----------
    recording : bag directory or .mcap file, which stays unchanged
    out : directory to create (default: RUN_recovered beside it)
    """
    from tcc_sim.recording.reader import open_run
    from tcc_sim.recording.recovery import default_directory, recover

    result = recover(open_run(recording), out or default_directory(recording))
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
