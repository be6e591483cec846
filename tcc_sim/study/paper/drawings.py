"""Drawings of the paper's maps and diagrams from the numbers of `paper.figures`; histories are in `histories`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.study.paper import branch_panels as panels
from tcc_sim.study.paper import histories
from tcc_sim.study.paper.catalogue import SWEPT, plain
from tcc_sim.study.paper.figure_results import Figure, Labelled
from tcc_sim.views import style
from tcc_sim.views.stored import Record
from tcc_sim.views.sweeps import numbers

MAXIMUM = r"max $|\dot\delta_1|$ (rad/s)"
SECTION = r"$\delta_2$ (rad)"
WORD = re.compile(r"(?:\$[^$]*\$|[^\s$])+")
"""A word of a caption; formulas stay whole."""
WIDEST = 125
"""Characters of a caption's line over a page."""
NARROW = 72
"""Characters of the lines of a caption and of a title in a column."""
SAMPLES = ("t", "slip_speed", "plate_angle", "friction_torque", "engine_torque", "saturation_torque", "state",
           "coefficient", "slope", "near_slip_speed", "near_coefficient", "near_slope", "near_set_valued")
"""Keys of the samples of curves and panels."""
DIRECTIONS = {"cold": ("from the initial state (13)", style.BLUE), "up": ("continued upward", style.RED),
              "down": ("continued downward", style.GREEN)}


def draw(data: Figure, stem: Path, title: str = "", width: float = style.PAGE) -> None:
    """Write the picture of one figure as `stem`.png and `stem`.svg.

    Parameters
    ----------
    title : title of the picture; by default number and title of the figure
    width : width, inch; in a column, panels are narrower or below each other
    """
    wide, caption = style.wide(width), caption_of(data, width)
    more = 0.0 if wide else 0.15 * (caption.count("\n") + 1)
    with style.figure(width, _height(data, wide) + more) as drawn:
        extra = [] if data.law == "smoothed" or data.kind in ("law", "solvers") else ["set-valued law"]
        if data.kind in ("map", "damping"):
            directions = {curve.direction for curve in data.curves}
            extra += [DIRECTIONS[d][0] for d in sorted(directions)] if directions != {"cold"} else []
        note = f" ({', '.join(extra)})" if extra else ""
        words = title or f"Fig. {data.figure}. {data.title}{note}"
        drawn.suptitle(words if wide else "\n".join(_lines(WORD.findall(words), " ", 42)), x=0.01, ha="left",
                       fontsize=9.5 if wide else 8.5, fontweight="bold", parse_math=not title)
        KINDS[data.kind][-1](drawn, data)
        drawn.supxlabel(caption, x=0.01, ha="left", fontsize=7.0 if wide else 6.5, color=style.GREY)
        style.save_both(drawn, stem)


def paper_figure(figure: int, *, quick: bool = False, law: str = "smoothed", direction: str | None = None,
                 branches: bool = False, jobs: int | None = None, out: str | Path | None = None) -> Figure:
    """Compute one figure of the paper, as `tcc-sim figure` does, and draw it into the directory `out` if that is given.

    Raises
    ------
    InputError
        There is no such figure, or an option does not apply to it.

    Examples
    --------
    >>> import tcc_sim
    >>> tcc_sim.figure(2, quick=True).kind
    'solvers'
    """
    from tcc_sim.study.paper.catalogue import FIGURES, FigureOptions, check_options
    from tcc_sim.study.paper.figures import figure_data

    options = FigureOptions(quick, direction, law, jobs, branches=branches)
    if figure in FIGURES:
        check_options(figure, options)
    data = figure_data(figure, options)
    if out is not None:
        Path(out).mkdir(parents=True, exist_ok=True)
        draw(data, Path(out) / f"fig{figure:02d}")
    return data


def caption_of(data: Figure, width: float = style.PAGE) -> str:
    """Return the caption: parameters, and numbers of cycles and section points."""
    parts = data.caption.replace("\n", " ").split("; ")
    if data.kind in SWEPT:
        most = max(len(points or ()) for curve in data.curves for points in curve.theta2)
        parts += [f"{data.cycles} periods of excitation, the first {data.discarded} dropped",
                  rf"$\delta_2$ at $t = 2\pi n/\omega$ over the last {most}"]
        if any(mark is panels.SETTLING for mark in panels.marks_met(data.curves)):
            parts.append("grey: still settling to a period")
    if style.wide(width):
        return ";\n".join(_lines(parts, "; ", WIDEST))
    return "\n".join(_lines(WORD.findall("; ".join(parts)), " ", NARROW))


