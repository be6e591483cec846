"""The parts of continuation by hand: roots, rings of events, correctors, segments, ends, and pieces of branches."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from textbook_maps import TextbookMap, henon, logistic

from tcc_sim.study.continuation.bordered import bordered, cyclic, nearest_margins
from tcc_sim.study.continuation.bracket import SameSign, _hermite, chandrupatla, turned_round
from tcc_sim.study.continuation.branch import BranchOrigin
from tcc_sim.study.continuation.follow import End, StopReason
from tcc_sim.study.continuation.newton import _newton_step, _slope, _weight, minimal_period, newton, shifts
from tcc_sim.study.continuation.palc import (
    FLAT,
    Solution,
    corrector,
    cosine_between,
    null_direction,
    oriented,
    predictor_nodes,
    solution_at,
    tangent_of,
)
from tcc_sim.study.continuation.problem import Image, Margin, Observation, kind_of_change, margin_residual, ring
from tcc_sim.study.continuation.settings import Settings
from tcc_sim.study.continuation.shooting import (
    Linearised,
    ParameterRange,
    Shooting,
    joined_observation,
    layout,
)
from tcc_sim.study.continuation.special_points import _opposite, doubling, torus

CURVES = [lambda x: x**3 - 0.3, lambda x: math.exp(3.0 * x) - 5.0, lambda x: math.atan(40.0 * (x - 0.91)),
          lambda x: 0.2 - x**9, lambda x: x - 1e-6]


@pytest.mark.parametrize("k", range(len(CURVES)))
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_root_is_that_of_brents_method_in_few_evaluations(k: int, mirrored: bool) -> None:
    calls: list[float] = []

    def counted(x: float) -> float:
        calls.append(x)
        return CURVES[k](-x) if mirrored else CURVES[k](x)

    found = chandrupatla(counted, *((-1.0, 0.0) if mirrored else (0.0, 1.0)))
    assert abs(found) == pytest.approx(brentq(CURVES[k], 0.0, 1.0, xtol=1e-15), abs=1e-13)
    assert len(calls) <= 16
    assert all(0.0 <= abs(x) <= 1.0 for x in calls)


def test_a_root_at_an_end_of_its_bracket_takes_no_search() -> None:
    assert chandrupatla(lambda x: x, 0.0, 1.0) == 0.0
    assert chandrupatla(lambda x: x - 1.0, 0.0, 1.0) == 1.0
    for sign in (1.0, -1.0):
        with pytest.raises(SameSign, match=r"^no change of sign$"):
            chandrupatla(lambda x, s=sign: s * (1.0 + x), 0.0, 1.0)
    wide = chandrupatla(lambda x: x - 0.3, 0.0, 1.0, 0.6)
    assert abs(wide - 0.3) <= 0.6


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("ends", "middle", "curved"), [
    ((-1.0, 1.0), -0.39, True), ((-1.0, 1.0), -0.43, False), ((-1.0, 1.0), 0.39, True), ((-1.0, 1.0), 0.43, False),
    ((-2.0, 3.0), -0.5, True), ((-2.0, 3.0), -0.56, False), ((-2.0, 3.0), 1.5, True), ((-2.0, 3.0), 1.56, False)])
def test_the_next_guess_is_that_of_inverse_quadratic_interpolation_where_the_curve_is_even_enough(
        sign: float, ends: tuple[float, float], middle: float, curved: bool) -> None:
    """The first of them, after the middle: where the three values, as parts of the last two's range, are 0.293 to 0.707
    from their ends; else the half on the side of the root is halved.
    """
    known, asked = {2.0: sign * ends[0], 6.0: sign * ends[1], 4.0: sign * middle}, list[float]()

    def f(x: float) -> float:
        asked.append(x)
        return known.pop(x) if x in known else 0.0

    (a, fa), (b, fb), (c, fc) = known.items()
    expected = (a * fb * fc / ((fa - fb) * (fa - fc)) + b * fa * fc / ((fb - fa) * (fb - fc))
                + c * fa * fb / ((fc - fa) * (fc - fb)))
    assert chandrupatla(f, a, b) == asked[3]
    assert asked[:3] == [2.0, 6.0, 4.0]
    assert asked[3] == pytest.approx(expected if curved else 5.0 if middle < 0.0 else 3.0, rel=1e-12)


def test_the_cubic_of_a_bracket_is_hermites() -> None:
    ends, slopes = np.array([[1.0, -2.0], [3.0, 5.0]]), np.array([[0.5, 4.0], [-7.0, 1.0]])
    for t in (0.0, 0.2, 0.7, 1.0):
        assert _hermite(*ends, *slopes, t) == pytest.approx(CubicHermiteSpline([0.0, 1.0], ends, slopes)(t))


@pytest.mark.parametrize(("one", "two", "turned"), [
    ((1.0, 0.0), (-3.0, 0.0), True), ((1.0, 0.0), (3.0, 0.0), False), ((2.0, 0.0), (-0.801, 0.599), True),
    ((2.0, 0.0), (-0.799, 0.602), False), ((0.0, 0.0), (1.0, 0.0), False)])
def test_vectors_are_opposite_below_a_cosine(one: Any, two: Any, turned: bool) -> None:
    assert turned_round(np.array(one), np.array(two), 0.8) is turned


@pytest.mark.parametrize(("events", "least"), [
    ("", ""), ("S", "S"), ("+", "+"), ("S+S", "+S"), ("+S+", "+S"), ("S+-S", "+-S"), ("-S+S-", "+S-S"),
    ("S-S+S", "+S-S"), ("+-+-", "+-+-"), ("-+", "+-"), ("FS", "FS"), ("+F+", "+F")])
def test_a_sequence_is_its_least_rotation(events: str, least: str) -> None:
    assert ring(events) == least


CHANGES = {
    "stick_border": ["S S+S", "S S-S", "S S+S-S", "S +-S"],
    "adding_sliding": ["+S +S+S", "-S -S-S", "+S-S +S-S-S", "+S-S +S+S-S", "+S +S+S+S"],
    "grazing_sliding": ["+ +S", "- -S", "+ +-", "- +-", "+- +-+-"],
    "crossing_sliding": ["+- +S-", "+-S +S-S", "-+S -S+S"],
    "switching_sliding": ["+S +-S", "-S -+S", "+S-S +-S-S", "+S-S +-S-+S"]}


@pytest.mark.parametrize(("kind", "pair"), [(kind, pair) for kind, pairs in CHANGES.items() for pair in pairs])
def test_the_kind_of_a_change_of_events(kind: str, pair: str) -> None:
    """With the margin that vanishes the least one, in every rotation and either order."""
    name = {"adding_sliding": "stick", "stick_border": "stick", "grazing_sliding": "grazing"}.get(kind, "arrival")
    near = {each: Margin(1e-9 if each == name else 0.5, np.zeros(2)) for each in ("grazing", "arrival", "stick")}
    shorter, longer = pair.split()
    for k in range(len(longer)):
        for one, two in ((shorter, longer[k:] + longer[:k]), (longer[k:] + longer[:k], shorter)):
            assert kind_of_change(one, two, (near, {})) == kind
            assert kind_of_change(one, two, ({}, near)) == kind


def test_a_change_that_no_rule_explains_has_the_kind_of_the_least_margin() -> None:
    def near(**sizes: float) -> dict[str, Margin]:
        return {name: Margin(size, np.zeros(2), name == "arrival" and size < 0.0) for name, size in sizes.items()}

    assert kind_of_change("+S-S", "-", (near(stick=0.1, grazing=-0.01, arrival=0.2), {})) == "grazing_sliding"
    assert kind_of_change("+S-S", "-", (near(stick=0.1), near(grazing=0.2, arrival=0.3))) == "adding_sliding"
    assert kind_of_change("+S-S", "-", (near(stick=0.1), near(arrival=0.01))) == "crossing_sliding"
    assert kind_of_change("+S-S", "-", (near(arrival=0.4), near(arrival=-0.01))) == "switching_sliding"
    assert kind_of_change("+S-S", "-", (near(arrival=-0.4), near(arrival=0.01))) == "crossing_sliding"
    assert margin_residual("stick_border", (near(stick=-0.3), near(stick=0.2, grazing=0.1))) == 0.2
    assert margin_residual("grazing_sliding", (near(stick=-0.3),)) == math.inf


class Scaled(TextbookMap):
    """The Henon map in natural sizes 2 and 1/4, with amplitudes x^2 of every cycle and their derivatives."""

    amplitude_scale = 10.0

    def __init__(self) -> None:
        super().__init__(henon, 2)
        self.scales = np.array([2.0, 0.25])

    def evaluate(self, x, values, first, cycles):
        amplitudes, rows = [], []
        slope = np.hstack([np.eye(2), np.zeros((2, len(values)))])
        for _ in range(cycles):
            amplitudes.append(float(x[0] ** 2))
            rows.append(2.0 * x[0] * slope[0])
            x, a, b = henon(x, values)
            slope = a @ slope
            slope[:, 2:] += b
        return Image(x, slope, Observation(max(amplitudes), 0.25 * cycles, "+S" * cycles, tuple(amplitudes)),
                     np.array(rows))


@pytest.mark.parametrize("segments", [(3,), (1, 2), (1, 1, 1)])
def test_the_equations_of_an_orbit_are_those_of_the_map_and_their_derivatives_those_of_differences(
        segments: tuple[int, ...]) -> None:
    of, random = Scaled(), np.random.default_rng(len(segments))
    shooting = Shooting(of, 3, (ParameterRange(1.0, 3.0, "a"), ParameterRange(0.5, 0.1, "b")), segments)
    m = len(segments)
    nodes, values = random.uniform(-0.5, 0.5, (m, 2)), (1.4, 0.3)
    z = shooting.unknowns(nodes, values)
    assert shooting.nodes(z) == pytest.approx(nodes)
    assert shooting.values(z) == pytest.approx(values)
    assert (z[-2:].tolist(), shooting.size, shooting.widths) == (pytest.approx([0.2, 0.5]), 2 * m, [2.0, -0.4])
    assert shooting.outer(z).tolist() == [*z[:2], *z[-2:]]
    at = shooting.linearise(z)
    for k, length in enumerate(segments):
        x = nodes[k]
        for _ in range(length):
            x = henon(x, values)[0]
        assert at.residual[2 * k:2 * k + 2] == pytest.approx((x - nodes[(k + 1) % m]) / of.scales)
    assert at.jacobian.shape == (2 * m, 2 * m + 2)
    assert at.amplitude_gradient.shape == (3, 2 * m + 2)
    for k, step in enumerate(1e-6 * np.eye(len(z))):
        ahead, behind = shooting.linearise(z + step), shooting.linearise(z - step)
        assert at.jacobian[:, k] == pytest.approx((ahead.residual - behind.residual) / 2e-6, abs=1e-7)
        assert at.amplitude_gradient[:, k] == pytest.approx((ahead.amplitudes - behind.amplitudes) / 2e-6, abs=1e-7)
    squares = [shooting.map.evaluate(node, values, 0, n).seen.amplitudes for node, n in zip(nodes, segments)]
    assert at.amplitudes == pytest.approx([x / 10.0 for each in squares for x in each])
    assert (at.seen.largest, at.seen.events) == (max(x for each in squares for x in each), "+S" * 3)
    assert at.seen.stick_fraction == pytest.approx(sum(0.25 * n * n for n in segments) / 3.0)
    assert shooting.keeps_segments(at.blocks, 1e9, False)
    assert shooting.keeps_segments(at.blocks, 1e9, True) is (m == 3)
    assert shooting.keeps_segments(at.blocks, 1e-9, False) is (m == 3)


def test_observations_of_segments_are_joined_with_their_lengths() -> None:
    parts = [Observation(1.0, 0.5, "S+", (1.0, 0.5)), Observation(3.0, 0.0, "+-", (3.0,)), Observation(2.0, 1.0, "S")]
    assert joined_observation(parts, (1.0, 0.5, 0.5)) == Observation(3.0, 0.5, "S+-S", (1.0, 0.5, 3.0))
    assert joined_observation(parts[:1], (1.0,)) is parts[0]


def test_the_layout_of_segments() -> None:
    starts, (rows, columns), (ends, following) = layout((0.5, 1.5, 1.0), 2)
    assert starts == [0, 0.5, 2.0]
    assert [rows[1].tolist(), columns[1].tolist()] == [[[2, 2], [3, 3]], [[2, 3], [2, 3]]]
    assert [ends.tolist(), following.tolist()] == [[0, 1, 2, 3, 4, 5], [2, 3, 4, 5, 0, 1]]


@pytest.mark.parametrize("growth", [3.0, 10.0, 1e9])
def test_an_orbit_is_cut_between_cycles_where_a_disturbance_has_grown(growth: float) -> None:
    of = TextbookMap(lambda x, p: (2.0 * x + p[0], np.array([[2.0]]), np.array([[1.0]])), 1)
    whole = Shooting.single(of, 6, ParameterRange(0.0, 2.0), settings=Settings(growth=growth))
    finer, z = whole.cut(whole.unknowns(np.array([[1.0]]), (1.0,)))
    count = {3.0: 1, 10.0: 3, 1e9: 6}[growth]
    assert finer.segments == (count,) * (6 // count)
    assert finer.nodes(z)[:, 0].tolist() == [2.0 ** (k * count + 1) - 1.0 for k in range(6 // count)]
    assert (finer.period, finer.map, finer.values(z)) == (6, of, (1.0,))


class Parts(TextbookMap):
    """x' = x exp(rate t) in parts of cycles, with an event where `events` says so; `asked` holds all parts."""

    divisible = True

    def __init__(self, rate: float, events: str = "") -> None:
        super().__init__(lambda x, p: (x, np.eye(1), np.zeros((1, 1))), 1)
        self.rate, self.events, self.asked = rate, events, list[tuple[float, float]]()

    def evaluate(self, x, values, first, cycles):
        self.asked.append((first, cycles))
        grown = math.exp(self.rate * cycles)
        return Image(x * grown, np.array([[grown, 0.0]]), Observation(1.0, 0.0, self.events))


