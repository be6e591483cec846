"""Sweeps of textbook maps: every motion on a branch, every jump and every end of a stable stretch with its cause."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from textbook_maps import Step, TextbookMap, hysteresis, logistic

from tcc_sim.study.continuation.branch import (
    APERIODIC,
    BASIN,
    NOT_FOLLOWED,
    STEEP,
    SWEPT,
    Branch,
    SettledMotion,
    amplitude_of,
    bifurcation_diagram,
    jumps_of,
    left_out,
    place_of,
    point_of,
    segment_of,
    stable_segments,
)
from tcc_sim.study.continuation.orbits import Image, ParameterRange

FOLD = 2.0 / (3.0 * math.sqrt(3.0))
UNIT, NARROW = ParameterRange(-1.0, 1.0, name="p"), ParameterRange(-0.3, 0.3, name="p")


def subcritical(x, p):
    """x' = -(1 + p) x - x^3 + x^5/2: 0 loses its stability at p = 0 to a period two that is there already."""
    slope = -(1.0 + p[0]) - 3.0 * x[0] ** 2 + 2.5 * x[0] ** 4
    return -(1.0 + p[0]) * x - x**3 + 0.5 * x**5, np.array([[slope]]), -x[:, None]


def period(points) -> int:
    return next((n for n in range(1, 17) if abs(points[-1] - points[-1 - n]) < 1e-9), 0)


def swept(step: Step, values, start, cycles=400, hand_over=False, period_of=lambda points: 1,
          size=lambda points: max(map(abs, points))) -> list[SettledMotion]:
    """Motions of a map from cold starts, or each from the end of the one before."""
    out, x = [], np.array([start])
    for value in values:
        x = x if hand_over else np.array([start])
        points = []
        for _ in range(cycles):
            x = step(x, (value,))[0]
            points.append(float(x[0]))
        out.append(SettledMotion(float(value), x, cycles, period_of(points), size(points[-16:])))
    return out


def lifted(values, start, **how) -> list[SettledMotion]:
    """Motions of `hysteresis` with the sizes x + 2, which differ on its two branches."""
    return swept(hysteresis, values, start, size=lambda points: points[-1] + 2.0, **how)


LIFTED = TextbookMap(hysteresis, 1, size=lambda x: (float(x[0]) + 2.0, np.ones(1)))


def surveyed(step: Step, seen: list[SettledMotion], low: float, high: float, settings=SWEPT) -> list[Branch]:
    return bifurcation_diagram(TextbookMap(step, 1), ParameterRange(low, high, name="p"), seen, settings=settings)


@pytest.mark.parametrize("up", [True, False])
def test_a_jump_of_a_continued_sweep_is_the_fold_at_its_end(up) -> None:
    way = 1 if up else -1
    seen = lifted(np.linspace(-1.0, 1.0, 41)[::way], -1.3 * way, hand_over=True)[::way]
    branch, = branches = bifurcation_diagram(LIFTED, UNIT, seen)
    jump, = jumps_of(seen, branches, 0.2)
    assert jump.cause == "fold"
    assert jump.value == pytest.approx(FOLD if up else -FOLD, abs=1e-9)
    assert jump.between[0] < jump.value < jump.between[1]
    # A motion between the last point and the fold lies on the branch too.
    last = max(s.value for s in branch.points if s.section[0] < 0.0)
    p = 0.5 * (last + FOLD)
    x = float(np.roots([1.0, 0.0, -1.0, -p]).real.min())
    assert last < p < FOLD
    assert place_of(SettledMotion(p, np.array([x]), 0, 1, x + 2.0), branches, amplitude_of(seen)) is not None
    for wrong in (SettledMotion(p, np.array([x]), 0, 1, x + 2.5), SettledMotion(p, np.array([x]), 0, 2, x + 2.0)):
        assert place_of(wrong, branches, amplitude_of(seen)) is None


