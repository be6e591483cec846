"""The loop of the slip controller: margins by an independent loop gain, and found again in lock-step."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from documents import valid

import tcc_sim
from tcc_sim import cli
from tcc_sim.estimation.linearise import SlipLoop, linearise
from tcc_sim.plant.driveline import Reading
from tcc_sim.plant.slip_control import CycleMean, SlipController, Tuning
from tcc_sim.scene import load_scene

TUNING = Tuning()
LAW = SlipController(TUNING)
GAINS = LAW.proportional, LAW.integral
ACTUATED = {"pressure.time_constant": 0.03, "pressure.delay": 0.005}


@pytest.fixture(scope="module")
def loop() -> SlipLoop:
    """The package's controller about its target."""
    return linearise("controlled", slip=TUNING.target, frequencies=[10.0], controller=GAINS).controller


class Raised:
    """The slip controller with its gains raised and its commands late."""

    def __init__(self, factor: float = 1.0, late: int = 0, target: float = TUNING.target) -> None:
        self.controller = SlipController(Tuning(target=target))
        self.controller.proportional *= factor
        self.controller.integral *= factor
        self.late, self.commands = late, []

    def __call__(self, reading: Reading) -> float:
        self.commands.append(self.controller.update(reading.slip_speed, reading.engine_torque))
        return self.commands[max(0, len(self.commands) - 1 - self.late)]


def swing(law: Raised, seconds: float = 4.0) -> float:
    """Peak to peak of the cycle means at the end in lock-step, rad/s."""
    run = tcc_sim.closed_loop("controlled", law, seconds)
    means = CycleMean(TUNING.cycle_steps)
    return float(np.ptp([means.update(v) for v in run.slip_speed][-1000:]))


def test_the_gain_margin_is_found_in_lock_step(loop: SlipLoop) -> None:
    assert loop.stable
    assert 2.5 < loop.gain_margin < 4.0
    assert swing(Raised(0.9 * loop.gain_margin)) < 0.1
    assert swing(Raised(1.1 * loop.gain_margin)) > 1.0


def test_the_largest_delay_is_found_in_lock_step(loop: SlipLoop) -> None:
    ticks = loop.largest_delay / 1e-3
    assert swing(Raised(late=round(0.93 * ticks)), 10.0) < 1.0
    assert swing(Raised(late=round(1.07 * ticks))) > 3.0


def test_the_smallest_stable_slip_is_found_in_lock_step(loop: SlipLoop) -> None:
    slower = linearise("controlled", slip=0.998 * loop.smallest_stable_slip, frequencies=[10.0], controller=GAINS)
    assert not slower.controller.stable
    assert swing(Raised(target=1.1 * loop.smallest_stable_slip)) < 0.1
    assert swing(Raised(target=0.9 * loop.smallest_stable_slip)) > 0.4


def test_an_actuator_costs_the_loop_margin_and_makes_it_unstable_where_lock_step_does(loop: SlipLoop) -> None:
    slow = linearise(load_scene("controlled").with_values(ACTUATED), slip=TUNING.target, frequencies=[10.0],
                     controller=GAINS).controller
    assert slow.largest_delay < loop.largest_delay - 0.005
    assert slow.gain_margin < 0.85 * loop.gain_margin
    assert slow.phase_margin < loop.phase_margin - 0.3
    grown = []
    for factor in (0.93, 1.07):
        run = tcc_sim.closed_loop(load_scene("controlled").with_values(ACTUATED), Raised(factor * slow.gain_margin),
                                  3.0, at={1.5: {"engine.mean_torque": 203.0}})
        mean = np.convolve(run.slip_speed, np.ones(42) / 42.0, "valid") - TUNING.target
        grown.append(np.ptp(mean[2400:2900]) / np.ptp(mean[1900:2400]))
    assert grown[0] < 1.0 < grown[1]


