"""Branches of textbook maps beside their closed forms: points, multipliers, stability, bifurcations, ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from textbook_maps import (
    BORDERS,
    Edged,
    Step,
    TextbookMap,
    branch_of,
    delayed_logistic,
    henon,
    hysteresis,
    isola,
    logistic,
    mirrored,
    of_kind,
    resized,
)

from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.study.continuation.arclength import End, StopReason
from tcc_sim.study.continuation.branch import Branch, BranchOrigin, branch_through, first_point, orbits_at, switch
from tcc_sim.study.continuation.orbits import (
    DEFAULTS,
    ParameterRange,
    Settings,
    Shooting,
    find_orbit,
    minimal_period,
    newton,
)


def saddle(x, p):
    return (np.array([2.0 * x[0] + x[1] ** 2, p[0] * x[1]]), np.array([[2.0, 2.0 * x[1]], [0.0, p[0]]]),
            np.array([[0.0], [x[1]]]))


def pitchfork(x, p):
    return x + 0.3 * (p[0] * x - x**3), np.array([[1.0 + 0.3 * (p[0] - 3.0 * x[0] ** 2)]]), 0.3 * x[:, None]


def close(x, p):
    """Fixed points x = sin(8 p) and x = sin(8 p) + 0.04."""
    u, gap = x[0] - math.sin(8.0 * p[0]), 0.04
    slope = 2.0 * u - gap
    return x + u * (u - gap), np.array([[1.0 + slope]]), np.array([[-8.0 * math.cos(8.0 * p[0]) * slope]])


def turning(x, p):
    """A spiral about 0 that turns by 1.2 and grows by 1 + p - |x|^2/10."""
    c, s = math.cos(1.2), math.sin(1.2)
    turn, grown = np.array([[c, -s], [s, c]]), 1.0 + p[0] - 0.1 * float(x @ x)
    return turn @ x * grown, turn @ (grown * np.eye(2) - 0.2 * np.outer(x, x)), (turn @ x)[:, None]


def pair(trace: float, determinant: float) -> np.ndarray:
    return np.roots([1.0, -trace, determinant])


def with_next(x: float, y: float) -> tuple[float, float]:
    return 4.0 * x * y + 0.6, 0.09


HALVED = frozenset({StopReason.DOUBLING, StopReason.RANGE})


class Known(NamedTuple):
    """A branch with its equation (0 on it) and multipliers in closed form, its bifurcations, and its ends."""

    step: Step
    span: tuple[float, float]
    start: tuple[float, Sequence[float]]
    law: Callable[[Any, float], float]
    multipliers: Callable[[Any, float], Any]
    bifurcations: list[tuple[str, float]]
    ends: frozenset[StopReason] = frozenset({StopReason.RANGE})
    period: int = 1


ROOT6 = 1.0 + math.sqrt(6.0)
FOLD = 2.0 / (3.0 * math.sqrt(3.0))
KNOWN = {
    "henon": Known(henon, (-1.0, 1.5), (0.1, [0.1, 0.1]), lambda x, a: a - x[0] ** 2 - 0.7 * x[0],
                   lambda x, a: pair(-2.0 * x[0], -0.3), [("fold", -0.1225), ("period_doubling", 0.3675)]),
    "henon, period two": Known(
        henon, (0.3, 1.0), (0.6, [1.0, -0.1]), lambda x, a: x[0] * (0.7 - x[0]) - (0.49 - a),
        lambda x, a: pair(*with_next(x[0], 0.7 - x[0])), [("period_doubling", 0.9125)],
        HALVED, 2),
    "delayed logistic": Known(delayed_logistic, (1.1, 2.6), (1.5, [0.3, 0.3]), lambda x, r: x[0] - 1.0 + 1.0 / r,
                              lambda x, r: pair(1.0, r - 1.0), [("neimark_sacker", 2.0)]),
    "turning": Known(turning, (-0.3, 0.4), (-0.2, [0.0, 0.0]), lambda x, p: float(np.abs(x).max()),
                     lambda x, p: (1.0 + p) * np.exp([1.2j, -1.2j]), [("neimark_sacker", 0.0)]),
    "logistic": Known(logistic, (0.5, 2.9), (2.5, [0.6]), lambda x, r: x[0] - 1.0 + 1.0 / r, lambda x, r: [2.0 - r],
                      [("branch_point", 1.0)]),
    "logistic at 0": Known(logistic, (0.5, 1.9), (0.7, [0.0]), lambda x, r: x[0], lambda x, r: [r],
                           [("branch_point", 1.0)]),
    "logistic, period two": Known(
        logistic, (2.5, 3.5), (3.206, [0.5]), lambda x, r: (r * x[0]) ** 2 - r * (r + 1.0) * x[0] + r + 1.0,
        lambda x, r: [4.0 + 2.0 * r - r * r], [("period_doubling", ROOT6)], HALVED, 2),
    "isola": Known(isola, (-2.0, 2.0), (0.0, [-1.0]), lambda x, p: x[0] ** 2 + p * p - 1.0,
                   lambda x, p: [1.0 + 0.5 * x[0]], [("fold", -1.0), ("fold", 1.0)], frozenset({StopReason.CLOSED})),
    "hysteresis": Known(hysteresis, (-1.0, 1.0), (-0.7, [-1.2]), lambda x, p: p + x[0] - x[0] ** 3,
                        lambda x, p: [1.3 - 0.9 * x[0] ** 2], [("fold", FOLD), ("fold", -FOLD)]),
    "pitchfork at 0": Known(pitchfork, (-0.7, 1.0), (0.81, [0.0]), lambda x, p: x[0], lambda x, p: [1.0 + 0.3 * p],
                            [("branch_point", 0.0)]),
    "saddle": Known(saddle, (0.2, 0.8), (0.3, [0.0, 0.0]), lambda x, p: float(np.abs(x).max()), lambda x, p: [2.0, p],
                    []),
    "close": Known(close, (0.0, 2.0), (0.1, [math.sin(0.8)]), lambda x, p: x[0] - math.sin(8.0 * p),
                   lambda x, p: [0.96], [])}


def clothed(known: Known, how: str) -> tuple[TextbookMap, Settings, float, np.ndarray]:
    """The map in other clothes, the settings, the sign of its parameter and the sizes of its states."""
    dimension, sizes = len(known.start[1]), np.array([40.0, 0.003])[:len(known.start[1])]
    if how == "mirrored":
        return TextbookMap(mirrored(known.step), dimension), DEFAULTS, -1.0, np.ones(dimension)
    if how == "sized":
        def size(x):
            return 7.0 * (x[0] / 40.0) ** 2, np.array([14.0 * x[0] / 1600.0, 0.0])[:dimension]

        return TextbookMap(resized(known.step, sizes), dimension, tuple(sizes), 7.0, size), DEFAULTS, 1.0, sizes
    return (TextbookMap(known.step, dimension), Settings(growth=0.05) if how == "cut" else DEFAULTS, 1.0,
            np.ones(dimension))


def check(branch: Branch, known: Known, sign: float, sizes: np.ndarray) -> None:
    """Every figure of a branch beside its closed form."""
    assert branch.period == known.period
    assert {end.reason for end in branch.ended} == known.ends
    assert branch.closed == (StopReason.CLOSED in known.ends)
    for point in branch.points:
        x, p = point.section / sizes, sign * point.value
        assert known.law(x, p) == pytest.approx(0.0, abs=2e-8)
        expected = sorted(np.atleast_1d(known.multipliers(x, p)), key=lambda m: (-abs(m), -m.imag))
        np.testing.assert_allclose(sorted(point.multipliers, key=lambda m: (-round(abs(m), 9), -m.imag)),
                                   expected, atol=1e-5)
        assert point.residual <= 5e-9
        if abs(abs(expected[0]) - 1.0) > 1e-6:
            assert point.stable == (abs(expected[0]) < 1.0)
    places = [np.append(s.section / sizes, s.value) for s in branch.points]
    for one, two, three in zip(places, places[1:], places[2:]):
        assert (two - one) @ (three - two) > 0.0
    if known.ends == {StopReason.RANGE}:
        for k in (0, -1):
            assert min(abs(sign * branch.points[k].value - end) for end in known.span) < 1e-12
    found = sorted((f.kind, sign * f.value) for f in branch.bifurcations)
    assert [kind for kind, _ in found] == sorted(kind for kind, _ in known.bifurcations)
    assert [p for _, p in found] == pytest.approx([p for _, p in sorted(known.bifurcations)], abs=1e-8)
    for f in branch.bifurcations:
        assert f.residual < 1e-8
        one, two = places[f.after:f.after + 2]
        at = np.append(f.point.section / sizes, f.value)
        assert 0.0 <= (at - one) @ (two - one) <= (two - one) @ (two - one)
        assert f.changes_stability == (branch.points[f.after].stable != branch.points[f.after + 1].stable)


CASES = [(name, how) for name in KNOWN for how in ("mirrored", "sized", "cut")
         if (name, how) != ("close", "sized")]  # Along x^2 its neighbours are nearer than a step.


@pytest.mark.parametrize(("name", "how"), CASES)
def test_a_branch_is_the_one_of_the_textbook(name: str, how: str) -> None:
    known = KNOWN[name]
    of, how_followed, sign, sizes = clothed(known, how)
    low, high = sorted(sign * p for p in known.span)
    guess = (sizes * np.array(known.start[1])).tolist()
    check(branch_of(of, low, high, sign * known.start[0], guess, known.period, how_followed), known, sign, sizes)


@pytest.mark.parametrize("sizes", [(1.0, 1.0), (40.0, 0.003)])
@pytest.mark.parametrize(("kind", "edge"), [*((kind, 0.2) for kind in BORDERS), ("stick_border", -0.1),
                                            ("stick_border", -1.2)])
def test_a_change_of_events_is_a_border_where_its_margin_vanishes(kind: str, edge: float,
                                                                  sizes: tuple[float, float]) -> None:
    """On x' = a - x^2 + 0.3 y the fixed point is at the edge where a = x^2 + 0.7 x."""
    of = Edged(resized(henon, sizes), 2, kind, edge * sizes[0], sizes)
    branch = branch_of(of, -1.0, 1.5, 0.1, [0.1 * size for size in sizes])
    others = {f.kind: f.value for f in branch.bifurcations}
    assert len(others) == len(branch.bifurcations) == 3
    assert others == pytest.approx({"fold": -0.1225, "period_doubling": 0.3675, kind: edge * edge + 0.7 * edge},
                                   abs=1e-9)
    assert max(f.residual for f in branch.bifurcations) < 1e-8
    assert {end.reason for end in branch.ended} == {StopReason.RANGE}


