"""What `ros2 run tcc_sim`, the path and `python -m` know as driveline_node, recorder_node and so on.

Signals are taken before anything else is loaded; `--help` and `--version` need no ROS 2; where ROS 2 is not installed
there is one line.
"""

from __future__ import annotations

from typing import NoReturn

from tcc_sim.nodes import signals


def driveline_node() -> NoReturn:
    """Run the driveline node."""
    _run("driveline")


def recorder_node() -> NoReturn:
    """Run the recorder node."""
    _run("recorder")


def slip_controller_node() -> NoReturn:
    """Run the slip controller example."""
    _run("slip_controller")


def commander() -> NoReturn:
    """Run the node that sends commands for `tcc-sim soak`."""
    _run("commander")


def _run(name: str) -> NoReturn:
    """Run a node's `main` where rclpy and its messages are there, and end the process with its status."""
    signals.take()
    import sys

    from tcc_sim.nodes.usage import asked_for

    text = asked_for(name, sys.argv[1:])
    if text is not None:
        sys.stdout.write(text)
        signals.end(0)
    from importlib import import_module

    from tcc_sim.errors import MissingPackage
    from tcc_sim.nodes.children import require_ros

    try:
        require_ros()
    except MissingPackage as error:
        sys.stderr.write(f"{name}_node: {error}\n")
        signals.end(1)
    signals.end(import_module(f"tcc_sim.nodes.{name}").main())
