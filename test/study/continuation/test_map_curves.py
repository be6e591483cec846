"""Curves of bifurcations of textbook maps in two parameters beside their closed forms: places, special points, ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pytest
from textbook_maps import BORDERS, Edged, Step, TextbookMap, at_second, branch_of, henon, mirrored, of_kind, resized

from tcc_sim.study.continuation.arclength import StopReason
from tcc_sim.study.continuation.bifurcations import Bifurcation, ContinuationPoint
from tcc_sim.study.continuation.curves import BifurcationCurve, bifurcation_curve
from tcc_sim.study.continuation.orbits import DEFAULTS, ParameterRange, Settings, Shooting

P, Q, UNIT = (-1.2, 5.0), (-1.5, 1.5), (-0.5, 0.5)
BOTH = {StopReason.RANGE}


def cubic(x, p):
    """p + q x - x^3 = 0: folds at q = 3 x^2, p = -2 x^3."""
    return (x + 0.2 * (p[0] + p[1] * x - x**3), np.array([[1.0 + 0.2 * (p[1] - 3.0 * x[0] ** 2)]]),
            np.array([[0.2, 0.2 * x[0]]]))


def ring(x, p):
    """Folds at x = 0 where p^2 + q^2 = 1."""
    return (x + 0.2 * (x**2 + p[0] ** 2 + p[1] ** 2 - 1.0), np.array([[1.0 + 0.4 * x[0]]]),
            np.array([[0.4 * p[0], 0.4 * p[1]]]))


def quintic(x, p):
    """Doubles at p = 0; period two at p - q x^2 + x^4 = 0, with folds at p = q^2/4, q = 2 x^2."""
    return (-(1.0 + p[0]) * x + p[1] * x**3 - x**5,
            np.array([[-(1.0 + p[0]) + 3.0 * p[1] * x[0] ** 2 - 5.0 * x[0] ** 4]]),
            np.array([[-x[0], x[0] ** 3]]))


SHORT = 1e-4


def waving(x, p):
    """Bends within SHORT: -(1 + p) u + u^2/2 + q u^3 + ... of u = x/SHORT, so that the cubic coefficient is 1/4 + q."""
    u = x / SHORT
    jacobian = -(1.0 + p[0]) + np.sin(u) + 6.0 * p[1] * (1.0 - np.cos(u))
    return (SHORT * (-(1.0 + p[0]) * u + 1.0 - np.cos(u) + 6.0 * p[1] * (u - np.sin(u))), jacobian[:, None],
            SHORT * np.array([[-u[0], 6.0 * (u[0] - np.sin(u[0]))]]))


def turning(x, p):
    """Turns by 1.2 + q and grows by 1 + p + (q - 0.1) |x|^2: 1:4 at q = pi/2 - 1.2, 1:3 at 2 pi/3 - 1.2."""
    c, s = math.cos(1.2 + p[1]), math.sin(1.2 + p[1])
    turn, by_turn = np.array([[c, -s], [s, c]]), np.array([[-s, -c], [c, -s]])
    square = float(x @ x)
    grown = 1.0 + p[0] + (p[1] - 0.1) * square
    jacobian = turn @ (grown * np.eye(2) + 2.0 * (p[1] - 0.1) * np.outer(x, x))
    return turn @ x * grown, jacobian, np.column_stack([turn @ x, by_turn @ x * grown + turn @ x * square])


def generalised_henon(x, p):
    """x' = y, y' = p - q x - y^2 + R x y with R = -0.1: Neimark-Sacker at q = 1 + R y with 2 cos theta = (R - 2) y."""
    r = -0.1
    by = np.array([[0.0, 0.0], [1.0, -x[0]]])
    return (np.array([x[1], p[0] - p[1] * x[0] - x[1] ** 2 + r * x[0] * x[1]]),
            np.array([[0.0, 1.0], [-p[1] + r * x[1], -2.0 * x[1] + r * x[0]]]), by)


def generalised(angle: float) -> tuple[float, float]:
    """Parameters at which the multipliers of `generalised_henon` are exp(+- i angle)."""
    y = 2.0 * math.cos(angle) / (-2.1)
    q = 1.0 - 0.1 * y
    return y + q * y + y**2 + 0.1 * y**2, q


def off_neimark_sacker(p: float, q: float) -> float:
    y = 10.0 * (1.0 - q)
    return y + q * y + y**2 + 0.1 * y**2 - p


def growing_ring(x, p):
    """The ring beside y' = (2.5 + p) y."""
    value, slope, by = ring(x[:1], p)
    return (np.append(value, (2.5 + p[0]) * x[1]), np.diag([slope[0, 0], 2.5 + p[0]]), np.vstack([by, [x[1], 0.0]]))


