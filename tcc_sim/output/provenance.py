"""Head of every JSON document: format, version of the package, scene with every key, command, and units.

Keys may be added within a format; a key that changes its meaning makes a new one.
"""

from __future__ import annotations

import platform
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from tcc_sim.code_version import code_version
from tcc_sim.model.parameters import System, values_of
from tcc_sim.output.fields import units_in
from tcc_sim.result import json_of
from tcc_sim.scene import Scene
from tcc_sim.shown_units import selected_units

FORMATS: dict[str, int] = {
    "simulate": 1, "analyse": 1, "sweep": 1, "sweep_points": 1, "continue": 1, "basins": 1, "basin_rows": 1,
    "explain": 1, "figure": 1, "claims": 1, "precision": 1, "stability": 1, "realtime": 1,
    "linearise": 1, "identify": 1}
"""Format number of each kind of JSON; files of sweep_points and basin_rows have one line per point or row."""
HEAD = {"format": "kind of file and number of its format",
        "version": "release that wrote it, and a digest of its code",
        "scene": "every key of the scene, and node options of a whole one; of identify before the fit",
        "environment": "versions of python, numpy, scipy and numba (null where not installed), and the "
                       "processor",
        "command": "arguments of tcc-sim, the verb first", "units": "unit by field",
        "title": "title of a picture of the result",
        "shown_units": "unit of speeds in printed lines and pictures: rad, rpm or hz",
        "warnings": "sentences on the scene, if any"}
"""Keys that begin every JSON, with their meaning."""


def format_of(kind: str) -> str:
    """Return name and number of the format of one kind of JSON."""
    return f"tcc_sim {kind} {FORMATS[kind]}"


def head_of(kind: str, scene: Scene | System, command: Sequence[str]) -> dict[str, Any]:
    """Return the keys that begin every JSON and every file of points: five, and `warnings` if the scene has any.

    Parameters
    ----------
    kind : a key of FORMATS
    scene : the solved or recorded scene; for several scenes, the one from which they differ
    command : arguments of `tcc-sim`, the verb first
    """
    values = {"format": format_of(kind), "version": code_version(), "environment": environment(),
              "scene": scene_values(scene), "command": list(command)}
    return {**values, "warnings": warnings} if (warnings := warnings_of(scene)) else values


@cache
def environment() -> dict[str, str | None]:
    """Return the versions of the packages that compute, without loading them, and the name of the processor."""
    versions: dict[str, str | None] = {"python": platform.python_version()}
    for name in ("numpy", "scipy", "numba"):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = None
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return {**versions, "processor": line.partition(":")[2].strip()}
    return {**versions, "processor": platform.processor() or platform.machine()}


def warnings_of(scene: Scene | System) -> list[str]:
    """Return the warnings about a scene that accompany every result."""
    return (scene if isinstance(scene, Scene) else Scene("system", scene)).warnings()


def document(kind: str, result: Any, scene: Scene | System, command: Sequence[str], title: str = "") -> dict[str, Any]:
    """Return a result as JSON values, with the head (see `head_of`), the units of its fields, and the title and unit of
    its picture.
    """
    head = {**head_of(kind, scene, command), "units": units_in(result), "title": title, "shown_units": selected_units()}
    values = json_of(result)
    if "warnings" in values:  # A recording has its own.
        head["warnings"] = [*head.get("warnings", []), *values["warnings"]]
    return {**head, **{key: value for key, value in values.items() if key not in head}}


def scene_values(scene: Scene | System) -> dict[str, Any]:
    """Return every key of a scene with its value; `Scene.with_values` makes the same scene from them.

    For a System, which has no node options, those are left out.
    """
    values = dict(values_of(scene)) if isinstance(scene, System) else scene.values()
    return {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}
