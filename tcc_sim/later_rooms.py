"""Functions of later rooms that an earlier room calls, by name: the only way against the order of the rooms.

Core rooms name the study here alone, so that whoever removes `tcc_sim/study` sees in this table what goes with it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

CALLED = {
    # name: (module, function)
    "draw_figure": ("tcc_sim.study.paper.drawings", "draw_figure"),
    "draw_precision": ("tcc_sim.study.benchmarks.report_drawings", "draw_precision"),
    "draw_stability": ("tcc_sim.study.benchmarks.report_drawings", "draw_stability"),
    "branch_panels": ("tcc_sim.study.views", "branch_panels"),
    "basin_panels": ("tcc_sim.study.views", "basin_panels"),
}
"""Module and function of every such call."""


def from_later_room(name: str) -> Any:
    """Return the function that CALLED names."""
    module, function = CALLED[name]
    return getattr(import_module(module), function)


def importing(name: str) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a module that imports each name, which its file imports for type checkers,
    when it is first used; so `import tcc_sim` stays light, and neither ROS nor the study is loaded without need.
    """
    this = sys.modules[name]
    file = str(this.__file__)

    @cache
    def places() -> dict[str, tuple[str, str]]:
        import ast

        return {one.asname or one.name: (str(node.module), one.name)
                for node in ast.walk(ast.parse(Path(file).read_text(encoding="utf-8")))
                if isinstance(node, ast.ImportFrom) for one in node.names}

    def found(name: str) -> object:
        if name not in places():
            raise AttributeError(f"{file} has no attribute {name!r}")
        module, there = places()[name]
        return getattr(import_module(module), there)

    return found, lambda: sorted(this.__all__)
