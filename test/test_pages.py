"""The notebook of the guide and the code of the page on solvers run; a notebook shows the last value of each cell."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from typing import Any

import pytest

from tcc_sim.scene import KNOWN_KEYS, load_scene
from tcc_sim.sweeps.results import Sweep
from tcc_sim.views.plots import Picture

NOTEBOOK = Path(__file__).resolve().parent.parent / ".github" / "guide" / "first_steps.ipynb"


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Run a cell in a namespace, as a kernel does; the value of the expression in its last line."""
    tree = ast.parse(source)
    assert isinstance(tree.body[-1], ast.Expr)
    tree.body[-1] = ast.fix_missing_locations(ast.copy_location(
        ast.Assign([ast.Name("_", ast.Store())], tree.body[-1].value), tree.body[-1]))
    exec(compile(tree, str(NOTEBOOK), "exec"), names)
    return names["_"]


def test_the_notebook_runs_and_shows_tables_and_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    content = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert content["nbformat"] == 4
    names: dict[str, Any] = {}
    shown = [run_cell("".join(cell["source"]), names) for cell in content["cells"] if cell["cell_type"] == "code"]
    scene, result, picture, swept, other, path = shown
    frequency = f"{scene.system.engine.frequency:.6g}"
    assert f"<td>engine.frequency</td><td>{frequency}</td><td>rad/s</td>" in scene._repr_html_()
    assert "<td>rate</td><td>1000</td><td>Hz</td>" in scene._repr_html_()
    assert "<th>max_slip_speed (rad/s)</th>" in result._repr_html_()
    assert "<th>engine.torque_amplitude (N m)</th>" in swept._repr_html_()
    assert isinstance(swept, Sweep)
    for drawn, width in ((picture, 1440), (other, 700)):
        assert isinstance(drawn, Picture)
        png = drawn._repr_png_()
        assert png.startswith(b"\x89PNG")
        assert int.from_bytes(png[16:20], "big") == width
    assert path.read_bytes().startswith(b"%PDF")
    assert [file.name for file in tmp_path.iterdir()] == ["swept.pdf"]


def test_a_scene_is_a_table_of_every_key() -> None:
    shown = load_scene("fig02")._repr_html_()
    assert shown.count("<tr>") == 1 + len(KNOWN_KEYS)
    assert "more lines" not in shown
    assert "&lt;" not in shown.partition("</p>")[0]


PAGE = Path(__file__).resolve().parent.parent / ".github" / "guide" / "solvers.md"
QUICKER = {"seeds, generations, samples = range(5), 30, 256": "seeds, generations, samples = range(1), 2, 8"}
"""Slow lines of the page, and the quicker ones that run instead."""
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_the_code_runs(block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "matplotlib" in block or "plot(" in block:
        pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(tmp_path)
    for line, other in QUICKER.items():
        block = block.replace(line, other)
    exec(compile(block, str(PAGE), "exec"), {})


def test_every_replaced_line_is_on_the_page() -> None:
    assert all(sum(line in block for block in BLOCKS) == 1 for line in QUICKER)
