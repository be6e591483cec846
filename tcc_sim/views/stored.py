"""Results that commands wrote as JSON or NPZ, read back so that they can be drawn again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from zipfile import BadZipFile

import numpy as np

from tcc_sim.analysis.orders import Judder, Orders
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.output.files import read_json
from tcc_sim.output.samples import cycles_in
from tcc_sim.scene import Operation, Scene
from tcc_sim.sweeps.simulation import Plan, simulate
from tcc_sim.trajectory import UNITS, Trajectory

DRAWN = {"analyse": ("tcc_sim.replay.replay", "draw_again"), "figure": ("tcc_sim.paper.redrawn", "draw_stored"),
         "precision": ("tcc_sim.benchmarks.redrawn", "draw_stored_precision"),
         "stability": ("tcc_sim.benchmarks.redrawn", "draw_stored_stability")}
"""By kind of JSON the module and the function of a later room that draws it: they take a picture's file, a `Record`, a
title and a width in inches.
"""


class Record:
    """A JSON object whose keys are attributes as well; an attribute that it does not have is None."""

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
        """The keys with their values."""
        return vars(self).items()

    @staticmethod
    def of(value: Any) -> Any:
        """A JSON value with a Record in the place of every object."""
        if isinstance(value, Mapping):
            return Record({name: Record.of(part) for name, part in value.items()})
        return [Record.of(part) for part in value] if isinstance(value, list) else value


def read_stored(path: Path) -> dict[str, Any]:
    """The JSON that a command wrote to a .json, or within a .npz, whose arrays are then below `arrays`.

    The arrays of a .npz that --out wrote beside a .json are taken along where both are of one command.

    Raises
    ------
    InputError
        Another suffix, a file that cannot be read, or one that no command of this version wrote.
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
    """The JSON within a .npz, with its arrays."""
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
    """The arguments of the command that wrote a JSON, as its parser gives them; without any where none is recorded.

    Raises
    ------
    InputError
        A command that this version does not take.
    """
    words = values.get("command")
    return _later("tcc_sim.cli", "arguments_of")(words) if words else SimpleNamespace()


def _later(module: str, name: str) -> Callable[..., Any]:
    """A function of a later room."""
    found: Callable[..., Any] = getattr(import_module(module), name)
    return found


def kind_of(values: Mapping[str, Any]) -> str:
    """The verb that a JSON is of; of values without a format the one that its keys show."""
    parts = str(values.get("format", "")).split()
    if len(parts) == 3:
        return parts[1]
    for key, kind in (("branches", "continue"), ("plane", "basins"), ("scatter", "sweep"), ("over", "sweep"),
                      ("gain", "linearise"), ("parameters", "identify")):
        if key in values:
            return kind
    return ""


def title_of(values: Mapping[str, Any]) -> str:
    """The title that the command gave its picture."""
    arguments, kind = arguments_in(values), kind_of(values)
    given = getattr(arguments, "title", None)
    if given is not None or kind in ("figure", "precision", "stability"):
        return given or ""
    source = next((Path(found) for name in ("recording", "scene", "measured")
                   if (found := getattr(arguments, name, None)) is not None), Path())
    return source.name if kind == "analyse" else source.stem


def revived(values: Mapping[str, Any]) -> Any:
    """A result that `plots.plot` draws, made of a JSON.

    Raises
    ------
    InputError
        A JSON of which there is no picture, or one without the data of its picture.
    """
    kind = kind_of(values)
    if "orders" in values:
        return _orders(values["orders"], scene_in(values))
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
    """The function that draws a JSON of one of the kinds of DRAWN."""
    return _later(*DRAWN[kind])


def missing_data(values: Mapping[str, Any]) -> str:
    """What a JSON lacks for its picture and how that is made up for, in words; empty where it lacks nothing."""
    kind = kind_of(values)
    if "orders" in values or "arrays" in values:
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


def _measured(values: Mapping[str, Any]) -> bool:
    """Whether the measurements of `identify` are still there."""
    measured = getattr(arguments_in(values), "measured", None)
    return measured is not None and measured.exists()


def _identification(values: Mapping[str, Any]) -> Any:
    """The fit of `identify` made again; InputError where it gives other values, since the measurements have changed."""
    arguments = arguments_in(values)
    found = _later("tcc_sim.cli.identify", "fit_again")(arguments)
    for now, then in zip(found.parameters, values["parameters"]):
        if abs(now.value - then["value"]) > 1e-3 * (then["standard_error"] or abs(then["value"])):
            raise InputError(f"{arguments.measured} has changed: {now.key} is {now.value:.6g} in the fit and "
                             f"{then['value']:.6g} in the JSON")
    return found


def scene_in(values: Mapping[str, Any]) -> Scene:
    """The scene that a JSON states."""
    return Scene(title_of(values), System(), Operation()).with_values(values["scene"])


def _orders(values: Mapping[str, Any], scene: Scene) -> Orders:
    """The orders of a run."""
    found: dict[str, Any] = {item.name: np.array(values[item.name]) for item in fields(Orders)
                             if item.name in values and item.name != "judder"}
    judder = Judder(**{name: np.array(column) for name, column in values["judder"].items()})
    return Orders(**found, judder=judder)


def _simulation(values: Mapping[str, Any]) -> Any:
    """The run of `simulate`: its samples where there are any, else the scene solved again as the JSON says."""
    scene, arrays = scene_in(values), values.get("arrays")
    if getattr(arguments_in(values), "inputs", None) is not None and arrays is None:
        raise InputError("the inputs came from a table, which this JSON does not hold; simulate ... --out FILE.npz "
                         "keeps the samples")
    if arrays is None:
        return simulate(scene, Plan(**values["plan"]))
    run = Trajectory(**{name: arrays[name] for name in UNITS if name in arrays}, cycle=scene.system.cycle,
                     solver=values["solver"], system=scene.system, cycles=cycles_in(arrays))
    return SimpleNamespace(trajectory=run, summary=Record(values))
