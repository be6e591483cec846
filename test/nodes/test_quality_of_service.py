"""The page's table of the quality of service agrees with the driveline's profiles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from tcc_sim.nodes.loop_topics import CommandedInput
from tcc_sim.topics import TOPICS, topic


def test_the_page_says_the_quality_of_service_that_is_offered(bench: Any) -> None:
    page = (Path(__file__).parents[2] / ".github" / "guide" / "nodes.md").read_text().split("Quality of service, as")[1]
    said = {}
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 4 and cells[0].startswith("`"):
            said |= {name.strip("`/ "): cells[1:] for name in cells[0].split(",")}
        elif said:
            break
    patient = bench.driveline(scene="commands", publish_shaft_torque=True, pacing="lockstep")
    node = bench.driveline(scene="commands", publish_shaft_torque=True)
    for one in (patient, node):
        one.loop.clock.begin()
        one.loop.attach(CommandedInput(one, topic("output_speed")))
    kept = {p.topic_name.strip("/"): p.qos_profile.history.name for p in patient.publishers}
    node.loop.outputs.unsent["joint_states"] = 1
    node.loop.outputs.tell_unsent()
    ends = {end.topic_name.strip("/"): end.qos_profile for end in (*node.publishers, *node.subscriptions)}
    assert set(said) == {row.name.strip("/") for row in TOPICS}
    for name, (reliability, durability, history) in said.items():
        if name == "target_slip_speed":  # From the controller.
            continue
        profile = ends[name]
        assert reliability == profile.reliability.name.lower()
        assert durability == profile.durability.name.lower().replace("_", " ")
        if history.startswith("the last 0.25 s"):
            assert (profile.depth, kept[name]) == (250, "KEEP_ALL")
        else:
            assert history == f"last {profile.depth}"
