"""Output on a terminal: lines wrapped to its width, with continuation lines indented."""

from __future__ import annotations

import io
import os
import re
import shutil
import sys
import textwrap

NARROWEST = 40
"""Smallest width used, even if the terminal is narrower, columns."""


def terminal_width() -> int | None:
    """Return the columns of the terminal on standard output, or COLUMNS; None for a file or a pipe."""
    columns = shutil.get_terminal_size(fallback=(0, 0)).columns
    return max(columns, NARROWEST) if columns else None


def wrapped(text: str, width: int | None) -> str:
    """Return `text` with each line wider than `width` broken between words; unchanged if `width` is None.

    Continuation lines begin under the last column that starts in the left half of the line, where a column follows two
    spaces or more. For a line without columns they are indented by two characters more than the line.
    """
    if width is None:
        return text
    lines = []
    for line in text.split("\n"):
        columns = [match.end() for match in re.finditer(r"\S {2,}(?=\S)", line) if match.end() <= width // 2]
        indent = columns[-1] if columns else len(line) - len(line.lstrip()) + 2
        lines += [line] if len(line) <= width else textwrap.wrap(
            line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False,
            expand_tabs=False, replace_whitespace=False)
    return "\n".join(lines)


def say(text: str, *, flush: bool = False) -> None:
    """Print a text on standard output, wrapped to the terminal."""
    print(wrapped(text, terminal_width()), flush=flush)


def open_streams() -> None:
    """Prepare standard output and standard error for any text: a closed stream discards it, and a character that the
    encoding of a stream lacks is escaped.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