@settings(max_examples=6, deadline=None, derandomize=True)
@given(b=st.floats(-0.8, 0.8), low=st.floats(-3.0, -1.5), high=st.floats(3.0, 5.0))
def test_fold_and_doubling_of_every_henon_map(b: float, low: float, high: float) -> None:
    def fixed(x, p):
        value, by_state, by = henon(x, (p[0], b))
        return value, by_state, by[:, :1]

    x = 0.5 * (-(1.0 - b) + math.sqrt((1.0 - b) ** 2 + 0.4))
    branch = branch_of(TextbookMap(fixed, 2), low, high, 0.1, [x, x])
    assert of_kind(branch, "fold").value == pytest.approx(-0.25 * (1.0 - b) ** 2, abs=1e-9)
    assert of_kind(branch, "period_doubling").value == pytest.approx(0.75 * (1.0 - b) ** 2, abs=1e-9)
    assert [s.value for s in (branch.points[0], branch.points[-1])] == pytest.approx([high, high], rel=1e-12)


@pytest.mark.parametrize("guess", [0.9, -0.9])
def test_the_turning_branch_of_a_pitchfork(guess: float) -> None:
    branch = branch_of(TextbookMap(pitchfork, 1), -0.7, 1.0, 0.81, [guess])
    (point,) = [f for f in branch.bifurcations if f.kind == "branch_point"]
    assert (point.value, point.residual) == (pytest.approx(0.0, abs=1e-8), pytest.approx(0.0, abs=1e-8))
    on = [s.section[0] for s in branch.points]
    assert [x * x for x in on] == pytest.approx([s.value for s in branch.points], abs=1e-7)
    assert on[0] * on[-1] < 0.0


