"""The exact engine against closed forms, hand-solved events and an independent event-to-event solution with SciPy."""

import math

import numpy as np
import pytest
from piecewise import Piecewise
from scipy.optimize import brentq

from tcc_sim.model import closed_form
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import Status, solve

BASE = replace(System(), {"friction.law": "set_valued", "friction.kinetic_coefficient": 0.3, "pressure.mean": 225e3,
                          "pressure.amplitude": 0.0, "engine.frequency": 150.0, "initial.slip_speed": 10.0})
CASES = {
    "stick-slip": {},
    "low frequency from rest": {"engine.frequency": 60.0, "initial.slip_speed": 0.0},
    "pressure at 3/2": {"pressure.amplitude": 100e3, "pressure.frequency_ratio": 1.5, "pressure.phase": 0.7},
    "three harmonics": {"engine.harmonic_amplitudes": (100.0, 50.0), "engine.harmonic_phases": (0.3, 1.0)},
    "reversals": {"engine.mean_torque": 0.0, "engine.torque_amplitude": 900.0},
    "clamped pressure": {"pressure.amplitude": 300e3},
    "heavy damping": {"driveline.damping": 40.0, "engine.torque_amplitude": 500.0},
    "critical damping": {"driveline.damping": 2.0 * math.sqrt(60.0), "engine.torque_amplitude": 500.0},
    "no damping": {"driveline.damping": 0.0},
    "r = 1.25": {"friction.kinetic_coefficient": 0.24},
    "r = 1.25, pressure": {"friction.kinetic_coefficient": 0.24, "pressure.mean": 260416.67,
                           "pressure.amplitude": 52083.3},
    "r = 2, reversals": {"friction.kinetic_coefficient": 0.15, "pressure.mean": 300e3, "engine.torque_amplitude": 700.0,
                         "engine.mean_torque": 0.0},
    "r = 1.5, clamped": {"friction.kinetic_coefficient": 0.2, "pressure.amplitude": 250e3, "engine.mean_torque": 100.0},
    "r = 1.5, constant law": {"friction.kinetic_coefficient": 0.2, "friction.decay": 0.0},
}


def system_of(values=None, **keys):
    return replace(BASE, {**(values or {}), **keys})


@pytest.mark.parametrize("name", CASES)
def test_agrees_with_scipy_from_event_to_event(name):
    system, cycles = system_of(CASES[name]), 5
    run = solve(system, cycles=cycles, samples_per_cycle=20, flywheel_angle=True).raise_for_status()
    states, changes, stuck = Piecewise(system).run(cycles * system.cycle, run.t, slices=20 * cycles)
    found = np.stack([run.slip_speed, run.plate_angle, run.plate_speed, run.flywheel_angle], axis=1)
    scale = np.abs(states).max(axis=0) + 1e-3
    np.testing.assert_array_less(np.abs(found - states).max(axis=0) / scale, 1e-10)
    np.testing.assert_array_less(np.abs(run.cycles.section - states[::20, :3]).max(axis=0) / scale[:3], 1e-10)
    assert [(b, a) for _, b, a in changes] == list(zip(run.transitions.before.tolist(), run.transitions.after.tolist()))
    np.testing.assert_allclose(run.transitions.time, [t for t, _, _ in changes], atol=1e-11)
    assert run.cycles.stick_time.sum() == pytest.approx(stuck, abs=1e-10)


@pytest.mark.parametrize("name", CASES)
def test_samples_cycles_and_torques_are_of_one_motion(name):
    system = system_of(CASES[name])
    run = solve(system, cycles=3, samples_per_cycle=3000).raise_for_status()
    d = system.driveline
    slipping = run.state != 0
    np.testing.assert_array_equal(run.slip_speed[~slipping & (run.saturation_torque > 0)], 0.0)
    limit = system.friction_ratio * run.saturation_torque
    assert np.all(np.abs(run.friction_torque) <= limit + 1e-9)
    law = run.saturation_torque * (1 + (system.friction_ratio - 1)
                                   * np.exp(-system.friction.decay * np.abs(run.slip_speed)))
    moving = slipping & (run.saturation_torque > 0)
    np.testing.assert_allclose(run.friction_torque[moving], (np.sign(run.state) * law)[moving], atol=1e-9)
    plate = np.gradient(run.plate_speed, run.t)
    balance = (d.plate_inertia * plate + d.damping * run.plate_speed + d.stiffness * run.plate_angle
               - run.friction_torque)
    calm = np.abs(np.gradient(run.friction_torque)) < 5.0
    assert np.median(np.abs(balance[calm])) < 0.05
    for n in range(3):
        part = run.slip_speed[3000 * n:3000 * n + 3001]
        step = np.abs(np.diff(part)).max()
        assert part.max() <= run.cycles.highest[n] + 1e-12 <= part.max() + step + 1e-12
        assert part.min() >= run.cycles.lowest[n] - 1e-12 >= part.min() - step - 1e-12


