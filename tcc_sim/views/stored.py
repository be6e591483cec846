"""Results in JSON or NPZ files of commands, read back to be drawn again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from zipfile import BadZipFile

import numpy as np

from tcc_sim.analysis.orders import Judder, OrderComparison, Orders
from tcc_sim.analysis.spectra import Spectrum
from tcc_sim.errors import InputError
from tcc_sim.later_rooms import from_later_room
from tcc_sim.model.parameters import System
from tcc_sim.output.files import read_json
from tcc_sim.output.samples import cycles_in
from tcc_sim.scene import Operation, Scene
from tcc_sim.sweeps.simulation import Plan, simulate
from tcc_sim.trajectory import UNITS, Trajectory

DRAWN = {"analyse": "draw_again", "figure": "draw_figure", "precision": "draw_precision", "stability": "draw_stability"}
"""Function of a later room that draws a kind of JSON. Arguments: file of the picture, `Record`, title, and width in
inches.
"""


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
    recorded place.

    Raises
    ------
    InputError
        The suffix is wrong, the file cannot be read, or no command of this version wrote it.
    """
    if path.suffix == ".npz":
        return _arrays_in(path)
    if path.suffix != ".json":
        raise InputError(f"{path} must end in .json or .npz")
    found = read_json(path)
    beside = getattr(arguments_in(found), "out", None)
    if beside is not None and beside.suffix == ".npz":
        for place in (path.parent / beside.name, beside):
            if place.is_file() and (other := _arrays_in(place)).get("command") == found.get("command"):
                return {**found, "arrays": other["arrays"]}
    return found


def _arrays_in(path: Path) -> dict[str, Any]:
    """Return the JSON in a .npz, with its arrays."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, BadZipFile) as error:
        raise InputError(f"{path} cannot be read as .npz: {error}") from None
    if "document" not in arrays:
        raise InputError(f"{path} does not say which command wrote it; write it again with --out")
    found: dict[str, Any] = json.loads(str(arrays.pop("document")))
    return {**found, "arrays": arrays}


def arguments_in(values: Mapping[str, Any]) -> Any:
    """Return the arguments of the command that wrote a JSON; an empty namespace if it records no command.

    Raises
    ------
    InputError
        This version does not accept the command.
    """
    words = values.get("command")
    return from_later_room("arguments_of")(words) if words else SimpleNamespace()


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
    source = next((Path(found) for name in ("recording", "scene", "measured")
                   if (found := getattr(arguments, name, None)) is not None), Path())
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
    found: Callable[..., Path] = from_later_room(DRAWN[kind])
    return found


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
    found = from_later_room("fit_again")(arguments)
    for now, then in zip(found.parameters, values["parameters"]):
        if abs(now.value - then["value"]) > 1e-3 * (then["standard_error"] or abs(then["value"])):
            raise InputError(f"{arguments.measured} has changed: {now.key} is {now.value:.6g} in the fit and "
                             f"{then['value']:.6g} in the JSON")
    return found


def scene_in(values: Mapping[str, Any]) -> Scene:
    """Return the scene in a JSON."""
    return Scene(title_of(values), System(), Operation()).with_values(values["scene"])


def spectrum_in(values: Mapping[str, Any]) -> Spectrum | None:
    """Return the spectrum in a JSON, or None."""
    found: Spectrum | None = _of(Spectrum, values["spectrum"]) if "spectrum" in values else None
    return found


def _orders(values: Mapping[str, Any]) -> Orders:
    """Return the orders in a JSON."""
    found: Orders = _of(Orders, {**values, "judder": _of(Judder, values["judder"])})
    return found


def _of(kind: Callable[..., Any], values: Mapping[str, Any]) -> Any:
    """Return a result of a class of arrays; None for a field that the JSON omits."""
    return kind(**{item.name: np.array(value, np.float64) if isinstance(value := values.get(item.name), list) else value
                   for item in fields(kind)})  # type: ignore[arg-type]


def _simulation(values: Mapping[str, Any]) -> Any:
    """Return the run of `simulate` from its samples; without samples, solve the scene again."""
    scene, arrays, arguments = scene_in(values), values.get("arrays"), arguments_in(values)
    inputs = getattr(arguments, "inputs", None)
    there = inputs is not None and inputs.exists()
    source = from_later_room("inputs_of")(arguments) if there else None
    if arrays is not None:
        run = Trajectory(**{name: arrays[name] for name in UNITS if name in arrays}, cycle=scene.system.cycle,
                         solver=values["solver"], system=scene.system, cycles=cycles_in(arrays))
    elif inputs is None:
        run = simulate(scene, Plan(**values["plan"])).trajectory
    elif there:
        driven = from_later_room("driven_by")(scene, source, arguments.hold)
        run = simulate(driven, Plan(**values["plan"]), samples_per_cycle=INPUT_SAMPLES).trajectory
    else:
        raise InputError(f"{inputs}, which has the inputs, does not exist; tcc-sim plot FILE.npz draws the samples "
                         "that simulate ... --out FILE.npz wrote")
    twin = from_later_room("twin_of")(source, run) if there else None
    return twin or SimpleNamespace(trajectory=run, summary=Record(values), spectrum=spectrum_in(values))
