"""Announced scenes: the comment line that says from when a scene holds is read back, and no other line counts."""


import numpy as np
import pytest

from tcc_sim.model.profile import START, Origin
from tcc_sim.recording.announcements import SceneRecord, holding_from, simulation_ns, zeros_of

NO_ZEROS = np.empty(0, np.int64)
TEXT = "a: 1\nb: 2\n"


@pytest.mark.parametrize("stamp", [0, 1, 7_000_000_000])
@pytest.mark.parametrize("origin", [START, Origin(1.5, 0.1 + 0.2, -2e-9)])
@pytest.mark.parametrize("zero", [0, 1_700_000_000_000_000_000])
def test_what_is_announced_is_read_back(stamp: int, origin: Origin, zero: int) -> None:
    result = SceneRecord(holding_from(TEXT, stamp, origin, zero), "1.0", 5)
    assert (result.first_stamp_ns, result.origin, result.zero_ns, result.parameters) == (
        stamp, origin, zero, TEXT)


@pytest.mark.parametrize("text", [
    TEXT, "", TEXT + "# holds from stamp -3 ns on\n", TEXT + "# holds from stamp 3 ns\n",
    "# holds from stamp 3 ns on\n" + TEXT])
def test_a_scene_without_such_a_line_holds_from_the_start(text: str) -> None:
    result = SceneRecord(text, "1.0", 5)
    assert (result.first_stamp_ns, result.origin, result.zero_ns, result.parameters) == (
        0, START, 0, text)


@pytest.mark.parametrize(("line", "first", "zero", "origin"), [
    (f"# holds from stamp 3 ns on, simulation time 0 is {(1 << 62) - 1} ns of the wall clock", 3, (1 << 62) - 1, START),
    (f"# holds from stamp 3 ns on, simulation time 0 is {1 << 62} ns of the wall clock", 3, 0, START),  # No stamp is.
    ("# holds from stamp 3 ns on, phase 1.5 rad at 2.5 s, the load's ahead by -1e-3 rad", 3, 0, Origin(2.5, 1.5,
     -1e-3)),
    ("# holds from stamp 3 ns on, phase 1-5 rad at 2.5 s, the load's ahead by 1 rad", 3, 0, START)])
def test_numbers_in_the_line_are_read_if_they_are_numbers(line: str, first: int, zero: int, origin: Origin) -> None:
    result = SceneRecord(f"{TEXT}{line}\n", "1.0", 5)
    assert (result.first_stamp_ns, result.zero_ns, result.origin, result.parameters) == (first, zero, origin, TEXT)


def test_stamps_of_the_wall_clock_count_from_the_last_zero_before_them() -> None:
    zeros = zeros_of([TEXT, *(holding_from(TEXT, 0, START, zero) for zero in (500, 200, 500))])
    assert zeros.tolist() == [200, 500]
    stamps = np.array([0, 199, 200, 201, 499, 500, 900])
    assert simulation_ns(stamps, zeros).tolist() == [0, 199, 0, 1, 299, 0, 400]
    assert simulation_ns(stamps, zeros_of([TEXT])) is stamps
