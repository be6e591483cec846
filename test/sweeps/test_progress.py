"""Progress: bars on a terminal and in a notebook, elsewhere lines on standard error."""

from __future__ import annotations

import io
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest

from tcc_sim.sweeps.progress import ProgressLines, in_notebook, progress_bar

REFUSED = """
import multiprocessing

def refuse(*_):
    raise RuntimeError("a semaphore of the system was asked for")

multiprocessing.RLock = refuse
from tcc_sim.sweeps.progress import progress_bar

with progress_bar("part", 3) as bar:
    bar.update()
"""


class Written(io.StringIO):
    """A standard error that is no terminal, and reports each line."""

    def __init__(self) -> None:
        super().__init__()
        self.lines = threading.Semaphore(0)

    def flush(self) -> None:
        self.lines.release()


def test_without_a_terminal_lines_come_even_when_no_part_finishes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", written := Written())
    bar = ProgressLines("point", 40, 3, every=1e-3)
    for _ in range(2):
        assert written.lines.acquire(timeout=60.0)
    bar.close()
    assert set(written.getvalue().splitlines()) == {"tcc-sim: 3 of 40 points after 0 s"}


@pytest.mark.parametrize(("unit", "total", "words"), [
    ("point", 40, "2 of 40 points"), ("branches", 5, "2 of 5 branches"), (" states", None, "2 states"),
    ("s", 90.5, "2 of 90 s")])
def test_a_line_counts_finished_parts(unit, total, words, capsys):
    with progress_bar(unit, total) as bar:
        bar.set_postfix_str("at 7", refresh=False)
        bar.update(2)
        assert capsys.readouterr().err == ""
        bar.tell(60.0)
    line = capsys.readouterr().err
    assert all(each in line for each in (words, "60 s", "at 7"))
    with progress_bar(unit, total, shown=False) as hidden:
        hidden.update(2)
    assert capsys.readouterr().err == ""


def test_a_notebook_shows_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """Standard error of a kernel is no terminal; a plain IPython has no kernel."""
    shell = SimpleNamespace()
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    assert not in_notebook()
    shell.kernel = object()
    assert in_notebook()
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress_bar("point", 2) as bar:
        bar.update(2)
    assert "100%" in sys.stderr.getvalue()
    assert "2/2" in sys.stderr.getvalue()


def test_a_bar_asks_for_no_semaphore_which_an_ended_process_would_leave_behind() -> None:
    ended = subprocess.run([sys.executable, "-c", REFUSED], text=True, capture_output=True, check=False, timeout=60)
    assert (ended.returncode, ended.stderr) == (0, "")
