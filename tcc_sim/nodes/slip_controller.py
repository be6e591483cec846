"""The slip controller example: a ROS 2 node that answers every state of the driveline with an actuation pressure.

`ros2 run tcc_sim slip_controller_node` beside `driveline_node --ros-args -p scene:=controlled`. Copy this file, put
your own control law in the place of `SlipController`, and test it against the same driveline.
"""

from __future__ import annotations

if __name__ == "__main__":
    from tcc_sim.nodes.executables import slip_controller_node

    raise SystemExit(slip_controller_node())

import math
from typing import Any, NoReturn

from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from tcc_sim.errors import InputError
from tcc_sim.nodes import signals
from tcc_sim.nodes.middleware import LATCHED, poll
from tcc_sim.nodes.parameters import declared
from tcc_sim.nodes.process import Spinner, log, run_node
from tcc_sim.plant.slip_control import SlipController, Tuning

FLYWHEEL, PLATE = 0, 1
"""Order of the joints in joint_states."""
QOS = QoSProfile(depth=5000)
"""Reliable, as the driveline asks for commands; deep enough that a recorder on a busy machine gets every command."""


class SlipControllerNode(Node):
    """joint_states in, actuation_pressure out: a command for the newest state, with that state's stamp.

    target_slip_speed says what it is asked to hold, at every change and to whoever subscribes later.
    The stamp says which state a command answers. In lock-step the driveline waits for exactly that answer, so that the
    same controller gives the same run to the last bit however slow it is. In real time states wait where the machine is
    busy: the control law takes them all, since its means need every one, and the newest is answered. Answered one by
    one they would be ever older, and a loop with that dead time is unstable.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("slip_controller", **options)
        self.controller = SlipController(declared(self, Tuning))
        self._last_stamp = -1
        self._command = self.create_publisher(FluidPressure, "actuation_pressure", QOS)
        self._target = self.create_publisher(Float64, "target_slip_speed", LATCHED)
        self._say_target()
        self._states = self.create_subscription(JointState, "joint_states", self._on_state, QOS)

    def report(self) -> None:
        """Say what it controls, and with what belief of its plant."""
        tuning = self.controller.tuning
        log(self, f"holds a mean slip speed of {self.controller.target:g} rad/s by {self._command.topic_name}, from "
                  f"{self._states.topic_name}: bandwidth {tuning.bandwidth:g} rad/s, engine cycle "
                  f"{tuning.cycle_steps:.4g} states of {tuning.step:g} s, at most {tuning.pressure_limit:g} Pa")

    def _say_target(self) -> None:
        """Say what is to be held."""
        self._target.publish(Float64(data=self.controller.target))

    def _on_state(self, state: JointState) -> None:
        """Take a state and those that wait behind it, and answer the last.

        Raises
        ------
        InputError
            One that has not the speeds of two joints and the torque of the first, all finite; the others are taken.
        """
        waiting = [state, *(state for state, _ in poll(self._states, QOS.depth))]
        whole = [state for state in waiting if len(state.velocity) > PLATE and len(state.effort) > FLYWHEEL
                 and all(map(math.isfinite, (*state.velocity, *state.effort)))]
        for state in whole:
            pressure = self._update(state)
        if whole:
            command = FluidPressure(fluid_pressure=pressure)
            command.header.stamp = whole[-1].header.stamp
            self._command.publish(command)
        if len(whole) < len(waiting):
            raise InputError(f"{self._states.topic_name} without finite speeds of two joints and a torque")

    def _update(self, state: JointState) -> float:
        """What the control law makes of one state, Pa."""
        stamp = state.header.stamp.sec * 1_000_000_000 + state.header.stamp.nanosec
        if stamp <= self._last_stamp:
            # Simulation time started again: the driveline was reset or restarted.
            self.controller.reset()
            self._say_target()
        self._last_stamp = stamp
        target = self.controller.tuning.target_at(stamp * 1e-9)
        if target != self.controller.target:
            self.controller.target = target
            self._say_target()
        return self.controller.update(state.velocity[FLYWHEEL] - state.velocity[PLATE], state.effort[FLYWHEEL])


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node("slip_controller_node", SlipControllerNode, _spin, args)


def _spin(node: SlipControllerNode) -> NoReturn:
    """Answer states until the context ends."""
    signals.end_in_order()
    node.report()
    spinner = Spinner(node)
    while True:
        spinner.once()
