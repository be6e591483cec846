"""Options and checks that several verbs share: numbers in a range, scene, tables, solver, outputs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcc_sim.cli.options import Form, Source, keywords_of, number, numbers_apart, options_in, reader
from tcc_sim.errors import InputError, check_suffix, one_line, printable, require
from tcc_sim.output.files import STANDARD_OUTPUT, draft, new_file, write_json
from tcc_sim.output.terminal import say
from tcc_sim.shown_units import UNITS, show_in
from tcc_sim.topics import JOINT_NAMES

if TYPE_CHECKING:
    from tcc_sim.model.parameters import System
    from tcc_sim.replay.recorded import Recording
    from tcc_sim.scene import Scene
    from tcc_sim.sweeps.simulation import Plan


def _joints(text: str) -> dict[str, str]:
    names = dict(part.partition("=")[::2] for part in text.split(","))
    if not all(names.values()) or not set(names) <= set(JOINT_NAMES):
        raise ValueError
    return names


def _targets(text: str) -> float | dict[float, float]:
    """Return the target in `V`, or the targets by time in `T:V,T:V`."""
    if ":" not in text:
        return float(text)
    pairs = [(float(t), float(value)) for t, value in (part.split(":") for part in text.split(","))]
    if len(dict(pairs)) < len(pairs):
        raise argparse.ArgumentTypeError(f"{text!r} has two targets for one time")
    return dict(pairs)


FORMS = {
    "profile": Form("KEY=T:V,T:V", repeated=True), "inputs": Form("RUN|FILE", Path), "inputs_scene": Form("SCENE"),
    "joints": Form("flywheel=NAME,clutch_plate=NAME", reader(
        _joints, "flywheel=NAME,clutch_plate=NAME")), "columns": Form("NAME=COLUMN[:UNIT],..."),
    "from_": Form("S", float), "to": Form("S", float), "pulses": Form("N", number(1, 10_000, kind=int)),
    "discard": Form("N|auto", reader(lambda text: text if text == "auto" else int(text), "a number of cycles or auto")),
    "target": Form("V|T:V,T:V", reader(_targets, "a slip speed in rad/s, or T:V,T:V with times in s")),
    "limits": Form("LOW:HIGH", reader(lambda text: numbers_apart(text, ":", 2), "LOW:HIGH, two pressures in Pa")),
    "connect": Form("URL"), "rrd": Form("FILE", Path),
    "dask": Form("ADDRESS"), "quantiles": Form("P,P,...", reader(
        lambda text: numbers_apart(text, ","), "numbers separated by commas")), "scene": Form("SCENE")}
"""Values that several verbs write otherwise than as a number or a word, by keyword."""
UNPLANNED = "section_points lyapunov_cycles"
"""Fields of a plan that are no options."""
OF_SWEEPS = f"{UNPLANNED} direction orders"
"""The same of a verb that solves once."""
SIMULATION, ANALYSIS = "tcc_sim.functions:simulation", "tcc_sim.functions:analysis"
PLAN = "tcc_sim.sweeps.simulation:Plan"
DRIVELINE = "joints topic driveline"
"""Options that select the driveline of a recording."""


def say_of_own_scene(recording: Recording, scene: str | None) -> None:
    """Print on standard error that --scene is left out if the recording has its scene."""
    if scene is not None and recording.file.scene_text is not None:
        say_of_table([f"{recording.path} holds its scene, which is used; --scene {scene} is left out"])


def add_scene(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Add SCENE and --set of the verbs that work on a scene; `more` ends the help of --set."""
    parser.add_argument("scene", metavar="SCENE", help="name of a bundled scene, or a file")
    add_changes(parser, more)


