"""Curves of bifurcations of textbook maps in two parameters: places, special points, and ends."""

import math

import numpy as np
import pytest
from test_branches import branch_of, of_kind
from textbook_maps import Step, TextbookMap, henon

from tcc_sim.study.continuation import curves
from tcc_sim.study.continuation.bordered import MinimallyAugmented
from tcc_sim.study.continuation.codim2_points import AugmentedPoint, measured, values_of_tests
from tcc_sim.study.continuation.curves import BifurcationCurve, bifurcation_curve
from tcc_sim.study.continuation.follow import StopReason
from tcc_sim.study.continuation.palc import Solution, solution_at
from tcc_sim.study.continuation.settings import Settings
from tcc_sim.study.continuation.shooting import ParameterRange, Shooting
from tcc_sim.study.continuation.special_points import Bifurcation, point_at

P, Q = ParameterRange(-1.2, 5.0, name="p"), ParameterRange(-1.5, 1.5, name="q")


def at_second(step: Step, second: float) -> Step:
    """The map with its first parameter free alone."""
    def fixed(x, p):
        value, by_state, by = step(x, (p[0], second))
        return value, by_state, by[:, :1]

    return fixed


def curve_of(step: Step, dimension: int, kind: str, start: tuple[float, float], guess: list[float], *,
             first=P, second=Q, settings=None, period: int = 1) -> tuple[BifurcationCurve, TextbookMap]:
    """The curve of the first bifurcation of a kind on the branch through a guess."""
    branch = branch_of(at_second(step, start[1]), dimension, first.low, first.high, start[0], guess, period)
    of = TextbookMap(step, dimension)
    return bifurcation_curve(of_kind(branch, kind), of, (first, second), start[1], settings), of


def within_errors(curve: BifurcationCurve, places: dict[str, tuple[float, float]], most: float) -> None:
    """Its special points are these, each within its own error, and none has an error above `most`."""
    assert sorted(s.kind for s in curve.special) == sorted(places)
    for each in curve.special:
        assert each.located
        value, second = places[each.kind]
        assert abs(each.value - value) <= each.error < most
        assert abs(each.second - second) <= each.second_error < most


@pytest.mark.parametrize(("kind", "law", "points"), [
    ("fold", lambda b: -0.25 * (1.0 - b) ** 2, {"resonance_1_1": (-1.0, -1.0), "fold_flip": (0.0, 1.0)}),
    ("period_doubling", lambda b: 0.75 * (1.0 - b) ** 2, {"resonance_1_2": (3.0, -1.0), "fold_flip": (0.0, 1.0)})])
def test_curves_of_the_henon_map(kind: str, law, points) -> None:
    # Multipliers on the fold are 1 and -b, on the doubling -1 and b.
    curve, of = curve_of(henon, 2, kind, (0.1, 0.3), [0.1, 0.1])
    assert curve.values == pytest.approx([law(b) for b in curve.second], abs=1e-8)
    assert {end.reason for end in curve.ended} == {StopReason.RANGE}
    assert max(curve.second) == pytest.approx(1.5, abs=1e-12)
    within_errors(curve, points, 1e-7)
    # Two evaluations for each of some three iterations, and two for the coefficient of third order.
    assert of.evaluations < 22 * len(curve.values)


@pytest.mark.parametrize(("low", "high"), [(-9.0, 9.0), (0.3001, 9.0), (-9.0, 0.2999)])
def test_a_curve_that_cannot_be_followed_is_listed_with_its_end(low: float, high: float) -> None:
    def torn(x, p):
        if low < p[1] < high:
            raise ArithmeticError("no map")
        return henon(x, p)

    result = of_kind(branch_of(henon, 2, P.low, P.high, 0.1, [0.1, 0.1]), "fold")
    curve = bifurcation_curve(result, TextbookMap(torn, 2), (P, Q), 0.3)
    assert StopReason.STEP in {end.reason for end in curve.ended}
    assert any(str(end).startswith("no further point was found beyond ") for end in curve.ended)
    assert 0.3 in [round(b, 3) for b in curve.second]
    assert (len(curve.values) == 1) == (low < 0.3 < high)


