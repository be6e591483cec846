"""Results in JSON or NPZ files of commands, read back to be drawn again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from tcc_sim.analysis.orders import Judder, OrderComparison, Orders
from tcc_sim.analysis.spectra import Spectrum
from tcc_sim.analysis.summary import Summary
from tcc_sim.errors import InputError, TccError, one_line
from tcc_sim.later_rooms import from_later_room
from tcc_sim.model.parameters import System
from tcc_sim.output.files import read_json
from tcc_sim.output.samples import cycles_in
from tcc_sim.output.stored_files import check_lengths, document_in, read_arrays
from tcc_sim.result import reported_of
from tcc_sim.scene import Operation, Scene
from tcc_sim.sweeps.simulation import Plan, simulate
from tcc_sim.trajectory import UNITS, Trajectory

DRAWN = {"analyse": "draw_again", "figure": "draw_figure", "precision": "draw_precision", "stability": "draw_stability"}
"""Function of a later room that draws a kind of JSON. Arguments: file of the picture, `Record`, title, and width in
inches.
"""


CYCLE_ARRAYS = ("cycle_highest", "cycle_lowest", "cycle_stick_time")
ARRAYS = (*UNITS, "section_states", *CYCLE_ARRAYS, "cycle_starts", "labels")
"""Arrays of a .npz that pictures use."""
RESULTS = tuple({entry.name or name for name, entry in reported_of(Summary).items()} | {"status", "confirmed"})
"""Results of a sweep: a value for each of the values, or rows of them."""
LISTS = {"": ("frequencies", "gain", "phase"), "orders": ("time", "frequency", "slip_speed", "shaft_torque",
                                                         "transmissibility"),
         "measured_orders": ("time", "frequency", "slip_speed", "shaft_torque", "transmissibility"),
         "spectrum": ("frequency", "order", "slip_speed", "shaft_torque"),
         "branches": ("value", "slip_speed", "plate_angle", "plate_speed", "max_slip_speed", "stick_fraction", "stable",
                      "multipliers", "events"),
         "curves": ("value", "second"), "curve": ("slip_speeds", "coefficient", "low", "high", "visited")}
"""Lists of equal length, by the key of the object, or of the objects in a list, that has them."""
INPUT_SAMPLES = 200
"""Samples per period of excitation of a run with inputs from a file, as `simulate` takes them."""


class Record:
    """JSON object whose keys are attributes too; a missing attribute is None."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        vars(self).update(values)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)

    def __getitem__(self, name: str) -> Any:
        return vars(self)[name]

    def __iter__(self) -> Iterator[str]:
        return iter(vars(self))

    def items(self) -> Any:
        """Return the keys with their values."""
        return vars(self).items()

    def get(self, name: str) -> Any:
        """Return the value of a key, or None."""
        return vars(self).get(name)

    @staticmethod
    def of(value: Any) -> Any:
        """Return a JSON value with every object replaced by a Record."""
        if isinstance(value, Mapping):
            return Record({name: Record.of(part) for name, part in value.items()})
        return [Record.of(part) for part in value] if isinstance(value, list) else value


def read_stored(path: Path) -> dict[str, Any]:
    """Return the JSON in a .json or .npz file of a command; `arrays` has the arrays of the .npz.

    With a .json, the .npz that the same command wrote with --out is read too, if it is in the same directory or at its
    recorded place. A .json of `demo` is that of `analyse` of the recording beside it.

    Raises
    ------
    InputError
        The suffix is wrong, the file cannot be read, or no command of this version wrote it.
    """
    if path.suffix == ".npz":
        return _arrays_in(path)
    if path.suffix != ".json":
        raise InputError(f"{path} must end in .json or .npz")
    document = read_json(path)
    if _demo_wrote(document):
        document["command"] = ["analyse", str((path.parent / "recording").absolute())]
    arrays_path = getattr(arguments_in(document), "out", None)
    if arrays_path is not None and arrays_path.suffix == ".npz":
        for place in (path.parent / arrays_path.name, arrays_path):
            if place.is_file() and (other := _arrays_in(place)).get("command") == document.get("command"):
                return {**document, "arrays": other["arrays"]}
    return document


