"""Commands in another process, and their messages for any state of the cache of kernels."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

COMPILING = re.compile(r"^tcc-sim: compiling kernels for this kind of scene, about \d+ s, "
                       r"(once|in every process, since they cannot be kept)\n", re.MULTILINE)


def environment(**more: str) -> dict[str, str]:
    """The variables of this process, and others, for one that finds the same modules."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **more}


def python(*words: str, cwd: Path | None = None, **more: str) -> subprocess.CompletedProcess[str]:
    """Run this interpreter with words and variables of its environment; return status, output and messages."""
    return subprocess.run([sys.executable, *words], cwd=cwd, env=environment(**more), capture_output=True, text=True,
                          timeout=300, check=False)


def without_compiling(said: str) -> str:
    """Return standard error without the lines that announce compilation."""
    return COMPILING.sub("", said)


def rerun_rows(file: Path) -> Counter[str]:
    """Rows by entity in a Rerun file, complete or growing."""
    printed = python("-m", "rerun_cli", "rrd", "print", str(file), HOME=str(file.parent))
    rows: Counter[str] = Counter()
    for count, entity in re.findall(r"with (\d+) rows .*? - (/\S+) - data", printed.stdout):
        rows[entity] += int(count)
    return rows