def test_a_closed_branch_ends_where_it_closes_however_it_began() -> None:
    first = branch_of(TextbookMap(isola, 1), -2.0, 2.0, 0.0, [-1.0]).points[0]
    closed = branch_through(first, both=False, began=End(StopReason.BEGAN, "p", first.value))
    assert [end.reason for end in closed.ended] == [StopReason.CLOSED, StopReason.CLOSED]


@pytest.mark.parametrize("value", [0.1, 0.1001, 0.2, 0.2999, 0.3])
def test_a_branch_reaches_both_ends_of_its_range_from_beside_them(value: float) -> None:
    values = [point.value for point in branch_of(TextbookMap(henon, 2), 0.1, 0.3, value, [0.3, 0.3]).points]
    assert (values[0], values[-1]) in ((0.1, 0.3), (0.3, 0.1))
    assert len(set(values)) == len(values)


def test_doublings_of_the_logistic_map_are_switched_to_again_and_again() -> None:
    branches = [branch_of(TextbookMap(logistic, 1), 2.5, 3.56, 2.7, [0.6])]
    switch(branches, 3)
    values = [of_kind(b, "period_doubling").value for b in branches[:3]]
    assert values == pytest.approx([3.0, ROOT6, 3.544090359552], abs=1e-8)
    assert [b.period for b in branches] == [1, 2, 4, 8]
    assert branches[1].origin == BranchOrigin("period_doubling", branches[0].bifurcations[0].value, 0)
    assert branches[1].ended[0].reason is StopReason.BEGAN
    alone = [branch_of(TextbookMap(logistic, 1), 2.5, 3.56, 2.7, [0.6])]
    switch(alone, 3, longest=4)
    assert [b.period for b in alone] == [1, 2, 4]


