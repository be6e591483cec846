"""Announced scenes: the comment line that says from when a scene holds is read back, and no other line counts."""


import numpy as np
import pytest

from tcc_sim.model.profile import START, Origin
from tcc_sim.recording.announcements import SceneRecord, holding_from, simulation_ns, zeros_of

NO_ZEROS = np.empty(0, np.int64)
TEXT = "a: 1\nb: 2\n"


LINE, SHIFTED = f"{TEXT}# holds from stamp 3 ns on", Origin(1.5, 0.1 + 0.2, -2e-9)
OTHERS = [TEXT, "", f"{TEXT}# holds from stamp -3 ns on\n", f"{TEXT}# holds from stamp 3 ns\n",
          f"# holds from stamp 3 ns on\n{TEXT}"]


@pytest.mark.parametrize(("text", "first", "zero", "origin", "parameters"), [
    *((holding_from(TEXT, stamp, origin, zero), stamp, zero, origin, TEXT) for stamp in (0, 1, 7_000_000_000)
      for origin in (START, SHIFTED) for zero in (0, 1_700_000_000_000_000_000)),
    *((text, 0, 0, START, text) for text in OTHERS),
    (f"{LINE}, simulation time 0 is {(1 << 62) - 1} ns of the wall clock\n", 3, (1 << 62) - 1, START, TEXT),
    (f"{LINE}, simulation time 0 is {1 << 62} ns of the wall clock\n", 3, 0, START, TEXT),  # No stamp is.
    (f"{LINE}, phase 1.5 rad at 2.5 s, the load's ahead by -1e-3 rad\n", 3, 0, Origin(2.5, 1.5, -1e-3), TEXT),
    (f"{LINE}, phase 1-5 rad at 2.5 s, the load's ahead by 1 rad\n", 3, 0, START, TEXT)])
def test_what_is_announced_is_read_back_and_no_other_line(text: str, first: int, zero: int, origin: Origin,
                                                          parameters: str) -> None:
    result = SceneRecord(text, "1.0", 5)
    assert (result.first_stamp_ns, result.zero_ns, result.origin, result.parameters) == (
        first, zero, origin, parameters)


def test_stamps_of_the_wall_clock_count_from_the_last_zero_before_them() -> None:
    zeros = zeros_of([TEXT, *(holding_from(TEXT, 0, START, zero) for zero in (500, 200, 500))])
    assert zeros.tolist() == [200, 500]
    stamps = np.array([0, 199, 200, 201, 499, 500, 900])
    assert simulation_ns(stamps, zeros).tolist() == [0, 199, 0, 1, 299, 0, 400]
    assert simulation_ns(stamps, zeros_of([TEXT])) is stamps
