import signal

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState

from my_clutch.law import HoldSlip

PERIOD = 0.005


class TimedController(Node):
    """Takes every state of the driveline, and sends a pressure every 5 ms of its clock."""

    def __init__(self, **options) -> None:
        super().__init__("timed_controller", **options)
        self.law = HoldSlip()
        self.commands = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(JointState, "joint_states", self.on_state, 100)
        self.create_timer(PERIOD, self.on_timer)

    def on_state(self, state: JointState) -> None:
        flywheel, plate = state.velocity
        self.law.measure(flywheel - plate)

    def on_timer(self) -> None:
        if self.law.cycle:
            self.commands.publish(FluidPressure(fluid_pressure=self.law.pressure(PERIOD)))


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C then ends rclpy's context, as SIGTERM does.
    with rclpy.init():
        try:
            rclpy.spin(TimedController())
        except Exception:
            if rclpy.ok():  # Else the context has ended, and rclpy raises what its next call happens to raise.
                raise
