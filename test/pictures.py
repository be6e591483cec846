"""Pictures and Rerun files as a reader sees them: curves by panel and name, units, legends, margins, values by time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree

LETTER = re.compile(r"^\([a-z]\)\s+")
UNIT = re.compile(r"\([^()]*(\([^()]*\)[^()]*)*\)|dB re 1|%")
BARE = ("crank order", "period of excitation", "friction coefficient", "fraction of the plane", "coefficient",
        "residual", r"$\bar\mu$", "frequency ratio", "friction ratio", r"$\mu_", "error", "relative error", "tolerance",
        "log10", "share of the cases", "engine cycles", "chi-square", "period (", "mu_k", "static_coefficient",
        "friction.", "kinetic friction coefficient")
"""Beginnings and parts of labels of quantities without a unit."""
Curve = tuple[Any, Any]


def panels(drawn: Any) -> dict[str, Any]:
    """Return the axes of a figure by their titles, without letters and line breaks; those without one by number."""
    out = {}
    for k, axis in enumerate(drawn.axes):
        title = LETTER.sub("", (axis.get_title(loc="left") or axis.get_title()).replace("\n", " "))
        out[title or f"{k}"] = axis
    return out


def curves(axis: Any) -> dict[str, Curve]:
    """Return the points of the lines of axes by their labels; those without one by number."""
    return {label if not (label := str(line.get_label())).startswith("_") else f"{k}": tuple(
        np.asarray(side, float) for side in line.get_data(orig=False)) for k, line in enumerate(axis.lines)}


def shaded(axis: Any) -> list[tuple[float, float]]:
    """Return the ranges that are shaded along x as stick."""
    return [(float(path.vertices[:, 0].min()), float(path.vertices[:, 0].max())) for area in axis.collections
            if area.get_label() == "stick" for path in area.get_paths()]


def legends_in(drawn: Any) -> list[Any]:
    """Return every legend of a figure."""
    return [*(axis.get_legend() for axis in drawn.axes if axis.get_legend() is not None), *drawn.legends]


def entries(drawn: Any) -> list[str]:
    """Return the entries of all legends of a figure."""
    return [text.get_text() for legend in legends_in(drawn) for text in legend.get_texts()]


def labelled(drawn: Any) -> None:
    """Check that every axis of a figure has a quantity with its unit."""
    for axis in drawn.axes:
        for side in (axis.xaxis, axis.yaxis):
            label = side.get_label_text()
            if label and not label.startswith(BARE):
                assert UNIT.search(label), f"no unit: {label!r}"
        if axis.axison and axis.get_label() != "<colorbar>":
            sharing = [axis, *(other for other in drawn.axes if axis.get_shared_x_axes().joined(axis, other))]
            assert any(other.get_xlabel() for other in sharing), f"no quantity along x: {axis.get_title(loc='left')!r}"


def check(drawn: Any) -> None:
    """Check that every axis of a saved figure has a quantity with its unit, that no legend lies over data or another
    text, and that nothing is cut off.
    """
    labelled(drawn)
    drawn.draw_without_rendering()
    width, height = drawn.bbox.size
    for text in texts_in(drawn):
        box = text.get_window_extent()
        if text.get_text().strip() and text.get_visible() and box.width > 0.0:
            inside = min(box.x0, box.y0, width - box.x1, height - box.y1) >= -1.0
            assert inside, f"cut off: {text.get_text()!r}"
    for axis in drawn.axes:
        legend = axis.get_legend()
        if legend is not None:
            box = legend.get_window_extent()
            assert not covered(legend), f"a legend lies over {covered(legend)}"
            for text in (axis._left_title, axis.title, *(each for child in axis.child_axes for each in (
                    child.xaxis.label, *child.get_xticklabels()))):
                other = text.get_window_extent()
                assert not text.get_text() or not _overlap(box, other), f"a legend lies over {text.get_text()!r}"


def texts_in(drawn: Any) -> Iterator[Any]:
    """Yield the texts of a figure: titles, labels, and those of legends."""
    yield from filter(None, [drawn._suptitle, *drawn.texts])
    for axis in drawn.axes:
        if axis.axison:
            yield from (axis._left_title, axis.title, axis.xaxis.label, axis.yaxis.label)
    for legend in legends_in(drawn):
        yield from legend.get_texts()


def covered(legend: Any) -> list[str]:
    """Return the labels of lines and marks that a legend of axes lies on."""
    box = legend.get_window_extent()
    inside = _overlap(box, legend.axes.bbox)
    return [str(line.get_label()) for line in legend.axes.lines
            if inside and _within(line, line.get_transform().transform_path(line.get_path()), box)]


def _overlap(one: Any, other: Any) -> bool:
    """Return whether two boxes overlap by more than a pixel."""
    return bool(min(one.x1, other.x1) - max(one.x0, other.x0) > 1.0
                and min(one.y1, other.y1) - max(one.y0, other.y0) > 1.0)


def _within(line: Any, path: Any, box: Any) -> bool:
    """Return whether a line, or a mark of it, lies in a box."""
    points = path.vertices[np.isfinite(path.vertices).all(axis=1)]
    if ((points >= box.min) & (points <= box.max)).all(axis=1).any():
        return True
    if line.get_linestyle() in ("None", "none", " ", ""):
        return False
    clipped = path.cleaned(remove_nans=True, clip=(*box.min, *box.max), simplify=False)
    return bool(((clipped.codes != clipped.STOP) & (clipped.codes != clipped.CLOSEPOLY)).any())


def passes(curve: Curve, t: Any, values: Any, tolerance: float = 0.0) -> int:
    """Check that a curve has a point at each sample between its ends, with the sample's value; return their number."""
    x, y = curve
    slack = 1e-9 * max(float(np.ptp(x)), 1e-300)
    inside = np.isfinite(values) & (t >= x[0] - slack) & (t <= x[-1] + slack)
    t, values = np.asarray(t)[inside], np.asarray(values)[inside]
    at = np.clip(np.searchsorted(x, t - slack), 0, len(x) - 1)
    assert np.abs(x[at] - t).max(initial=0.0) <= slack, "no point at a sample"
    size = np.abs(values).max(initial=1e-300)
    assert np.abs(y[at] - values).max(initial=0.0) <= tolerance * size + 1e-12 * size, "another value than the sample's"
    return len(t)


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
    points, data = points / size, np.clip(data / size, -2.0, 2.0)
    if any(np.abs(data - point).max(axis=1).min() > rtol for point in points[::max(len(points) // 4, 1)]):
        return False  # Most other curves miss a point of five; a tree takes far longer.
    near, _ = KDTree(data).query(points, p=np.inf)
    return bool((near <= rtol).all())


def broken(curve: Curve, begin: float, end: float) -> bool:
    """Return whether no line joins the points on both sides of a gap between two times."""
    x, y = curve
    inner = (x > begin) & (x < end)
    return bool(inner.any() and not np.isfinite(y[inner]).any())


def shown_in_rerun(file: Path) -> dict[str, list[tuple[float, list[Any]]]]:
    """Return the rows of a Rerun file by entity: elapsed time, s (NaN for what always holds), and values."""
    pytest.importorskip("rerun")
    try:
        from rerun.chunk import RrdReader
    except ImportError:
        RrdReader = pytest.importorskip("rerun.experimental").RrdReader
    out: dict[str, list[tuple[float, list[Any]]]] = {}
    for chunk in RrdReader(str(file)).stream():
        rows = chunk.to_record_batch()
        named = dict(zip(rows.schema.names, rows.columns))
        columns = [name for name, field in zip(rows.schema.names, rows.schema)
                   if (field.metadata or {}).get(b"rerun:kind") == b"data"]
        times = named["elapsed"].cast("int64").to_pylist() if "elapsed" in named else [None] * rows.num_rows
        for name in columns[:1]:
            out.setdefault(chunk.entity_path, []).extend(
                (np.nan if t is None else 1e-9 * t, value) for t, value in zip(times, named[name].to_pylist()))
    return {entity: sorted(rows, key=lambda row: row[0]) for entity, rows in out.items()}


def rerun_line(rows: list[tuple[float, list[Any]]]) -> Curve:
    """Return the points of a line in Rerun; NaN where it ends."""
    timed = [(t, values[0] if values else np.nan) for t, values in rows if np.isfinite(t)]
    return np.array([t for t, _ in timed]), np.array([value for _, value in timed], float)