@pytest.mark.parametrize(("rate", "thorough", "lengths"), [
    (1.0, False, [2]), (6.0, False, [0.75, 0.75, 0.5]), (5.0, False, [0.875, 0.875, 0.25]),
    (6.0, True, [3143 / 4096, 3143 / 4096, 1906 / 4096])])
def test_a_flow_is_cut_at_parts_of_cycles(rate: float, thorough: bool, lengths: list[float]) -> None:
    """The growth over a segment is at most 100, measured over sixteenths of cycles, or of their sixteenths."""
    of = Parts(rate, "+S" if thorough else "+")
    whole = Shooting.single(of, 2, ParameterRange(0.0, 1.0), settings=Settings(thorough=thorough))
    finer, z = whole.cut(whole.unknowns(np.array([[1.0]]), (0.5,)))
    assert finer.segments == pytest.approx(lengths)
    assert finer.nodes(z)[:, 0] == pytest.approx(np.exp(rate * np.cumsum([0.0, *lengths[:-1]])))
    assert min(cycles for _, cycles in of.asked) == pytest.approx(16.0**-3 if thorough else 16.0**-1)
    assert of.asked[:3] == [(0.0, 1.0), (0.0, 1 / 16), (0.0, 1 / 256) if thorough else (1 / 16, 1 / 16)]


