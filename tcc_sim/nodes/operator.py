"""Operate a running driveline: reset, pause, step, parameters and single commands.

This does the same as `ros2 service call`, `ros2 param set` and `ros2 topic pub` where only the Python wheels of ROS 2
are installed.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from tcc_sim.errors import InputError, TccError
from tcc_sim.model.parameters import QUANTITIES, coerce, index_of, list_of, with_whole_lists
from tcc_sim.nodes.executables import Spinner, node_of_command
from tcc_sim.nodes.middleware import wait_until
from tcc_sim.nodes.parameters import without_arrays
from tcc_sim.scene import Operation, meaning_of
from tcc_sim.topics import topic

DISCOVERY_LIMIT = 4.0
"""Longest real time to find a driveline, and for its answer, s."""
NAMED_WITHIN = 0.3
"""Real time for discovering other drivelines of the domain, s."""
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

        Raises TccError: no driveline answers, or it refuses; the message is the driveline's.
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

        Raises InputError: a parameter cannot change while the node runs, or the driveline refuses; the message is the
        driveline's. Raises TccError: no driveline answers.
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

        Raises InputError: a list has no such number. Raises TccError: no driveline answers.
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
        """Let the driveline hold a command, once or `rate` times a second until interrupted; return its answer as text.

        Parameters
        ----------
        what : torque or pressure
        value : value of the command, N m or Pa
        rate : repeat the command at this rate, Hz, until Ctrl-C
        tell : function that takes a message before sending is repeated

        Raises
        ------
        InputError
            The driveline refuses the command; the message is the driveline's.
        TccError
            No driveline answers.
        """
        row = topic(COMMANDS_OF[what])
        text = f"{row.name} {value:g} {QUANTITIES[row.key].unit}"
        request = SetParametersAtomically.Request(parameters=[Parameter(row.name, value=value).to_parameter_msg()])
        for number in itertools.count():
            result = self._call(SetParametersAtomically, "command", request).result
            if not result.successful:
                raise InputError(result.reason)
            if rate <= 0.0:
                break
            if not number:
                tell(f"sending {text} {rate:g} times a second; Ctrl-C ends it")
            time.sleep(1.0 / rate)
        return f"{text}, {result.reason}{self._namesakes()}"

    def _namesakes(self) -> str:
        """Return a note that names the driveline, if there are others or several with the same name."""
        wait_until(lambda: len(self._drivelines()) > 1, NAMED_WITHIN)
        names = self._drivelines()
        namesakes, others = names.count(self._driveline), sorted(set(names) - {self._driveline})
        notes = [f"; {namesakes} nodes have the name {self._driveline} and received this: give them namespaces"]
        notes *= namesakes > 1
        notes += [f"; this acted on {self._driveline}, not on {' or '.join(others)}"] * bool(others)
        return "".join(notes)

    def _drivelines(self) -> list[str]:
        nodes = self._node.get_node_names_and_namespaces()
        return [f"{namespace.rstrip('/')}/{name}" for name, namespace in nodes if name == "driveline"]

    def _value(self, key: str) -> Any:
        return self.values([key]).get(key)

    def _call(self, kind: Any, name: str, request: Any) -> Any:
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, f"{self._driveline}/{name}")
        client = self._clients[name]
        if not wait_until(client.service_is_ready, DISCOVERY_LIMIT):
            others = " and ".join(sorted(set(self._drivelines()) - {self._driveline}))
            raise TccError(f"no driveline answers at {self._driveline} within {DISCOVERY_LIMIT:g} s "
                           f"(ROS_DOMAIN_ID {os.environ.get('ROS_DOMAIN_ID', '0')})"
                           f"{f'; there is {others}: use --namespace' if others else ''}")
        future, end = client.call_async(request), time.monotonic() + DISCOVERY_LIMIT
        while not future.done():
            if time.monotonic() >= end:
                raise TccError(f"{self._driveline} does not answer within {DISCOVERY_LIMIT:g} s")
            self._spinner.once(0.05)
        return future.result()


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
