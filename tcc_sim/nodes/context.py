"""What needs a valid ROS 2 context, for nodes whose context a signal may shut down at any moment."""

from __future__ import annotations

import sys
import time

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from tcc_sim.errors import one_line
from tcc_sim.nodes import signals


def executor_of(node: Node) -> SingleThreadedExecutor:
    """An executor with this node, whole or not at all: one that was built by half says so when it is destroyed.

    Raises
    ------
    ExternalShutdownException
        The context has been shut down.
    """
    with signals.held():
        if not node.context.ok():
            raise ExternalShutdownException
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        signals.wakes(executor.wake)
    return executor


def say(node: Node, sentence: str, warning: bool = False) -> None:
    """Log a sentence; on standard error alone where the context was shut down, since /rosout is then no more."""
    with signals.held():
        if not node.context.ok():
            sys.stderr.write(f"[{'WARN' if warning else 'INFO'}] [{node.get_logger().name}]: {sentence}\n")
        elif warning:
            node.get_logger().warning(sentence)
        else:
            node.get_logger().info(sentence)


def warn(node: Node, sentence: str) -> None:
    """Log a warning, as `say` does."""
    say(node, sentence, warning=True)


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
