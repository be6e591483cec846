"""Commands in another process, and their messages for any state of the cache of kernels."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path
from typing import Any

from tcc_sim.nodes.children import end_with_parent

COMPILING = re.compile(r"^tcc-sim: compiling kernels .*\n", re.MULTILINE)


def environment(**more: str) -> dict[str, str]:
    """The variables of this process, and others, for one that finds the same modules."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **more}


def python(*words: str, cwd: Path | None = None, **more: str) -> subprocess.CompletedProcess[str]:
    """Run this interpreter with words and variables of its environment; return status, output and messages."""
    return subprocess.run([sys.executable, *words], cwd=cwd, env=environment(**more), capture_output=True, text=True,
                          timeout=300, check=False)


def end_children_with_this_process() -> None:
    """From now on Linux ends every child that the main thread starts when this process ends, even if it is killed.

    A signal is bound to the thread that starts the child, so other threads start theirs as usual.
    """
    class Child(subprocess.Popen):  # type: ignore[type-arg]
        """A child that ends with its parent."""

        def __init__(self, *words: Any, **how: Any) -> None:
            if threading.current_thread() is threading.main_thread():
                how.setdefault("preexec_fn", end_with_parent(signal.SIGTERM))
            super().__init__(*words, **how)

    if subprocess.Popen.__name__ != Child.__name__:
        subprocess.Popen = Child  # type: ignore[misc]


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
