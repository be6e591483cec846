"""Curves of bifurcations continue, close and stop, also in segments other than the first."""

import math
from collections import deque

import numpy as np
import pytest
from test_branches import branch_of, of_kind
from test_codim2 import P, Q, at_second, curve_of
from textbook_maps import TextbookMap, henon

from tcc_sim.study.continuation.bordered import MinimallyAugmented
from tcc_sim.study.continuation.bracket import CurvePoint
from tcc_sim.study.continuation.curves import CurveTrack, bifurcation_curve, facing, start_of_curve
from tcc_sim.study.continuation.follow import Continuation, StopReason
from tcc_sim.study.continuation.palc import Solution, solution_at
from tcc_sim.study.continuation.problem import Image
from tcc_sim.study.continuation.settings import Settings
from tcc_sim.study.continuation.shooting import ParameterRange, Shooting


def ring(x, p):
    """Folds at x = 0 where p^2 + q^2 = 1."""
    return (x + 0.2 * (x**2 + p[0] ** 2 + p[1] ** 2 - 1.0), np.array([[1.0 + 0.4 * x[0]]]),
            np.array([[0.4 * p[0], 0.4 * p[1]]]))


def followed(equations: MinimallyAugmented, forward: bool) -> CurveTrack:
    """The curve from its start, followed to its end."""
    track = CurveTrack(facing(start_of_curve(equations), forward))
    deque(track.follow(), 0)
    return track


def test_a_curve_that_comes_back_is_closed() -> None:
    curve, _ = curve_of(ring, 1, "fold", (0.0, 0.3), [-0.9], first=ParameterRange(-2.0, 2.0),
                        second=ParameterRange(-2.0, 2.0))
    assert {end.reason for end in curve.ended} == {StopReason.CLOSED}
    assert [p**2 + q**2 for p, q in zip(curve.values, curve.second)] == pytest.approx([1.0] * len(curve.values))


class TakenBack(TextbookMap):
    """Four cycles multiply x, known to 1e-15, by `gain` each; the fifth one has a cusp in that, and divides."""

    forcing_period = 5
    gain = 11.0

    def __init__(self) -> None:
        def step(x, p):
            y = x * self.gain**4
            return ((y + 0.2 * (p[0] + p[1] * y - y**3)) / self.gain**4,
                    np.array([[1.0 + 0.2 * (p[1] - 3.0 * y[0] ** 2)]]), 0.2 / self.gain**4 * np.array([[1.0, y[0]]]))

        super().__init__(step, 1)

    def evaluate(self, x, values, first, cycles):
        if cycles > 1:
            a, b = self.evaluate(x, values, first, 1), self.evaluate
            b = self.evaluate(a.value, values, first + 1, cycles - 1)
            by_state, by_parameter = b.jacobian @ a.jacobian, b.jacobian @ a.derivatives[:, 1:] + b.derivatives[:, 1:]
            return Image(b.value, np.hstack([by_state, by_parameter]))
        if first % 5 < 4:
            return Image(self.gain * np.round(x, 15), np.array([[self.gain, 0.0, 0.0]]))
        value, jacobian, by_parameter = self.step(x / self.gain**4, values)
        return Image(value, np.hstack([jacobian / self.gain**4, by_parameter]))


def test_a_curve_goes_on_in_more_segments_where_growth_within_one_is_taken_back() -> None:
    # The derivative over all cycles is one, but it bends within 1e-4.
    span = ParameterRange(-1.0, 1.0)
    of = TakenBack()
    whole = Shooting.single(of, 5, span, Q)
    x = -math.sqrt(0.2)
    start = whole.unknowns(np.array([[x / of.gain**4]]), (-2.0 * x**3, 0.6))
    equations = MinimallyAugmented("fold", whole, start)
    track = followed(equations, False)
    values = [point.equations.shooting.values(point.solution.z) for point in track.points]
    assert [27.0 * p**2 for p, _ in values] == pytest.approx([4.0 * q**3 for _, q in values], abs=1e-6)
    assert min(values[-1][0] + 1.0, 1.5 - values[-1][1]) == pytest.approx(0.0, abs=1e-9)
    assert [each.kind for _, each in track.special] == ["cusp"]


