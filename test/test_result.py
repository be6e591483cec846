"""How values are shown in JSON and in a notebook, and the system behind a result."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tcc_sim.model.parameters import System
from tcc_sim.result import html_of, json_of, system_behind, units_of_columns
from tcc_sim.sweeps.simulation import Simulation


@pytest.mark.parametrize(("value", "shown"), [
    (1.5, 1.5), (math.nan, None), (-math.inf, None), (True, True), (3, 3), ("a", "a"), (None, None),
    (1.0 - 2.0j, [1.0, -2.0]), (complex(math.nan, 1.0), [None, 1.0]), (np.float64(0.25), 0.25), (np.int64(4), 4),
    (np.bool_(True), True), (np.array([[1.0, math.nan], [2.0, 3.0]]), [[1.0, None], [2.0, 3.0]]),
    ((1, [2.0, (math.inf,)]), [1, [2.0, [None]]]), ({1: math.nan, "b": {"c": (1,)}}, {"1": None, "b": {"c": [1]}})])
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


def test_the_system_behind_a_result_is_found_through_its_parts() -> None:
    system = System()
    for result in (system, SimpleNamespace(system=system), SimpleNamespace(scene=SimpleNamespace(system=system)),
                   SimpleNamespace(sweeps=[SimpleNamespace(curve=SimpleNamespace(system=system))]),
                   SimpleNamespace(system=None, trajectory=SimpleNamespace(system=system))):
        assert system_behind(result) is system
    assert system_behind(SimpleNamespace(system=None)) is None
    assert system_behind(3.0) is None


def test_a_column_has_the_unit_of_the_outer_field_of_its_name() -> None:
    """The period of a run, not that of its spectrum."""
    assert units_of_columns(Simulation, ["period"]) == {"period": "periods of excitation"}
