"""Pictures of precision.json and stability.json."""

from __future__ import annotations

from pathlib import Path

from tcc_sim.study.benchmarks.report_drawings import draw_precision, draw_stability
from tcc_sim.views.stored import Record


def draw_stored_precision(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw error against run time."""
    for record in values.scenes:
        for row in record.results:
            vars(row)["largest_error"] = max(row.error_final, row.error_section, row.error_max_slip)
    draw_precision(path, values.scenes, title, width)
    return path


def draw_stored_stability(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw error charts and the errors of extreme scenes."""
    draw_stability(path, values.charts, values.cases, title, width)
    return path
