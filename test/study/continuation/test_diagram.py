"""Sweeps of textbook maps: every motion on a branch, every jump and every end of a stable stretch with its cause."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from textbook_maps import Step, TextbookMap, logistic

from tcc_sim.study.continuation.branch import Branch
from tcc_sim.study.continuation.diagram import (
    SWEPT,
    SettledMotion,
    amplitude_of,
    bifurcation_diagram,
    left_out,
    place_of,
)
from tcc_sim.study.continuation.loss_of_stability import (
    APERIODIC,
    BASIN,
    NOT_FOLLOWED,
    STEEP,
    SegmentEnd,
    StableSegment,
    jumps_of,
    nearest_bifurcation,
    segment_of,
    stable_segments,
)
from tcc_sim.study.continuation.shooting import ParameterRange

FOLD = 2.0 / (3.0 * math.sqrt(3.0))


def hysteresis(x, p):
    """x' = x + 0.3 (p + x - x^3): two stable fixed points for |p| < 2/(3 sqrt 3), where each meets the unstable one."""
    return x + 0.3 * (p[0] + x - x**3), np.array([[1.0 + 0.3 * (1.0 - 3.0 * x[0] ** 2)]]), np.array([[0.3]])


def subcritical(x, p):
    """x' = -(1 + p) x - x^3 + x^5/2: 0 loses its stability at p = 0 to a period two that is there already."""
    slope = -(1.0 + p[0]) - 3.0 * x[0] ** 2 + 2.5 * x[0] ** 4
    return -(1.0 + p[0]) * x - x**3 + 0.5 * x**5, np.array([[slope]]), -x[:, None]


def swept(step: Step, values, start, cycles=400, hand_over=False, period_of=lambda points: 1) -> list[SettledMotion]:
    """Motions of a map from cold starts, or each from the end of the one before."""
    out, x = [], np.array([start])
    for value in values:
        x = x if hand_over else np.array([start])
        points = []
        for _ in range(cycles):
            x = step(x, (value,))[0]
            points.append(float(x[0]))
        out.append(SettledMotion(float(value), x, cycles, period_of(points), max(map(abs, points[-16:]))))
    return out


def lifted(values, start, **how) -> list[SettledMotion]:
    """Motions of `hysteresis` with the sizes x + 2, which differ on its two branches."""
    return [SettledMotion(s.value, s.state, s.cycle, 1, float(s.state[0]) + 2.0)
            for s in swept(hysteresis, values, start, **how)]


def period(points) -> int:
    return next((n for n in range(1, 17) if abs(points[-1] - points[-1 - n]) < 1e-9), 0)


def surveyed(step: Step, seen: list[SettledMotion], low: float, high: float, settings=SWEPT) -> list[Branch]:
    return bifurcation_diagram(TextbookMap(step, 1), ParameterRange(low, high, name="p"), seen, settings=settings)


@pytest.mark.parametrize("up", [True, False])
def test_a_jump_of_a_continued_sweep_is_the_fold_at_its_end(up) -> None:
    way = 1 if up else -1
    seen = lifted(np.linspace(-1.0, 1.0, 41)[::way], -1.3 * way, hand_over=True)[::way]
    branches = bifurcation_diagram(Lifted(hysteresis, 1), ParameterRange(-1.0, 1.0, name="p"), seen)
    assert len(branches) == 1
    jump, = jumps_of(seen, branches, 0.2)
    assert jump.cause == "fold"
    assert jump.value == pytest.approx(FOLD if up else -FOLD, abs=1e-9)
    assert jump.low < jump.value < jump.high


def test_a_motion_between_the_last_point_and_the_fold_lies_on_the_branch() -> None:
    seen = lifted(np.linspace(-1.0, 1.0, 41), -1.3, hand_over=True)
    branch, = bifurcation_diagram(Lifted(hysteresis, 1), ParameterRange(-1.0, 1.0, name="p"), seen)
    last = max(s.value for s in branch.points if s.orbit.section[0] < 0.0)
    p = 0.5 * (last + FOLD)
    x = float(np.roots([1.0, 0.0, -1.0, -p]).real.min())
    assert last < p < FOLD
    assert place_of(SettledMotion(p, np.array([x]), 0, 1, x + 2.0), [branch], amplitude_of(seen)) is not None