def _lines(parts: Sequence[str], between: str, most: int) -> list[str]:
    """Join parts to lines of at most this number of characters."""
    lines = [parts[0]]
    for part in parts[1:]:
        if len(plain(f"{lines[-1]}{between}{part}")) > most:
            lines.append(part)
        else:
            lines[-1] += f"{between}{part}"
    return lines


def draw_orbit(axis: Any, x: Sequence[float], curve: Labelled, colour: str) -> None:
    """Draw section points over the parameter, grey for unsettled motions; mark runaway slip at the edge."""
    panels.draw_runaways(axis, x, curve)
    counts = np.array([len(p or ()) for p in curve.theta2])
    points = np.concatenate([np.array(p or (), dtype=np.float64) for p in curve.theta2])
    place = np.repeat(x, counts)
    for mark, where in panels.marked(curve):
        if mark is not panels.AWAY:
            shown = np.repeat(where, counts)
            axis.plot(place[shown], points[shown], linestyle="none", marker=".", markersize=1.6, markeredgewidth=0.0,
                      color=style.GREY if mark is panels.SETTLING else colour, rasterized=True)


def draw_curve_maxima(axis: Any, x: Sequence[float], curve: Labelled, colour: str) -> None:
    """Draw the largest slip speeds with a mark for each kind of motion, coexisting motions, and spikes."""
    axis.plot(x, panels.bounded(curve), color=colour, linewidth=0.9, label=curve.label)
    _points(axis, x, curve, colour)
    rows = curve.coexisting or ()
    for mark, places in ((panels.OTHER, [(x[r.index], r.other.max_slip_speed) for r in rows]),
                         (panels.SPIKE, [(x[r.index], r.max_slip_speed) for r in rows if r.spike])):
        axis.plot(*np.array(places).reshape(-1, 2).T, **mark.look(colour))


def legend_of_marks(axis: Any, curves: Sequence[Labelled]) -> None:
    """Draw a legend of the marks in this picture."""
    rows = [r for curve in curves for r in curve.coexisting or ()]
    for mark in (*panels.marks_met(curves), *[panels.OTHER] * bool(rows), *[panels.SPIKE] * any(r.spike for r in rows)):
        style.key(axis, mark.name, **mark.look(style.INK, 2.6))


def _paint_map(drawn: Any, data: Figure) -> None:
    """Draw maxima and orbit diagrams of every curve in shared ranges, over the other curves or its branches, pale."""
    curves, x = data.curves, data.x
    branched, wide, count = curves[0].behind is not None, style.wide(drawn.get_figwidth()), len(curves)
    top, beyond = panels.top_of(curves) if branched else (
        1.06 * max(float(np.nanmax(panels.bounded(curve), initial=1e-6)) for curve in curves), 0)
    if branched and not wide:  # Causes of jumps need the whole width: the orbit diagram is below its maxima.
        grid = drawn.add_gridspec(2 * count + 1, 1, height_ratios=[1.4, 1.0] * count + [0.8])
        cells = [[grid[2 * k + side, 0] for k in range(count)] for side in range(2)]
    else:
        grid = drawn.add_gridspec(count + 1, 2, width_ratios=(1.55 if branched else 1.0, 1.0),
                                  height_ratios=[1.0] * count + [0.24 if branched else 0.36 if wide else 0.8])
        cells = [[grid[k, side] for k in range(count)] for side in range(2)]
    maxima, orbits = ([drawn.add_subplot(cell) for cell in column] for column in cells)
    for row in (maxima, orbits):
        for axis in row[1:]:
            axis.sharex(row[0])
            axis.sharey(row[0])
    named = wide or branched
    for k, (curve, left, right) in enumerate(zip(curves, maxima, orbits)):
        colour = style.CYCLE[k]
        if branched:
            _points(left, x, curve, colour)
            panels.draw_branches(left, curve, data.unit, colour)
        else:
            for other in curves:
                left.plot(x, panels.bounded(other), color=style.GREY, linewidth=0.4, alpha=0.45, zorder=1)
            draw_curve_maxima(left, x, curve, colour)
        draw_orbit(right, x, curve, colour)
        if named:
            left.set_ylabel(MAXIMUM.replace(" (", "\n("))
            right.set_ylabel(SECTION)
        for axis in (right,) if branched else (left, right):
            axis.set_title(curve.label, loc="right", fontweight="normal", fontsize=7.5, color=colour, pad=2.0)
        for axis in (left, right):
            axis.tick_params(labelbottom=k == count - 1)
            for mark in data.marks:
                axis.axvline(mark, color=style.GREY, linewidth=0.6, linestyle=(0, (2, 2)), zorder=0.5)
    orbits[0].margins(y=0.08)
    for axis in (maxima[0], orbits[0]):
        axis.set_xlim(x[0], x[-1])
        axis.locator_params(axis="y", nbins=4)
        axis.locator_params(axis="x", nbins=6 if named else 3)
    maxima[0].set_ylim(0.0, top)
    for curve, left in zip(curves, maxima if branched else ()):
        panels.label_jumps(left, [curve], data.unit, [style.INK])
    for axis in (maxima[-1], orbits[-1]):
        axis.set_xlabel(panels.AXES[data.axis])
    room = panels.room_above(curves[:1]) if branched else 6.0 if wide else 13.0
    titles = ("(a) maximum slip speed", "(b) orbit diagrams") if named else (f"(a) {MAXIMUM}", f"(b) {SECTION}")
    for axis, title in zip((maxima[0], orbits[0]), titles):
        axis.annotate(title, (0.0, 1.0), (0.0, room if wide or axis is maxima[0] or not branched else 6.0),
                      xycoords="axes fraction", textcoords="offset points", fontsize=8.5 if wide else 7.5,
                      fontweight="bold")
    below = drawn.add_subplot(grid[-1, :])
    if branched:
        panels.legend_of(below, curves, curves, beyond)
        return
    below.set_axis_off()
    legend_of_marks(below, curves)
    named = style.legend(below, loc="lower center", ncols=3 if wide else 1, fontsize=6.5 if wide else 6.0)
    if named is not None:
        named.set_in_layout(False)


