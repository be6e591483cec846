"""Branches of textbook maps: folds, doublings, Neimark-Sacker, branch points, closed branches, switching, curves."""

import math
import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from textbook_maps import Step, TextbookMap, delayed_logistic, henon, isola, logistic

from tcc_sim.study.continuation import branch as branch_module
from tcc_sim.study.continuation import follow
from tcc_sim.study.continuation.bracket import Bracket
from tcc_sim.study.continuation.branch import Branch, BranchOrigin, BranchTrack, branch_through, first_point, orbits_at
from tcc_sim.study.continuation.diagram import switch
from tcc_sim.study.continuation.follow import StopReason
from tcc_sim.study.continuation.newton import find_orbit
from tcc_sim.study.continuation.palc import corrector, predictor
from tcc_sim.study.continuation.settings import DEFAULTS, Settings
from tcc_sim.study.continuation.shooting import ParameterRange, Shooting
from tcc_sim.study.continuation.special_points import Bifurcation


def branch_of(step: Step, dimension: int, low: float, high: float, value: float, guess: list[float],
              period: int = 1, settings: Settings = DEFAULTS) -> Branch:
    shooting = Shooting.single(TextbookMap(step, dimension), period, ParameterRange(low, high, name="p"),
                               settings=settings)
    z = find_orbit(shooting, (value,), [np.array(guess)])
    return branch_through(first_point(shooting, z))


def kinds(branch: Branch) -> list[str]:
    return [f.kind for f in branch.bifurcations]


def of_kind(branch: Branch, kind: str) -> Bifurcation:
    return next(f for f in branch.bifurcations if f.kind == kind)


def test_a_corrector_is_given_up_at_the_first_step_that_is_too_long() -> None:
    of = TextbookMap(logistic, 1)
    shooting = Shooting.single(of, 1, ParameterRange(2.0, 4.0))
    guess, row = np.array([0.7, 0.5]), np.array([0.0, 1.0])  # The fixed point 1 - 1/r is 2/3 at r = 3.
    assert corrector(shooting, guess, row, farthest=0.03) is None
    assert of.evaluations == 1
    result = corrector(shooting, guess, row, farthest=0.04)
    assert result.z[0] == pytest.approx(2.0 / 3.0, abs=1e-15)


def test_fold_and_doubling_of_the_henon_map() -> None:
    branch = branch_of(henon, 2, -1.0, 1.5, 0.1, [0.1, 0.1])
    assert sorted(kinds(branch)) == ["fold", "period_doubling"]
    for f in branch.bifurcations:
        assert f.changes_stability
        first, second = (branch.points[k].orbit.section[0] for k in (f.after, f.after + 1))
        assert min(first, second) < f.point.orbit.section[0] < max(first, second)
    assert of_kind(branch, "fold").value == pytest.approx(-0.1225, abs=1e-10)
    assert of_kind(branch, "period_doubling").value == pytest.approx(0.3675, abs=1e-10)
    assert all(f.residual < 1e-8 for f in branch.bifurcations)
    assert [s.value for s in (branch.points[0], branch.points[-1])] == [1.5, 1.5]
    for point in branch.points:
        x, a = point.orbit.section[0], point.value
        assert a - x * x + 0.3 * x == pytest.approx(x, abs=1e-9)
    stable = [s.orbit.stable for s in branch.points]
    assert stable == [-0.35 < s.orbit.section[0] < 0.35 for s in branch.points]


@pytest.mark.parametrize("value", [0.1, 0.1001, 0.2, 0.2999, 0.3])
def test_a_branch_reaches_both_ends_of_its_range_from_beside_them(value: float) -> None:
    branch = branch_of(henon, 2, 0.1, 0.3, value, [0.3, 0.3])
    values = [point.value for point in branch.points]
    assert (values[0], values[-1]) in ((0.1, 0.3), (0.3, 0.1))
    assert len(set(values)) == len(values)
    assert {end.reason for end in branch.ended} == {StopReason.RANGE}


