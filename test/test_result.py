"""How a result is shown: names, units, JSON, text and tables of made-up classes, each written out by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tcc_sim.model.parameters import System
from tcc_sim.result import (
    Described,
    Reported,
    Result,
    as_in,
    as_lists,
    fields_of,
    html_of,
    json_of,
    names_in,
    reported,
    reported_of,
    reporting,
    system_behind,
    units_of,
    units_of_columns,
)


@dataclass(frozen=True, repr=False)
class Wheel(Described):
    """A wheel."""

    turns: float = field(metadata=reported("turning speed", "rad/s"))
    mark: str | None = field(default=None, metadata=reported("mark", optional=True))
    spokes: int = 0

    @property
    @reporting("speed of the rim", "m/s", name="rim")
    def rim_speed(self) -> float:
        return 0.5 * self.turns


@dataclass(frozen=True)
class Bolt:
    """A bolt."""

    size: float = field(metadata=reported("size", "m"))
    torque: float | None = field(default=None, metadata=reported("torque", "N m", optional=True))


@dataclass(frozen=True)
class Load:
    """A load."""

    turns: float = field(metadata=reported("turns of the winch", "rad"))
    scaled: float = field(metadata=reported("in the unit of a key", "{over}"))


@dataclass(frozen=True, repr=False)
class Cart(Result):
    """A cart."""

    name: str = field(metadata=reported("name"))
    front: Wheel = field(metadata=reported("front wheel"))
    load: Load | None = field(metadata=reported("load", spread=True, of=(Load,)))
    bolts: tuple[Any, ...] = field(metadata=reported("bolts", listed=True, of=(Bolt,)))
    weights: Mapping[str, float] = field(metadata=reported("weights", "{*}", spread=True, optional=True))

    def columns(self) -> Mapping[str, Any]:
        return {"turns": [self.front.turns, 2.0], "size": [1.0, math.nan]}


WHEEL, LOAD = Wheel(3.0, spokes=5), Load(7.0, math.inf)
CART = Cart("a <cart>", WHEEL, LOAD, (Bolt(0.1), None, Bolt(0.2, 9.0)), {"engine.frequency": 1.5})


def test_the_reported_fields_and_properties_of_a_class_are_its_rows() -> None:
    assert list(reported_of(Wheel)) == ["turns", "mark", "rim_speed"]
    assert reported_of(Wheel)["rim_speed"] == Reported("speed of the rim", "m/s", name="rim")
    assert units_of(Wheel) == {"turns": "rad/s", "mark": "", "rim_speed": "m/s"}
    assert as_in(Bolt, "torque", optional=False) == {"reported": Reported("torque", "N m")}
    assert "turning speed, rad/s" in (Wheel.__doc__ or "")


def test_the_fields_in_json_are_those_of_parts_with_dots_or_in_the_place_of_the_part() -> None:
    assert [(name, entry.unit, entry.optional) for name, entry in fields_of(Cart)] == [
        ("name", "", False), ("front", "", False), ("front.turns", "rad/s", False), ("front.mark", "", True),
        ("front.rim", "m/s", False), ("turns", "rad", False), ("scaled", "{over}", False), ("size", "m", False),
        ("torque", "N m", True), ("*", "{*}", True)]
    assert (names_in(Wheel), names_in(Bolt)) == (["turns", "rim"], ["size"])


def test_the_unit_of_a_column_is_that_of_the_outer_field() -> None:
    names = ["turns", "front_turns", "rim", "size", "scaled", "name", "engine.frequency", "slip_speed", "nothing"]
    assert units_of_columns(Cart, names) == {
        "turns": "rad", "front_turns": "rad/s", "rim": "m/s", "size": "m", "engine.frequency": "rad/s",
        "slip_speed": "rad/s"}


def test_json_has_the_reported_fields_alone() -> None:
    assert CART.as_json() == {
        "name": "a <cart>", "front": {"turns": 3.0, "rim": 1.5}, "turns": 7.0, "scaled": None,
        "size": [0.1, None, 0.2], "torque": [None, None, 9.0], "engine.frequency": 1.5}
    bare = json_of(Cart("", Wheel(0.0, "x"), None, (None,), {}))
    assert bare == {"name": "", "front": {"turns": 0.0, "mark": "x", "rim": 0.0}, "turns": None, "scaled": None,
                    "size": [None]}
    assert as_lists([], Bolt) == {}


@pytest.mark.parametrize(("value", "shown"), [
    (1.5, 1.5), (math.nan, None), (-math.inf, None), (True, True), (3, 3), ("a", "a"), (None, None),
    (1.0 - 2.0j, [1.0, -2.0]), (complex(math.nan, 1.0), [None, 1.0]), (np.float64(0.25), 0.25), (np.int64(4), 4),
    (np.bool_(True), True), (np.array([[1.0, math.nan], [2.0, 3.0]]), [[1.0, None], [2.0, 3.0]]),
    ((1, [2.0, (math.inf,)]), [1, [2.0, [None]]]), ({1: math.nan, "b": {"c": (1,)}}, {"1": None, "b": {"c": [1]}}),
    (Wheel, Wheel)])
def test_every_kind_of_value_in_json(value: object, shown: object) -> None:
    result = json_of(value)
    assert result == shown
    assert type(result) is type(shown)


def test_the_view_in_a_notebook_escapes_names_and_is_short() -> None:
    columns = {"a": [1.0, 2.0, 1.0 / 3.0], "b<": ["x", "&", "z"]}
    shown = html_of(columns, {"a": "m"}, 2)
    assert shown.count("<tr>") == 3
    assert "a (m)" in shown
    assert "b&lt;" in shown
    assert "&amp;" in shown
    assert "1 more" in shown
    assert html_of({"k": range(30)}).count("<td>") == 20
    assert "&lt;cart&gt;" in CART._repr_html_()


def test_the_system_behind_a_result_is_found_through_its_parts() -> None:
    system = System()
    for result in (system, SimpleNamespace(system=system), SimpleNamespace(scene=SimpleNamespace(system=system)),
                   SimpleNamespace(sweeps=[SimpleNamespace(curve=SimpleNamespace(system=system))]),
                   SimpleNamespace(system=None, trajectory=SimpleNamespace(system=system))):
        assert system_behind(result) is system
    assert system_behind(SimpleNamespace(system=None)) is None
    assert system_behind(3.0) is None
