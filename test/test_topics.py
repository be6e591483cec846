"""The table of topics."""

import pytest

from tcc_sim.messages.definitions import type_parts
from tcc_sim.topics import JOINT_NAMES, TOPICS, topic


def test_every_row_is_whole_and_found_by_its_name():
    assert len({row.name for row in TOPICS}) == len(TOPICS)
    assert len({row.view for row in TOPICS if row.view}) == sum(bool(row.view) for row in TOPICS)
    for row in TOPICS:
        assert topic(row.name) is row
        assert row.direction in ("in", "out", "beside")
        assert row.carries
        type_parts(row.type)
    assert [row.name for row in TOPICS if row.direction == "in"] == [
        "engine_torque", "actuation_pressure", "output_speed"]
    assert [row.name for row in TOPICS if row.direction == "beside"] == [
        "output_state", "target_slip_speed", "unsent_messages"]
    assert JOINT_NAMES == ("flywheel", "clutch_plate")
    with pytest.raises(KeyError):
        topic("clutch")