def test_a_jump_between_motions_that_both_go_on_is_the_boundary_of_their_basins() -> None:
    # From 0.1 - p cold starts reach the upper motion where the unstable one lies below.
    seen = lifted(np.linspace(-0.3, 0.3, 21), 0.05)
    branches = bifurcation_diagram(LIFTED, NARROW, seen)
    assert len(branches) == 2
    jump, = jumps_of(seen, branches, 0.2)
    assert (jump.cause, jump.bifurcation) == (BASIN, None)
    assert jump.between[0] <= -0.05 + 0.05**3 <= jump.between[1]  # the unstable motion is at the start: p + x - x^3 = 0
    middle = 0.5 * sum(jump.between)
    ways = [([s for s in seen if s.value < middle], -0.3, middle), ([s for s in seen if s.value > middle], middle, 0.3)]
    ended = [b for part, *ends in ways for b in bifurcation_diagram(LIFTED, ParameterRange(*ends), part)]
    assert [place_of(s, ended, amplitude_of(seen)) for s in seen].count(None) == 0
    assert {j.cause for j in jumps_of(seen, ended, 0.2)} == {NOT_FOLLOWED}


@pytest.mark.parametrize(("direction", "side", "fold"), [
    ("up", 1.0, 1.0), ("down", -1.0, -1.0), ("cold", 1.0, -1.0), ("cold", -1.0, 1.0)])
def test_the_motion_that_was_followed_ends_in_the_cause_of_a_jump(direction: str, side: float, fold: float) -> None:
    """Cold starts follow no motion; the cause is the end nearest to the middle of the jump."""
    # p + x - x^3 = 0: the lower motion ends at p = 2/3^1.5, the upper one at -2/3^1.5.
    seen = [s for p in (-0.5 - 0.05 * side, 0.5 - 0.05 * side) for s in lifted([p], p)]
    branches = bifurcation_diagram(LIFTED, ParameterRange(-0.6, 0.6, name="p"), seen)
    jump, = jumps_of(seen, branches, 0.2, direction=direction)
    assert (jump.cause, jump.value) == ("fold", pytest.approx(fold * FOLD, abs=1e-9))


def test_a_jump_at_a_doubling_names_it_and_its_unstable_branch_is_followed() -> None:
    seen = swept(subcritical, np.linspace(-0.31, 0.09, 5), 1e-3, cycles=4000, period_of=period)
    branches = surveyed(subcritical, seen, -0.31, 0.09)
    assert sorted(b.period for b in branches) == [1, 2]
    jump, = jumps_of(seen, branches, 0.2)
    assert (jump.cause, jump.value) == ("period_doubling", pytest.approx(0.0, abs=1e-9))
    double = next(b for b in branches if b.period == 2)
    # x' = -x on period two: p + x^2 - x^4/2 = 0 has its fold at x = 1, p = -1/2, beyond the range.
    for point in double.points:
        x = point.section[0]
        assert point.value == pytest.approx(0.5 * x**4 - x**2, abs=1e-8)
    assert {s.stable for s in double.points if abs(s.section[0]) < 0.9} == {False}
    end = stable_segments(branches, -0.31, 0.09)[0].high
    assert (end.kind, end.jumps) == ("period_doubling", True)


def test_a_steep_rise_is_no_jump_also_on_two_branches_that_overlap() -> None:
    def steep(x, p):
        rise = math.tanh(200.0 * p[0])
        by = np.array([[100.0 * (1.0 - rise**2)]])
        return np.array([1.5 + rise + 0.5 * (x[0] - 1.5 - rise)]), np.array([[0.5]]), by

    def even(x, p):
        return np.array([2.0 + 10.0 * p[0] + 0.5 * (x[0] - 2.0 - 10.0 * p[0])]), np.array([[0.5]]), np.array([[5.0]])

    seen = swept(steep, np.linspace(-0.1, 0.1, 21), 1.0)
    assert {jump.cause for jump in jumps_of(seen, surveyed(steep, seen, -0.1, 0.1), 0.2)} == {STEEP}
    seen = swept(even, np.linspace(-0.1, 0.1, 5), 1.0)
    whole, = surveyed(even, seen, -0.1, 0.1)
    middle = len(whole.points) // 2
    halves = [replace(whole, points=whole.points[:middle + 2]), replace(whole, points=whole.points[middle:])]
    assert {jump.cause for jump in jumps_of(seen, halves, 0.1)} == {STEEP}
    assert jumps_of(seen, halves, 100.0) == []


