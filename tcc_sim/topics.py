"""Topics of the driveline, one row each: type, unit, direction, condition, contents, and place in a viewer.

Nodes (publishers, subscriptions, encoding), recorder, viewers, `explain` and the page of topics read these rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Topic:
    """One topic.

    name : name in ROS 2, relative to the node's namespace or absolute
    type : message type, package/msg/Name
    unit : SI unit of the value; empty for a dimensionless value or several units
    direction : in (the driveline subscribes), out (it publishes) or other (created later: by another node of this
        package, or by the driveline with its first message)
    created_when : scene keys or node parameters, each with the value that creates the topic; empty: always created
    carries : contents of a message
    view : entity path in Rerun, which begins with the panel (`panel`); the layouts read it, so that a new topic appears
        in them; empty for a topic that Rerun does not show
    latched : late subscribers receive the last message (transient local)
    fields : names of `plant.driveline.Reading` published every tick; empty for a topic not published every tick
    joints, arrays : joints of a JointState with such fields, and which of position, velocity and effort it has; fields
        are in the order of the arrays, and in each of the joints
    key : scene key with the allowed range of a command
    """

    name: str
    type: str
    unit: str
    direction: str
    created_when: tuple[tuple[str, object], ...]
    carries: str
    view: str = ""
    latched: bool = False
    fields: tuple[str, ...] = ()
    key: str = ""
    joints: tuple[str, ...] = ()
    arrays: tuple[bool, bool, bool] = (True, True, True)

    @property
    def joint_fields(self) -> tuple[str, ...]:
        """Names of all positions, velocities and efforts of the joints; empty in an array that is absent."""
        fields = iter(self.fields)
        return tuple(next(fields) if there else "" for there in self.arrays for _ in self.joints)

    @property
    def panel(self) -> str:
        """First part of the view, the panel that shows the topic."""
        return self.view.partition("/")[0]

    @property
    def switch(self) -> str:
        """Condition for the topic in words; empty: always created."""
        return " or ".join(f"{key}: {str(value).lower() if isinstance(value, bool) else value}"
                           for key, value in self.created_when)

    def wanted(self, value_of: Callable[[str], object]) -> bool:
        """Return whether the driveline creates the topic; `value_of(key)` gives values of scene keys and parameters."""
        return self.direction != "other" and (not self.created_when
                                              or any(value_of(key) == value for key, value in self.created_when))


FLOAT64 = "std_msgs/msg/Float64"
FLOAT64_ARRAY = "std_msgs/msg/Float64MultiArray"
STRING = "std_msgs/msg/String"
INT8 = "std_msgs/msg/Int8"
HEADER = "std_msgs/msg/Header"
FLUID_PRESSURE = "sensor_msgs/msg/FluidPressure"
JOINT_STATE = "sensor_msgs/msg/JointState"
DIAGNOSTIC_STATUS = "diagnostic_msgs/msg/DiagnosticStatus"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
CLOCK = "rosgraph_msgs/msg/Clock"

CLOCK_TOPIC = "/clock"

JOINT_NAMES = ("flywheel", "clutch_plate")
"""Joints of joint_states, in this order."""
OUTPUT_JOINT = "output"
"""Joint of output_state: the shaft's far end."""
CLUTCH_JOINT = "clutch"
"""Joint of slip_speed_stamped and friction_torque_stamped."""

_TORQUE = (("engine.source", "topic"),)
_PRESSURE = (("pressure.source", "topic"),)
_SCALARS = (("publish_scalars", True),)
_STAMPED = (("publish_stamped", True),)
_SHAFT = (("publish_shaft_torque", True),)

