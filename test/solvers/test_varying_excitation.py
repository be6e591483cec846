"""Solvers through profiles in time, against SciPy on separately written equations with the phase as a state."""

import itertools
import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import odeint

from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.study.benchmarks.references import coefficient_and_slope
from tcc_sim.sweeps.simulation import simulate

STICK_SLIP = replace(System(), {
    "friction.smoothing": 8.0, "friction.kinetic_coefficient": 0.25, "pressure.amplitude": 6e4,
    "pressure.frequency_ratio": 0.5, "pressure.phase": 0.4, "engine.harmonic_amplitudes": [40.0, 25.0],
    "engine.harmonic_phases": [0.3, -1.0], "initial.slip_speed": 10.0,
    "engine.frequency_times": [0.0, 0.0437, 0.11], "engine.frequency_values": [120.0, 260.0, 150.0],
    "engine.mean_torque_times": [0.0, 0.031, 0.0587], "engine.mean_torque_values": [300.0, 120.0, 280.0],
    "pressure.mean_times": [0.0, 0.0213, 0.0871], "pressure.mean_values": [180e3, 240e3, 200e3]})
"""Sticks and slips while all three profiles vary."""
SWELLING = replace(STICK_SLIP, {
    "engine.torque_amplitude_times": [0.0, 0.05, 0.12], "engine.torque_amplitude_values": [250.0, 100.0, 300.0],
    "engine.harmonic_amplitudes_times": [0.0, 0.0712], "engine.harmonic_amplitudes_values": [40.0, 25.0, 5.0, 60.0]})
"""The same while the amplitudes of all three harmonics vary too."""
SLIP = replace(STICK_SLIP, {"initial.slip_speed": 150.0, "engine.mean_torque_values": [300.0, 420.0, 380.0]})
"""Slips in one direction all the time, so that nothing but the profiles is not smooth."""
END = 0.13


@cache
def truth(system: System) -> np.ndarray:
    """Final slip speed, plate angle, plate speed and phase, by LSODA at 1e-13, restarted at every point: between two
    of them every profile is a line.
    """
    e, p, f, d = system.engine, system.pressure, system.friction, system.driveline
    pairs = [(f.static_coefficient / f.kinetic_coefficient - 1.0, f.decay)]
    per_pressure = f.kinetic_coefficient * system.clutch.area * system.clutch.radius
    profiles = [(e.frequency_times, e.frequency_values), (e.mean_torque_times, e.mean_torque_values),
                (p.mean_times, p.mean_values),
                (e.torque_amplitude_times or (0.0,), e.torque_amplitude_values or (e.torque_amplitude,)),
                *((e.harmonic_amplitudes_times or (0.0,), (e.harmonic_amplitudes_values or e.harmonic_amplitudes)[k::2])
                  for k in (0, 1))]
    points = sorted({0.0, END, *itertools.chain(*(times for times, _ in profiles))})
    y = np.array([system.initial.slip_speed, 0.0, 0.0, 0.0])
    for begin, end in itertools.pairwise(points):
        lines = [np.interp([begin, end], *profile).tolist() for profile in profiles]

        def rates(t, y, begin=begin, end=end, lines=lines):
            v, angle, speed, phase = map(float, y)
            share = (t - begin) / (end - begin)
            frequency, te, load, *amplitudes = [a + share * (b - a) for a, b in lines]
            for n, (a, shift) in enumerate(zip(amplitudes, (0.0, *e.harmonic_phases)), 1):
                te += a * math.sin(n * phase + shift)
            load += p.amplitude * math.sin(p.frequency_ratio * phase + p.phase)
            tf = coefficient_and_slope(v, pairs, f.smoothing)[0] * per_pressure * max(load, 0.0)
            plate = (tf - d.damping * speed - d.stiffness * angle) / d.plate_inertia
            return [(te - tf) / d.flywheel_inertia - plate, speed, plate, frequency]

        y = odeint(rates, y, [begin, end], tfirst=True, rtol=1e-13, atol=[1e-12, 1e-14, 1e-11, 1e-13], mxstep=9999)[-1]
    return y


def error(name, system, **setting):
    """Largest difference of a final state from the truth, relative to the size of the motion."""
    run = solve(system, solver=name, duration=END, **setting).raise_for_status()
    values = np.array([run.final.slip_speed, run.final.plate_angle, run.final.plate_speed])
    return float((np.abs(values - truth(system)[:3]) / [10.0, 0.1, 10.0]).max())


