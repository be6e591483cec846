"""Whether a JSON holds exactly the fields that the page of fields documents."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from fields_page import fields_by_kind

from tcc_sim import __version__
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.output.provenance import HEAD, format_of


def valid(kind: str, found: dict[str, Any]) -> dict[str, Any]:
    """`found`, once it begins with what every JSON says of itself, and its fields and units are documented."""
    assert list(found)[:2] == ["format", "version"]
    assert (found["format"], found["version"]) == (format_of(kind), __version__)
    assert set(QUANTITIES) <= found["scene"].keys()
    assert found["command"]
    assert set(HEAD) - set(found) <= {"warnings"}
    documented = fields_by_kind(kind)
    names = set(documented)
    there = paths_in({key: value for key, value in found.items() if key not in HEAD}, names)
    assert there <= names, f"not documented: {there - names}"
    missing = {name for name, entry in documented.items() if not entry.asked_for and "." not in name} - set(found)
    assert not missing or kind in ("sweep", "figure"), f"not there: {missing}"
    for path, unit in found["units"].items():
        name = re.sub(r"\[\d+\]", "", path)
        declared = next(documented[part].unit for start in beginnings(name)
                        for part in (start, f"{start.rpartition('.')[0]}.*") if part in documented)
        assert declared == unit or "{" in declared, f"{path}: {unit}"
    lacking = {name for name in there & set(found) if documented[name].unit and "{" not in documented[name].unit
               and found[name] is not None} - set(found["units"])
    assert not lacking, f"no unit of {lacking}"
    return found


def beginnings(path: str) -> list[str]:
    """A path and all that it begins with, the longest first."""
    parts = path.split(".")
    return [".".join(parts[:k]) for k in range(len(parts), 0, -1)]


def paths_in(value: Any, names: set[str], path: str = "") -> set[str]:
    """The documented names below a value, and those that are not; the keys of a mapping are no names."""
    if not any(name.startswith(path) for name in names):
        return set()  # Nothing within it is documented.
    if isinstance(value, list):
        return {name for each in value for name in paths_in(each, names, path)}
    found = set()
    for key, each in value.items() if isinstance(value, dict) else ():
        if path and f"{path}{key}" not in names and isinstance(each, (dict, list)):
            found |= paths_in(each, names, path)  # The key of a mapping.
        elif f"{path}{key}" not in names and f"{path}*" in names and (key in QUANTITIES or key == "cycles"):
            found.add(f"{path}*")
        else:
            found |= {f"{path}{key}", *paths_in(each, names, f"{path}{key}.")}
    return found


def pixels(picture: Path) -> int:
    """Width of a PNG."""
    return int.from_bytes(picture.read_bytes()[16:20], "big")
