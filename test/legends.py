"""Checks of legends by their looks: an entry has a mark within the picture, and a legend in the axes covers no line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

NEUTRAL = ("#222222", "#8c8c8c")
"""Colours of entries that stand for marks of any colour."""
NOTE = re.compile(r", not drawn$| beyond the axes\)$|, below -?\d+ dB$")
"""Ends of entries that say that nothing is drawn."""
Look = tuple[str, str]


def legends_in(drawn: Any) -> Iterator[tuple[Any, list[Any]]]:
    """Yield every legend of a figure with the axes whose artists it may name."""
    for axis in drawn.axes:
        if axis.get_legend() is not None:
            yield axis.get_legend(), [axis] if axis.axison else list(drawn.axes)
    for part in (drawn, *drawn.subfigs):
        for legend in part.legends:
            yield legend, list(part.axes)


def unmarked(drawn: Any) -> list[str]:
    """Return the entries of a figure's legends that no artist within the view of its axes looks like."""
    drawn.draw_without_rendering()
    return [text.get_text() for legend, axes in legends_in(drawn)
            for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True)
            if not NOTE.search(text.get_text()) and not _marked(handle, axes)]


def covered(legend: Any) -> list[str]:
    """Return the labels of lines, and of marks, that a legend of axes lies on, after the figure has been drawn once."""
    box = legend.get_window_extent()
    return [str(artist.get_label()) for artist in legend.axes.lines
            if len(_within(artist, artist.get_transform().transform_path(artist.get_path()), box))]


def _marked(handle: Any, axes: list[Any]) -> bool:
    """Return whether an artist with a look of a legend's handle lies within the view of axes."""
    parts = list(handle.get_children()) if not hasattr(handle, "get_visible") or hasattr(handle, "lines") else [handle]
    wanted = {look for part in parts for look in _looks(part)}
    shown = {look for axis in axes for artist in (*axis.lines, *axis.collections, *axis.patches, axis.patch)
             if _visible(artist, axis) for look in _looks(artist)}
    names = {name for name, _ in shown}
    return any(look in shown or (look[1] in NEUTRAL and look[0] in names) for look in wanted)


def _visible(artist: Any, axis: Any) -> bool:
    """Return whether an artist has a point or a piece of a line within the view of its axes, a pixel more or less."""
    box, transform = axis.bbox.padded(1.0), artist.get_transform()
    if hasattr(artist, "get_coordinates"):  # A mesh.
        return bool(np.isfinite(np.ma.filled(np.ma.asarray(artist.get_array(), float), np.nan)).any())
    if hasattr(artist, "get_paths"):
        paths = [transform.transform_path(path) for path in artist.get_paths()]
    else:
        paths = [transform.transform_path(artist.get_path())]
    return any(len(_within(artist, path, box)) for path in paths)


def _within(artist: Any, path: Any, box: Any) -> Any:
    """Return the points of an artist in a box; of a line, also where it crosses the box."""
    points = path.vertices[np.isfinite(path.vertices).all(axis=1)]
    inside = points[((points >= box.min) & (points <= box.max)).all(axis=1)]
    if len(inside) or getattr(artist, "get_linestyle", lambda: "-")() in ("None", "none", " ", ""):
        return inside
    clipped = path.cleaned(remove_nans=True, clip=(*box.min, *box.max), simplify=False)
    return clipped.vertices[(clipped.codes != clipped.STOP) & (clipped.codes != clipped.CLOSEPOLY)]


def _looks(artist: Any) -> set[Look]:
    """Return the looks of an artist, each a kind and a colour: the marker, the dashes of a line, an area."""
    from matplotlib.colors import to_hex

    def colours(many: Any) -> set[str]:
        return {to_hex(one) for one in np.reshape(many, (-1, 4)) if one[3] > 0.0}

    if hasattr(artist, "get_coordinates"):
        shown = artist.cmap(artist.norm(np.ma.compressed(np.ma.asarray(artist.get_array()))))
        return {("area", one) for one in colours(shown) | colours(artist.cmap(1.0))}
    if not hasattr(artist, "get_marker"):
        face = {("area", one) for one in colours(_rgba(artist.get_facecolor()))}
        return face or {("-", one) for one in colours(_rgba(artist.get_edgecolor()))}
    result = set()
    colour, marker = to_hex(artist.get_color()), artist.get_marker()
    if artist.get_linestyle() not in ("None", "none", " ", ""):
        result.add((artist.get_linestyle(), colour))
    if marker not in ("None", "none", " ", "", None):
        result |= {(f"marker {marker}", colour), *([("area", colour)] if marker == "s" else [])}
    return result


def _rgba(colours: Any) -> Any:
    """Return colours as rows of four."""
    from matplotlib.colors import to_rgba_array

    return to_rgba_array(colours)


def title_of(drawn: Any) -> str:
    """The title over all axes of a figure; figures of matplotlib 3.7 have no method for it."""
    return str(drawn._suptitle.get_text()) if drawn._suptitle is not None else ""


def spans_in(axis: Any) -> list[tuple[float, float]]:
    """The ranges that are shaded along x; older versions of matplotlib draw polygons."""
    places = [patch.get_patch_transform().transform_path(patch.get_path()).get_extents() for patch in axis.patches]
    return [(float(place.x0), float(place.x1)) for place in places]
