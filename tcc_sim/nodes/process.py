"""Start, log, run callbacks and end in a node's process: initialise ROS 2, run the node, return an exit status."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from typing import Any, TypeVar

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from tcc_sim.errors import InputError, TccError, one_line
from tcc_sim.nodes import signals
from tcc_sim.nodes.shared_memory import clear
from tcc_sim.nodes.signals import left_to_the_system

LOOK = 0.25
"""Longest time between two checks for a signal, s."""
ACKNOWLEDGED_WITHIN, SOON = 5.0, 0.1
"""Longest real time to wait at the end for subscribers to acknowledge the last messages, and time after which the wait
is logged, s. Fast DDS asks for acknowledgements and repairs lost datagrams every 3 s.
"""
_INTERRUPTED = threading.Event()
"""Set when Ctrl-C was pressed in a command."""
N = TypeVar("N", bound=Node)


def _initialise(words: list[str]) -> None:
    """Initialise ROS 2; raise InputError if it refuses the parameter file or command line."""
    for option, file in pairwise(words):
        if option == "--params-file":
            try:
                with open(file, "rb") as stream:
                    stream.read(1)
            except OSError as error:
                raise InputError(f"--params-file {file}: {error.strerror}") from None
    try:
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise InputError(f"ROS 2 arguments not understood: {' '.join(str(error).split())}") from None


def created(create: Callable[[], N]) -> N:
    """Create a node after cleaning shared memory; a signal meanwhile ends the process.

    Raises
    ------
    InputError
        ROS 2 refuses the node, for example if two topics are remapped to one name.
    TccError
        Another process has left shared memory of this domain unfinished.
    """
    clear(rclpy.get_default_context().get_domain_id())
    try:
        return left_to_the_system(create)
    except RuntimeError as error:
        raise InputError(f"ROS 2 refuses the node: {' '.join(str(error).split())}") from None


def run_node(name: str, create: Callable[[], N], body: Callable[[N], int], args: Sequence[str] | None = None) -> int:
    """Initialise ROS, create the node, run `body` with it, and return the exit status.

    SIGINT, SIGTERM and SIGHUP end the process at once until `body` calls `signals.end_in_order`. After that call a
    signal makes `Spinner.once` raise ExternalShutdownException, and the status is 0. Wrong input gives one line on
    standard error and status 2.
    """
    try:
        signals.take()
        _initialise(sys.argv if args is None else list(args))
        node = created(create)
        try:
            return body(node)
        finally:
            node.destroy_node()
    except ExternalShutdownException:
        return 0
    except (TccError, OSError) as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 2 if isinstance(error, InputError) else 1
    finally:
        rclpy.try_shutdown()


def deliver(node: Node, flush: Callable[[], bool] = lambda: True) -> None:
    """Wait until the subscribers have received all messages of a node that ends, at most ACKNOWLEDGED_WITHIN.

    A publisher that is destroyed earlier takes back the messages that a busy subscriber has not received.

    flush : function that sends waiting messages and returns whether none is left
    """
    began = time.monotonic()
    with suppress(RuntimeError):  # Some middleware does not acknowledge, and a context may have been shut down.
        for limit in (SOON, ACKNOWLEDGED_WITHIN):
            while not (sent := flush()) and time.monotonic() < began + limit:
                time.sleep(0.1 * SOON)
            late = [publisher.topic_name for publisher in node.publishers if not publisher.wait_for_all_acked(
                Duration(seconds=max(0.0, began + limit - time.monotonic())))]
            if sent and not late:
                return
            if limit == SOON:
                log(node, f"waits until subscribers have received the last messages of {', '.join(late)}")
        warn(node, f"subscribers have not received the last messages of {', '.join(late)} within "
                   f"{ACKNOWLEDGED_WITHIN:g} s")


@contextmanager
def node_of_command(name: str, namespace: str) -> Iterator[Node]:
    """Create the node of a command for the duration of a `with` block; Ctrl-C raises KeyboardInterrupt.

    Raises
    ------
    InputError
        The namespace is not valid.
    """
    with rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO):
        try:
            node = created(lambda: rclpy.create_node(name, namespace=namespace, enable_rosout=False,
                                                     start_parameter_services=False))
        except (ValueError, NameValidationException) as error:
            raise InputError(f"--namespace {namespace!r} is not a namespace: {str(error).splitlines()[0]}") from None
        before = signal.getsignal(signal.SIGINT)
        if before is signal.default_int_handler and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, _interrupt)
        try:
            yield node
        finally:
            if signal.getsignal(signal.SIGINT) is _interrupt:
                signal.signal(signal.SIGINT, before)
            node.destroy_node()


def _interrupt(number: int, frame: object) -> None:
    """Set _INTERRUPTED and raise KeyboardInterrupt."""
    _INTERRUPTED.set()
    raise KeyboardInterrupt


def log(node: Node, sentence: str) -> None:
    """Log a message."""
    node.get_logger().info(sentence)


def warn(node: Node, sentence: str) -> None:
    """Log a warning."""
    node.get_logger().warning(sentence)


class Throttle:
    """Logger of warnings at most once a second for each subject.

    clock : function that returns real time, s
    """

    def __init__(self, node: Node, clock: Callable[[], float] = time.monotonic) -> None:
        self._node, self._clock = node, clock
        self._logged: dict[str, tuple[int, float]] = {}

    def warn(self, what: str, sentence: str, count: int | None = None) -> None:
        """Log a warning about `what`, with a `count` only if it has grown since the last one."""
        before, when = self._logged.get(what, (0, -1.0))
        now = self._clock()
        if (count is None or count > before) and now - when >= 1.0:
            self._logged[what] = count or 0, now
            warn(self._node, sentence if count is None else f"{sentence} ({count} so far)")

    def once(self, what: str, sentence: str) -> None:
        """Log a warning about `what` the first time."""
        if what not in self._logged:
            self.warn(what, sentence)


def _executor_for(busy: bool) -> Any:
    """Return the class of a node's executor."""
    if busy:
        with suppress(ImportError):  # The rclpy of Jazzy has none.
            from rclpy.experimental import EventsExecutor

            return EventsExecutor
    return SingleThreadedExecutor


class Spinner:
    """Executor of a node's callbacks; it logs exceptions of callbacks, and the node continues.

    Parameters
    ----------
    busy : whether the node answers every state; at 1 kHz rclpy's EventsExecutor takes half of the processor time

    Raises
    ------
    ExternalShutdownException
        The context has been shut down.
    """

    def __init__(self, node: Node, busy: bool = False) -> None:
        self._node, self._throttle = node, Throttle(node)
        self._failed = 0
        with signals.deferred():  # A partly built executor prints a traceback when it is destroyed.
            if not node.context.ok():
                raise ExternalShutdownException
            self._executor = _executor_for(busy)(context=node.context)
            self._executor.add_node(node)

    def once(self, seconds: float = LOOK) -> None:
        """Run one callback that is ready within `seconds`.

        Raises
        ------
        ExternalShutdownException
            A signal has asked the node to end, or the context has been shut down.
        """
        if signals.end_requested.is_set():
            raise ExternalShutdownException
        try:
            self._executor.spin_once(timeout_sec=seconds)
        except ExternalShutdownException:
            raise
        except Exception as error:
            if _INTERRUPTED.is_set():  # rclpy's conversions turn a KeyboardInterrupt into another error.
                raise KeyboardInterrupt from error
            # rclpy raises errors of decoding messages here.
            self._failed += 1
            self._throttle.warn("callbacks", "a message or request could not be handled: "
                                f"{type(error).__name__}: {one_line(str(error))}", self._failed)
