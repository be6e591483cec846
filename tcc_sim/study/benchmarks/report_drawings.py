"""Pictures of both reports: error against run time; error charts over step and a key, and errors on extreme scenes."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tcc_sim.study.benchmarks.peers import SINGLE
from tcc_sim.study.benchmarks.precision import FROM_START
from tcc_sim.views import style
from tcc_sim.views.stored import Record
from tcc_sim.views.sweeps import edges, numbers

if TYPE_CHECKING:
    from tcc_sim.study.benchmarks.precision import StudiedScene
    from tcc_sim.study.benchmarks.stability import ErrorChart, Examined

Look = tuple[str, str, Any, float]
LOOKS: dict[str, Look] = {
    "smoothed": (style.BLUE, "o", "-", 1.8), "event_driven": (style.RED, "D", "-", 1.8),
    "fixed_step": (style.GREEN, "s", "-", 1.8),
    "rk4": (style.GREY, "x", ":", 0.9), "rk45": (style.ORANGE, "^", "-", 1.1), "dop853": ("#8A8A00", "v", ":", 0.9),
    "radau": (style.PURPLE, "^", "--", 0.9), "bdf": (style.SKY, "v", "--", 0.9), "lsoda": (style.INK, "<", "--", 0.9),
    "solve_ivp LSODA": ("#E7298A", ">", ":", 0.9), "numbalsoda": ("#1B9E77", "p", ":", 0.9),
    "XPPAUT cvode": ("#7A4B00", "*", "-.", 1.1),
    "XPPAUT stiff": ("#C49A6C", "X", "-.", 0.9), "XPPAUT gear": ("#1F7A6D", "P", "-.", 0.9),
    "XPPAUT 2rb": ("#1B3A6F", "d", "-.", 0.9), "CVODE": ("#00A08A", "X", "-", 1.1)}
"""Colour, marker, line and width of every solver; the package's own are prominent, and all combinations differ."""
GROUPS = {"this package": ("smoothed", "event_driven", "fixed_step"), "explicit methods": ("rk4", "rk45", "dop853"),
          "implicit methods": ("radau", "bdf", "lsoda", "solve_ivp LSODA"),
          "other programs": ("numbalsoda", "CVODE", "XPPAUT cvode", "XPPAUT stiff", "XPPAUT gear", "XPPAUT 2rb")}
"""Groups of solvers that share a panel; the engines of this package are in every panel."""
SPARE = [(colour, marker, (0, (3, 1, 1, 1)), 0.9) for colour, marker in zip(style.MANY, "8H|_1234+,.")]
"""Looks for solvers without a row in LOOKS."""
SET_VALUED = ", set-valued"
FADED = 0.2
"""Opacity of errors below the floor of the references."""
KEYS = {"friction.smoothing": "$\\sigma$ (s/rad)", "friction.kinetic_coefficient": "$\\mu_s/\\mu_k$",
        "pressure.mean": "$P_m$ (Pa)"}
METHODS = {"SDIRK3, one step": "SDIRK3, no sub-steps"}
SETTINGS = {"fixed_step": "tick (s)", "smoothed": "tolerance", "event_driven": "tolerance"}
ENGINES = {"smoothed": (style.BLUE, "o"), "event_driven": (style.RED, "D"), "fixed_step": (style.GREEN, "s")}
LOWEST = -9.0
"""Powers of ten at the ends of the colour scale."""


