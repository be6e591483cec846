"""Controllers slower than the plant: an answer every command_period, and nodes with timers that follow /clock."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import FluidPressure, JointState

import tcc_sim
from tcc_sim.errors import InputError
from tcc_sim.plant.driveline import Reading
from tcc_sim.scene import load_scene

PERIOD = 10


class Timed(Node):
    """A controller as ROS 2 users write it: a subscription keeps the state, a timer of 10 ms commands."""

    def __init__(self) -> None:
        super().__init__("timed", parameter_overrides=[Parameter("use_sim_time", value=True)])
        self.slip, self.times = 0.0, []
        self.publisher = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(JointState, "joint_states", self.on_state, 10)
        self.create_timer(0.01, self.on_timer)

    def on_state(self, state: JointState) -> None:
        self.slip = state.velocity[0] - state.velocity[1]

    def on_timer(self) -> None:
        self.times.append(self.get_clock().now().nanoseconds)
        self.publisher.publish(FluidPressure(fluid_pressure=pressure_of(self.slip)))


def pressure_of(slip: float) -> float:
    return min(max(9e4 + 800.0 * (slip - 20.0), 0.0), 4e5)


class Slow(Node):
    """Answers every tenth state."""

    def __init__(self, every: int = PERIOD) -> None:
        super().__init__("slow")
        self.every = every
        self.publisher = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(JointState, "joint_states", self.on_state, 10)

    def on_state(self, state: JointState) -> None:
        if state.header.stamp.nanosec // 1_000_000 % self.every == 0:
            command = FluidPressure(fluid_pressure=pressure_of(state.velocity[0] - state.velocity[1]))
            command.header.stamp = state.header.stamp
            self.publisher.publish(command)


def law(reading: Reading) -> float:
    return pressure_of(reading.flywheel_speed - reading.plate_speed)


def test_timers_of_simulation_time_fire_at_their_times_and_give_the_same_bits_each_time(driveline: Any) -> None:
    runs = []
    for _ in range(2):
        plant = driveline("controlled")
        node = plant.add(Timed())
        runs.append(plant.run(seconds=0.5))
        assert node.times == [k * 10_000_000 for k in range(1, len(node.times) + 1)]
        assert len(node.times) in (49, 50)
    held = runs[0].commands["actuation_pressure"][1:]
    assert np.isnan(held[:PERIOD]).all()
    assert np.flatnonzero(np.diff(held[PERIOD:])).tolist() == [k * PERIOD - 1 for k in range(1, 49)]
    assert runs[0].slip_speed.tobytes() == runs[1].slip_speed.tobytes()
    assert runs[0].missed == 0


def test_an_answer_is_awaited_every_command_period_and_held_between(driveline: Any) -> None:
    plant = driveline("controlled", changes={"command_period": 0.01})
    plant.add(Slow())
    run = plant.run(seconds=0.4)
    assert run.missed == 0
    changes = np.flatnonzero(np.diff(run.commands["actuation_pressure"][1:]))
    assert (1 + changes).tolist() == [k * PERIOD for k in range(1, 40)]
    scene = load_scene("controlled").with_values({"command_period": 0.01})
    alone = tcc_sim.closed_loop(scene, law, 0.4)
    assert alone.slip_speed.tobytes() == run.slip_speed.tobytes()
    every = tcc_sim.closed_loop("controlled", law, 0.4)
    assert every.slip_speed.tobytes() != alone.slip_speed.tobytes()


@pytest.mark.parametrize(("period", "rate"), [(0.0015, 1000.0), (0.01, 150.0)])
def test_a_command_period_is_whole_ticks(period: float, rate: float) -> None:
    with pytest.raises(InputError, match=rf"command_period is {period} s; it must be a whole number of ticks"):
        load_scene("controlled").with_values({"command_period": period, "rate": rate})
