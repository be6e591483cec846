"""`tcc-sim control`: what `ros2 service`, `param` and `topic pub` do to a running driveline, with the wheels alone."""

from __future__ import annotations

import argparse
import math
from functools import partial

from tcc_sim.cli.arguments import number
from tcc_sim.output.terminal import say

ACTIONS = {
    "reset": "back to the initial state and simulation time 0",
    "pause": "stop simulated time",
    "resume": "let it go on",
    "step": "one tick while paused",
    "set": "change parameters, all or none",
    "get": "print parameters with their units",
    "torque": "send an engine torque command, N m",
    "pressure": "send an actuation pressure command, Pa",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What to do, with its values, and the namespace."""
    parser.add_argument("--namespace", metavar="NS", default="", help="of the driveline node")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True, parser_class=type(parser))
    for name, text in ACTIONS.items():
        action = actions.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        if name == "set":
            action.add_argument("assignments", nargs="+", metavar="KEY=VALUE", help="scene keys and node options")
        elif name == "get":
            action.add_argument("keys", nargs="+", metavar="KEY", help="scene keys and node options")
        elif name in ("torque", "pressure"):
            action.add_argument("value", type=number(-math.inf, math.inf, ""), metavar="X", help="in SI units")
            action.add_argument("--rate", type=number(0.1, 1000.0, "Hz"), metavar="HZ",
                                help="send it again so many times a second until Ctrl-C")
        action.add_argument("--namespace", metavar="NS", default=argparse.SUPPRESS, help="of the driveline node")


def run(arguments: argparse.Namespace) -> int:
    """Ask the driveline, print its answer."""
    from tcc_sim.nodes.children import require_ros
    from tcc_sim.scene import meaning_of, parse_assignments

    values = parse_assignments(arguments.assignments) if arguments.action == "set" else {}
    meanings = {key: meaning_of(key) for key in (arguments.keys if arguments.action == "get" else ())}
    require_ros()
    from tcc_sim.nodes.operator import operator

    with operator(arguments.namespace) as ask:
        if arguments.action in ("reset", "step"):
            say(ask.trigger(arguments.action))
        elif arguments.action in ("pause", "resume"):
            say(ask.pause(arguments.action == "pause"))
        elif arguments.action == "set":
            say(ask.change(values))
        elif arguments.action == "get":
            for key, value in ask.values(list(meanings)).items():
                shown = list(value) if hasattr(value, "__iter__") and not isinstance(value, str) else value
                say(f"{key} {shown}{f' {meanings[key].unit}' if meanings[key].unit else ''}")
        else:
            tell = partial(say, flush=True)  # Standard output may be a pipe.
            try:
                say(ask.command(arguments.action, arguments.value, arguments.rate or 0.0, tell=tell))
            except KeyboardInterrupt:
                say("no more is sent")
    return 0
