"""An actuator in the transfer function: the closed form of its lag and delay, found again by simulation."""

import numpy as np
import pytest

import tcc_sim
from tcc_sim.plant.slip_control import SlipController, Tuning

ACTUATED = {"pressure.time_constant": 0.03, "pressure.delay": 0.005}


def test_a_lag_and_a_delay_cost_the_phase_that_their_closed_form_says():
    scene = tcc_sim.load_scene("controlled")
    omegas = np.array([2.0, 15.0, 60.0])
    plain = tcc_sim.linearise(scene, slip=20.0, frequencies=omegas)
    found = tcc_sim.linearise(scene.with_values(ACTUATED), slip=20.0, frequencies=omegas, check=2)
    np.testing.assert_allclose(found.gain / plain.gain, 1.0 / np.hypot(1.0, 0.03 * omegas), rtol=1e-12)
    np.testing.assert_allclose(found.phase - plain.phase, -np.arctan(0.03 * omegas) - 0.005 * omegas, atol=1e-12)
    assert [point.frequency for point in found.checked] == [2.0, 60.0]
    for point in found.checked:
        place = omegas.tolist().index(point.frequency)
        assert point.gain == pytest.approx(found.gain[place], rel=0.02)
        assert point.phase == pytest.approx(found.phase[place], abs=0.03)
    torque = tcc_sim.linearise(scene.with_values(ACTUATED), slip=20.0, frequencies=omegas, input="engine_torque")
    np.testing.assert_allclose(torque.response, tcc_sim.linearise(
        scene, slip=20.0, frequencies=omegas, input="engine_torque").response, rtol=1e-12)


def grows(factor):
    """How much the slip speed's swing about its mean over a cycle grows in half a second in the closed loop."""
    law = SlipController(Tuning(target=20.0))
    law.proportional, law.integral = 3.0 * factor, 3.75 * 3.0 * factor
    run = tcc_sim.closed_loop(tcc_sim.load_scene("controlled").with_values(ACTUATED), lambda r: law.update(
        r.flywheel_speed - r.plate_speed, r.engine_torque), 3.0, at={1.5: {"engine.mean_torque": 203.0}})
    mean = np.convolve(run.slip_speed, np.ones(42) / 42.0, "valid") - 20.0
    return np.ptp(mean[2400:2900]) / np.ptp(mean[1900:2400])


def test_an_actuator_costs_the_loop_margin_and_makes_it_unstable_where_lock_step_does():
    def loop(kp, **keys):
        scene = tcc_sim.load_scene("controlled").with_values({f"pressure.{key}": value for key, value in keys.items()})
        return tcc_sim.linearise(scene, slip=20.0, frequencies=[10.0], controller=(kp, 3.75 * kp)).controller

    plain, slow = loop(3.0), loop(3.0, time_constant=0.03, delay=0.005)
    assert slow.gain_margin < 0.85 * plain.gain_margin
    assert slow.phase_margin < plain.phase_margin - 0.3
    assert grows(0.93 * slow.gain_margin) < 1.0 < grows(1.07 * slow.gain_margin)
    assert loop(3.0, delay=0.005).largest_delay == pytest.approx(plain.largest_delay - 0.005, abs=1.1e-3)