def _arrays_in(path: Path) -> dict[str, Any]:
    """Return the JSON in a .npz, with the arrays that pictures use; InputError if their lengths differ."""
    arrays = read_arrays(path, ("document", *ARRAYS))
    document = document_in(path, arrays)
    samples = [name for name in UNITS if name in arrays]
    for name in (*samples, *CYCLE_ARRAYS):
        if name in arrays and arrays[name].ndim != 1:
            raise InputError(f"{path}: array {name} has {arrays[name].ndim} dimensions; it must have 1")
    check_lengths(str(path), arrays, samples)
    check_lengths(str(path), arrays, CYCLE_ARRAYS)
    states = arrays.get("section_states")
    if states is not None and states.shape != ((cycles := len(arrays.get("cycle_highest", ()))) + 1, 3):
        raise InputError(f"{path}: array section_states has the shape {states.shape}; it must be {(cycles + 1, 3)}")
    return {**document, "arrays": arrays}


@contextmanager
def refusing_damage(name: str) -> Iterator[None]:
    """Refuse a stored result, in one line, whose values have wrong types or are missing."""
    try:
        yield
    except TccError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        raise InputError(f"{name} is damaged, or no command of this version wrote it ({type(error).__name__}: "
                         f"{one_line(str(error))})") from None


def check_stored(name: str, values: Mapping[str, Any]) -> None:
    """Raise InputError if lists in the JSON of a command that belong together have different lengths."""
    kind = kind_of(values)
    if kind == "sweep":
        rows = len(values["second_values"]) if values.get("second_values") else None
        if rows is None and "scatter" not in values:
            rows = len(values["values"])
        check_lengths(name, values, RESULTS, rows)
        if values.get("second_values"):
            for key in RESULTS:
                for row in values.get(key) or ():
                    check_lengths(f"{name}: a row of {key}", {"it": row}, ["it"], len(values["values"]))
    for key, lists in LISTS.items():
        parts = values.get(key, []) if key else values
        for part in parts if isinstance(parts, list) else [parts]:
            if isinstance(part, dict):
                check_lengths(f"{name}: {key}" if key else name, part, lists)


def arguments_in(values: Mapping[str, Any]) -> Any:
    """Return the arguments of the command that wrote a JSON; an empty namespace if it records no command.

    Raises
    ------
    InputError
        This version does not accept the command, or it is `demo`, which does not name its recording.
    """
    words = values.get("command")
    if words and not (isinstance(words, list) and all(isinstance(word, str) for word in words)):
        raise InputError("the result is damaged: its command is no list of words")
    if _demo_wrote(values):
        raise InputError("a result of demo does not name its recording; give its file, DIR/analysis.json, with the "
                         "recording beside it")
    return from_later_room("arguments_of")(words) if words else SimpleNamespace()


def _demo_wrote(values: Mapping[str, Any]) -> bool:
    """Return whether `demo` wrote a JSON, whose format is that of `analyse`."""
    words = values.get("command")
    return isinstance(words, list) and words[:1] == ["demo"]


def kind_of(values: Mapping[str, Any]) -> str:
    """Return the verb that wrote a JSON; without a format, its keys show the verb."""
    parts = str(values.get("format", "")).split()
    if len(parts) == 3:
        return parts[1]
    for key, kind in (("branches", "continue"), ("plane", "basins"), ("scatter", "sweep"), ("over", "sweep"),
                      ("gain", "linearise"), ("parameters", "identify")):
        if key in values:
            return kind
    return ""


def title_of(values: Mapping[str, Any]) -> str:
    """Return the title of the picture of the command."""
    arguments, kind = arguments_in(values), kind_of(values)
    given = getattr(arguments, "title", None)
    if given is not None or kind in ("figure", "precision", "stability"):
        return given or ""
    source = next((Path(value) for name in ("recording", "scene", "measured")
                   if (value := getattr(arguments, name, None)) is not None), Path())
    return source.name if kind == "analyse" else source.stem


def revived(values: Mapping[str, Any]) -> Any:
    """Return the result for `plots.plot` that a JSON holds.

    Raises
    ------
    InputError
        The JSON has no picture, or the data of its picture are missing.
    """
    kind = kind_of(values)
    if "measured_orders" in values:
        return OrderComparison(_orders(values["measured_orders"]), _orders(values["orders"]))
    if "orders" in values:
        return _orders(values["orders"])
    if _of_table(values):
        return spectrum_in(values)
    if kind == "simulate":
        return _simulation(values)
    if kind == "explain":
        return scene_in(values)
    if kind == "basins" and "arrays" in values:
        return {**values, "labels": values["arrays"]["labels"]}
    if kind == "analyse" and "arrays" in values and not arguments_in(values).recording.exists():
        return _simulation(values)
    if kind == "identify" and _measured(values):
        return _identification(values)
    if kind in DRAWN:
        return Record.of({name: part for name, part in values.items() if name != "arrays"})
    if kind in ("sweep", "continue", "basins", "linearise", "identify"):
        return values
    raise InputError(f"there is no picture of a JSON of {kind}" if kind else "this is no result of a command")


