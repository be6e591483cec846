"""/clock: published on request or, in lock-step, where a node listens; never beside another publisher."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from benches import stamp_of
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState
from test_waiting import begun

import tcc_sim
from tcc_sim.messages import cdr
from tcc_sim.nodes.recorder import Recorder

PERIOD_NS, TICK = 10_000_000, 1_000_000


class Timed(Node):
    """A controller with a timer of 10 ms of simulation time; its command waits for the state of the timer's time."""

    def __init__(self, context: Any) -> None:
        super().__init__("timed", context=context, parameter_overrides=[Parameter("use_sim_time", value=True)])
        self.due, self.slip, self.times = 0, {}, []
        self.publisher = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(JointState, "joint_states", self.on_state, 100)
        self.create_timer(0.01, self.on_timer)

    def on_timer(self) -> None:
        self.due = self.get_clock().now().nanoseconds
        self.times.append(self.due)
        self.command()

    def on_state(self, state: JointState) -> None:
        self.slip[stamp_of(state)] = state.velocity[0] - state.velocity[1]
        self.command()

    def command(self) -> None:
        if (slip := self.slip.pop(self.due, None)) is not None:
            self.publisher.publish(FluidPressure(fluid_pressure=min(max(9e4 + 800.0 * (slip - 20.0), 0.0), 4e5)))


def lockstep_run(bench: Any, seconds: float) -> tuple[Timed, list[JointState]]:
    """The states of a driveline whose controller has a timer of simulation time."""
    timed = bench.add(Timed(bench.context))
    heard = bench.listen(JointState, "joint_states")
    node = bench.started(scene="controlled", pacing="lockstep", command_period=0.01, command_timeout=0.0,
                 wait_for_subscribers=2, publish_scalars=False, publish_diagnostics=False)
    bench.until(lambda: len(heard) > 1000 * seconds)
    node.loop.stop()
    assert node.loop.clock.published
    pressure = node.loop.inputs["actuation_pressure"]
    assert pressure.timeouts == pressure.refused == 0
    for one in (timed, node):
        bench.remove(one)
    return timed, heard[:round(1000 * seconds) + 1]


def test_a_timer_of_simulation_time_controls_a_driveline_in_lock_step_with_the_same_bits(bench: Any) -> None:
    runs = [lockstep_run(bench, 0.2) for _ in range(2)]
    for timed, heard in runs:
        assert timed.times[:19] == [k * PERIOD_NS for k in range(1, 20)]
        assert [stamp_of(state) for state in heard] == [k * 1_000_000 for k in range(201)]
    first, again = (np.array([[*state.position, *state.velocity, *state.effort] for state in heard])
                    for _, heard in runs)
    assert first.tobytes() == again.tobytes()
    assert np.ptp(first[:, 5]) > 10.0  # The friction torque follows the commands.