TOPICS: tuple[Topic, ...] = (
    Topic("scene", STRING, "", "out", (),
          "the scene as a parameter file; again after a change", latched=True),
    Topic("engine_torque", FLOAT64, "N m", "in", _TORQUE, "engine torque command",
          "torque/engine_command", key="engine.mean_torque"),
    Topic("actuation_pressure", FLUID_PRESSURE, "Pa", "in", _PRESSURE,
          "actuation pressure command", "pressure/command", key="pressure.mean"),
    Topic("command", JOINT_STATE, "", "in", (*_TORQUE, *_PRESSURE),
          "commands as efforts of the joints flywheel (engine torque, N m) and clutch (actuation pressure, Pa), for "
          "ros2_control; a joint that is absent or NaN commands nothing"),
    Topic("output_speed", FLOAT64, "rad/s", "in", (),
          "speed of the shaft's far end, for instance of a vehicle; without a publisher it stands still",
          "far_end/command", key="initial.plate_speed"),
    Topic("held", FLOAT64_ARRAY, "", "out", (*_TORQUE, *_PRESSURE),
          "source, value, publisher and command counts of every input; before the state of a tick in which any of it "
          "changes, every 0.1 s, and at the end of a run", "events", latched=True),
    Topic("joint_states", JOINT_STATE, "", "out", (),
          "angles (rad), speeds (rad/s) of flywheel and clutch plate; efforts: engine torque on the flywheel and "
          "friction torque on the plate (N m)", "plate",
          fields=("flywheel_angle", "plate_angle", "flywheel_speed", "plate_speed", "engine_torque",
                  "friction_torque"), joints=JOINT_NAMES),
    Topic("applied_pressure", FLUID_PRESSURE, "Pa", "out", _PRESSURE,
          "actuation pressure at the end of this tick", "pressure/applied",
          fields=("applied_pressure",)),
    Topic("slip_speed", FLOAT64, "rad/s", "out", _SCALARS, "slip speed", "slip/speed",
          fields=("slip_speed",)),
    Topic("friction_torque", FLOAT64, "N m", "out", _SCALARS, "friction torque on the plate", "torque/friction",
          fields=("friction_torque",)),
    Topic("stick_slip_state", INT8, "", "out", _SCALARS, "-1 negative slip, 0 stick, 1 positive slip", "state",
          fields=("stick_slip_state",)),
    Topic("slip_speed_stamped", JOINT_STATE, "rad/s", "out", _STAMPED,
          "slip speed as velocity of a joint clutch", fields=("slip_speed",), joints=(CLUTCH_JOINT,),
          arrays=(False, True, False)),
    Topic("friction_torque_stamped", JOINT_STATE, "N m", "out", _STAMPED,
          "friction torque as effort of a joint clutch", fields=("friction_torque",), joints=(CLUTCH_JOINT,),
          arrays=(False, False, True)),
    Topic("shaft_torque", FLOAT64, "N m", "out", _SHAFT,
          "torque of the shaft on a vehicle at its far end", "torque/shaft",
          fields=("shaft_torque",)),
    Topic("output_state", JOINT_STATE, "", "other", (),
          "joint output, the shaft's far end, after the first output_speed: angle theta3 (rad), speed (rad/s), shaft "
          "torque (N m)",
          fields=("output_angle", "output_speed", "shaft_torque"), joints=(OUTPUT_JOINT,)),
    Topic("target_slip_speed", FLOAT64, "rad/s", "other", (),
          "slip speed that a controller holds in the mean over a period of excitation", "control/target", latched=True,
          key="initial.slip_speed"),
    Topic("pressure_limits", FLOAT64_ARRAY, "Pa", "other", (),
          "smallest and largest pressure of a controller", latched=True),
    Topic("unsent_messages", DIAGNOSTIC_STATUS, "", "other", (),
          "numbers of messages, by topic, that the middleware refused from the driveline", latched=True),
    Topic("/diagnostics", DIAGNOSTIC_ARRAY, "", "out", (("publish_diagnostics", True),),
          "pacing, iterations, inputs and commands; once a second"),
    Topic(CLOCK_TOPIC, CLOCK, "", "out", (("publish_clock", True),),
          "the stamp of joint_states; in lock-step also where a node with use_sim_time listens",
          fields=("stamp_ns",)),
)

INPUTS = "engine_torque", "actuation_pressure"
"""Topics of the two inputs, which come from the scene or from commands."""
FAR_END = "output_speed"
"""Topic of the speed of the shaft's far end, which is fixed without publisher."""
SHAFT = "shaft_torque"
"""Topic of the torque of spring and damper in the shaft."""
LIMITS = "pressure_limits"
"""Topic of the smallest and the largest pressure of a controller that states them."""
JOINT_COMMAND = "command"
"""Topic of commands for joints."""
TARGET = "target_slip_speed"
"""Topic of the slip speed that a controller is to hold."""
HELD_INPUTS = (*INPUTS, FAR_END, TARGET)
"""Inputs that the topic `held` describes; the target acts on nothing."""


def shown() -> tuple[Topic, ...]:
    """Return the topics whose numbers a viewer shows by themselves; joint_states has those of the others."""
    known = {*topic("joint_states").fields, "slip_speed", "stick_slip_state"}
    return tuple(row for row in TOPICS if row.view and row.type in (FLOAT64, FLUID_PRESSURE, JOINT_STATE)
                 and not (row.fields and known.issuperset(row.fields)))


def stamped() -> tuple[Topic, ...]:
    """Return the topics with run and stamp of a state beside joint_states, whose values no earlier topic has."""
    known, found = {*topic("joint_states").fields, "slip_speed"}, list[Topic]()
    for row in TOPICS:
        if row.type in (FLUID_PRESSURE, JOINT_STATE) and not known.issuperset(row.fields):
            known.update(row.fields)
            found.append(row)
    return tuple(found)


def topic(name: str) -> Topic:
    """Return the row of topic `name`.

    Raises KeyError: the topic does not exist.
    """
    return {row.name: row for row in TOPICS}[name]
