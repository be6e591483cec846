"""Drawings of the paper's figures from the numbers of `paper.figures`: maps, orbit diagrams, the law, histories; of
`figure --branches` the branches over points, and the cause of each jump.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.errors import counted
from tcc_sim.shown_units import speed
from tcc_sim.study.paper.branches_behind import MotionsBehind
from tcc_sim.study.paper.catalogue import SWEPT, plain
from tcc_sim.study.paper.figures import Figure, Labelled
from tcc_sim.study.views import MARKS, UNSTABLE, stable_and_unstable
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
CYCLES = "time (periods of excitation)"
SLIP, ANGLE = r"$\dot\delta_1$ (rad/s)", r"$\delta_2$ (rad)"
LOOKS: dict[str, dict[str, Any]] = {
    "smoothed": {"color": style.SKY, "linewidth": 3.0}, "rk45": {"color": style.INK, "linewidth": 1.0},
    "bdf": {"color": style.ORANGE, "linestyle": (0, (1, 1.5)), "linewidth": 1.6},
    "event_driven": {"color": style.GREEN, "linestyle": (0, (5, 2, 1, 2))},
    "rk4": {"color": style.RED, "linestyle": (0, (4, 2)), "linewidth": 0.8}}
LOOKS_OF_LAWS = (LOOKS["smoothed"], {"color": style.PURPLE, "linewidth": 1.4}, LOOKS["event_driven"])
"""Lines of the solvers of Fig. 2, and of the laws."""
SET_VALUED: dict[str, Any] = {"linewidth": 0.8, "linestyle": (0, (3, 2))}
"""Line of the set-valued law in Fig. 3."""
CAUSES = {"basin_boundary": "basin", "period_doubling": "doubling", "neimark_sacker": "torus"}
"""Labels of jumps whose cause has a longer name."""
UNNAMED = ("aperiodic", "not_followed")
"""Causes without a label in drawings, because there may be dozens; JSON and pages name them."""
UNSEEN = ("steep",)
"""Causes without a mark, because one motion continues."""
OFF_BRANCHES: dict[str, Any] = {"linewidth": 0.4, "linestyle": (0, (1, 3))}
"""Line of a jump whose cause is UNNAMED."""
NARROWEST = 0.021
"""Least distance of neighbouring labels, as a fraction of the axis."""
AXES = {"omega/omega_n": r"frequency ratio $\omega/\omega_n$", "mu_k/mu_s": r"friction ratio $\mu_k/\mu_s$"}


def draw_branches(axis: Any, curve: Labelled, unit: float, colour: str) -> None:
    """Draw the largest slip speed of every branch: solid if stable, dashed if unstable, thicker for longer periods."""
    motions = behind([curve])
    periods = sorted({b["period"] for b in motions.branches})
    for number, branch in enumerate(motions.branches):
        thicker = 0.35 * min(periods.index(branch["period"]), 3)
        for (x, height), dashes, width in zip(stable_and_unstable(vars(motions), number), ("-", UNSTABLE), (1.1, 0.7)):
            axis.plot(x / unit, height, linestyle=dashes, linewidth=width + thicker, color=colour, zorder=2.5)
    for item in motions.bifurcations:
        axis.plot([item["value"] / unit], [item["max_slip_speed"]], linestyle="none", marker=MARKS[item["kind"]][0],
                  color=style.INK, markersize=2.8, markeredgewidth=0.0, zorder=4)


def behind(curves: Sequence[Labelled]) -> MotionsBehind:
    """Join the motions behind some curves."""
    parts = [curve.behind for curve in curves if curve.behind is not None]
    return MotionsBehind(**{item.name: [x for part in parts for x in getattr(part, item.name)]
                            for item in fields(MotionsBehind)})


def room_above(curves: Sequence[Labelled]) -> float:
    """Return the height above the axes for the labels of `label_jumps`, if there are any, and a title, points."""
    return 64.0 if any(jump.cause not in UNNAMED + UNSEEN for jump in behind(curves).jumps) else 6.0


def label_jumps(axis: Any, curves: Sequence[Labelled], unit: float, colours: Sequence[str]) -> None:
    """Label every jump due to a bifurcation or a basin above the axes, without overlap, with a thin line to it.

    Jumps beside a motion without a period or a branch have a dotted line and no label.
    """
    low, high = axis.get_xlim()
    named: dict[tuple[str, str], tuple[float, str]] = {}
    for curve, colour in zip(curves, colours):
        for jump in behind([curve]).jumps:
            x, cause = jump.value / unit, jump.cause
            if cause in UNNAMED:
                axis.axvline(x, color=colour, alpha=0.6, zorder=1.4, **OFF_BRANCHES)
            elif cause not in UNSEEN:
                axis.axvline(x, color=colour, linewidth=0.5, alpha=0.7, zorder=1.5)
                name = CAUSES.get(cause, cause.removesuffix("_sliding").replace("_", " "))
                named.setdefault((name, f"{x:.4f}"), (x, colour))
    labels = sorted((x, f"{name} {value}", colour) for (name, value), (x, colour) in named.items())
    least = NARROWEST if style.wide(axis.figure.get_figwidth()) else 1.4 * NARROWEST
    places = spread([x for x, _, _ in labels], least * (high - low), low, high)
    for place, (x, text, colour) in zip(places, labels):
        axis.annotate(text, (x, 1.0), (place, 1.06), xycoords=("data", "axes fraction"), rotation=90,
                      textcoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=5.2, color=colour,
                      annotation_clip=False, arrowprops={"arrowstyle": "-", "linewidth": 0.4, "color": colour,
                                                         "shrinkA": 0.0, "shrinkB": 0.0})


def spread(places: Sequence[float], least: float, low: float, high: float) -> list[float]:
    """Move sorted positions apart to at least `least` by minimal shifts, within `low` to `high` if possible.

    Isotonic regression by the max-min formula (R. E. Barlow and others (1972), Sec. 1.2).
    """
    count = len(places)
    steps = least * np.arange(count)
    sums = np.concatenate([[0.0], np.cumsum(np.array(places) - steps)])
    moved = np.array([max(min((sums[end] - sums[k]) / (end - k) for end in range(n + 1, count + 1))
                          for k in range(n + 1)) for n in range(count)])
    if count * least <= high - low:
        moved = np.clip(moved, low, high - least * max(count - 1, 0))
    return [float(x) for x in moved + steps]


def top_of(curves: Sequence[Labelled]) -> tuple[float, int]:
    """Return the end of the axis of maxima, above branches and settled motions, and the number of points beyond."""
    inside = [0.0]
    for curve in curves:
        inside += [max(b["max_slip_speed"]) for b in behind([curve]).branches]
        inside += bounded(curve)[dict(marked(curve))[SETTLED]].tolist()
    top = max(1.12 * max(inside), 1e-6)
    return top, sum(int((bounded(curve) > top).sum()) for curve in curves)


def legend_of(axis: Any, curves: Sequence[Labelled], swept: Sequence[Labelled], beyond: int) -> None:
    """Draw the legend in axes of its own: lines of branches, marks of `swept` curves, number of points beyond."""
    followed = behind(curves)
    some = any(any(b["stable"]) for b in followed.branches)
    rows: list[dict[str, Any]] = [{"label": "stable (thicker: longer period)"}] * some
    whole = all(all(b["stable"]) for b in followed.branches)
    rows += [{"label": "unstable", "linewidth": 0.7, "linestyle": UNSTABLE}] * (not whole)
    rows += [{"label": mark.name, **mark.look(style.INK, 2.4)} for mark in marks_met(swept)]
    rows += [{"label": f"({counted(beyond, 'point')} beyond the axes)", "linestyle": "none"}] * bool(beyond)
    rows += [{"label": name, "marker": marker, "markersize": 3.2, "markeredgewidth": 0.0, "linestyle": "none"}
             for marker, name in (MARKS[kind] for kind in dict.fromkeys(f["kind"] for f in followed.bifurcations))]
    causes = {jump.cause for jump in behind(swept).jumps}
    rows += [{"label": "jump, with its cause", "linewidth": 0.5}] * bool(causes.difference(UNNAMED, UNSEEN))
    rows += [{"label": "jump off the branches", **OFF_BRANCHES}] * bool(causes.intersection(UNNAMED))
    axis.set_axis_off()
    for row in rows:
        style.key(axis, **{"color": style.INK, **row})
    columns = 4 if style.wide(axis.figure.get_figwidth()) else 2
    if (named := style.legend(axis, loc="center", ncols=columns, fontsize=6.2)) is not None:
        named.set_in_layout(False)


@dataclass(frozen=True)
class Mark:
    """Look of points; `face` and `colour` override the colour of the curve, and `size` that of the picture."""

    name: str
    marker: str
    face: str = ""
    edge: float = 0.0
    size: float = 0.0
    colour: str = ""

    def look(self, colour: str, size: float = 1.8) -> dict[str, Any]:
        """Return the keywords of a plot."""
        colour = self.colour or colour
        return {"linestyle": "none", "marker": self.marker, "color": colour, "markersize": self.size or size,
                "markerfacecolor": self.face or colour, "markeredgewidth": self.edge}


SETTLED = Mark("settled in a period", "o")
APERIODIC = Mark("no period up to 16", "o", "white", 0.5)
SETTLING = Mark("still settling to a period", "x", "white", 0.5)
AWAY = Mark("slip grows without end", "^", colour=style.RUNAWAY)
OTHER = Mark("coexists: reached from a neighbour's state", "D", "none", 0.7, 3.2)
SPIKE = Mark("transient outlasting the dropped cycles", "v", "none", 0.8, 4.5)


def marked(curve: Labelled) -> list[tuple[Mark, np.ndarray]]:
    """Return every kind of point with (n,) whether each point of a curve is of this kind."""
    away, period, done = (np.array([other if v is None else v for v in values]) for values, other in (
        (curve.runaway, False), (curve.period, 0), (curve.settled, True)))
    where = (~away & (period > 0) & done, ~away & (period > 0) & ~done, ~away & (period == 0), away)
    return list(zip((SETTLED, SETTLING, APERIODIC, AWAY), (w.astype(bool) for w in where)))


def draw_runaways(axis: Any, x: Sequence[float], curve: Labelled) -> None:
    """Mark runaway slip at the upper edge, since its size depends on the solved time only."""
    where = dict(marked(curve))[AWAY]
    axis.plot(np.array(x)[where], np.full(int(where.sum()), 0.97), transform=axis.get_xaxis_transform(), zorder=2,
              **AWAY.look("", 3.0))


def bounded(curve: Labelled) -> np.ndarray:
    """Return (n,) largest slip speeds, NaN for a failure or runaway slip."""
    return np.where(dict(marked(curve))[AWAY], np.nan, numbers(curve.max_slip_speed))


def marks_met(curves: Sequence[Labelled]) -> list[Mark]:
    """Return the kinds of points on some curves."""
    return list(dict.fromkeys(mark for curve in curves for mark, where in marked(curve) if where.any()))


def paint_histories(drawn: Any, data: Figure) -> None:
    """Draw Fig. 7: slip speed, plate angle and section (plate speed over plate angle) of every value, in equal ranges.

    The sections lie in stick, where the slip speed is 0.
    """
    panels = data.panels
    axes = _rows_of_three(drawn, len(panels))
    for letter, row, panel in zip("abc", axes, panels):
        speed, angle, section = row
        speed.plot(panel.t, panel.slip_speed, color=style.BLUE, linewidth=0.9)
        angle.plot(panel.t, panel.plate_angle, color=style.GREEN, linewidth=0.9)
        section.plot(*np.array(panel.section).reshape(-1, 2).T, linestyle="none", marker="o", color=style.RED,
                     markeredgewidth=0.0, markersize=5.0 if panel.period else 1.6)
        section.margins(0.1)
        speed.set(ylabel=SLIP, xlim=(panel.t[0], panel.t[-1]), title=f"({letter}) {panel.label}")
        angle.set(ylabel=ANGLE, xlim=(panel.t[0], panel.t[-1]))
        section.set_ylabel(r"$\dot\delta_2$ (rad/s)")
        # In a column the section is too narrow for the diagnosis; the slip speed is as wide as the picture.
        _note(section if style.wide(drawn.get_figwidth()) else speed, _diagnosis(panel))
        section.locator_params(axis="x", nbins=4)
    for axis, label in zip(axes[-1], (CYCLES, CYCLES, ANGLE)):
        axis.set_xlabel(label)


def _note(axis: Any, words: str) -> None:
    """Write words above the right end of the axes."""
    axis.set_title(words, loc="right", fontweight="normal", fontsize=7.0)


def _torque_axis(axis: Any, colour: str) -> Any:
    other = axis.twinx()
    other.grid(False)
    other.spines["right"].set_visible(True)
    other.tick_params(colors=colour)
    return other


def _rows_of_three(drawn: Any, count: int) -> Any:
    """Return (count, 3) axes, each column in shared ranges: in a row, or the first above the two others."""
    if style.wide(drawn.get_figwidth()):
        return drawn.subplots(count, 3, width_ratios=(1.25, 1.25, 1.0), sharex="col", sharey="col")
    grid, axes = drawn.add_gridspec(2 * count, 2, width_ratios=(1.25, 1.0)), np.empty((count, 3), dtype=object)
    for k in range(count):
        for place, cell in enumerate((grid[2 * k, :], grid[2 * k + 1, 0], grid[2 * k + 1, 1])):
            first = axes[0, place] if k else None
            axes[k, place] = drawn.add_subplot(cell, sharex=first, sharey=first)
    return axes


def _diagnosis(panel: Labelled) -> str:
    """Return the period, or the exponent with its interval, as text."""
    if panel.period:
        return f"period {panel.period}"
    exponent = panel.lyapunov
    if exponent is None or not np.isfinite(exponent.exponent):
        return "no period up to 16"
    half = 0.5 * (exponent.high - exponent.low)
    return rf"{exponent.diagnosis}, $\lambda_1 = {exponent.exponent:.1f} \pm {half:.1f}$ s$^{{-1}}$"


def paint_delay(drawn: Any, data: Figure) -> None:
    """Draw Fig. 9: slip speed with positive slip shaded, and the engine torque above it."""
    wide, panels = style.wide(drawn.get_figwidth()), data.panels
    grid = drawn.subplots(2, 2, sharex=True) if wide else drawn.subplots(len(panels), 1, sharex=True)
    for k, (axis, panel) in enumerate(zip(grid.ravel(), panels)):
        t, v = panel.t, panel.slip_speed
        axis.fill_between(t, 0.0, np.where(panel.state == 1, v, 0.0), color=style.STICK, linewidth=0.0)
        axis.plot(t, v, color=style.BLUE, label="slip speed")
        axis.set(xlim=(t[0], t[-1]), title=f"({'abcd'[k]}) {panel.label}")
        other = _torque_axis(axis, style.ORANGE)
        other.plot(t, panel.engine_torque, color=style.ORANGE, linewidth=0.9, linestyle=(0, (4, 2)))
        if k % 2 or not wide:
            other.set_ylabel(r"$T_e$ (N m)", color=style.ORANGE)
        if k % 2 == 0 or not wide:
            axis.set_ylabel(SLIP, color=style.BLUE)
        share = panel.first_half
        _note(axis, f"{100.0 * share:.0f} % in first half cycle" if np.isfinite(share) else "no positive slip")
        if k > 1 and (wide or k == len(panels) - 1):
            axis.set_xlabel(CYCLES)


def paint_actuation(drawn: Any, data: Figure) -> None:
    """Draw Fig. 12: slip speed, engine and saturation torque, with the start of every engine cycle."""
    panels = data.panels
    axes = drawn.subplots(len(panels), 1, sharex=True, sharey=True)
    for letter, axis, panel in zip("abc", axes, panels):
        t = panel.t
        axis.plot(t, panel.slip_speed, color=style.BLUE)
        axis.set(ylabel=SLIP, xlim=(t[0], t[-1]), xticks=np.arange(0, int(t[-1]) + 1),
                 title=f"({letter}) {panel.label}")
        _note(axis, (f"period {panel.period}" if panel.period else "no period up to 16") + orbit_words(panel))
        other = _torque_axis(axis, style.GREY)
        other.plot(t, panel.saturation_torque, color=style.GREY, linewidth=0.9, linestyle=(0, (4, 2)))
        other.plot(t, panel.engine_torque, color=style.ORANGE, linewidth=0.8, linestyle=(0, (1, 1.5)))
        other.set_ylabel(r"$T_s$, $T_e$ (N m)", color=style.GREY)
        axis.set_zorder(other.get_zorder() + 1)
        axis.patch.set_visible(False)
    axes[-1].set_xlabel(CYCLES)


def orbit_words(panel: Labelled) -> str:
    """Return the stability of a panel's periodic orbit in words; empty if it was not followed."""
    if panel.orbit is None:
        return ""
    orbit = panel.orbit
    size = max(float(np.hypot(*m)) for m in orbit["multipliers"])
    return f", {'stable' if orbit['stable'] else 'unstable'}: largest Floquet multiplier {size:.3g}"


