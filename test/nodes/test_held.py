"""The topic `held` and the names of runs, as another node receives them, against the commands that were sent."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from benches import Commander
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Float64MultiArray, String

TICK, FIELDS = 1_000_000, ("source", "value", "applied", "stamp", "since", "publisher", "received", "superseded",
                           "refused", "lost")
INPUTS = "engine_torque", "actuation_pressure", "output_speed", "target_slip_speed"
SCENE, FALLBACK, COMMAND, NOBODY = range(4)
NAME = r"[0-9a-f]{12}\.[0-9]{3}"


class Chain:
    """A driveline stepped tick by tick, a sender, and all that a listener heard."""

    def __init__(self, bench: Any, **parameters: object) -> None:
        self.bench = bench
        latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.heard = {name: bench.listen(kind, name, qos) for name, kind, qos in (
            ("held", Float64MultiArray, latched), ("scene", String, latched), ("joint_states", JointState, None),
            ("applied_pressure", FluidPressure, None), ("output_state", JointState, None))}
        self.node = bench.driveline(publish_diagnostics=False, command_timeout=0.0, **parameters)
        self.loop = self.node.loop
        self.loop.begin()
        self.states = 1

    def until(self, there: Callable[[], object]) -> None:
        """Step until a condition holds."""
        self.bench.until(lambda: self.step() or there())

    def step(self) -> None:
        self.loop.step()
        self.states += 1

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.step()

    def reset(self) -> None:
        self.loop.reset()
        self.states += 1

    def rows(self) -> list[dict[str, Any]]:
        """The messages on held: run, tick, ns, number, last, and a dictionary for each input."""
        self.loop.stop()
        pressed = "actuation_pressure" in self.loop.inputs
        self.bench.until(lambda: len(self.heard["joint_states"]) == self.states
                         and len(self.heard["applied_pressure"]) == pressed * self.states)
        out = []
        for message in self.heard["held"]:
            (dimension,), data = message.layout.dim, np.array(message.data)
            label = re.fullmatch(rf"held 1 ({NAME})", dimension.label)
            assert label is not None
            assert (dimension.size, dimension.stride, len(data)) == (44, 44, 44)
            out.append({"run": label[1], **dict(zip(("tick", "ns", "number", "last"), data[:4].tolist())),
                        **{name: dict(zip(FIELDS, data[4 + 10 * k:14 + 10 * k].tolist()))
                           for k, name in enumerate(INPUTS)}})
        return out


def tick_of(message: Any) -> int:
    """The tick of a stamped message."""
    return round((message.header.stamp.sec * 10**9 + message.header.stamp.nanosec) / TICK)


def test_a_message_holds_until_the_next_and_tells_whose_command_acts_since_which_tick(bench: Any) -> None:
    chain = Chain(bench, scene="commands", engine__fallback="mean", pressure__fallback="mean",
                  pressure__time_constant=0.02)
    one, other = Commander(bench), Commander(bench)
    chain.run(250)
    torque, pressure = chain.loop.commands
    for k, sender in enumerate((one, other, one)):
        sender.torques.publish(Float64(data=100.0 + k))
        chain.until(lambda k=k: torque.received == k + 1)
    command = FluidPressure(fluid_pressure=1.5e5)
    command.header.stamp.nanosec = 7 * TICK
    for _ in range(3):
        one.pressures.publish(command)
    other.torques.publish(Float64(data=math.nan))
    chain.until(lambda: pressure.received == 3 and torque.refused == 1)
    chain.run(130)
    rows = chain.rows()
    assert [row["number"] for row in rows] == list(range(1, len(rows) + 1))
    assert all(row["ns"] == TICK * row["tick"] for row in rows)
    ticks = [row["tick"] for row in rows]
    assert ticks[0] == 0
    assert max(np.diff(ticks)) <= 100
    states = {tick_of(state): state for state in chain.heard["joint_states"]}
    applied = {tick_of(message): message.fluid_pressure for message in chain.heard["applied_pressure"]}
    for k, state in states.items():
        row = rows[int(np.searchsorted(ticks, k, side="right")) - 1]
        engine, clutch = row["engine_torque"], row["actuation_pressure"]
        assert (engine["source"], clutch["source"]) == tuple(
            COMMAND if math.isfinite(one["value"]) else FALLBACK for one in (engine, clutch))
        assert state.effort[0] == (engine["value"] if engine["source"] == COMMAND else 300.0)
        assert clutch["applied"] == applied[k]
        assert not engine["since"] > k
        assert row["output_speed"]["source"] == row["target_slip_speed"]["source"] == NOBODY
    held = {row["engine_torque"]["since"]: row["engine_torque"] for row in rows if row["engine_torque"]["source"] == 2}
    assert [(one["value"], one["publisher"], one["received"]) for one in held.values()] == [
        (100.0, 1.0, 1.0), (101.0, 2.0, 2.0), (102.0, 1.0, 3.0)]
    for since, one in held.items():
        assert states[since].effort[0] == one["value"] != states[since - 1].effort[0]
    end = rows[-1]
    assert (end["engine_torque"]["refused"], end["engine_torque"]["lost"]) == (1.0, 0.0)
    acted = {row["actuation_pressure"]["since"] for row in rows} - {math.nan}
    acted = {since for since in acted if math.isfinite(since)}
    assert end["actuation_pressure"]["received"] - end["actuation_pressure"]["superseded"] == len(acted)
    assert end["actuation_pressure"]["stamp"] == 7 * TICK


def test_a_reset_begins_another_run_whose_counts_begin_and_the_name_is_in_every_frame(bench: Any) -> None:
    chain = Chain(bench, scene="commands", stamp="wall")
    sender = Commander(bench)
    for k in range(2):
        sender.torques.publish(Float64(data=50.0))
        chain.until(lambda k=k: chain.loop.inputs["engine_torque"].received == k + 1)
        if not k:
            ended = chain.loop.plant.stepper.tick
            chain.reset()
            chain.run(5)
    rows = chain.rows()
    runs = list(dict.fromkeys(row["run"] for row in rows))
    assert [run[-4:] for run in runs] == [".001", ".002"]
    assert runs[0][:12] == runs[1][:12]
    (last,) = [row for row in rows if row["last"]]
    assert (last["run"], last["tick"]) == (runs[0], ended)
    for run in runs:
        mine = [row for row in rows if row["run"] == run]
        assert (mine[0]["tick"], mine[0]["number"], mine[0]["engine_torque"]["received"]) == (0, 1, 0)
        assert (mine[-1]["engine_torque"]["received"], mine[-1]["engine_torque"]["publisher"]) == (1, 1)
    for name in ("joint_states", "applied_pressure"):
        assert list(dict.fromkeys(message.header.frame_id for message in chain.heard[name])) == runs
    lines = [text.data.rstrip("\n").rpartition("\n")[2] for text in chain.heard["scene"]]
    assert {line.partition(",")[0] for line in lines} == {f"# run {run} of /driveline" for run in runs}
    assert all(", holds from stamp 0 ns on" in line for line in lines)


def test_a_pause_is_stated_once_with_the_tick_before_it(bench: Any) -> None:
    chain = Chain(bench, scene="commands")
    chain.run(30)
    for _ in range(2):
        chain.loop.pause(True)
    chain.run(3)
    chain.loop.pause(False)
    chain.run(50)
    assert [row["tick"] for row in chain.rows() if row["last"] == 2.0] == [30]


def test_inputs_that_join_are_reported_from_then_on(bench: Any) -> None:
    chain = Chain(bench, scene="slip")
    chain.run(20)
    assert not chain.heard["held"]
    speed = chain.bench.node("vehicle").create_publisher(Float64, "output_speed", 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    target = chain.bench.node("controller").create_publisher(Float64, "target_slip_speed", latched)
    target.publish(Float64(data=20.0))

    def joined() -> bool:
        speed.publish(Float64(data=3.0))
        chain.node.housekeeping()
        chain.step()
        inputs = chain.loop.inputs
        return bool("target_slip_speed" in inputs and "output_speed" in inputs and inputs["output_speed"].value)

    chain.bench.until(joined)
    chain.until(lambda: chain.loop.inputs["target_slip_speed"].received)
    chain.run(150)
    rows = chain.rows()
    end = rows[-1]
    assert (end["target_slip_speed"]["source"], end["target_slip_speed"]["value"]) == (COMMAND, 20.0)
    assert (end["output_speed"]["source"], end["output_speed"]["value"]) == (COMMAND, 3.0)
    assert end["engine_torque"]["source"] == end["actuation_pressure"]["source"] == SCENE
    first = chain.heard["output_state"][0]
    assert first.header.frame_id == end["run"]
