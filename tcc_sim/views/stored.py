"""Results in JSON or NPZ files of commands, read back to be drawn again."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from tcc_sim.analysis.measured.orders import Judder, OrderComparison, Orders, Spectrum
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import QUANTITIES, System
from tcc_sim.output.files import read_json
from tcc_sim.output.samples import cycles_in, document_in, read_arrays
from tcc_sim.scene import Operation, Scene
from tcc_sim.trajectory import SAMPLED, UNITS, Trajectory

DRAWN = "figure", "precision", "stability"
"""Kinds of JSON that a function of a later room draws, from the file of the picture, a `Record`, title and width, inch.
"""
CYCLE_ARRAYS = "cycle_highest", "cycle_lowest", "cycle_stick_time"
ARRAYS = (*UNITS, "section_states", *CYCLE_ARRAYS, "cycle_starts", "labels")
"""Arrays of a .npz that pictures use."""
DAMAGE = LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError
"""Errors of drawing a stored result whose values have wrong types or are missing."""


class Record(SimpleNamespace):
    """JSON object whose keys are attributes too; a missing attribute is None."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)

    def __getitem__(self, name: str) -> Any:
        return vars(self)[name]

    @staticmethod
    def of(value: Any) -> Any:
        """Return a JSON value with every object replaced by a Record."""
        if isinstance(value, Mapping):
            return Record(**{name: Record.of(part) for name, part in value.items()})
        return [Record.of(part) for part in value] if isinstance(value, list) else value


def read_stored(path: Path) -> dict[str, Any]:
    """Return the JSON in a .json or .npz file of a command; `arrays` has the arrays of the .npz.

    Raise InputError: the suffix is wrong, the file cannot be read, or no command of this version wrote it.
    """
    if path.suffix not in (".json", ".npz"):
        raise InputError(f"{path} must end in .json or .npz")
    if path.suffix == ".json":
        return read_json(path)
    arrays = read_arrays(path, ("document", *ARRAYS))
    return {**document_in(path, arrays), "arrays": arrays}


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


def revived(values: Mapping[str, Any], name: str) -> Any:
    """Return the result for `plots.plot` that a JSON holds, of the file `name`.

    Raise InputError: the JSON has no picture, or the data of its picture are in another file.
    """
    kind = kind_of(values)
    orders, measured = (_of(Orders, {**values[name], "judder": _of(Judder, values[name]["judder"])})
                        if name in values else None for name in ("orders", "measured_orders"))
    if orders is not None:
        return orders if measured is None else OrderComparison(measured, orders)
    if kind in ("simulate", "analyse") and "arrays" in values:
        return _run(values)
    if "spectrum" in values:
        return _of(Spectrum, values["spectrum"])
    if kind in ("simulate", "analyse"):
        words = list(values.get("command") or ["simulate", "SCENE"])
        given = [k for k, word in enumerate(words) if word in ("--json", "--plot", "--out")]
        words = [word for k, word in enumerate(words) if k not in given and k - 1 not in given and word != "--force"]
        again = shlex.join([*(["analyse", "DIR/recording"] if words[0] == "demo" else words), "--out", "FILE.npz"])
        raise InputError(f"the JSON of {kind} has no samples to draw; give the file of samples that this command "
                         f"writes: tcc-sim {again}")
    if kind == "explain":
        return Scene("", System(), Operation()).with_values(values["scene"])
    if kind == "basins" and "arrays" in values:
        return {**values, "labels": values["arrays"]["labels"]}
    if kind in DRAWN:
        return Record.of({name: part for name, part in values.items() if name != "arrays"})
    if kind in ("sweep", "continue", "basins", "linearise", "identify"):
        return values
    raise InputError(f"{name} holds no result of a command" if not kind else
                     f"{name} is the JSON of {kind}, of which there is no picture")


def _of(kind: Callable[..., Any], values: Mapping[str, Any]) -> Any:
    """Return a result of a class of arrays; None for a field that the JSON omits."""
    return kind(**{item.name: np.array(value, np.float64) if isinstance(value := values.get(item.name), list) else value
                   for item in fields(kind)})  # type: ignore[arg-type]


def _run(values: Mapping[str, Any]) -> Any:
    """Return the run in the samples of `simulate` or `analyse`, with its summary and spectrum."""
    first, arrays = Scene("", System(), Operation()).with_values(values["scene"]), values["arrays"]
    cycles = len(arrays.get("cycle_highest", ()))
    shapes = {**dict.fromkeys(UNITS, (len(arrays["t"]),)), **dict.fromkeys(CYCLE_ARRAYS, (cycles,)),
              "section_states": (cycles + 1, 3)}
    for name, shape in shapes.items():
        if name in arrays and arrays[name].shape != shape:
            raise ValueError(f"array {name} has the shape {arrays[name].shape}; it must be {shape}")
    scene, systems = first, list[tuple[float, System]]()
    for segment in values.get("segments", ()):
        scene = scene.with_values({key: value for key, value in segment["changes"].items() if key in QUANTITIES})
        if segment["run"] == values["run"]:
            systems.append((segment["start"], scene.system))
    run = Trajectory(**{name: arrays[name] for name in SAMPLED if name in arrays}, cycle=first.system.cycle,
                     solver=values["solver"], system=first.system, cycles=cycles_in(arrays),
                     largest_step=1.5 * values["tick_s"] if values.get("tick_s") else math.inf,
                     systems=tuple(systems))
    spectrum = _of(Spectrum, values["spectrum"]) if "spectrum" in values else None
    return SimpleNamespace(trajectory=run, summary=Record(**values), spectrum=spectrum)
