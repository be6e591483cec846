"""ROS 2 for tests: nothing outside of the process is seen, and nothing outside is commanded."""

from __future__ import annotations

import os

import rclpy

from tcc_sim.errors import InputError
from tcc_sim.nodes.shared_memory import remove_ownerless


def alone() -> None:
    """Raise InputError where rclpy was initialised so that other processes are seen: commands would reach their nodes.
    """
    if rclpy.ok() and os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") != "OFF":
        raise InputError("rclpy.init() was called before the fixture driveline, so this test would hear and command "
                         "nodes of other processes: leave rclpy.init() to the fixture, or set "
                         "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF before it")


def initialise() -> bool:
    """Initialise ROS 2's default context for tests, unless it is; whether it has to be shut down again."""
    if rclpy.ok():
        return False
    remove_ownerless()
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    return True
