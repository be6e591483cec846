"""Any bytes sent to a live driveline leave its state finite; time goes on, and diagnostics count each refusal."""

from __future__ import annotations

import math
import random
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benches import Commander

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, String

from tcc_sim.messages import cdr
from tcc_sim.nodes.driveline import DrivelineNode
from tcc_sim.nodes.middleware import COMMANDS, poll, states, subscribe
from tcc_sim.nodes.recorder import Recorder
from tcc_sim.recording.reader import Run


def driveline(bench: Any, namespace: str = "", **parameters: object) -> DrivelineNode:
    return bench.driveline(namespace, **{"scene": "commands", "engine.fallback": "mean", "pressure.fallback": "mean",
                                         "publish_scalars": False, "wait_for_subscribers": 1, **parameters})


class Attacker(Commander):
    """Sends raw bytes to both inputs and hears joint_states."""

    def __init__(self, bench: Any, namespace: str = "") -> None:
        super().__init__(bench, namespace, connected=False)
        self.subscription = subscribe(self.node, JointState, "joint_states", states(20_000))
        self.stamps: list[int] = []
        self.values: list[tuple[float, ...]] = []

    def hear(self) -> int:
        for data, _ in poll(self.subscription):
            (row,) = cdr.own_records([data], "joint_states")
            self.stamps.append(int(row["sec"]) * 10**9 + int(row["nanosec"]))
            self.values.append(tuple(float(row[name]) for name in row.dtype.names[2:]))
        return len(self.stamps)


def refusals(bench: Any, node: DrivelineNode) -> dict[str, int]:
    """The refusals by topic in the next message on /diagnostics."""
    heard = bench.listen(DiagnosticArray, "/diagnostics")
    status = bench.until(lambda: (node.housekeeping(), heard)[1])[-1].status[0]
    return {item.key.split()[0]: int(item.value) for item in status.values if item.key.endswith(" refused")}


def test_senseless_commands_leave_the_state_finite_and_are_counted(bench: Any) -> None:
    node, attacker = driveline(bench, command_timeout=0.0), Attacker(bench)
    node.start()
    bench.until(attacker.ready)
    torques = [math.nan, -math.nan, math.inf, -math.inf, 1e308, -1e308, 1.0001e5, -1.0001e5]
    pressures = [math.nan, math.inf, -math.inf, 1e308, -1e308, -1.0, -5e-324, 1.0001e7]
    broken = [cdr.HEADER, cdr.float64(1.0), b"\0\0" + cdr.fluid_pressure(0, 1e5)[2:], cdr.fluid_pressure(0, 1e5)[:20],
              struct.pack("<4siII", cdr.HEADER, 0, 0, 0xFFFFFFFF) + bytes(16),
              struct.pack("<4siII", cdr.HEADER, 0, 0, 1 << 31)]
    for value in torques:
        attacker.torques.publish(cdr.float64(value))
    for value in pressures:
        attacker.pressures.publish(cdr.fluid_pressure(0, value))
    for data in broken:
        attacker.pressures.publish(data)
    torque, pressure = node.loop.commands
    expected = {"engine_torque": len(torques), "actuation_pressure": len(pressures) + len(broken)}
    bench.until(lambda: attacker.hear() and (torque.refused, pressure.refused) == tuple(expected.values()))
    assert refusals(bench, node) == expected
    assert (torque.value, torque.received, pressure.value, pressure.received) == (None, 0, None, 0)
    # In real time, tiny values and distant stamps are valid.
    smallest = [5e-324, -5e-324, 0.0, -0.0, 2.2e-308]
    for value in smallest:
        attacker.torques.publish(cdr.float64(value))
    for stamp in (0, 1, -(2**31) * 10**9, (2**31 - 1) * 10**9 + 999_999_999):
        attacker.pressures.publish(cdr.fluid_pressure(stamp, 5e-324))
    bench.until(lambda: torque.received == len(smallest) and pressure.value == 5e-324)
    count = attacker.hear()
    bench.until(lambda: attacker.hear() > count + 50)
    assert attacker.stamps == [k * 1_000_000 for k in range(len(attacker.stamps))]
    assert np.all(np.isfinite(attacker.values))
    assert node.loop.plant.stepper.iterations_most <= node.loop.plant.stepper.iterations_bound


