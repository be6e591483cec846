"""Nodes of a user of ROS 2: a controller that answers states, and a vehicle at the far end of the shaft."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

INERTIA, DRAG, STEP = 1.5, 2.0, 1e-3


def pressure_of(slip: float) -> float:
    return min(max(9e4 + 800.0 * (slip - 20.0), 0.0), 4e5)


class Slow(Node):
    """Answers the states of every tenth tick of 1 ms, or of all; counts the states."""

    def __init__(self, every: int = 10, context: Any = None) -> None:
        super().__init__("slow", context=context)
        self.every, self.states = every, 0
        self.publisher = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(JointState, "joint_states", self.on_state, 100)

    def on_state(self, state: JointState) -> None:
        self.states += 1
        if state.header.stamp.nanosec // 1_000_000 % self.every == 0:
            command = FluidPressure(fluid_pressure=pressure_of(state.velocity[0] - state.velocity[1]))
            command.header.stamp = state.header.stamp
            self.publisher.publish(command)


class Vehicle(Node):
    """One inertia with a drag: shaft_torque in, output_speed out, the speed for the next tick."""

    def __init__(self, context: Any = None) -> None:
        super().__init__("vehicle", context=context)
        self.speed = 0.0
        self.publisher = self.create_publisher(Float64, "output_speed", 100)
        self.create_subscription(Float64, "shaft_torque", self.on_torque, 100)

    def on_torque(self, torque: Float64) -> None:
        self.speed += STEP * (torque.data - DRAG * self.speed) / INERTIA
        self.publisher.publish(Float64(data=self.speed))
