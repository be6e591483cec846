"""The commander, which loads a driveline with commands."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Float64

from tcc_sim.nodes import commander


def test_it_sends_nothing_before_a_driveline_subscribes_to_both_commands(
        bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    met: list[Callable[[], object]] = []
    monkeypatch.setattr(commander, "await_peer", lambda connected, limit: met.append(connected))
    ended = threading.Event()
    ended.set()
    monkeypatch.setattr(commander.signals, "end_requested", ended)
    assert commander.send(bench.node("commander")) == 0
    (connected,) = met
    assert not connected()
    bench.listen(Float64, "engine_torque")
    pressures = bench.listen(FluidPressure, "actuation_pressure")
    bench.until(connected)
    assert not pressures
