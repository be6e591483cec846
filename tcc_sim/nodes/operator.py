"""Operate a running driveline: reset, pause, step, parameters and single commands.

This does the same as `ros2 service call`, `ros2 param set` and `ros2 topic pub` where only the Python wheels of ROS 2
are installed.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
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

from tcc_sim.errors import InputError, TccError, counted
from tcc_sim.messages import cdr
from tcc_sim.model.elements import index_of, list_of, with_whole_lists
from tcc_sim.model.parameters import QUANTITIES, coerce
from tcc_sim.nodes.middleware import COMMANDS, DIAGNOSTICS, message_class, poll, subscribe
from tcc_sim.nodes.parameters import without_arrays
from tcc_sim.nodes.process import Spinner, node_of_command
from tcc_sim.plant.closed_loop import doubt_of
from tcc_sim.scene import Operation, meaning_of
from tcc_sim.topics import FLUID_PRESSURE, topic

DISCOVERY_LIMIT = 4.0
"""Longest real time to find a driveline, and for its answer, s."""
HEARD_WITHIN = 1.5
"""Longest real time to see a command applied or refused if diagnostics do not count it, s."""
NAMED_WITHIN = 0.3
"""Real time for discovering other drivelines of the domain, s."""
COUNTED_WITHIN = 30.0
"""Longest real time until the diagnostics of a driveline on a busy machine count a command, s."""
LISTENED_FOR = 0.5
"""Longest real time to wait for a state, s; a paused driveline sends none."""
SETTLED = 1.0
"""Real time without a new subscriber after which the subscribers count as complete, s."""
MET_WITHIN = 10.0
"""Longest real time to connect to the known subscribers, s."""
COMMANDS_OF = {"torque": "engine_torque", "pressure": "actuation_pressure"}


class Operator:
    """Operator of the driveline in the namespace of `node`."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._spinner = Spinner(node)
        self._driveline = node.resolve_topic_name("driveline")
        self._clients: dict[str, Any] = {}

    def serve(self, action: str) -> str:
        """Call the service for reset, step, pause or resume, and return the driveline's answer.

        Raises
        ------
        TccError
            No driveline answers, or it refuses; the message is the driveline's.
        """
        if action in ("pause", "resume"):
            answer = self._call(SetBool, "pause", SetBool.Request(data=action == "pause"))
        else:
            answer = self._call(Trigger, action, Trigger.Request())
        if not answer.success:
            raise TccError(f"the driveline refuses: {answer.message}")
        return f"{answer.message}{self._namesakes()}"

    def change(self, values: Mapping[str, object]) -> str:
        """Set parameters together and return the new values as text.

        Raises
        ------
        InputError
            A parameter cannot change while the node runs, or the driveline refuses; the message is the driveline's.
        TccError
            No driveline answers.
        """
        for key, value in values.items():
            if not meaning_of(key).live:
                raise InputError(f"{key} cannot change while the driveline runs: start it again with --ros-args -p "
                                 f"{key}:={value}, or with a parameter file")
        request = SetParametersAtomically.Request(parameters=[
            _parameter(key, value).to_parameter_msg() for key, value in with_whole_lists(values, self._value).items()])
        result = self._call(SetParametersAtomically, "set_parameters_atomically", request).result
        if not result.successful:
            raise InputError(result.reason or "the driveline refused the change without a reason")
        return ", ".join(f"{key} {value}" for key, value in values.items()) + self._namesakes()

    def values(self, keys: Sequence[str]) -> dict[str, Any]:
        """Return the values of parameters, and of single numbers of lists.

        Raises
        ------
        InputError
            A list has no such number.
        TccError
            No driveline answers.
        """
        names = list(map(list_of, keys))
        values = self._call(GetParameters, "get_parameters", GetParameters.Request(names=names)).values
        whole = [without_arrays(rclpy.parameter.parameter_value_to_python(value)) for value in values]
        out: dict[str, Any] = {}
        for key, name, value in zip(keys, names, whole):
            if key.endswith("]"):
                out[key] = value[index_of(key, value)]
            else:
                out[name] = value
        return out

    def command(self, what: str, value: float, rate: float = 0.0, tell: Callable[[str], Any] = str) -> str:
        """Send a command, once or `rate` times a second until interrupted, and return its effect as text.

        Parameters
        ----------
        tell : function that takes a message before sending is repeated

        Raises
        ------
        InputError
            The driveline refuses the command (the message is the driveline's), or takes this input from its scene.
        TccError
            No driveline answers.
        """
        row = topic(COMMANDS_OF[what])
        unit = QUANTITIES[row.key].unit
        source = f"{row.key.partition('.')[0]}.source"
        heard = self._refusals(row.name)
        publisher = self._node.create_publisher(message_class(row.type), row.name, COMMANDS)
        options = self.values([source, "publish_diagnostics", "command_timeout"])
        if options[source] != "topic":
            raise InputError(f"{row.name}: the driveline takes this input from its scene ({source}: harmonic)")
        if not self._until(lambda: publisher.get_subscription_count() > 0, DISCOVERY_LIMIT):
            raise TccError(f"the driveline runs, but nothing subscribes to {publisher.topic_name}")
        data = cdr.fluid_pressure(0, value) if row.type == FLUID_PRESSURE else cdr.float64(value)
        applied = self._applied(row.type)
        self._until(lambda: applied() is not None, LISTENED_FOR)
        status = self._statuses(options["publish_diagnostics"])
        known = int(status[-1].get(f"{row.name} listeners", 0)) if status else 0
        self._until(all_met(lambda: (publisher.get_subscription_count(),
                                     max(self._node.count_subscribers(row.name), known))), MET_WITHIN)
        others = self._node.count_publishers(row.name) - 1
        said = len(status)
        publisher.publish(data)
        answer = self._until(
            lambda: "refused" if heard else "applied" if applied() == value else self._counted(row.name, status, said)
            if not others else "", HEARD_WITHIN if others or not status else COUNTED_WITHIN)
        if answer == "refused" and not heard:
            heard.append(status[-1][f"{row.name} last refusal"])
        if not answer and status and not others:
            raise TccError(f"{self._driveline} has not taken the command within {COUNTED_WITHIN:g} s")
        # A recorder may get the command later than the driveline.
        publisher.wait_for_all_acked(Duration(seconds=HEARD_WITHIN))
        if rate > 0.0 and not heard:
            tell(f"sending {row.name} {value:g} {unit} {rate:g} times a second; Ctrl-C ends it")
        while rate > 0.0 and not heard:
            publisher.publish(data)
            self._until(lambda: bool(heard), 1.0 / rate)
        if heard:
            raise InputError(heard[0])
        timeout = options["command_timeout"]
        end = f"for {timeout:g} s of simulated time (command_timeout)" if timeout else "until the next command"
        held = f"held {end}"
        notes = [f"{held}, once the driveline goes on: it is {status[-1]['regime']}" if answer == "waits" else held]
        if not answer:
            notes.append(f"not seen applied within {HEARD_WITHIN:g} s")
        if others > 0:
            notes.append(f"{counted(others, 'other publisher')} on {publisher.topic_name}: the newest command counts")
        if doubt := doubt_of(row.name, value):
            notes.append(doubt.partition("; ")[2])
        return f"{row.name} {value:g} {unit}, {'; '.join(notes)}{self._namesakes()}"

    @staticmethod
    def _counted(name: str, statuses: Sequence[Mapping[str, str]], before: int) -> str:
        """Return the effect of the command sent after `before` statuses by the driveline's counts; empty if unknown."""
        was, now = statuses[before - 1 if before else 0:][:1], statuses[before:][-1:]
        for old, new in zip(was, now):
            for count, word in (("refused", "refused"), ("received", "applied")):
                if new[f"{name} {count}"] != old[f"{name} {count}"]:
                    return word
        # The first status may date from before the command.
        still = len(statuses) > before + 1 and statuses[-1]["regime"] in ("paused", "waiting")
        return "waits" if still else ""

    def _refusals(self, name: str) -> list[str]:
        """Return a list that collects the driveline's log lines for commands on a topic refused from now on."""
        heard: list[str] = []
        began, logger = time.time_ns(), self._driveline.strip("/").replace("/", ".")

        def listen(message: Log) -> None:
            sent = message.stamp.sec * 1_000_000_000 + message.stamp.nanosec
            if sent >= began and message.msg.startswith(f"{name} command") and message.name == logger:
                heard.append(message.msg.rpartition(" (")[0])  # Without the log's count.

        self._node.create_subscription(Log, "/rosout", listen,
                                       QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        return heard

    def _applied(self, command_type: str) -> Callable[[], float | None]:
        """Return a function that gives the input applied in the newest state, None without a new state."""
        row = topic("applied_pressure" if command_type == FLUID_PRESSURE else "joint_states")
        field = "fluid_pressure" if row.type == FLUID_PRESSURE else "engine_torque"
        subscription = subscribe(self._node, message_class(row.type), row.name, QoSProfile(depth=10))

        def newest() -> float | None:
            rows, _ = cdr.own_records([data for data, _ in poll(subscription)], row.type)
            return float(rows[field][-1]) if len(rows) else None

        return newest

    def _statuses(self, published: bool) -> list[dict[str, str]]:
        """Return a list that collects the driveline's diagnostics, after waiting for the first if they are published.
        """
        statuses: list[dict[str, str]] = []

        def take(message: DiagnosticArray) -> None:
            mine = (status for status in message.status if status.name == f"{self._driveline}: driveline")
            statuses.extend({pair.key: pair.value for pair in status.values} for status in mine)

        self._node.create_subscription(DiagnosticArray, "/diagnostics", take, DIAGNOSTICS)
        if published:
            self._until(lambda: statuses, DISCOVERY_LIMIT)
        return statuses

    def _namesakes(self) -> str:
        """Return a note that names the driveline, if there are others or several with the same name."""
        self._until(lambda: len(self._drivelines()) > 1, NAMED_WITHIN)
        names = self._drivelines()
        namesakes, others = names.count(self._driveline), sorted(set(names) - {self._driveline})
        notes = [f"; {namesakes} nodes have the name {self._driveline} and received this: give them namespaces"]
        notes *= namesakes > 1
        notes += [f"; this acted on {self._driveline}, not on {' or '.join(others)}"] * bool(others)
        return "".join(notes)

    def _drivelines(self) -> list[str]:
        """Return the fully qualified names of all known driveline nodes."""
        nodes = self._node.get_node_names_and_namespaces()
        return [f"{namespace.rstrip('/')}/{name}" for name, namespace in nodes if name == "driveline"]

    def _value(self, key: str) -> Any:
        """Return the value of a parameter of the driveline."""
        return self.values([key]).get(key)

    def _call(self, kind: Any, name: str, request: Any) -> Any:
        """Call a service of the driveline and return its answer."""
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, f"{self._driveline}/{name}")
        client = self._clients[name]
        if not self._until(client.service_is_ready, DISCOVERY_LIMIT):
            others = " and ".join(sorted(set(self._drivelines()) - {self._driveline}))
            raise TccError(f"no driveline answers at {self._driveline} within {DISCOVERY_LIMIT:g} s "
                           f"(ROS_DOMAIN_ID {os.environ.get('ROS_DOMAIN_ID', '0')})"
                           f"{f'; there is {others}: use --namespace' if others else ''}")
        future = client.call_async(request)
        if not self._until(future.done, DISCOVERY_LIMIT):
            raise TccError(f"{self._driveline} does not answer within {DISCOVERY_LIMIT:g} s")
        return future.result()

    def _until(self, predicate: Callable[[], object], limit: float) -> object:
        """Run callbacks until the predicate is true and return its value; return False after `limit` seconds."""
        end = time.monotonic() + limit
        while not (outcome := predicate()):
            if time.monotonic() >= end:
                return False
            self._spinner.once(min(0.05, max(0.0, end - time.monotonic())))
        return outcome


