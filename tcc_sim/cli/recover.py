"""`tcc-sim recover`: a complete, indexed bag beside a recording that was cut short or damaged."""

from __future__ import annotations

import argparse
from pathlib import Path

from tcc_sim.recording.reader import open_run
from tcc_sim.recording.recovery import default_directory, recover


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The recording and where the new one goes."""
    parser.add_argument("recording", metavar="RUN", type=Path, help="bag directory or .mcap file; it stays as it is")
    parser.add_argument("--out", metavar="DIR", type=Path,
                        help="directory to create (default: RUN_recovered beside it)")


def run(arguments: argparse.Namespace) -> int:
    """Recover and say what is missing."""
    recording = open_run(arguments.recording)
    found = recover(recording, arguments.out or default_directory(arguments.recording))
    print(f"recovered {sum(found.messages.values())} messages into {found.directory}")
    for topic, count in found.messages.items():
        print(f"  {topic}: {count}")
    for sentence in found.missing:
        print(f"  missing: {sentence}")
    if not found.missing:
        print("  nothing is missing; the original was complete" if found.complete else "  nothing is missing")
    return 0
