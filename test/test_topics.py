"""The table of topics: conditions in words and as a choice, and the topics that a viewer shows."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from tcc_sim.messages.definitions import type_parts
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLOAT64, FLUID_PRESSURE, INT8, TOPICS, Topic, topic

LAYOUT = Path(__file__).parents[1] / "config" / "plotjuggler.xml"


@pytest.mark.parametrize("row", TOPICS, ids=lambda row: row.name)
def test_a_topic_is_created_where_its_condition_holds(row: Topic) -> None:
    scene = load_scene("fig02").with_values({"publish_scalars": False, "publish_diagnostics": False})
    assert row.wanted(scene.value) is (row.direction != "other" and not row.created_when)
    assert all(key in row.switch for key, _ in row.created_when)
    for key, value in row.created_when:
        assert row.wanted(scene.with_values({key: value}).value)
    assert row.carries
    assert [each for each in TOPICS if each.name == row.name] == [topic(row.name)] == [row]
    type_parts(row.type)
    assert row.latched is (row.name in ("scene", "held", "target_slip_speed", "pressure_limits", "unsent_messages"))


def test_the_layout_of_plotjuggler_shows_numbers_of_topics() -> None:
    fields = {FLOAT64: "data", INT8: "data", FLUID_PRESSURE: "fluid_pressure"}
    curves = [curve.attrib["name"] for curve in ElementTree.parse(LAYOUT).iter("curve")]
    assert len(curves) == len(set(curves)) > 5
    for curve in curves:
        name, _, field = curve.strip("/").rpartition("/")
        assert field == fields[topic(name).type]