def test_known_orbits_repel_newtons_method_by_the_deflation_operator() -> None:
    """The product of 1 + 1/d^2 over the known ones, and the slope of its logarithm along a step."""
    z, step = np.array([1.0, 2.0, 9.0]), np.array([0.3, -0.2])
    known = [np.array([0.0, 0.0, 5.0]), np.array([1.0, 1.0, 5.0])]
    assert _weight(z, known, 2) == pytest.approx((1.0 + 1.0 / 5.0) * 2.0)
    for each in known:
        ahead, behind = (math.log(_weight(z[:2] + s * step, [each[:2]], 2)) for s in (1e-6, -1e-6))
        assert _slope(z[:2] - each[:2], step) == pytest.approx((ahead - behind) / 2e-6, rel=1e-6)
    assert _newton_step(np.diag([2.0, 4.0]), np.array([2.0, 2.0]), 1e-12) == pytest.approx([-1.0, -0.5])
    assert _newton_step(np.diag([2.0, 0.0]), np.array([2.0, 3.0]), 1e-12) == pytest.approx([-1.0, 0.0])


def test_the_points_and_the_least_period_of_an_orbit() -> None:
    of = TextbookMap(lambda x, p: (np.array([(x[0] + 1.0) % 6.0]), np.eye(1), np.zeros((1, 1))), 1)
    x = np.array([4.0])
    assert [float(p[0]) for p in shifts(of, x, (), 6)] == [4.0, 5.0, 0.0, 1.0, 2.0, 3.0]
    assert [minimal_period(of, x, (), period) for period in (1, 5, 6, 12, 18)] == [1, 5, 6, 6, 6]
    of.forcing_period = 2
    assert [float(p[0]) for p in shifts(of, x, (), 6)] == [4.0, 0.0, 2.0]
    assert [minimal_period(of, x, (), period) for period in (2, 6, 12)] == [2, 6, 6]
    of.scales = np.array([1e3])
    assert [minimal_period(of, x, (), 12, same) for same in (1.9e-3, 2.1e-3)] == [6, 4]