BY_ENGINES = [("smoothed", {"rtol": 1e-6}, 1e-7), ("smoothed", {"rtol": 1e-12}, 1e-10),
              ("fixed_step", {"step": 1e-5}, 5e-7)]
COMPARED = [("lsoda", {"rtol": 1e-10}, 1e-6), ("rk4", {"step": 5e-6}, 1e-5)]


@pytest.mark.parametrize(("system", "name", "setting", "allowed"), [
    *((STICK_SLIP, *row) for row in BY_ENGINES + COMPARED),
    *((SWELLING, *row) for row in BY_ENGINES)])
def test_final_states_through_all_profiles(system, name, setting, allowed):
    assert error(name, system, **setting) < allowed


def test_samples_have_the_torque_of_the_amplitudes_that_vary():
    run = solve(SWELLING, solver="smoothed", duration=END, samples_per_cycle=50)
    phase, e = SWELLING.cycles_until, SWELLING.engine
    for k in range(0, len(run.t), 17):
        t = float(run.t[k])
        angle = 2.0 * math.pi * phase(t)
        torque = np.interp(t, e.mean_torque_times, e.mean_torque_values) + np.interp(
            t, e.torque_amplitude_times, e.torque_amplitude_values) * math.sin(angle)
        for n, shift in ((2, 0.3), (3, -1.0)):
            torque += np.interp(t, e.harmonic_amplitudes_times, e.harmonic_amplitudes_values[n - 2::2]) * math.sin(
                n * angle + shift)
        assert run.engine_torque[k] == pytest.approx(torque, rel=1e-9)


def test_the_real_time_solver_keeps_its_order_through_corners():
    # Without steps that end at the corners the order would be two.
    errors = [error("fixed_step", SLIP, step=h) for h in (1e-4 / 7.0, 1e-4 / 14.0, 1e-4 / 28.0)]
    assert min(math.log2(a / b) for a, b in itertools.pairwise(errors)) > 2.8


def test_the_phase_is_that_of_the_independent_solution():
    assert STICK_SLIP.cycles_until(END) == pytest.approx(truth(STICK_SLIP)[3] / (2.0 * math.pi), abs=1e-9)


@pytest.mark.parametrize("slips", [False, True])
def test_cycles_and_samples_of_the_fast_engine_are_those_of_lsoda(slips):
    system = SLIP if slips else STICK_SLIP
    one, other = (solve(system, solver=name, duration=END, samples_per_cycle=16, rtol=rtol)
                  for name, rtol in (("smoothed", 1e-9), ("lsoda", 1e-10)))
    np.testing.assert_array_equal(one.t, other.t)
    np.testing.assert_allclose(one.slip_speed, other.slip_speed, atol=2e-6)
    np.testing.assert_allclose(one.engine_torque, other.engine_torque, rtol=1e-12)
    np.testing.assert_allclose(one.cycles.section, other.cycles.section, atol=2e-6)
    np.testing.assert_allclose(one.cycles.highest, other.cycles.highest, atol=1e-4)
    np.testing.assert_allclose(one.cycles.stick_time, other.cycles.stick_time, atol=2e-6)


def test_a_clamp_that_sets_in_and_ends_while_everything_varies():
    clamped = replace(STICK_SLIP, {"pressure.amplitude": 3e5, "pressure.frequency_ratio": 2.3, "pressure.mean_values":
                                   [0.0, 240e3, 100e3]})
    one, other = (solve(clamped, solver=name, duration=END, rtol=rtol).final
                  for name, rtol in (("smoothed", 1e-9), ("lsoda", 1e-9)))
    assert one.slip_speed == pytest.approx(other.slip_speed, abs=1e-4)
    assert one.plate_angle == pytest.approx(other.plate_angle, abs=1e-6)


def test_a_run_up_has_cycles_of_its_own_length_and_no_period():
    result = simulate("runup", duration=6.0)
    assert result.trajectory.t[-1] == 6.0
    assert result.summary.cycles == int(load_scene("runup").system.cycles_until(6.0))
    assert (result.summary.period, result.summary.discarded) == (0, 0)
    fixed = simulate("runup", solver="fixed_step", duration=6.0).summary
    assert result.summary.breakaways == fixed.breakaways > 50
    assert result.summary.clutch_energy == pytest.approx(fixed.clutch_energy, rel=1e-5)


def test_what_settles_after_the_last_point_has_a_period():
    result = simulate("apply", duration=3.0)
    assert (result.summary.period, result.summary.breakaways) == (1, 0)
    assert result.trajectory.final.slip_speed == pytest.approx(0.0, abs=0.05)