class Known(NamedTuple):
    """A curve of bifurcations: law is 0 on it, and special points with their places."""

    step: Step
    kind: str
    start: tuple[float, float]
    guess: Sequence[float]
    law: Callable[[float, float], float]
    special: dict[str, tuple[float, float]]
    first: tuple[float, float] = P
    second: tuple[float, float] = Q
    period: int = 1
    ends: frozenset[tuple[StopReason, str]] = frozenset({(StopReason.RANGE, "")})
    settings: Settings = DEFAULTS
    most: float = 1e-7


KNOWN = {
    "fold of henon": Known(henon, "fold", (0.1, 0.3), [0.1, 0.1], lambda a, b: a + 0.25 * (1.0 - b) ** 2, {
        "resonance_1_1": (-1.0, -1.0), "fold_flip": (0.0, 1.0)}),  # Multipliers on it are 1 and -b.
    "doubling of henon": Known(henon, "period_doubling", (0.1, 0.3), [0.1, 0.1],
                               lambda a, b: a - 0.75 * (1.0 - b) ** 2,
                               {"resonance_1_2": (3.0, -1.0), "fold_flip": (0.0, 1.0)}),
    "doubling of period two": Known(henon, "period_doubling", (0.6, 0.3), [0.83, -0.13],
                                    lambda a, b: a - (1.0 - b) ** 2 - 0.25 * (1.0 + b) ** 2,
                                    {"resonance_1_2": (1.0, 1.0)}, second=(0.2, 1.5), period=2),
    "the same, cut": Known(henon, "period_doubling", (0.6, 0.3), [0.83, -0.13],
                           lambda a, b: a - (1.0 - b) ** 2 - 0.25 * (1.0 + b) ** 2, {"resonance_1_2": (1.0, 1.0)},
                           second=(0.2, 1.5), period=2, settings=Settings(growth=2.2)),
    "cusp": Known(cubic, "fold", (0.9, 1.0), [1.4], lambda p, q: 27.0 * p * p - 4.0 * q**3, {"cusp": (0.0, 0.0)},
                  first=(-1.0, 1.0)),
    "generalised doubling": Known(quintic, "period_doubling", (-0.2, 0.6), [0.0], lambda p, q: p,
                                  {"generalised_doubling": (0.0, 0.0)}, first=UNIT),
    # The halves of the orbit are one motion there, and the doublings of that one are folds of period two as well.
    "folds of doubled motions": Known(quintic, "fold", (0.05, 0.6), [0.7], lambda p, q: p - 0.25 * q * q,
                                      {"generalised_doubling": (0.0, 0.0)}, first=UNIT, period=2, most=1e-5,
                                      ends=frozenset({(StopReason.RANGE, ""),
                                                      (StopReason.SPECIAL, "generalised doubling")})),
    "waving": Known(waving, "period_doubling", (-0.2, 0.6), [0.0], lambda p, q: p,
                    {"generalised_doubling": (0.0, -0.25)}, first=UNIT),
    "resonances": Known(turning, "neimark_sacker", (-0.2, 0.0), [0.0, 0.0], lambda p, q: p, {
        **{f"resonance_1_{n}": (0.0, 2.0 * math.pi / n - 1.2) for n in (3, 4)}, "resonance_1_1": (0.0, -1.2)},
        first=UNIT, ends=frozenset({(StopReason.RANGE, ""), (StopReason.SPECIAL, "resonance 1 1")})),
    "ends of neimark_sacker": Known(generalised_henon, "neimark_sacker", (1.6, 0.95), [0.55, 0.55],
                                    off_neimark_sacker,
                                    {name: generalised(angle) for name, angle in (
                                        ("resonance_1_1", 0.0), ("resonance_1_4", 0.5 * math.pi),
                                        ("resonance_1_3", 2.0 * math.pi / 3.0), ("resonance_1_2", math.pi))},
                                    second=(0.5, 2.0), most=1e-6,
                                    ends=frozenset((StopReason.SPECIAL, f"resonance 1 {n}") for n in (1, 2))),
    "ring": Known(ring, "fold", (0.0, 0.3), [-0.9], lambda p, q: p * p + q * q - 1.0, {}, first=(-2.0, 2.0),
                  second=(-2.0, 2.0), ends=frozenset({(StopReason.CLOSED, "")}))}