def test_a_branch_begins_towards_growing_parameters() -> None:
    """Whichever way the Jacobian's null vector points: for one in twelve linear maps of the plane the other way."""
    random = np.random.default_rng(0)
    for _ in range(40):
        slopes = random.normal(size=(2, 3))

        def linear(x, p, slopes=slopes):
            return x + slopes @ [*x, p[0]], np.eye(2) + slopes[:, :2], slopes[:, 2:]

        shooting = Shooting.single(TextbookMap(linear, 2), 1, ParameterRange(-1.0, 1.0, name="p"))
        first = first_point(shooting, shooting.unknowns(np.zeros((1, 2)), (0.0,)))
        assert first.solution.tangent[shooting.size] > 0.0


def test_neimark_sacker_of_the_delayed_logistic_map() -> None:
    branch = branch_of(delayed_logistic, 2, 1.1, 2.6, 1.5, [0.3, 0.3])
    assert kinds(branch) == ["neimark_sacker"]
    assert branch.bifurcations[0].value == pytest.approx(2.0, abs=1e-10)
    assert branch.bifurcations[0].point.orbit.multipliers[0] == pytest.approx(np.exp(1j * math.pi / 3.0), abs=1e-8)


def test_a_neutral_saddle_is_no_neimark_sacker() -> None:
    def saddle(x, p):  # Fixed point 0 with multipliers 2 and p: their product passes 1 at p = 0.5.
        return (np.array([2.0 * x[0] + x[1] ** 2, p[0] * x[1]]), np.array([[2.0, 2.0 * x[1]], [0.0, p[0]]]),
                np.array([[0.0], [x[1]]]))

    assert kinds(branch_of(saddle, 2, 0.2, 0.8, 0.3, [0.0, 0.0])) == []


def test_a_branch_point_is_located_and_not_taken_for_a_fold() -> None:
    branch = branch_of(logistic, 1, 0.5, 2.9, 2.5, [0.6])
    assert kinds(branch) == ["branch_point"]
    assert branch.bifurcations[0].value == pytest.approx(1.0, abs=1e-8)
    assert all(s.orbit.section[0] == pytest.approx(1.0 - 1.0 / s.value, abs=1e-8) for s in branch.points)


@pytest.mark.parametrize("guess", [0.0, 0.9])
def test_the_branch_point_of_a_pitchfork(guess: float) -> None:
    def pitchfork(x, p):  # x = 0 and p = x^2: both pass p = 0, one of them turning.
        return (x + 0.3 * (p[0] * x - x**3), np.array([[1.0 + 0.3 * (p[0] - 3.0 * x[0] ** 2)]]), 0.3 * x[:, None])

    branch = branch_of(pitchfork, 1, -0.7, 1.0, 0.81, [guess])
    (point,) = [f for f in branch.bifurcations if f.kind == "branch_point"]
    assert point.value == pytest.approx(0.0, abs=1e-8)
    assert point.residual < 1e-8
    kinds_found = kinds(branch)
    assert "period_doubling" not in kinds_found
    on = [s.orbit.section[0] for s in branch.points]
    if guess:
        assert all(x * x == pytest.approx(s.value, abs=1e-7) for x, s in zip(on, branch.points))
        assert (on[0] > 0.0) != (on[-1] > 0.0)
    else:
        assert max(map(abs, on)) < 1e-9


def test_a_closed_branch_is_recognised() -> None:
    branch = branch_of(isola, 1, -2.0, 2.0, 0.0, [-1.0])
    assert branch.closed
    assert str(branch.ended[0]).startswith("closed")
    assert sorted(f.value for f in branch.bifurcations) == pytest.approx([-1.0, 1.0], abs=1e-10)