def _points(axis: Any, x: Sequence[float], curve: Labelled, colour: str) -> None:
    """Draw the maxima of a sweep as points, with a mark for each kind of motion."""
    values, at = panels.bounded(curve), np.array(x)
    panels.draw_runaways(axis, x, curve)
    for mark, where in panels.marked(curve):
        if mark is not panels.AWAY:
            axis.plot(at[where], values[where], alpha=0.75, zorder=2, **mark.look(colour))


def _paint_damping(drawn: Any, data: Figure) -> None:
    """Draw both readings of (21) above the maxima and the orbit diagram."""
    curve, x = data.curves[0], np.array(data.x)
    damping, maxima, orbit = drawn.subplots(3, 1, sharex=True, height_ratios=(1.2, 0.8, 1.0))
    weighted, negative = numbers(curve.equivalent_damping or []), numbers(curve.negative_slope_mean or [])
    damping.plot(x, weighted, color=style.GREEN, label=r"$C_f$ of (21) as printed")
    damping.plot(x, negative, color=style.BLUE, label=r"time mean of min($\partial T/\partial\dot\delta_1$, 0)")
    damping.axhline(data.threshold, color=style.RED, linewidth=0.8, linestyle=(0, (4, 2)))
    damping.annotate(r"$-C_{23}$", (1.005, data.threshold), xycoords=("axes fraction", "data"), color=style.RED,
                     va="center")
    damping.set(ylabel="damping (N m s/rad)", ylim=(None, 2.6))
    close = damping.inset_axes((0.66, 0.66, 0.33, 0.28))
    close.plot(x, 1e3 * weighted, color=style.GREEN, linewidth=0.8)
    close.set_xlim(x[0], x[-1])
    close.set_title(r"$C_f$, $10^{-3}$ N m s/rad", fontsize=6.0, fontweight="normal", pad=2.0)
    close.locator_params(nbins=4)
    close.tick_params(labelsize=5.5)
    style.legend_above(damping)
    draw_curve_maxima(maxima, data.x, curve, style.BLUE)
    maxima.lines[0].set_label("_")
    legend_of_marks(maxima, [curve])
    style.legend_above(maxima)
    maxima.set(ylabel=MAXIMUM, ylim=(0.0, None))
    draw_orbit(orbit, data.x, curve, style.BLUE)
    orbit.set(ylabel=SECTION, xlabel=panels.AXES[data.axis], xlim=(x[0], x[-1]))
    style.panel_titles((damping, maxima, orbit), ["equivalent damping", "maximum slip speed", "orbit diagram"])


