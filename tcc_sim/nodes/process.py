"""How a node's process starts and ends: ROS 2 is initialised, the node runs, and its end is an exit status."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import TypeVar

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from tcc_sim.errors import InputError, TccError
from tcc_sim.nodes import signals
from tcc_sim.nodes.shared_memory import creation

N = TypeVar("N", bound=Node)


def _initialise(words: list[str]) -> None:
    """Initialise ROS 2; a parameter file or command line that it refuses is wrong input."""
    for option, file in pairwise(words):
        if option == "--params-file":
            try:
                with open(file, "rb") as stream:
                    stream.read(1)
            except OSError as error:
                raise InputError(f"--params-file {file}: {error.strerror}") from None
    try:
        # `signals` has them while the node starts; the node leaves them to ROS 2 when it runs.
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise InputError(f"ROS 2 arguments not understood: {' '.join(str(error).split())}") from None


def _created(create: Callable[[], N]) -> N:
    """A node; InputError with the words of ROS 2 where it has no such node, as with topics remapped onto one."""
    try:
        with creation():
            return create()
    except RuntimeError as error:
        if rclpy.ok():
            raise InputError(f"ROS 2 refuses the node: {' '.join(str(error).split())}") from None
        raise


def run(name: str, create: Callable[[], N], body: Callable[[N], int], args: Sequence[str] | None = None) -> int:
    """Run a node's process: initialise ROS, create the node, run `body` with it, and give the exit status.

    Until `body` calls `signals.leave_to_ros`, since there is something to end in order, SIGINT, SIGTERM and SIGHUP end
    the process at once. From then on they shut the context down, `body` ends by itself or by
    ExternalShutdownException, and the status is 0; nothing tears it away from what it holds. Wrong input gives one line
    on standard error and status 2.
    """
    try:
        signals.take()
        _initialise(sys.argv if args is None else list(args))
        node = _created(create)
        try:
            return body(node)
        finally:
            node.destroy_node()
    except ExternalShutdownException:
        return 0
    except RuntimeError:
        # A signal that arrives within a call of rclpy makes that call fail, since the context is no longer valid.
        if rclpy.ok():
            raise
        return 0
    except (TccError, OSError) as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 2 if isinstance(error, InputError) else 1
    finally:
        rclpy.try_shutdown()


@contextmanager
def node_of_command(name: str, namespace: str) -> Iterator[Node]:
    """The node of a command for the time of a `with`, with ROS 2 initialised; Ctrl-C is a KeyboardInterrupt.

    Raises
    ------
    InputError
        A namespace that is not one.
    """
    with rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO):
        try:
            with creation():
                node = rclpy.create_node(name, namespace=namespace, enable_rosout=False, start_parameter_services=False)
        except (ValueError, NameValidationException) as error:
            raise InputError(f"--namespace {namespace!r} is not a namespace: {str(error).splitlines()[0]}") from None
        try:
            yield node
        finally:
            node.destroy_node()
