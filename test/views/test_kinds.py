"""Which picture a stored result has, by its words: kinds, titles, missing data, and lengths of its lists."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tcc_sim.errors import InputError
from tcc_sim.views.stored import Record, check_stored, kind_of, missing_data, title_of


@pytest.mark.parametrize(("values", "kind"), [
    ({"format": "tcc_sim sweep 1"}, "sweep"), ({"format": "tcc_sim sweep"}, ""), ({}, ""),
    ({"branches": []}, "continue"),
    ({"plane": []}, "basins"), ({"scatter": {}}, "sweep"), ({"over": "a"}, "sweep"), ({"gain": []}, "linearise"),
    ({"parameters": []}, "identify"), ({"plane": [], "over": "a"}, "basins"),
    ({"format": 3, "gain": []}, "linearise")])
def test_a_kind_is_that_of_the_format_or_of_the_keys(values: dict[str, Any], kind: str) -> None:
    assert kind_of(values) == kind


@pytest.mark.parametrize(("words", "title"), [
    (["simulate", "dir/mine.yaml"], "mine"), (["simulate", "fig02", "--title", "T"], "T"),
    (["simulate", "fig02", "--title", ""], ""), (["analyse", "runs/run1.mcap"], "run1.mcap"),
    (["identify", "a/b.csv", "--free", "k", "--scene", "slip"], "slip"), (["identify", "a/b.csv", "--free", "k"], "b"),
    (["figure", "4"], ""), (["precision", "--quick"], ""), ([], "")])
def test_a_title_is_given_or_the_name_of_what_was_read(words: list[str], title: str) -> None:
    assert title_of({"command": words, "format": f"tcc_sim {words[0] if words else 'x'} 1"}) == title


def test_what_a_json_lacks_for_its_picture_is_named(tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    table.write_text("t\n")
    fit = {"format": "tcc_sim identify 1", "command": ["identify", str(table), "--free", "k"]}
    for values, words in (
            ({"format": "tcc_sim simulate 1"}, "has no samples: the scene is solved again"),
            ({"format": "tcc_sim simulate 1", "orders": {}}, ""), ({"format": "tcc_sim simulate 1", "arrays": {}}, ""),
            ({"format": "tcc_sim analyse 1", "messages": 3}, "has no samples: the recording is read again"),
            ({"format": "tcc_sim analyse 1"}, ""), (fit, "has no samples: the fit is made again"),
            ({**fit, "command": ["identify", str(tmp_path / "b.csv"), "--free", "k"]},
             "has no samples, and the measurements are not there: its parameters are drawn without the fit"),
            ({"format": "tcc_sim basins 1"},
             "has no cells: the attractors are drawn without them; basins ... --out FILE.npz keeps them"),
            ({"format": "tcc_sim basins 1", "over": "a"}, ""), ({"format": "tcc_sim sweep 1"}, "")):
        assert missing_data(values) == words


SWEEP = {"format": "tcc_sim sweep 1", "values": [1.0, 2.0], "period": [1, 1], "status": ["a", "b"]}
GRID = {**SWEEP, "second_values": [1.0, 2.0, 3.0], "period": [[1, 1]] * 3, "status": [["a", "b"]] * 3}


@pytest.mark.parametrize(("values", "says"), [
    (SWEEP, ""), ({**SWEEP, "period": [1]}, "it: period has 1 values; 2 are expected"), (GRID, ""),
    ({**GRID, "period": [[1, 1]] * 2}, "it: period has 2 values; 3 are expected"),
    ({**GRID, "status": [["a", "b"], ["a"], ["a", "b"]]}, "it: a row of status: it has 1 values; 2 are expected"),
    ({**SWEEP, "scatter": {}, "period": [1] * 4, "status": ["a"] * 4}, ""),
    ({**SWEEP, "scatter": {}, "period": [1] * 4}, "has"),
    ({"branches": [{"value": [1.0], "stable": [True]}, {"value": [1.0], "stable": []}]},
     "it: branches: stable has 0 values; 1 are in value"),
    ({"spectrum": {"order": [1.0], "frequency": [1.0, 2.0]}}, "it: spectrum: order has 1 values; 2 are in frequency"),
    ({"gain": [1.0], "frequencies": []}, "it: gain has 1 values; 0 are in frequencies")])
def test_lists_of_a_result_have_the_same_length(values: dict[str, Any], says: str) -> None:
    if not says:
        check_stored("it", values)
        return
    with pytest.raises(InputError) as caught:
        check_stored("it", values)
    assert says in str(caught.value)


def test_a_record_is_an_object_of_attributes() -> None:
    record = Record.of({"a": {"b": [1, {"c": 2}]}, "d": None})
    assert (record.a.b[0], record.a.b[1].c, record["a"].b[0]) == (1, 2, 1)
    assert (record.d, record.missing, record["d"], record.get("x")) == (None,) * 4
    assert (list(record), dict(record.items())["d"]) == (["a", "d"], None)
    with pytest.raises(AttributeError):
        record.__array__  # noqa: B018
    with pytest.raises(KeyError):
        record["x"]