def paint_solvers(drawn: Any, data: Figure) -> None:
    """Draw Fig. 2: slip speed by every solver from one state, their divergence, and steady motions from (13)."""
    whole, close, steady = drawn.subplots(3, 1)
    wide, period, first = style.wide(drawn.get_figwidth()), data.cycle, data.curves[0]
    for curve in data.curves:
        difference = curve.rms_difference
        label = curve.label + (f" ({difference:.1e})" if np.isfinite(difference) and curve.solver != "smoothed" else "")
        for axis in (whole, close):
            axis.plot(curve.t * period, curve.slip_speed, label=label, **LOOKS[curve.solver])
    leaving = float(first.t[int(np.argmax(first.slip_speed > 1.0))]) * period
    for axis in (whole, close):
        axis.set(ylabel=SLIP, xlabel="time (s)")
    whole.set_xlim(0.0, first.t[-1] * period)
    close.set(xlim=(leaving - 0.06 * period, leaving + 0.03 * period), ylim=(-0.6, 4.0))
    if not wide:
        close.locator_params(axis="x", nbins=5)
    words = f"in brackets: rms difference from the first curve,{' ' if wide else chr(10)}relative to its maximum"
    style.legend(whole, loc="lower right", bbox_to_anchor=(1.0, 1.02), ncols=3 if wide else 1, fontsize=6.8,
                 title=words, title_fontsize=6.8)
    style.panel_titles((whole, close, steady), [
        "from one state", "leaving stick", f"steady state of each law from (13), after {data.steady_cycles} cycles"])
    for row, look in zip(data.steady, LOOKS_OF_LAWS):
        steady.plot(row.t, row.slip_speed, **look,
                    label=f"{row.label}: period {row.period}, {speed(row.max_slip_speed, 4)}")
    steady.set(ylabel=SLIP, xlabel=CYCLES, xlim=(0.0, data.steady[0].t[-1]))
    steady.set_ylim(top=(1.4 if wide else 1.9) * max(row.max_slip_speed for row in data.steady))
    style.legend(steady, loc="upper center", ncols=3 if wide else 1, fontsize=6.5)