def curve_of(of: TextbookMap, known: Known, sign: float = 1.0, sizes: np.ndarray | None = None,
             settings: Settings | None = None) -> BifurcationCurve:
    """The curve of the first bifurcation of the kind on the branch through the guess."""
    p, q = known.start
    low, high = sorted(sign * x for x in known.first)
    one = TextbookMap(at_second(of.step, q), of.dimension, tuple(of.scales))
    guess = np.array(known.guess) * (np.ones(of.dimension) if sizes is None else sizes)
    branch = branch_of(one, low, high, sign * p, guess, known.period)
    ranges = ParameterRange(low, high, name="p"), ParameterRange(*known.second, name="q")
    return bifurcation_curve(of_kind(branch, known.kind), of, ranges, q, settings or known.settings)


@pytest.mark.parametrize(("name", "how"), [
    *((name, ("plain", "mirrored, sized")[k % 2]) for k, name in enumerate(KNOWN)),
    ("folds of doubled motions", "mirrored, sized")])
def test_a_curve_is_the_one_of_the_textbook(name: str, how: str) -> None:
    known = KNOWN[name]
    dimension, sign = len(known.guess), 1.0 if how == "plain" else -1.0
    sizes = np.ones(dimension) if how == "plain" else np.array([40.0, 0.003])[:dimension]
    step = known.step if how == "plain" else mirrored(resized(known.step, sizes))
    curve = curve_of(TextbookMap(step, dimension, tuple(sizes)), known, sign, sizes)
    assert curve.kind == known.kind
    assert {(end.reason, end.what) for end in curve.ended} == known.ends
    values = [sign * p for p in curve.values]
    assert [known.law(p, q) for p, q in zip(values, curve.second)] == pytest.approx([0.0] * len(values), abs=1e-6)
    places = np.column_stack([values, curve.second])
    steps = np.diff(places, axis=0) / [np.ptp(known.first), np.ptp(known.second)]
    steps = steps[np.abs(steps).max(axis=1) > 1e-6]  # At a special point it may end with rounding.
    assert name == "cusp" or (np.sum(steps[1:] * steps[:-1], axis=1) > 0.0).all()
    if known.ends == {(StopReason.RANGE, "")}:
        for p, q in places[[0, -1]]:
            assert min(abs(p - known.first[0]), abs(p - known.first[1]), abs(q - known.second[0]),
                       abs(q - known.second[1])) < 1e-9
    assert sorted(s.kind for s in curve.special) == sorted(known.special)
    for each in curve.special:
        p, q = known.special[each.kind]
        assert each.located
        assert abs(sign * each.value - p) <= each.error < known.most
        assert abs(each.second - q) <= each.second_error < known.most


