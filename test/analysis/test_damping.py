"""Equivalent damping (21) and the mean of the negative slope, against quadratures along independent solutions."""

import math
from dataclasses import replace as with_field

import numpy as np
import pytest
from independent import Piecewise, equations
from scipy.integrate import solve_ivp

from tcc_sim.analysis.steady.damping import damping_of_cycles, slope_of_friction
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.study.benchmarks.references import coefficient_and_slope
from tcc_sim.trajectory import Cycles

LOADED = {"friction.kinetic_coefficient": 0.24, "pressure.mean": 260e3, "pressure.amplitude": 52e3,
          "pressure.frequency_ratio": 0.5, "pressure.phase": 0.3}


class Integrated(Piecewise):
    """The set-valued solution by located events, with the three integrals as further states."""

    def rates(self, t, y, mode):
        v = abs(y[0])
        slope = 0.0 if mode == 0 else -self.load(t) * 2.0 * (self.ratio - 1.0) * math.exp(-2.0 * v)
        return [*super().rates(t, y[:4], mode), slope * v * v, v * v, slope]

    def arc(self, t, end, y, *rest):
        run = super().arc(t, end, y if len(y) == 7 else np.append(y, np.zeros(3)), *rest)
        self.integrals = run.y[4:, -1]
        return run


@pytest.mark.parametrize("values", [
    {"initial.slip_speed": 5.0, "initial.plate_angle": 0.1}, {"initial.slip_speed": 30.0, "pressure.amplitude": 0.0},
    {"initial.slip_speed": 0.0, "friction.kinetic_coefficient": 0.1, "initial.plate_angle": 0.1},
    {"initial.slip_speed": 2.0, "pressure.amplitude": 390e3, "pressure.frequency_ratio": 2.0,
     "initial.plate_angle": 0.1}])
def test_the_set_valued_averages_agree_with_quadrature_on_located_arcs(values):
    system = replace(System(), {**LOADED, "friction.law": "set_valued", **values})
    truth, end = Integrated(system, rtol=1e-11, atol=1e-12), 2.0 * system.cycle
    _, changes, _ = truth.run(end, np.empty(0), slices=20)
    assert len(changes) > 2
    weighted, energy, negative = truth.integrals
    damping = damping_of_cycles(system, solve(system, cycles=2).cycles, 0, 1)
    assert damping.weighted == pytest.approx(weighted / energy, rel=1e-6)
    assert damping.negative_mean == pytest.approx(negative / end, rel=1e-6)
    assert damping.threshold == -0.6


@pytest.mark.parametrize(("smoothing", "tolerance"), [(50.0, 1e-8), (2000.0, 1e-8)])
def test_the_smoothed_averages_agree_with_quadratures_along_scipys_solution(smoothing, tolerance):
    system = replace(System(), {**LOADED, "friction.smoothing": smoothing})
    cycle = system.cycle
    begin = np.array([5.0, 0.1, -5.0])

    motion, _ = equations(system)

    def rates(t, y):
        """The motion with the three integrals of (20b) as further states."""
        load = 0.24 * 0.08 * 0.1 * (260e3 + 52e3 * math.sin(75.0 * t + 0.3))
        v, slope = y[0], load * coefficient_and_slope(y[0], [(0.25, 2.0)], smoothing)[1]
        return [*motion(t, [*y[:3], 0.0])[:3], slope * v * v, v * v, min(slope, 0.0)]

    section, totals = [], []
    for n in (7, 8):
        run = solve_ivp(rates, (n * cycle, (n + 1) * cycle), [*begin, 0.0, 0.0, 0.0], method="LSODA", rtol=1e-12,
                        atol=1e-13)
        section.append(begin)
        totals.append(run.y[3:, -1])
        begin = run.y[:3, -1]
    missing = [math.nan] * 3
    cycles = Cycles(np.array([missing, *section, begin]), np.array([math.nan, 1.0, 1.0]), np.zeros(3), np.zeros(3))
    weighted, energy, negative = np.sum(totals, axis=0)
    damping = damping_of_cycles(system, cycles, 6, 1)
    assert damping.weighted == pytest.approx(weighted / energy, rel=tolerance)
    assert damping.negative_mean == pytest.approx(negative / (2.0 * cycle), rel=tolerance)
    assert damping.as_json() == {"equivalent_damping": damping.weighted, "negative_slope_mean": damping.negative_mean}


def test_pure_stick_has_no_weighted_average_with_the_set_valued_law():
    system = replace(System(), {"friction.law": "set_valued", "engine.torque_amplitude": 0.0,
                                "initial.slip_speed": 0.0, "initial.plate_angle": 0.1})
    damping = damping_of_cycles(system, solve(system, cycles=2).cycles, 0, 1)
    assert math.isnan(damping.weighted)
    assert damping.negative_mean == 0.0


def test_the_slope_at_the_samples_is_that_of_20b_and_0_where_the_set_valued_law_has_none():
    system = replace(System(), {"friction.kinetic_coefficient": 0.2, "pressure.amplitude": 0.0, "pressure.mean": 225e3})
    run = solve(system, cycles=1, samples_per_cycle=100)
    v, step = run.slip_speed, 1e-7

    def law(v):
        return 360.0 * (1.0 + 0.5 * np.exp(-2.0 * np.abs(v))) * np.tanh(50.0 * v)

    assert slope_of_friction(run) == pytest.approx((law(v + step) - law(v - step)) / (2.0 * step), rel=1e-5, abs=1e-5)
    stuck = solve(replace(system, {"friction.law": "set_valued", "initial.slip_speed": 0.0}), cycles=1,
                  samples_per_cycle=100)
    slope = slope_of_friction(stuck)
    assert (slope[stuck.slip_speed == 0.0] == 0.0).all()
    assert slope == pytest.approx(np.where(stuck.slip_speed == 0.0, 0.0,
                                           -360.0 * np.exp(-2.0 * np.abs(stuck.slip_speed))))
    with pytest.raises(InputError, match="system"):
        slope_of_friction(with_field(run, system=None))