def test_newtons_method_ends_at_its_tolerances() -> None:
    shooting = Shooting.single(TextbookMap(logistic, 1), 1, ParameterRange(0.0, 4.0))
    z = newton(shooting, np.array([0.61, 0.7]))
    assert z is not None
    assert z == pytest.approx([1.0 - 1.0 / 2.8, 0.7], abs=1e-15)
    assert newton(shooting, np.array([0.61, 0.7]), [z]) == pytest.approx([0.0, 0.7], abs=1e-12)
    assert newton(shooting, np.array([math.nan, 0.7])) is None


class Circle:
    """x^2 + y^2 = 1 with amplitudes (3 x, y) if `sized`."""

    rounding, size = 1e-10, 1

    def __init__(self, sized: bool = False, **settings: Any) -> None:
        self.settings, self.sized, self.coarse, self.calls = Settings(**settings), sized, self, 0
        self.ranges = (ParameterRange(0.0, 1.0),)

    def linearise(self, z: Any) -> Linearised:
        self.calls += 1
        x, y = z.tolist()
        sizes = (np.array([3.0 * x, y]), np.array([[3.0, 0.0], [0.0, 1.0]])) if self.sized else ()
        return Linearised(np.array([x * x + y * y - 1.0]), np.array([[2.0 * x, 2.0 * y]]), np.empty((0, 0, 0)),
                          Observation(0.0, 0.0, ""), *sizes)