@pytest.mark.parametrize(("kind", "edge", "b"), [*((kind, -0.2, 0.6) for kind in BORDERS),
                                                 ("stick_border", -0.6, -0.2)])
def test_a_curve_lists_the_change_of_events_that_it_meets(kind: str, edge: float, b: float) -> None:
    """Folds of the Henon map lie at x = -(1 - b)/2, a = -(1 - b)^2/4."""
    curve = curve_of(Edged(henon, 2, kind, edge), KNOWN["fold of henon"])
    (item,) = [s for s in curve.special if s.kind == kind]
    assert item.located
    assert abs(item.second - b) <= item.second_error < 1e-6
    assert abs(item.value + 0.25 * (1.0 - b) ** 2) <= item.error < 1e-6


@pytest.mark.parametrize(("low", "high"), [(-9.0, 9.0), (0.3001, 9.0), (-9.0, 0.2999)])
def test_a_curve_that_cannot_be_followed_is_listed_with_its_end(low: float, high: float) -> None:
    def torn(x, p):
        if low < p[1] < high:
            raise ArithmeticError("no map")
        return henon(x, p)

    result = of_kind(branch_of(TextbookMap(at_second(henon, 0.3), 2), *P, 0.1, [0.1, 0.1]), "fold")
    curve = bifurcation_curve(result, TextbookMap(torn, 2), (ParameterRange(*P), ParameterRange(*Q)), 0.3)
    assert StopReason.STEP in {end.reason for end in curve.ended}
    assert 0.3 in [round(b, 3) for b in curve.second]
    assert (len(curve.values) == 1) == (low < 0.3 < high)


@pytest.mark.parametrize("width", [1e-2, 1e-6])
def test_a_curve_of_folds_that_lie_in_a_sharp_bend(width: float) -> None:
    def bent(x, p):  # p + q x = sqrt(x^2 + width^2): folds at q = x/sqrt(x^2 + width^2), p = width sqrt(1 - q^2).
        root = math.hypot(x[0], width)
        return (x + 0.2 * (p[0] + p[1] * x - root), np.array([[1.0 + 0.2 * (p[1] - x[0] / root)]]),
                np.array([[0.2, 0.2 * x[0]]]))

    span, second = ParameterRange(-1.0, 1.0), ParameterRange(-0.9, 0.9)
    shooting = Shooting.single(TextbookMap(at_second(bent, 0.5), 1), 1, span)
    at = width * math.sqrt(0.75)
    point = ContinuationPoint.at(shooting, np.array([width * 0.5 / math.sqrt(0.75), span.scaled(at)]))
    curve = bifurcation_curve(Bifurcation("fold", point, 0.0), TextbookMap(bent, 1), (span, second), 0.5)
    assert {end.reason for end in curve.ended} == BOTH
    assert sorted((curve.second[0], curve.second[-1])) == pytest.approx([-0.9, 0.9])
    assert curve.values == pytest.approx([width * math.sqrt(1.0 - q * q) for q in curve.second], abs=1e-9)


def test_a_curve_ends_where_a_disturbance_grows_beyond_what_is_resolved() -> None:
    # The derivative [[-2 x, 1], [b, 0]] has 2 |x| = 1 - b on the folds, whose multipliers are 1 and -b.
    known = KNOWN["fold of henon"]
    curve = curve_of(TextbookMap(henon, 2), known, settings=Settings(canard=2.0))
    assert {end.reason for end in curve.ended} == {StopReason.CANARD_CURVE, StopReason.RANGE}
    assert -1.0 < min(curve.second) < -1.0 + 0.03 * (Q[1] - Q[0])
    short = curve_of(TextbookMap(henon, 2), known, settings=Settings(max_points=3))
    assert {end.reason for end in short.ended} == {StopReason.POINTS}
    assert len(short.values) == 7


