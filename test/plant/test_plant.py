"""Values that a running driveline accepts and refuses, without ROS: sub-steps, their cost, held inputs."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.plant.driveline import MEASURED, SHARE, Plant
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import SUBSTEP_LIMIT

MEANS = {"engine.fallback": "mean", "pressure.fallback": "mean"}


def plant(cost: float = 0.0, scene: str = "commands", **values: object) -> Plant:
    """A plant that has measured a `cost` of its sub-steps, s."""
    result = Plant(load_scene(scene).with_values({**(MEANS if scene == "commands" else {}),
                                                  **{k.replace("__", "."): v for k, v in values.items()}}),
                   itertools.cycle((0.0, cost * MEASURED)).__next__)
    result.warm_up()
    return result


def needed(system, pressure: float, step: float) -> float:
    """The rule of the solver's docstring: h <= 1/(2 beta Ts alpha (r - 1))."""
    d, f = system.driveline, system.friction
    beta = 1.0 / d.flywheel_inertia + 1.0 / d.plate_inertia
    ratio = f.static_coefficient / f.kinetic_coefficient
    return 2.0 * step * beta * system.torque_per_pressure * pressure * f.decay * (ratio - 1.0)


@pytest.mark.parametrize("values", [{"rate": 50.0}, {"rate": 20.0}, {"friction__decay": 100.0}])
def test_a_pressure_that_needs_too_many_sub_steps_is_refused_and_the_last_one_holds(values: dict[str, float]) -> None:
    result = plant(**values)
    assert needed(result.scene.system, 1e7, result.stepper.step) > SUBSTEP_LIMIT
    result.hold(None, 2e5)
    terms = result.stepper.terms
    with pytest.raises(InputError, match=f"sub-steps; fixed_step allows at most {SUBSTEP_LIMIT}"):
        result.check_pressure(1e7)
    assert result.stepper.terms == terms
    highest = 1e7 * SUBSTEP_LIMIT / needed(result.scene.system, 1e7, result.stepper.step)
    result.check_pressure(highest * (1.0 - 1e-9))
    with pytest.raises(InputError):
        result.check_pressure(highest * (1.0 + 1e-9))


def test_what_takes_longer_than_its_own_time_is_refused_in_real_time_only() -> None:
    """A tick of 1 ms may take half of it: 500 sub-steps of 1 us."""
    pressure = 1e7 * 500.0 / needed(load_scene("commands").system, 1e7, 1e-3)
    assert SHARE == 0.5
    result = plant(1e-6)
    result.check_pressure(pressure * (1.0 - 1e-9))
    with pytest.raises(InputError, match=r"a tick of 1 ms needs 501 sub-steps, which take 0.501 ms on this machine; in "
                                         r"real time at most 0.5 ms are allowed \(no limit offline, in lock-step and "
                                         r"with real_time_factor 0\)"):
        result.check_pressure(pressure * (1.0 + 1e-9))
    plant(1e-6, real_time_factor=0.0).check_pressure(1e7)
    plant(1e-6, pacing="".join("lockstep")).check_pressure(1e7)
    plant(1e-6, real_time_factor=0.5).check_pressure(1.9 * pressure)
    with pytest.raises(InputError):
        plant(1e-6, real_time_factor=2.0).check_pressure(0.6 * pressure)


def test_a_live_parameter_is_checked_beside_the_held_pressure_and_for_the_time_after_it() -> None:
    result = plant(rate=50.0)
    result.hold(100.0, 5e6)
    before = result.scene
    steeper = before.with_values({"friction.static_coefficient": 0.4})
    with pytest.raises(InputError, match="sub-steps"):
        result.use(steeper)
    assert (result.scene, result.stepper.terms.mean_load) == (before, before.system.torque_per_pressure * 5e6)
    result.hold(100.0, 1e5)
    with pytest.raises(InputError, match="sub-steps"):
        result.use(steeper.with_values({"pressure.mean": 1e7}))
    result.use(steeper)
    result.reset()
    for _ in range(5):
        result.stepper.advance()
    assert np.isfinite(result.reading()).all()


def test_a_scene_that_needs_more_than_the_share_from_the_start_keeps_running_and_gets_no_dearer() -> None:
    stepper = Plant(load_scene("fig02")).stepper
    result = plant(0.7 * stepper.step / stepper.substeps, "fig02")
    result.use(result.scene.with_values({"engine.mean_torque": 200.0, "pressure.mean": 2e5}))
    with pytest.raises(InputError, match=r"in real time at most 0.7 ms are allowed"):
        result.use(result.scene.with_values({"pressure.mean": 3e5}))


def test_a_pressure_that_would_fall_below_zero_is_clamped_in_the_fallback() -> None:
    result = plant(scene="commands", pressure__fallback="harmonic", pressure__amplitude=9e5)
    lowest = []
    for _ in range(60):
        result.stepper.advance()
        lowest.append(result.reading().applied_pressure)
    assert min(lowest) == 0.0