@pytest.mark.parametrize("sized", [False, True])
def test_a_corrector_meets_the_curve_in_the_plane_of_its_guess(sized: bool) -> None:
    """Also in a plane of unknowns and amplitudes: row . (z - guess) + weights . (sizes - those at the guess) = 0."""
    of: Any = Circle(sized)
    guess, row = np.array([0.8, 0.7]), np.array([-0.6, 0.8])
    plane = (np.array([-0.2, 0.3]), np.array([3.0 * 0.8, 0.7])) if sized else FLAT
    got = corrector(of, guess, row, plane)
    assert got is not None
    slope = row + (np.array([-0.6, 0.3]) if sized else 0.0)
    assert float(slope @ (got.z - guess)) == pytest.approx(0.0, abs=1e-12)
    assert float(got.z @ got.z) == pytest.approx(1.0, abs=1e-12)
    away = got.z - guess
    distance = math.hypot(*away, *((3.0 * away[0], away[1]) if sized else ()))
    assert got.distance == pytest.approx(distance, rel=1e-6)
    assert np.linalg.norm(got.tangent) == pytest.approx(1.0)
    assert float(got.tangent @ got.z) == pytest.approx(0.0, abs=1e-8)
    assert got.slopes == pytest.approx(np.array([3.0, 1.0]) * got.tangent if sized else [])
    assert 0.0 < got.contraction < 0.15
    assert corrector(of, guess, row, plane, farthest=0.9 * float(np.abs(away).max())) is None


def test_a_corrector_takes_its_first_step_by_other_equations() -> None:
    of, cheap = Circle(), Circle()
    assert corrector(of, np.array([0.8, 0.7]), np.array([-0.6, 0.8]), first=cheap) is not None  # type: ignore[arg-type]
    assert cheap.calls == 1
    assert of.calls >= 2


def circle_at(degrees: float, sized: bool = False) -> Solution:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return solution_at(z := np.array([c, s]), Circle(sized).linearise(z), np.array([-s, c]))