def test_a_cusp_is_where_two_folds_meet() -> None:
    def cubic(x, p):  # p + q x - x^3 = 0: folds at q = 3 x^2, p = -2 x^3.
        return (x + 0.2 * (p[0] + p[1] * x - x**3), np.array([[1.0 + 0.2 * (p[1] - 3.0 * x[0] ** 2)]]),
                np.array([[0.2, 0.2 * x[0]]]))

    curve, _ = curve_of(cubic, 1, "fold", (0.9, 1.0), [1.4], first=ParameterRange(-1.0, 1.0))
    within_errors(curve, {"cusp": (0.0, 0.0)}, 1e-7)
    assert [27.0 * p**2 for p in curve.values] == pytest.approx([4.0 * q**3 for q in curve.second], abs=1e-7)
    assert curve.values[0] * curve.values[-1] < 0.0


def quintic(x, p):
    """Doubles at p = 0; period two at p - q x^2 + x^4 = 0, with folds at p = q^2/4, q = 2 x^2."""
    return (-(1.0 + p[0]) * x + p[1] * x**3 - x**5,
            np.array([[-(1.0 + p[0]) + 3.0 * p[1] * x[0] ** 2 - 5.0 * x[0] ** 4]]),
            np.array([[-x[0], x[0] ** 3]]))


def test_a_generalised_doubling_is_where_the_doubled_motion_changes_its_side() -> None:
    curve, _ = curve_of(quintic, 1, "period_doubling", (-0.2, 0.6), [0.0], first=ParameterRange(-0.5, 0.5))
    within_errors(curve, {"generalised_doubling": (0.0, 0.0)}, 1e-7)
    assert curve.values == pytest.approx([0.0] * len(curve.values), abs=1e-9)


@pytest.mark.parametrize("smallest", [1e-9, 2e-3])
def test_the_folds_of_doubled_motions_end_in_a_generalised_doubling(smallest: float) -> None:
    # The halves of the orbit are one motion there, and the doublings of that one are folds of period two as well.
    curve, _ = curve_of(quintic, 1, "fold", (0.05, 0.6), [0.7], first=ParameterRange(-0.5, 0.5), period=2,
                        settings=Settings(smallest_step=smallest))
    assert curve.values == pytest.approx([0.25 * q * q for q in curve.second], abs=1e-8)
    assert {(end.reason, end.what) for end in curve.ended} == {(StopReason.SPECIAL, "generalised doubling"),
                                                               (StopReason.RANGE, "")}
    within_errors(curve, {"generalised_doubling": (0.0, 0.0)}, 1e-5)


SHORT = 1e-4


def waving(x, p):
    """Bends within SHORT: -(1 + p) u + u^2/2 + q u^3 + ... of u = x/SHORT, so that the cubic coefficient is 1/4 + q."""
    u = x / SHORT
    jacobian = -(1.0 + p[0]) + np.sin(u) + 6.0 * p[1] * (1.0 - np.cos(u))
    return (SHORT * (-(1.0 + p[0]) * u + 1.0 - np.cos(u) + 6.0 * p[1] * (u - np.sin(u))), jacobian[:, None],
            SHORT * np.array([[-u[0], 6.0 * (u[0] - np.sin(u[0]))]]))


def test_a_generalised_doubling_of_motions_that_bend_within_a_short_length() -> None:
    curve, _ = curve_of(waving, 1, "period_doubling", (-0.2, 0.6), [0.0], first=ParameterRange(-0.5, 0.5))
    within_errors(curve, {"generalised_doubling": (0.0, -0.25)}, 1e-7)


@pytest.mark.parametrize("width", [1e-2, 1e-6])
def test_a_curve_of_folds_that_lie_in_a_sharp_bend(width: float) -> None:
    def bent(x, p):  # p + q x = sqrt(x^2 + width^2): folds at q = x/sqrt(x^2 + width^2), p = width sqrt(1 - q^2).
        root = math.hypot(x[0], width)
        return (x + 0.2 * (p[0] + p[1] * x - root), np.array([[1.0 + 0.2 * (p[1] - x[0] / root)]]),
                np.array([[0.2, 0.2 * x[0]]]))

    span, second = ParameterRange(-1.0, 1.0), ParameterRange(-0.9, 0.9)
    of = TextbookMap(bent, 1)
    shooting = Shooting.single(TextbookMap(at_second(bent, 0.5), 1), 1, span)
    at = width * math.sqrt(0.75)
    point = point_at(shooting, solution_at(z := np.array([width * 0.5 / math.sqrt(0.75), span.scaled(at)]),
                                           shooting.linearise(z), np.array([1.0, 0.0])))
    curve = bifurcation_curve(Bifurcation("fold", point, 0.0), of, (span, second), 0.5)
    assert {end.reason for end in curve.ended} == {StopReason.RANGE}
    assert sorted((curve.second[0], curve.second[-1])) == pytest.approx([-0.9, 0.9])
    assert curve.values == pytest.approx([width * math.sqrt(1.0 - q * q) for q in curve.second], abs=1e-9)


