"""The law of the slip controller example, on the node's solver without ROS."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
import pytest
from ranges import check_options, of_page

from tcc_sim.errors import InputError
from tcc_sim.plant.closed_loop import ControlledRun, closed_loop
from tcc_sim.plant.slip_control import SlipController, Tuning
from tcc_sim.scene import load_scene


def held(tuning: Tuning, seconds: float, at: dict[float, dict[str, object]] | None = None,
         **values: object) -> ControlledRun:
    """Run of the scene `controlled` with the law, tick by tick."""
    controller = SlipController(tuning)
    scene = load_scene("controlled").with_values({key.replace("__", "."): value for key, value in values.items()})
    return closed_loop(scene, lambda reading: controller.update(reading.slip_speed, reading.engine_torque), seconds,
                       at=at)


@pytest.mark.parametrize(("kinetic", "change", "start"), [
    (0.27, 100.0, 50.0), (0.27, -100.0, 50.0), (0.21, 100.0, 50.0), (0.3, 100.0, 50.0), (0.24, -100.0, 0.0),
    (0.24, 100.0, 150.0)])
def test_mean_slip_is_held_under_pulsation_and_after_a_step(kinetic: float, change: float, start: float) -> None:
    """Also from stick, from a fast start, and with friction that the controller does not expect."""
    system = load_scene("controlled").system
    assert (system.engine.torque_amplitude, system.engine.mean_torque) == (250.0, 200.0)
    run = held(Tuning(target=20.0), 4.0, {2.0: {"engine.mean_torque": 200.0 + change}},
               friction__kinetic_coefficient=kinetic, initial__slip_speed=start)
    t, means = run.control.t, run.control.mean_slip
    settled = 25 * system.cycle
    assert np.abs(means[(t > settled) & (t <= 2.0)] - 20.0).max() < 1.0
    assert np.abs(means[t > 2.0 + settled] - 20.0).max() < 1.0
    # The pulsation has the swing that the flywheel allows, and the step disturbed the slip.
    assert np.ptp(run.slip_speed[3000:]) == pytest.approx(2.0 * 250.0 / (0.2 * 150.0), rel=0.05)
    assert np.abs(means[(t > 2.0) & (t < 2.0 + 6 * system.cycle)] - 20.0).max() > 1.0


def test_a_limit_that_was_hit_leaves_nothing_wound_up() -> None:
    """The torque needs more than the pressure limit: slip runs away, and returns without an undershoot by windup."""
    run = held(Tuning(pressure_limit=100e3), 6.0, {0.6: {"engine.mean_torque": 100.0}}, engine__mean_torque=260.0)
    pressure, means = run.commands["actuation_pressure"][1:], run.control.mean_slip
    assert set(pressure[200:600]) == {100e3}
    assert means[14] > 60.0
    assert means[14:].min() > 8.0
    assert np.abs(means[-20:] - 20.0).max() < 1.0
    assert min(pressure) >= 0.0


def test_the_tuning_takes_its_ranges_and_refuses_the_rest_by_a_sentence() -> None:
    page = of_page("nodes")
    check_options({item.name: page[item.name] for item in fields(Tuning)}, Tuning)


@pytest.mark.parametrize(("values", "match"), [
    ({"step": True}, "step is True"), ({"inertia": "heavy"}, "inertia is 'heavy'"),
    ({"frequency": 1e-9}, "period of excitation"), ({"frequency": 1e9}, "period of excitation"),
    ({"frequency": 1e-300, "step": 1e-300}, r"1 to 1e\+06 steps.*inf")])
def test_a_senseless_tuning_is_refused(values: dict[str, object], match: str) -> None:
    with pytest.raises(InputError, match=match):
        Tuning(**values)  # type: ignore[arg-type]


def test_every_update_is_that_of_its_equations() -> None:
    """A cycle of two and a half updates: the last two samples count in full, the one before them by a half."""
    tuning = Tuning(target=20.0, bandwidth=12.0, frequency=2.0 * math.pi / 0.025, inertia=0.3, torque_per_pressure=2e-3,
                    pressure_limit=2e5, step=0.01)
    assert tuning.cycle_steps == pytest.approx(2.5)
    controller, correction = SlipController(tuning), 0.0
    slips = np.array([30.0, 25.0, 18.0, 22.0, 26.0, 140.0, 90.0, 20.0])
    torques = np.array([100.0, 300.0, 200.0, -50.0, 10.0, 400.0, 300.0, 50.0])
    for k in range(len(slips)):
        weights, last = np.array([1.0, 1.0, 0.5][:k + 1][::-1]), slice(max(k - 2, 0), k + 1)
        mean, torque = (float(x[last] @ weights / weights.sum()) for x in (slips, torques))
        controller.target = 20.0 if k < 4 else 23.0
        error = mean - controller.target
        wanted = (torque + 0.3 * 12.0 * error + correction) / 2e-3
        assert controller.update(slips[k], torques[k]) == pytest.approx(min(max(wanted, 0.0), 2e5))
        if 0.0 <= wanted <= 2e5 or (wanted > 2e5) == (error < 0.0):
            correction += 0.3 * 12.0**2 / 4.0 * 0.01 * error
    answers = []
    for _ in range(2):
        controller.reset()
        answers.append([controller.update(*pair) for pair in zip(slips, torques)])
    assert answers[0] == answers[1]
    moving = Tuning(target_times=(0.0, 2.0), target_values=(20.0, 30.0))
    assert [moving.target_at(t) for t in (0.0, 0.5, 2.0, 9.0)] == [20.0, 22.5, 30.0, 30.0]
    assert (Tuning(target=25.0).target_at(3.0), SlipController(moving).target) == (25.0, 20.0)
