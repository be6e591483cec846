"""The frequency changes while the driveline runs: neither the engine's phase nor the load's jumps."""

import math

import pytest

from tcc_sim.plant.driveline import Plant
from tcc_sim.scene import load_scene

STEP = 1e-3


def test_engine_torque_and_pressure_go_on_from_where_they_are():
    scene = load_scene("fig02").with_values({"pressure.frequency_ratio": 0.5, "pressure.phase": 0.7,
                                             "pacing": "lockstep", "engine.harmonic_amplitudes": [40.0],
                                             "engine.harmonic_phases": [0.2]})
    plant = Plant(scene)
    plant.warm_up()
    plant.warm_up_general()
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
    from tcc_sim.solvers import solve

    scene = load_scene("chaos").with_values({"engine.frequency_times": [0.0, 0.0505], "engine.frequency_values":
                                               [100.0, 220.0], "pacing": "lockstep"})
    plant = Plant(scene)
    plant.warm_up()
    for _ in range(100):
        plant.stepper.advance()
    final = solve(scene, solver="fixed_step", duration=0.1).final
    assert (plant.reading().slip_speed, plant.reading().plate_angle) == (final.slip_speed, final.plate_angle)
    assert not plant.general
