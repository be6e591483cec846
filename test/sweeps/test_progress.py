"""Progress: bars on a terminal and in a notebook, elsewhere a line a minute, by a clock that the test turns."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from types import SimpleNamespace

import pytest
from fig02_measured import FIG02, measured

import tcc_sim
from tcc_sim.sweeps.progress import in_notebook, progress_bar


class Clock:
    """Seconds that pass where the test says so."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_without_a_terminal_a_line_a_minute_counts_what_is_done(capsys: pytest.CaptureFixture[str]) -> None:
    clock = Clock()
    with progress_bar("point", 40, 3, clock=clock) as bar:
        for clock.now in (20.0, 59.0, 60.0, 70.0, 119.0, 121.0):
            bar.set_postfix_str(f"at {clock.now:g}", refresh=False)
            bar.update()
    assert capsys.readouterr().err.splitlines() == [
        "tcc-sim: 6 of 40 points after 60 s: at 60", "tcc-sim: 9 of 40 points after 121 s: at 121"]


@pytest.mark.parametrize(("unit", "total", "line"), [
    ("branches", 5, "tcc-sim: 1 of 5 branches after 60 s"), (" states", None, "tcc-sim: 1 states after 60 s"),
    ("s", 90.5, "tcc-sim: 1 of 90 s after 60 s")])
def test_a_line_names_the_unit(unit: str, total: float | None, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    clock = Clock()
    with progress_bar(unit, total, clock=clock) as bar:
        clock.now = 60.0
        bar.update()
    assert capsys.readouterr().err == f"{line}\n"


def test_nothing_is_printed_where_nobody_asks(capsys: pytest.CaptureFixture[str]) -> None:
    clock = Clock()
    with progress_bar("point", 2, shown=False, clock=clock) as bar:
        clock.now = 100.0
        bar.update()
    assert capsys.readouterr().err == ""


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
def test_functions_show_progress_where_asked(call: Callable[..., object], line: str, monkeypatch: pytest.MonkeyPatch,
                                             capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("tcc_sim.sweeps.progress.EVERY", 0.0)
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
    assert "100%" in sys.stderr.getvalue()  # type: ignore[attr-defined]
    assert "2/2" in sys.stderr.getvalue()  # type: ignore[attr-defined]