def all_met(count: Callable[[], tuple[int, int]], clock: Callable[[], float] = time.monotonic) -> Callable[[], bool]:
    """Return a function that tells whether all known subscribers are connected and no new one came for SETTLED seconds.

    A recorder that is not connected when the sender ends would miss the command.

    Parameters
    ----------
    count : function that returns the numbers of connected and of known subscribers
    clock : function that returns real time, s
    """
    seen, since = -1, clock()

    def complete() -> bool:
        nonlocal seen, since
        connected, known = count()
        if connected != seen:
            seen, since = connected, clock()
        return connected >= known and clock() - since >= SETTLED

    return complete


def _parameter(key: str, value: object) -> Parameter[Any]:
    """Return a live parameter with its YAML value as a float or list of floats; InputError if the value is wrong."""
    if key not in QUANTITIES:
        return Parameter(key, value=getattr(Operation(**{key: value}), key))  # type: ignore[arg-type]
    checked = coerce(key, value)
    return (Parameter(key, Parameter.Type.DOUBLE_ARRAY, list(checked)) if isinstance(checked, tuple) else
            Parameter(key, value=checked))


@contextmanager
def operator(namespace: str) -> Iterator[Operator]:
    """Create an Operator for the duration of a `with` block; errors are those of `node_of_command`."""
    with node_of_command(f"operator_{os.getpid()}", namespace) as node:
        yield Operator(node)
