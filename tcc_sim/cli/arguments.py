"""What several verbs ask for: numbers within a range, ranges of scene keys, and files that must not exist yet."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tcc_sim.errors import InputError, check_folder, check_suffix, printable, require
from tcc_sim.output.files import STANDARD_OUTPUT, check_name, draft, replaceable, write_json
from tcc_sim.output.shown_units import in_words, show_order
from tcc_sim.output.terminal import say

if TYPE_CHECKING:
    from tcc_sim.model.parameters import System
    from tcc_sim.scene import Scene
    from tcc_sim.sweeps.simulation import Plan


def number(low: float, high: float, unit: str = "", kind: type[float] | type[int] = float) -> Callable[[str], Any]:
    """An argparse type: a number from `low` to `high`; the error names the value, the unit and the range.

    Parameters
    ----------
    kind : int takes whole numbers only
    """
    what = "a whole number" if kind is int else "a number"

    def read(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            span = f" from {low:g} to {high:g} {unit}".rstrip() if math.isfinite(high) else ""
            raise argparse.ArgumentTypeError(f"{text!r} must be {what}{span}")
        return value

    return read


def values_of_range(text: str, option: str = "--over", even: bool = False) -> tuple[str, list[float]]:
    """KEY and its values: evenly spaced, or evenly in logarithm with `:log`, both ends included; or those of a list.
    `even` takes evenly spaced ones only.

    Raises
    ------
    InputError
        Anything else.

    Examples
    --------
    >>> values_of_range("engine.frequency=1:100:3:log")
    ('engine.frequency', [1.0, 10.0, 100.0])
    >>> values_of_range("engine.frequency=80,90.5,140")
    ('engine.frequency', [80.0, 90.5, 140.0])
    """
    key, equals, numbers = text.partition("=")
    others = "" if even else ", KEY=START:STOP:COUNT:log or KEY=VALUE,VALUE,..."
    wrong = InputError(f"{option} is {text!r}; it must be KEY=START:STOP:COUNT{others}")
    if not equals:
        raise wrong
    if not even and "," in numbers and ":" not in numbers:
        return key, _numbers(numbers.split(","), wrong)
    logarithmic = not even and numbers.endswith(":log")
    return key, spaced(numbers.removesuffix(":log") if logarithmic else numbers, option, logarithmic, wrong)


def spaced(text: str, option: str, logarithmic: bool = True, wrong: InputError | None = None) -> list[float]:
    """The values of START:STOP:COUNT, both ends included, evenly in logarithm or evenly.

    Raises
    ------
    InputError
        Anything else: `wrong` where it is given.
    """
    wrong = wrong or InputError(f"{option} is {text!r}; it must be START:STOP:COUNT, two numbers and a whole number")
    parts = text.split(":")
    if len(parts) != 3:
        raise wrong
    start, stop = _numbers(parts[:2], wrong)
    try:
        count = int(parts[2])
    except ValueError:
        raise wrong from None
    from tcc_sim.sweeps.settings import DEFAULTS  # What most verbs need not load.

    if not 1 <= count <= DEFAULTS.most_values:
        raise InputError(f"{option} has a count of {count}; it must be 1 to {DEFAULTS.most_values}")
    if logarithmic and not start * stop > 0.0:
        raise InputError(f"{option} goes from {start:g} to {stop:g}; values that are even in logarithm must be above "
                         "0, or all below it")
    import numpy as np

    return [float(x) for x in (np.geomspace if logarithmic else np.linspace)(start, stop, count)]


def bounds_of_range(text: str, option: str, names: str = "START:STOP") -> tuple[str, float, float]:
    """KEY, the smaller and the larger number of KEY=LOW:HIGH, which must differ.

    Raises
    ------
    InputError
        Anything else.
    """
    key, equals, numbers = text.partition("=")
    wrong = InputError(f"{option} is {text!r}; it must be KEY={names}")
    parts = numbers.split(":")
    if not equals or len(parts) != 2:
        raise wrong
    low, high = sorted(_numbers(parts, wrong))
    if low == high:
        raise InputError(f"{option} is {text!r}; the two values must differ")
    return key, low, high


def _numbers(words: Sequence[str], wrong: InputError) -> list[float]:
    """Finite numbers; `wrong` is raised for anything else."""
    try:
        found = [float(word) for word in words]
    except ValueError:
        raise wrong from None
    if not all(map(math.isfinite, found)):
        raise wrong
    return found


def new_file(path: Path, force: bool = False) -> Path:
    """`path`, once it is sure that nothing is overwritten and that its directory is there.

    Raises
    ------
    InputError
        The file exists and `force` is off, what is there is no regular file, its name is too long, or it has no
        directory to be in.
    """
    check_name(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory; name a file")
    if replaceable(path) and not force:
        raise InputError(f"{path} exists; it is not overwritten")
    check_folder(path)
    return path


def add_scene(parser: argparse.ArgumentParser, more: str = "") -> None:
    """SCENE and --set of the verbs that work on a scene; `more` is what the verb has to say of --set."""
    parser.add_argument("scene", metavar="SCENE", help="name of a bundled scene, or a file")
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[],
                        help=f"change a key of the scene{more}")


def scene_of(arguments: argparse.Namespace, more: Mapping[str, Any] | None = None) -> Scene:
    """The scene that SCENE names, with the changes of --set and `more`."""
    from tcc_sim.scene import load_scene, parse_assignments

    given = parse_assignments(arguments.set)
    for key in given:
        if f"{key}_times" in (more or {}):
            raise InputError(f"--set {key} beside --profile {key}: the profile takes its place; leave one of them out")
    scene = load_scene(arguments.scene).with_values({**given, **(more or {})})
    show_order(scene.system.engine.order)
    return scene


def refuse_swept(assignments: list[str], keys: Sequence[str]) -> None:
    """Raise InputError where `--set` gives a key that the command goes through itself."""
    for word in assignments:
        key = word.partition("=")[0]
        if key in keys:
            raise InputError(f"--set {word}: the command goes through {key} itself; leave one of the two out")


def add_workers(parser: argparse.ArgumentParser) -> None:
    """--jobs and --dask of the verbs whose work is many equal parts."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", metavar="N", type=int, help="threads (default: all cores)")
    where.add_argument("--dask", metavar="ADDRESS", help="Dask scheduler, such as tcp://127.0.0.1:8786")


