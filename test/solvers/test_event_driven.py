"""The exact engine: events at the times of closed forms, edges, overdamped plates, and extreme ranges."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from independent import Piecewise
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tcc_sim.model import closed_forms
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import Status, solve

BASE = replace(System(), {"friction.law": "set_valued", "friction.kinetic_coefficient": 0.3, "pressure.mean": 225e3,
                          "pressure.amplitude": 0.0, "engine.frequency": 150.0, "initial.slip_speed": 10.0})


def system_of(values=None, **keys):
    return replace(BASE, {**(values or {}), **keys})


def test_run_down_stops_when_the_closed_form_says():
    system = system_of(**{"engine.mean_torque": 100.0, "engine.torque_amplitude": 0.0, "initial.slip_speed": 30.0})
    exact = closed_forms.pure_slip(system)
    stop = brentq(lambda t: float(exact.slip_speed(t)), 1e-3, 0.05, xtol=1e-16)
    assert np.all(exact.slip_speed(np.linspace(0.0, stop - 1e-9, 10_000)) > 0.0)
    run = solve(system, duration=0.06)
    assert run.transitions.time[0] == pytest.approx(stop, abs=1e-14)
    assert (run.transitions.before[0], run.transitions.after[0]) == (1, 0)


def test_breakaway_happens_when_the_stuck_oscillator_says():
    system = system_of(**{"engine.torque_amplitude": 400.0, "engine.frequency": 20.0, "initial.slip_speed": 0.0,
                          "driveline.damping": 0.0})
    d, both = system.driveline, 0.22
    frequency, w = math.sqrt(d.stiffness / both), 20.0
    gain = 400.0 / (d.stiffness - both * w**2)

    def margin(t):
        angle = 0.1 * (1 - math.cos(frequency * t)) + gain * (math.sin(w * t) - w / frequency * math.sin(frequency * t))
        torque = 300.0 + 400.0 * math.sin(w * t)
        return 540.0 - (0.02 * torque + 0.2 * d.stiffness * angle) / both

    grid = np.linspace(0.0, 0.1, 100_001)
    k = int(np.argmax(np.array([margin(t) for t in grid]) < 0.0))
    run = solve(system, duration=0.1)
    assert run.transitions.time[0] == pytest.approx(brentq(margin, grid[k - 1], grid[k], xtol=1e-16), abs=1e-13)
    assert (run.transitions.before[0], run.transitions.after[0]) == (0, 1)


THREE_HARMONICS = {"engine.harmonic_amplitudes": [100.0, 50.0, 80.0], "engine.harmonic_phases": [1.0, 2.0, 3.0]}


@pytest.mark.parametrize(("scene", "frequency", "keys"), [
    ("fig02", 60.0, {"friction.kinetic_coefficient": 0.3}), ("fig02", 120.0, THREE_HARMONICS),
    ("fig02", 120.0, {"friction.kinetic_coefficient": 0.4}), ("fig02", 60.0, {"friction.kinetic_coefficient": 0.15}),
    ("fresh_fluid", 120.0, {}), ("aged_fluid", 60.0, THREE_HARMONICS)],
    ids=["constant", "falling", "rising", "steep", "fresh_fluid", "aged_fluid"])
def test_modes_follow_one_another_alike_at_any_tolerance(scene, frequency, keys):
    """A breakaway counts once, also where the arc before it is good to the tolerance only."""
    system = load_scene(scene).with_values({"friction.law": "set_valued", "engine.mean_torque": 0.0,
                                            "engine.frequency": frequency, **keys}).system
    _, changes, _ = Piecewise(system, rtol=1e-11, atol=1e-12).run(8 * system.cycle, np.empty(0), slices=80)
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        run = solve(system, cycles=8, rtol=rtol, loads_from=0)
        found = list(zip(run.transitions.before.tolist(), run.transitions.after.tolist()))
        assert found == [change[1:] for change in changes], rtol
        assert run.cycles.loads.breakaways.sum() == sum(
            before == 0 for _, before, _ in changes)


FIG02 = replace(System(), {"friction.law": "set_valued"})


@pytest.mark.parametrize("phase", [0.3, 0.5 * math.pi, 2.0, 3.0, 3.5, 5.0])
def test_the_mode_at_the_start_is_that_of_the_load_there(phase):
    """With a mean pressure of 0 the clutch starts loaded where sin(phase) > 0."""
    system = replace(FIG02, {"pressure.mean": 0.0, "pressure.amplitude": 200e3, "pressure.phase": phase,
                             "initial.slip_speed": 10.0})
    run = solve(system, cycles=1)
    states, _, _ = Piecewise(system).run(system.cycle, run.t, slices=60)
    assert run.slip_speed[-1] == pytest.approx(states[-1, 0], abs=1e-8)
    load = max(system.saturation_amplitude * math.sin(phase), 0.0)
    law = 1.0 + (system.friction_ratio - 1.0) * math.exp(-20.0)
    assert run.friction_torque[0] == pytest.approx(law * load, abs=1e-9)


@pytest.mark.parametrize("phase", [0.0, math.pi])
def test_a_load_of_nothing_at_the_start_goes_by_where_it_is_going(phase):
    near = [replace(FIG02, {"pressure.mean": 0.0, "pressure.amplitude": 200e3, "pressure.phase": phase + shift,
                            "initial.slip_speed": 10.0}) for shift in (-1e-9, 0.0, 1e-9)]
    ends = [solve(system, cycles=1).slip_speed[-1] for system in near]
    np.testing.assert_allclose(ends, ends[1], atol=1e-6)


def test_a_run_that_ends_at_an_event_has_mode_and_torque_of_one_side():
    system = replace(FIG02, {"initial.slip_speed": 5.0})
    d = system.driveline
    marks = [0.027585877613337938, *solve(system, duration=0.2).transitions.time.tolist()]
    for mark in marks:
        for end in (np.nextafter(mark, 0.0), mark, np.nextafter(mark, 1.0)):
            run = solve(system, duration=float(end))
            spring = d.damping * run.plate_speed[-1] + d.stiffness * run.plate_angle[-1]
            held = (d.plate_inertia * run.engine_torque[-1] + d.flywheel_inertia * spring) / (0.2 + 0.02)
            slipping = system.friction_ratio * run.saturation_torque[-1] * np.sign(run.state[-1])
            assert abs(run.slip_speed[-1]) < 1e-9
            assert run.friction_torque[-1] == pytest.approx(held if run.state[-1] == 0 else slipping, abs=1e-6)


def overdamped(**keys):
    return replace(FIG02, {"driveline.damping": 9794.0, "driveline.plate_inertia": 0.0016,
                           **{k.replace("__", "."): v for k, v in keys.items()}})


def test_an_overdamped_plate_with_a_falling_coefficient():
    """Against SciPy's Radau on the slip equations, to where slip ends."""
    system = overdamped(initial__slip_speed=5.0)
    run = solve(system, cycles=2, samples_per_cycle=50).raise_for_status()
    model = Piecewise(system)
    stop = run.transitions.time[0]
    solution = solve_ivp(lambda t, y: model.rates(t, y, 1), (0.0, stop), [5.0, 0.0, 0.0, 0.0], method="Radau",
                         rtol=1e-11, atol=1e-13, dense_output=True)
    assert abs(solution.y[0, -1]) < 1e-7
    inside = run.t < stop
    np.testing.assert_allclose(run.slip_speed[inside], solution.sol(run.t[inside])[0], atol=1e-7)
    np.testing.assert_allclose(run.plate_angle[inside], solution.sol(run.t[inside])[1], atol=1e-9)