def test_directions_of_a_curve_at_a_point() -> None:
    here, new = circle_at(0.0), circle_at(90.0)
    # det [2 x, 2 y; -y, x] = 2.
    assert (here.sign, solution_at(here.z, here.linearised, -here.tangent).sign) == (1.0, -1.0)
    assert oriented(here, 1.0) is here
    assert (oriented(here, -1.0).tangent.tolist(), oriented(here, -1.0).sign) == ([0.0, -1.0], -1.0)
    assert tangent_of(here.linearised, np.array([0.3, -0.1])) == pytest.approx([0.0, -1.0])
    assert np.abs(null_direction(new.linearised)) == pytest.approx([1.0, 0.0])
    assert cosine_between(here, new, False) == pytest.approx(math.cos(math.pi / 4.0))
    one, two = circle_at(0.0, True), circle_at(90.0, True)
    way, along = np.array([-1.0, 1.0, -3.0, 1.0]), np.array([-1.0, 0.0, -3.0, 0.0])
    assert cosine_between(one, two, True) == pytest.approx(way @ along / np.linalg.norm(way) / np.linalg.norm(along))
    assert cosine_between(one, one, True) == 0.0


def test_the_nodes_of_a_predictor_are_behind_the_last_point() -> None:
    here, before = circle_at(0.0), [circle_at(-30.0), circle_at(-20.0), circle_at(-10.0)]
    nodes = predictor_nodes(here, before, FLAT[0], 2)
    assert [at for at, _ in nodes] == pytest.approx([0.0, 0.0, *(-math.sin(math.radians(d)) for d in (10.0, 20.0))])
    assert nodes[0][1].tolist() == [0.0, 0.0]
    assert nodes[1][1].tolist() == [0.0, 1.0]
    assert nodes[2][1] == pytest.approx(before[2].z - here.z)
    assert len(predictor_nodes(here, before, FLAT[0], 3)) == 5
    assert len(predictor_nodes(here, [circle_at(10.0), circle_at(-10.0)], FLAT[0], 3)) == 3  # One lies ahead.
    sized, slopes = circle_at(0.0, True), np.array([0.0, 1.0])
    nodes = predictor_nodes(sized, [circle_at(-30.0), circle_at(-10.0, True)], slopes, 3)
    assert nodes[1][1] == pytest.approx(np.array([0.0, 1.0, 0.0, 1.0]) / 2.0)
    ten = circle_at(-10.0, True)
    assert [at for at, _ in nodes] == pytest.approx([0.0, 0.0, 2.0 * ten.z[1]])
    assert nodes[2][1] == pytest.approx([*(ten.z - sized.z), 3.0 * (ten.z[0] - 1.0), ten.z[1]])


@pytest.mark.parametrize("mu", [1.0, -1.0, np.exp(0.7j)])
@pytest.mark.parametrize("count", [1, 3])
def test_the_matrix_of_segments_is_singular_at_their_multipliers(mu: complex, count: int) -> None:
    """Its determinant is that of mu - M_m ... M_1 but for the sign; the bordered scalar is 0 with it."""
    blocks = np.random.default_rng(count).normal(size=(count, 2, 2))
    whole = np.linalg.multi_dot([*blocks[::-1]]) if count > 1 else blocks[0]
    matrix = cyclic(blocks, mu)
    assert abs(np.linalg.det(matrix)) == pytest.approx(abs(np.linalg.det(whole - mu * np.eye(2))))
    random = np.random.default_rng(9)
    b, c = random.normal(size=2 * count), random.normal(size=(1, 2 * count))
    v, w, g = bordered(matrix, b, c)
    assert matrix @ v[0] + b * g[0] == pytest.approx(np.zeros(2 * count), abs=1e-12)
    assert (c @ v[0]).item() == pytest.approx(1.0)
    assert w @ matrix + g[0] * c[0] == pytest.approx(np.zeros(2 * count), abs=1e-12)
    assert w @ b == pytest.approx(1.0)


