"""Parameter files of ROS 2: folders of the bundled ones, and a reader that refuses tags, aliases and duplicate keys."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import Any

from tcc_sim.errors import InputError

LARGEST_FILE = 1 << 16
"""Largest scene file, bytes; a scene needs 1 kB, and the YAML reader takes seconds per MB."""
DEEPEST = 20
"""Deepest nesting in a scene file; the time of the YAML reader grows with its square."""


def read_parameters(text: str) -> dict[str, object]:
    """Return the parameters of the only node in a parameter file, by dotted keys, as ROS 2 names them.

    Raises InputError: the text is not YAML or not a parameter file, or has an alias, a tag, a duplicate key or too deep
    nesting.
    """
    import yaml

    try:
        depth = 0
        for event in yaml.parse(text, Loader=_safe_loader()):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            line = event.start_mark.line + 1 if event.start_mark is not None else 0
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
                raise InputError(f"line {line}: YAML anchors and aliases are not allowed in a scene")
            if depth > DEEPEST:
                raise InputError(f"line {line}: nested more than {DEEPEST} deep; a scene needs at most 3")
            if getattr(event, "tag", None):
                raise InputError(f"line {line}: YAML tags are not allowed in a scene")
        tree = yaml.load(text, Loader=_unique_loader())  # noqa: S506
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark is not None else ""
        raise InputError(f"{where}not valid YAML ({getattr(error, 'problem', None) or 'unreadable'})") from None
    except InputError:
        raise
    except (RecursionError, ValueError):
        raise InputError("not valid YAML (unreadable)") from None
    if not isinstance(tree, dict) or len(tree) != 1:
        raise InputError("not a scene: it must contain one node, '/**:', with ros__parameters")
    node = next(iter(tree.values()))
    if not isinstance(node, dict) or set(node) != {"ros__parameters"} or not isinstance(node["ros__parameters"], dict):
        raise InputError("not a scene: '/**:' must contain ros__parameters and nothing else")
    return _flatten(node["ros__parameters"])


def _flatten(tree: dict[str, Any], prefix: str = "", depth: int = 0) -> dict[str, object]:
    """Return nested parameters by dotted keys."""
    out: dict[str, object] = {}
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict) and depth < 4:
            nested = _flatten(value, name + ".", depth + 1)
        else:
            nested = {name: value}
        for item in nested:
            if item in out:
                raise InputError(f"{item} is given twice")
        out.update(nested)
    return out


def _safe_loader() -> Any:
    """Return the SafeLoader of libyaml, which ROS 2 reads parameters with; PyYAML may have been built without it."""
    import yaml

    return getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def dumped(content: object) -> str:
    """Return plain values as YAML, by libyaml where PyYAML has it: a fifth of the time, the same text."""
    import yaml

    def by(dumper: Any) -> str:
        return str(yaml.dump(content, Dumper=dumper, sort_keys=False))

    try:
        return by(getattr(yaml, "CSafeDumper", yaml.SafeDumper))
    except UnicodeEncodeError:  # A name of a file that is not UTF-8.
        return by(yaml.SafeDumper)


@cache
def _unique_loader() -> Any:
    """Return a SafeLoader that refuses duplicate keys, made when the first file is read."""
    class UniqueLoader(_safe_loader()):  # type: ignore[misc]
        """SafeLoader that refuses duplicate keys."""

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            """Construct a mapping; raise InputError for a duplicate key."""
            seen = set()
            for key_node, _ in node.value:
                key = self.construct_object(key_node, deep=True)
                if not isinstance(key, str):
                    raise InputError(f"line {key_node.start_mark.line + 1}: {key!r} is not a parameter name")
                if key in seen:
                    raise InputError(f"line {key_node.start_mark.line + 1}: {key} is given twice")
                seen.add(key)
            mapping: dict[Any, Any] = super().construct_mapping(node, deep)
            return mapping

    return UniqueLoader


def description_in(text: str) -> str:
    """Return the comment in the first line of a parameter file."""
    first = text.lstrip().partition("\n")[0]
    return first.lstrip("# ").strip() if first.startswith("#") else ""


def bundled_scenes(module: str = __file__, prefix: str = sys.prefix) -> dict[str, Path]:
    """Return name and file of every bundled scene, installed by colcon or pip or in the source tree.

    module, prefix : this file, and the prefix of the Python installation
    """
    above = Path(module).resolve().parents
    source = [above[1] / "config"] if (above[1] / "setup.py").is_file() else []
    for folder in (*source, *(parent / "share" / "tcc_sim" / "config" for parent in (*above, Path(prefix)))):
        scenes = {p.stem: p for p in sorted(folder.glob("*.yaml"))}
        if scenes:
            return scenes
    return {}