def test_a_damper_beyond_all_steps_ends_the_run_with_its_name():
    run = solve(overdamped(driveline__damping=1000.0, driveline__plate_inertia=1e-6), cycles=1)
    assert run.status is Status.STEP_LIMIT
    assert "driveline.damping" in run.detail
    assert "1e+09 1/s" in run.detail


def test_an_overdamped_plate_without_load_is_free_of_the_friction_law():
    """Under the clamp the flywheel's speed grows by Te t/I1, and the plate stops."""
    system = overdamped(driveline__damping=0.6, driveline__plate_inertia=1e-6, engine__mean_torque=-300.0,
                        engine__torque_amplitude=0.0, pressure__mean=0.0, pressure__amplitude=1e6,
                        pressure__phase=math.pi, initial__slip_speed=-5.0)
    run = solve(system, duration=0.2 * math.pi / (system.pressure.frequency_ratio * system.engine.frequency),
                samples_per_cycle=40)
    flywheel = run.slip_speed + run.plate_speed
    np.testing.assert_allclose(flywheel, -5.0 - 300.0 / system.driveline.flywheel_inertia * run.t, rtol=1e-9)


@pytest.mark.parametrize("scene", ["fig02", "minimal", "chaos"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_slip_that_ends_has_zero_for_its_extreme(scene: str, sign: float) -> None:
    """Between stick and slip of one sign the slip speed never turns round, not by a rounding either."""
    system = load_scene(scene).system
    system = replace(system, {"friction.law": "set_valued", "engine.mean_torque": sign * system.engine.mean_torque,
                              "initial.slip_speed": 0.0, "initial.plate_angle": sign * 0.1})
    if sign < 0.0:   # Half a cycle later the torque of one harmonic is the other's mirror image.
        system = replace(system, {"pressure.phase": system.pressure.phase + np.pi})
    cycles = solve(system, cycles=60).cycles
    kept = cycles[10:]
    least, most = (kept.lowest, kept.highest) if sign > 0.0 else (kept.highest, kept.lowest)
    assert np.all(least == 0.0)
    assert np.abs(most).max() > 10.0


RESONANCES = [math.sqrt(3000.0 / 0.22), math.sqrt(3000.0 / 0.02)]
EXTREMES = st.fixed_dictionaries({
    "friction.kinetic_coefficient": st.sampled_from([0.3, 0.3, 0.285, 0.24, 0.15, 0.075]),
    "friction.decay": st.sampled_from([0.0, 2.0, 1000.0]),
    "pressure.mean": st.sampled_from([0.0, 1e-3, 1e4, 225e3, 1e6, 1e7]),
    "engine.frequency": st.sampled_from([1.0, 10.0, 150.0, 1000.0, 5000.0, *RESONANCES]),
    "driveline.damping": st.sampled_from([0.0, 0.6, 2.0 * math.sqrt(60.0), 40.0]),
    "driveline.plate_inertia": st.sampled_from([0.02, 1e-4, 1e-6]),
    "initial.slip_speed": st.sampled_from([0.0, 1e-12, -5.0, 150.0, 1e4]),
    "engine.mean_torque": st.sampled_from([0.0, 300.0, -300.0]),
    "engine.torque_amplitude": st.sampled_from([0.0, 1e-9, 250.0, 1000.0]),
    "pressure.frequency_ratio": st.sampled_from([1.0, 0.5, 2.0 / 3.0, math.sqrt(2.0), 2.0]),
    "pressure.phase": st.sampled_from([0.0, math.pi / 2, math.pi, 1.0]),
})


@settings(max_examples=60, deadline=None, derandomize=True)
@given(EXTREMES, st.sampled_from([1e-9, 0.5, 0.999, 1.0, 1.0 + 1e-9, 1.5]))
def test_ends_finite_and_within_the_law(values, share):
    amplitude = min(share * max(values["pressure.mean"], 1e-6), 1e7)
    values = {**values, "friction.law": "set_valued", "pressure.amplitude": amplitude}
    system = replace(System(), values)
    run = solve(system, cycles=2, samples_per_cycle=16)
    assert run.status in (Status.DONE, Status.STEP_LIMIT)
    for values in (run.slip_speed, run.plate_angle, run.plate_speed, run.friction_torque, run.cycles.section,
                   run.cycles.highest):
        assert np.all(np.isfinite(values))
    limit = system.friction_ratio * run.saturation_torque
    assert np.all(np.abs(run.friction_torque) <= limit + 1e-9 * (1.0 + limit.max()))
    assert np.all(np.diff(run.transitions.time) >= 0.0)
    stuck = run.cycles.stick_time
    assert np.all((stuck >= 0.0) & (stuck <= system.cycle * (1 + 1e-12)))
    for n in range(len(run.cycles)):
        part = run.slip_speed[16 * n:16 * n + 17]
        rounding = 1e-9 * np.abs(part).max()
        assert run.cycles.lowest[n] - rounding <= part.min()
        assert part.max() <= run.cycles.highest[n] + rounding


@pytest.mark.parametrize("offset", [-1e-3, -1e-9, -1e-12, 0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_near_grazing_breakaway(offset):
    """Without damping and from the steady stuck motion, |lambda| just reaches r Ts (1 - offset) once a cycle."""
    gain = 3000.0 - 0.02 * 60.0**2, 3000.0 - 0.22 * 60.0**2
    reach = 300.0 + 100.0 * gain[0] / gain[1]
    system = replace(System(), {
        "friction.law": "set_valued", "friction.kinetic_coefficient": 0.3,
        "pressure.mean": reach * (1.0 - offset) / 0.0024,
        "pressure.amplitude": 0.0, "engine.mean_torque": 300.0, "engine.torque_amplitude": 100.0,
        "engine.frequency": 60.0,
        "driveline.damping": 0.0, "initial.slip_speed": 0.0, "initial.plate_angle": 0.1,
        "initial.plate_speed": 100.0 * 60.0 / gain[1]})
    run = solve(system, cycles=3, samples_per_cycle=40)
    assert run.status is Status.DONE
    if offset < 0.0:
        assert len(run.transitions.time) == 0
    if offset >= 1e-9:
        first = run.transitions.time[0] / system.cycle
        assert first == pytest.approx(0.25 - math.acos(1.0 - offset * reach / (reach - 300.0)) / (2 * math.pi),
                                      abs=1e-6)
        assert np.count_nonzero(run.transitions.after == 1) == 3
    if offset == 1e-3:
        states, _, _ = Piecewise(system).run(3 * system.cycle, run.t, slices=120)
        np.testing.assert_allclose(run.slip_speed, states[:, 0], atol=1e-6 * np.abs(states[:, 0]).max() + 1e-10)
