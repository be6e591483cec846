"""stability.png: error charts of the fixed-step methods, and the errors of every engine on the extreme scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.views import style
from tcc_sim.views.sweeps import edges, numbers

LABELS = {"friction.smoothing": "smoothing $\\sigma$ (s/rad)", "friction.kinetic_coefficient": "$\\mu_s/\\mu_k$",
          "pressure.mean": "mean pressure (Pa)"}
NAMES = {"fixed_step": "fixed_step, own sub-steps", "SDIRK3, one step": "SDIRK3 alone, no sub-steps", "rk4": "rk4"}
ENGINES = {"smoothed": (style.BLUE, "o"), "event_driven": (style.RED, "D"), "fixed_step": (style.GREEN, "s")}
LOWEST = -9.0
"""Colours end at this power of ten."""


def stability(stem: Path, charts: list[dict[str, Any]], cases: list[dict[str, Any]]) -> tuple[Path, Path]:
    """Draw `stem`.png and `stem`.svg."""
    keys, methods = list(dict.fromkeys(c["over"] for c in charts)), list(dict.fromkeys(c["method"] for c in charts))
    with style.figure(9.0, 2.5 * len(methods) + 3.4) as drawn:
        upper, lower = drawn.subfigures(2, 1, height_ratios=(2.5 * len(methods) + 0.4, 3.0))
        axes = upper.subplots(len(methods), max(len(keys), 1), squeeze=False, sharex="row")
        shade: Any = None
        lines: dict[str, Any] = {}
        letters = iter("abcdefghijklmnop")
        for row, method in zip(axes, methods):
            for axis, key in zip(row, keys):
                chart = next(c for c in charts if c["over"] == key and c["method"] == method)
                shade = _chart(axis, chart, lines)
                axis.set_title(f"({next(letters)}) {NAMES.get(method, method)}")
                axis.set(xlabel="tick (s)" if method == "fixed_step" else "step (s)", ylabel=LABELS.get(key, key))
        if shade is not None:
            bar = upper.colorbar(shade, ax=axes, shrink=0.7, pad=0.01, extend="min")
            bar.set_label("log10 of the relative section error; grey: not finite or refused")
            upper.legend(lines.values(), lines.keys(), loc="outside lower center", ncols=3, handlelength=3.0)
        panels = lower.subplots(1, 2, sharey=False)
        _sorted(panels[0], cases, "error", "relative error")
        _sorted(panels[1], cases, "power_residual", "power balance residual")
        for panel, name in zip(panels, ("Extreme scenes: error", "Extreme scenes: power balance")):
            panel.set_title(f"({next(letters)}) {name}")
        style_handles, labels = panels[0].get_legend_handles_labels()
        lower.legend(style_handles, labels, loc="outside lower center", ncols=3)
        return style.save_both(drawn, stem)


def _chart(axis: Any, chart: dict[str, Any], lines: dict[str, Any]) -> Any:
    """One map of log10 of the error over step and value, with the limits."""
    steps = np.array(chart["steps"])
    ratio = chart["over"] == "friction.kinetic_coefficient"
    values = 0.3 / np.array(chart["values"]) if ratio else np.array(chart["values"])
    borders = edges(values) if ratio else np.exp(edges(np.log(values)))
    with np.errstate(all="ignore"):
        found = np.array([numbers(row) for row in chart["errors"]])
        level = np.clip(np.log10(np.maximum(found, 1e-30)), LOWEST, 0.0)
    axis.set_facecolor("#9A9A9A")
    shade = axis.pcolormesh(np.exp(edges(np.log(steps))), borders, np.ma.masked_invalid(level),
                            cmap="viridis_r", vmin=LOWEST, vmax=0.0, rasterized=True)
    axis.grid(False)
    axis.set_xscale("log")
    if not ratio:
        axis.set_yscale("log")
    limits = {"2.785/($\\beta T_s r \\sigma$), rk4 stable to its left": (chart["limits"]["rk4"], style.RED, "-"),
              "1/($\\beta T_s |\\bar\\mu'_{min}|$), one root to its left": (chart["limits"]["uniqueness"], "white",
                                                                            (0, (4, 2)))}
    bounds = axis.get_xlim(), axis.get_ylim()
    for name, (limit, colour, dashes) in limits.items():
        if chart["method"] != "rk4" and colour == style.RED:
            continue
        at = numbers(limit)
        outline, = axis.plot(at, values, color=style.INK, linewidth=2.4,
                             linestyle="-" if colour == style.RED else dashes)
        line, = axis.plot(at, values, color=colour, linewidth=1.4, linestyle=dashes)
        lines[name] = (outline, line)
    axis.set(xlim=bounds[0], ylim=bounds[1])
    return shade


def _sorted(axis: Any, cases: list[dict[str, Any]], key: str, name: str) -> None:
    """Every engine's values in rising order over the share of its cases."""
    for engine, (colour, marker) in ENGINES.items():
        values = np.sort([c[key] for c in cases if c["solver"] == engine and c[key] is not None])
        if len(values):
            share = 100.0 * (np.arange(len(values)) + 0.5) / len(values)
            axis.plot(share, np.maximum(values, 1e-17), color=colour, marker=marker, markersize=2.0, linewidth=0.8,
                      label=engine)
    axis.set(yscale="log", xlabel="share of the cases, smallest first (%)", ylabel=name)
