"""What `ros2 run tcc_sim` and the path know as driveline_node, recorder_node and so on: one line where ROS 2 is not
installed.
"""

from __future__ import annotations

import sys
from importlib import import_module

from tcc_sim.errors import MissingPackage
from tcc_sim.nodes.processes import require_ros


def driveline_node() -> int:
    """Run the driveline node; the exit status."""
    return _run("driveline")


def recorder_node() -> int:
    """Run the recorder node; the exit status."""
    return _run("recorder")


def slip_controller_node() -> int:
    """Run the slip controller example; the exit status."""
    return _run("slip_controller")


def _run(name: str) -> int:
    """Run a node's `main` where rclpy and its messages are there."""
    try:
        require_ros()
    except MissingPackage as error:
        sys.stderr.write(f"{name}_node: {error}\n")
        return 1
    status: int = import_module(f"tcc_sim.nodes.{name}").main()
    return status
