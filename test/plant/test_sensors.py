"""Sensors before a law: effect of each option on the law's input, and wrong options."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from ranges import Stated, check_options

import tcc_sim
from tcc_sim.errors import InputError
from tcc_sim.plant.driveline import Reading
from tcc_sim.plant.sensors import SIGNALS, Sensor, Sensors
from tcc_sim.trajectory import Floats


def sensed(count: int, **sensors: Any) -> tuple[dict[str, Floats], list[bool]]:
    """Measured signals of states with signals 1, 2, ... times the tick, and whether a message was lost."""
    measuring, columns, lost = Sensors(sensors), {name: np.empty(count) for name in SIGNALS}, []
    for tick in range(count):
        state = Reading(*[0.0] * len(Reading.__annotations__))._replace(
            **{name: (1.0 + at) * tick for at, name in enumerate(SIGNALS)})
        measured = measuring.measure(state)
        for name in SIGNALS:
            columns[name][tick] = getattr(measured, name)
        lost.append(bool(measuring.lost))
    return columns, lost


def test_each_option_does_what_it_says_and_leaves_the_other_signals() -> None:
    ticks = np.arange(40.0)
    columns, _ = sensed(40, slip_speed={"offset": 0.5}, plate_speed={"quantum": 7.0}, flywheel_speed={"delay_ticks": 3})
    np.testing.assert_array_equal(columns["slip_speed"], ticks + 0.5)
    assert np.abs(columns["plate_speed"] - 5.0 * ticks).max() <= 3.5
    assert (columns["plate_speed"] % 7.0 == 0.0).all()
    np.testing.assert_array_equal(columns["flywheel_speed"], 4.0 * np.maximum(ticks - 3.0, 0.0))
    np.testing.assert_array_equal(columns["plate_angle"], 3.0 * ticks)
    late, _ = sensed(40, joint_states={"delay_ticks": 5})
    np.testing.assert_array_equal(late["engine_torque"], 6.0 * np.maximum(ticks - 5.0, 0.0))
    np.testing.assert_array_equal(late["slip_speed"], ticks)


def test_noise_has_its_deviation_and_its_seed() -> None:
    one, again, other = (sensed(4000, slip_speed={"noise": 2.0, "seed": seed})[0]["slip_speed"] for seed in (1, 1, 2))
    noise = one - np.arange(4000.0)
    # Four standard deviations of the mean and of the variance of 4000 independent draws.
    assert abs(noise.mean()) < 4.0 * 2.0 / 4000.0 ** 0.5
    assert abs(noise.var() / 4.0 - 1.0) < 4.0 * (2.0 / 4000.0) ** 0.5
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 4.0 / 4000.0 ** 0.5
    assert one.tobytes() == again.tobytes() != other.tobytes()


def test_a_law_is_told_by_the_sensors_and_the_run_keeps_the_true_states() -> None:
    seen: list[float] = []

    def law(reading: Reading) -> float:
        seen.append(reading.slip_speed)
        return 1e5

    run = tcc_sim.closed_loop("controlled", law, 0.05, sensors={"slip_speed": {"offset": 3.0, "drop": 5}})
    assert len(seen) == 40
    assert set(seen) < set(run.slip_speed + 3.0)
    assert np.abs(run.applied_pressure[5:] - 1e5).max() == 0.0


def test_a_sensor_takes_its_ranges_and_refuses_the_rest_by_a_sentence() -> None:
    check_options({"noise": Stated("0 or more", "0"), "offset": Stated("-1e+12 to 1e+12", "0"),
                   "quantum": Stated("0 or more", "0"), "delay_ticks": Stated("0 to 100000", "0"),
                   "drop": Stated("0 or more", "0"), "seed": Stated("0 or more", "0")}, Sensor)


@pytest.mark.parametrize(("name", "options", "sentence"), [
    ("slip", {}, "slip has no sensor; sensors are of slip_speed, flywheel_angle, plate_angle, flywheel_speed, "
                 "plate_speed, engine_torque and joint_states"),
    ("slip_speed", {"nose": 1.0}, "nose is not an option of a sensor; the options are noise, offset, quantum"),
    ("slip_speed", {"delay_ticks": 1.5}, "delay_ticks is 1.5; it .* a whole number"),
    ("plate_speed", {"drop": 3}, "plate_speed has no drop, since only whole messages are lost; give drop to"),
    ("joint_states", {"noise": 0.1}, "joint_states has no noise, offset or quantum; give them to one of its signals")])
def test_wrong_sensors_are_refused(name: str, options: dict[str, float], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        tcc_sim.closed_loop("controlled", lambda _: None, 0.01, sensors={name: options})
