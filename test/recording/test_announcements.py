"""Announced scenes: the comment line that says from when a scene holds is read back, and no other line counts."""

import pytest

from tcc_sim.model.profile import START, Origin
from tcc_sim.recording.announcements import SceneRecord, holding_from

TEXT = "a: 1\nb: 2\n"


@pytest.mark.parametrize("stamp", [0, 1, 7_000_000_000])
@pytest.mark.parametrize("general", [False, True])
@pytest.mark.parametrize("origin", [START, Origin(1.5, 0.1 + 0.2, -2e-9)])
@pytest.mark.parametrize("zero", [0, 1_700_000_000_000_000_000])
def test_what_is_announced_is_read_back(stamp: int, general: bool, origin: Origin, zero: int) -> None:
    result = SceneRecord(holding_from(TEXT, stamp, general, origin, zero), "1.0", 5)
    assert (result.first_stamp_ns, result.general, result.origin, result.zero_ns, result.parameters) == (
        stamp, general, origin, zero, TEXT)


@pytest.mark.parametrize("text", [
    TEXT, "", TEXT + "# holds from stamp -3 ns on\n", TEXT + "# holds from stamp 3 ns\n",
    "# holds from stamp 3 ns on\n" + TEXT])
def test_a_scene_without_such_a_line_holds_from_the_start(text: str) -> None:
    result = SceneRecord(text, "1.0", 5)
    assert (result.first_stamp_ns, result.general, result.origin, result.zero_ns, result.parameters) == (
        0, False, START, 0, text)