def test_pure_stick_closed_form():
    system = system_of(**{"engine.torque_amplitude": 100.0, "engine.frequency": 60.0, "pressure.mean": 300e3,
                          "initial.slip_speed": 0.0})
    run = solve(system, cycles=400, samples_per_cycle=12)
    angle = closed_form.plate_angle(system)
    late = slice(390 * 12, None)
    assert closed_form.stick_margin(system).sticks
    np.testing.assert_array_equal(run.state, 0)
    np.testing.assert_allclose(run.plate_angle[late], angle(run.t[late]), atol=1e-13)
    np.testing.assert_allclose(run.plate_speed[late], angle.rate()(run.t[late]), atol=1e-11)
    np.testing.assert_allclose(run.friction_torque[late], closed_form.interface_torque(system)(run.t[late]), atol=1e-9)
    np.testing.assert_allclose(run.cycles.stick_time, system.cycle, rtol=1e-12)
    assert np.all(run.cycles.highest == 0.0)


@pytest.mark.parametrize("damping", [0.0, 0.6, 2.0 * math.sqrt(60.0), 90.0])
def test_pure_slip_closed_form(damping):
    system = system_of(**{"initial.slip_speed": 150.0, "pressure.mean": 100e3, "pressure.amplitude": 60e3,
                          "pressure.phase": 0.4,
                          "pressure.frequency_ratio": 0.75, "driveline.damping": damping, "initial.plate_speed": 3.0})
    run = solve(system, cycles=12, samples_per_cycle=50)
    exact = closed_form.pure_slip(system)
    np.testing.assert_array_equal(run.state, 1)
    np.testing.assert_allclose(run.slip_speed, exact.slip_speed(run.t), rtol=1e-12)
    np.testing.assert_allclose(run.plate_angle, exact.plate_angle(run.t), atol=1e-12)
    np.testing.assert_allclose(run.plate_speed, exact.plate_speed(run.t), atol=1e-10)
    fine = np.linspace(0.0, system.cycle, 200_001)
    assert run.cycles.highest[0] == pytest.approx(exact.slip_speed(fine).max(), abs=1e-6)
    assert run.cycles.lowest[0] == pytest.approx(exact.slip_speed(fine).min(), abs=1e-6)


def test_run_down_stops_when_the_closed_form_says():
    system = system_of(**{"engine.mean_torque": 100.0, "engine.torque_amplitude": 0.0, "initial.slip_speed": 30.0})
    exact = closed_form.pure_slip(system)
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
    for amplitude in np.linspace(545.0, 556.0, 5):
        system = system_of(base, **{"engine.torque_amplitude": float(amplitude), "driveline.stiffness": 1e6})
        run = solve(system, cycles=2)
        _, changes, _ = Piecewise(system).run(2 * system.cycle, np.array([0.0]), slices=120)
        assert len(run.transitions.time) == len(changes), amplitude


def test_half_a_cycle_later_the_odd_system_is_mirrored():
    system = system_of(**{"engine.mean_torque": 0.0, "engine.torque_amplitude": 900.0})
    run = solve(system, cycles=500, samples_per_cycle=8)
    late = run.slip_speed[-9:]
    np.testing.assert_allclose(late[4:], -late[:5], atol=1e-8 * np.abs(late).max())


def test_a_start_many_cycles_later_is_the_same_motion():
    system = system_of(CASES["pressure at 3/2"])
    early, late = solve(system, cycles=6), solve(system, cycles=6, start_cycle=9_000_000)
    np.testing.assert_allclose(late.cycles.section, early.cycles.section, atol=1e-12)
    np.testing.assert_allclose(late.transitions.time - late.t[0], early.transitions.time, atol=1e-8)


def test_the_smoothed_law_converges_to_it_as_one_over_sigma():
    system = system_of(**{"initial.slip_speed": 5.0})
    exact = solve(system, duration=0.1, samples_per_cycle=40)
    errors = []
    for sigma in (1e3, 1e4, 1e5):
        smoothed = replace(system, {"friction.law": "smoothed", "friction.smoothing": sigma})
        run = solve(smoothed, duration=0.1, samples_per_cycle=40, solver="radau", rtol=1e-9)
        errors.append(np.abs(run.slip_speed - exact.slip_speed).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 7.0) & (ratios < 14.0)), ratios


def test_a_duration_ends_exactly_and_free_of_load_it_coasts():
    system = system_of(**{"pressure.mean": 0.0, "engine.torque_amplitude": 0.0, "engine.mean_torque": 40.0})
    run = solve(system, duration=0.05)
    assert run.t[-1] == 0.05
    assert run.slip_speed[-1] == pytest.approx(10.0 + 40.0 / 0.2 * 0.05, rel=1e-14)
    assert len(run.transitions.time) == 0
    assert run.friction_torque[-1] == 0.0
    assert run.status is Status.DONE
