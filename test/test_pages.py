"""The notebook of the guide and the code of the page on solvers run; a notebook shows the last value of each cell."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from notebook import shown_by

from tcc_sim.scene import KNOWN_KEYS, load_scene
from tcc_sim.views.plots import Picture

NOTEBOOK = Path(__file__).resolve().parent.parent / ".github" / "guide" / "stick_slip.ipynb"


def test_the_lecture_shows_what_the_paper_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, without_layout: None
                                               ) -> None:
    """The motion of period two begins near 0.92 of the static coefficient (Sec. 5.1); energies of a period balance."""
    pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(tmp_path)
    names, shown = shown_by(NOTEBOOK)
    pictures = [value for value in shown if isinstance(value, Picture)]
    assert len(pictures) == 5
    assert all(picture._repr_png_().startswith(b"\x89PNG") for picture in pictures)
    heat, work, stick, breakaways = next(value for value in shown if isinstance(value, dict)).values()
    run, omega = names["run"].trajectory, 150.0
    last = run.t > run.t[-1] - 2.0 * np.pi / omega
    damped = 0.6 * np.trapezoid(run.plate_speed[last] ** 2, run.t[last])
    assert work == pytest.approx(heat + damped, rel=2e-3)
    assert 0.5 < stick < 1.0
    assert breakaways == 1.0
    first = {found.kind: found.value / 0.3 for found in names["motions"].bifurcations[:2]}
    assert first == pytest.approx({"period_doubling": 0.777, "fold": 0.92}, abs=5e-3)
    verdict, settling, _ = shown[-2]
    assert verdict == "settled"
    assert 2.0 < settling < 4.0
    assert list(tmp_path.iterdir()) == []


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
def test_the_code_runs(block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                       request: pytest.FixtureRequest) -> None:
    if "matplotlib" in block or "plot(" in block:
        request.getfixturevalue("pictures")
    monkeypatch.chdir(tmp_path)
    for line, other in QUICKER.items():
        block = block.replace(line, other)
    exec(compile(block, str(PAGE), "exec"), {})


def test_every_replaced_line_is_on_the_page() -> None:
    assert all(sum(line in block for block in BLOCKS) == 1 for line in QUICKER)


def test_the_gallery_has_every_picture() -> None:
    root = PAGE.parent.parent
    text = (root / "guide" / "gallery.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"\]\(\.\./pictures/([^)]+)\)", text))
    assert shown == {path.name for path in (root / "pictures").iterdir()}
