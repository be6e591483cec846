"""Judder and orders at given speeds of a run whose orders are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tcc_sim.analysis.measured.orders import judder_of, orders_at_speeds, orders_of
from tcc_sim.errors import InputError
from tcc_sim.scene import load_scene
from tcc_sim.trajectory import Trajectory

HIGH = 200.0


def run_of(system, seconds, swing):
    """A run at 2 kHz in which the slip swings with the engine about 30 rad/s by an amplitude of the frequency."""
    t = np.arange(0.0, seconds, 5e-4)
    high = HIGH if system.profile is not None else 100.0
    phase, omega = 100.0 * t + 0.5 * (high - 100.0) / seconds * t**2, 100.0 + (high - 100.0) / seconds * t
    slip, zero = 30.0 + swing(omega) * np.sin(phase), np.zeros(len(t))
    torque = system.driveline.flywheel_inertia * np.gradient(slip, t, edge_order=2)
    return Trajectory(t, slip, zero, zero, torque, zero, zero, zero.astype(np.int8), system.cycle, "by_hand", system)


RISING = load_scene("slip").with_values({"engine.frequency_times": (0.0, 5.0),
                                         "engine.frequency_values": (100.0, HIGH)}).system
STEADY = load_scene("slip").with_values({"engine.frequency": 100.0}).system
UP = run_of(RISING, 5.0, lambda omega: 0.02 * omega)


def test_judder_is_that_of_the_periods_from_a_time_on():
    run = run_of(STEADY, 1.0, lambda omega: 2.0 + 0.0 * omega)
    whole = judder_of(run, 0.0)
    assert (whole.rms, whole.peak) == (pytest.approx(math.sqrt(2.0), rel=1e-4), pytest.approx(2.0, rel=1e-3))
    grown = replace(run, slip_speed=np.where(run.t < 0.5, 30.0, run.slip_speed))
    assert judder_of(grown, 0.0).rms == pytest.approx(math.sqrt(7.0 / 15.0 * 2.0), rel=0.03)
    assert judder_of(grown, 8.0 * STEADY.cycle).rms == pytest.approx(math.sqrt(2.0), rel=1e-4)
    assert judder_of(grown, 8.0 * STEADY.cycle).peak == pytest.approx(2.0, rel=1e-3)
    none = judder_of(run, 2.0)
    assert math.isnan(none.rms)
    assert math.isnan(none.peak)


def test_orders_at_speeds_are_those_where_the_frequency_passes_them():
    found = orders_at_speeds(UP, (120.0, 150.0, 300.0), 0.0)
    assert found.speeds.tolist() == [120.0, 150.0, 300.0]
    assert found.order.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert found.slip_speed[:2, 0] == pytest.approx([2.4, 3.0], rel=5e-3)
    assert found.slip_speed[:2, 1:] == pytest.approx(np.zeros((2, 3)), abs=0.02)
    assert np.isnan(found.slip_speed[2]).all()
    assert found.shaft_torque[:2] == pytest.approx(np.zeros((2, 4)), abs=1e-6)
    known = orders_of(UP).frequency
    within = orders_at_speeds(UP, (), 0.0).speeds
    assert within == pytest.approx(np.linspace(known.min(), known.max(), 7)[1:-1])
    late = orders_at_speeds(UP, (), 2.0).speeds   # Windows that begin at 2 s, at 140 rad/s, or later.
    assert 147.0 < late[0] < 160.0
    with pytest.raises(InputError, match="16 periods"):
        orders_at_speeds(UP, (), 4.9)


def test_a_constant_frequency_has_its_own_speed_alone():
    run = run_of(STEADY, 2.0, lambda omega: 2.0 + 0.0 * omega)
    found = orders_at_speeds(run, (), 0.0)
    assert found.speeds == pytest.approx([100.0])
    assert found.slip_speed[0, 0] == pytest.approx(2.0, rel=1e-3)
    given = orders_at_speeds(run, (100.0 * (1.0 + 0.9e-6), 100.0 * (1.0 + 1.2e-6)), 0.0).slip_speed[:, 0]
    assert (given[0], math.isnan(given[1])) == (pytest.approx(2.0, rel=1e-3), True)
