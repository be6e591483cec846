"""`tcc-sim scenes`, `explain`, `fmu`, `recover`, `import` and `plot`: list, print and estimate a scene, export it as an
FMU, make a complete bag from a damaged one and a recording from a foreign bag, and draw a stored result.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from tcc_sim.cli import arguments as common
from tcc_sim.cli.options import Form, command, keywords_of, number, of, options_in
from tcc_sim.errors import InputError, counted, one_line, printable
from tcc_sim.output.files import new_file
from tcc_sim.output.terminal import say
from tcc_sim.parameter_file import description_in
from tcc_sim.scene import bundled_scenes, load_scene, parse_assignments

EXPLANATION = "tcc_sim.functions:explanation"


@command(common.add_changes)
def scenes(arguments: argparse.Namespace, show: str | None = None) -> None:
    """List the bundled scenes.

    example : scenes --show fig02
    prints : name and description of each scene; with --show the parameter file of one scene
    writes : no file; scenes --show fig02 > mine.yaml makes a scene to edit
    show : print this scene (or a file) as a parameter file with every key
    """
    if show is not None:
        sys.stdout.write(load_scene(show).with_changes(parse_assignments(arguments.set)).text())
        return
    if arguments.set:
        raise InputError("--set changes the scene that --show prints; give --show NAME too")
    bundled = bundled_scenes()
    width = max(map(len, bundled), default=0)
    for name, path in bundled.items():
        say(f"{name:<{width}}  {description_in(path.read_text(encoding='utf-8'))}")


@command(common.add_scene, of(EXPLANATION), common.outputs("the estimates and terms"))
def explain(arguments: argparse.Namespace) -> None:
    """Estimate how a scene behaves, and list the terms of its equations.

    example : explain fig02
    prints : natural frequencies, torques, critical slope, friction law, closed forms, terms in use and left out
    writes : --json FILE holds all numbers, --plot FILE a picture of the friction law
    """
    scene = common.scene_of(arguments)
    common.check_outputs(arguments)
    from tcc_sim.output.estimates import estimate_lines, estimates_of
    from tcc_sim.output.explanation import closed_form_lines, explained, friction_lines

    explanation = explained(scene, **keywords_of(arguments, options_in(EXPLANATION)))
    document = explanation.as_json()
    torque = "published" if scene.operation.publish_shaft_torque else "not published (publish_shaft_torque)"
    lines = [f"{document['name']}: {document['description']}", *estimate_lines(estimates_of(scene.system)),
             *friction_lines(document["friction"]), *closed_form_lines(document["closed_forms"]),
             f"far end of the shaft: still, until output_speed moves it; shaft_torque is {torque}",
             f"solver offline: {document['solver']}"]
    for what in ("terms", "topics", "modules") if arguments.cost else ("terms",):
        lines += [what, f"  in use:   {', '.join(document[what]['held']) or 'none'}",
                  f"  left out: {', '.join(document[what]['left_out']) or 'none'}"]
    if arguments.cost:
        lines += ["kernel arguments", "  " + "; ".join(f"{name}: {kind}" for name, kind in document["kernel"].items())]
    common.deliver(arguments, scene, explanation, [*lines, *_step_lines(document["step"], arguments.cost)], shown=scene)


def _step_lines(step: dict[str, Any] | None, cost: bool) -> Iterator[str]:
    """Yield lines with the sub-steps, calls and, if `cost`, the measured run time of a tick."""
    if step is None:
        yield "real-time step: none; the real-time solver needs friction.law smoothed"
        return
    yield f"real-time step: {counted(step['sub_steps'], 'sub-step')} in a tick of {step['tick_s'] * 1e3:g} ms"
    if cost:
        yield (f"  run time of a tick: {step['own_s'] * 1e6:.2f} us; with all terms {step['general_s'] * 1e6:.2f} us, "
               f"{step['ratio']:.2f} times as long")
        for verb, terms in (("takes", step["terms_s"]), ("is left out and saves", step["saved_s"])):
            for name, seconds in terms.items():
                amount = "less than the noise" if seconds is None else (
                    f"{seconds * 1e6:.2f} us, {100.0 * seconds / step['own_s']:.0f} %")
                yield f"  {name} {verb} {amount}"
        yield f"  noise of these times: {step['noise_s'] * 1e6:.2f} us"
    for name, calls in step["own_calls"].items():
        yield f"  {name} per sub-step: {calls:.3g}; with all terms {step['general_calls'][name]:.3g}"


FMU = "tcc_sim.functions:fmu_file"
TOPICS_SHOWN = 100
"""Largest number of topics listed."""


@command(forms={"recording": Form("RUN", Path), "out": Form("DIR", Path)})
def recover(arguments: argparse.Namespace, recording: Path, out: Path | None = None) -> None:
    """Make a complete, indexed bag from a recording that was cut short or damaged.

    example : recover run1 --out run1_whole
    prints : recovered messages by topic, and the parts that are missing
    writes : the directory --out with the new bag; the old one stays unchanged
    recording : bag directory or .mcap file, which stays unchanged
    out : directory to create (default: RUN_recovered beside it)
    """
    from tcc_sim.recording import recovery
    from tcc_sim.recording.reader import Run

    result = recovery.recover(Run(recording), out or recovery.default_directory(recording))
    say(printable(f"recovered {counted(sum(result.messages.values()), 'message')} into {result.directory}"))
    for topic, count in list(result.messages.items())[:TOPICS_SHOWN]:
        say(f"  {one_line(topic)}: {count}")
    if len(result.messages) > TOPICS_SHOWN:
        say(f"  and {counted(len(result.messages) - TOPICS_SHOWN, 'more topic')}")
    for sentence in result.missing:
        say(f"  note: {one_line(sentence)}")
    if not result.missing:
        say("  nothing is missing; the original was complete" if result.complete else "  nothing is missing")


@command(of("tcc_sim.recording.importer:import_bag", common.FORMS, common.DRIVELINE),
         forms={"bag": Form("BAG", Path), "recording": Form("RUN", Path)})
def import_(arguments: argparse.Namespace, bag: Path, recording: Path) -> None:
    """Write a bag in SQLite, of ROS 1 or of another program as a recording.

    example : import lab.db3 run1 --joints flywheel=engine,clutch_plate=turbine
    prints : number of states and runs, losses, and what the bag does not state
    writes : the directory RUN with the new bag; the old one stays unchanged
    bag : a bag in SQLite, of ROS 1, compressed, or of another program in MCAP; it stays unchanged
    recording : directory to create
    """
    from tcc_sim.recording.importer import import_bag

    result = import_bag(bag, recording, **keywords_of(arguments, common.DRIVELINE))
    say(printable(f"imported {counted(result.states, 'state')} of {counted(result.runs, 'run')} into "
                  f"{result.directory}"))
    for sentence in result.notes:
        say(f"  note: {one_line(sentence)}")


@command(partial(common.add_layout, title="that of the command"),
         partial(common.add_units, default="those of the command"),
         forms={"result": Form("FILE.json|FILE.npz", Path)})
def plot(arguments: argparse.Namespace, result: Path, plot: Path | None = None, force: bool = False) -> None:
    """Draw the result in a .json or .npz file of another verb again.

    example : plot run.json --plot run.pdf --width column
    prints : the name of the picture
    writes : --plot FILE, the picture
    result : file that --json or --out wrote; a run is in that of --out
    plot : the picture: .pdf, .svg or .png (default: the result's name with .pdf, in this directory)
    force : replace an existing file
    """
    from tcc_sim.output.files import draft
    from tcc_sim.views import plots

    path, title = plot or Path(result.with_suffix(".pdf").name), arguments.title
    plots.check_picture(path, arguments.width)
    new_file(path, force)
    with draft(path) as part:
        plots.plot(result, part, arguments.width, title=title and printable(title), units=arguments.units)
    say(f"picture in {path}")


@command(common.add_scene, of(FMU, {"step": Form("S", number(5e-5, 1.0, "s")), "out": Form("FILE.fmu", Path)}))
def fmu(arguments: argparse.Namespace) -> None:
    """Export the real-time step of a scene in C as a co-simulation FMU.

    example : fmu controlled --fmi 3 --out clutch.fmu
    prints : the name of the FMU and its contents
    writes : --out FILE, the FMU
    """
    from tcc_sim.fmi.export import compiler, folder_of_binary
    from tcc_sim.functions import fmu_file

    scene = common.scene_of(arguments)
    path = fmu_file(scene, **keywords_of(arguments, options_in(FMU)))
    common.say_of_table(scene.warnings())
    if folder := folder_of_binary(arguments.fmi, arguments.sources_only):
        held = f"sources in C99 and a binary for {folder}"
    elif arguments.sources_only or compiler() is not None:
        held = "sources in C99; importers compile them"
    else:
        held = "sources in C99; no C compiler was found here, so importers compile them"
    say(f"{path}: FMI {arguments.fmi}.0 for co-simulation, {held}")
