"""Initialise ROS 2 for tests, isolated from nodes of other processes."""

from __future__ import annotations

import os

import rclpy

from tcc_sim.errors import InputError
from tcc_sim.nodes.shared_memory import remove_ownerless


def alone() -> None:
    """Raise InputError if rclpy was initialised without isolation: commands would reach nodes of other processes."""
    if rclpy.ok() and os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") != "OFF":
        raise InputError("rclpy.init() was called before the fixture driveline, so this test would receive from and "
                         "command nodes of other processes; leave rclpy.init() to the fixture, or set "
                         "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF before it")


def initialise() -> bool:
    """Initialise ROS 2's default context unless it is already; return whether the caller must shut it down."""
    if rclpy.ok():
        return False
    remove_ownerless()
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    return True
