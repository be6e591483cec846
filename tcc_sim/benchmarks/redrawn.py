"""The pictures of precision.json and stability.json again."""

from __future__ import annotations

import tempfile
from pathlib import Path

from tcc_sim.benchmarks.report_drawings import draw_precision, draw_stability
from tcc_sim.views.stored import Record


def draw_stored_precision(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw error against run time; title and width are the picture's own."""
    for record in values.scenes:
        for row in record.results:
            vars(row)["largest_error"] = max(row.error_final, row.error_section, row.error_max_slip)
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder:  # A second picture, of the section, comes with it.
        drawn = Path(folder) / path.name
        draw_precision(drawn, values.scenes)
        path.write_bytes(drawn.read_bytes())
    return path


def draw_stored_stability(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw error charts and the errors of extreme scenes; title and width are the picture's own."""
    draw_stability(path, values.charts, values.cases)
    return path
