"""The commander, which loads a driveline with commands."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Float64

from tcc_sim.messages import cdr
from tcc_sim.nodes import commander
from tcc_sim.scene import load_scene


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


def test_its_commands_are_those_of_the_scene_at_their_times(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: dict[str, list[bytes]] = {"engine_torque": [], "actuation_pressure": []}
    node: Any = SimpleNamespace(create_publisher=lambda kind, name, profile: SimpleNamespace(
        publish=sent[name].append, get_subscription_count=lambda: 1))
    ended = iter([True] * 3 + [False])
    for name, stub in {"await_peer": lambda met, limit: None, "log": lambda node, sentence: None,
                       "declared": lambda node, kind: SimpleNamespace(rate=200.0), "signals": SimpleNamespace(
                           end_in_order=lambda: None, end_requested=SimpleNamespace(is_set=None)),
                       "Pacer": lambda period: SimpleNamespace(wait=lambda done: period == 0.005 and next(ended)),
                       "load_scene": lambda name: load_scene(name).with_values({
                           "pressure.frequency_ratio": 2.0, "pressure.phase": 0.5, "pressure.mean": 2e5})}.items():
        monkeypatch.setattr(commander, name, stub)
    assert commander.send(node) == 0
    torques, pressures = map(cdr.read_float64, sent["engine_torque"]), map(cdr.read_fluid_pressure,
                                                                           sent["actuation_pressure"])
    times = np.arange(3) * 0.005
    np.testing.assert_allclose(list(torques), 300.0 + 250.0 * np.sin(150.0 * times), rtol=1e-14)
    np.testing.assert_allclose(list(pressures), [(0, 2e5 + 1e6 / 19.2 * np.sin(300.0 * t + 0.5)) for t in times],
                               rtol=1e-14)
