"""Special points from points made by hand: extrapolated ends, changes of events, angles, digits and circles."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_continuation_parts import Scaled
from textbook_maps import TextbookMap

from tcc_sim.study.continuation import codim2_points
from tcc_sim.study.continuation.bracket import Bracket
from tcc_sim.study.continuation.branch import branch_through, first_point
from tcc_sim.study.continuation.codim2_points import (
    ENDING,
    AugmentedPoint,
    Special,
    change_of_events,
    midway,
    parameter_values,
    parameters,
    singular_end,
    special_point,
    values_of_tests,
    with_error,
)
from tcc_sim.study.continuation.diagram import SettledMotion, state_at_phase_0
from tcc_sim.study.continuation.palc import Solution
from tcc_sim.study.continuation.problem import Margin, Observation
from tcc_sim.study.continuation.settings import DEFAULTS, Settings
from tcc_sim.study.continuation.shooting import Linearised, ParameterRange, Shooting
from tcc_sim.study.continuation.special_points import _from_circle

EQUATIONS: Any = SimpleNamespace(size=1, unknowns=3, settings=Settings(), shooting=None, rounding=1e-9, kind="fold",
                                 ranges=(ParameterRange(0.0, 10.0, "p"), ParameterRange(100.0, 300.0, "q")))


def at(x: float, p: float, q: float, events: str = "", equations: Any = EQUATIONS) -> AugmentedPoint:
    """A point with unknown x and scaled parameters p and q."""
    seen = Linearised(np.zeros(1), np.zeros((1, 3)), seen=Observation(0.0, 0.0, events))
    return AugmentedPoint(Solution(np.array([x, p, q]), np.array([1.0, 0.0, 0.0]), seen, 1.0), equations)


def test_the_middle_between_two_points_has_half_of_their_distance_as_error() -> None:
    found = midway("cusp", at(0.0, 0.2, 0.8), at(1.0, 0.4, 0.4), False)
    assert (found.kind, found.located) == ("cusp", False)
    assert (found.value, found.second) == (pytest.approx(3.0), pytest.approx(220.0))
    assert (found.error, found.second_error) == (pytest.approx(1.0), pytest.approx(40.0))
    exact = midway("cusp", at(0.0, 0.2, 0.8), at(1.0, 0.2, 0.8), True)
    assert (exact.error, exact.second_error, exact.located) == (pytest.approx(1e-10), pytest.approx(2e-9), True)
    assert parameter_values(at(0.0, 0.25, 0.5)) == (2.5, 200.0)
    assert parameters(at(0.0, 0.25, 0.5), np.arange(5.0)).tolist() == [1.0, 2.0]
    assert special_point("cusp", at(0.0, 0.2, 0.8), at(1.0, 0.4, 0.4, equations=SimpleNamespace(**vars(EQUATIONS))),
                         lambda point, longer: 1.0).value == pytest.approx(3.0)


@pytest.mark.parametrize(("value", "error", "text"), [
    (1.23456789, 0.002, "1.2346 +- 0.002"), (1.23456789, 0.0149, "1.235 +- 0.01"), (12.5, 0.4, "12.50 +- 0.4"),
    (123.4, 30.0, "123 +- 3e+01"), (0.5, 3e-11, "0.500000000000 +- 3e-11"), (0.5, 1e-20, "0.500000000000 +- 1e-20")])
def test_a_number_has_the_digits_that_its_error_allows(value: float, error: float, text: str) -> None:
    assert with_error(value, error) == text


def test_a_special_point_in_words() -> None:
    for located, where in ((True, ""), (False, "  not located: its test changes sign in between")):
        found = Special("cusp", 0.25, 140.5, 0.002, 0.4, located, point=at(0.0, 0.0, 0.0))
        assert found.described("a", "engine.frequency") == (
            f"                  cusp  a 0.2500 +- 0.002  engine.frequency 140.50 +- 0.4 rad/s{where}")


@pytest.mark.parametrize(("law", "exact"), [(lambda d: 0.3 + 0.5 * d**2 - d**4, True), (lambda d: 0.3 + 0.5 * d, True),
                                            (lambda d: 0.3 + math.sin(d), False)])
def test_the_end_of_a_curve_is_extrapolated_through_its_last_four_points(law: Any, exact: bool) -> None:
    """An even function of the distance, or a cubic; points nearer than 0.05 do not count."""
    points = [at(d, law(d), 1.0 - law(d)) for d in (9.0, 0.4, 0.3, 0.2, 0.1)] + [at(0.01, 0.9, 0.9)]
    found = singular_end("cusp", points, lambda s: float(s.solution.z[0]))
    assert found is not None
    assert found.located
    assert abs(found.value - 3.0) <= found.error
    assert abs(found.second - 240.0) <= found.second_error
    assert found.error < (1e-7 if exact else 0.1)
    assert found.error >= 3e-8


def test_an_end_without_four_points_is_none_or_the_middle_to_a_point_beyond() -> None:
    points = [at(d, d, d) for d in (0.3, 0.2, 0.1)]

    def distance(point: AugmentedPoint) -> float:
        return float(point.solution.z[0])

    assert singular_end("cusp", points, distance) is None
    near = [at(0.01 * d, 0.3 + 0.01 * d, 0.5) for d in (4.0, 3.0, 2.0, 1.0)]
    found = singular_end("cusp", near, distance)
    assert found is not None
    assert found.value == pytest.approx(3.0)
    others = at(-0.1, 0.2, 0.2, equations=SimpleNamespace(**vars(EQUATIONS)))
    beyond = singular_end("cusp", points, distance, others)
    assert beyond is not None
    assert (beyond.located, beyond.value) == (False, pytest.approx(1.5))


@pytest.mark.parametrize(("most", "parts"), [(24, 2.0**-25), (3, 1.0 / 16.0)])
def test_a_change_of_events_is_bisected(most: int, parts: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """At three tenths of the way, to half of the last bracket."""
    a, b = at(0.0, 0.2, 0.4, "+S"), at(1.0, 0.4, 0.8, "S+S-")
    asked: list[float] = []

    class Between:
        def __init__(self, one: Any, two: Any, by_amplitude: bool) -> None:
            assert (one, two, by_amplitude) == (a, b, False)

        def at(self, part: float) -> Any:
            asked.append(part)
            if len(asked) > most:
                return None
            return at(part, 0.2 + 0.2 * part, 0.4 + 0.4 * part, "S+" if part < 0.3 else "-S+S")

    def margins(shooting: Any, z: Any) -> dict[str, Margin]:
        assert len(z) == 3
        return {"stick": Margin(0.2, np.zeros(1)), "grazing": Margin(0.1, np.zeros(1))}

    monkeypatch.setattr(codim2_points, "Bracket", Between)
    monkeypatch.setattr(codim2_points, "nearest_margins", margins)
    found = change_of_events(a, b)
    assert (found.kind, found.located, len(asked)) == ("adding_sliding", True, min(most + 1, 24))
    assert abs(found.value - 2.6) <= found.error == pytest.approx(2.0 * parts, rel=1e-2)
    assert abs(found.second - 204.0) <= found.second_error == pytest.approx(80.0 * parts, rel=1e-2)


@pytest.mark.parametrize("angle", [0.3, 2.5])
def test_the_tests_of_a_neimark_sacker_curve_are_those_of_its_angle(angle: float) -> None:
    turning: Any = SimpleNamespace(turning=True)
    point = at(0.0, 0.5, angle, equations=turning)
    small = angle < math.pi / 2.0
    assert values_of_tests(point) == pytest.approx({
        "resonance_1_1": math.sin(angle) if small else 1.0, "resonance_1_2": 1.0 if small else math.sin(angle),
        "resonance_1_3": angle - 2.0 * math.pi / 3.0, "resonance_1_4": angle - math.pi / 2.0})
    assert ENDING["neimark_sacker", "resonance_1_1"](point) == angle
    assert ENDING["neimark_sacker", "resonance_1_2"](point) == pytest.approx(math.pi - angle)


@pytest.mark.parametrize(("multipliers", "distance"), [
    ([0.8 + 0.7j, 0.8 - 0.7j, 0.1], 0.13), ([0.6 + 0.7j, 0.6 - 0.7j, 0.1], 0.15), ([2.0, 0.5, 0.1], math.inf),
    ([-1.1, -0.9, 0.1], math.inf), ([0.3j, -0.3j, 1.0], 0.91),
    ([np.exp(0.5e-6j), np.exp(-0.5e-6j), 0.1], math.inf), ([np.exp(2e-6j), np.exp(-2e-6j), 0.1], 0.0),
    ([-np.exp(0.5e-6j), -np.exp(-0.5e-6j), 0.1], math.inf)])
def test_the_distance_of_a_complex_pair_from_the_unit_circle(multipliers: Any, distance: float) -> None:
    point: Any = SimpleNamespace(orbit=SimpleNamespace(multipliers=np.array(multipliers, complex)),
                                 shooting=SimpleNamespace(settings=Settings()))
    assert _from_circle(point) == pytest.approx(distance, abs=1e-12)


@pytest.fixture(scope="module")
def henons() -> Any:
    """Two neighbouring points of the branch of fixed points of the Henon map with the amplitude x^2."""
    of = Scaled()
    shooting = Shooting.single(of, 1, ParameterRange(-1.0, 1.5, name="p"))
    start = shooting.unknowns(np.array([[0.5 * (-0.7 + math.sqrt(0.49 + 0.4))] * 2]), (0.1,))
    branch = branch_through(first_point(shooting, start), both=False)
    return branch.points[3], branch.points[4]


@pytest.mark.parametrize("by_amplitude", [True, False])
def test_the_points_of_a_bracket_lie_on_the_branch_at_their_part_of_the_chord(henons: Any, by_amplitude: bool) -> None:
    a, b = henons
    bracket = Bracket(a, b, by_amplitude)
    assert (bracket.at(0.0), bracket.at(1.0)) == (a, b)
    assert Bracket(a, a).at(0.5) is a
    chord = b.solution.z - a.solution.z
    low, high = (float(point.orbit.section[0]) ** 2 / 10.0 for point in (a, b))
    for part in (0.25, 0.75, 0.5):
        point = bracket.at(part)
        x, p = float(point.orbit.section[0]), point.value
        assert p - x * x + 0.3 * x == pytest.approx(x, abs=1e-13)
        away = point.solution.z - a.solution.z - part * chord
        if by_amplitude:
            apart = x * x / 10.0 - low - part * (high - low)
            assert float(chord @ away) + (high - low) * apart == pytest.approx(0.0, abs=1e-13)
        else:
            assert np.linalg.norm(away) < 1e-3
        assert float(point.solution.tangent @ a.solution.tangent) > 0.9
        assert bracket.at(part) is point
    middle = 0.5 * (a.value + b.value)
    assert bracket.locate(lambda s: s.value - middle).value == pytest.approx(middle, abs=1e-13)
    assert bracket.locate(lambda s: 1.0) is None
    assert bracket.locate(lambda s: s.value - middle, lambda s: 1e-12) is a
    asked: list[float] = []
    found = bracket.locate(lambda s: s.value - middle, lambda s: asked.append(s.value) or abs(s.value - middle))
    assert abs(found.value - middle) <= 1e-11
    assert len(asked) >= 3


def test_a_point_turned_has_the_other_tangent_and_sign(henons: Any) -> None:
    a, _ = henons
    turned = a.turned()
    assert turned.solution.tangent.tolist() == (-a.solution.tangent).tolist()
    assert (turned.solution.sign, turned.turned().solution.sign) == (-a.solution.sign, a.solution.sign)
    assert a.moved(a.solution, False).by_amplitude is False
    assert a.moved(a.solution).by_amplitude is True
    assert a.slope == a.solution.tangent[2]


def test_a_motion_of_a_sweep_begins_at_the_next_phase_0() -> None:
    """With a load of period 3, the state at cycle 4 is mapped over two cycles."""
    of = TextbookMap(lambda x, p: (2.0 * x + p[0], np.array([[2.0]]), np.ones((1, 1))), 1)
    of.forcing_period = 3
    for cycle, at_phase_0 in ((0, 5.0), (3, 5.0), (4, 4.0 * 5.0 + 3.0 * 0.5), (5, 2.0 * 5.0 + 0.5)):
        assert state_at_phase_0(of, SettledMotion(0.5, np.array([5.0]), cycle, 1, 1.0)).tolist() == [at_phase_0]
    assert [SettledMotion(0.0, np.zeros(1), 0, n, 1.0).has_period(6, 2) for n in (0, 2, 3, 4, 6)] == [
        False, False, True, False, True]


def test_tolerances_and_bounds_are_those_of_their_page() -> None:
    """Settings that decide a result; those that only change the work are not on it."""
    for line in Path(__file__).with_name("settings.txt").read_text().splitlines():
        name, _, value = line.partition(" = ")
        assert repr(getattr(DEFAULTS, name)) == value, name