class Lifted(TextbookMap):
    """A map whose size is x + 2."""

    def observe(self, x, values, first, cycles):
        return super().observe(x, values, first, cycles)._replace(largest=float(x[0]) + 2.0)


def test_a_jump_between_motions_that_both_go_on_is_the_boundary_of_their_basins() -> None:
    # From 0.1 - p cold starts reach the upper motion where the unstable one lies below.
    seen = lifted(np.linspace(-0.3, 0.3, 21), 0.05)
    branches = bifurcation_diagram(Lifted(hysteresis, 1), ParameterRange(-0.3, 0.3, name="p"), seen)
    assert len(branches) == 2
    jump, = jumps_of(seen, branches, 0.2)
    assert (jump.cause, jump.bifurcation) == (BASIN, None)
    assert jump.low <= -0.05 + 0.05**3 <= jump.high  # the unstable motion is at the start: p + x - x^3 = 0


@pytest.mark.parametrize(("direction", "side", "fold"), [
    ("up", 1.0, 1.0), ("down", -1.0, -1.0), ("cold", 1.0, -1.0), ("cold", -1.0, 1.0)])
def test_the_motion_that_was_followed_ends_in_the_cause_of_a_jump(direction: str, side: float, fold: float) -> None:
    """Cold starts follow no motion; the cause is the end nearest to the middle of the jump."""
    # p + x - x^3 = 0: the lower motion ends at p = 2/3^1.5, the upper one at -2/3^1.5.
    seen = [s for p in (-0.5 - 0.05 * side, 0.5 - 0.05 * side) for s in lifted([p], p)]
    branches = bifurcation_diagram(Lifted(hysteresis, 1), ParameterRange(-0.6, 0.6, name="p"), seen)
    jump, = jumps_of(seen, branches, 0.2, direction=direction)
    assert (jump.cause, jump.value) == ("fold", pytest.approx(fold * 2.0 / 3.0**1.5, abs=1e-9))


def test_a_jump_at_a_doubling_names_it_and_its_unstable_branch_is_followed() -> None:
    seen = swept(subcritical, np.linspace(-0.31, 0.09, 5), 1e-3, cycles=4000, period_of=period)
    branches = surveyed(subcritical, seen, -0.31, 0.09)
    assert sorted(b.period for b in branches) == [1, 2]
    jump, = jumps_of(seen, branches, 0.2)
    assert (jump.cause, jump.value) == ("period_doubling", pytest.approx(0.0, abs=1e-9))
    double = next(b for b in branches if b.period == 2)
    # x' = -x on period two: p + x^2 - x^4/2 = 0 has its fold at x = 1, p = -1/2, beyond the range.
    for point in double.points:
        x = point.orbit.section[0]
        assert point.value == pytest.approx(0.5 * x**4 - x**2, abs=1e-8)
    assert {s.orbit.stable for s in double.points if abs(s.orbit.section[0]) < 0.9} == {False}


def test_a_steep_rise_is_no_jump() -> None:
    def steep(x, p):
        rise = math.tanh(200.0 * p[0])
        return np.array([1.5 + rise + 0.5 * (x[0] - 1.5 - rise)]), np.array([[0.5]]), np.array([[100.0
                                                                                                 * (1.0 - rise**2)]])

    seen = swept(steep, np.linspace(-0.1, 0.1, 21), 1.0)
    branches = surveyed(steep, seen, -0.1, 0.1)
    assert {jump.cause for jump in jumps_of(seen, branches, 0.2)} == {STEEP}


def test_a_motion_on_two_branches_that_overlap_makes_no_jump() -> None:
    def steep(x, p):
        return np.array([2.0 + 10.0 * p[0] + 0.5 * (x[0] - 2.0 - 10.0 * p[0])]), np.array([[0.5]]), np.array([[5.0]])

    seen = swept(steep, np.linspace(-0.1, 0.1, 5), 1.0)
    whole, = surveyed(steep, seen, -0.1, 0.1)
    middle = len(whole.points) // 2
    halves = [replace(whole, points=whole.points[:middle + 2]), replace(whole, points=whole.points[middle:])]
    assert {jump.cause for jump in jumps_of(seen, halves, 0.1)} == {STEEP}