def paint_law(drawn: Any, data: Figure) -> None:
    """Draw Fig. 3: law, zoom, slope."""
    wide, near, slope = drawn.subplots(1, 3) if style.wide(drawn.get_figwidth()) else drawn.subplots(3, 1)
    v, close = data.slip_speed, data.near_slip_speed
    for colour, curve in zip(style.CYCLE, data.curves):
        wide.plot(v, curve.coefficient, color=colour, label=curve.label)
        near.plot(close, curve.near_coefficient, color=colour)
        near.plot(close, curve.near_set_valued, color=colour, **SET_VALUED)
        slope.plot(close, curve.near_slope, color=colour)
        if np.isfinite(curve.peak_slip_speed):
            near.plot(curve.peak_slip_speed, curve.peak, marker="o", markersize=3.0, color=colour)
    style.key(near, "set-valued law (6)", color=style.GREY, **SET_VALUED)
    if any(np.isfinite(curve.peak_slip_speed) for curve in data.curves):
        style.key(near, "maximum of (7)", color=style.GREY, linestyle="none", marker="o")
    near.set_ylim(0.6, 1.6)
    slope.set_ylim(-1.5, 1.5)
    slope.axhline(0.0, color=style.GREY, linewidth=0.6)
    for axis, label in ((wide, r"$\bar\mu$"), (near, r"$\bar\mu$"),
                        (slope, r"$\partial\bar\mu/\partial\dot\delta_1$ (s/rad)")):
        axis.set(xlabel=SLIP, ylabel=label)
        axis.margins(x=0.0)
    style.panel_titles((wide, near, slope), ["smoothed law (7)", "zoom", "slope (20b)"])
    for axis in (wide, near):
        style.legend(axis, loc="lower right", fontsize=6.5)


