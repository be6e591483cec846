"""Functions of later rooms that an earlier room calls, by name: the only way against the order of the rooms.

Core rooms name the study here alone, so that whoever removes `tcc_sim/study` sees in this table what goes with it.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

CALLED = {
    # name: (module, function)
    "draw_figure": ("tcc_sim.study.paper.drawings", "draw_stored"),
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