def test_a_branch_that_comes_back_some_cycles_later_is_met_in_its_own_direction() -> None:
    """The tangent at the second point of an orbit of period two is the difference of that point along the branch."""
    branch = branch_of(henon, 2, 0.37, 0.9, 0.6, [1.0, -0.1], 2)
    here, after = branch.points[2:4]
    middle = Bracket(here, after).at(0.5)
    shifted, tangent = BranchTrack(middle).starts[1]
    z, ways = middle.solution.z, []
    for point in (here, after):
        end, _ = BranchTrack(point).starts[1]
        ways.append(end - shifted)
    assert shifted[:2] == pytest.approx(henon(z[:2], (middle.value,))[0])
    assert np.linalg.norm(tangent) == pytest.approx(1.0)
    along = ways[1] - ways[0]
    assert tangent == pytest.approx(along / np.linalg.norm(along), abs=1e-2)


def test_a_branch_does_not_jump_to_a_neighbour() -> None:
    def close(x, p):  # Fixed points x = sin(8 p) and x = sin(8 p) + 0.04.
        s, gap = math.sin(8.0 * p[0]), 0.04
        u = x[0] - s
        slope = 2.0 * u - gap
        return x + u * (u - gap), np.array([[1.0 + slope]]), np.array([[-8.0 * math.cos(8.0 * p[0]) * slope]])

    branch = branch_of(close, 1, 0.0, 2.0, 0.1, [math.sin(0.8)])
    assert (branch.points[0].value, branch.points[-1].value) == (0.0, 2.0)
    assert all(s.orbit.section[0] == pytest.approx(math.sin(8.0 * s.value), abs=1e-7) for s in branch.points)


def test_a_doubled_branch_does_not_go_over_to_the_simple_one() -> None:
    branch = branch_of(logistic, 1, 2.5, 3.5, 3.206, [0.5], 2)
    assert str(branch.ended[0]).startswith("ended in a period doubling of motions of a shorter period at p = 3")
    assert min(s.value for s in branch.points) == pytest.approx(3.0, abs=1e-9)


def test_doublings_of_the_logistic_map_are_switched_to_again_and_again() -> None:
    branches = [branch_of(logistic, 1, 2.5, 3.56, 2.7, [0.6])]
    switch(branches, 3)
    values = [of_kind(b, "period_doubling").value for b in branches[:3]]
    assert values == pytest.approx([3.0, 1.0 + math.sqrt(6.0), 3.544090359552], abs=1e-8)
    assert [b.period for b in branches] == [1, 2, 4, 8]
    assert branches[1].origin == BranchOrigin("period_doubling", branches[0].bifurcations[0].value, 0)
    assert branches[1].ended[0].reason is StopReason.BEGAN


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_doubled_branch_ends_where_its_period_halves(sign: float) -> None:
    """Whichever way its parameter grows, and the determinant of Jacobian and tangent has its sign."""
    def signed(x, p):
        value, by_state, by_parameter = logistic(x, (sign * p[0],))
        return value, by_state, sign * by_parameter

    low, high = sorted((2.5 * sign, 3.9 * sign))
    branch = branch_of(signed, 1, low, high, 3.2 * sign, [0.5], 2)
    assert any(end.reason is StopReason.DOUBLING for end in branch.ended)
    assert kinds(branch) == ["period_doubling"]
    assert min(abs(s.value) for s in branch.points) == pytest.approx(3.0, abs=1e-9)


def test_orbits_at_a_value_on_both_sides_of_a_fold() -> None:
    branch = branch_of(henon, 2, -1.0, 1.5, 0.1, [0.1, 0.1])
    names = sorted(o.section[0] for o in orbits_at(branch, 0.2))
    assert names == pytest.approx(sorted(-0.35 + s * math.sqrt(0.1225 + 0.2) for s in (1.0, -1.0)), abs=1e-9)
    assert orbits_at(branch, -0.5) == []


