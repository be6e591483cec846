"""What both nodes share: quality of service, subscriptions that are polled, and how a process starts and ends."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from types import FrameType
from typing import Any

import rclpy
from rclpy.callback_groups import CallbackGroup
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from tcc_sim.errors import InputError, TccError

COMMANDS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.VOLATILE)
"""What the driveline asks of those who send commands."""

LATCHED = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For the scene: whoever subscribes later still gets the last one."""

DIAGNOSTICS = QoSProfile(depth=10)
"""For /diagnostics, as diagnostic_aggregator expects it."""


_ENDING = {signal.SIGINT, signal.SIGTERM}


def states(depth: int) -> QoSProfile:
    """What the driveline offers: nothing is lost as long as a subscriber falls back by less than `depth` messages.

    With depth 0 all are kept, so that the driveline waits for a slow subscriber.
    """
    history = HistoryPolicy.KEEP_LAST if depth else HistoryPolicy.KEEP_ALL
    return QoSProfile(history=history, depth=depth, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.VOLATILE)


class Polled(CallbackGroup):
    """A callback group that no executor ever executes: its subscriptions wait for `poll`."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing ends that never begins."""


def subscribe(node: Node, message_class: type, topic: str, qos: QoSProfile) -> Subscription[Any]:
    """A raw subscription that only `poll` reads."""
    return node.create_subscription(message_class, topic, _unused, qos, callback_group=Polled(), raw=True)


def _unused(message: bytes) -> None:
    """The callback that rclpy asks for and nothing calls."""


def poll(subscription: Subscription[Any], most: int = 100_000) -> list[tuple[bytes, dict[str, Any]]]:
    """Take up to `most` waiting messages: serialised bytes and message information each.

    It works on after the context was shut down, so that the last messages can still be saved.
    """
    taken: list[tuple[bytes, dict[str, Any]]] = []
    handle, message_class, raw = subscription.handle, subscription.msg_type, subscription.raw
    with handle:
        take = handle.take_message
        while len(taken) < most:
            item = take(message_class, raw)
            if item is None:
                break
            taken.append(item)
    return taken


def hold_signals() -> None:
    """Let SIGINT and SIGTERM wait while a node is being built: rclpy prints a traceback where they come in between."""
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)


def release_signals() -> None:
    """Take SIGINT and SIGTERM again, those that waited first."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)


def unknown_parameters(node: Node) -> list[str]:
    """Parameters that were given on the command line or in a file and that the node does not declare."""
    return sorted(name for name in node._parameter_overrides if not node.has_parameter(name))


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
        rclpy.init(args=words)
    except RuntimeError as error:
        raise InputError(f"ROS 2 arguments not understood: {' '.join(str(error).split())}") from None


def run(name: str, body: Callable[[], int], args: Sequence[str] | None = None, interruptible: bool = True) -> int:
    """Run a node's process: initialise ROS, run `body`, and give the exit status.

    SIGINT and SIGTERM end `body` by KeyboardInterrupt or ExternalShutdownException, which it may use to tidy up; the
    status is then 0. Wrong input gives one line on standard error and status 2. Where `interruptible` is off, SIGINT
    ends the context only, as SIGTERM does, and no KeyboardInterrupt tears `body` away from what it holds.
    """
    started = False

    def leave_it_to_ros(number: int, frame: FrameType | None) -> None:
        """ROS 2 has handled the signal before, once it is initialised."""
        if not started:
            raise KeyboardInterrupt

    try:
        if not interruptible:
            signal.signal(signal.SIGINT, leave_it_to_ros)
        _initialise(sys.argv if args is None else list(args))
        started = True
        return body()
    except (KeyboardInterrupt, ExternalShutdownException):
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