def test_the_applied_pressure_follows_its_profile_and_the_phase() -> None:
    """omega rises from 100 to 140 rad/s in 0.2 s, so that phi = 100 t + 100 t^2."""
    values = {"engine.frequency_times": [0.0, 0.2], "engine.frequency_values": [100.0, 140.0],
              "pressure.mean_times": [0.0, 0.1], "pressure.mean_values": [2e5, 3e5]}
    for name, change, swing in (("fig02", {"pressure.phase": 0.3}, 1.0), ("controlled", {}, 0.0)):
        scene = load_scene(name).with_values({**values, **change, "pacing": "lockstep"})
        result = Plant(scene)
        for _ in range(150):
            result.stepper.advance()
        amplitude = swing * scene.system.pressure.amplitude
        phase = 100.0 * 0.15 + 100.0 * 0.15**2
        assert result.reading().applied_pressure == pytest.approx(3e5 + amplitude * math.sin(phase + 0.3), rel=1e-12)


STEP = 1e-3


def test_engine_torque_and_pressure_go_on_from_where_they_are():
    scene = load_scene("fig02").with_values({"pressure.frequency_ratio": 0.5, "pressure.phase": 0.7,
                                             "pacing": "lockstep", "engine.harmonic_amplitudes": [40.0],
                                             "engine.harmonic_phases": [0.2]})
    plant = Plant(scene)
    plant.warm_up()
    phase, angle, omega, ratio = 0.0, 0.7, 150.0, 0.5
    for ticks, changes in ((33, {"engine.frequency": 210.0}), (41, {"pressure.frequency_ratio": 1.7}),
                           (29, {"engine.frequency": 95.0, "pressure.frequency_ratio": 0.9}),
                           (17, {"engine.mean_torque": 280.0}), (50, {})):
        for _ in range(ticks):
            plant.stepper.advance()
            phase, angle = phase + omega * STEP, angle + ratio * omega * STEP
            engine, pressure = scene.system.engine, scene.system.pressure
            now = plant.reading()
            assert now.engine_torque == pytest.approx(engine.mean_torque + engine.torque_amplitude * math.sin(phase)
                                                      + 40.0 * math.sin(2.0 * phase + 0.2), abs=1e-8)
            expected = pressure.mean + pressure.amplitude * math.sin(angle)
            assert now.applied_pressure == pytest.approx(expected, rel=1e-10)
        scene = scene.with_values(changes)
        plant.use(scene)
        omega, ratio = scene.system.engine.frequency, scene.system.pressure.frequency_ratio
    plant.reset()
    plant.stepper.advance()
    assert plant.reading().engine_torque == pytest.approx(280.0 + 250.0 * math.sin(omega * STEP)
                                                          + 40.0 * math.sin(2.0 * omega * STEP + 0.2), abs=1e-8)


def test_a_profile_runs_in_ticks_as_offline():
    scene = load_scene("chaos").with_values({"engine.frequency_times": [0.0, 0.0505], "engine.frequency_values":
                                               [100.0, 220.0], "pacing": "lockstep"})
    plant = Plant(scene)
    plant.warm_up()
    for _ in range(100):
        plant.stepper.advance()
    final = solve(scene, solver="fixed_step", duration=0.1).final
    assert (plant.reading().slip_speed, plant.reading().plate_angle) == (final.slip_speed, final.plate_angle)


def test_a_reading_has_the_state_of_its_tick() -> None:
    scene = load_scene("fig02").with_values({"initial.slip_speed": -40.0, "initial.plate_speed": 3.0, "rate": 750.0,
                                             "initial.plate_angle": 0.1, "pacing": "lockstep"})
    result = Plant(scene)
    first, d = result.reading(), scene.system.driveline
    assert first[:5] == (0, 0.1, 0.1, -37.0, 3.0)
    assert (first.slip_speed, first.stick_slip_state) == (-40.0, -1)
    assert first.shaft_torque == pytest.approx(3.0 * d.damping + 0.1 * d.stiffness)
    for _ in range(2):
        result.advance()
    third = result.advance()
    assert (third.stamp_ns, result.stamp_ns, result.stamp_of(4)) == (4_000_000, 4_000_000, 5_333_333)
    assert third.flywheel_speed == third.slip_speed + third.plate_speed
    assert third.shaft_torque == pytest.approx(third.plate_speed * d.damping + third.plate_angle * d.stiffness)
    result.move_far_end(25.0)
    moved = result.advance()
    assert (moved.output_speed, moved.output_angle) == (25.0, pytest.approx(25.0 / 750.0))
    assert moved.shaft_torque == pytest.approx((moved.plate_speed - 25.0) * d.damping + (
        moved.plate_angle - moved.output_angle) * d.stiffness)
    result.move_far_end(None)
    assert result.advance()[-2:] == (moved.output_angle, 0.0)
