"""What a terminal shows: lines that are no wider than it, of which what is broken goes on under the place where its
text begins, and bars for what takes a while.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

NARROWEST = 40
"""Columns that are filled even where a terminal has fewer."""


def terminal_width() -> int | None:
    """Columns of the terminal that is standard output, or what COLUMNS says; None for a file or a pipe."""
    columns = shutil.get_terminal_size(fallback=(0, 0)).columns
    return max(columns, NARROWEST) if columns else None


def wrapped(text: str, width: int | None) -> str:
    """`text` with every line that is wider than `width` broken between words; as it is where `width` is None.

    The parts go on under the last column that begins within the left half of the line: two spaces or more stand before
    it. A line without columns goes on two places further in than it begins.
    """
    if width is None:
        return text
    return "\n".join(part for line in text.split("\n") for part in (
        [line] if len(line) <= width else textwrap.wrap(
            line, width, subsequent_indent=" " * _indent(line, width), break_long_words=False, break_on_hyphens=False,
            expand_tabs=False, replace_whitespace=False)))


def _indent(line: str, width: int) -> int:
    """Where the second part of a broken line begins."""
    columns = [found.end() for found in re.finditer(r"\S {2,}(?=\S)", line) if found.end() <= width // 2]
    return columns[-1] if columns else len(line) - len(line.lstrip()) + 2


def say(text: str, *, flush: bool = False) -> None:
    """Print what a command has to say on standard output."""
    print(wrapped(text, terminal_width()), flush=flush)


def open_streams() -> None:
    """Take whatever is printed: a stream that the caller closed takes it to nowhere, and one whose encoding lacks a
    character gets that escaped.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


class CountedBar:
    """Progress of what is done part by part.

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
def counted_bar(unit: str) -> Iterator[CountedBar]:
    """Progress of what Ctrl-C may end early; it then says so, and leaves `complete` False."""
    from tcc_sim.sweeps.progress import progress_bar

    with progress_bar(unit, leave=False) as bar:
        found = CountedBar(bar)
        try:
            yield found
            found.complete = True
        except KeyboardInterrupt:
            print("tcc-sim: interrupted", file=sys.stderr)


@contextmanager
def seconds_bar(name: str, total: float) -> Iterator[Callable[[float], None]]:
    """Progress of what runs `total` s; what it gives is called with the seconds done so far."""
    from tcc_sim.sweeps.progress import progress_bar

    with progress_bar("s", total, desc=name, leave=False,
                      bar_format="{desc} {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s") as bar:
        yield lambda done: bar.update(done - bar.n)