def draw(data: Figure, stem: Path, title: str = "", width: float = style.PAGE) -> None:
    """Write the picture of one figure as `stem`.png and `stem`.svg, with number and title of the figure as its default
    title. In a column (`width`, inch) panels are narrower or below each other.
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
        drawn.suptitle(words if wide else _wrapped(words, 42), x=0.01, ha="left", fontsize=9.5 if wide else 8.5,
                       fontweight="bold", parse_math=not title)
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
    from tcc_sim.study.paper.catalogue import FigureOptions, check_options
    from tcc_sim.study.paper.figures import figure_data

    options = FigureOptions(quick, direction, law, jobs, branches=branches)
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
        if any(mark is SETTLING for mark in marks_met(data.curves)):
            parts.append("grey: still settling to a period")
    return _wrapped("; ".join(parts), WIDEST if style.wide(width) else NARROW)


def _wrapped(text: str, most: int) -> str:
    """Break a text into lines of at most this number of characters."""
    first, *words = WORD.findall(text)
    lines = [first]
    for word in words:
        if len(plain(f"{lines[-1]} {word}")) > most:
            lines.append(word)
        else:
            lines[-1] += f" {word}"
    return "\n".join(lines)


def draw_orbit(axis: Any, x: Sequence[float], curve: Labelled, colour: str) -> None:
    """Draw section points over the parameter, grey for unsettled motions; mark runaway slip at the edge."""
    draw_runaways(axis, x, curve)
    counts = np.array([len(p or ()) for p in curve.theta2])
    points = np.concatenate([np.array(p or (), dtype=np.float64) for p in curve.theta2])
    place = np.repeat(x, counts)
    for mark, where in marked(curve):
        if mark is not AWAY:
            shown = np.repeat(where, counts)
            axis.plot(place[shown], points[shown], linestyle="none", marker=".", markersize=1.6, markeredgewidth=0.0,
                      color=style.GREY if mark is SETTLING else colour, rasterized=True)


def draw_curve_maxima(axis: Any, x: Sequence[float], curve: Labelled, colour: str) -> None:
    """Draw the largest slip speeds with a mark for each kind of motion, coexisting motions, and spikes."""
    axis.plot(x, bounded(curve), color=colour, linewidth=0.9, label=curve.label)
    _points(axis, x, curve, colour)
    rows = curve.coexisting or ()
    for mark, places in ((OTHER, [(x[r.index], r.other.max_slip_speed) for r in rows]),
                         (SPIKE, [(x[r.index], r.max_slip_speed) for r in rows if r.spike])):
        axis.plot(*np.array(places).reshape(-1, 2).T, **mark.look(colour))


def legend_of_marks(axis: Any, curves: Sequence[Labelled]) -> None:
    """Draw a legend of the marks in this picture."""
    rows = [r for curve in curves for r in curve.coexisting or ()]
    for mark in (*marks_met(curves), *[OTHER] * bool(rows), *[SPIKE] * any(r.spike for r in rows)):
        style.key(axis, mark.name, **mark.look(style.INK, 2.6))


def _paint_map(drawn: Any, data: Figure) -> None:
    """Draw maxima and orbit diagrams of every curve in shared ranges, over the other curves or its branches, pale."""
    curves, x = data.curves, data.x
    branched, wide, count = curves[0].behind is not None, style.wide(drawn.get_figwidth()), len(curves)
    top, beyond = top_of(curves) if branched else (
        1.06 * max(float(np.nanmax(bounded(curve), initial=1e-6)) for curve in curves), 0)
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
            draw_branches(left, curve, data.unit, colour)
        else:
            for other in curves:
                left.plot(x, bounded(other), color=style.GREY, linewidth=0.4, alpha=0.45, zorder=1)
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
        label_jumps(left, [curve], data.unit, [style.INK])
    for axis in (maxima[-1], orbits[-1]):
        axis.set_xlabel(AXES[data.axis])
    room = room_above(curves[:1]) if branched else 6.0 if wide else 13.0
    titles = ("(a) maximum slip speed", "(b) orbit diagrams") if named else (f"(a) {MAXIMUM}", f"(b) {SECTION}")
    for axis, title in zip((maxima[0], orbits[0]), titles):
        axis.annotate(title, (0.0, 1.0), (0.0, room if wide or axis is maxima[0] or not branched else 6.0),
                      xycoords="axes fraction", textcoords="offset points", fontsize=8.5 if wide else 7.5,
                      fontweight="bold")
    below = drawn.add_subplot(grid[-1, :])
    if branched:
        legend_of(below, curves, curves, beyond)
        return
    below.set_axis_off()
    legend_of_marks(below, curves)
    named = style.legend(below, loc="lower center", ncols=3 if wide else 1, fontsize=6.5 if wide else 6.0)
    if named is not None:
        named.set_in_layout(False)


def _points(axis: Any, x: Sequence[float], curve: Labelled, colour: str) -> None:
    """Draw the maxima of a sweep as points, with a mark for each kind of motion."""
    values, at = bounded(curve), np.array(x)
    draw_runaways(axis, x, curve)
    for mark, where in marked(curve):
        if mark is not AWAY:
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
    orbit.set(ylabel=SECTION, xlabel=AXES[data.axis], xlim=(x[0], x[-1]))
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
            grey = dict(marked(curve))[SETTLING] | dict(marked(curve))[AWAY]
            if any(len(points or ()) for points, other in zip(curve.theta2, grey) if not other):
                style.key(axis, words, linestyle="none", marker=".", markersize=5.0, color=colour)
        if AWAY in marks_met(panel):
            style.key(axis, AWAY.name, **AWAY.look("", 3.0))
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
    axes[-1].set(xlabel=AXES[data.axis], xlim=(x[0], x[-1]))
    if branched:
        colours = [DIRECTIONS[c.direction][1] for c in curves]
        for curve, colour in zip(curves, colours):
            _points(axes[-1], x, curve, colour)
        draw_branches(axes[-1], curves[0], data.unit, style.INK)
        top, beyond = top_of(curves)
        axes[-1].set(ylabel=MAXIMUM, ylim=(0.0, top))
        label_jumps(axes[-1], curves, data.unit, colours)
        legend_of(drawn.add_subplot(grid[-1]), curves[:1], curves, beyond)
        titles.append("branches behind both")
    style.panel_titles(axes, titles)
    if branched:
        axes[-1].set_title(axes[-1].get_title(loc="left"), pad=room_above(curves))


def shade_slipping_away(axis: Any, x: Sequence[float], data: Figure) -> None:
    """Shade the range with Tsm < Tm, with an entry for the legend."""
    keys = data.parameters
    ratio = keys["engine.mean_torque"] / (keys["friction.static_coefficient"] * keys["pressure.mean"]
                                          * keys["clutch.area"] * keys["clutch.radius"])
    if x[0] < ratio < x[-1]:
        axis.axvspan(x[0], ratio, color=style.GREY, alpha=0.25, linewidth=0.0, zorder=0, label="$T_{sm} < T_m$")


def _height(data: Figure, wide: bool) -> float:
    branched = data.kind in ("map", "orbit") and data.curves[0].behind is not None
    if data.kind == "orbit":
        return (3.0 if len({c.direction == "cold" for c in data.curves}) == 1 else 5.0) + 3.4 * branched
    page, column, _ = KINDS["branched map" if branched else data.kind]
    base, each = page if wide else column
    return base + each * len(data.curves if data.panels is None else data.panels)


KINDS: dict[str, tuple[tuple[float, float], tuple[float, float], Callable[[Any, Figure], None]]] = {
    "map": ((1.1, 1.05), (1.9, 1.05), _paint_map), "branched map": ((1.2, 1.9), (1.9, 3.2), _paint_map),
    "damping": ((5.4, 0.0), (5.4, 0.0), _paint_damping), "orbit": ((0.0, 0.0), (0.0, 0.0), _paint_orbit),
    "law": ((2.7, 0.0), (6.6, 0.0), paint_law),
    "histories": ((0.6, 1.75), (0.6, 2.3), paint_histories),
    "delay": ((4.4, 0.0), (0.5, 1.5), paint_delay),
    "actuation": ((0.6, 1.4), (0.6, 1.4), paint_actuation),
    "solvers": ((6.2, 0.0), (7.6, 0.0), paint_solvers)}
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
