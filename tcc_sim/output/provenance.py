"""What every JSON says of itself: format, version of the package, scene with every key, and the command.

The format names a JSON Schema that comes with the package: `schemas/<kind>.yaml` beside this module, with what several
kinds share in `schemas/shared.yaml`. A schema lists every key with its meaning and unit; keys may be added within a
format, and a key that changes its meaning makes a new one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

from tcc_sim import __version__
from tcc_sim.model.parameters import System, values_of
from tcc_sim.output.fields import units_in
from tcc_sim.result import json_of
from tcc_sim.scene import Scene

FORMATS: dict[str, int] = {
    "simulate": 1, "analyse": 1, "sweep": 1, "sweep_points": 1, "continue": 1, "basins": 1, "basin_rows": 1,
    "explain": 1, "figure": 1, "claims": 1, "precision": 1, "stability": 1, "soak": 1, "realtime": 1,
    "linearise": 1, "identify": 1}
"""Kinds of JSON with the number of their schema; sweep_points and basin_rows are files of one line a point or row."""


def format_of(kind: str) -> str:
    """Name and version of the schema of one kind."""
    return f"tcc_sim {kind} {FORMATS[kind]}"


def said(kind: str, scene: Scene | System, command: Sequence[str]) -> dict[str, Any]:
    """The keys that begin every JSON: four, and `warnings` where the scene has some.

    Parameters
    ----------
    kind : a key of FORMATS
    scene : what was solved or recorded; where there are several, the one that they are changes of
    command : the arguments of `tcc-sim`, the verb first
    """
    head = {"format": format_of(kind), "version": __version__, "scene": scene_values(scene), "command": list(command)}
    return {**head, "warnings": warnings} if (warnings := warnings_of(scene)) else head


def warnings_of(scene: Scene | System) -> list[str]:
    """Sentences on a scene that go with every result."""
    return (scene if isinstance(scene, Scene) else Scene("system", scene)).warnings()


def document(kind: str, result: Any, scene: Scene | System, command: Sequence[str]) -> dict[str, Any]:
    """A result as JSON values, with what is said of it before (see `said`) and with the units of its fields."""
    head = {**said(kind, scene, command), "units": units_in(result)}
    values = json_of(result)
    if "warnings" in values:  # A recording has its own.
        head["warnings"] = [*head.get("warnings", []), *values["warnings"]]
    return {**head, **{key: value for key, value in values.items() if key not in head}}


def scene_values(scene: Scene | System) -> dict[str, Any]:
    """Every key of a scene with its value, from which `Scene.with_values` makes the same scene again.

    A System has no node options, so they are left out then.
    """
    values = dict(values_of(scene)) if isinstance(scene, System) else scene.values()
    return {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}


def schema(kind: str) -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of one kind, a key of FORMATS, complete by itself."""
    shared, own = _read("shared"), _read(kind)
    summary = shared["summary"]
    nullable = {key: _nullable(rule) for key, rule in summary["properties"].items()}
    shared["summary_or_null"] = {**summary, "properties": nullable}
    shared["summary_lists"] = {**summary, "properties": {key: _lists(rule) for key, rule in nullable.items()}}
    first = own["oneOf"][0] if "oneOf" in own else own
    named = {"const": format_of(kind), "description": "name and version of this schema"}
    first["properties"] = {"format": named, **first.get("properties", {})}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"urn:tcc_sim:{kind}:{FORMATS[kind]}",
            **own, "$defs": shared}


def _read(name: str) -> dict[str, Any]:
    """One of the files of `schemas`."""
    import yaml

    text = resources.files(__package__).joinpath("schemas").joinpath(f"{name}.yaml").read_text(encoding="utf-8")
    found: dict[str, Any] = yaml.safe_load(text)
    return found


def _nullable(rule: Mapping[str, Any]) -> dict[str, Any]:
    """The rule of a value that may be null as well."""
    if "$ref" in rule or "anyOf" in rule:
        return {"description": rule.get("description", ""), "anyOf": [rule, {"type": "null"}]}
    if "enum" in rule:
        return {**rule, "enum": [*rule["enum"], None]}
    types = rule["type"] if isinstance(rule["type"], list) else [rule["type"]]
    return {**rule, "type": list(dict.fromkeys([*types, "null"]))}


def _lists(rule: Mapping[str, Any]) -> dict[str, Any]:
    """The rule of a list of values of a rule, or of a list of such lists."""
    bare = {key: value for key, value in rule.items() if key != "description"}
    return {"description": rule.get("description", ""), "type": "array",
            "items": {"anyOf": [bare, {"type": "array", "items": bare}]}}