def test_the_margins_are_those_of_the_loop_gain(loop: SlipLoop) -> None:
    """The loop gain from the harmonic transfer function, with the controller's own cycle of 41.89 ticks."""
    # Fine where the slipping mode is, which decides the gain margin.
    omegas = np.concatenate([np.linspace(1.0, 380.0, 1000), np.linspace(380.0, 430.0, 1200)[1:],
                             np.linspace(430.0, 900.0, 200)[1:]])
    plant = linearise("controlled", slip=TUNING.target, frequencies=omegas).response
    s, length = 1j * omegas, TUNING.cycle_steps
    late = np.exp(-s * TUNING.step)
    whole = math.floor(length)
    mean = ((1.0 - late**whole) / (1.0 - late) + (length - whole) * late**whole) / length
    held = (1.0 - late) / (s * TUNING.step)
    gains = LAW.proportional + LAW.integral * TUNING.step * late / (1.0 - late)
    gain = -plant * mean * held * gains / TUNING.torque_per_pressure
    # Where the phase passes -180 degrees the imaginary part changes its sign, with a real part below 0: the least
    # margin is that of the slipping mode, not that of the integrator.
    turns = np.flatnonzero((gain.imag[:-1] * gain.imag[1:] <= 0.0) & (gain.real[1:] < 0.0))
    assert 390.0 < omegas[turns[np.argmax(np.abs(gain[turns]))]] < 420.0
    assert loop.gain_margin == pytest.approx(float(np.min(1.0 / np.abs(gain[turns]))), rel=0.03)
    crossed = np.flatnonzero((np.abs(gain[:-1]) >= 1.0) & (np.abs(gain[1:]) < 1.0))
    assert len(crossed) == 1
    margin = math.pi + float(np.angle(gain[crossed[0]]))
    assert loop.phase_margin == pytest.approx(margin, abs=0.01)
    assert loop.largest_delay == pytest.approx(margin / omegas[crossed[0]], abs=2e-3)


def test_constant_slip_without_slope_is_an_integrator_with_known_multipliers() -> None:
    """Below the mode of a stiff shaft: I1 v' = -dTs, with a mean over four ticks, as a polynomial written out here."""
    scene = load_scene("controlled").with_values({
        "engine.torque_amplitude": 0.0, "friction.kinetic_coefficient": 0.3, "driveline.stiffness": 1e8,
        "driveline.plate_inertia": 1e-3, "driveline.damping": 1e3, "rate": 4.0 * 150.0 / (2.0 * math.pi)})
    linearised = linearise(scene, slip=20.0, frequencies=[10.0], controller=(3.0, 11.25)).controller
    h = linearised.step
    assert h == pytest.approx(2.0 * math.pi / 600.0)
    # v+ = v - h/I1 (KP m + c), c+ = c + KI h m, m = (v + v1 + v2 + v3)/4.
    by_mean = np.full(4, 0.25)
    rows = np.zeros((5, 5))
    rows[0, :4], rows[0, 4] = -h / 0.2 * 3.0 * by_mean, -h / 0.2
    rows[0, 0] += 1.0
    rows[1, 0] = rows[2, 1] = rows[3, 2] = rows[4, 4] = 1.0
    rows[4, :4] = 11.25 * h * by_mean
    exact = np.linalg.eigvals(np.linalg.matrix_power(rows, 4))
    assert np.sort(np.abs(linearised.multipliers))[::-1][:2] == pytest.approx(np.sort(np.abs(exact))[::-1][:2],
                                                                              rel=1e-3)


def test_the_command_prints_the_margins_and_refuses_other_gains(tmp_path, capsys) -> None:
    words = ["linearise", "controlled", "--slip", "20", "--frequencies", "2:300:5", "--controller"]
    assert cli.main([*words, "12,45", "--json", str(tmp_path / "found.json")]) == 0
    assert "N m/rad, a command every 0.9973 ms: unstable, largest multiplier 1." in capsys.readouterr().out
    document = valid("linearise", json.loads((tmp_path / "found.json").read_text()))
    loop = document["controller"]
    assert [loop[name] for name in ("stable", "gain_margin", "largest_delay", "smallest_stable_slip")] == [
        False, None, None, None]
    assert math.hypot(*loop["multipliers"][0]) > 1.0
    assert cli.main([*words, "12"]) == 2
    refused = capsys.readouterr().err
    assert all(word in refused for word in ("--controller", "12", "above 0"))
