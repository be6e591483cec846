"""The table of node parameters: every value is checked by type and range."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest

from tcc_sim.errors import InputError
from tcc_sim.nodes.options import OPTIONS

FIELDS = [(kind, item) for kind in OPTIONS.values() for item in dataclasses.fields(kind)]


def beyond(item: Any) -> list[object]:
    """Values that the option must refuse."""
    meaning = item.metadata["quantity"]
    if item.type == "bool":
        return [1, "yes", 0.0]
    if item.type.startswith("tuple"):
        return [3, "one", [""], [True], [-1.0]] if item.type != "tuple[str, ...]" else [3, "one", [""], [1]]
    if item.type == "str":
        return ["sideways", 3.0, True] if meaning.choices else []
    below = meaning.low if meaning.above else math.nextafter(meaning.low, -math.inf) if item.type == "float" else -1
    above = [] if math.isinf(meaning.high) else [math.nextafter(meaning.high, math.inf) if item.type == "float" else
                                                 int(meaning.high) * 2]
    return [below, *above, math.nan, math.inf, True, "fast", None, *([0.5] if item.type == "int" else [])]


@pytest.mark.parametrize(("kind", "item"), FIELDS, ids=lambda value: getattr(value, "name", None))
def test_an_option_refuses_what_it_cannot_be_and_says_its_name(kind: Any, item: Any) -> None:
    for value in beyond(item):
        with pytest.raises(InputError, match=rf"^{item.name} is "):
            kind(**{item.name: value})


@pytest.mark.parametrize(("kind", "item"), FIELDS, ids=lambda value: getattr(value, "name", None))
def test_an_option_takes_its_ends_and_its_default(kind: Any, item: Any) -> None:
    meaning = item.metadata["quantity"]
    ends = [end for end in (meaning.low, meaning.high) if not math.isinf(end) and not (meaning.above and end == 0.0)]
    whole = [int(end) for end in ends] if item.type == "int" else []
    for value in [item.default, *meaning.choices, *([0] if meaning.zero else []),
                  *(ends if item.type == "float" else whole)]:
        if item.name not in ("frequency", "step"):  # Their ends do not fit the other's default.
            assert getattr(kind(**{item.name: value}), item.name) == value