def test_what_is_not_followed_is_told() -> None:
    seen = swept(logistic, np.linspace(2.52, 3.4, 11), 0.3, cycles=3000, period_of=period)
    assert left_out(seen, surveyed(logistic, seen, 2.5, 3.5)) == []
    few = replace(SWEPT, max_branches=1, max_points=2)
    branches = surveyed(logistic, seen, 2.5, 3.5, few)
    missing = left_out(seen, branches, settings=replace(few, longest_period=2))[0]
    stopped = left_out(seen, branches, settings=few)[-1]
    assert missing.endswith("of 11 motions lie on no branch: 1 branches are followed")
    assert stopped == "1 of 1 branches go on: 2 points are followed either way"
    far = SettledMotion(4.0, np.array([0.5]), 10, 1, 5.0)
    jump = jumps_of([seen[0], far], branches, 0.2)[0]
    assert (jump.cause, jump.bifurcation) == (NOT_FOLLOWED, None)


def test_a_jump_between_branches_that_were_not_followed_far_enough_has_no_named_cause() -> None:
    seen = lifted(np.linspace(-0.3, 0.3, 21), 0.05)
    jump, = jumps_of(seen, bifurcation_diagram(Lifted(hysteresis, 1), ParameterRange(-0.3, 0.3), seen), 0.2)
    middle = 0.5 * (jump.low + jump.high)
    ways = [([s for s in seen if s.value < middle], -0.3, middle), ([s for s in seen if s.value > middle], middle, 0.3)]
    ended = [b for part, *ends in ways for b in bifurcation_diagram(Lifted(hysteresis, 1), ParameterRange(*ends), part)]
    assert [place_of(s, ended, amplitude_of(seen)) for s in seen].count(None) == 0
    assert {j.cause for j in jumps_of(seen, ended, 0.2)} == {NOT_FOLLOWED}


def test_what_has_no_period_lies_on_no_branch() -> None:
    seen = swept(logistic, np.linspace(3.7, 3.72, 5), 0.3, period_of=lambda points: 0)
    assert surveyed(logistic, seen, 3.7, 3.72) == []
    assert place_of(seen[0], [], 1.0) is None
    assert {jump.cause for jump in jumps_of(seen, [], 1e-6)} == {APERIODIC}


def test_the_doublings_of_the_logistic_map_are_one_branch_each() -> None:
    seen = swept(logistic, np.linspace(2.5, 3.5, 41), 0.3, cycles=3000, period_of=period)
    branches = surveyed(logistic, seen, 2.5, 3.5)
    assert [b.period for b in branches] == [1, 2, 4]
    values = [f.value for b in branches for f in b.bifurcations]
    assert values == pytest.approx([3.0, 1.0 + math.sqrt(6.0)], abs=1e-8)
    for s in seen:
        place = place_of(s, branches, 1.0)
        assert place is None or branches[place[0]].period == s.period


@pytest.mark.parametrize(("value", "largest", "near"), [
    (2.0, 5.0, True), (6.9, 5.0, True), (7.1, 5.0, False), (-4.9, 3.0, True), (-5.1, 3.0, False),
    (2.0, 5.4, True), (2.0, 5.6, False), (2.0, 2.6, True), (2.0, 2.4, False), (5.0, 5.3, False), (4.0, 5.2, True)])
def test_a_bifurcation_is_near_by_its_value_and_its_size_together(value: float, largest: float, near: bool) -> None:
    """Beyond values 0 to 2 and sizes 3 to 5 at most 0.05 of the range (100) and of the size (10) together."""
    def at(value: float, largest: float) -> SimpleNamespace:
        return SimpleNamespace(value=value, orbit=SimpleNamespace(seen=SimpleNamespace(largest=largest)))

    def bifurcation(value: float, largest: float) -> SimpleNamespace:
        return SimpleNamespace(value=value, point=at(value, largest))

    far, here = bifurcation(50.0, 4.0), bifurcation(value, largest)
    branch: Any = SimpleNamespace(points=[at(9.0, 9.0), at(0.0, 3.0), at(1.0, 5.0), at(2.0, 4.0), at(8.0, 9.0)],
                                  bifurcations=[far, here])
    assert nearest_bifurcation(branch, 2, 10.0, 100.0) is (here if near else None)