def test_a_flood_from_two_publishers_is_taken_without_a_missing_tick(bench: Any) -> None:
    """Two floods of 5000 commands: each is applied or replaced by a newer one, and time goes on."""
    node, attacker = driveline(bench, command_timeout=0.0), Attacker(bench)
    other = attacker.node.create_publisher(Float64, "engine_torque", COMMANDS)
    node.start()
    bench.until(lambda: attacker.ready() and other.get_subscription_count())
    draw = random.Random(3)
    for _ in range(5000):
        attacker.torques.publish(cdr.float64(draw.choice([100.0, 200.0, math.nan])))
        other.publish(cdr.float64(draw.choice([-100.0, 1e308])))
    attacker.torques.publish(cdr.float64(77.0))
    bench.until(lambda: attacker.hear() and attacker.values[-1][4] == 77.0)
    assert attacker.stamps == [k * 1_000_000 for k in range(len(attacker.stamps))]
    assert np.all(np.isfinite(attacker.values))
    assert {value[4] for value in attacker.values} <= {300.0, 100.0, 200.0, -100.0, 77.0}
    torque = node.loop.inputs["engine_torque"]
    assert torque is not None
    assert 0 < torque.refused + torque.received <= 10_001
    assert refusals(bench, node)["engine_torque"] == torque.refused > 0


def test_another_message_type_on_the_same_name_is_not_taken(bench: Any, monkeypatch: pytest.MonkeyPatch,
                                                            domain: str) -> None:
    """The publisher is another participant's; within one, Fast DDS refuses to create it."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    matching, foreign = type(bench)(), type(bench)()
    try:
        wrong = foreign.node("stranger").create_publisher(
            String, "engine_torque", COMMANDS)
        node, attacker = driveline(matching), Attacker(matching)
        node.start()
        matching.until(lambda: attacker.ready() and node.count_publishers("engine_torque") == 2)
        for _ in range(10):
            wrong.publish(String(data="as much as you can"))
        attacker.torques.publish(cdr.float64(55.0))
        matching.until(lambda: attacker.hear() and attacker.values[-1][4] == 55.0)
        torque = node.loop.inputs["engine_torque"]
        assert torque is not None
        assert (torque.received, torque.refused) == (1, 0)
    finally:
        matching.close()
        foreign.close()


def test_in_lockstep_a_stamp_of_no_waiting_state_is_refused_and_counted(bench: Any) -> None:
    node = driveline(bench, pacing="lockstep", command_timeout=0.0, engine__source="harmonic")
    attacker = bench.node("attacker")
    pressures = attacker.create_publisher(FluidPressure, "actuation_pressure", COMMANDS)
    subscription = subscribe(attacker, JointState, "joint_states", states(100))
    node.start()
    bench.until(pressures.get_subscription_count)
    bench.until(lambda: poll(subscription))
    for stamp in (-10**9, 1, 1_000_000, (2**31 - 1) * 10**9):
        pressures.publish(cdr.fluid_pressure(stamp, 1e5))
    command = node.loop.inputs["actuation_pressure"]
    assert command is not None
    bench.until(lambda: command.refused == 4)
    assert (node.loop.plant.stepper.tick, command.received) == (0, 0)
    assert all(part in command.refusal for part in ("actuation_pressure", f"{2**31 - 1:.9g} s", " 0 s"))
    pressures.publish(cdr.fluid_pressure(0, 2e5))
    bench.until(lambda: poll(subscription))
    assert (node.loop.plant.stepper.tick, command.value) == (1, 2e5)
    assert refusals(bench, node) == {"actuation_pressure": 4}


def test_eight_drivelines_in_namespaces_keep_apart(bench: Any, tmp_path: Path) -> None:
    """Each has its own command and scene; a recorder records its namespace alone."""
    attackers = [Attacker(bench, f"/d{k}") for k in range(8)]
    recorder = Recorder(bench.node("recorder", "/d3", output=str(tmp_path / "run"),
                                   topics=["scene", "joint_states", "engine_torque"]))
    nodes = [driveline(bench, f"/d{k}", rate=200.0, command_timeout=0.0, initial__slip_speed=10.0 + k)
             for k in range(8)]
    for node in nodes:
        node.start()
    bench.until(lambda: all(attacker.ready() for attacker in attackers))
    for k, attacker in enumerate(attackers):
        attacker.torques.publish(cdr.float64(100.0 + k))
    bench.until(lambda: min(attacker.hear() for attacker in attackers) > 40 and all(
        attacker.values[-1][4] == 100.0 + k for k, attacker in enumerate(attackers)))
    for k, (node, attacker) in enumerate(zip(nodes, attackers)):
        assert {value[4] for value in attacker.values} <= {300.0, 100.0 + k}
        assert attacker.values[0][2] == 10.0 + k
        assert attacker.stamps == [n * 5_000_000 for n in range(len(attacker.stamps))]
        assert [command.received for command in node.loop.commands] == [1, 0]
        node.loop.stop()
    recorder.drain()
    recorder.close()
    run = Run(tmp_path / "run")
    assert set(run.topics) == {"/d3/scene", "/d3/joint_states", "/d3/engine_torque"}
    batches = list(run.columns().runs)
    assert {float(x) for batch in batches for x in batch.engine_torque} <= {300.0, 103.0}
    assert [scene.text.count("slip_speed: 13.0") for scene in run.scenes] == [1]
