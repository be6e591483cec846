"""`tcc-sim demo`, `watch` and `control`: run a scene on ROS 2, record it, analyse the recording, and write a Rerun file
and a picture; show running nodes in Rerun; and operate a driveline without `ros2`.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import shlex
import shutil
import signal
import sys
import time
from contextlib import ExitStack
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tcc_sim.cli.arguments import add_namespace
from tcc_sim.cli.options import Form, command, keywords_of, number, of, parameters_of
from tcc_sim.errors import InputError
from tcc_sim.output.files import new_directory, new_file
from tcc_sim.output.terminal import say
from tcc_sim.sweeps.progress import seconds_bar

if TYPE_CHECKING:
    from tcc_sim.scene import Scene

TARGET = 20.0
"""Target slip speed of the slip controller in scenes with a commanded pressure, rad/s."""
CONTROLLED = "controlled"
"""Default scene for the user's controller."""
RATE = 250.0
"""Ticks per second of the default demo, Hz: two slow cores that lose 3 ms at a time still answer each state in time."""
STEP = 0.1
"""Time between two checks of the nodes, s."""


@command(forms={"scene": Form("S"), "controller": Form("COMMAND"), "duration": Form("SECONDS", number(
    0.5, 86400.0, "s")), "out": Form("DIR", Path)})
def demo(arguments: argparse.Namespace, scene: str | None = None, controller: str | None = None, duration: float = 10.0,
         out: Path | None = None) -> None:
    """Run nodes, recorder and controller on ROS 2, analyse the recording and draw it.

    example : demo --scene controlled --duration 5 --out run1
    prints : the summary of the recorded motion and the next commands to try
    writes : the directory --out with recording/, analysis.json, run.rrd (Rerun) and overview.png
    scene : name of a bundled scene, or a file (default: commands at 250 Hz, with a node that publishes both commands)
    controller : command that starts your controller instead of the example, such as 'python my_node.py'; the default
        scene is then controlled
    duration : recorded time, s
    out : directory to create (default: tcc_demo_ and the time)
    """
    from tcc_sim.nodes.children import require_ros
    from tcc_sim.scene import NODE_SCENE, load_scene

    name = scene or (CONTROLLED if controller is not None else NODE_SCENE)
    driven = load_scene(name)
    commands = (_split_command(controller, driven) if controller is not None else
                controller_of(driven) if scene is not None else ("commander", {}))
    require_ros()
    directory = new_directory(out or Path(f"tcc_demo_{datetime.now():%Y%m%d_%H%M%S}"))
    missing = [name for name in ("rerun", "matplotlib") if importlib.util.find_spec(name) is None]
    if missing:
        say(f"{' and '.join(missing)} not installed: no {'run.rrd' if 'rerun' in missing else 'overview.png'}"
            f"{' and no overview.png' if len(missing) == 2 else ''}; to get both: pip install 'tcc_sim[view]'")
    directory.mkdir()
    recording = directory / "recording"
    rate = RATE if scene is None and controller is None else driven.operation.rate
    _record(driven, {"scene": name, "rate": rate}, recording, duration, commands)
    _analyse(driven, recording, directory, missing, arguments)