def test_a_curve_ends_where_a_disturbance_grows_beyond_what_is_resolved() -> None:
    # The derivative [[-2 x, 1], [b, 0]] has 2 |x| = 1 - b on the folds, whose multipliers are 1 and -b.
    curve, _ = curve_of(henon, 2, "fold", (0.1, 0.3), [0.1, 0.1], settings=Settings(canard=2.0))
    assert {end.reason for end in curve.ended} == {StopReason.CANARD_CURVE, StopReason.RANGE}
    assert -1.0 < min(curve.second) < -1.0 + 0.03 * (Q.high - Q.low)


def turning(x, p):
    """Turns by 1.2 + q and grows by 1 + p + (q - 0.1) |x|^2: 1:4 at q = pi/2 - 1.2, 1:3 at 2 pi/3 - 1.2."""
    c, s = math.cos(1.2 + p[1]), math.sin(1.2 + p[1])
    turn, by_turn = np.array([[c, -s], [s, c]]), np.array([[-s, -c], [c, -s]])
    square = float(x @ x)
    grown = 1.0 + p[0] + (p[1] - 0.1) * square
    jacobian = turn @ (grown * np.eye(2) + 2.0 * (p[1] - 0.1) * np.outer(x, x))
    return turn @ x * grown, jacobian, np.column_stack([turn @ x, by_turn @ x * grown + turn @ x * square])


def test_the_resonances_1_3_and_1_4_lie_on_a_neimark_sacker_curve() -> None:
    curve, _ = curve_of(turning, 2, "neimark_sacker", (-0.2, 0.0), [0.0, 0.0], first=ParameterRange(-0.5, 0.5))
    assert curve.values == pytest.approx([0.0] * len(curve.values), abs=1e-9)
    within_errors(curve, {f"resonance_1_{n}": (0.0, 2.0 * math.pi / n - 1.2) for n in (3, 4)}
                  | {"resonance_1_1": (0.0, -1.2)}, 1e-8)


def generalised_henon(x, p):
    """x' = y, y' = p - q x - y^2 + R x y with R = -0.1: Neimark-Sacker at q = 1 + R y with 2 cos theta = (R - 2) y."""
    r = -0.1
    by = np.array([[0.0, 0.0], [1.0, -x[0]]])
    return (np.array([x[1], p[0] - p[1] * x[0] - x[1] ** 2 + r * x[0] * x[1]]),
            np.array([[0.0, 1.0], [-p[1] + r * x[1], -2.0 * x[1] + r * x[0]]]), by)


def test_a_neimark_sacker_curve_ends_in_the_resonances_1_1_and_1_2() -> None:
    def place(angle: float) -> tuple[float, float]:
        y = 2.0 * math.cos(angle) / (-2.1)
        q = 1.0 - 0.1 * y
        return y + q * y + y**2 + 0.1 * y**2, q

    curve, _ = curve_of(generalised_henon, 2, "neimark_sacker", (1.6, 0.95), [0.55, 0.55],
                        second=ParameterRange(0.5, 2.0))
    assert {(end.reason, end.what) for end in curve.ended} == {(StopReason.SPECIAL, "resonance 1 1"),
                                                               (StopReason.SPECIAL, "resonance 1 2")}
    angles = {"resonance_1_1": 0.0, "resonance_1_4": 0.5 * math.pi, "resonance_1_3": 2.0 * math.pi / 3.0,
              "resonance_1_2": math.pi}
    within_errors(curve, {name: place(angle) for name, angle in angles.items()}, 1e-6)


def with_noise(size: float):
    """`quintic` with a derivative that is off by up to `size`, differently at every state."""
    def noisy(x, p):
        value, by_state, by_parameters = quintic(x, p)
        return value, by_state + size * math.sin(1e15 * (x[0] + 0.1 * p[1])), by_parameters

    return noisy


