"""`tcc-sim watch` and `tcc-sim control`: show running nodes in Rerun, and operate a driveline without `ros2`."""

from __future__ import annotations

import argparse
import math
import signal
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from tcc_sim.cli.arguments import add_namespace
from tcc_sim.cli.options import Form, command, keywords_of, number, of, parameters_of
from tcc_sim.output.files import new_file
from tcc_sim.output.terminal import say

ACTIONS = {
    "reset": "return to the initial state and simulation time 0",
    "pause": "stop simulated time",
    "resume": "continue simulated time",
    "step": "advance a paused driveline by one tick",
    "set": "change parameters together; if one is refused, none changes",
    "get": "print parameters with their units",
    "torque": "send an engine torque command, N m",
    "pressure": "send an actuation pressure command, Pa",
}
COMMAND = "tcc_sim.nodes.operator:Operator.command"
FORMS = {"value": Form("X", number(-math.inf, math.inf)), "rate": Form("HZ", number(0.1, 1000.0, "Hz"))}


@command(add_namespace, forms={"connect": Form("URL")})
def watch(arguments: argparse.Namespace, rrd: Path | None = None, spawn: bool = False, connect: str | None = None,
          web: bool = False) -> int:
    """Show running nodes live in Rerun.

    example : watch --rrd live.rrd
    prints : after Ctrl-C, the number of states shown and missed
    writes : --rrd FILE a Rerun recording; otherwise nothing
    rrd : write a Rerun file; at 1 kHz the file grows by about 5 MB a minute, memory by half a MB
    spawn : start a viewer (the default)
    connect : send to a running viewer, rerun+http://HOST:PORT/proxy
    web : serve a viewer for a browser on this machine, and print its address
    """
    from tcc_sim.nodes.children import require_ros

    require_ros()
    if rrd is not None:
        new_file(rrd)
    from tcc_sim.nodes import watcher
    from tcc_sim.nodes.children import web_viewer
    from tcc_sim.views.rerun_stream import check_viewer

    if connect is not None:
        check_viewer(connect)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with ExitStack() as stack:
        if web:
            viewer = stack.enter_context(web_viewer())
            say(f"viewer: {viewer.page}", flush=True)
            connect = viewer.url
        say(watcher.watch(arguments.namespace, lambda text: print(text, file=sys.stderr), web=web, file=rrd,
                          spawn=rrd is None and connect is None, url=connect))
    return 0


def add_actions(parser: argparse.ArgumentParser) -> None:
    """Add the actions with their values, and the namespace."""
    add_namespace(parser)
    actions = parser.add_subparsers(title="actions", dest="action", metavar="ACTION", required=True,
                                    parser_class=type(parser))
    for name, text in ACTIONS.items():
        action = actions.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        values = action.add_argument_group("values")
        if name == "set":
            values.add_argument("assignments", nargs="+", metavar="KEY=VALUE", help="scene keys and node options")
        elif name == "get":
            values.add_argument("keys", nargs="+", metavar="KEY", help="scene keys and node options")
        elif name in ("torque", "pressure"):
            of(COMMAND, FORMS, needed="value", without="tell")(values)
        add_namespace(action, argparse.SUPPRESS)


@command(add_actions)
def control(arguments: argparse.Namespace) -> int:
    """Reset, pause, step or command a running driveline, and get or set its parameters.

    example : control set pressure.mean=230000 engine.mean_torque=310
    prints : the answer of the node
    writes : no file
    """
    from tcc_sim.model.parameters import list_of
    from tcc_sim.nodes.children import require_ros
    from tcc_sim.nodes.options import SCENE, TEXT
    from tcc_sim.scene import meaning_of, parse_assignments

    values = parse_assignments(arguments.assignments) if arguments.action == "set" else {}
    keys = arguments.keys if arguments.action == "get" else []
    units = {key: "" if key in (SCENE, TEXT) else meaning_of(key).unit for key in (*keys, *map(list_of, keys))}
    require_ros()
    from tcc_sim.nodes.operator import operator

    with operator(arguments.namespace) as ask:
        if arguments.action in ("reset", "step", "pause", "resume"):
            say(ask.serve(arguments.action))
        elif arguments.action == "set":
            say(ask.change(values))
        elif arguments.action == "get":
            for key, value in ask.values(keys).items():
                say(f"{key} {value}{f' {units[key]}' if units[key] else ''}")
        else:
            tell = partial(say, flush=True)  # Standard output may be a pipe.
            try:
                say(ask.command(arguments.action, tell=tell, **keywords_of(arguments, parameters_of(COMMAND))))
            except KeyboardInterrupt:
                say("interrupted; no more commands are sent")
    return 0