@pytest.mark.parametrize("growth", [0.05, 0.2])
def test_orbits_at_a_value_between_two_points_in_different_segments(growth: float) -> None:
    """Period two of the Henon map has x + y = 1 - b and x y = (1 - b)^2 - a."""
    branch = branch_of(henon, 2, 0.37, 0.9, 0.6, [1.0, -0.1], 2, settings=Settings(growth=growth))
    pairs = [(p, q) for p, q in pairwise(branch.points) if p.shooting.segments != q.shooting.segments]
    assert pairs
    for p, q in pairs:
        for a in np.linspace(p.value, q.value, 7)[1:-1]:
            (orbit,) = orbits_at(branch, float(a))
            x, y = orbit.section
            assert (orbit.values, x + y) == ((a,), pytest.approx(0.7, abs=1e-12))
            assert x * y == pytest.approx(0.49 - a, abs=1e-12)


def test_the_predictor_is_exact_for_a_polynomial_with_its_slope_or_without() -> None:
    def at(s: float) -> np.ndarray:
        return np.array([s**3 - 2.0 * s, 0.5 * s**2 + s])

    known = [(s, at(s)) for s in (-0.1, -0.3, -0.35)]
    for nodes in ([(0.0, at(0.0)), (0.0, np.array([-2.0, 1.0])), *known], [(0.0, at(0.0)), *known]):
        assert predictor(nodes, 0.7) == pytest.approx(at(0.7), abs=1e-12)


def test_a_bifurcation_takes_few_evaluations() -> None:
    of = TextbookMap(henon, 2)
    shooting = Shooting.single(of, 1, ParameterRange(-1.0, 1.5))
    z = find_orbit(shooting, (0.1,), [np.array([0.1, 0.1])])
    counts = []
    for detect in (True, False):
        of.evaluations = 0
        branch = branch_through(first_point(replace(shooting, settings=Settings(detect=detect)), z))
        counts.append(of.evaluations)
    assert counts[0] - counts[1] <= 2 * 20
    assert len(branch.points) > 10


def test_nothing_of_a_branch_rests_on_the_map_for_guesses() -> None:
    def nearly(x, p):
        value, by_state, by_parameter = henon(x, p)
        return value + 1e-9, 1.00001 * by_state, by_parameter

    class Guessed(TextbookMap):
        coarse = TextbookMap(nearly, 2)

    branches, counts = [], []
    for kind in (TextbookMap, Guessed):
        of = kind(henon, 2)
        shooting = Shooting.single(of, 1, ParameterRange(-1.0, 1.5, name="p"))
        z = find_orbit(shooting, (0.1,), [np.array([0.1, 0.1])])
        branches.append(branch_through(first_point(shooting, z)))
        counts.append(of.evaluations)
    assert Guessed.coarse.evaluations > 0
    assert counts[1] < counts[0]
    one, other = branches
    assert [f.value for f in other.bifurcations] == pytest.approx([f.value for f in one.bifurcations], abs=1e-10)
    for point in other.points:
        x, a = point.orbit.section[0], point.value
        assert a - x * x + 0.3 * x == pytest.approx(x, abs=1e-14)
        assert point.orbit.residual < DEFAULTS.residual
        assert np.prod(point.orbit.multipliers).real == pytest.approx(-0.3, abs=1e-13)


def test_a_branch_without_progress_is_given_up() -> None:
    branch = branch_of(henon, 2, -1.0, 1.5, 0.1, [0.1, 0.1], settings=Settings(max_tries=5))
    assert len(branch.points) <= 13
    assert all(str(end).startswith("given up after 6 steps tried at p = ") for end in branch.ended)


def test_a_branch_that_meets_no_residual_says_so() -> None:
    def torn(x, p):  # The fixed point x = p is gone beyond p = 0.5.
        return x + 0.5 * (p[0] - x) + (0.1 if p[0] > 0.5 else 0.0) * np.sin(1e9
                                                                            * x), np.array([[0.5]]), np.array([[0.5]])

    branch = branch_of(torn, 1, 0.0, 1.0, 0.2, [0.2])
    assert re.match(r"no further point was found beyond p = (0\.5|0\.4999999\d*): ", str(branch.ended[1]))
    assert str(branch.ended[1]).endswith("met a residual of 5e-09")