def test_what_is_left_out_of_a_diagram_is_counted() -> None:
    seen = swept(logistic, np.linspace(2.52, 3.4, 11), 0.3, cycles=3000, period_of=period)
    assert left_out(seen, surveyed(logistic, seen, 2.5, 3.5)) == []
    few = replace(SWEPT, max_branches=1, max_points=2)
    branches = surveyed(logistic, seen, 2.5, 3.5, few)
    lines = left_out(seen, branches, settings=few)
    alone = sum(place_of(s, branches, amplitude_of(seen)) is None for s in seen)
    assert lines[0].startswith(f"{alone} of 11 ")
    assert lines[-1].startswith("1 of 1 ")
    assert "1" in left_out(seen, branches, settings=replace(few, longest_period=1))[-2]
    far = SettledMotion(4.0, np.array([0.5]), 10, 1, 5.0)
    jump = jumps_of([seen[0], far], branches, 0.2)[0]
    assert (jump.cause, jump.bifurcation) == (NOT_FOLLOWED, None)


def test_what_has_no_period_lies_on_no_branch() -> None:
    seen = swept(logistic, np.linspace(3.7, 3.72, 5), 0.3, period_of=lambda points: 0)
    assert surveyed(logistic, seen, 3.7, 3.72) == []
    assert place_of(seen[0], [], 1.0) is None
    assert {jump.cause for jump in jumps_of(seen, [], 1e-6)} == {APERIODIC}


def test_the_doublings_of_the_logistic_map_are_one_branch_each() -> None:
    seen = swept(logistic, np.linspace(2.5, 3.5, 21), 0.3, cycles=2000, period_of=period)
    branches = surveyed(logistic, seen, 2.5, 3.5)
    assert [b.period for b in branches] == [1, 2, 4]
    values = [f.value for b in branches for f in b.bifurcations]
    assert values == pytest.approx([3.0, 1.0 + math.sqrt(6.0)], abs=1e-8)
    for s in seen:
        place = place_of(s, branches, 1.0)
        assert place is None or branches[place[0]].period == s.period
    one, two, four = sorted(stable_segments(branches, 2.5, 3.5), key=lambda s: s.period)
    assert (one.low.value, one.low.kind, one.low.jumps) == (2.5, None, False)
    assert (one.high.kind, one.high.jumps, one.high.value) == ("period_doubling", False, pytest.approx(3.0, abs=1e-8))
    assert (two.low.kind, two.low.jumps, two.low.value) == ("period_doubling", False, pytest.approx(3.0, abs=1e-8))
    assert (two.high.kind, two.high.value) == ("period_doubling", pytest.approx(1.0 + math.sqrt(6.0), abs=1e-8))
    assert (four.low.kind, four.low.value) == ("period_doubling", pytest.approx(two.high.value, abs=1e-8))
    assert one.amplitude(2.8) == pytest.approx(1.0 - 1.0 / 2.8, abs=1e-4)
    assert math.isnan(one.amplitude(3.01))
    assert len(stable_segments([*branches, *branches], 2.5, 3.5)) == 3
    assert stable_segments(branches, 2.5, 2.5 + 1e5) == []


def test_both_stretches_of_a_hysteresis_end_in_its_folds() -> None:
    """Values over a unit of 2."""
    seen = lifted(np.linspace(-1.0, 1.0, 21), -1.3, hand_over=True)
    result = stable_segments(bifurcation_diagram(LIFTED, UNIT, seen), -1.0, 1.0, 2.0)
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
    for wrong in (replace(halves[0], period=2), replace(halves[0], amplitude=halves[0].amplitude + 1.0)):
        assert segment_of(wrong, result, 4.0) is None


class Turning(TextbookMap):
    """In turns x' = 1.5 x - x^3/2 + p, -x and -x: near 1, 1 and -1 or near -1, -1 and 1."""

    forcing_period = 3

    def evaluate(self, x, values, first, cycles):
        slopes = np.array([[1.0, 0.0]])
        for k in range(int(first), int(first) + int(cycles)):
            slope = -1.0 if k % 3 else 1.5 - 1.5 * float(x[0]) ** 2
            x = -x if k % 3 else 1.5 * x - 0.5 * x**3 + values[0]
            slopes = slope * slopes + np.array([[0.0, 0.0 if k % 3 else 1.0]])
        return Image(x, slopes)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_motion_of_a_sweep_begins_at_the_next_phase_0(side: float) -> None:
    of = Turning(hysteresis, 1)
    for cycle in range(6):
        x = np.array([-side if cycle % 3 == 2 else side])
        point = point_of(of, UNIT, SettledMotion(0.0, x, cycle, 1, 1.0))
        assert (point.period, point.section) == (3, pytest.approx([side]))