def drawer_of(kind: str) -> Callable[..., Path]:
    """Return the function that draws a kind of DRAWN."""
    drawer: Callable[..., Path] = from_later_room(DRAWN[kind])
    return drawer


def missing_data(values: Mapping[str, Any]) -> str:
    """Return what a JSON lacks for its picture and the replacement, in words; empty if it lacks nothing."""
    kind = kind_of(values)
    if "orders" in values or "arrays" in values or _of_table(values):
        return ""
    if kind == "simulate":
        return "has no samples: the scene is solved again"
    if kind == "analyse":
        return "has no samples: the recording is read again"
    if kind == "identify":
        return ("has no samples: the fit is made again" if _measured(values) else
                "has no samples, and the measurements are not there: its parameters are drawn without the fit")
    if kind == "basins" and "over" not in values:
        return "has no cells: the attractors are drawn without them; basins ... --out FILE.npz keeps them"
    return ""


def _of_table(values: Mapping[str, Any]) -> bool:
    """Return whether a JSON is that of `analyse` of a table, which has no messages."""
    return kind_of(values) == "analyse" and "messages" not in values


def _measured(values: Mapping[str, Any]) -> bool:
    """Return whether the file with the measurements of `identify` still exists."""
    measured = getattr(arguments_in(values), "measured", None)
    return measured is not None and measured.exists()


def _identification(values: Mapping[str, Any]) -> Any:
    """Fit the measurements of `identify` again; InputError if the values differ, because the file has changed."""
    arguments = arguments_in(values)
    fit = from_later_room("fit_again")(arguments)
    for now, then in zip(fit.parameters, values["parameters"]):
        if abs(now.value - then["value"]) > 1e-3 * (then["standard_error"] or abs(then["value"])):
            raise InputError(f"{arguments.measured} has changed: {now.key} is {now.value:.6g} in the fit and "
                             f"{then['value']:.6g} in the JSON")
    return fit


def scene_in(values: Mapping[str, Any]) -> Scene:
    """Return the scene in a JSON."""
    return Scene(title_of(values), System(), Operation()).with_values(values["scene"])


def spectrum_in(values: Mapping[str, Any]) -> Spectrum | None:
    """Return the spectrum in a JSON, or None."""
    spectrum: Spectrum | None = _of(Spectrum, values["spectrum"]) if "spectrum" in values else None
    return spectrum


def _orders(values: Mapping[str, Any]) -> Orders:
    """Return the orders in a JSON."""
    orders: Orders = _of(Orders, {**values, "judder": _of(Judder, values["judder"])})
    return orders


def _of(kind: Callable[..., Any], values: Mapping[str, Any]) -> Any:
    """Return a result of a class of arrays; None for a field that the JSON omits."""
    return kind(**{item.name: np.array(value, np.float64) if isinstance(value := values.get(item.name), list) else value
                   for item in fields(kind)})  # type: ignore[arg-type]


def _simulation(values: Mapping[str, Any]) -> Any:
    """Return the run of `simulate` from its samples; without samples, solve the scene again."""
    scene, arrays, arguments = scene_in(values), values.get("arrays"), arguments_in(values)
    inputs = getattr(arguments, "inputs", None)
    readable = inputs is not None and inputs.exists()
    source = from_later_room("inputs_of")(arguments) if readable else None
    if arrays is not None:
        run = Trajectory(**{name: arrays[name] for name in UNITS if name in arrays}, cycle=scene.system.cycle,
                         solver=values["solver"], system=scene.system, cycles=cycles_in(arrays))
    elif inputs is None:
        run = simulate(scene, Plan(**values["plan"])).trajectory
    elif readable:
        driven = from_later_room("driven_by")(scene, source, arguments.hold)
        run = simulate(driven, Plan(**values["plan"]), samples_per_cycle=INPUT_SAMPLES).trajectory
    else:
        raise InputError(f"{inputs}, which has the inputs, does not exist; tcc-sim plot FILE.npz draws the samples "
                         "that simulate ... --out FILE.npz wrote")
    twin = from_later_room("twin_of")(source, run) if readable else None
    return twin or SimpleNamespace(trajectory=run, summary=Record(values), spectrum=spectrum_in(values))
