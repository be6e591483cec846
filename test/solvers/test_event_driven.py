"""The exact engine's events: at the times of closed forms, close together, and in the limit of sharp smoothing."""

import math

import numpy as np
import pytest
from piecewise import Piecewise
from scipy.optimize import brentq

from tcc_sim.model import pure_slip
from tcc_sim.model.parameters import System, replace
from tcc_sim.polynomials.polynomial import variation
from tcc_sim.solvers import solve
from tcc_sim.solvers.event_driven.step import monotone
from tcc_sim.solvers.series import COLUMNS, ROWS, SLIP

BASE = replace(System(), {"friction.law": "set_valued", "friction.kinetic_coefficient": 0.3, "pressure.mean": 225e3,
                          "pressure.amplitude": 0.0, "engine.frequency": 150.0, "initial.slip_speed": 10.0})


def system_of(values=None, **keys):
    return replace(BASE, {**(values or {}), **keys})


def test_run_down_stops_when_the_closed_form_says():
    system = system_of(**{"engine.mean_torque": 100.0, "engine.torque_amplitude": 0.0, "initial.slip_speed": 30.0})
    exact = pure_slip.pure_slip(system)
    stop = brentq(lambda t: float(exact.slip_speed(t)), 1e-3, 0.05, xtol=1e-16)
    assert np.all(exact.slip_speed(np.linspace(0.0, stop - 1e-9, 10_000)) > 0.0)
    run = solve(system, duration=0.06)
    assert run.transitions.time[0] == pytest.approx(stop, abs=1e-14)
    assert (run.transitions.before[0], run.transitions.after[0]) == (1, 0)


def test_breakaway_happens_when_the_stuck_oscillator_says():
    system = system_of(**{"engine.torque_amplitude": 400.0, "engine.frequency": 20.0, "initial.slip_speed": 0.0,
                          "driveline.damping": 0.0})
    d, both = system.driveline, 0.22
    own, w = math.sqrt(d.stiffness / both), 20.0
    gain = 400.0 / (d.stiffness - both * w**2)

    def margin(t):
        angle = 0.1 * (1 - math.cos(own * t)) + gain * (math.sin(w * t) - w / own * math.sin(own * t))
        torque = 300.0 + 400.0 * math.sin(w * t)
        return 540.0 - (0.02 * torque + 0.2 * d.stiffness * angle) / both

    grid = np.linspace(0.0, 0.1, 100_001)
    k = int(np.argmax(np.array([margin(t) for t in grid]) < 0.0))
    run = solve(system, duration=0.1)
    assert run.transitions.time[0] == pytest.approx(brentq(margin, grid[k - 1], grid[k], xtol=1e-16), abs=1e-13)
    assert (run.transitions.before[0], run.transitions.after[0]) == (0, 1)


def test_two_events_close_together_are_both_found():
    """Slip that dips below zero for an instant between two coarse cells: the dip's depth is set through the mean
    torque.
    """
    base = {"engine.mean_torque": 0.0, "engine.torque_amplitude": 900.0, "initial.slip_speed": 0.0,
            "engine.frequency": 40.0}
    for amplitude in np.linspace(545.0, 556.0, 3):
        system = system_of(base, **{"engine.torque_amplitude": float(amplitude), "driveline.stiffness": 1e6})
        run = solve(system, cycles=2)
        _, changes, _ = Piecewise(system, rtol=1e-10, atol=1e-11).run(2 * system.cycle, np.empty(0), slices=30)
        assert len(run.transitions.time) == len(changes), amplitude


def test_the_smoothed_law_converges_to_it_as_one_over_sigma():
    system = system_of(**{"initial.slip_speed": 5.0})
    exact = solve(system, duration=0.1, samples_per_cycle=40)
    errors = []
    for sigma in (1e3, 1e4, 1e5):
        smoothed = replace(system, {"friction.law": "smoothed", "friction.smoothing": sigma})
        run = solve(smoothed, duration=0.1, samples_per_cycle=40, solver="lsoda", rtol=1e-10)
        errors.append(np.abs(run.slip_speed - exact.slip_speed).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 7.0) & (ratios < 14.0)), ratios


def test_what_is_called_monotone_is():
    random, found = np.random.default_rng(2), 0
    for _ in range(300):
        rows = np.zeros((ROWS, COLUMNS))
        rows[SLIP, :9] = random.normal(size=9) * 0.5 ** np.arange(9)
        x = float(random.uniform(0.05, 1.5))
        if monotone(rows, 8, x, variation(rows, SLIP, 8, x)):
            found += 1
            rise = np.diff(np.polynomial.Polynomial(rows[SLIP, :9])(np.linspace(0.0, x, 500)))
            assert (rise > 0.0).all() or (rise < 0.0).all()
    assert 30 < found < 270