def test_a_curve_that_comes_back_in_other_segments_is_closed() -> None:
    # Beside the ring y' = (2.5 + p) y: three cycles are one segment at first.
    def growing(x, p):
        value, slope, by = ring(x[:1], p)
        return (np.append(value, (2.5 + p[0]) * x[1]), np.diag([slope[0, 0], 2.5 + p[0]]),
                np.vstack([by, [x[1], 0.0]]))

    span = ParameterRange(-2.0, 2.0)
    whole = Shooting.single(TextbookMap(growing, 2), 3, span, span, settings=Settings(growth=3.0, fewer_after=5))
    equations = MinimallyAugmented("fold", whole, whole.unknowns(np.zeros((1, 2)), (-0.8, 0.6)))
    track = followed(equations, True)
    assert {point.equations.shooting.segments for point in track.points} == {(3,), (1, 1, 1)}
    assert track.ended.reason is StopReason.CLOSED


def test_a_closed_curve_that_was_lost_one_way_is_closed() -> None:
    ways = 0

    def torn(x, p):  # On the first way there is no map where q > 0.9.
        if ways == 1 and p[1] > 0.9:
            raise ArithmeticError("no map")
        return ring(x, p)

    class Counted(TextbookMap):
        """Counts the started ways by their parameters."""

        def evaluate_each(self, states, values, firsts, cycles):
            nonlocal ways
            begins = np.allclose(values, (result.value, 0.3), rtol=0.0, atol=1e-12)
            ways += begins and not self.beginning
            self.beginning = begins
            return super().evaluate_each(states, values, firsts, cycles)

        beginning = False

    span = ParameterRange(-2.0, 2.0)
    result = of_kind(branch_of(at_second(torn, 0.3), 1, -2.0, 2.0, 0.0, [-0.9]), "fold")
    curve = bifurcation_curve(result, Counted(torn, 1), (span, span), 0.3)
    assert ways == 2
    assert {end.reason for end in curve.ended} == {StopReason.CLOSED}
    assert (curve.values[0], curve.second[0]) == (curve.values[-1], curve.second[-1])


def test_after_a_refused_step_the_tangent_says_where_a_curve_goes_on() -> None:
    # The points behind are 40 degrees of the circle apart, so the chord is 20 off.
    def point(degrees: float) -> Solution:
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        return solution_at(z := np.array([0.0, c, s]), equations.linearise(z), np.array([0.0, -s, c]))

    span = ParameterRange(0.0, 1.0)
    shooting = Shooting.single(TextbookMap(ring, 1), 1, span, span)
    equations = MinimallyAugmented("fold", shooting, np.array([0.0, 1.0, 0.0]))
    track = Continuation(CurvePoint(point(0.0), equations))
    track.length, track.before = 2.0, [point(-80.0), point(-40.0)]
    new = track.step()
    assert np.hypot(*new.z[1:]) == pytest.approx(1.0, abs=1e-8)
    assert new.z[2] > 0.0


def test_a_curve_stops_after_as_many_points_as_are_allowed() -> None:
    curve, _ = curve_of(henon, 2, "fold", (0.1, 0.3), [0.1, 0.1], settings=Settings(max_points=3))
    assert {end.reason for end in curve.ended} == {StopReason.POINTS}


def test_a_curve_goes_on_where_its_orbits_are_cut_anew() -> None:
    # Period two has x + y = 1 - b and x y = (1 - b)^2 - a; its derivative has the trace 4 x y + 2 b and the
    # determinant b^2, so it doubles at a = (1 - b)^2 + (1 + b)^2/4.
    settings = Settings(growth=2.2)
    curve, of = curve_of(henon, 2, "period_doubling", (0.6, 0.3), [0.83, -0.13], settings=settings, period=2)
    assert curve.values == pytest.approx([(1.0 - b) ** 2 + 0.25 * (1.0 + b) ** 2 for b in curve.second], abs=1e-7)
    assert {end.reason for end in curve.ended} == {StopReason.RANGE}
    assert (min(curve.second) < -1.1, max(curve.second)) == (True, pytest.approx(1.5))
    # Both cycles are one segment at first, and two where a disturbance grows to twice what is allowed over one.
    result = of_kind(branch_of(at_second(henon, 0.3), 2, P.low, P.high, 0.6, [0.83, -0.13], 2), "period_doubling")
    whole = Shooting.single(of, 2, P, Q, settings=settings)
    start = whole.unknowns(result.point.orbit.nodes, (result.value, 0.3))
    equations = MinimallyAugmented("period_doubling", whole, start)
    for forward in (True, False):
        points = followed(equations, forward).points
        cuts = [point.equations.shooting.segments for point in points]
        assert (cuts[0], cuts[-1]) == ((2,), (1, 1))
        grown = [float(np.abs(point.solution.linearised.blocks).max()) for point, cut in zip(points, cuts)
                 if cut == (2,)]
        assert 3.5 < max(grown) < 5.0