def test_margins_are_the_least_over_the_segments_in_scaled_unknowns() -> None:
    margins = {0: {"stick": Margin(-0.2, np.array([1.0, 2.0, 3.0])), "grazing": Margin(0.5, np.ones(3))},
               1: {"stick": Margin(0.1, np.array([4.0, 5.0, 6.0]), True), "grazing": Margin(-0.5, np.ones(3))}}

    class Margined(TextbookMap):
        def margins(self, x, values, first, cycles):
            assert (values, cycles) == ((30.0,), 1)
            assert x.tolist() == [2.0 * first, 0.25]
            return margins[first]

    of = Margined(henon, 2)
    of.scales = np.array([2.0, 0.25])
    shooting = Shooting(of, 2, (ParameterRange(20.0, 40.0),), (1, 1))
    found = nearest_margins(shooting, np.array([0.0, 1.0, 1.0, 1.0, 0.5]))
    assert (found["stick"].value, found["stick"].grows) == (0.1, True)
    assert found["stick"].slopes.tolist() == [0.0, 0.0, 8.0, 1.25, 120.0]
    assert found["grazing"].value == 0.5
    assert found["grazing"].slopes.tolist() == [2.0, 0.25, 0.0, 0.0, 20.0]


def test_the_tests_of_multipliers_are_their_products() -> None:
    for m in (np.array([0.5 + 0.2j, 0.5 - 0.2j, -0.1]), np.array([3.0, -0.5, 0.2j])):
        assert doubling(m) == pytest.approx(np.linalg.det(np.diag(m) + np.eye(3)).real)
        assert torus(m) == pytest.approx(np.prod([x * y - 1.0 for x, y in itertools.combinations(m, 2)]).real)
    assert _opposite(1e-3, -1e-3, [1.0])
    assert not _opposite(1e-3, 1e-3, [1.0])
    assert not _opposite(1e-10, -1e-10, [1.0])
    assert not _opposite(-3e-9, 1e-10, [2.0, 2.0])
    assert _opposite(-5e-9, 1e-10, [2.0, 2.0])


ENDS = {
    StopReason.RANGE: "engine.frequency reached 80.5 rad/s, the end of the range",
    StopReason.CLOSED: "closed: back at its first point, engine.frequency = 80.5 rad/s",
    StopReason.DOUBLING: "ended in a period doubling of motions of a shorter period at engine.frequency = 80.5 rad/s",
    StopReason.BEGAN: "began in the period doubling at engine.frequency = 80.5 rad/s",
    StopReason.CANARD: ("ended at engine.frequency = 80.5 rad/s: beyond it a multiplier is above 1e+10, a canard, "
                        "which double precision does not resolve"),
    StopReason.CANARD_CURVE: ("ended at engine.frequency = 80.5 rad/s: beyond it a disturbance grows by more than "
                              "1e+10 along a part of the motion, a canard, which double precision does not resolve"),
    StopReason.FAMILY: ("met a family of motions with a multiplier of exactly 1 at engine.frequency = 80.5 rad/s: no "
                        "branch can be followed through it"),
    StopReason.POINTS: "stopped after 1e+10 points at engine.frequency = 80.5 rad/s",
    StopReason.TRIES: "given up after 1e+10 steps tried at engine.frequency = 80.5 rad/s: no progress",
    StopReason.STEP: ("no further point was found beyond engine.frequency = 80.5 rad/s: no step, however short, met a "
                      "residual of 1e+10"),
    StopReason.SPECIAL: "ended in a cusp at engine.frequency = 80.5 rad/s",
    StopReason.INTERRUPTED: "interrupted at engine.frequency = 80.5 rad/s"}


@pytest.mark.parametrize("reason", StopReason)
def test_the_sentence_of_every_end(reason: StopReason) -> None:
    assert str(End(reason, "engine.frequency", 80.5, 1e10, "cusp")) == ENDS[reason]
    assert str(End(StopReason.BEGAN, "friction.decay", 1.0 / 3.0)).endswith("friction.decay = 0.333333333 s/rad")
    assert str(End(StopReason.BEGAN, "p", 2.0)) == "began in the period doubling at p = 2"


def test_the_origins_of_branches() -> None:
    assert BranchOrigin().as_json() == "start"
    assert BranchOrigin("fold", 0.5, 0).as_json() == {"kind": "fold", "value": 0.5, "branch": 0}
    assert BranchOrigin("attractor", 0.0, attractor=2).as_json() == {"kind": "attractor", "value": 0.0, "attractor": 2}
