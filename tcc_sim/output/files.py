"""New files that appear whole or not at all, and never over existing ones unless that was asked for."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

STANDARD_OUTPUT = Path("-")


@contextmanager
def draft(path: Path) -> Iterator[Path]:
    """A path beside `path`, of the same suffix, that takes its place when the `with` ends well and is removed
    otherwise.
    """
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write values as JSON to a file, or to standard output for '-'."""
    text = json.dumps(values, allow_nan=False, indent=1) + "\n"
    if path == STANDARD_OUTPUT:
        sys.stdout.write(text)
        return
    with draft(path) as part:
        part.write_text(text, encoding="utf-8")
