"""The slip controller example: a ROS 2 node that answers every state of the driveline with an actuation pressure.

`ros2 run tcc_sim slip_controller_node` beside `driveline_node --ros-args -p scene:=controlled`. Copy this file, replace
`SlipController` by your own control law, and test it against the same driveline.
"""

from __future__ import annotations

if __name__ == "__main__":
    from tcc_sim.nodes.executables import slip_controller_node

    raise SystemExit(slip_controller_node())

import math
from dataclasses import replace
from typing import Any

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Float64MultiArray, String

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.nodes.executables import answer, run_node
from tcc_sim.nodes.middleware import LATCHED, poll, subscribe, wait_until
from tcc_sim.nodes.parameters import declared
from tcc_sim.plant.slip_control import SlipController, Tuning
from tcc_sim.recording.announcements import simulation_ns, zeros_of
from tcc_sim.topics import LIMITS

FLYWHEEL, PLATE = 0, 1
"""Indices of the joints in joint_states."""
QOS = QoSProfile(depth=5000)
"""Reliable, as the driveline requires for commands; deep enough for a recorder on a busy machine."""


class SlipControllerNode(Node):
    """Node that subscribes to joint_states and publishes actuation_pressure with the stamp of the newest state.

    It publishes the target on target_slip_speed and the limits on pressure_limits at every change; late subscribers get
    the last ones. Target, bandwidth and pressure limit may change while it runs.
    The stamp identifies the state that a command answers. In lock-step the driveline waits for this answer, so that the
    same controller gives the same run to the last bit, however slow it is. In real time states may queue on a busy
    machine: the control law takes all of them, since its means need every state, and only the newest is answered.
    Answering each state would let the delay grow, and the loop would become unstable.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("slip_controller", **options)
        self.controller = SlipController(declared(self, Tuning))
        self._last_time, self._connected = -1, False
        self._scenes, self._zeros = subscribe(self, String, "scene", LATCHED), zeros_of(())
        self._command = self.create_publisher(FluidPressure, "actuation_pressure", QOS)
        self._target = self.create_publisher(Float64, "target_slip_speed", LATCHED)
        self._limits = self.create_publisher(Float64MultiArray, LIMITS, LATCHED)
        self._publish_target()
        self._publish_limits()
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self._states = self.create_subscription(JointState, "joint_states", self._on_state, QOS)

    def task(self) -> str:
        """Return a sentence on the controlled topic and the nominal plant."""
        tuning = self.controller.tuning
        return (f"holds a mean slip speed of {self.controller.target:g} rad/s by {self._command.topic_name}, from "
                f"{self._states.topic_name}: bandwidth {tuning.bandwidth:g} rad/s, period of excitation "
                f"{tuning.cycle_steps:.4g} states of {tuning.step:g} s, at most {tuning.pressure_limit:g} Pa")

    def _publish_target(self) -> None:
        self._target.publish(Float64(data=self.controller.target))

    def _publish_limits(self) -> None:
        self._limits.publish(cdr.pressure_limits(0.0, self.controller.tuning.pressure_limit))

    def _on_set_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Use changed options from the next state on, all of a request or none."""
        names = Tuning.quantities()
        try:
            tuning = replace(self.controller.tuning, **{change.name: change.value for change in changes
                                                        if change.name in names})
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        limit = self.controller.tuning.pressure_limit
        self.controller.use(tuning)
        if tuning.pressure_limit != limit:
            self._publish_limits()
        return SetParametersResult(successful=True)

    def _on_state(self, state: JointState) -> None:
        """Take a state and the states queued behind it, answer the last, and raise InputError if one is not valid."""
        waiting = [state, *(state for state, _ in poll(self._states, QOS.depth))]
        whole = [state for state in waiting if len(state.velocity) > PLATE and len(state.effort) > FLYWHEEL
                 and all(map(math.isfinite, (*state.velocity, *state.effort)))]
        for state in whole:
            pressure = self._update(state)
        if whole and not self._connected:  # A recorder should receive the first command too.
            self._connected, known = True, self.count_subscribers("actuation_pressure")
            wait_until(lambda: self._command.get_subscription_count() >= known)
        if whole:
            command = FluidPressure(fluid_pressure=pressure)
            command.header.stamp = whole[-1].header.stamp
            self._command.publish(command)
        if len(whole) < len(waiting):
            raise InputError(f"{self._states.topic_name} without finite speeds of two joints and a torque")

    def _update(self, state: JointState) -> float:
        for data, _ in poll(self._scenes):  # The scene names the stamp of simulation time 0.
            self._zeros = np.union1d(self._zeros, zeros_of([cdr.read_string(data)]))
        stamp = state.header.stamp.sec * 1_000_000_000 + state.header.stamp.nanosec
        time = int(simulation_ns(np.array([stamp]), self._zeros)[0])
        if time <= self._last_time:
            # Simulation time started again: the driveline was reset or restarted.
            self.controller.reset()
            self._publish_target()
        self._last_time = time
        target = self.controller.tuning.target_at(time * 1e-9)
        if target != self.controller.target:
            self.controller.target = target
            self._publish_target()
        return self.controller.update(state.velocity[FLYWHEEL] - state.velocity[PLATE], state.effort[FLYWHEEL])


def main() -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node(SlipControllerNode, lambda node: answer(node, node.task()))