SPAN = ParameterRange(-0.5, 0.5)


@pytest.mark.parametrize(("size", "second"), [(1e-14, 0.6), (1e-12, 0.05), (1e-10, -0.7)])
def test_a_special_point_lies_within_its_error_wherever_the_curve_begins(size: float, second: float) -> None:
    curve, _ = curve_of(with_noise(size), 1, "period_doubling", (-0.2, second), [0.0], first=SPAN)
    (result,) = curve.special
    assert (result.kind, result.located) == ("generalised_doubling", True)
    assert abs(result.second) <= result.second_error < 1e6 * size + 1e-7


def test_a_test_function_that_is_all_noise_lists_no_special_point() -> None:
    """A cubic coefficient that is 1e-9 of the bend of the map, with either sign."""
    def flat(x, p):
        value, by_state, by_parameters = with_noise(1e-10)(x, (p[0], 1e-9 * p[1]))
        return value, by_state, by_parameters * np.array([1.0, 1e-9])

    curve, _ = curve_of(flat, 1, "period_doubling", (-0.2, 0.6), [0.0], first=SPAN)
    assert len(curve.values) > 20
    assert curve.special == ()


@pytest.mark.parametrize(("side", "second"), [(1.0, 0.6), (-1.0, 0.6)])
def test_a_sign_that_is_resolved_on_one_side_only_lists_nothing(side: float, second: float,
                                                                monkeypatch: pytest.MonkeyPatch) -> None:
    def noisy(point, test):
        value, noise, step = measured(point, test)
        q = point.equations.ranges[1].value(point.solution.z[2])
        return value, (1e9 if q * side > 0.0 else noise), step

    monkeypatch.setattr(curves, "measured", noisy)
    curve, _ = curve_of(quintic, 1, "period_doubling", (-0.2, second), [0.0], first=SPAN)
    assert curve.special == ()


def test_a_change_of_sign_that_only_other_segments_resolve_is_listed_as_not_located(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Period two of the Henon map doubles at a = (1 - b)^2 + (1 + b)^2/4, with a 1:2 resonance at b = 1."""
    def noisy(point, test):
        value, noise, step = measured(point, test)
        _, b = point.equations.shooting.values(point.solution.z)
        return value, (1e9 if b > 1.0 and len(point.equations.shooting.segments) == 1 else noise), step

    monkeypatch.setattr(curves, "measured", noisy)
    curve, _ = curve_of(henon, 2, "period_doubling", (0.6, 0.3), [0.83, -0.13], period=2,
                        second=ParameterRange(0.2, 1.5), settings=Settings(growth=2.2))
    (result,) = curve.special
    assert (result.kind, result.located) == ("resonance_1_2", False)
    assert abs(result.value - 1.0) <= result.error < 0.5
    assert abs(result.second - 1.0) <= result.second_error < 0.5


@pytest.mark.parametrize("longer", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(("a", "b"), [(0.3, 0.2), (0.3, -0.2), (0.0, 0.4), (-0.5, 0.0)])
def test_the_test_of_a_generalised_doubling_is_the_coefficient_of_third_order(a: float, b: float,
                                                                              longer: float) -> None:
    """x' = -x + a x^2 + b x^3 has 3 (a^2 + b): C(q, q, q) = 6 b, B(q, q) = 2 a and h = a (Kuznetsov, Section 5.4.2)."""
    of = TextbookMap(lambda x, p: (-(1.0 + p[0]) * x + a * x**2 + b * x**3, np.array([[
        -(1.0 + p[0]) + 2.0 * a * x[0] + 3.0 * b * x[0] ** 2]]), np.array([[-x[0], 0.0]])), 1)
    shooting = Shooting.single(of, 1, P, Q)
    u = shooting.unknowns(np.zeros((1, 1)), (0.0, 0.5))
    equations = MinimallyAugmented("period_doubling", shooting, u)
    point = AugmentedPoint(Solution(u, np.zeros(3), equations.linearise(u), 1.0), equations)
    tests = values_of_tests(point, longer)
    assert abs(tests["resonance_1_2"]) == pytest.approx(1.0)
    assert tests["generalised_doubling"] == pytest.approx(3.0 * (a * a + b) * tests["resonance_1_2"], abs=1e-6)
    assert tests["fold_flip"] == 1.0