def _paint_orbit(drawn: Any, data: Figure) -> None:
    """Draw one orbit diagram per direction, and one for both continued sweeps."""
    curves, x = data.curves, data.x
    cold, continued = ([c for c in curves if (c.direction == "cold") is alone] for alone in (True, False))
    shown = [panel for panel in (cold, continued) if panel]
    branched = curves[0].behind is not None
    heights = [1.0] * len(shown) + ([1.4, 0.2] if branched else [])
    grid = drawn.add_gridspec(len(heights), 1, height_ratios=heights)
    axes = [drawn.add_subplot(grid[k]) for k in range(len(shown) + branched)]
    for axis, panel in zip(axes, shown):
        for curve in panel:
            words, colour = DIRECTIONS[curve.direction]
            draw_orbit(axis, x, curve, colour)
            grey = dict(panels.marked(curve))[panels.SETTLING] | dict(panels.marked(curve))[panels.AWAY]
            if any(len(points or ()) for points, other in zip(curve.theta2, grey) if not other):
                style.key(axis, words, linestyle="none", marker=".", markersize=5.0, color=colour)
        if panels.AWAY in panels.marks_met(panel):
            style.key(axis, panels.AWAY.name, **panels.AWAY.look("", 3.0))
        axis.set_ylabel(SECTION)
    for k, axis in enumerate(axes):
        shade_slipping_away(axis, x, data)
        if k < len(shown):
            style.legend_above(axis)
        if k:
            axis.sharex(axes[0])
        if 0 < k < len(shown):
            axis.sharey(axes[0])
    for axis in axes[:-1]:
        axis.tick_params(labelbottom=False)
    titles = ["every value by itself" if panel is cold else "continued" for panel in shown]
    axes[-1].set(xlabel=panels.AXES[data.axis], xlim=(x[0], x[-1]))
    if branched:
        colours = [DIRECTIONS[c.direction][1] for c in curves]
        for curve, colour in zip(curves, colours):
            _points(axes[-1], x, curve, colour)
        panels.draw_branches(axes[-1], curves[0], data.unit, style.INK)
        top, beyond = panels.top_of(curves)
        axes[-1].set(ylabel=MAXIMUM, ylim=(0.0, top))
        panels.label_jumps(axes[-1], curves, data.unit, colours)
        panels.legend_of(drawn.add_subplot(grid[-1]), curves[:1], curves, beyond)
        titles.append("branches behind both")
    style.panel_titles(axes, titles)
    if branched:
        axes[-1].set_title(axes[-1].get_title(loc="left"), pad=panels.room_above(curves))


def shade_slipping_away(axis: Any, x: Sequence[float], data: Figure) -> None:
    """Shade the range with Tsm < Tm, with an entry for the legend."""
    keys = data.parameters
    ratio = keys["engine.mean_torque"] / (keys["friction.static_coefficient"] * keys["pressure.mean"]
                                          * keys["clutch.area"] * keys["clutch.radius"])
    if x[0] < ratio < x[-1]:
        axis.axvspan(x[0], ratio, color=style.GREY, alpha=0.25, linewidth=0.0, zorder=0, label="$T_{sm} < T_m$")


def _height(data: Figure, wide: bool) -> float:
    """Return the height of the picture without its caption, inch."""
    branched = data.kind in ("map", "orbit") and data.curves[0].behind is not None
    if data.kind == "orbit":
        return (3.0 if len({c.direction == "cold" for c in data.curves}) == 1 else 5.0) + 3.4 * branched
    page, column, _ = KINDS["branched map" if branched else data.kind]
    base, each = page if wide else column
    return base + each * len(data.curves if data.panels is None else data.panels)


KINDS: dict[str, tuple[tuple[float, float], tuple[float, float], Callable[[Any, Figure], None]]] = {
    "map": ((1.1, 1.05), (1.9, 1.05), _paint_map), "branched map": ((1.2, 1.9), (1.9, 3.2), _paint_map),
    "damping": ((5.4, 0.0), (5.4, 0.0), _paint_damping), "orbit": ((0.0, 0.0), (0.0, 0.0), _paint_orbit),
    "law": ((2.7, 0.0), (6.6, 0.0), histories.paint_law),
    "histories": ((0.6, 1.75), (0.6, 2.3), histories.paint_histories),
    "delay": ((4.4, 0.0), (0.5, 1.5), histories.paint_delay),
    "actuation": ((0.6, 1.4), (0.6, 1.4), histories.paint_actuation),
    "solvers": ((6.2, 0.0), (7.6, 0.0), histories.paint_solvers)}
"""Height in inch on a page and in a column, each of the picture and of every curve or panel, and painter, by kind."""


def draw_stored(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw a figure from its JSON; null is NaN in samples and in numbers that may be missing."""
    for part in (values, *(values.curves or ()), *(values.panels or ()), *(values.steady or ())):
        for name in SAMPLES:
            if isinstance(getattr(part, name), list):
                vars(part)[name] = numbers(getattr(part, name))
        vars(part).update({name: np.nan for name in ("peak_slip_speed", "first_half")
                           if name in part and part[name] is None})
        vars(part)["behind"] = part if part.branches is not None else None
    draw(values, path, title, width)  # type: ignore[arg-type]
    return path
