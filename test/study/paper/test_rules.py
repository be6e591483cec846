"""Rules that claims share, at and beside their bounds, for curves written down here."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from given import Given, curve_along, record, stretch

from tcc_sim.study.paper import claims_jumps, evidence, rules
from tcc_sim.study.paper.branches_behind import Motion, highest_shares
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, paper_system
from tcc_sim.study.paper.claims_periods import covered_down_to, repeats
from tcc_sim.study.paper.evidence import FAILED, RUNAWAY, T
from tcc_sim.study.paper.rules import CONFIRMED, DEPENDS, NOT_CONFIRMED, Curves, Measured
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Plan, Sweep
from tcc_sim.trajectory import State, Status

HALF, NONE = np.array([True, True, False, False]), np.zeros(4, bool)


@pytest.mark.parametrize(("function", "arguments", "expected"), [
    (rules.grow, ([1.0, 2.0, 3.0],), True), (rules.grow, ([1.0, 1.0],), False), (rules.grow, ([2.0, 1.0],), False),
    (rules.grow, ([1.0],), True), (rules.some, ([True, True],), CONFIRMED), (rules.some, ([False, True],), DEPENDS),
    (rules.some, ([False],), NOT_CONFIRMED), (rules.some, ([],), CONFIRMED),
    *((rules.denominator, ({"pressure.frequency_ratio": ratio},), n) for ratio, n in (
        (0.5, 2), (2.0, 1), (2 / 3, 3), (4 / 3, 3), (1 / 12, 12), (5 / 12, 12), (1 / 13, 12))),
    (rules.denominator, ({},), 1),
    (evidence.share_where, (HALF, ~NONE), 0.5), (evidence.share_where, (HALF, NONE), 1.0),
    (evidence.share_where, (HALF, HALF), 1.0), (evidence.share_where, (NONE, HALF), 0.0),
    (evidence.two_digits, (1234.5,), 1200.0), (evidence.two_digits, (-0.01257,), -0.013),
    (evidence.rms_apart, (np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, -4.0, 3.0, 4.0])), 0.75),
    (evidence.with_kinetic, (0.5, {"a": 1}), {"a": 1, "friction.kinetic_coefficient": 0.15}),
    (evidence.with_kinetic, (1.0,), {"friction.kinetic_coefficient": 0.3}),
    (evidence.period_of, (None,), FAILED), (claims_jumps.nearest, ([0.1, 0.25, 0.4], 0.3), 0.25),
    (claims_jumps.nearest, ([], 0.3), None), (repeats, (np.zeros(64),), 1),
    *((repeats, (np.tile([1.0, 2.0, 1.0, 2.0 + off], 16),), n) for off, n in (
        (0.0, 2), (0.9999e-5, 2), (1.1e-5, 4))),
    (repeats, (np.tile(1e3 + 1e-6 * np.array([0.0, 1.0, 3.0, 9.0]), 16),), 1),
    *((repeats, (np.tile(np.arange(float(n)), 5),), n if n <= 16 else 0) for n in (16, 17)),
    (covered_down_to, ([stretch(0.5, 1.0, 3), stretch(0.8, 1.0, 2), stretch(0.7, 0.8), stretch(0.6, 0.7 - 1e-5)], 1.0),
     0.7),
    (covered_down_to, ([], 1.0), 1.0), (covered_down_to, ([stretch(0.8, 1.0), stretch(0.6, 0.85, 2)], 1.0), 0.6),
    *((highest_shares, ([{"low": [[1.0], [1.0]], "high": [[2.0], [2.0]], "two": [[0.5, 3.0], [1.5]]}[name]
                         for name in pair.split()], ~NONE[:2]), shares)
      for pair, shares in (("low two", (0.0, 0.5)), ("two low", (0.5, 1.0)), ("high low", (1.0, 1.0)))),
    (highest_shares, ([[[3.0], [1.0]], [[2.0], [2.0]], [[1.0], [3.0]]], HALF[:2]), (0.5, 0.5)),
    (highest_shares, ([[[1.95], [1.9]], [[2.0], [2.0]]], HALF[:2]), (0.5, 0.5)),
    (highest_shares, ([[[0.125], [0.1]], [[0.0], [0.0]]], HALF[:2]), (1.0, 1.0))])
def test_a_rule_by_hand(function: Any, arguments: Any, expected: Any) -> None:
    assert function(*arguments) == (pytest.approx(expected) if isinstance(expected, float) else expected)


def test_thresholds_are_those_of_the_page() -> None:
    assert vars(T) == {"near": 0.02, "close": 0.01, "ends": 0.004, "jump": 0.08, "prominent": 0.02, "shows": 0.05,
                       "slipping": 0.1, "alike": 0.05, "missing": 0.05, "factor": 1.0}
    assert FAILED != RUNAWAY
    assert min(FAILED, RUNAWAY) < 0 > max(FAILED, RUNAWAY)
    kept = Given(lambda *at: record())
    assert kept.most == pytest.approx(0.95)
    assert kept.used == {"missing"}


def points(*regimes: str | None, period: int = 1) -> Sweep:
    """A sweep with a motion of each regime; None is a failure, and `away` runs away."""
    rows = [None if name is None else record(period=period, regime=name) for name in regimes]
    rows = [row if row is None or row.summary.regime != "away" else replace(row, summary=replace(
        row.summary, runaway=True)) for row in rows]
    return Sweep(curve_along(paper_system(), "engine.frequency", tuple(map(float, range(1, len(rows) + 1)))),
                 Plan(), rows, 0.0)


def test_stick_slip_and_failure_are_told_apart() -> None:
    sweep = points("stick", "slip", "stick-slip", None, "away")
    assert evidence.sticks(sweep).tolist() == [True, False, False, False, False]
    kept = Given()
    assert kept.slips(sweep).tolist() == [False, True, True, False, True]
    assert kept.periods(sweep).tolist() == [1, 1, 1, FAILED, RUNAWAY]


@pytest.mark.parametrize(("values", "jump", "steep"), [
    ([0.0, 8.0, 16.0], 0.5, []), ([0.0, 8.1, 16.0], 0.5, [0]), ([16.0, 4.0, math.nan, 12.0], 0.5, [0]),
    ([0.0, 1.0, 1.0], 0.5, [0]), ([1.0, 1.0], 0.0, [])])
def test_a_jump_exceeds_its_share_of_the_largest_value(values: Any, jump: float, steep: Any) -> None:
    assert evidence.steep(np.array(values), jump).tolist() == steep


@pytest.mark.parametrize(("phases", "slip", "state", "share"), [
    ([0.0, 0.25, 0.5, 0.75], [1.0, 2.0, 4.0, 8.0], [1, 1, 1, 1], 0.2),
    ([0.0, 0.25, 0.5, 0.75], [1.0, 2.0, 4.0, -8.0], [1, 1, 1, -1], 3 / 7),
    ([0.25, 0.75, 1.25, 1.75], [1.0, 2.0, 4.0, 8.0], [1, 0, 1, 1], 5 / 13),
    ([0.0, 0.5], [1.0, 1.0], [0, 0], math.nan), ([1.0 - 1e-13, 0.5 - 1e-13], [3.0, 1.0], [1, 1], 0.75)])
def test_slip_in_the_first_half_of_the_cycle_by_hand(phases: Any, slip: Any, state: Any, share: float) -> None:
    """A phase of 1/2 belongs to the second half, and one that rounding leaves just below 1 to the next cycle."""
    run: Any = SimpleNamespace(t=4.0 * np.array(phases), cycle=4.0, slip_speed=np.array(slip), state=np.array(state))
    assert evidence.first_half(run) == pytest.approx(share, nan_ok=True)


def test_the_end_of_later_cycles_and_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """500 further cycles of pure stick, of which the last 100 are judged: period one from cycle 550 to 650."""
    system = paper_system({"friction.law": "set_valued", "engine.frequency": 0.46 * OMEGA_N,
                           "initial.slip_speed": 0.0, "initial.plate_angle": 0.1})
    summary, end = evidence.later(system, Start(State.at_start(system), 150))  # type: ignore[misc]
    assert (summary.period, summary.regime, summary.cycles, end.cycle) == (1, "stick", 100, 650)
    monkeypatch.setattr(evidence, "solve", lambda *task, **how: SimpleNamespace(status=Status.STEP_LIMIT, cycles=None))
    assert evidence.later(system, end) is None


THREE = np.array([[1.0, 1.0, 0.05, 2.0], [2.0, 0.97, 0.1, 2.0625], [3.0, 5.0, 0.0, 0.125]])
"""Maxima of three curves at four ratios; the third ratio does not slip."""


def curves(maxima: Any = THREE, periods: Any = ((1, 2, 0, 1), (2, 2, 2, 4), (1, 1, 1, 1))) -> Curves:
    kept = Given()
    rows = {"a": {}, "b": {"pressure.frequency_ratio": 0.5}, "c": {}}
    result = Curves(kept, rows, np.array([0.1, 0.2, 0.3, 0.4]), [], maxima, np.array([HALF, ~HALF, ~NONE]))
    vars(result)["periods"] = np.array(periods)
    return result


def test_curves_of_a_figure_by_hand() -> None:
    result, every = curves(), ~NONE
    assert result.any_slips().tolist() == [True, True, False, True]
    assert result.parts(np.array([HALF, HALF, HALF])) == [1.0, 0.0, 0.5]
    assert result.off_period() == [0.5, 0.5, 0.0]
    assert result.means(HALF) == pytest.approx([1.0, 1.485, 4.0])
    assert [result.best(k, every) for k in range(3)] == pytest.approx([2 / 3, 1 / 3, 1 / 3])
    assert [result.best(k, every, -1.0) for k in range(3)] == pytest.approx([0.0, 1 / 3, 2 / 3])
    assert [result.exceptions(k, every) for k in range(3)] == [[0.4], [0.1, 0.3, 0.4], [0.1, 0.2]]
    assert result.exceptions(0, HALF) == []


@pytest.mark.parametrize(("off", "best"), [(0.05, 1.0), (0.0501, 0.0), (-1.0, 1.0)])
def test_a_curve_is_the_lowest_up_to_a_difference_that_shows(off: float, best: float) -> None:
    """And the highest likewise, mirrored."""
    result = curves(np.array([[1.0 + off] * 4, [1.0] * 4, [2.5] * 4]))
    assert result.best(0, ~NONE) == best
    assert curves(5.0 - result.maxima).best(0, ~NONE, -1.0) == best
    assert result.exceptions(0, ~NONE) == ([] if best else [0.1, 0.2, 0.3, 0.4])


def test_a_count_near_marks_is_compared_with_that_near_any_ratio() -> None:
    """A fifth of the ratios from 0.14 to 0.36 lies below 0.1841."""
    marks = {"low": 0.15, "high": 0.3}
    result = rules.more_than_anywhere(lambda x: 5.0 * (x < 0.1841), marks, "found", {"more": 1}, "not near {}", ())
    anywhere = 5.0 * 45 / 221
    assert result == Measured([(True, True), (False, True)], {
        "found": {"low": 5.0, "high": 0.0}, "near any ratio, on average": pytest.approx(anywhere), "more": 1},
        "not near high", ())
    same = rules.more_than_anywhere(lambda x: 2.0, marks, "found", {}, "not near {}")
    assert (same.judged, same.why) == ([(False, True)] * 2, "not near low, high")
    assert rules.more_than_anywhere(lambda x: float(x in (0.15, 0.3)), marks, "found", {}, "not near {}").why == ""


@pytest.mark.parametrize("change", [0.1, 0.37, 0.9])
def test_a_change_is_found_by_halving(change: float) -> None:
    for sign in (1.0, -1.0):
        asked: list[float] = []

        def holds(x: float, sign: float = sign, asked: list[float] = asked) -> bool:
            asked.append(x)
            return sign * x > sign * change

        assert rules.place_of_change(holds, 0.0, 1.0, 10) == pytest.approx(change, abs=0.5**11 * 1.0001)
        assert len(asked) == 11


@pytest.mark.parametrize(("criterion", "judged", "verdict"), [
    (rules.shares("a"), (0.95, 0.95), CONFIRMED), (rules.shares("a"), (0.75, 0.75), DEPENDS),
    (rules.shares("a"), (0.74, 0.95), DEPENDS), (rules.shares("a"), (0.74, 0.94), NOT_CONFIRMED),
    (rules.shares("a", 0.5), (0.5,), DEPENDS), (rules.shares("a", 0.5), (0.49,), NOT_CONFIRMED),
    (rules.near("a", 0.25), ((1.25, 1.0), (0.75, 1.0)), CONFIRMED),
    (rules.near("a", 0.25), ((1.26, 1.0),), NOT_CONFIRMED),
    (rules.near("a", 0.25), ((math.inf, 1.0),), NOT_CONFIRMED), (rules.holds("a", "b"), (False, False), NOT_CONFIRMED),
    (rules.holds("a", "b"), (True, False), CONFIRMED)])
def test_a_criterion_at_its_bounds(criterion: Any, judged: Any, verdict: str) -> None:
    limits = {"missing": 0.05, "factor": 1.0}
    assert criterion.verdict(judged, lambda name: limits[name]) == verdict


def test_criteria_say_their_thresholds() -> None:
    assert [criterion.words for criterion in (
        rules.holds("it is"), rules.holds("it is", "it was"), rules.shares("cases"), rules.shares("cases", 0.5),
        rules.near("a ratio", 0.02), rules.equal("the period"))] == [
        "it is", "it is; depends where it was",
        "cases at 0.95 or more of them; depends where at 0.75 or more, or in one of several parts alone",
        "cases at 0.95 or more of them; depends where at 0.5 or more, or in one of several parts alone",
        "a ratio within 0.02; depends where some are so and others are not",
        "the period; depends where some are so and others are not"]
    assert rules.near("a", 0.1).verdict([(1.15, 1.0)], lambda name: 2.0) == CONFIRMED


@pytest.mark.parametrize(("name", "values", "peaks"), [
    ("alone", [0, 0, 0, 10, 0, 0, 0], [3]), ("at the ends", [10, 0, 0, 0, 0, 0, 9], []),
    ("two within five values", [0, 0, 8, 0, 0, 10, 0], [5]), ("six apart", [0, 8, 0, 0, 0, 0, 0, 10, 0], [1, 7]),
    ("five apart", [0, 8, 0, 0, 0, 0, 10, 0], [6]), ("less than 2 % high", [9.9, 9.9, 10, 9.9, 9.9], []),
    ("on one side", [9.9, 9.9, 10, 5, 5], []), ("on the other", [5, 5, 10, 9.9, 9.9], []),
    ("exactly", [98, 100, 98], []), ("beside a gap", [0, math.nan, 10, 0, 0], [2])])
def test_prominent_maxima(name: str, values: Any, peaks: list[int]) -> None:
    axis = np.arange(float(len(values)))
    assert Given().prominent_maxima(axis, np.array(values, float)) == pytest.approx(peaks)


def test_a_motion_in_words_at_one_value_and_at_none() -> None:
    motion = Motion("", "sigma", [2.0, 1.0, 3.0], stretch(1.0, 3.0, 4))
    assert motion.words.endswith("within 2650 cycles (13) leads to it at 1 to 3 (3 values)")
    assert motion.words.startswith("period 4, stable over sigma from 1 (followed no further) to 3 (")


@pytest.mark.parametrize(("number", "band", "word", "chosen", "verdict", "why"), [
    (8, "to 0.29", "lowest", (), (True, True), ""), (8, "to 0.29", "highest", (), (False, False),
     "another curve is the highest in the mean"),
    (8, "from 0.31 to 0.45", "lowest", (), (False, False), "another curve is the lowest in the mean"),
    (8, "from 0.31 to 0.45", "highest", (), (True, True), "")])
def test_the_first_curve_is_the_lowest_in_a_band(number: int, band: str, word: str, chosen: Any, verdict: Any,
                                                 why: str) -> None:
    """psi = 0 lies 1 rad/s below the others up to 0.3, and above them beyond."""
    given = Given(lambda row, x, d: record(10.0 + (row["pressure.phase"] == 0.0) * (2.0 * (x > 0.3) - 1.0)))
    result = given.lowest(number, band, word, chosen)
    assert (tuple(result.judged), result.why) == (verdict, why)
    assert result.values["mean"][1:] == pytest.approx([10.0, 10.0])
    assert ("beaten" in result.values) == (word == "lowest")


@pytest.mark.parametrize(("word", "part"), [("fall", 1.0), ("rise", 0.0)])
def test_maxima_fall_from_curve_to_curve(word: str, part: float) -> None:
    given = Given(lambda row, x, d: record(10.0 - row["pressure.amplitude"] / 1e4))
    assert given.ordered(13, "to 0.29", word).judged == [part]
    assert Given().ordered(13, "to 0.29", word).judged == [1.0]


def test_curves_of_a_figure_have_its_axis_rows_and_start() -> None:
    given = Given(lambda row, x, d: record(10.0 * ("cold", "up", "down").index(d) + x,
                                           regime="stick" if x < 0.1 else "slip"))
    for number, axis in ((4, rules.FINER), (8, rules.AXIS)):
        result = given.figure(number, way="up")
        np.testing.assert_allclose(result.maxima, np.tile(10.0 + axis, (len(FIGURES[number].series), 1)))
        assert result.slips[0].tolist() == (axis >= 0.1).tolist()
    assert list(given.figure(8, [2]).rows.values()) == [FIGURES[8].series[2].values]
