"""Whether a JSON is what its schema says, judged by the package jsonschema."""

from __future__ import annotations

from typing import Any

from jsonschema import Draft202012Validator

from tcc_sim import __version__
from tcc_sim.model.parameters import QUANTITIES
from tcc_sim.output.provenance import format_of, schema


def valid(kind: str, found: dict[str, Any]) -> dict[str, Any]:
    """`found`, once it is valid, begins with what every JSON says of itself, and has no key that the schema omits."""
    rules = schema(kind)
    Draft202012Validator(rules).validate(found)
    assert list(found)[:2] == ["format", "version"]
    assert (found["format"], found["version"]) == (format_of(kind), __version__)
    assert set(QUANTITIES) <= found["scene"].keys()
    assert found["command"]
    assert set(found) <= keys_of(rules), set(found) - keys_of(rules)
    return found


def keys_of(rules: dict[str, Any]) -> set[str]:
    """The top-level keys that a schema names, of the first line where it is one of a file of lines."""
    first = rules["oneOf"][0] if "oneOf" in rules else rules
    shared = [rules["$defs"][part["$ref"].rpartition("/")[2]] for part in first["allOf"]]
    return {key for part in (first, *shared) for key in part["properties"]}