def test_a_timer_whose_command_has_the_stamp_of_an_older_state_takes_part_too(bench: Any) -> None:
    """The state of the timer's time may come after the timer; here it always does."""
    timed = bench.add(Node("timed", context=bench.context, parameter_overrides=[Parameter("use_sim_time", value=True)]))
    publisher, times = timed.create_publisher(FluidPressure, "actuation_pressure", 10), []

    def on_timer() -> None:
        times.append(timed.get_clock().now().nanoseconds)
        command = FluidPressure(fluid_pressure=1e5 + len(times))
        command.header.stamp.nanosec = times[-1] - TICK
        publisher.publish(command)

    def on_state(state: JointState) -> None:  # No timer fires at 0 s.
        if stamp_of(state) == 0:
            publisher.publish(FluidPressure(fluid_pressure=1e5))

    timed.create_timer(0.01, on_timer)
    timed.create_subscription(JointState, "joint_states", on_state, 10)
    heard = bench.listen(FluidPressure, "applied_pressure")
    node = bench.started(scene="controlled", pacing="lockstep", command_period=0.01, command_timeout=0.0,
                         wait_for_subscribers=1, publish_diagnostics=False)
    bench.until(lambda: (node.housekeeping(), len(heard) > 45)[1])
    node.loop.stop()
    assert times[:4] == [k * PERIOD_NS for k in range(1, 5)]
    assert [m.fluid_pressure for m in heard[11:41]] == [1e5 + 1 + k // 10 for k in range(30)]
    assert node.loop.inputs["actuation_pressure"].refused == 0
    assert node.loop.inputs["actuation_pressure"].unstamped == 0


def test_a_recorder_with_use_sim_time_logs_simulation_time(bench: Any, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    recorder = Recorder(bench.node("recorder", use_sim_time=True, output=str(tmp_path / "run"), topics=[
        "joint_states", "slip_speed", "scene", "actuation_pressure", "applied_pressure", "held"]))
    recorder.look()
    timed = bench.add(Timed(bench.context))
    recorder.drain()
    node = bench.started(scene="controlled", pacing="lockstep", command_period=0.01, command_timeout=0.0,
                 wait_for_subscribers=2, publish_diagnostics=False)
    bench.until(lambda: (recorder.drain(), recorder.look(), len(timed.times) > 30)[2])
    node.loop.stop()
    recorder.close()
    logged: dict[str, list[tuple[int, bytes]]] = {}
    with open(tmp_path / "run" / "run_0.mcap", "rb") as file:
        for _, channel, message in reader.make_reader(file).iter_messages(log_time_order=False):
            logged.setdefault(channel.topic, []).append((message.log_time, message.data))
            assert message.publish_time > 10**18
    assert {log for log, _ in logged["/scene"]} == {0}
    states = logged["/joint_states"]
    assert [cdr.read_stamp(data) for _, data in states] == [k * TICK for k in range(len(states))]
    for topic in ("/joint_states", "/slip_speed", "/applied_pressure"):
        assert len(logged[topic]) == len(states) > 300
        assert {k * TICK - log for k, (log, _) in enumerate(logged[topic])} <= {0, TICK}
    commands = [log for log, _ in logged["/actuation_pressure"]]
    assert commands[0] == 0
    assert commands[1:] == [k * PERIOD_NS for k in range(1, len(commands))]
    recording = tcc_sim.read(tmp_path / "run")
    assert recording.commands["actuation_pressure"].t[:30].tolist() == pytest.approx(
        [k * 0.01 + 1e-3 for k in range(30)], abs=1e-9)
    (run,) = recording.line().runs
    assert (run.log_ns == run.sent_ns).all()  # Times of receipt are not known.


def test_a_follower_that_comes_late_gets_the_time_from_then_on(bench: Any) -> None:
    states = bench.listen(JointState, "joint_states")
    node = bench.started(scene="controlled", pacing="lockstep", command_timeout=0.0, wait_for_subscribers=1)
    bench.until(lambda: states)
    assert not node.loop.clock.published
    late = bench.add(Node("late", context=bench.context, parameter_overrides=[Parameter("use_sim_time", value=True)]))
    heard = bench.listen(Clock, "/clock")
    bench.until(lambda: (node.housekeeping(), node.loop.clock.published)[1])
    publisher = bench.probe.create_publisher(FluidPressure, "actuation_pressure", 10)
    bench.until(publisher.get_subscription_count)
    publisher.publish(FluidPressure(fluid_pressure=1e5))
    bench.until(lambda: late.get_clock().now().nanoseconds == 1_000_000)
    bench.until(lambda: len(heard) == 2)
    assert [message.clock.nanosec for message in heard] == [0, 1_000_000]


def test_another_publisher_of_the_clock_is_named_and_goes_first(bench: Any) -> None:
    other = bench.node("gazebo")
    other.create_publisher(Clock, "/clock", 10)
    judged = begun(bench, publish_clock=True)
    assert not judged.node.loop.clock.published
    assert judged.holds("/clock", "/gazebo", "since")
    bench.remove(other)
    bench.until(lambda: (judged.node.housekeeping(), judged.node.loop.clock.published)[1])
    assert "/clock" not in judged.said()
    again = bench.node("gazebo")
    again.create_publisher(Clock, "/clock", 10)
    bench.until(lambda: judged.node.loop.clock.rivals)
    assert judged.holds("/clock", "/gazebo", "since")
