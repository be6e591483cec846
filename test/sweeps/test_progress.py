"""Progress: bars on a terminal and in a notebook, elsewhere a line a minute."""

from __future__ import annotations

import io
import sys
import threading
from types import SimpleNamespace

import pytest
from fig02_measured import FIG02, measured

import tcc_sim
from tcc_sim.sweeps import progress
from tcc_sim.sweeps.progress import ProgressLines, in_notebook, progress_bar


class Written(io.StringIO):
    """A standard error that is no terminal, and reports each line."""

    def __init__(self) -> None:
        super().__init__()
        self.lines = threading.Semaphore(0)

    def flush(self) -> None:
        self.lines.release()


def test_without_a_terminal_lines_come_even_when_no_part_finishes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY", 1e-3)
    monkeypatch.setattr(sys, "stderr", written := Written())
    with progress_bar("point", 40, 3):
        for _ in range(2):
            assert written.lines.acquire(timeout=60.0)
    assert set(written.getvalue().splitlines()) == {"tcc-sim: 3 of 40 points after 0 s"}


@pytest.mark.parametrize(("unit", "total", "line"), [
    ("point", 40, "tcc-sim: 2 of 40 points after 60 s: at 7"),
    ("branches", 5, "tcc-sim: 2 of 5 branches after 60 s: at 7"),
    (" states", None, "tcc-sim: 2 states after 60 s: at 7"), ("s", 90.5, "tcc-sim: 2 of 90 s after 60 s: at 7")])
def test_a_line_counts_what_is_done(unit, total, line, capsys):
    with progress_bar(unit, total) as bar:
        assert isinstance(bar, ProgressLines)
        bar.set_postfix_str("at 7", refresh=False)
        bar.update(2)
        assert capsys.readouterr().err == ""
        bar.tell(60.0)
    assert capsys.readouterr().err == f"{line}\n"


def test_nothing_is_printed_where_nobody_asks() -> None:
    with progress_bar("point", 2, shown=False) as bar:
        assert not isinstance(bar, ProgressLines)
        assert bar.disable
    for shown in (True, False):
        bar = progress.begin_progress("point", shown=shown)
        assert (bar.n, bar.total) == (0, None)
        bar.close()


STEADY = tcc_sim.load_scene("controlled").with_values({"engine.torque_amplitude": 0.0})


@pytest.mark.parametrize(("call", "line"), [
    (lambda **how: tcc_sim.scatter("slip", {"engine.torque_amplitude": (1.0, 2.0)}, 2, cycles=5, jobs=1, **how),
     "tcc-sim: 2 of 2 points"),
    (lambda **how: tcc_sim.linearise(STEADY, slip=20.0, frequencies=[300.0], check=1, **how), "tcc-sim: 1 of 1 points"),
    (lambda **how: tcc_sim.identify(measured()[0], ["driveline.stiffness"], scene=FIG02, **how),
     "tcc-sim: 1 iterations"),
    (lambda **how: tcc_sim.continuation(tcc_sim.load_scene("stick").with_values({"friction.law": "set_valued"}),
                                        "engine.mean_torque", 299.0, 301.0, **how), "tcc-sim: 1 points")],
    ids=["scatter", "linearise", "identify", "continuation"])
def test_functions_show_progress_where_asked(call, line, monkeypatch, capsys):
    def update(bar: ProgressLines, count: float = 1) -> None:
        bar.n += count
        bar.tell(0.0)

    monkeypatch.setattr(ProgressLines, "update", update)
    call()
    assert capsys.readouterr().err == ""
    call(progress=True)
    assert line in capsys.readouterr().err


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