@pytest.mark.parametrize("growth", [0.05, 100.0])
def test_orbits_at_a_value_between_two_points(growth: float) -> None:
    """Also between points in different segments, on both sides of a fold, and at the values of points."""
    branch = branch_of(TextbookMap(henon, 2), 0.37, 0.9, 0.6, [1.0, -0.1], 2, Settings(growth=growth))
    between = [float(a) for p, q in pairwise(branch.points) for a in np.linspace(p.value, q.value, 4)]
    for a in [*between, 0.37, 0.9]:
        (orbit,) = orbits_at(branch, a)
        x, y = orbit.section
        assert (orbit.value, x + y, x * y) == pytest.approx((a, 0.7, 0.49 - a), abs=1e-9)
    folded = branch_of(TextbookMap(henon, 2), -1.0, 1.5, 0.1, [0.1, 0.1])
    names = sorted(o.section[0] for o in orbits_at(folded, 0.2))
    assert names == pytest.approx([-0.35 - math.sqrt(0.3225), -0.35 + math.sqrt(0.3225)], abs=1e-9)
    assert orbits_at(folded, -0.5) == []
    closed = branch_of(TextbookMap(isola, 1), -2.0, 2.0, 0.0, [-1.0])
    assert sorted(o.section[0] for o in orbits_at(closed, closed.points[0].value)) == pytest.approx([-1.0, 1.0])