def test_a_closed_curve_whose_orbits_are_cut_anew_is_closed() -> None:
    """Three cycles are one segment at first, and three where a disturbance grows."""
    span = ParameterRange(-2.0, 2.0)
    result = of_kind(branch_of(TextbookMap(at_second(growing_ring, 0.6), 2), -2.0, 2.0, 0.0, [-0.8, 0.0]), "fold")
    settings = Settings(growth=3.0, fewer_after=5)
    curve = bifurcation_curve(result, TextbookMap(growing_ring, 2), (span, span), 0.6, settings)
    assert {end.reason for end in curve.ended} == {StopReason.CLOSED}
    assert [p * p + q * q for p, q in zip(curve.values, curve.second)] == pytest.approx([1.0] * len(curve.values))


def with_noise(size: float) -> Step:
    """`quintic` with a derivative that is off by up to `size`, differently at every state."""
    def noisy(x, p):
        value, by_state, by_parameters = quintic(x, p)
        return value, by_state + size * math.sin(1e15 * (x[0] + 0.1 * p[1])), by_parameters

    return noisy


@pytest.mark.parametrize(("size", "second"), [(1e-14, 0.6), (1e-12, 0.05), (1e-10, -0.7)])
def test_a_special_point_lies_within_its_error_wherever_the_curve_begins(size: float, second: float) -> None:
    known = KNOWN["generalised doubling"]._replace(start=(-0.2, second))
    (result,) = curve_of(TextbookMap(with_noise(size), 1), known).special
    assert (result.kind, result.located) == ("generalised_doubling", True)
    assert abs(result.second) <= result.second_error < 1e6 * size + 1e-7


def test_a_test_function_that_is_all_noise_lists_no_special_point() -> None:
    """A cubic coefficient that is 1e-9 of the bend of the map, with either sign."""
    def flat(x, p):
        value, by_state, by_parameters = with_noise(1e-10)(x, (p[0], 1e-9 * p[1]))
        return value, by_state, by_parameters * np.array([1.0, 1e-9])

    curve = curve_of(TextbookMap(flat, 1), KNOWN["generalised doubling"])
    assert len(curve.values) > 20
    assert curve.special == ()


@pytest.mark.parametrize(("a", "b"), [(0.3, 0.2), (0.3, -0.2), (-0.5, 0.0), (0.2, 0.7)])
def test_a_generalised_doubling_is_where_the_coefficient_of_third_order_vanishes(a: float, b: float) -> None:
    """x' = -(1 + p) x + a x^2 + (b + q) x^3 has 3 (a^2 + b + q) at p = 0 (Kuznetsov, Section 5.4.2)."""
    def third(x, p):
        c = b + p[1]
        return (-(1.0 + p[0]) * x + a * x**2 + c * x**3,
                np.array([[-(1.0 + p[0]) + 2.0 * a * x[0] + 3.0 * c * x[0] ** 2]]), np.array([[-x[0], x[0] ** 3]]))

    known = KNOWN["generalised doubling"]._replace(start=(-0.2, 0.3))
    (result,) = curve_of(TextbookMap(third, 1), known).special
    assert result.kind == "generalised_doubling"
    assert abs(result.second + a * a + b) <= result.second_error < 1e-6


@pytest.mark.parametrize(("value", "error", "digits"), [(1.23456789, 0.002, "1.2346"), (123.4, 30.0, "123"),
                                                        (12.5, 0.4, "12.50")])
def test_a_special_point_is_printed_with_the_digits_that_its_error_allows(value, error, digits) -> None:
    (item,) = curve_of(TextbookMap(cubic, 1), KNOWN["cusp"]).special
    shown = type(item)("cusp", value, 0.5, error, 0.25, point=item.point).described("p", "engine.frequency")
    assert f"p {digits} +- {error:.1g}" in shown
    assert "engine.frequency 0.50 +- 0.2 rad/s" in shown
