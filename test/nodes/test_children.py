"""What child processes are given, without starting any."""

from __future__ import annotations

import pytest

from tcc_sim.nodes.children import isolated_environment


def test_nodes_get_a_domain_of_their_own_unless_the_user_has_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    found = [isolated_environment() for _ in range(300)]
    domains = {int(environment["ROS_DOMAIN_ID"]) for environment in found}
    assert len(domains) > 50
    assert min(domains) >= 1
    assert max(domains) <= 101
    assert {environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] for environment in found} == {"LOCALHOST"}
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    chosen = isolated_environment()
    assert (chosen["ROS_DOMAIN_ID"], chosen["ROS_AUTOMATIC_DISCOVERY_RANGE"]) == ("7", "SUBNET")
