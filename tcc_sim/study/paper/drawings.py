"""Drawings of the paper's figures from the numbers of `paper.figures`, as panels: maps and orbit diagrams as `sweep`
draws them, over the paper's ratios; with `figure --branches` the branches behind them as `continue` draws them, and the
cause of each jump.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.errors import counted
from tcc_sim.result import json_of
from tcc_sim.shown_units import speed
from tcc_sim.study.paper.catalogue import FIGURES, SWEPT, FigureOptions, check_options, plain
from tcc_sim.study.paper.figures import Figure, figure_data
from tcc_sim.study.views import branch_panels
from tcc_sim.views import style
from tcc_sim.views.panels import Panel, compose
from tcc_sim.views.stored import Record
from tcc_sim.views.sweeps import DOTS, numbers, sweep_panels

WORD = re.compile(r"(?:\$[^$]*\$|[^\s$])+")
"""A word of a caption; formulas stay whole."""
WIDEST, NARROW, TITLE = 125, 72, 42
"""Characters of a caption's line over a page and in a column, and of a title's line in a column."""
SAMPLES = ("t", "slip_speed", "plate_angle", "friction_torque", "engine_torque", "saturation_torque", "state",
           "coefficient", "slope", "near_slip_speed", "near_coefficient", "near_slope", "near_set_valued")
"""Keys of the samples of curves and panels."""
DIRECTIONS = {"cold": ("from the initial state (13)", style.BLUE), "up": ("continued upward", style.RED),
              "down": ("continued downward", style.GREEN)}
CYCLES = "time (periods of excitation)"
SLIP, MAXIMUM, ANGLE = r"$\dot\delta_1$ (rad/s)", r"max $|\dot\delta_1|$ (rad/s)", r"$\delta_2$ (rad)"
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
NARROWEST = 0.16
"""Least distance of neighbouring labels, inch."""
AXES = {"omega/omega_n": r"frequency ratio $\omega/\omega_n$", "mu_k/mu_s": r"friction ratio $\mu_k/\mu_s$"}


def swept(data: Record, curve: Record) -> tuple[Panel, Panel]:
    """Return the maxima and the orbit diagram of a curve as `sweep` draws them."""
    maxima, orbit, *_ = sweep_panels({
        "values": data.x, "over": AXES[data.axis],
        "transient": [bool(period) and not done for period, done in zip(curve.period, curve.settled)],
        "section": [[(angle,) for angle in angles or ()] for angles in curve.theta2],
        **{name: getattr(curve, name) for name in (
            "max_slip_speed", "runaway", "regime", "period", "stick_fraction")}}, "maximum, not settled")
    return maxima, orbit


def settled(curve: Record) -> np.ndarray:
    """Return (n,) whether a motion has a period and has settled to it."""
    return np.array([bool(period and done) for period, done in zip(curve.period, curve.settled)])


def bounded(curve: Record) -> np.ndarray:
    """Return (n,) largest slip speeds, NaN for a failure or runaway slip."""
    return np.where([bool(away) for away in curve.runaway], np.nan, numbers(curve.max_slip_speed))


def top_of(axis: Any, curves: Sequence[Record]) -> float:
    """Return the upper end of the axis of maxima above all motions, or above branches and settled motions if there are
    branches; the legend then has the number of points beyond.
    """
    inside: list[float] = [max(branch.max_slip_speed) for curve in curves for branch in curve.branches or ()]
    inside += [float(np.nanmax(bounded(curve)[settled(curve) | (curve.branches is None)], initial=0.0))
               for curve in curves]
    top = max(1.12 * max(inside), 1e-6)
    if beyond := sum(int((bounded(curve) > top).sum()) for curve in curves):
        style.key(axis, f"({counted(beyond, 'point')} beyond the axes)", linestyle="none")
    return top


def draw_maxima(axis: Any, data: Record, curve: Record) -> None:
    """Draw the largest slip speeds with coexisting motions and with transients that stand out."""
    swept(data, curve)[0].draw(axis)
    rows = curve.coexisting or ()
    for name, marker, places in (
            ("coexisting motion", "D", [(r.index, r.other.max_slip_speed) for r in rows]),
            ("transient outlasts the dropped cycles", "v", [(r.index, r.max_slip_speed) for r in rows if r.spike])):
        axis.plot([data.x[k] for k, _ in places], [height for _, height in places], linestyle="none", marker=marker,
                  markersize=3.6, markerfacecolor="none", markeredgewidth=0.7, color=style.INK, label=name)


def draw_branches(axis: Any, data: Record, curves: Sequence[Record]) -> None:
    """Draw the branches behind curves, which share them, with the motions of their sweeps and the causes of jumps."""
    unit = data.unit
    branch_panels({
        "over": AXES[data.axis],
        "bifurcations": [{**vars(f), "value": f.value / unit} for f in curves[0].bifurcations],
        "branches": [{**vars(b), "value": [x / unit for x in b.value]} for b in curves[0].branches],
    }, "unstable")[0].draw(axis)  # The colour tells the period of unstable motions too.
    for curve in curves:
        for which, face, name in ((settled(curve), style.INK, "motion of the sweep"),
                                  (~settled(curve), "white", "without a period, or not settled")):
            axis.plot(np.array(data.x)[which], bounded(curve)[which], **{**DOTS, "markeredgewidth": 0.4}, zorder=1.8,
                      markersize=1.8, color=style.INK, markerfacecolor=face, label=name)
    axis.set_xlim(data.x[0], data.x[-1])
    label_jumps(axis, curves, unit)


def label_jumps(axis: Any, curves: Sequence[Record], unit: float) -> None:
    """Label every jump due to a bifurcation or a basin on an axis above, without overlap, with a thin line to it.

    Jumps beside a motion without a period or a branch have a dotted line and no label.
    """
    named: dict[str, tuple[float, str]] = {}
    for curve in curves:
        words, colour = DIRECTIONS[curve.direction]
        colour, words = (colour, f", {words}") if len(curves) > 1 else (style.INK, "")
        for jump in curve.jumps:
            x, cause = jump.value / unit, jump.cause
            if cause in UNNAMED:
                axis.axvline(x, color=colour, alpha=0.6, zorder=1.4, label="jump off the branches", **OFF_BRANCHES)
            elif cause not in UNSEEN:
                axis.axvline(x, color=colour, linewidth=0.5, alpha=0.7, zorder=1.5, label=f"jump{words}")
                name = CAUSES.get(cause, cause.removesuffix("_sliding").replace("_", " "))
                named.setdefault(f"{name} {x:.4f}", (x, colour))
    if not named:
        return
    (low, high), least = axis.get_xlim(), NARROWEST / (0.8 * axis.figure.get_figwidth())
    labels = sorted((x, text, colour) for text, (x, colour) in named.items())
    places = spread([x for x, _, _ in labels], least * (high - low), low, high)
    above = axis.secondary_xaxis("top")
    above.set_xticks(places, [text for _, text, _ in labels], rotation=90, fontsize=5.2)
    above.tick_params(length=0.0, pad=8.0)
    for place, tick, (x, _, colour) in zip(places, above.get_xticklabels(), labels):
        tick.set_color(colour)
        axis.plot([x, place], [1.0, 1.05], transform=axis.get_xaxis_transform(), clip_on=False, color=colour,
                  linewidth=0.4)


def spread(places: Sequence[float], least: float, low: float, high: float) -> list[float]:
    """Move sorted positions apart to at least `least`, upward from `low` and then back from `high`."""
    moved = list(accumulate(places, lambda before, place: max(place, before + least)))
    moved[-1] = min(moved[-1], max(high, low + least * (len(moved) - 1)))
    return list(accumulate(reversed(moved), lambda above, place: min(place, above - least)))[::-1]


def key_panel(height: float) -> Panel:
    """Return a panel with one legend of all panels before it."""
    def draw(axis: Any) -> None:
        named = {name: handle for other in axis.figure.axes for handle, name in zip(*style.entries(other))}
        axis.set_axis_off()
        columns, size = (4, 6.2) if style.wide(axis.figure.get_figwidth()) else (2, 5.5)
        axis.legend(named.values(), named.keys(), loc="center", ncols=columns, fontsize=size).set_in_layout(False)

    return Panel("", draw, height, named=False)


def map_panels(data: Record) -> list[Panel]:
    """Return maxima, or branches, and orbit diagram of every curve, in shared ranges."""
    curves, branched = data.curves, data.curves[0].branches is not None
    angles = [a for curve in curves for part in curve.theta2 for a in part or ()]

    def left(axis: Any, curve: Record) -> None:
        if branched:
            draw_branches(axis, data, [curve])
        else:
            draw_maxima(axis, data, curve)
        marked(axis)
        axis.set(ylim=(0.0, top_of(axis, curves)), ylabel=MAXIMUM)

    def right(axis: Any, curve: Record) -> None:
        swept(data, curve)[1].draw(axis)
        marked(axis)
        axis.set(ylim=span_of(angles), ylabel=ANGLE)

    def marked(axis: Any) -> None:
        axis.set_xlim(data.x[0], data.x[-1])
        axis.locator_params(axis="y", nbins=4)
        axis.locator_params(axis="x", nbins=6)
        for mark in data.marks:
            axis.axvline(mark, color=style.GREY, linewidth=0.6, linestyle=(0, (2, 2)), zorder=0.5)

    heights, ratio = (2.2, 1.6) if branched else (1.2, 1.2), style.quantity_of(AXES[data.axis])
    return [*(Panel(title, partial(draw, curve=curve), height, ratio, beside=draw is right, over=True, named=False,
                    close=draw is right and not branched)
              for curve in curves for draw, title, height in zip((left, right), (curve.label, ""), heights)),
            key_panel(1.0 if branched else 0.5)]


def damping_panels(data: Record) -> list[Panel]:
    """Return both readings of (21) above the maxima and the orbit diagram."""
    curve, x = data.curves[0], np.array(data.x)
    maxima, orbit = swept(data, curve)
    weighted, negative = numbers(curve.equivalent_damping or []), numbers(curve.negative_slope_mean or [])

    def damping(axis: Any) -> None:
        axis.plot(x, weighted, color=style.GREEN, label=r"$C_f$ of (21) as printed")
        axis.plot(x, negative, color=style.BLUE, label=r"time mean of min($\partial T/\partial\dot\delta_1$, 0)")
        axis.axhline(data.threshold, color=style.RED, linewidth=0.8, linestyle=(0, (4, 2)))
        axis.annotate(r"$-C_{23}$", (1.005, data.threshold), xycoords=("axes fraction", "data"), color=style.RED,
                      va="center")
        axis.set(ylabel="damping (N m s/rad)", ylim=(None, 2.6), xlim=(x[0], x[-1]))
        close = axis.inset_axes((0.66, 0.66, 0.33, 0.28))
        close.plot(x, 1e3 * weighted, color=style.GREEN, linewidth=0.8)
        close.set_xlim(x[0], x[-1])
        close.set_title(r"$C_f$, $10^{-3}$ N m s/rad", fontsize=6.0, fontweight="normal", pad=2.0)
        close.locator_params(nbins=4)
        close.tick_params(labelsize=5.5)

    return [Panel("equivalent damping", damping, 2.1),
            maxima._replace(title="maximum slip speed", draw=partial(draw_maxima, data=data, curve=curve), height=1.4,
                            over=True),
            orbit._replace(title="orbit diagram", height=1.8)]


def orbit_panels(data: Record) -> list[Panel]:
    """Return one orbit diagram per direction, and the branches behind all of them."""
    curves, keys = data.curves, data.parameters
    ratio = keys["engine.mean_torque"] / (keys["friction.static_coefficient"] * keys["pressure.mean"]
                                          * keys["clutch.area"] * keys["clutch.radius"])

    def shaded(axis: Any, draw: Callable[[Any], object]) -> None:
        draw(axis)
        axis.set_xlim(data.x[0], data.x[-1])
        if data.x[0] < ratio < data.x[-1]:
            axis.axvspan(data.x[0], ratio, color=style.GREY, alpha=0.25, linewidth=0.0, zorder=0,
                         label="$T_{sm} < T_m$")

    def branches(axis: Any) -> None:
        draw_branches(axis, data, curves)
        axis.set(ylim=(0.0, top_of(axis, curves)), ylabel=MAXIMUM)

    panels = [swept(data, curve)[1]._replace(title=DIRECTIONS[curve.direction][0], height=1.7) for curve in curves]
    panels += [Panel("branches behind them", branches, 3.4, panels[0].x)] if curves[0].branches is not None else []
    return [*(panel._replace(draw=partial(shaded, draw=panel.draw), over=k > 0, named=False)
              for k, panel in enumerate(panels)), key_panel(1.5 if len(panels) > len(curves) else 0.3)]


def history_panels(data: Record) -> list[Panel]:
    """Return Fig. 7: slip speed, plate angle and section (plate speed over plate angle) of every value, in equal
    ranges. The sections lie in stick, where the slip speed is 0.
    """
    speeds, angles = ([getattr(panel, name) for panel in data.panels] for name in ("slip_speed", "plate_angle"))
    places = [span_of([np.array(panel.section)[:, k] for panel in data.panels]) for k in range(2)]

    def line(axis: Any, panel: Record, name: str, label: str, colour: str, rows: Sequence[Any]) -> None:
        axis.plot(panel.t, getattr(panel, name), color=colour, linewidth=0.9)
        axis.set(xlabel=CYCLES, ylabel=label, xlim=(panel.t[0], panel.t[-1]), ylim=span_of(rows))

    def section(axis: Any, panel: Record) -> None:
        axis.plot(*zip(*panel.section), **DOTS, color=style.RED, markersize=5.0 if panel.period else 1.6)
        axis.set(xlabel=ANGLE, ylabel=r"$\dot\delta_2$ (rad/s)", xlim=places[0], ylim=places[1])
        axis.locator_params(axis="x", nbins=4)
        words = f"period {panel.period}" if panel.period else "no period up to 16"
        if (found := panel.lyapunov) is not None and found.exponent is not None:
            half = 0.5 * (found.high - found.low)
            words = rf"{found.diagnosis}, $\lambda_1 = {found.exponent:.1f} \pm {half:.1f}$ s$^{{-1}}$"
        _note(axis, words)

    return [Panel(title, partial(draw, panel=panel), 1.7, beside=draw is not slip, close=draw is section, named=False)
            for panel in data.panels
            for slip in [partial(line, name="slip_speed", label=SLIP, colour=style.BLUE, rows=speeds)]
            for title, draw in ((panel.label, slip), ("", partial(
                line, name="plate_angle", label=ANGLE, colour=style.GREEN, rows=angles)), ("", section))]


def span_of(rows: Sequence[Any]) -> tuple[float, float]:
    """Return limits of an axis around some numbers or arrays."""
    low, high = (of(np.hstack(rows or [0.0])) for of in (np.nanmin, np.nanmax))
    return style.widened((float(low - 0.06 * (high - low)), float(high + 0.06 * (high - low))))


def _note(axis: Any, words: str) -> None:
    """Write words above the right end of the axes."""
    axis.set_title(words, loc="right", fontweight="normal", fontsize=7.0)


def _torque_axis(axis: Any, colour: str, label: str) -> Any:
    other = axis.twinx()
    other.grid(False)
    other.spines["right"].set_visible(True)
    other.tick_params(colors=colour)
    other.set_ylabel(label, color=colour)
    return other


def delay_panels(data: Record) -> list[Panel]:
    """Return Fig. 9: slip speed with positive slip shaded, and the engine torque above it."""
    def draw(axis: Any, panel: Record) -> None:
        t, v, share = panel.t, panel.slip_speed, panel.first_half
        axis.fill_between(t, 0.0, np.where(panel.state == 1, v, 0.0), color=style.STICK, linewidth=0.0)
        axis.plot(t, v, color=style.BLUE)
        axis.set(xlim=(t[0], t[-1]), xlabel=CYCLES)
        axis.set_ylabel(SLIP, color=style.BLUE)
        other = _torque_axis(axis, style.ORANGE, r"$T_e$ (N m)")
        other.plot(t, panel.engine_torque, color=style.ORANGE, linewidth=0.9, linestyle=(0, (4, 2)))
        _note(axis, f"{100.0 * share:.0f} % in first half cycle" if share is not None else "no positive slip")

    return [Panel(panel.label, partial(draw, panel=panel), 2.0, beside=k % 2 == 1, over=k > 1, named=False)
            for k, panel in enumerate(data.panels)]


def actuation_panels(data: Record) -> list[Panel]:
    """Return Fig. 12: slip speed, engine and saturation torque, with the start of every engine cycle, and the
    stability of the periodic orbit if it was followed.
    """
    def draw(axis: Any, panel: Record) -> None:
        t, orbit = panel.t, panel.orbit
        axis.plot(t, panel.slip_speed, color=style.BLUE)
        axis.set(xlabel=CYCLES, ylabel=SLIP, xlim=(t[0], t[-1]), xticks=np.arange(0, int(t[-1]) + 1),
                 ylim=span_of([row.slip_speed for row in data.panels]))
        words = f"period {panel.period}" if panel.period else "no period up to 16"
        if orbit is not None:
            size = max(float(np.hypot(*m)) for m in orbit["multipliers"])
            words += f", {'stable' if orbit['stable'] else 'unstable'}: largest Floquet multiplier {size:.3g}"
        _note(axis, words)
        other = _torque_axis(axis, style.GREY, r"$T_s$, $T_e$ (N m)")
        other.plot(t, panel.saturation_torque, color=style.GREY, linewidth=0.9, linestyle=(0, (4, 2)))
        other.plot(t, panel.engine_torque, color=style.ORANGE, linewidth=0.8, linestyle=(0, (1, 1.5)))
        axis.set_zorder(other.get_zorder() + 1)
        axis.patch.set_visible(False)

    return [Panel(panel.label, partial(draw, panel=panel), 1.5, over=k > 0, named=False)
            for k, panel in enumerate(data.panels)]


def solver_panels(data: Record) -> list[Panel]:
    """Return Fig. 2: slip speed by every solver from one state, their divergence, and steady motions from (13)."""
    period, first = data.cycle, data.curves[0]
    leaving = float(first.t[int(np.argmax(first.slip_speed > 1.0))]) * period

    def whole(axis: Any) -> None:
        for curve in data.curves:
            difference = curve.rms_difference
            shown = difference is not None and curve.solver != "smoothed"
            axis.plot(curve.t * period, curve.slip_speed, **LOOKS[curve.solver],
                      label=curve.label + (f" ({difference:.1e})" if shown else ""))
        axis.set(ylabel=SLIP, xlabel="time (s)", xlim=(0.0, first.t[-1] * period))

    def close(axis: Any) -> None:
        whole(axis)
        axis.set(xlim=(leaving - 0.06 * period, leaving + 0.03 * period), ylim=(-0.6, 4.0))
        axis.locator_params(axis="x", nbins=6)

    def steady(axis: Any) -> None:
        for row, look in zip(data.steady, LOOKS_OF_LAWS):
            axis.plot(row.t, row.slip_speed, **look,
                      label=f"{row.label}: period {row.period}, {speed(row.max_slip_speed, 4)}")
        axis.set(ylabel=SLIP, xlabel=CYCLES, xlim=(0.0, data.steady[0].t[-1]))

    return [Panel("from one state (rms difference from the first curve, relative to its maximum)", whole, 2.2),
            Panel("leaving stick", close, 2.0, named=False),
            Panel(f"steady state of each law from (13), after {data.steady_cycles} cycles", steady, 2.0)]


def law_panels(data: Record) -> list[Panel]:
    """Return Fig. 3: law, zoom, slope."""
    v, close, curves = data.slip_speed, data.near_slip_speed, list(zip(style.CYCLE, data.curves))

    def wide(axis: Any) -> None:
        for colour, curve in curves:
            axis.plot(v, curve.coefficient, color=colour, label=curve.label)

    def near(axis: Any) -> None:
        for colour, curve in curves:
            axis.plot(close, curve.near_coefficient, color=colour)
            axis.plot(close, curve.near_set_valued, color=colour, **SET_VALUED)
            if curve.peak_slip_speed is not None:
                axis.plot(curve.peak_slip_speed, curve.peak, marker="o", markersize=3.0, color=colour)
        style.key(axis, "set-valued law (6)", color=style.GREY, **SET_VALUED)
        if any(curve.peak_slip_speed is not None for _, curve in curves):
            style.key(axis, "maximum of (7)", color=style.GREY, linestyle="none", marker="o")
        axis.set_ylim(0.6, 1.6)

    def slope(axis: Any) -> None:
        for colour, curve in curves:
            axis.plot(close, curve.near_slope, color=colour)
        axis.set_ylim(-1.5, 1.5)
        axis.axhline(0.0, color=style.GREY, linewidth=0.6)

    def named(axis: Any, draw: Callable[[Any], None], label: str) -> None:
        draw(axis)
        axis.set(xlabel=SLIP, ylabel=label)
        axis.margins(x=0.0)
        if (named := style.entries(axis))[0]:
            axis.legend(*named, loc="lower right", fontsize=6.5)

    return [Panel(title, partial(named, draw=draw, label=label), 2.5, beside=draw is not wide, named=False)
            for title, draw, label in (("smoothed law (7)", wide, r"$\bar\mu$"), ("zoom", near, r"$\bar\mu$"),
                                       ("slope (20b)", slope, r"$\partial\bar\mu/\partial\dot\delta_1$ (s/rad)"))]


KINDS: dict[str, Callable[[Record], list[Panel]]] = {
    "map": map_panels, "damping": damping_panels, "orbit": orbit_panels, "law": law_panels,
    "histories": history_panels, "delay": delay_panels, "actuation": actuation_panels, "solvers": solver_panels}
"""Panels of each kind of figure."""


def draw_figure(path: Path, data: Record, title: str = "", width: float = style.PAGE) -> Path:
    """Draw one figure from its JSON, with number and title of the figure as its default title, as `compose` writes
    pictures. In a column (`width`, inch) panels are below each other.
    """
    for part in (data, *(data.curves or ()), *(data.panels or ()), *(data.steady or ())):
        vars(part).update({name: numbers(part[name]) for name in SAMPLES if isinstance(getattr(part, name), list)})
    extra = [] if data.law == "smoothed" or data.kind in ("law", "solvers") else ["set-valued law"]
    if data.kind in ("map", "damping"):
        directions = {curve.direction for curve in data.curves}
        extra += [DIRECTIONS[d][0] for d in sorted(directions)] if directions != {"cold"} else []
    wide, note = style.wide(width), f" ({', '.join(extra)})" if extra else ""
    words = title or f"Fig. {data.figure}. {FIGURES[data.figure].title}{note}"
    parts = data.caption.replace("\n", " ").split("; ")
    if data.kind in SWEPT:
        most = max(len(points or ()) for curve in data.curves for points in curve.theta2)
        parts += [f"{data.cycles} periods of excitation, the first {data.discarded} dropped",
                  rf"$\delta_2$ at $t = 2\pi n/\omega$ over the last {most}"]
    return compose(path, KINDS[data.kind](data), words if wide else _wrapped(words, TITLE), width,
                   caption=_wrapped("; ".join(parts), WIDEST if wide else NARROW), formulas=not title)


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
    options = FigureOptions(quick, direction, law, jobs, branches=branches)
    check_options(figure, options)
    data = figure_data(FIGURES[figure], options)
    if out is not None:
        Path(out).mkdir(parents=True, exist_ok=True)
        draw_figure(Path(out) / f"fig{figure:02d}", Record.of(json_of(data)))
    return data


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
