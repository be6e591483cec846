"""Cycles, runs and trajectories: parts of them, joined and selected, with numbers that say where they were."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.parameters import System
from tcc_sim.model.parameters import replace as changed
from tcc_sim.trajectory import (
    UNITS,
    Cycles,
    Loads,
    Runs,
    State,
    Statistics,
    Status,
    Trajectory,
    Transitions,
    concatenated,
    event_sequence,
    integral,
    joined_runs,
    modes_of,
    no_cycles,
    split_cycles,
)

N = np.arange(5.0)
LOADS = Loads(*(100.0 * k + N for k in range(6)))
CYCLES = Cycles(np.stack([np.arange(6.0)] * 3, axis=1), N, -2.0 * N, 10.0 + N, LOADS, 20.0 + np.arange(6.0))
RUNS = Runs("euler", np.arange(36.0).reshape(2, 6, 3), *(10.0 * k + np.arange(10.0).reshape(2, 5) for k in range(3)),
            np.arange(60.0).reshape(2, 6, 5), np.array([1.0, 2.0]), np.array([True, False]))


def numbers(cycles: Cycles) -> list[Any]:
    """Every array of some cycles as lists; the section by its first column."""
    return [cycles.section[:, 0].tolist(), *(column.tolist() for column in (cycles.highest, cycles.lowest,
                                                                           cycles.stick_time)),
            None if cycles.loads is None else [column.tolist() for column in cycles.loads.columns()],
            None if cycles.starts is None else cycles.starts.tolist()]


def expected(first: int, last: int) -> list[Any]:
    """The same of cycles `first` to `last` - 1 by their numbers."""
    each, ends = [float(k) for k in range(first, last)], [float(k) for k in range(first, last + 1)]
    return [ends, each, [-2.0 * k for k in each], [10.0 + k for k in each],
            [[100.0 * j + k for k in each] for j in range(6)], [20.0 + k for k in ends]]


@pytest.mark.parametrize(("part", "first", "last"), [
    (slice(None), 0, 5), (slice(1, 3), 1, 3), (slice(2, None), 2, 5), (slice(None, 9), 0, 5), (slice(-2, None), 3, 5),
    (slice(4, 4), 4, 4), (slice(4, 2), 4, 4), (slice(7, None), 5, 5)])
def test_a_range_of_cycles_has_their_sections_on_both_sides(part: slice, first: int, last: int) -> None:
    assert numbers(CYCLES[part]) == expected(first, last)
    bare = replace(CYCLES, loads=None, starts=None)[part]
    assert numbers(bare) == [*expected(first, last)[:4], None, None]
    assert len(bare) == last - first


def test_cycles_are_taken_in_a_row_and_joined_again() -> None:
    for stride in (2, -1):
        with pytest.raises(ValueError, match="must be consecutive"):
            CYCLES[::stride]
    assert CYCLES.largest.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert (-CYCLES.highest.min(), replace(CYCLES, highest=-3.0 * N).largest.tolist()) == (0.0, (3.0 * N).tolist())
    assert numbers(concatenated([CYCLES[:2], CYCLES[2:3], CYCLES[3:]])) == expected(0, 5)
    assert numbers(concatenated([CYCLES[1:3]])) == expected(1, 3)
    some = concatenated([CYCLES[:2], replace(CYCLES[2:], loads=None)])
    assert numbers(some) == [*expected(0, 5)[:4], None, expected(0, 5)[5]]
    assert numbers(concatenated([replace(CYCLES[:2], starts=None), CYCLES[2:]])) == [*expected(0, 5)[:5], None]
    whole, rest = split_cycles(CYCLES, 4)
    assert (numbers(whole), rest and numbers(rest)) == (expected(0, 4), expected(4, 5))
    assert split_cycles(CYCLES, 5)[1] is None
    nothing = no_cycles()
    assert (len(nothing), nothing.section.shape, nothing.starts is not None and len(nothing.starts)) == (0, (0, 3), 0)
    assert nothing.loads is None


def test_one_of_many_runs_has_its_row_of_every_array() -> None:
    one = RUNS.cycles(1)
    assert one.section.tolist() == RUNS.section[1].tolist()
    assert (one.highest[0], one.lowest[0], one.stick_time[0]) == (5.0, 15.0, 25.0)
    assert one.loads is not None
    assert [column[0] for column in one.loads.columns()] == [30.0, 35.0, 40.0, 45.0, 50.0, 55.0]
    assert (one.loads.energy[1], one.loads.coupling_energy[4]) == (31.0, 59.0)
    assert replace(RUNS, loads=None).cycles(0).loads is None


@pytest.mark.parametrize(("chosen", "first"), [([0, 1], 0), ([0, 1], 2), ([1], 1), ([1, 0], 0), ([], 0)])
def test_chosen_runs_keep_their_order_and_begin_at_a_cycle(chosen: list[int], first: int) -> None:
    for loads in (RUNS.loads, None):
        part = replace(RUNS, loads=loads).chosen(chosen, first)
        assert part.solver == "euler"
        for name in ("section", "highest", "lowest", "stick_time"):
            np.testing.assert_array_equal(getattr(part, name), getattr(RUNS, name)[chosen][:, first:])
        for name in ("seconds", "done"):
            np.testing.assert_array_equal(getattr(part, name), getattr(RUNS, name)[chosen])
        if loads is None:
            assert part.loads is None
        else:
            np.testing.assert_array_equal(part.loads, loads[chosen][:, :, first:])


def test_successive_cycles_of_runs_are_joined_and_their_times_added() -> None:
    early = replace(RUNS.chosen([0, 1]), section=RUNS.section[:, :3], highest=RUNS.highest[:, :2],
                    lowest=RUNS.lowest[:, :2], stick_time=RUNS.stick_time[:, :2], loads=RUNS.loads[:, :, :2],
                    done=np.array([True, True]))
    late = RUNS.chosen([0, 1], 2)
    both = joined_runs([early, late])
    for name in ("section", "highest", "lowest", "stick_time", "loads", "done"):
        np.testing.assert_array_equal(getattr(both, name), getattr(RUNS, name))
    assert both.seconds.tolist() == [2.0, 4.0]
    assert joined_runs([early, replace(late, loads=None)]).loads is None
    assert joined_runs([late]) is late


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
    assert list(RUN.columns()) == ["t", "slip_speed", "plate_angle", "plate_speed", "engine_torque",
                                   "saturation_torque", "friction_torque", "state"]
    wet = replace(RUN, system=changed(System(), {"converter.coupling": 0.5}), output_angle=T, output_speed=np.ones(3))
    assert list(wet.columns())[8:] == ["output_angle", "output_speed", "coupling_torque"]
    assert wet.columns()["coupling_torque"].tolist() == [0.5, -1.0, 0.0]
    assert UNITS == {"t": "s", "slip_speed": "rad/s", "plate_angle": "rad", "plate_speed": "rad/s",
                     "engine_torque": "N m", "saturation_torque": "N m", "friction_torque": "N m", "state": "",
                     "output_angle": "rad", "output_speed": "rad/s", "coupling_torque": "N m"}
    assert replace(wet, system=None).coupling_torque is RUN.coupling_torque is None
    assert repr(RUN) == "<Trajectory by euler: 3 samples over 3 s; reached the end>"
    late = replace(RUN, t=T + 7.0, cycles=CYCLES[:1])
    assert repr(late) == "<Trajectory by euler: 3 samples over 3 s, 1 period of excitation; reached the end>"
    none = replace(RUN, t=np.empty(0), status=Status.REFUSED)
    assert repr(none) == "<Trajectory by euler: 0 samples over no time; not started: the solver cannot do this case>"
    assert RUN.statistics == Statistics(0, 0, 0, 0, 0, 0.0)
    assert [column.dtype for column in vars(Transitions.none()).values()] == [np.float64, np.int8, np.int8]


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
    with pytest.raises(ValueError, match=r"^euler computes no cycles$"):
        _ = RUN.solved_cycles
    failed = replace(RUN, status=Status.NOT_FINITE, cycles=CYCLES)
    for run, sentence in ((failed, "euler: stopped: the state is no longer finite at t = 3 s"),
                          (replace(failed, detail="why", t=np.empty(0)),
                           "euler: stopped: the state is no longer finite; why")):
        with pytest.raises(NumericalFailure, match=f"^{sentence}$"):
            run.raise_for_status()
        with pytest.raises(NumericalFailure):
            _ = run.solved_cycles


def test_integrals_are_trapezoids_and_modes_begin_beyond_the_speed_of_stick() -> None:
    assert integral(np.array([0.0, 2.0, 4.0]), T).tolist() == [0.0, 1.0, 7.0]
    assert integral(np.ones(1), np.ones(1)).tolist() == [0.0]
    speeds = np.array([-0.6, -0.5, 0.0, 0.5, 0.6])
    assert modes_of(speeds, 0.5).tolist() == [-1, 0, 0, 0, 1]
    assert modes_of(speeds, 0.5).dtype == np.int8
    assert modes_of(np.array([-1e-300, 0.0, 1e-300]), 0.0).tolist() == [-1, 0, 1]
    assert event_sequence([0, 1, 2, -1]) == "S+F-"