def test_both_stretches_of_a_hysteresis_end_in_its_folds() -> None:
    seen = lifted(np.linspace(-1.0, 1.0, 21), -1.3, hand_over=True)
    result = stable_segments(bifurcation_diagram(Lifted(hysteresis, 1), ParameterRange(-1.0, 1.0, name="p"), seen),
                             -1.0, 1.0, 2.0)
    lower, upper = sorted(result, key=lambda s: s.low.value)
    assert (lower.low.value, lower.low.kind, lower.low.jumps) == (pytest.approx(-0.5), None, False)
    assert (lower.high.kind, lower.high.jumps, lower.high.value) == ("fold", True, pytest.approx(0.5 * FOLD, abs=1e-9))
    assert (upper.low.kind, upper.low.value) == ("fold", pytest.approx(-0.5 * FOLD, abs=1e-9))
    assert upper.high.value == pytest.approx(0.5)
    assert lower.high.residual < 1e-8
    halves = [SettledMotion(0.5 * s.value, s.state, s.cycle, 1, s.amplitude) for s in seen]
    on = [segment_of(s, result, 4.0) for s in halves]
    assert {result[k].high.kind for k, s in zip(on, seen) if s.value < FOLD - 1e-6} == {"fold"}
    assert {result[k].low.kind for k, s in zip(on, seen) if s.value > FOLD} == {"fold"}


def test_a_doubling_jumps_unless_the_doubled_motion_goes_on_stably() -> None:
    seen = swept(logistic, np.linspace(2.5, 3.4, 19), 0.3, 3000, False, period)
    smooth = stable_segments(surveyed(logistic, seen, 2.5, 3.4), 2.5, 3.4)
    one, two = sorted(smooth, key=lambda s: s.period)
    assert (one.high.kind, one.high.jumps, one.high.value) == ("period_doubling", False, pytest.approx(3.0, abs=1e-8))
    assert (two.period, two.low.kind, two.low.jumps) == (2, "period_doubling", False)
    assert two.low.value == pytest.approx(3.0, abs=1e-8)
    seen = swept(subcritical, np.linspace(-0.31, 0.09, 5), 1e-3, 4000, False, period)
    end = stable_segments(surveyed(subcritical, seen, -0.31, 0.09), -0.31, 0.09)[0].high
    assert (end.kind, end.jumps) == ("period_doubling", True)
    assert "period doubling, residual" in str(end)


def test_heights_end_with_the_stretch() -> None:
    stretch = StableSegment(2, SegmentEnd(0.2), SegmentEnd(0.6, "fold", 1e-12, True), (0.2, 0.4, 0.6), (1.0, 3.0, 4.0))
    assert stretch.amplitude(0.3) == pytest.approx(2.0)
    assert math.isnan(stretch.amplitude(0.61))
    assert segment_of(SettledMotion(0.3, np.zeros(1), 0, 2, 2.01), [stretch], 4.0) == 0
    assert segment_of(SettledMotion(0.3, np.zeros(1), 0, 1, 2.0), [stretch], 4.0) is None
    assert segment_of(SettledMotion(0.3, np.zeros(1), 0, 1, 2.0), [stretch], 4.0, base=2) == 0
    assert segment_of(SettledMotion(0.3, np.zeros(1), 0, 2, 3.0), [stretch], 4.0) is None
    assert str(stretch) == "period 2, stable from 0.2 (followed no further) to 0.6 (fold, residual 1e-12)"


def test_a_stretch_that_was_followed_twice_or_is_next_to_nothing_is_left_out() -> None:
    seen = swept(logistic, np.linspace(2.5, 2.9, 9), 0.3, 3000, False, period)
    branches = surveyed(logistic, seen, 2.5, 2.9)
    assert len(stable_segments([*branches, *branches], 2.5, 2.9)) == len(branches) == 1
    assert stable_segments(branches, 2.5, 2.5 + 1e5) == []
