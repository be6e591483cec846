"""The pictures of precision.json and stability.json again."""

from __future__ import annotations

import tempfile
from pathlib import Path

from tcc_sim.benchmarks.report_drawings import draw_precision, draw_stability
from tcc_sim.errors import InputError
from tcc_sim.views import style
from tcc_sim.views.stored import Record


def draw_stored_precision(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw error against run time; InputError for a picture that is as wide as a column."""
    _check_width("precision", width)
    for record in values.scenes:
        for row in record.results:
            vars(row)["largest_error"] = max(row.error_final, row.error_section, row.error_max_slip)
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder:  # A second picture, of the section, comes with it.
        drawn = Path(folder) / path.name
        draw_precision(drawn, values.scenes, title)
        path.write_bytes(drawn.read_bytes())
    return path


def draw_stored_stability(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw error charts and the errors of extreme scenes; InputError for a picture that is as wide as a column."""
    _check_width("stability", width)
    draw_stability(path, values.charts, values.cases, title)
    return path


def _check_width(verb: str, width: float) -> None:
    """Raise InputError for a column."""
    if not style.wide(width):
        raise InputError(f"width is column; the picture of {verb} has too many panels for it, so it must be page")