def test_ctrl_c_keeps_the_branch() -> None:
    seen = []

    def tick(point) -> None:
        seen.append(point)
        if len(seen) == 6:
            raise KeyboardInterrupt

    shooting = Shooting.single(TextbookMap(henon, 2), 1, ParameterRange(-1.0, 1.5))
    z = find_orbit(shooting, (0.1,), [np.array([0.1, 0.1])])
    kept: list[Branch] = []
    with pytest.raises(KeyboardInterrupt):
        branch_through(first_point(shooting, z), tick=tick, keep=kept)
    assert len(kept[0].points) == 7
    assert kept[0].ended[1].reason is StopReason.INTERRUPTED


@pytest.mark.parametrize(("value", "away", "found"), [
    (0.3, {0: 0.39}, 0), (0.3, {0: 0.41, 1: 0.39}, 1), (0.3, {0: 0.41, 1: 0.41}, None), (0.3, {1: 0.1}, 1),
    (0.6, {0: 0.1, 1: 0.2}, 1), (0.3, {}, None)])
def test_an_orbit_between_two_segments_is_that_of_the_nearer_point(
        value: float, away: dict[int, float], found: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within twice the distance between the points, 0.2, in natural sizes of 2."""
    points = [SimpleNamespace(value=at, solution=SimpleNamespace(z=np.array([z])), orbit=SimpleNamespace(
        section=np.array([at])), shooting=SimpleNamespace(outer=lambda z: z, map=SimpleNamespace(scales=2.0)))
        for at, z in ((0.2, 1.0), (0.6, 1.2))]
    orbits = {k: SimpleNamespace(section=points[k].orbit.section - 2.0 * off) for k, off in away.items()}
    monkeypatch.setattr(branch_module, "_at", lambda point, at: orbits.get(points.index(point)))
    assert branch_module._crossing(*points, value) is (None if found is None else orbits[found])  # type: ignore[arg-type]


@pytest.mark.parametrize(("p", "q", "middle", "count", "passed"), [
    (-0.1, 0.1, 0.0039, 4, True), (-0.1, 0.1, 0.0041, 4, False), (-0.1, 0.1, None, 4, False),
    (-0.1, 0.1, 0.0, 3, False),
    (-0.2, 0.0, 0.0, 4, True), (0.0, 0.2, 0.0, 4, False), (-0.3, -0.1, 0.0, 4, False), (-0.22, -0.02, 0.0, 4, False),
    (0.1, -0.1, 0.0, 4, False), (-0.1 + 0.0399j, 0.1 + 0.0399j, 0.0, 4, True),
    (-0.1 + 0.0401j, 0.1 + 0.0401j, 0.0, 4, False)])
def test_a_step_passes_the_first_point_along_its_tangent(p: complex, q: complex, middle: float | None, count: int,
                                                         passed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The point 0 with tangent 1 in a plane, within a fifth of a step of 0.2, and a fiftieth on the curve itself."""
    def at(z: complex) -> Any:
        return SimpleNamespace(equations=SimpleNamespace(outer=lambda z: z), solution=SimpleNamespace(
            z=np.array([z.real, z.imag])))

    monkeypatch.setattr(follow, "Bracket", lambda a, b: SimpleNamespace(
        at=lambda part: None if middle is None else at(complex(0.0, middle))))
    track: Any = SimpleNamespace(here=at(complex(p)), starts=[(np.zeros(2), np.array([1.0, 0.0]))], points=range(count),
                                 settings=DEFAULTS)
    assert BranchTrack.passes_start(track, at(complex(q))) is passed