def add_solver(parser: argparse.ArgumentParser) -> None:
    """How a scene is solved, and what costs more than the figures that are always given."""
    parser.add_argument("--solver", metavar="NAME", default="auto", help="name of a solver (default auto)")
    parser.add_argument("--rtol", metavar="R", type=float, help="relative tolerance of an adaptive solver")
    parser.add_argument("--step", metavar="H", type=float, help="step of a fixed-step solver, s")
    parser.add_argument("--damping", action="store_true", help="work out the equivalent damping (21) too")
    parser.add_argument("--lyapunov", action="store_true", help="work out the largest Lyapunov exponent too")


def add_spectrum(parser: argparse.ArgumentParser) -> None:
    """--spectrum and --pulses of the verbs that take apart a run by frequency."""
    parser.add_argument("--spectrum", action="store_true", help="work out the spectra of slip speed and shaft torque "
                        "in the steady state too, over frequency and order; --plot then draws them")
    parser.add_argument("--pulses", metavar="N", type=number(1, 10_000, kind=int), default=1,
                        help="of the tacho column of a table in a crank revolution (default 1)")


def solver_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """What `add_solver` asks for, as `Plan` takes it."""
    return {name: getattr(arguments, name) for name in ("solver", "rtol", "step", "damping", "lyapunov")}


def plan_of(arguments: argparse.Namespace, **more: Any) -> Plan:
    """How a motion is solved, from --cycles, --duration, --discard and what `add_solver` asks for.

    Raises
    ------
    InputError
        A value out of its range.
    """
    from tcc_sim.sweeps.simulation import Plan

    discard = arguments.discard
    if discard is not None and discard != "auto":
        try:
            discard = int(discard)
        except ValueError:
            raise InputError(f"--discard is {discard!r}; it must be a number of cycles or auto") from None
    return Plan(cycles=arguments.cycles, duration=arguments.duration, discard=discard, **solver_options(arguments),
                **more)