def draw_precision(stem: Path, scenes: Sequence[StudiedScene], title: str = "", width: float = style.PAGE) -> None:
    """Draw the largest of three errors over run time as `stem`.png and `stem`.svg.

    On a page there is a column per scene and a row per group of solvers; in a column each scene has two rows of two
    groups. Set-valued runs are in the panel of their scene.
    """
    wide, names = style.wide(width), list(dict.fromkeys(record.scene.removesuffix(SET_VALUED) for record in scenes))
    rows = [[([r for r in scenes if r.scene.removesuffix(SET_VALUED) == name], group) for name in names]
            for group in GROUPS]
    if not wide:
        rows = [[rows[k + side][n] for side in range(2)] for n in range(len(names)) for k in (0, 2)]
    with style.figure(width, (1.75 if wide else 1.0) * len(rows) + (1.4 if wide else 1.5), title) as drawn:
        axes = drawn.subplots(len(rows), len(rows[0]), sharex=True, sharey=True, squeeze=False)
        handles: dict[str, Any] = {}
        letters = iter("abcdefghijklmnopqrstuvwxyz")
        for number, (line, panels) in enumerate(zip(axes, rows)):
            for axis, (records, group) in zip(line, panels):
                for record in records:
                    _draw_curves(axis, record, handles, (*GROUPS[group], *ENGINES))
                    law, colour = ("(7)", style.GREY) if record.law == "smoothed" else ("(6)", style.RED)
                    handles[f"reference floor, law {law}"] = axis.axhline(
                        record.reference.floor, color=colour, linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=1)
                axis.set(xscale="log", yscale="log", ylim=(1e-15, 2.0))
                axis.set_yticks([1e-12, 1e-8, 1e-4, 1.0])
                if wide and not number:
                    scene, start, _ = records[0].scene.partition(FROM_START)
                    axis.set_title(f"({next(letters)}) {scene}", pad=34.0)
                    axis.text(0.0, 1.03, _wrapped("; ".join(filter(None, (start.strip(), records[0].description)))),
                              transform=axis.transAxes, fontsize=6.5, va="bottom")
                elif not wide:
                    axis.set_title(f"({next(letters)}) {group}", fontsize=6.5, pad=3.0)
            line[0].set_ylabel(panels[0][1] if wide else f"error, {panels[0][0][0].scene}", fontsize=7.0)
        for axis in axes[-1]:
            axis.set_xlabel("run time (s)")
        if wide:
            drawn.supylabel("relative error", fontsize=8.0)
        order = [n for n in LOOKS if n in handles] + [n for n in handles if n not in LOOKS]
        drawn.legend([handles[n] for n in order], order, loc="outside lower center", ncols=5 if wide else 3,
                     fontsize=7.0 if wide else 6.0)
        style.save_both(drawn, stem)


def looks_of(names: list[str]) -> dict[str, Look]:
    """Return a different look for each solver; a solver without a row in LOOKS gets a spare one."""
    unknown = [name for name in names if name not in LOOKS]
    return {name: LOOKS[name] if name in LOOKS else SPARE[unknown.index(name) % len(SPARE)] for name in names}


def _draw_curves(axis: Any, record: StudiedScene, handles: dict[str, Any], shown: Sequence[str]) -> None:
    """Draw the results of some solvers in one panel; errors below the floor, or an output's precision, are faded."""
    for name, look in looks_of(list(dict.fromkeys(row.solver for row in record.results))).items():
        if name not in shown and name in LOOKS:
            continue
        rows = [row for row in record.results if row.solver == name]
        colour, marker, line, width = look
        seconds, errors = [row.seconds for row in rows], np.array([max(row.largest_error, 1e-16) for row in rows])
        floor = max(record.reference.floor, SINGLE if name.startswith("XPPAUT") else 0.0)
        drawn = {"color": colour, "marker": marker, "linestyle": line, "linewidth": width, "markersize": 3.0}
        axis.plot(seconds, errors, alpha=FADED, zorder=2, **drawn)
        handles[name], = axis.plot(seconds, np.where(errors >= floor, errors, np.nan), zorder=3, **drawn)


def _wrapped(text: str) -> str:
    """Return a description broken to the width of a panel."""
    lines = "\n".join(textwrap.wrap(text.replace(" N m", "\u00a0N\u00a0m"), 27))
    for plain, symbol in (("mu_s/mu_k", "$\\mu_s/\\mu_k$"), ("mu_k = mu_s", "$\\mu_k = \\mu_s$"),
                          ("sigma", "$\\sigma$"), ("Tm", "$T_m$"), ("Tp", "$T_p$")):
        lines = lines.replace(plain, symbol)
    return lines


