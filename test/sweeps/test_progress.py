"""Progress: bars on a terminal and in a notebook, elsewhere a line a minute, by a clock that the test turns."""

from __future__ import annotations

import io
import sys
from types import SimpleNamespace

import pytest

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
