"""Every verb with a table writes it in every format, with names, units and values that other programs read."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from tcc_sim.cli import main
from tcc_sim.output.samples import TABLES

parquet = pytest.importorskip("pyarrow.parquet", reason="PyArrow is not installed")

CASES: dict[str, tuple[list[str], str, str, str]] = {
    "simulate": (["simulate", "slip", "--cycles", "3", "--samples", "4"], "slip_speed", "rad/s", ""),
    "sweep": (["sweep", "slip", "--over", "engine.frequency=100:120:3", "--cycles", "9"], "max_slip_speed", "rad/s",
              "max_slip_speed"),
    "grid": (["sweep", "slip", "--over", "engine.frequency=100:120:3", "--over", "engine.torque_amplitude=5,6",
              "--cycles", "9"], "max_slip_speed", "rad/s", "max_slip_speed"),
    "scatter": (["sweep", "slip", "--scatter", "engine.torque_amplitude=5:9", "--samples", "4", "--cycles", "9"],
                "max_slip_speed", "rad/s", "max_slip_speed"),
    "linearise": (["linearise", "slip", "--frequencies", "10:20:4"], "gain", "", "gain"),
    "basins": (["basins", "stick", "--plane", "initial.slip_speed=0:1:2", "--plane", "initial.plate_angle=0:0.1:2"],
               "cycles", "", "")}
"""Words of a verb, a column, its unit, and the same in --json, if it is there."""


def read(path: Path, name: str) -> tuple[np.ndarray, str | None]:
    """Return a column and its unit, by a reader that is not this package's; None for a format without units."""
    if path.suffix == ".csv":
        with path.open(newline="") as file:
            names, units, *rows = csv.reader(file)
        column = names.index(name)
        assert {len(row) for row in (names, units, *rows)} == {len(names)}
        return np.array([float(row[column]) for row in rows]), units[column]
    if path.suffix == ".parquet":
        table = parquet.read_table(path)
        return table[name].to_numpy(), table.schema.field(name).metadata[b"unit"].decode()
    if path.suffix == ".mat":
        content = loadmat(path)
        units = content["units"].dtype.names if "units" in content else ()
        return content[name].ravel(), str(content["units"][name][0, 0][0]) if name in units else ""
    with np.load(path) as content:
        return content[name].ravel(), None


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The --json of every case, as far as it was asked for."""
    return {}


@pytest.mark.parametrize("suffix", TABLES)
@pytest.mark.parametrize("case", CASES)
def test_a_verb_writes_a_format(case: str, suffix: str, first: dict[str, Any], tmp_path: Path) -> None:
    words, name, unit, key = CASES[case]
    out, summary = tmp_path / f"a{suffix}", tmp_path / "a.json"
    assert main([*words, "--out", str(out), "--json", str(summary)]) == 0
    values, stated = read(out, name)
    document = json.loads(summary.read_text())
    expected = np.ravel(document[key]) if key else first.setdefault(case, values)
    assert values.tolist() == np.asarray(expected).tolist()
    assert len(values) > 2
    assert stated in (unit, None)
    assert {path.name for path in tmp_path.iterdir()} == {f"a{suffix}", "a.json"}


def test_a_table_of_a_sweep_has_its_keys_words_and_scene(tmp_path: Path) -> None:
    words = CASES["grid"][0]
    for suffix in (".mat", ".parquet"):
        assert main([*words, "--out", str(tmp_path / f"a{suffix}")]) == 0
    content = loadmat(tmp_path / "a.mat", simplify_cells=True)
    assert content["engine_frequency"].tolist() == [100.0, 110.0, 120.0] * 2
    assert content["engine_torque_amplitude"].tolist() == [5.0] * 3 + [6.0] * 3
    assert content["regime"].tolist() == ["slip"] * 6
    assert content["units"]["engine_frequency"] == "rad/s"
    table = parquet.read_table(tmp_path / "a.parquet")
    assert table["regime"].to_pylist() == ["slip"] * 6
    for text in (content["document"], table.schema.metadata[b"document"].decode()):
        document = json.loads(text)
        assert document["command"][:3] == words[:3]
        assert "max_slip_speed" not in document
        assert document["scene"]["engine.mean_torque"] > 0.0
