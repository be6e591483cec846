"""Every topic of the driveline, one row each: what it is, who creates it, what it carries and where a viewer shows it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Topic:
    """One topic.

    name : as given to ROS 2: relative to the node's namespace, or absolute
    type : message type, package/msg/Name
    unit : SI unit of the value; empty where it has none or several
    direction : in (the driveline subscribes) or out (it publishes)
    switch : the scene key or node parameter, with its value, that creates the topic; empty: always there
    carries : what one message says
    view : entity path in Rerun; empty where it is not shown
    latched : the last message is kept for those who subscribe later
    """

    name: str
    type: str
    unit: str
    direction: str
    switch: str
    carries: str
    view: str = ""
    latched: bool = False


FLOAT64 = "std_msgs/msg/Float64"
STRING = "std_msgs/msg/String"
INT8 = "std_msgs/msg/Int8"
FLUID_PRESSURE = "sensor_msgs/msg/FluidPressure"
JOINT_STATE = "sensor_msgs/msg/JointState"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
CLOCK = "rosgraph_msgs/msg/Clock"

JOINT_NAMES = ("flywheel", "clutch_plate")
"""The two joints of joint_states, in this order."""

TOPICS: tuple[Topic, ...] = (
    Topic("scene", STRING, "", "out", "",
          "the scene with every override, as a parameter file; said again after a change",
          latched=True),
    Topic("engine_torque", FLOAT64, "N m", "in", "engine.source: topic",
          "engine torque command, held until the next one",
          "torque/engine_command"),
    Topic("actuation_pressure", FLUID_PRESSURE, "Pa", "in", "pressure.source: topic",
          "actuation pressure command, held until the next one", "pressure/command"),
    Topic("joint_states", JOINT_STATE, "", "out", "",
          "angles (rad), speeds (rad/s) of flywheel and clutch plate; effort: engine torque applied to the flywheel and friction "
          "torque on the plate (N m); stamp: simulation time", "plate"),
    Topic("applied_pressure", FLUID_PRESSURE, "Pa", "out", "pressure.source: topic",
          "actuation pressure that this tick applied; stamp: simulation time", "pressure/applied"),
    Topic("slip_speed", FLOAT64, "rad/s", "out", "publish_scalars: true", "slip speed v = theta1' - theta2'",
          "slip/speed"),
    Topic("friction_torque", FLOAT64, "N m", "out", "publish_scalars: true", "friction torque on the clutch plate",
          "torque/friction"),
    Topic("stick_slip_state", INT8, "", "out", "publish_scalars: true", "-1 negative slip, 0 stick, 1 positive slip",
          "slip/state"),
    Topic("/diagnostics", DIAGNOSTIC_ARRAY, "", "out", "publish_diagnostics: true",
          "rate reached, missed ticks, lateness, iterations, refused and timed-out commands; once a second"),
    Topic("/clock", CLOCK, "", "out", "publish_clock: true", "simulation time"),
)


def topic(name: str) -> Topic:
    """The row of `name`.

    Raises
    ------
    KeyError
        No such topic.
    """
    for row in TOPICS:
        if row.name == name:
            return row
    raise KeyError(name)
