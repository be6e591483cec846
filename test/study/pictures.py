"""Pictures from outside: those that matplotlib saves, the curves in them, and the faults that a reader would see."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

SYMBOLS = ("mu", "omega", "sigma", "Phi")
"""Names of dimensionless quantities in labels of axes."""


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Every figure that matplotlib saves, with the names of its files in `figure.saved`; each file is empty."""
    figures = pytest.importorskip("matplotlib.figure")
    values: list[Any] = []

    def savefig(self: Any, path: Any, **how: Any) -> None:
        if not isinstance(path, io.BytesIO):
            self.draw_without_rendering()
            values.append(self)
            self.saved = {Path(path).name, *getattr(self, "saved", ())}
            Path(path).touch()

    monkeypatch.setattr(figures.Figure, "savefig", savefig)
    return values


def shows(figure: Any, x: Any, y: Any, rtol: float = 1e-9) -> bool:
    """Whether a line or the marks of a picture pass through all these points."""
    points = np.stack(np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float)), axis=-1)
    points = points[np.isfinite(points).all(axis=1)]
    return any(_on(points, data, rtol) for axis in figure.axes for data in (
        *(np.asarray(line.get_xydata(), float) for line in axis.lines),
        *(np.asarray(part.get_offsets(), float) for part in axis.collections if len(part.get_offsets()))))


def _on(points: Any, data: Any, rtol: float) -> bool:
    """Whether each point is among some data."""
    data = data[np.isfinite(data).all(axis=1)]
    if len(data) < len(points):
        return False
    size = np.maximum(np.abs(points).max(axis=0), 1e-300)
    return all(bool((np.abs(data - point) <= rtol * size).all(axis=1).any()) for point in points)


def faults(figure: Any) -> list[str]:
    """What a reader would miss: labels with units, a text within the page, a line that no legend covers."""
    page, found = figure.bbox.padded(2.0), []
    for axis in (axis for axis in figure.axes if axis.axison and axis.get_visible()):
        shared = [other for other in figure.axes if other.axison]
        labels = [name for name in (axis.get_xlabel(), axis.get_ylabel()) if name]
        found += [f"no unit: {name}" for name in labels if "(" not in name and "engine cycle" not in name
                  and not any(word in name for word in (*SYMBOLS, "error", "residual", "share", "run", "cycle", "tol"))]
        if not labels and not any(other.get_xlabel() for other in shared):
            found.append("an axis without a label")
        box = axis.get_tightbbox()
        if box is not None and not (page.x0 <= box.x0 <= box.x1 <= page.x1 and page.y0 <= box.y0 <= box.y1 <= page.y1):
            found.append(f"cut off: {box}")
        legend = axis.get_legend()
        for line in axis.lines if legend is not None else ():
            inside = legend.get_window_extent().padded(-1.0)
            xy = line.get_transform().transform(np.asarray(line.get_xydata(), float))
            xy = xy[np.isfinite(xy).all(axis=1)]
            if line.get_alpha() != 0.0 and len(xy) and inside.count_contains(xy) > 0:
                found.append(f"the legend lies on {line.get_label()}")
    return found
