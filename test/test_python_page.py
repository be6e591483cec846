"""The code of the page on solvers and Python runs unchanged."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

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