def _split_command(command: str, scene: Scene) -> list[str]:
    """Split the command that starts a controller into words, as a shell would."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise InputError(f"--controller {command!r}: {str(error).lower()}") from None
    if not words or shutil.which(words[0]) is None:
        raise InputError(f"--controller {command!r}: there is no program {words[0] if words else ''!r}")
    system = scene.system
    if "topic" not in (system.engine.source, system.pressure.source):
        raise InputError(f"scene {scene.name} takes no commands: engine.source and pressure.source are harmonic; "
                         f"--controller needs topic for one of them, as in scene {CONTROLLED}")
    return words


def _record(scene: Scene, driveline: dict[str, object], recording: Path, duration: float,
            controller: tuple[str, dict[str, object]] | list[str] | None) -> None:
    """Run driveline, recorder and the sender of commands as processes for `duration` seconds of real time.

    Ctrl-C ends them sooner.
    """
    from tcc_sim.nodes.children import Session

    say(f"scene {scene.name}: {scene.description}")
    if isinstance(controller, list):
        say(f"controller: {shlex.join(controller)}")
    elif controller is not None:
        say("commander: answers every state with an engine torque and a pressure" if controller[0] == "commander" else
            f"slip controller: holds a mean slip speed of {TARGET:g} rad/s")
    operation = scene.operation
    paced = operation.pacing != "lockstep" and operation.real_time_factor > 0.0
    session = Session(recording, driveline, controller, real_time=paced and not operation.thread_priority)
    say(f"recording {duration:g} s at {driveline['rate']:g} Hz to {recording}", flush=True)
    try:
        with seconds_bar("recording", duration) as done:
            began = time.monotonic()
            while (elapsed := time.monotonic() - began) < duration:
                done(elapsed)
                session.watch(min(STEP, duration - elapsed))
    except KeyboardInterrupt:
        say("stopped early; the recording up to here is analysed")
    finally:
        session.stop()


def controller_of(scene: Scene) -> tuple[str, dict[str, object]] | None:
    """Return the slip controller with its parameters for a scene whose pressure alone is commanded, else None."""
    system = scene.system
    if (system.engine.source, system.pressure.source) != ("harmonic", "topic"):
        return None
    return "slip_controller", {
        "target": TARGET, "frequency": system.engine.frequency, "inertia": system.driveline.flywheel_inertia,
        "torque_per_pressure": system.torque_per_pressure, "step": 1.0 / scene.operation.rate}


def _analyse(scene: Scene, recording: Path, directory: Path, missing: list[str],
             arguments: argparse.Namespace) -> None:
    """Replay the asked time of the recording into analysis.json, run.rrd and overview.png, and print the summary."""
    from tcc_sim.output.files import write_json
    from tcc_sim.output.provenance import document
    from tcc_sim.recording.columns import Window
    from tcc_sim.replay.replay import replay

    result = replay(recording, rrd=None if "rerun" in missing else directory / "run.rrd", progress=True,
                    window=Window(end=arguments.duration))
    write_json(directory / "analysis.json", document("analyse", result, result.scene, arguments.words,
                                                      title=scene.name))
    made = ["recording", "analysis.json"] + ([] if "rerun" in missing else ["run.rrd"])
    if "rerun" not in missing:
        from tcc_sim.views.rerun_layout import write_layout

        write_layout(recording)
    if "matplotlib" not in missing:
        from tcc_sim.views.plots import plot

        plot(result, directory / "overview.png", title=scene.name)
        made.append("overview.png")
    say("\n".join(result.lines()))
    say(f"{directory}/ holds {', '.join(made)}\nnext:")
    say(f"  tcc-sim analyse {recording} --to {arguments.duration:g} --verify")
    if "rerun" not in missing:
        say(f"  rerun {directory / 'run.rrd'}")
    say(f"  tcc-sim explain {scene.name}\n  tcc-sim demo --scene chaos")


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
          web: bool = False) -> None:
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
            page, connect = stack.enter_context(web_viewer())
            say(f"viewer: {page}", flush=True)
        say(watcher.watch(arguments.namespace, lambda text: print(text, file=sys.stderr), web=web, file=rrd,
                          spawn=rrd is None and connect is None, url=connect))


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
def control(arguments: argparse.Namespace) -> None:
    """Reset, pause, step or command a running driveline, and get or set its parameters.

    example : control set pressure.mean=230000 engine.mean_torque=310
    prints : the answer of the node
    writes : no file
    """
    from tcc_sim.model.parameters import list_of
    from tcc_sim.nodes.children import require_ros
    from tcc_sim.nodes.parameters import BESIDE
    from tcc_sim.scene import meaning_of, parse_assignments

    values = parse_assignments(arguments.assignments) if arguments.action == "set" else {}
    keys = arguments.keys if arguments.action == "get" else []
    units = {key: "" if key in BESIDE else meaning_of(key).unit for key in (*keys, *map(list_of, keys))}
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
