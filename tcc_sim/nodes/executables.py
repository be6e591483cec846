"""What `ros2 run tcc_sim`, the path and `python -m` know as driveline_node, recorder_node and so on.

Signals are taken before anything else is loaded; `--help` and `--version` need no ROS 2; where ROS 2 is not installed
there is one line.
"""

from __future__ import annotations

from functools import partial

from tcc_sim.nodes import signals


def _run(name: str) -> int:
    """Run a node's `main` where rclpy and its messages are there, and give the exit status."""
    signals.take()
    import sys
    from importlib import import_module

    from tcc_sim.errors import InputError, TccError
    from tcc_sim.nodes.children import require_ros
    from tcc_sim.nodes.usage import asked_for, command_of
    from tcc_sim.output.terminal import open_streams

    open_streams()
    try:
        text = asked_for(name, sys.argv[1:])
        if text is None:
            require_ros()
    except TccError as error:
        sys.stderr.write(f"{command_of(name)}: {error}\n")
        signals.give_back()
        return 2 if isinstance(error, InputError) else 1
    if text is not None:
        sys.stdout.write(text)
        signals.give_back()
        return 0
    status = 1
    try:
        status = import_module(f"tcc_sim.nodes.{name}").main()
    except Exception:
        sys.excepthook(*sys.exc_info())
    return signals.end(status)


driveline_node = partial(_run, "driveline")
recorder_node = partial(_run, "recorder")
slip_controller_node = partial(_run, "slip_controller")
commander = partial(_run, "commander")
"""The node that sends commands for `tcc-sim soak`; the others have the names of their modules."""
