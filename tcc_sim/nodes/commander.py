"""The commander of the demo: a node that answers every state of the driveline with engine torque and pressure.

The commands are the pulsation of the scene `commands`, which is also its fallback, at the time of the state.
"""

from __future__ import annotations

if __name__ == "__main__":
    from tcc_sim.nodes.executables import commander

    raise SystemExit(commander())

import math
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

from tcc_sim.messages import cdr
from tcc_sim.nodes.executables import answer, run_node
from tcc_sim.nodes.middleware import COMMANDS, poll
from tcc_sim.scene import NODE_SCENE, load_scene


class CommanderNode(Node):
    """Node that subscribes to joint_states and publishes both commands, the pressure with the stamp of the state.

    Where several states wait, it answers the newest one.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("commander", **options)
        self._system = load_scene(NODE_SCENE).system
        self._torques = self.create_publisher(Float64, "engine_torque", COMMANDS)
        self._pressures = self.create_publisher(FluidPressure, "actuation_pressure", COMMANDS)
        self.states = self.create_subscription(JointState, "joint_states", self._answer, COMMANDS, raw=True)

    def _answer(self, state: bytes) -> None:
        stamp_ns = cdr.read_stamp([state, *(data for data, _ in poll(self.states))][-1])
        engine, pressure = self._system.engine, self._system.pressure
        phase = engine.frequency * stamp_ns * 1e-9
        swing = math.sin(pressure.frequency_ratio * phase + pressure.phase)
        self._torques.publish(cdr.float64(engine.mean_torque + engine.torque_amplitude * math.sin(phase)))
        self._pressures.publish(cdr.fluid_pressure(stamp_ns, pressure.mean + pressure.amplitude * swing))


def main() -> int:
    """Answer states until SIGINT or SIGTERM."""
    return run_node(CommanderNode, lambda node: answer(node, f"answers every state of {node.states.topic_name}"))
