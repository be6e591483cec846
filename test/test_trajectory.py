"""Cycles, runs and trajectories: parts of them, joined and selected, with numbers that say where they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.parameters import System
from tcc_sim.model.parameters import replace as changed
from tcc_sim.trajectory import (
    UNITS,
    Cycles,
    Loads,
    State,
    Status,
    Trajectory,
    concatenated,
    event_sequence,
    integral,
    modes_of,
)

N = np.arange(5.0)
LOADS = Loads(*(100.0 * k + N for k in range(6)))
CYCLES = Cycles(np.stack([np.arange(6.0)] * 3, axis=1), N, -2.0 * N, 10.0 + N, LOADS, 20.0 + np.arange(6.0))


def test_loads_of_joined_cycles_are_those_of_all_parts_or_none() -> None:
    whole = concatenated([CYCLES[:2], CYCLES[2:]]).loads
    assert whole is not None
    np.testing.assert_array_equal(whole.columns(), LOADS.columns())
    assert concatenated([CYCLES[:2], replace(CYCLES[2:], loads=None)]).loads is None


def test_a_state_is_three_numbers_and_the_initial_one_of_a_system() -> None:
    state = State.of(["1", 2, 3.0])
    assert (state.numbers, state.flywheel_angle) == ((1.0, 2.0, 3.0), 0.0)
    assert State.at_start(state.starting(System())) == state
    system = changed(System(), {"initial.slip_speed": 4.0, "initial.plate_angle": 0.5, "initial.plate_speed": 6.0})
    assert State.at_start(system).numbers == (4.0, 0.5, 6.0)


T = np.array([0.0, 1.0, 3.0])
RUN = Trajectory(T, np.array([1.0, -2.0, 0.0]), np.array([0.1, 0.2, 0.4]), np.array([5.0, 6.0, 8.0]), 10.0 * T,
                 20.0 * T, 30.0 * T, np.array([1, -1, 0], np.int8), 0.5, "euler", System())


def test_a_trajectory_has_columns_units_and_a_text() -> None:
    wet = replace(RUN, system=changed(System(), {"converter.coupling": 0.5}), output_angle=T, output_speed=np.ones(3))
    assert list(wet.columns()) == ["t", "slip_speed", "plate_angle", "plate_speed", "engine_torque",
                                   "saturation_torque", "friction_torque", "state", "output_angle", "output_speed",
                                   "coupling_torque"]
    assert list(RUN.columns()) == list(wet.columns())[:8]
    assert set(wet.columns()) == set(UNITS)
    assert wet.columns()["coupling_torque"].tolist() == [0.5, -1.0, 0.0]
    assert replace(wet, system=None).coupling_torque is RUN.coupling_torque is None
    late = replace(RUN, t=T + 7.0, cycles=CYCLES[:1])
    for run, words in ((RUN, ("euler", "3 samples", "3 s")), (late, ("3 s", "1 period")),
                       (replace(RUN, t=np.empty(0), status=Status.REFUSED), ("0 samples", "not started"))):
        assert [word for word in words if word not in repr(run)] == []


def test_the_twist_of_the_shaft_is_relative_to_its_far_end() -> None:
    angle, speed = RUN.shaft_twist
    assert (angle.tolist(), speed.tolist()) == ([0.1, 0.2, 0.4], [5.0, 6.0, 8.0])
    moved = replace(RUN, output_angle=np.array([0.1, np.nan, 0.1]), output_speed=np.array([1.0, 2.0, np.nan]))
    angle, speed = moved.shaft_twist
    assert np.isnan(angle).tolist() == [False, True, False]
    assert np.isnan(speed).tolist() == [False, False, True]


def test_a_trajectory_ends_at_a_state_or_with_a_sentence() -> None:
    assert RUN.final == State(0.0, 0.4, 8.0, 0.0)
    assert replace(RUN, flywheel_angle=np.array([1.0, 2.0, 9.0])).final.flywheel_angle == 9.0
    assert RUN.raise_for_status() is RUN
    assert replace(RUN, cycles=CYCLES).solved_cycles is CYCLES
    with pytest.raises(ValueError, match="euler"):
        _ = RUN.solved_cycles
    failed = replace(RUN, status=Status.NOT_FINITE, cycles=CYCLES)
    for run, words in ((failed, "euler.* t = 3 s"), (replace(failed, detail="why", t=np.empty(0)), "euler.*why")):
        with pytest.raises(NumericalFailure, match=words):
            run.raise_for_status()
        with pytest.raises(NumericalFailure):
            _ = run.solved_cycles


def test_integrals_are_trapezoids_and_modes_begin_beyond_the_speed_of_stick() -> None:
    assert integral(np.array([0.0, 2.0, 4.0]), T).tolist() == [0.0, 1.0, 7.0]
    assert integral(np.ones(1), np.ones(1)).tolist() == [0.0]
    speeds = np.array([-0.6, -0.5, 0.0, 0.5, 0.6])
    assert modes_of(speeds, 0.5).tolist() == [-1, 0, 0, 0, 1]
    assert modes_of(np.array([-1e-300, 0.0, 1e-300]), 0.0).tolist() == [-1, 0, 1]
    assert event_sequence([0, 1, 2, -1]) == "S+F-"
