"""A picture in words: its sizes, labels and limits, and each artist with its look and numbers, one on a line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcc_sim.views import style

NAMES = {getattr(style, name): name.lower() for name in ("BLUE", "ORANGE", "GREEN", "RED", "PURPLE", "SKY", "YELLOW",
                                                         "INK", "GREY", "STICK", "RUNAWAY")}
NAMES |= {"#000000": "black", "#FFFFFF": "white"}


def expected(page: Path, title: str) -> list[str]:
    """Return the lines of a part of a page of descriptions."""
    parts = dict(part.split("\n", 1) for part in page.read_text().split("== ")[1:])
    return parts[title].rstrip().split("\n")


def kept(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return a list that collects the figures instead of their files, neither laid out nor drawn."""
    pytest.importorskip("matplotlib")
    figures: list[Any] = []

    def keep(drawn: Any, path: Path) -> Path:
        style.convert_axes(drawn)
        figures.append(drawn)
        return path

    monkeypatch.setattr(style, "save", keep)
    monkeypatch.setattr(style, "lay_out", lambda drawn: None)
    return figures


def described(drawn: Any) -> list[str]:
    """Return the description of a figure; `new_lines` describes a narrower one."""
    width, height = drawn.get_size_inches()
    return [_joined(f"{width:.3g} x {height:.4g} inch", *(_text(t) for t in (drawn._suptitle, drawn._supxlabel,
                                                                             drawn._supylabel) if t is not None)),
            *(line for part in (drawn, *drawn.subfigs) for legend in part.legends for line in _legend(legend)),
            *(line for k, axis in enumerate(drawn.axes) for line in _axes(axis, f"{k}"))]


def new_lines(lines: Sequence[str], known: Sequence[str]) -> list[str]:
    """Return the lines that another description lacks."""
    return [line for line in lines if line not in known]


def _joined(*parts: str) -> str:
    return "; ".join(part for part in parts if part)


def _axes(axis: Any, name: str) -> Iterator[str]:
    """Describe axes and what is in them."""
    place = axis.get_subplotspec()
    if place is None:
        where = "in " + " ".join(f"{x:.2g}" for x in axis.get_position().bounds) if "." in name else ""
    else:
        grid = place.get_gridspec()
        ratios = [f"{x:g}" for side in (grid.get_height_ratios(), grid.get_width_ratios()) if side for x in side]
        rows, columns = place.rowspan, place.colspan
        where = (f"rows {rows.start}-{rows.stop}, columns {columns.start}-{columns.stop} of {grid.nrows}x{grid.ncols} "
                 f"by {' '.join(ratios)}")
    titles = [_text(title) for title in (axis._left_title, axis.title, axis._right_title) if title.get_text()]
    sides = [_joined(f"{letter} {_text(side.label)}", f"{side.get_scale()} {_numbers(side.get_view_interval())}",
                     _ticks(side.get_major_locator()),
                     " ".join(f"{k} {v}" for k, v in sorted(_tick_parameters(side).items()) if k in (
                         "labelbottom", "labelsize", "labelcolor")))
             for letter, side in (("x", axis.xaxis), ("y", axis.yaxis))] if axis.axison else ["off"]
    bare = "" if axis.xaxis.get_tick_params().get("gridOn", True) else "no grid"
    edges = " ".join(name for name in ("top", "right") if axis.spines[name].get_visible())
    yield _joined(f"axes {name} {where}", f"z{axis.get_zorder():g}", "" if axis.patch.get_visible() else "clear",
                  _colour(axis.get_facecolor()).replace("white", ""), bare, edges, *titles)
    if hasattr(axis, "set_functions"):
        there, back = axis._functions
        sides.append(f"{there(1.0):.4g} times the other axis, and back {back(there(3.0)):.4g} for 3")
    yield f"  {' | '.join(sides)}"
    if axis.get_label() == "<colorbar>":
        return
    for line in axis.lines:
        if len(line.get_xdata()) or not str(line.get_label()).startswith("_"):
            yield f"  {_line(line)}"
    for patch in axis.patches:
        box = patch.get_path().transformed(patch.get_patch_transform()).get_extents()
        yield (f"  patch {_colour(patch.get_facecolor())} {_colour(patch.get_edgecolor())} {patch.get_linewidth():g} "
               f"{_tail(patch)} {_numbers([box.x0, box.x1]) if box.width > 0.0 else 'empty'}")
    for mesh in axis.collections:
        yield f"  {_collection(mesh)}"
    for text in axis.texts:
        ends = [_numbers(place) for place in (getattr(text, "xy", ()), text.get_position()) if len(place)]
        arrow = getattr(text, "arrow_patch", None)
        yield _joined(f"  text {_text(text)}", *ends, f"{text.get_rotation():g} {text.get_ha()} {text.get_va()}",
                      "" if arrow is None else f"arrow {_colour(arrow.get_edgecolor())} {arrow.get_linewidth():g} "
                      f"{arrow.shrinkA:g} {arrow.shrinkB:g}")
    if axis.get_legend() is not None:
        for line in _legend(axis.get_legend()):
            yield f"  {line}"
    for k, child in enumerate(axis.child_axes):
        yield from _axes(child, f"{name}.{k}")


