"""Periodic orbits by Newton: deflation, multipliers against closed forms, periods."""

import math

import numpy as np
import pytest
from textbook_maps import TextbookMap, henon, logistic

from tcc_sim.errors import InputError
from tcc_sim.study.continuation.bracket import chandrupatla
from tcc_sim.study.continuation.newton import find_orbit, minimal_period, multipliers_of, newton, orbit_at
from tcc_sim.study.continuation.shooting import ParameterRange, Shooting, greedy


def orbit_of(shooting: Shooting, values: tuple[float, ...], guess: list[float], known=()):
    z = find_orbit(shooting, values, [np.array(guess)], known)
    return orbit_at(shooting, z, shooting.linearise(z))


def test_fixed_points_of_the_henon_map_and_their_multipliers() -> None:
    shooting = Shooting.single(TextbookMap(henon, 2), 1, ParameterRange(-1.0, 2.0))
    a, b = 1.4, 0.3
    for sign in (1.0, -1.0):
        x = 0.5 * (-(1.0 - b) + sign * math.sqrt((1.0 - b) ** 2 + 4.0 * a))
        result = orbit_of(shooting, (a,), [x + 0.1, x - 0.1])
        assert result.section == pytest.approx([x, x], abs=1e-12)
        expected = sorted((-x + s * math.sqrt(x * x + b) for s in (1.0, -1.0)), key=abs, reverse=True)
        assert result.multipliers.real == pytest.approx(expected, abs=1e-10)
        assert not result.stable


def test_deflation_turns_newton_to_the_other_orbit() -> None:
    shooting = Shooting.single(TextbookMap(henon, 2), 1, ParameterRange(-1.0, 2.0))
    first = orbit_of(shooting, (1.4,), [0.8, 0.8])
    other = orbit_of(shooting, (1.4,), [0.8, 0.8], [first.section])
    assert first.section[0] + other.section[0] == pytest.approx(-0.7, abs=1e-10)
    both = [shooting.unknowns(x.section[None], (1.4,)) for x in (first, other)]
    assert newton(shooting, shooting.unknowns(np.array([[0.3, 0.2]]), (1.4,)), both) is None


def test_an_orbit_of_a_shorter_period_is_passed_over() -> None:
    map_ = TextbookMap(logistic, 1)
    r = 3.3
    result = orbit_of(Shooting.single(map_, 2, ParameterRange(0.5, 4.0)), (r,), [1.0 - 1.0 / r + 1e-3])
    root = math.sqrt((r + 1.0) * (r - 3.0))
    assert sorted([result.section[0], map_.evaluate(result.section, (r,), 0, 1).value[0]]) == pytest.approx(
        [(r + 1.0 - root) / (2.0 * r), (r + 1.0 + root) / (2.0 * r)], abs=1e-11)
    assert result.multipliers[0].real == pytest.approx(4.0 + 2.0 * r - r * r, abs=1e-9)
    assert minimal_period(map_, result.section, (r,), 4) == 2


def test_segments_of_one_cycle_give_the_same_orbit() -> None:
    map_ = TextbookMap(logistic, 1)
    whole = Shooting.single(map_, 4, ParameterRange(0.5, 4.0))
    z = find_orbit(whole, (3.52,), [np.array([0.37])])
    values = (3.52,)
    nodes = [map_.evaluate(whole.nodes(z)[0], values, 0, k).value for k in range(4)]
    parts = Shooting(map_, 4, whole.ranges, (1, 1, 1, 1))
    fine = parts.unknowns(np.array(nodes), values)
    linearised = parts.linearise(fine)
    assert np.abs(linearised.residual).max() < 1e-12
    expected = multipliers_of(*whole.linearise(z).blocks)[0]
    assert multipliers_of(*linearised.blocks)[0] == pytest.approx(expected, abs=1e-10)
    again = newton(parts, fine + np.array([1e-3, 0.0, -1e-3, 0.0, 0.0]))
    assert again == pytest.approx(fine, abs=1e-10)


@pytest.mark.parametrize(("grown", "lengths", "nodes"), [
    ([2.0] * 5, [2.0, 2.0, 1.0], [0, 2, 4]), ([1.0] * 5, [5.0], [0]), ([0.1, 40.0, 0.1], [1.0, 2.0], [0, 1]),
    ([0.5, 0.5, 4.0, 4.0], [3.0, 1.0], [0, 3]), ([9.0], [1.0], [0])])
def test_segments_are_as_long_as_their_growth_allows(grown: list[float], lengths: list[float],
                                                     nodes: list[int]) -> None:
    """Up to 5 from any of their pieces to their end; a single piece may have more."""
    result = greedy([(1.0, np.array([float(k)]), np.array([[x]])) for k, x in enumerate(grown)], 5.0)
    assert result[0] == lengths
    assert [int(node[0]) for node in result[1]] == nodes


def test_a_period_that_does_not_fit_the_excitation_is_refused() -> None:
    map_ = TextbookMap(logistic, 1)
    map_.forcing_period = 2
    with pytest.raises(InputError, match="multiple of 2"):
        Shooting.single(map_, 3, ParameterRange(0.5, 4.0))


def test_the_bracketing_root_of_a_noisy_function_is_not_looked_for_in_its_noise() -> None:
    calls = []

    def noisy(x: float) -> float:
        calls.append(x)
        return math.cos(x) - x + 1e-9 * math.sin(1e15 * x)

    assert chandrupatla(noisy, 0.0, 1.0) == pytest.approx(0.7390851332151607, abs=1e-9)
    assert len(calls) <= 10


def test_a_motion_that_runs_away_is_no_orbit_however_short_newtons_step_is() -> None:
    def drifting(x, p):  # x grows by 0.1 in every cycle: the Jacobian of its equations is singular, the step none.
        return np.array([x[0] + 0.1, 0.5 * x[1]]), np.diag([1.0, 0.5]), np.zeros((2, 1))

    shooting = Shooting.single(TextbookMap(drifting, 2), 1, ParameterRange(0.0, 1.0))
    assert newton(shooting, shooting.unknowns(np.array([[3.0, 0.0]]), (0.5,))) is None
