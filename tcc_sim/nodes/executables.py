"""Entry points of the nodes (driveline_node, recorder_node, ...) for `ros2 run`, the path and `python -m`.

Signals are handled before anything slow is imported; `--help` and `--version` need no ROS 2; without ROS 2 a node ends
with one line.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from tcc_sim.code_version import code_version
from tcc_sim.nodes import signals

_ROS_WORDS = ("-p", "--param", "-r", "--remap", "--params-file", "-e", "--enclave", "--log-level")
_PURPOSES = {
    "driveline": "Run the driveline in real time: publish states, subscribe to engine torque and actuation pressure.",
    "recorder": "Record every topic of the driveline into a bag (MCAP) that survives a kill.",
    "slip_controller": "Answer the driveline's states with a pressure that holds a mean slip speed.",
    "commander": "Answer the driveline's states with harmonic engine torque and pressure.",
}


def run(name: str) -> int:
    """Run a node's `main` and end the process with its exit status."""
    signals.take()
    from tcc_sim.output.terminal import open_streams

    open_streams()
    return signals.end(status_of(name))


def status_of(name: str) -> int:
    """Run a node's `main` by the words of the command line, and return its exit status."""
    import sys
    from importlib import import_module

    from tcc_sim.errors import InputError, TccError, missing_package
    from tcc_sim.nodes.children import require_ros

    status = 1
    try:
        text = _text_for(name, sys.argv[1:])
        if text is None:
            require_ros()
            status = import_module(f"tcc_sim.nodes.{name}").main()
        else:
            sys.stdout.write(text)
            status = 0
    except TccError as error:
        sys.stderr.write(f"{_command_of(name)}: {error}\n")
        status = 2 if isinstance(error, InputError) else 1
    except Exception as error:
        missing = missing_package(error) if isinstance(error, ModuleNotFoundError) else None
        if missing is None:
            sys.excepthook(*sys.exc_info())
        else:
            sys.stderr.write(f"{_command_of(name)}: {missing}\n")
    return status


def _text_for(name: str, words: list[str]) -> str | None:
    """Return the text for --help or --version, or None; refuse unknown words before --ros-args by InputError."""
    from tcc_sim.errors import InputError

    options, to_ros = [], False
    for word in words:
        to_ros = word != "--" if to_ros else word == "--ros-args"
        if not to_ros and word != "--":
            options.append(word)
    if "--version" in options:
        return f"tcc_sim {code_version()}\n"
    if {"-h", "--help"} & set(options):
        return _help(name)
    if options:
        from difflib import get_close_matches

        near = get_close_matches(options[0], ("--help", "--version", "--ros-args"), 1)
        after = " ".join(["--ros-args", *(word for word in words if word not in ("--", "--ros-args"))])
        if near:
            meant = f"did you mean {near[0]}?"
        elif options[0] in _ROS_WORDS or ":=" in options[0]:
            meant = f"words for ROS 2 follow --ros-args: {_command_of(name)} {after}"
        else:
            meant = "options are --help, --version and --ros-args WORD ..."
        raise InputError(f"{options[0]} is not an option; {meant}")
    return None


def _command_of(name: str) -> str:
    """Return the command that starts the node `name`."""
    return name if name == "commander" else f"{name}_node"


def _help(name: str) -> str:
    """Return purpose, usage and parameters of a node as text."""
    from tcc_sim.output.terminal import terminal_width, wrapped

    command = _command_of(name)
    lines = [f"usage: {command} [--help] [--version] [--ros-args WORD ...]", "", _PURPOSES[name], "",
             "words after --ros-args: -p NAME:=VALUE, --params-file FILE, -r __ns:=/NAME", "", "parameters:"]
    lines += [f"  {key}: {meaning}" for key, meaning in _parameters(name)]
    return wrapped("\n".join(lines) + "\n", terminal_width() or 80)


def _parameters(name: str) -> Iterator[tuple[str, str]]:
    """Iterate over names and meanings of a node's parameters."""
    from tcc_sim.nodes.options import OPTIONS
    from tcc_sim.scene import NODE_SCENE

    if name == "driveline":
        yield "scene", f"bundled name or file ({NODE_SCENE})"
    for key, quantity in OPTIONS[name].quantities().items():
        yield key, quantity.described
    if name == "driveline":
        yield "driveline.*, friction.*, clutch.*, engine.*, pressure.*, initial.*", "the keys of a scene"


driveline_node = partial(run, "driveline")
recorder_node = partial(run, "recorder")
slip_controller_node = partial(run, "slip_controller")
commander = partial(run, "commander")
