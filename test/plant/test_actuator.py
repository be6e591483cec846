"""The actuator between command and plates: closed forms at every tick, SciPy within ticks, and dead time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcc_sim.errors import InputError
from tcc_sim.model.actuator import pressure_after
from tcc_sim.plant.driveline import Plant
from tcc_sim.scene import Scene, load_scene

MEAN = 100e3
"""Mean pressure of the scene `controlled`, Pa."""


def actuated(**keys: float) -> Scene:
    values = {f"pressure.{key}": value for key, value in keys.items()}
    return load_scene("controlled").with_values({**values, "pacing": "lockstep"})


def commanded(tick: int) -> float:
    """Two steps and a jump back, Pa."""
    return (150e3, 90e3, 110e3)[tick // 40 % 3]


def run(scene: Scene, ticks: int) -> list[tuple[float, float, float]]:
    """Slip speed, pressure at the plates and commanded pressure at every tick."""
    plant, result = Plant(scene), []
    for tick in range(ticks):
        plant.hold(None, commanded(tick))
        reading = plant.advance()
        result.append((reading.slip_speed, reading.applied_pressure, reading.commanded_pressure))
    return result


def test_a_lag_is_the_exponential_at_every_tick_and_a_delay_shifts_it_by_whole_ticks() -> None:
    _, plain, delayed = np.array(run(actuated(time_constant=0.03), 120)).T
    _, late, _ = np.array(run(actuated(time_constant=0.03, delay=0.005), 120)).T
    np.testing.assert_array_equal(delayed, [commanded(tick) for tick in range(120)])
    expected, start = [], MEAN
    for begin in range(0, 120, 40):
        target = commanded(begin)
        t = np.arange(1, 41) * 1e-3
        expected += (target + (start - target) * np.exp(-t / 0.03)).tolist()
        start = expected[-1]
    np.testing.assert_allclose(plain, expected, rtol=1e-13)
    np.testing.assert_array_equal(late[:5], MEAN)
    np.testing.assert_array_equal(late[5:], plain[:-5])


def test_a_rate_limit_alone_is_a_ramp_that_ends_at_the_command() -> None:
    _, pressure, _ = np.array(run(actuated(rate_limit=3e6), 40)).T
    np.testing.assert_allclose(pressure, np.minimum(MEAN + 3e6 * np.arange(1, 41) * 1e-3, 150e3), rtol=1e-13)


def test_a_delay_alone_applies_each_command_through_whole_ticks() -> None:
    slip, pressure, _ = np.array(run(actuated(delay=0.003), 60)).T
    assert pressure.tolist() == [MEAN] * 3 + [commanded(tick) for tick in range(57)]
    plant = Plant(actuated())
    for tick in range(60):
        plant.hold(None, MEAN if tick < 3 else commanded(tick - 3))
        assert plant.advance().slip_speed == slip[tick]


@pytest.mark.parametrize("limit", [0.0, 5e5])
def test_the_closed_form_is_that_of_the_differential_equation(limit: float) -> None:
    def rate(_: float, p: np.ndarray) -> np.ndarray:
        wanted = (2e5 - p) / 0.02
        return wanted if limit == 0.0 else np.clip(wanted, -limit, limit)

    for seconds in (0.001, 0.17, 0.25):
        solved = solve_ivp(rate, (0.0, seconds), [1e5], rtol=1e-11, atol=1e-6, max_step=1e-3).y[0, -1]
        assert pressure_after(1e5, 2e5, 0.02, limit, seconds) == pytest.approx(solved, rel=2e-8)


def test_within_a_tick_the_load_is_the_exponential_so_that_scipy_finds_the_same_slip() -> None:
    scene = actuated(time_constant=0.004)
    system = scene.system
    d, f = system.driveline, system.friction
    result, pressure = np.array(run(scene, 60)).T[:2]

    def rates(t: float, y: np.ndarray, target: float) -> list[float]:
        v, angle, speed, p = y
        engine = system.engine.mean_torque + system.engine.torque_amplitude * math.sin(system.engine.frequency * t)
        friction = system.torque_per_pressure * p * math.tanh(f.smoothing * v) * (
            1.0 + (system.friction_ratio - 1.0) * math.exp(-f.decay * abs(v)))
        plate = (friction - d.damping * speed - d.stiffness * angle) / d.plate_inertia
        return [(engine - friction) / d.flywheel_inertia - plate, speed, plate, (target - p) / 0.004]

    i, worst = system.initial, 0.0
    state = np.array([i.slip_speed, i.plate_angle, i.plate_speed, MEAN])
    for tick in range(60):
        state = solve_ivp(rates, (tick * 1e-3, (tick + 1) * 1e-3), state, "DOP853", args=(commanded(tick),), rtol=1e-10,
                          atol=1e-10).y[:, -1]
        worst = max(worst, abs(state[0] - result[tick]))
        assert pressure[tick] == pytest.approx(state[3], rel=1e-9)
    assert worst < 1e-3  # The error of the solver's sub-steps without an actuator.


@pytest.mark.parametrize(("values", "sentence"), [
    ({"pressure.delay": 0.0015}, r"pressure.delay is 0.0015 s; it .* a whole number of ticks of 0.001 s"),
    ({"pressure.time_constant": -1.0}, r"pressure.time_constant is -1 s; it .* 0 to 100 s"),
    ({"pressure.rate_limit": 1e6, "pressure.source": "harmonic"},
     r"pressure.rate_limit is 1e\+06; it acts on commanded pressure and needs pressure.source topic, "),
    ({"pressure.delay": 0.002, "pressure.fallback": "harmonic"}, "pressure.delay is 0.002; it acts on commanded"),
    ({"pressure.time_constant": 0.1, "pressure.mean_times": [0.0], "pressure.mean_values": [1e5]},
     "no pressure.mean_")])
def test_an_actuator_that_has_nothing_to_follow_is_refused(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        load_scene("controlled").with_values(values)
