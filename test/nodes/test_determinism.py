"""The same scene or the same commands give the same messages, byte by byte."""

from __future__ import annotations

import random
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Float64

from tcc_sim.messages import cdr
from tcc_sim.nodes.driveline import DrivelineNode
from tcc_sim.nodes.middleware import COMMANDS, message_class, poll, states, subscribe
from tcc_sim.scene import load_scene
from tcc_sim.solvers.fixed_step import Stepper
from tcc_sim.topics import topic

HARMONIC = ["chaos", "runup"]
TOPICS = ("joint_states", "slip_speed", "friction_torque", "stick_slip_state", "/clock")
TICKS = 80


def driveline(bench: Any, scene: str, **parameters: object) -> DrivelineNode:
    return bench.driveline(scene=scene, wait_for_subscribers=1, publish_diagnostics=False, **parameters)


def payloads(bench: Any, scene: str, **parameters: object) -> dict[str, list[bytes]]:
    """The serialised messages of the first ticks by topic."""
    listener = bench.node("listener")
    subscriptions = {name: subscribe(listener, message_class(topic(name).type), name, states(20_000))
                     for name in TOPICS}
    node = driveline(bench, scene, publish_clock=True, **parameters)
    heard: dict[str, list[bytes]] = {name: [] for name in TOPICS}

    def enough() -> bool:
        for name, subscription in subscriptions.items():
            heard[name] += [data for data, _ in poll(subscription)]
        return min(map(len, heard.values())) > TICKS

    node.start()
    bench.until(enough)
    node.loop.stop()
    for one in (node, listener):
        bench.remove(one)
    run = node.loop.outputs.run.encode()
    return {name: [data.replace(run, b"") for data in messages[:TICKS]] for name, messages in heard.items()}


@pytest.mark.parametrize("scene", HARMONIC)
def test_a_run_at_any_pace_gives_the_same_bytes(bench: Any, scene: str) -> None:
    fast = payloads(bench, scene, real_time_factor=0.0)
    assert {name: len(set(messages)) for name, messages in fast.items() if name in ("joint_states", "/clock")} == {
        "joint_states": TICKS, "/clock": TICKS}
    assert payloads(bench, scene, real_time_factor=1.0) == fast


def test_in_lockstep_the_commands_alone_decide_however_late_they_come(bench: Any) -> None:
    """Every message equals the solver's result for the commands, tick by tick, with delays counted in spins."""
    draw = random.Random(5)
    commands = [(draw.uniform(-500.0, 500.0), draw.uniform(0.0, 4e5)) for _ in range(60)]
    delays = [draw.choice([0, 0, 0, 1, 5, 20]) for _ in commands]
    listener = bench.node("controller")
    subscription = subscribe(listener, message_class(topic("joint_states").type), "joint_states", states(1000))
    torques = listener.create_publisher(Float64, "engine_torque", COMMANDS)
    pressures = listener.create_publisher(FluidPressure, "actuation_pressure", COMMANDS)
    node = driveline(bench, "commands", engine__fallback="mean", pressure__fallback="mean", pacing="lockstep",
                     command_timeout=0.0, publish_scalars=False)
    node.start()
    bench.until(lambda: torques.get_subscription_count() and pressures.get_subscription_count())
    heard: list[bytes] = []

    def state(count: int) -> bool:
        heard.extend(data for data, _ in poll(subscription))
        return len(heard) == count

    for tick, ((torque, pressure), delay) in enumerate(zip(commands, delays)):
        bench.until(lambda tick=tick: state(tick + 1))
        for _ in range(delay):
            bench.executor.spin_once(timeout_sec=0.0)
            assert not state(tick + 2)
        # The two topics in either order, and an answer to an old state, which does not count.
        pressures.publish(cdr.fluid_pressure(max(0, tick - 3) * 1_000_000 + 1, 7.0))
        answers = [(torques, cdr.float64(torque)), (pressures, cdr.fluid_pressure(tick * 1_000_000, pressure))]
        for publisher, data in answers if delay else reversed(answers):
            publisher.publish(data)
    bench.until(lambda: state(len(commands) + 1))
    means = {"engine.fallback": "mean", "pressure.fallback": "mean"}
    system = load_scene("commands").with_values(means).system
    stepper = Stepper(system, 1e-3)
    run = node.loop.outputs.run
    expected = [encoded(stepper, run)]
    for torque, pressure in commands:
        stepper.use(stepper.terms._replace(mean_torque=torque, mean_load=system.torque_per_pressure * pressure))
        stepper.advance()
        expected.append(encoded(stepper, run))
    assert heard == expected


def encoded(stepper: Stepper, run: str) -> bytes:
    """The joint_states message of this tick."""
    v, plate_angle, plate_speed, flywheel_angle, engine, friction, _ = stepper.now()
    return cdr.joint_state(stepper.tick * 1_000_000, flywheel_angle, plate_angle, v + plate_speed, plate_speed, engine,
                           friction, frame=run)
