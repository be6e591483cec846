"""Special points of a map whose derivatives are known to some digits only: resolved ones alone are listed."""

import math

import numpy as np
import pytest
from test_codim2 import curve_of, quintic
from textbook_maps import henon

from tcc_sim.continuation import curves
from tcc_sim.continuation.codim2_points import measured
from tcc_sim.continuation.settings import Settings
from tcc_sim.continuation.shooting import ParameterRange


def with_noise(size: float):
    """`quintic` with a derivative that is off by up to `size`, differently at every state."""
    def noisy(x, p):
        value, by_state, by_parameters = quintic(x, p)
        return value, by_state + size * math.sin(1e15 * (x[0] + 0.1 * p[1])), by_parameters

    return noisy


SPAN = ParameterRange(-0.5, 0.5)


@pytest.mark.parametrize("size", [1e-14, 1e-12, 1e-10])
@pytest.mark.parametrize("second", [0.6, -0.7, 0.05])
def test_a_special_point_lies_within_its_error_wherever_the_curve_begins(size: float, second: float) -> None:
    curve, _ = curve_of(with_noise(size), 1, "period_doubling", (-0.2, second), [0.0], first=SPAN)
    (found,) = curve.special
    assert (found.kind, found.located) == ("generalised_doubling", True)
    assert abs(found.second) <= found.second_error < 1e6 * size + 1e-7


def test_a_test_function_that_is_all_noise_lists_no_special_point() -> None:
    """A cubic coefficient that is 1e-9 of the bend of the map, with either sign."""
    def flat(x, p):
        value, by_state, by_parameters = with_noise(1e-10)(x, (p[0], 1e-9 * p[1]))
        return value, by_state, by_parameters * np.array([1.0, 1e-9])

    curve, _ = curve_of(flat, 1, "period_doubling", (-0.2, 0.6), [0.0], first=SPAN)
    assert len(curve.values) > 20
    assert curve.special == ()


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("second", [0.6, -0.7])
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
    (found,) = curve.special
    assert (found.kind, found.located) == ("resonance_1_2", False)
    assert abs(found.value - 1.0) <= found.error < 0.5
    assert abs(found.second - 1.0) <= found.second_error < 0.5
