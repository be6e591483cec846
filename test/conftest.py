"""Settings for every test."""

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

# Small matrices gain nothing from threads, which wait for each other by counting: a third of the tests' processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from interpreter import end_children_with_this_process  # NumPy reads that when it is loaded.

from tcc_sim.compiling import kernel_cache
from tcc_sim.shown_units import show_in, shown_unit


def pytest_configure() -> None:
    """Handle Ctrl-C and a hang-up as at a terminal; tests in the background or under nohup may ignore them, and their
    children inherit that. Children end with this process, even if it is killed. Announce no compilation, so that no
    output depends on the cache. Remove COLUMNS, which pytest's workers set: it would break lines that do not go to a
    terminal.
    """
    gc.set_threshold(50_000, 10, 10)
    os.environ.pop("COLUMNS", None)
    # Some 200 children would each compile the package's modules anew, half a second of processor time a child.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    end_children_with_this_process()
    kernel_cache.announced.add("compiling")
    for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)


def pytest_collection_finish() -> None:
    """Look for garbage never in what is loaded by now: with the threshold above, a fifth of the processor time."""
    gc.freeze()


@pytest.fixture(autouse=True)
def _nothing_is_left_selected() -> Iterator[None]:
    """Fail a test that leaves other units behind, which would change what tests after it print and draw."""
    yield
    left = shown_unit(engine=True)
    show_in("rad", 1.0)
    if "matplotlib" in sys.modules and "tcc_sim.views.style" in sys.modules:
        sys.modules["tcc_sim.views.style"].use_file(None)
    assert left == ("rad/s", 1.0)


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Function that runs a command in `tmp_path` which is refused by one line and status 2, prints nothing else and
    writes no file; it returns that line.
    """
    from tcc_sim.cli import main

    monkeypatch.chdir(tmp_path)

    def run(*words: object) -> str:
        before, _ = sorted(tmp_path.rglob("*")), capsys.readouterr()
        assert main([str(word) for word in words]) == 2
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert err.startswith("tcc-sim")
        assert sorted(tmp_path.rglob("*")) == before
        return err

    return run


@pytest.fixture
def laid_out(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Every figure that is saved, laid out but not rendered; its file is empty. Skips without matplotlib."""
    figure = pytest.importorskip("matplotlib.figure")
    from matplotlib.ticker import FixedLocator

    saved: list[Any] = []

    def keep(drawn: Any, path: Path, **_: object) -> None:
        for side in (each for axis in drawn.axes for each in (axis.xaxis, axis.yaxis)):
            side.set_major_locator(FixedLocator(side.get_majorticklocs()))  # A style that no longer applies has others.
        saved.append(drawn)
        Path(path).touch()

    monkeypatch.setattr(figure.Figure, "savefig", keep)
    return saved


@pytest.fixture
def without_layout(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures without a layout, which takes longer than everything else: for tests of what is drawn, not of where."""
    monkeypatch.setattr("matplotlib.figure.Figure.get_layout_engine", lambda drawn: None)


@pytest.fixture
def pictures(laid_out: list[Any], without_layout: None) -> list[Any]:
    """Every figure that is saved, neither laid out nor rendered."""
    return laid_out
