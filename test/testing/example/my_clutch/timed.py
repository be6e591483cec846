from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState

from my_clutch.law import HoldSlip
from my_clutch.node import spin

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
    spin(TimedController)
