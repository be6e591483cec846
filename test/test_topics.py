"""The table of topics: conditions in words and as a choice, panels, and the topics that a viewer shows."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from tcc_sim.messages.definitions import type_parts
from tcc_sim.scene import load_scene
from tcc_sim.topics import FAR_END, FLOAT64, FLUID_PRESSURE, INPUTS, INT8, STRING, TOPICS, Topic, shown, topic

LAYOUT = Path(__file__).parents[1] / "config" / "plotjuggler.xml"

CONDITIONS = {
    "engine_torque": "engine.source: topic", "actuation_pressure": "pressure.source: topic",
    "held": "engine.source: topic or pressure.source: topic",
    "command": "engine.source: topic or pressure.source: topic", "applied_pressure": "pressure.source: topic",
    "slip_speed": "publish_scalars: true", "friction_torque": "publish_scalars: true",
    "stick_slip_state": "publish_scalars: true", "slip_speed_stamped": "publish_stamped: true",
    "friction_torque_stamped": "publish_stamped: true", "shaft_torque": "publish_shaft_torque: true",
    "/diagnostics": "publish_diagnostics: true", "/clock": "publish_clock: true"}


@pytest.mark.parametrize("row", TOPICS, ids=lambda row: row.name)
def test_a_topic_is_created_where_its_condition_holds(row: Topic) -> None:
    assert row.switch == CONDITIONS.get(row.name, "")
    scene = load_scene("fig02").with_values({"publish_scalars": False, "publish_diagnostics": False})
    always = row.direction != "other" and row.name not in CONDITIONS
    assert row.wanted(scene.value) is always
    for key, value in row.created_when:
        assert row.wanted(scene.with_values({key: value}).value)
    assert row.carries
    assert [each for each in TOPICS if each.name == row.name] == [topic(row.name)] == [row]
    type_parts(row.type)
    assert row.latched is (row.name in ("scene", "held", "target_slip_speed", "pressure_limits", "unsent_messages"))


def test_a_viewer_shows_the_numbers_that_joint_states_does_not_have() -> None:
    assert [row.name for row in shown()] == ["engine_torque", "actuation_pressure", "output_speed", "applied_pressure",
                                             "shaft_torque", "target_slip_speed"]
    assert [row.panel for row in shown()] == ["torque", "pressure", "far_end", "pressure", "torque", "control"]
    assert Topic("a", STRING, "", "out", (), "").panel == ""
    assert {row.name: row.key for row in TOPICS if row.key} == {
        "engine_torque": "engine.mean_torque", "actuation_pressure": "pressure.mean",
        "output_speed": "initial.plate_speed", "target_slip_speed": "initial.slip_speed"}
    assert [topic(name).direction for name in (*INPUTS, FAR_END)] == ["in"] * 3
    with pytest.raises(KeyError):
        topic("nothing")


def test_the_layout_of_plotjuggler_shows_numbers_of_topics() -> None:
    fields = {FLOAT64: "data", INT8: "data", FLUID_PRESSURE: "fluid_pressure"}
    curves = [curve.attrib["name"] for curve in ElementTree.parse(LAYOUT).iter("curve")]
    assert len(curves) == len(set(curves)) > 5
    for curve in curves:
        name, _, field = curve.strip("/").rpartition("/")
        assert field == fields[topic(name).type]
