"""What the verbs share that measure for a while: where the report goes, a bar, and an end by Ctrl-C that keeps what is
done.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class Study:
    """A study in progress.

    complete : whether it came to its end
    """

    def __init__(self, bar: Any) -> None:
        self.complete = False
        self.name = bar.set_description_str
        self._bar = bar

    def done(self, count: int, total: int, following: str) -> None:
        """Say how much of it is done, and what comes next."""
        self._bar.total = total
        self._bar.set_description_str(following, refresh=False)
        self._bar.update(count - self._bar.n)


@contextmanager
def study(unit: str) -> Iterator[Study]:
    """A study with a bar on a terminal; Ctrl-C ends its block early, says so, and leaves `complete` False."""
    from tqdm import tqdm

    with tqdm(unit=unit, disable=None, leave=False) as bar:
        found = Study(bar)
        try:
            yield found
            found.complete = True
        except KeyboardInterrupt:
            print("tcc-sim: interrupted", file=sys.stderr)


@contextmanager
def seconds_bar(name: str, total: float) -> Iterator[Callable[[float], None]]:
    """A bar on a terminal for what runs `total` s; what it gives is called with the seconds done so far."""
    from tqdm import tqdm

    with tqdm(total=total, desc=name, disable=None, leave=False,
              bar_format="{desc} {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s") as bar:
        yield lambda done: bar.update(done - bar.n)


def add_report_arguments(parser: argparse.ArgumentParser, name: str, quick: str) -> None:
    """Where the report `name` goes, and what `--quick` does."""
    parser.add_argument("--out", type=Path, default=Path(name), metavar="DIR",
                        help=f"new directory for {name}.png, .svg, .json and .md (default {name})")
    parser.add_argument("--quick", action="store_true", help=quick)
