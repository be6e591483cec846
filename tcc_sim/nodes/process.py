"""How a node's process starts, speaks, runs callbacks and ends, though a signal may shut its context down at any
moment: ROS 2 is initialised, the node runs, and its end is an exit status.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import TypeVar

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from tcc_sim.errors import InputError, TccError, one_line
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


def run_node(name: str, create: Callable[[], N], body: Callable[[N], int], args: Sequence[str] | None = None) -> int:
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


def executor_of(node: Node) -> SingleThreadedExecutor:
    """An executor with this node, whole or not at all: one that was built by half says so when it is destroyed.

    Raises
    ------
    ExternalShutdownException
        The context has been shut down.
    """
    with signals.deferred():
        if not node.context.ok():
            raise ExternalShutdownException
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        signals.wake_when_asked(executor)
    return executor


def log(node: Node, sentence: str, warning: bool = False) -> None:
    """Log a sentence; on standard error alone where the context was shut down, since /rosout is then no more."""
    with signals.deferred():
        if not node.context.ok():
            sys.stderr.write(f"[{'WARN' if warning else 'INFO'}] [{node.get_logger().name}]: {sentence}\n")
        elif warning:
            node.get_logger().warning(sentence)
        else:
            node.get_logger().info(sentence)


def warn(node: Node, sentence: str) -> None:
    """Log a warning, as `log` does."""
    log(node, sentence, warning=True)


class Throttle:
    """Warnings of a node that are said at most once a second each."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._said: dict[str, tuple[int, float]] = {}

    def warn(self, what: str, count: int, sentence: str) -> None:
        """Say a sentence where `count` has grown since one was last said of `what`."""
        before, when = self._said.get(what, (0, -1.0))
        now = time.monotonic()
        if count > before and now - when >= 1.0:
            self._said[what] = count, now
            warn(self._node, f"{sentence} ({count} so far)")


class Spinner:
    """Runs the callbacks of a node. Whatever a message or a request makes of one is said, and the node goes on.

    Raises
    ------
    ExternalShutdownException
        The context has been shut down.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._executor, self._throttle = node, executor_of(node), Throttle(node)
        self._failed = 0

    def once(self, seconds: float | None = None) -> None:
        """Run one callback that is due, or wait for one at most so long; ExternalShutdownException as above."""
        try:
            self._executor.spin_once(timeout_sec=seconds)
        except ExternalShutdownException:
            raise
        except Exception as error:
            # What others send is decoded and looked at by rclpy, which raises here what it did not expect.
            if not self._node.context.ok():
                raise ExternalShutdownException from None
            self._failed += 1
            self._throttle.warn("callbacks", self._failed, "a message or request was not understood: "
                                f"{type(error).__name__}: {one_line(str(error))}")
