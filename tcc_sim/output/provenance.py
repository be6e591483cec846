"""What every JSON says of itself: format, version of the package, scene with every key, and the command.

The format names a JSON Schema that comes with the package, `schemas/<kind>.json` beside this module. A schema lists
every key with its meaning; keys may be added within a format, and a key that changes its meaning makes a new one.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

from tcc_sim import __version__
from tcc_sim.model.parameters import System, values_of
from tcc_sim.scene import OPERATION_QUANTITIES, Scene

FORMATS: dict[str, int] = {
    "simulate": 1, "analyse": 1, "sweep": 1, "sweep_points": 1, "continue": 1, "basins": 1, "basin_rows": 1,
    "explain": 1, "figure": 1, "claims": 1, "precision": 1, "stability": 1, "soak": 1, "realtime": 1}
"""Kinds of JSON with the number of their schema; sweep_points and basin_rows are files of one line a point or row."""


def format_of(kind: str) -> str:
    """Name and version of the schema of one kind."""
    return f"tcc_sim {kind} {FORMATS[kind]}"


def said(kind: str, scene: Scene | System, command: Sequence[str]) -> dict[str, Any]:
    """The four keys that begin every JSON.

    Parameters
    ----------
    kind : a key of FORMATS
    scene : what was solved or recorded; where there are several, the one that they are changes of
    command : the arguments of `tcc-sim`, the verb first
    """
    return {"format": format_of(kind), "version": __version__, "scene": scene_values(scene), "command": list(command)}


def document(kind: str, values: Mapping[str, Any], scene: Scene | System, command: Sequence[str]) -> dict[str, Any]:
    """`values` with what is said of them before; see `said`."""
    head = said(kind, scene, command)
    return {**head, **{key: value for key, value in values.items() if key not in head}}


def scene_values(scene: Scene | System) -> dict[str, Any]:
    """Every key of a scene with its value, from which `Scene.with_values` makes the same scene again.

    A System has no node options, so they are left out then.
    """
    system = scene if isinstance(scene, System) else scene.system
    found = {key: list(value) if isinstance(value, tuple) else value for key, value in values_of(system)}
    if isinstance(scene, Scene):
        options = dataclasses.asdict(scene.operation)
        found.update({key: options[key] for key in OPERATION_QUANTITIES})
    return found


def schema(kind: str) -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of one kind."""
    text = resources.files(__package__).joinpath("schemas").joinpath(f"{kind}.json").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text)
    return found
