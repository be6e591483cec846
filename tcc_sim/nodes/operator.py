"""What an operator asks of a running driveline: reset, pause, step, parameters and single commands.

The same as `ros2 service call`, `ros2 param set` and `ros2 topic pub`, for those who have only the wheels.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import SetBool, Trigger

from tcc_sim.errors import InputError, TccError
from tcc_sim.messages import cdr
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.nodes.middleware import COMMANDS, DIAGNOSTICS, message_class, poll, subscribe
from tcc_sim.nodes.process import Spinner, node_of_command
from tcc_sim.topics import FLUID_PRESSURE, topic

FOUND_WITHIN = 4.0
"""Real time, s, that a driveline may take to be found and to answer."""
HEARD_WITHIN = 1.5
"""Real time, s, that the refusal of a command may take: the driveline says one a second."""
LISTENED_FOR = 0.5
"""Real time, s, in which states are heard where there are any; a driveline that is paused has none."""
SETTLED = 1.0
"""Real time, s, without a new subscriber, after which they count as complete."""
MET_WITHIN = 10.0
"""Real time, s, that those who are known to listen may take to be connected."""
COMMANDS_OF = {"torque": "engine_torque", "pressure": "actuation_pressure"}


class Operator:
    """Talks to the driveline in the namespace of `node`."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._spinner = Spinner(node)
        self._driveline = node.resolve_topic_name("driveline")

    def trigger(self, name: str) -> str:
        """Call ~/reset or ~/step; what the driveline says of it.

        Raises
        ------
        TccError
            No driveline answers, or it refuses; then in its own words.
        """
        return _granted(self._call(Trigger, name, Trigger.Request()))

    def pause(self, paused: bool) -> str:
        """Call ~/pause; what the driveline says of it. Raises as `trigger`."""
        return _granted(self._call(SetBool, "pause", SetBool.Request(data=paused)))

    def change(self, values: Mapping[str, object]) -> None:
        """Set parameters, all or none.

        Raises
        ------
        InputError
            The driveline refuses; in its own words.
        TccError
            No driveline answers.
        """
        request = SetParametersAtomically.Request(parameters=[Parameter(key, value=_typed(value)).to_parameter_msg()
                                                              for key, value in values.items()])
        result = self._call(SetParametersAtomically, "set_parameters_atomically", request).result
        if not result.successful:
            raise InputError(result.reason or "the driveline refused the change without a reason")

    def command(self, what: str, value: float, rate: float = 0.0, tell: Callable[[str], Any] = str) -> str:
        """Send a command, once or `rate` times a second until interrupted, which `tell` is told; what became of it.

        Raises
        ------
        InputError
            The driveline refuses it, in its own words, or takes this input from its scene.
        TccError
            No driveline is there.
        """
        row = topic(COMMANDS_OF[what])
        unit = QUANTITIES[row.key].unit
        group = row.key.partition(".")[0]
        heard: list[str] = []
        began, logger = time.time_ns(), self._driveline.strip("/").replace("/", ".")

        def listen(message: Log) -> None:
            said = message.stamp.sec * 1_000_000_000 + message.stamp.nanosec
            if said >= began and message.msg.startswith(f"{row.name} command") and message.name == logger:
                heard.append(message.msg)

        self._node.create_subscription(Log, "/rosout", listen,
                                       QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        publisher = self._node.create_publisher(message_class(row.type), row.name, COMMANDS)
        if self._value(f"{group}.source") != "topic":
            raise InputError(f"{row.name}: the driveline takes this input from its scene ({group}.source: harmonic)")
        if not self._until(lambda: publisher.get_subscription_count() > 0, FOUND_WITHIN):
            raise TccError(f"the driveline is there, and nothing subscribes to {publisher.topic_name}")
        data = cdr.fluid_pressure(0, value) if row.type == FLUID_PRESSURE else cdr.float64(value)
        applied = self._applied(row.type)
        self._until(lambda: applied() is not None, LISTENED_FOR)
        known = self._listeners(row.name)
        self._until(all_met(lambda: (publisher.get_subscription_count(), known())), MET_WITHIN)
        publisher.publish(data)
        self._until(lambda: heard or applied() == value, HEARD_WITHIN)
        # A recorder may be served later than the driveline.
        publisher.wait_for_all_acked(Duration(seconds=HEARD_WITHIN))
        if rate > 0.0 and not heard:
            tell(f"{row.name} {value:g} {unit} is sent {rate:g} times a second; Ctrl-C ends it")
        while rate > 0.0 and not heard:
            publisher.publish(data)
            self._until(lambda: bool(heard), 1.0 / rate)
        if heard:
            raise InputError(heard[0])
        timeout = self._value("command_timeout")
        held = f"for {timeout:g} s of simulated time (command_timeout)" if timeout else "until the next command"
        return f"{row.name} {value:g} {unit}, held {held}"

    def _applied(self, command_type: str) -> Callable[[], float | None]:
        """Gives the input that the newest state applied, None where no state was heard since the last look; what others
        send on the topic is passed over.
        """
        row = topic("applied_pressure" if command_type == FLUID_PRESSURE else "joint_states")
        layout, field = ((cdr.FLUID_PRESSURE, "fluid_pressure") if row.type == FLUID_PRESSURE else
                         (cdr.joint_state_layout(), "engine_torque"))
        subscription = subscribe(self._node, message_class(row.type), row.name, QoSProfile(depth=10))

        def newest() -> float | None:
            found, _ = layout.records([data for data, _ in poll(subscription)])
            return float(found[field][-1]) if len(found) else None

        return newest

    def _listeners(self, name: str) -> Callable[[], int]:
        """Gives how many are known to subscribe to a command: here, and to the driveline, which has been there longer
        and says it once a second. A recorder that has not met this node is missing here, and not there.
        """
        said: list[int] = []

        def take(message: DiagnosticArray) -> None:
            mine = (status for status in message.status if status.name == f"{self._driveline}: driveline")
            said.extend(int(pair.value) for status in mine for pair in status.values if pair.key == f"{name} listeners")

        self._node.create_subscription(DiagnosticArray, "/diagnostics", take, DIAGNOSTICS)
        if self._value("publish_diagnostics"):
            self._until(lambda: said, FOUND_WITHIN)
        return lambda: max([self._node.count_subscribers(name), *said[-1:]])

    def _value(self, key: str) -> Any:
        """The value of a parameter of the driveline."""
        found = self._call(GetParameters, "get_parameters", GetParameters.Request(names=[key])).values
        return rclpy.parameter.parameter_value_to_python(found[0]) if found else None

    def _call(self, kind: Any, name: str, request: Any) -> Any:
        """The answer of a service of the driveline."""
        client = self._node.create_client(kind, f"{self._driveline}/{name}")
        try:
            if not self._until(client.service_is_ready, FOUND_WITHIN):
                raise TccError(f"no driveline answers at {self._driveline} within {FOUND_WITHIN:g} s "
                               f"(ROS_DOMAIN_ID {os.environ.get('ROS_DOMAIN_ID', '0')})")
            future = client.call_async(request)
            if not self._until(future.done, FOUND_WITHIN):
                raise TccError(f"{self._driveline} does not answer within {FOUND_WITHIN:g} s")
            return future.result()
        finally:
            self._node.destroy_client(client)

    def _until(self, predicate: Callable[[], object], limit: float) -> bool:
        """Spin until the predicate holds; False after `limit` seconds."""
        end = time.monotonic() + limit
        while not predicate():
            if time.monotonic() >= end:
                return False
            self._spinner.once(min(0.05, max(0.0, end - time.monotonic())))
        return True


def all_met(count: Callable[[], tuple[int, int]], clock: Callable[[], float] = time.monotonic) -> Callable[[], bool]:
    """Tells whether everyone who is known to listen is connected, and nobody else has been for SETTLED seconds: a
    command whose sender is gone at once is not heard by a recorder that it has not met by then.

    Parameters
    ----------
    count : gives how many are connected and how many are known
    clock : real time, s
    """
    seen, since = -1, clock()

    def complete() -> bool:
        nonlocal seen, since
        connected, known = count()
        if connected != seen:
            seen, since = connected, clock()
        return connected >= known and clock() - since >= SETTLED

    return complete


def _typed(value: object) -> object:
    """A value as YAML reads it, with the numbers that it takes for words, such as 1e3."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _granted(answer: Any) -> str:
    """What the driveline says of what it did; TccError with its words where it did not."""
    if not answer.success:
        raise TccError(f"the driveline refuses: {answer.message}")
    return str(answer.message)


@contextmanager
def operator(namespace: str) -> Iterator[Operator]:
    """An operator for the time of a `with`, as `node_of_command` has it."""
    with node_of_command(f"operator_{os.getpid()}", namespace) as node:
        yield Operator(node)