def add_outputs(parser: argparse.ArgumentParser, json: str, out: str = "", metavar: str = "FILE",
                force: str = "replace files that exist") -> None:
    """--json, --out where `out` says what it is, --plot, --width, --title and --force of verbs that draw a result."""
    parser.add_argument("--json", metavar="FILE", type=Path, help=f"{json}; - is standard output")
    if out:
        parser.add_argument("--out", metavar=metavar, type=Path, help=out)
    parser.add_argument("--plot", metavar="FILE", type=Path, help="a picture of the result: .png, .svg or .pdf")
    parser.add_argument("--width", choices=("column", "page"), default="page", help="of the picture in a paper (page)")
    parser.add_argument("--title", metavar="T", help="over the picture (default: the scene or recording)")
    parser.add_argument("--units", choices=("rad", "rpm", "hz"), default="rad", help="of speeds and frequencies in "
                        "what is printed and drawn: rad/s, revolutions a minute, or hertz; files stay in rad/s (rad)")
    parser.add_argument("--force", action="store_true", help=force)


def check_outputs(arguments: argparse.Namespace, suffixes: Sequence[str] = (), *more: Path | None) -> None:
    """Raise before anything is computed where one of the files that --json, --out and --plot name, or one of `more`,
    cannot become a new one.

    Parameters
    ----------
    suffixes : that --out may have; any where there are none, and then the verb looks after --out itself

    Raises
    ------
    InputError
        Another suffix, a file that exists and is not to be replaced, or one that is asked for twice.
    MissingPackage
        matplotlib is not installed, and --plot asks for it, or what --dask needs.
    """
    plot, out = getattr(arguments, "plot", None), getattr(arguments, "out", None)
    if out is not None and suffixes:
        check_suffix(out, suffixes, "--out ")
    named = [path for path in (arguments.json, out, plot, *more) if path not in (None, STANDARD_OUTPUT)]
    for k, path in enumerate(named):
        if path.absolute() in [other.absolute() for other in named[:k]]:
            raise InputError(f"{path} is asked for twice")
    if plot is not None:
        from tcc_sim.views.plots import check_picture

        check_picture(plot, arguments.width)
    for path in named:
        if path != out or suffixes:
            new_file(path, arguments.force)
    if getattr(arguments, "dask", None) is not None:
        require("distributed", "--dask")


@contextmanager
def drawn(arguments: argparse.Namespace, result: Any, title: str = "") -> Iterator[None]:
    """Draw a result where --plot asks for it, below --title or else `title`; the file appears when the `with` ends."""
    if arguments.plot is None:
        yield
        return
    from tcc_sim.views.plots import plot

    with draft(arguments.plot) as part:
        plot(result, part, arguments.width, title=printable(title if arguments.title is None else arguments.title))
        yield


def plot_result(arguments: argparse.Namespace, result: Any, title: str = "") -> None:
    """Draw a result where --plot asks for it."""
    with drawn(arguments, result, title):
        pass


def present(arguments: argparse.Namespace, scene: Scene | System, result: Any,
            lines: Iterable[str] = ()) -> None:
    """Write a result as JSON where --json asks for it, and print the lines unless that is what is printed.

    Parameters
    ----------
    scene : what was solved or recorded, which the JSON says
    result : a result, or a function that gives one
    """
    from tcc_sim.output.provenance import warnings_of

    for warning in warnings_of(scene):
        print(f"tcc-sim: {warning}", file=sys.stderr)
    if arguments.json is not None:
        write_json(arguments.json, document_of(arguments, scene, result() if callable(result) else result))
    if arguments.json != STANDARD_OUTPUT and (said := "\n".join(lines)):
        say(in_words(said))


def document_of(arguments: argparse.Namespace, scene: Scene | System, result: Any) -> dict[str, Any]:
    """The JSON of a result of this command, for --json and within a .npz."""
    from tcc_sim.output.provenance import document

    return document(arguments.verb, result, scene, arguments.words)
