"""Signals of a run between its samples, its phase, and the orders that its torque has."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tcc_sim.analysis.measured.signals import driven_orders, gaps_between, phase_of_cycles, run_signals, turns_at
from tcc_sim.errors import InputError
from tcc_sim.scene import load_scene
from tcc_sim.trajectory import Cycles, Trajectory, Transitions

SCENE = load_scene("fig02").with_values({"driveline.damping": 0.7, "engine.frequency": 40.0})
SYSTEM = SCENE.system
PROFILE = {"engine.frequency_times": (0.0, 1.0), "engine.frequency_values": (40.0, 60.0)}
HARMONICS = {"engine.harmonic_amplitudes": (30.0, 0.0, 5.0), "engine.harmonic_phases": (0.1, 0.0, 0.2)}
T = 0.01 * np.arange(101)


def run_of(system=SYSTEM, t=T, **fields):
    """A motion of known form: slip 5 + 3 sin 20 t, plate angle 0.1 + 0.02 sin 15 t, with the torques that it needs."""
    d = system.driveline
    angle, speed, rate = 0.1 + 0.02 * np.sin(15.0 * t), 0.3 * np.cos(15.0 * t), -4.5 * np.sin(15.0 * t)
    friction = d.plate_inertia * rate + d.damping * speed + d.stiffness * angle
    torque = d.flywheel_inertia * (60.0 * np.cos(20.0 * t) + rate) + friction
    return Trajectory(t, 5.0 + 3.0 * np.sin(20.0 * t), angle, speed, torque, friction, friction,
                      (np.arange(len(t)) % 10 > 3).astype(np.int8), system.cycle, "by_hand", system, **fields)


def test_signals_between_samples_have_the_rates_of_the_equations():
    run, at = run_of(), np.linspace(0.005, 0.995, 199)
    signals = run_signals(run)
    slip, shaft, engine = signals.at(at)
    d, angle, speed = SYSTEM.driveline, 0.1 + 0.02 * np.sin(15.0 * at), 0.3 * np.cos(15.0 * at)
    assert slip == pytest.approx(5.0 + 3.0 * np.sin(20.0 * at), abs=3.0 * 0.2**4 / 384.0)   # (omega h)^4/384
    assert shaft == pytest.approx(d.damping * speed + d.stiffness * angle, abs=60.0 * 0.15**4 / 300.0)
    assert engine == pytest.approx(np.interp(at, T, run.engine_torque), abs=1.0)
    assert signals.turns == pytest.approx(40.0 * T / (2.0 * math.pi))
    assert signals.when(np.array([1.5])) == pytest.approx([3.0 * math.pi / 40.0])
    exact = np.cumsum(np.append(0.0, 0.5 * 0.01 * (run.friction_torque[1:] * run.slip_speed[1:]
                                                   + run.friction_torque[:-1] * run.slip_speed[:-1])))
    assert signals.heat == pytest.approx(exact, rel=1e-9)
    assert signals.breakaways.tolist() == T[4::10].tolist()   # Rows 0 to 3 of ten stick.
    assert (signals.driven.tolist(), signals.holes.tolist(), signals.notes) == ([1.0], [], ())
    changes = Transitions(np.array([0.1, 0.2, 0.3]), np.array([1, 0, 0]), np.array([0, 1, -1]))
    assert run_signals(replace(run, transitions=changes)).breakaways.tolist() == [0.2, 0.3]


def test_a_phase_that_is_given_replaces_that_of_the_scene():
    signals = run_signals(run_of(), (np.array([2.0, 4.0]), lambda turns: 0.5 * np.asarray(turns) - 1.0))
    assert signals.turns == pytest.approx(2.0 + 2.0 * T)
    with pytest.raises(InputError, match="no system"):
        run_signals(replace(run_of(), system=None))


def test_turns_follow_a_profile():
    profile = SCENE.with_values(PROFILE).system
    assert turns_at(profile, T) == pytest.approx((40.0 * T + 10.0 * T**2) / (2.0 * math.pi))
    assert turns_at(SYSTEM, T) == pytest.approx(40.0 * T / (2.0 * math.pi))


@pytest.mark.parametrize(("values", "orders"), [
    ({}, [1.0]), ({"engine.torque_amplitude": 0.0}, []), (HARMONICS, [1.0, 2.0, 4.0]), (PROFILE, [1.0]),
    ({**HARMONICS, **PROFILE}, [1.0, 2.0, 4.0])])
def test_the_torque_of_a_scene_has_its_own_orders(values, orders):
    assert driven_orders(SCENE.with_values(values).system).tolist() == orders


def test_a_gap_is_wide_in_time_and_in_phase():
    t = np.delete(T, [20, *range(50, 53), 80, 81])
    assert gaps_between(t, t).tolist() == [pytest.approx([0.49, 0.53]), pytest.approx([0.79, 0.82])]
    assert gaps_between(np.arange(len(t)) * 1.0, t).tolist() == []
    assert gaps_between(t, np.arange(len(t)) * 1.0).tolist() == []
    assert gaps_between(3.0 * t, t).tolist() == gaps_between(t, t).tolist()


def cycles(starts, unknown=()):
    count = len(starts) - 1
    highest = np.where(np.isin(np.arange(count), unknown), np.nan, 1.0)
    return Cycles(np.zeros((count + 1, 3)), highest, highest, highest, starts=np.array(starts))


def test_a_commanded_torque_has_the_phase_of_its_cycles():
    commanded = SCENE.with_values({"engine.source": "topic"}).system
    run = run_of(commanded, cycles=cycles([0.105, 0.3, 0.5, 0.905], unknown=[1]))
    turns, when = phase_of_cycles(run)
    inside = T[11:91]
    assert turns == pytest.approx(np.interp(inside, [0.105, 0.3, 0.5, 0.905], [0.0, 1.0, 2.0, 3.0]))
    assert when(np.array([0.5, 2.5])) == pytest.approx([0.2025, 0.7025])
    assert run_signals(replace(run, t=T)).holes.tolist() == [[0.3, 0.5]]
    assert run_signals(run).driven is None
    for wrong in (None, cycles([0.1]), cycles([0.1, math.nan, 0.5])):
        with pytest.raises(InputError, match=r"commanded.* not known"):
            phase_of_cycles(replace(run, cycles=wrong))