@pytest.mark.parametrize("error", [ArithmeticError, OutOfRange, np.linalg.LinAlgError, InputError])
def test_a_branch_ends_where_its_map_does_and_a_refusal_is_raised(error: type[Exception]) -> None:
    def torn(x, p):
        if p[0] > 0.5:
            raise error("no map")
        return x + 0.5 * (p[0] - x), np.array([[0.5]]), np.array([[0.5]])

    if error is InputError:
        with pytest.raises(InputError):
            branch_of(TextbookMap(torn, 1), 0.0, 1.0, 0.2, [0.2])
        return
    branch = branch_of(TextbookMap(torn, 1), 0.0, 1.0, 0.2, [0.2])
    assert [end.reason for end in branch.ended] == [StopReason.RANGE, StopReason.STEP]
    assert branch.points[-1].value == branch.ended[1].value == pytest.approx(0.5, abs=1e-6)
    assert f"{branch.ended[1].value:.9g}" in str(branch.ended[1])


def test_bounds_on_points_and_tries_end_a_branch() -> None:
    of = TextbookMap(henon, 2)
    few = branch_of(of, -1.0, 1.5, 0.1, [0.1, 0.1], settings=Settings(max_points=4))
    assert {end.reason for end in few.ended} == {StopReason.POINTS}
    assert len(few.points) == 9
    tried = branch_of(of, -1.0, 1.5, 0.1, [0.1, 0.1], settings=Settings(max_tries=5))
    assert {end.reason for end in tried.ended} == {StopReason.TRIES}
    canard = branch_of(of, -1.0, 1.5, 0.1, [0.1, 0.1], settings=Settings(canard=1.5))
    assert {end.reason for end in canard.ended} == {StopReason.CANARD}
    assert 1.4 < max(abs(s.multipliers[0]) for s in canard.points) <= 1.5


def test_a_family_of_motions_at_one_value_ends_a_branch() -> None:
    def family(x, p):  # Every x is a fixed point at p = 0.
        return x + p[0], np.eye(1), np.eye(1)

    branch = branch_of(TextbookMap(family, 1), -1.0, 1.0, 0.0, [0.3])
    assert {end.reason for end in branch.ended} == {StopReason.FAMILY}


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


# Single orbits.


def orbit_of(shooting: Shooting, values: tuple[float, ...], guess: list[float], known=()):
    z = find_orbit(shooting, values, [np.array(guess)], known)
    return first_point(shooting, z)


def test_deflation_turns_newton_to_the_other_orbit() -> None:
    shooting = Shooting.single(TextbookMap(henon, 2), 1, ParameterRange(-1.0, 2.0))
    first = orbit_of(shooting, (1.4,), [0.8, 0.8])
    other = orbit_of(shooting, (1.4,), [0.8, 0.8], [first.section])
    roots = np.roots([1.0, 0.7, -1.4])
    assert sorted([first.section[0], other.section[0]]) == pytest.approx(sorted(roots), abs=1e-10)
    assert newton(shooting, shooting.unknowns(np.array([[0.3, 0.2]]), (1.4,)), [first.z, other.z]) is None


def test_an_orbit_of_a_shorter_period_is_passed_over() -> None:
    map_, r = TextbookMap(logistic, 1), 3.3
    result = orbit_of(Shooting.single(map_, 2, ParameterRange(0.5, 4.0)), (r,), [1.0 - 1.0 / r + 1e-3])
    after = map_.evaluate(result.section, (r,), 0, 1).value[0]
    root = math.sqrt((r + 1.0) * (r - 3.0))
    assert sorted([result.section[0], after]) == pytest.approx([(r + 1.0 - root) / (2.0 * r),
                                                                (r + 1.0 + root) / (2.0 * r)], abs=1e-11)
    assert minimal_period(map_, result.section, (r,), 4) == 2


def test_a_motion_that_runs_away_is_no_orbit_however_short_newtons_step_is() -> None:
    def drifting(x, p):  # x grows by 0.1 in every cycle: the Jacobian of its equations is singular, the step none.
        return np.array([x[0] + 0.1, 0.5 * x[1]]), np.diag([1.0, 0.5]), np.zeros((2, 1))

    shooting = Shooting.single(TextbookMap(drifting, 2), 1, ParameterRange(0.0, 1.0))
    assert newton(shooting, shooting.unknowns(np.array([[3.0, 0.0]]), (0.5,))) is None
