"""Words of options: numbers, ranges and lists are read, or one line refuses them with the option and its range."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from tcc_sim import cli
from tcc_sim.cli.options import bounds_of_range, spaced, values_of_range
from tcc_sim.errors import InputError

SWEEP = ["sweep", "fig02"]
OVER = ["--over", "engine.frequency=140:150:2"]
SCATTER = ["--scatter", "pressure.mean=22e4:26e4", "--samples", "2"]


@pytest.mark.parametrize(("words", "low", "high"), [
    (["analyse", "a", "--pulses"], 1, 10000), (["simulate", "a", "--pulses"], 1, 10000),
    (["demo", "--duration"], 0.5, 86400.0), (["fmu", "a", "--step"], 5e-5, 1.0),
    (["control", "torque", "1", "--rate"], 0.1, 1000.0)])
def test_a_number_may_be_at_both_ends_of_its_range_and_not_beyond(words: list[str], low: float, high: float,
                                                                  refused: Callable[..., str]) -> None:
    whole, name = isinstance(low, int), words[-1].removeprefix("--")
    for bound, beyond in ((low, low - 1 if whole else math.nextafter(low, 0.0)),
                          (high, high + 1 if whole else math.nextafter(high, math.inf))):
        value = vars(cli.build_parser(words[0]).parse_args([*words, repr(bound)]))[name]
        assert (value, type(value)) == (bound, type(low))
        for wrong in (repr(beyond), "x", "nan", *(["1.5"] if whole else [])):
            line = refused(*words, wrong)
            assert all(part in line for part in (words[-1], wrong, f"{low:g}", f"{high:g}"))


@pytest.mark.parametrize(("text", "values"), [
    ("a=1:2:1", [1.0]), ("a=1:2:2", [1.0, 2.0]), ("a=-2:2:3", [-2.0, 0.0, 2.0]), ("a=2:1:2", [2.0, 1.0]),
    ("a=1:16:3:log", [1.0, 4.0, 16.0]), ("a=-1:-16:3:log", [-1.0, -4.0, -16.0]), ("a=3,1", [3.0, 1.0]),
    ("engine.speed=60rpm,1hz", [2.0 * math.pi, 2.0 * math.pi])])
def test_a_range_is_its_numbers(text: str, values: list[float]) -> None:
    assert values_of_range(text) == (text.partition("=")[0], pytest.approx(values))


@pytest.mark.parametrize("text", ["a", "a=3", "a=1:2", "a=1:2:3:4", "a=1:2:x", "a=1:2:1.5", "a=1:x:2", "a=1,x",
                                  "a=1,inf", "a=1:nan:3", "a=1:2,3:4", "engine.frequency=60rpm,1hz", "a=1:2:0",
                                  "a=1:2:1000001", "a=0:2:3:log", "a=-1:2:3:log"])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        values_of_range(text)


def test_ranges_of_other_options() -> None:
    assert len(spaced("1:2:1000000", "--x", False)) == 1_000_000
    assert spaced("1hz:2hz:2", "--x", False) == pytest.approx([2.0 * math.pi, 4.0 * math.pi])
    assert bounds_of_range("a=3:-1", "--x") == ("a", -1.0, 3.0)
    for text in ("a", "a=1", "a=1:2:3", "a=1:x", "a=1:1"):
        with pytest.raises(InputError, match=f"--x is '{text}'"):
            bounds_of_range(text, "--x")
    with pytest.raises(InputError, match="--plane"):
        values_of_range("a=1:2:3:log", "--plane", even=True)


@pytest.mark.parametrize(("words", "names"), [
    (SWEEP, "--over"), ([*SWEEP, *OVER * 3], "--over"), ([*SWEEP, *OVER, "--quantiles", "0.5"], "--scatter"),
    ([*SWEEP, *OVER, "--every-sample"], "--scatter"), ([*SWEEP, *OVER, "--samples", "3"], "--scatter"),
    ([*SWEEP, *SCATTER[:2]], "--samples"), ([*SWEEP, *SCATTER, *OVER * 2], "--over"),
    ([*SWEEP, *SCATTER, "--quantiles", "0.1,x"], "--quantiles"), ([*SWEEP, *SCATTER, "--quantiles", "1.5"], "1.5"),
    ([*SWEEP, *OVER, "--orders", "100,x"], "--orders"), ([*SWEEP, *OVER, "--discard", "1.5"], "--discard"),
    (["linearise", "slip", "--controller", "1"], "--controller"),
    (["linearise", "slip", "--controller", "1,x"], "--controller"),
    (["identify", "T.csv", "--free", "driveline.stiffness="], "--free"),
    (["analyse", "R", "--joints", "wheel=a"], "flywheel=NAME"), (["analyse", "R", "--target", "0:1,2"], "--target"),
    (["analyse", "R", "--target", "1:2,1.0:3"], "--target"),
    (["simulate", "fig02", "--out", "a.npz", "--samples", "1000001"], "1000000"),
    (["simulate", "fig02", "--out", "a.npz", "--samples", "0"], "1000000"),
    (["simulate", "fig02", "--samples", "9"], "--samples"), (["simulate", "fig02", "--title", "A"], "--title"),
    (["explain", "fig02", "--width", "column"], "--width"), ([*SWEEP, *OVER, "--width", "column"], "--width"),
    (["simulate", "fig02", "--samples", "9", "--plot", "a.png", "--json", "a.json"], "--samples"),
    (["linearise", "slip", "--title", "A"], "--title"), (["analyse", "R", "--title", "A"], "--title"),
    (["simulate", "fig02", "--plot", "a.gif"], ".png"), (["simulate", "fig02", "--out", "a.txt"], ".npz"),
    (["demo", "--controller", "sh 'a"], "--controller"), (["demo", "--controller", ""], "--controller"),
    (["demo", "--controller", "no_such_program a"], "no_such_program"),
    (["demo", "--scene", "fig02", "--controller", "sh"], "fig02")])
def test_options_that_do_not_go_together_or_are_misspelt(words: list[str], names: str, refused: Callable[..., str],
                                                         tmp_path: Path) -> None:
    if words[0] == "demo":
        pytest.importorskip("rclpy", reason="a demo without ROS 2 names that instead")
    (tmp_path / "T.csv").write_text("t,slip_speed\n" + "".join(f"{k},1\n" for k in range(60)))
    assert names in refused(*words)


@pytest.mark.parametrize(("orders", "frequency"), [("955rpm", 955.0 * math.pi / 15.0), ("16hz", 32.0 * math.pi)])
def test_orders_of_a_sweep_are_taken_at_these_frequencies(orders: str, frequency: float, tmp_path: Path) -> None:
    """The scene has two periods of the excitation in a revolution."""
    path = tmp_path / "a.json"
    words = ["--set", "engine.order=2", "--over", "pressure.mean=3e5:3.1e5:1", "--orders", orders, "--json", str(path)]
    assert cli.main(["sweep", "runup", *words]) == 0
    for each in json.loads(path.read_text())["orders"]:
        assert each["speeds"] == pytest.approx([frequency])
