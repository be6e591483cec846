"""What needs a valid ROS 2 context, for nodes whose context a signal may shut down at any moment."""

from __future__ import annotations

import sys

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

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