def _tick_parameters(side: Any) -> dict[str, Any]:
    """Return what an axis sets of its ticks; matplotlib 3.7 leaves out which sides have labels."""
    named = {"labelbottom": "label1On"} if side.axis_name == "x" else {}
    return {**{name: side._major_tick_kw[key] for name, key in named.items() if key in side._major_tick_kw},
            **side.get_tick_params()}


def _ticks(locator: Any) -> str:
    """Describe ticks that are not those of the style."""
    if hasattr(locator, "locs"):
        return f"ticks at {_numbers(locator.locs)}"
    most = getattr(locator, "_nbins", "auto")
    return "" if most == "auto" else f"{most} ticks"


def _legend(legend: Any) -> Iterator[str]:
    """Describe a legend with its entries."""
    names = [text.get_text() for text in legend.get_texts()]
    anchor = legend._bbox_to_anchor
    yield _joined(f"legend at {legend._loc}, {legend._ncols} columns, {legend._fontsize:g} {legend.get_in_layout()}",
                  repr(legend.get_title().get_text()) if legend.get_title().get_text() else "",
                  "" if anchor is None else _numbers(np.ravel(getattr(anchor, "_bbox", anchor).get_points())[:2]),
                  *map(repr, names))


def _text(text: Any) -> str:
    return f"{text.get_text()!r} {text.get_fontsize():g} {_colour(text.get_color())} {text.get_fontweight()}"


def _line(line: Any) -> str:
    """Describe a line by look, points, first and last point, and sums."""
    dashes = line._unscaled_dash_pattern[1] or "-"
    kind = "" if line.get_linestyle() in ("None", "") else " ".join(f"{x:.3g}" if x != "-" else x for x in dashes)
    x, y = (np.asarray(side, float) for side in line.get_data(orig=False))
    marker = line.get_marker()
    marks = "" if marker in ("None", "", None) else (
        f"{marker}{line.get_markersize():g}/{line.get_markeredgewidth():g} {_colour(line.get_markerfacecolor())}")
    return _joined(f"{kind and f'({kind}) {line.get_linewidth():g}'}{marks} {_colour(line.get_color())}{_tail(line)}",
                   f"{len(x)}: {_numbers(x)}; {_numbers(y)}" if len(x) else "empty")


def _tail(artist: Any) -> str:
    """Describe opacity, order and label of an artist."""
    alpha, label = artist.get_alpha(), str(artist.get_label())
    return (f"{'' if alpha is None else f' a{alpha:g}'} z{artist.get_zorder():g}"
            f"{'' if label.startswith('_') else f' {label!r}'}{' raster' * bool(artist.get_rasterized())}")


def _collection(mesh: Any) -> str:
    """Describe areas by colours and extent, and a mesh also by its values."""
    colours = list(dict.fromkeys(map(_colour, mesh.get_facecolor())))
    if hasattr(mesh, "get_coordinates"):
        corners = mesh.get_coordinates()
        values = np.ma.filled(np.ma.asarray(mesh.get_array(), float), np.nan).reshape(len(corners) - 1, -1)
        map_of = " ".join(map(_colour, mesh.cmap.colors)) if mesh.cmap.N < 10 else mesh.cmap.name
        return (f"mesh {map_of} {_numbers(mesh.get_clim())}{_tail(mesh)}; {_numbers(corners[0, :, 0])}; "
                f"{_numbers(corners[:, 0, 1])}; {values.shape} {_numbers(values.ravel())}")
    points = np.concatenate([path.vertices for path in mesh.get_paths()]) if mesh.get_paths() else np.zeros((0, 2))
    return (f"area {' '.join(colours)} {_numbers(mesh.get_linewidth())}{_tail(mesh)}; {_numbers(points[:, 0])}; "
            f"{_numbers(points[:, 1])}")


def _numbers(values: Any) -> str:
    """Return all of a few numbers; of more, the first, the last, and the sum of those that are finite."""
    values = np.asarray(values, float)
    if len(values) <= 4:
        return " ".join(f"{x:.4g}" for x in values)
    gaps = int(np.isnan(values).sum())
    return f"{values[0]:.4g} .. {values[-1]:.4g} sum {np.nansum(values):.4g}{f' less {gaps}' if gaps else ''}"


def _colour(colour: Any) -> str:
    """Return a colour by its name in the style."""
    from matplotlib.colors import to_hex

    if isinstance(colour, str) and colour in ("none", "auto"):
        return colour
    name = to_hex(colour, keep_alpha=True).upper()
    alpha = name[7:] if name[7:] != "FF" else ""
    return "none" if alpha == "00" else NAMES.get(name[:7], name[:7]) + alpha
