import signal

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState

from my_clutch.law import HoldSlip


class Controller(Node):
    """Answers every state of the driveline with a pressure that carries the state's stamp."""

    def __init__(self) -> None:
        super().__init__("my_controller")
        self.law = HoldSlip()
        self.commands = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(JointState, "joint_states", self.on_state, 10)

    def on_state(self, state: JointState) -> None:
        flywheel, plate = state.velocity
        command = FluidPressure(fluid_pressure=self.law.update(flywheel - plate))
        command.header.stamp = state.header.stamp
        self.commands.publish(command)


def spin(controller: type[Node]) -> None:
    """Run a node until Ctrl-C or SIGTERM."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C then ends rclpy's context, as SIGTERM does.
    with rclpy.init():
        try:
            rclpy.spin(controller())
        except Exception:
            if rclpy.ok():  # Else the context has ended, and rclpy raises what its next call happens to raise.
                raise


def main() -> None:
    spin(Controller)