def draw_stability(stem: Path, charts: Sequence[ErrorChart], cases: Sequence[Examined], title: str = "",
                   width: float = style.PAGE) -> None:
    """Draw error charts and the errors of extreme scenes as `stem`.png and `stem`.svg.

    On a page there is a row of charts per method and a column per key; in a column the charts lie two in a row.
    """
    wide = style.wide(width)
    methods, keys = (list(dict.fromkeys(getattr(c, name) for c in charts)) for name in ("method", "over"))
    charts = sorted(charts, key=lambda c: methods.index(c.method))
    columns = max(len(keys), 1) if wide else 2
    places = [(methods.index(c.method), keys.index(c.over)) if wide else divmod(k, 2) for k, c in enumerate(charts)]
    count = 1 + max((row for row, _ in places), default=0)
    each = 1.5 if wide else 1.0
    with style.figure(width, each * count + (3.2 if wide else 2.9), title) as drawn:
        upper, lower = drawn.subfigures(2, 1, height_ratios=(each * count + 0.7, 2.5 if wide else 2.2))
        axes = upper.subplots(count, columns, squeeze=False, sharex="row" if wide else False)
        for axis in axes.flat:
            axis.set_axis_off()
        shade: Any = None
        lines: dict[str, Any] = {}
        letters = iter("abcdefghijklmnopqrstuvwxyz")
        small = 7.0 if wide else 6.0
        for place, chart in zip(places, charts):
            axis = axes[place]
            axis.set_axis_on()
            shade = _chart(axis, chart, lines)
            axis.set_title(f"({next(letters)}) {METHODS.get(chart.method, chart.method)}", fontsize=small)
            axis.set_xlabel(SETTINGS.get(chart.method, "step (s)"), fontsize=small, labelpad=1.0)
            axis.set_ylabel(KEYS.get(chart.over, chart.over), fontsize=small)
        if shade is not None:
            bar = upper.colorbar(shade, ax=axes, shrink=0.7, pad=0.01, extend="min", aspect=40,
                                 **({} if wide else {"location": "top"}))
            bar.set_label("log10 of the section's relative error; grey: " + ("" if wide else "\n")
                          + "not finite or refused", fontsize=small)
            if lines:
                upper.legend(lines.values(), lines.keys(), loc="outside lower center", ncols=2 if wide else 1,
                             handlelength=3.0, fontsize=small)
        panels = lower.subplots(1, 2, sharey=False)
        for panel, key, name in zip(panels, ("error", "power_residual"), ("error", "power balance")):
            _sorted(panel, cases, key, "relative error" if key == "error" else "residual")
            panel.set_title(f"({next(letters)}) {'extreme scenes: ' if wide else ''}{name}", fontsize=small)
            panel.set_xlabel("share of the cases, smallest first (%)" if wide else "share of the cases (%)")
        named = {name: handle for panel in panels for handle, name in zip(*style.entries(panel))}
        if named:
            lower.legend(named.values(), named.keys(), loc="outside lower center", ncols=3)
        style.save_both(drawn, stem)


def _chart(axis: Any, chart: ErrorChart, lines: dict[str, Any]) -> Any:
    """Draw a map of log10 of the error over step and value, with the limits."""
    steps = np.array(chart.steps)
    ratio = chart.over == "friction.kinetic_coefficient"
    values = 0.3 / np.array(chart.values) if ratio else np.array(chart.values)
    borders = edges(values) if ratio else np.exp(edges(np.log(values)))
    with np.errstate(all="ignore"):
        errors = np.array([numbers(row) for row in chart.errors])
        level = np.clip(np.log10(np.maximum(errors, 1e-30)), LOWEST, 0.0)
    axis.set_facecolor("#9A9A9A")
    shade = axis.pcolormesh(np.exp(edges(np.log(steps))), borders, np.ma.masked_invalid(level),
                            cmap="viridis_r", vmin=LOWEST, vmax=0.0, rasterized=True)
    axis.grid(False)
    axis.set_xscale("log")
    if not ratio:
        axis.set_yscale("log")
    limits = {"2.785/($\\beta T_s r \\sigma$), rk4 stable to its left": (chart.limits["rk4"], style.RED, "-"),
              "1/($\\beta T_s |\\bar\\mu'_{min}|$), one root to its left": (chart.limits["uniqueness"], "white",
                                                                            (0, (4, 2)))}
    bounds = axis.get_xlim(), axis.get_ylim()
    for name, (limit, colour, dashes) in limits.items():
        if chart.method != "rk4" and (colour == style.RED or SETTINGS.get(chart.method) == "tolerance"):
            continue
        at = numbers(limit)
        outline, = axis.plot(at, values, color=style.INK, linewidth=2.4,
                             linestyle="-" if colour == style.RED else dashes)
        line, = axis.plot(at, values, color=colour, linewidth=1.4, linestyle=dashes)
        if np.any((at >= min(bounds[0])) & (at <= max(bounds[0]))):
            lines[name] = (outline, line)
    axis.set(xlim=bounds[0], ylim=bounds[1])
    return shade


def _sorted(axis: Any, cases: Sequence[Examined], key: str, name: str) -> None:
    """Draw every engine's values in rising order over the share of its cases."""
    for engine, (colour, marker) in ENGINES.items():
        values = np.sort([x for c in cases if c.solver == engine and (x := getattr(c, key)) is not None])
        if len(values):
            share = 100.0 * (np.arange(len(values)) + 0.5) / len(values)
            axis.plot(share, np.maximum(values, 1e-17), color=colour, marker=marker, markersize=2.0, linewidth=0.8,
                      label=engine)
    axis.set(yscale="log", ylabel=name)


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
