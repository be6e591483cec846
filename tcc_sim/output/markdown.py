"""Markdown for the pages that commands write: tables, escaped words, and numbers for people."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]], align: str = "---",
                   first: str | None = None) -> list[str]:
    """The lines of a table; `align` is the rule below every heading: ``---`` to the left, ``---:`` to the right.

    `first` is the rule below the first heading where it is another.
    """
    rules = [align if first is None else first, *[align] * (len(head) - 1)]
    return ["| " + " | ".join(cells) + " |" for cells in (head, rules, *rows)]


def escape(words: str) -> str:
    """Words with the signs that Markdown would take for its own."""
    return words.replace("|", "\\|").replace("*", "\\*").replace("_", "\\_").replace("<", "&lt;")


def text(value: Any) -> str:
    """Numbers for people, with five digits."""
    if isinstance(value, Mapping):
        return ", ".join(f"{k}: {text(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(text(v) for v in value) + "]"
    return f"{value:.5g}" if isinstance(value, float) else "none" if value is None else str(value)
