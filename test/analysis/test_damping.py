"""Equivalent damping (21) of a prescribed motion, against SciPy's adaptive quadrature."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.damping import damping_as_json, damping_of_cycles, equivalent_damping
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.trajectory import Cycles, Trajectory

CYCLE = 2.0 * math.pi / 150.0


def slip(t):
    return 1.5 + 1.4 * np.sin(150.0 * t + 0.7)


def load(t):
    return 300.0 + 100.0 * np.sin(75.0 * t + 0.2)


def trajectory_of(system, count=40, samples=2000, v=slip):
    t = np.arange(count * samples + 1) * (CYCLE / samples)
    zero = np.zeros_like(t)
    return Trajectory(t, v(t), zero, zero, zero, load(t), zero, np.zeros(len(t), np.int8), CYCLE, "by_hand", system)


def test_both_averages_agree_with_quadrature():
    from scipy.integrate import quad

    system = replace(System(), {"friction.kinetic_coefficient": 0.2, "pressure.amplitude": 0.0, "pressure.mean": 225e3})

    def slope(t):
        """(20a), (20b) written out, with mu_s/mu_k - 1 = 0.5, alpha = 2, sigma = 50."""
        v = float(slip(t))
        e = 0.5 * math.exp(-2.0 * abs(v))
        th = math.tanh(50.0 * v)
        return float(load(t)) * (50.0 * (1.0 + e) * (1.0 - th * th) - 2.0 * e * math.copysign(1.0, v) * th)

    def integral(f):
        return quad(f, 0.0, 2.0 * CYCLE, epsabs=1e-12, epsrel=1e-11, limit=2000)[0]

    weighted = integral(lambda t: slope(t) * float(slip(t)) ** 2) / integral(lambda t: float(slip(t)) ** 2)
    negative = integral(lambda t: min(slope(t), 0.0)) / (2.0 * CYCLE)
    found = equivalent_damping(trajectory_of(system), 20)
    assert found.weighted == pytest.approx(weighted, rel=1e-5)
    assert found.negative_mean == pytest.approx(negative, rel=1e-5)
    assert found.threshold == -0.6


def test_the_set_valued_law_has_its_sliding_slope_and_nothing_in_stick():
    values = {"friction.kinetic_coefficient": 0.2, "friction.law": "set_valued"}
    found = equivalent_damping(trajectory_of(replace(System(), values), v=lambda t: 0.0 * t), 0)
    assert math.isnan(found.weighted)
    assert found.negative_mean == 0.0
    sliding = equivalent_damping(trajectory_of(replace(System(), values), v=lambda t: 1.0 + 0.0 * t), 0)
    assert sliding.weighted == pytest.approx(-300.0 * 2.0 * 0.5 * math.exp(-2.0), rel=1e-6)
    assert sliding.negative_mean == pytest.approx(sliding.weighted)


def test_equal_coefficients_have_no_negative_slope():
    assert equivalent_damping(trajectory_of(replace(System(), {"friction.kinetic_coefficient": 0.3})),
                              20).negative_mean == 0.0


def test_too_few_samples_are_refused():
    with pytest.raises(InputError, match="leaves fewer than 4"):
        equivalent_damping(trajectory_of(System(), count=3), 3)


def test_cycles_solved_from_their_section_agree_with_quadratures_along_scipys_solution():
    from scipy.integrate import solve_ivp

    system = replace(System(),
                     {"friction.kinetic_coefficient": 0.24, "pressure.mean": 260e3, "pressure.amplitude": 52e3,
                                "pressure.frequency_ratio": 0.5, "pressure.phase": 0.3})
    cycle = system.cycle
    begin = np.array([5.0, 0.1, -5.0])

    def rates(t, y):
        """(2a), (2b) and (20b) written out, with the three integrals as states."""
        v, angle, speed = y[:3]
        load = 0.24 * 0.08 * 0.1 * (260e3 + 52e3 * math.sin(75.0 * t + 0.3))
        e, th = 0.25 * math.exp(-2.0 * abs(v)), math.tanh(50.0 * v)
        torque, back = load * (1.0 + e) * th, 0.6 * speed + 3000.0 * angle
        plate = (torque - back) / 0.02
        slope = load * (50.0 * (1.0 + e) * (1.0 - th * th) - 2.0 * e * math.copysign(1.0, v) * th)
        return [(300.0 + 250.0 * math.sin(150.0 * t) - torque) / 0.2 - plate, speed, plate, slope * v * v, v * v,
                min(slope, 0.0)]

    section, totals = [], []
    for n in (7, 8):
        run = solve_ivp(rates, (n * cycle, (n + 1) * cycle), [*begin, 0.0, 0.0, 0.0], method="LSODA", rtol=1e-10,
                        atol=1e-10)
        section.append(begin)
        totals.append(run.y[3:, -1])
        begin = run.y[:3, -1]
    missing = [math.nan] * 3
    cycles = Cycles(np.array([missing, *section, begin]), np.array([math.nan, 1.0, 1.0]), np.zeros(3), np.zeros(3))
    weighted, energy, negative = np.sum(totals, axis=0)
    found = damping_of_cycles(system, cycles, 6, 1)
    assert found.weighted == pytest.approx(weighted / energy, rel=1e-3)
    assert found.negative_mean == pytest.approx(negative / (2.0 * cycle), rel=1e-2)
    assert damping_as_json(found) == {"equivalent_damping": found.weighted, "negative_slope_mean": found.negative_mean}


def test_no_cycle_gives_no_damping():
    none = Cycles(np.zeros((1, 3)), np.zeros(0), np.zeros(0), np.zeros(0))
    assert damping_as_json(damping_of_cycles(System(), none, 0, 0)) == {"equivalent_damping": None,
                                                                        "negative_slope_mean": None}