def add_changes(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Add --set."""
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[],
                        help=f"change a key of the scene{more}; may be repeated")


def scene_of(arguments: argparse.Namespace) -> Scene:
    """Load the scene that SCENE names, with the changes of --set."""
    from tcc_sim.scene import load_scene, parse_assignments

    scene = load_scene(arguments.scene).with_changes(parse_assignments(arguments.set))
    show_in(order=scene.system.engine.order)
    return scene


def refuse_swept(assignments: list[str], keys: Sequence[str]) -> None:
    """Raise InputError if --set gives a key that the command itself sets, or engine.speed for engine.frequency."""
    from tcc_sim.model.parameters import frequency_key

    own = {frequency_key(key): key for key in keys}
    for word in assignments:
        if (key := frequency_key(word.partition("=")[0])) in own:
            raise InputError(f"--set {word}: the command itself sets {own[key]}; remove one of the two")


def add_namespace(parser: argparse.ArgumentParser, default: str = "") -> None:
    """Add --namespace of the verbs that talk to a running driveline."""
    parser.add_argument_group("nodes").add_argument("--namespace", metavar="NS", default=default,
                                                    help="namespace of the driveline node")


def say_of_table(sentences: Iterable[str]) -> None:
    """Print sentences on how a table was read on standard error."""
    for sentence in sentences:
        print(f"tcc-sim: {one_line(sentence)}", file=sys.stderr)


def plan_of(arguments: argparse.Namespace, **more: Any) -> Plan:
    """Return the plan of a simulation from the options that are fields of it, and from `more`."""
    from tcc_sim.sweeps.simulation import Plan

    return Plan(**keywords_of(arguments, options_in(PLAN, OF_SWEEPS)), **more)


def outputs(json: str, out: str = "", metavar: str = "FILE", force: str = "replace existing files") -> Source:
    """Return the source of --json, --out with the help `out` if that is not empty, and --force; --plot, --width and
    --title of the picture.
    """
    def add(parser: argparse.ArgumentParser) -> None:
        output, picture = parser.add_argument_group("output"), parser.add_argument_group("picture")
        output.add_argument("--json", metavar="FILE", type=Path, help=f"write {json} as JSON; - is standard output")
        if out:
            output.add_argument("--out", metavar=metavar, type=Path, help=f"write {out}")
        add_units(output)
        output.add_argument("--force", action="store_true", help=force)
        picture.add_argument("--plot", metavar="FILE", type=Path, help="draw the result: .png, .svg or .pdf")
        add_layout(picture, "the scene or recording")

    return add


def add_units(group: argparse._ActionsContainer, default: str = "rad") -> None:
    """Add --units with its default in words."""
    group.add_argument("--units", choices=list(UNITS), help="unit of printed and drawn speeds and frequencies: rad/s, "
                       f"revolutions per minute or hertz; files stay in rad/s (default: {default})")


def add_layout(group: argparse._ActionsContainer, title: str) -> None:
    """Add --width, --style, and --title with its default in words."""
    group.add_argument("--style", metavar="FILE", type=Path,
                       help="matplotlib style file (.mplstyle) for fonts, sizes, lines, grid and resolution; curves "
                            "keep their colours")
    group.add_argument("--width", choices=("column", "page"), default="page",
                       help="width of the picture in a paper (default page)")
    group.add_argument("--title", metavar="T", help=f"title above the picture (default: {title})")


def check_used(arguments: argparse.Namespace, options: Mapping[str, tuple[object, tuple[str, ...]]]) -> None:
    """Raise InputError for an option that changes nothing, as none of the files that it is for is written.

    options : default of each option, and the options of its files
    """
    for name, (default, files) in options.items():
        if getattr(arguments, name, default) != default and all(getattr(arguments, one, None) is None for one in files):
            raise InputError(f"--{name} is only for {' and '.join(f'--{one}' for one in files)}; give "
                             f"{'it' if len(files) == 1 else 'one of them'} a file, or leave --{name} out")


def check_outputs(arguments: argparse.Namespace, suffixes: Sequence[str] = (), *more: Path | None) -> None:
    """Check, before the computation, the files of --json, --out (with one of `suffixes`; if there are none, the verb
    checks --out itself), --plot and `more`.

    Raise InputError: a wrong suffix, an existing file without --force, one file for two options, or an option of a
    picture without one; MissingPackage: --plot without matplotlib, or --dask without distributed.
    """
    plot, out = getattr(arguments, "plot", None), getattr(arguments, "out", None)
    if hasattr(arguments, "plot"):
        check_used(arguments, {"style": (None, ("plot",)), "width": ("page", ("plot",)),
                               "title": (None, ("plot", "json", "out"))})
    if out is not None and suffixes:
        check_suffix(out, suffixes, "--out ")
        if out.suffix == ".parquet":
            require("pyarrow", "a Parquet file")
    named = [path for path in (arguments.json, out, plot, *more) if path not in (None, STANDARD_OUTPUT)]
    for k, path in enumerate(named):
        if path.absolute() in [other.absolute() for other in named[:k]]:
            raise InputError(f"two options name the file {path}")
    if plot is not None:
        from tcc_sim.views.plots import check_picture

        check_picture(plot, arguments.width)
    for path in named:
        if path != out or suffixes:
            new_file(path, arguments.force)
    if getattr(arguments, "dask", None) is not None:
        require("distributed", "--dask")


def deliver(arguments: argparse.Namespace, scene: Scene | System, result: Any, lines: Iterable[str] = (), *,
            shown: Any = ..., write: Callable[[dict[str, Any]], object] | None = None) -> None:
    """Write the files of a result, print its lines, unless its JSON goes to standard output, and draw its picture.

    shown : the result that --plot draws; None for no picture
    write : function that writes the file of --out, from the JSON document; None for one with the result
    """
    from tcc_sim.output.provenance import document, warnings_of

    title, recording = getattr(arguments, "title", ""), getattr(arguments, "recording", None)
    out = getattr(arguments, "out", None)
    if title is None:
        title = recording.name if recording is not None else getattr(scene, "name", "")
    if out is not None or arguments.json is not None:
        whole = document(arguments.verb, result, scene, arguments.words, title)
    if out is not None and write is not None:
        write(whole)
    elif out is not None:
        from tcc_sim.output.samples import write_result

        write_result(out, result, whole)
    say_of_table(warnings_of(scene))
    if arguments.json is not None:
        write_json(arguments.json, whole)
    aloud = arguments.json != STANDARD_OUTPUT
    if aloud and (text := "\n".join(lines)):
        say(text, flush=True)
    picture = getattr(arguments, "plot", None) if shown is not None else None
    if picture is not None:  # Drawing takes longest; if it is interrupted, the results are there.
        from tcc_sim.views.plots import plot

        with draft(picture) as part:
            plot(result if shown is ... else shown, part, arguments.width, title=printable(title))
        if aloud:
            say(f"picture in {picture}")
