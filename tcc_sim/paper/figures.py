"""The numbers of the paper's figures: a row of `paper.FIGURES` -> JSON values, which `paper.drawings` draws."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model import friction
from tcc_sim.model.parameters import System, values_of
from tcc_sim.paper import settled_histories
from tcc_sim.paper.catalogue import CHARTS, FIGURES, OMEGA_N, STATIC, PaperFigure, Series, figure_row, paper_system
from tcc_sim.paper.charts import chart
from tcc_sim.paper.coexistence import coexisting
from tcc_sim.paper.figure_branches import motions_behind, motions_behind_each
from tcc_sim.paper.figure_options import QUICK_SHARE, FigureOptions, system_of
from tcc_sim.solvers.terms import terms_of
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep, sweep_curves

SECTION_POINTS = 40
"""Points of the section in an orbit diagram at every value."""


def figure_data(number: int, options: FigureOptions) -> dict[str, Any]:
    """The numbers of one figure as JSON values.

    Raises
    ------
    InputError
        A figure that the paper does not have, or one without numbers.
    NumericalFailure
        A time history that could not be solved; a failed point of a sweep is a status in the data instead.
    """
    if number not in (*FIGURES, *CHARTS):
        raise InputError(f"figure {number} has no numbers; the figures are {min(FIGURES)} to {max(CHARTS)}")
    row = figure_row(number)
    began = time.perf_counter()
    out: dict[str, Any] = {
        "figure": number, "kind": row.kind, "title": row.title, "caption": row.caption, "law": options.law,
        "quick": options.quick,
        "parameters": {key: value for key, value in values_of(figure_system(number, options))
                       if key not in _varied(row)},
        "marks": list(row.marks), **KINDS[row.kind](row, options)}
    out["seconds"] = time.perf_counter() - began
    return out


def figure_of(task: tuple[int, FigureOptions]) -> dict[str, Any]:
    """`figure_data` of a number and options, as a part of the work of several processes."""
    return figure_data(*task)


def figure_system(number: int, options: FigureOptions) -> System:
    """The system of a figure's first curve; the others and its axis are changes of it."""
    return system_of(figure_row(number).series[0], options)


def _varied(row: PaperFigure) -> set[str]:
    """Keys that differ between the curves or along them."""
    keys = {key for series in row.series for key in series.values} if len(row.series) > 1 else set()
    return keys | ({row.over, row.second} if row.kind in ("map", "damping", "orbit", "chart") else set())


def _axis(row: PaperFigure, options: FigureOptions) -> tuple[str, np.ndarray, float]:
    """Name and values of the normalised axis, and the value of the key at 1."""
    count = (row.count - 1) // QUICK_SHARE + 1 if options.quick else row.count
    ratios = np.linspace(*row.span, count)
    if row.over == "engine.frequency":
        return "omega/omega_n", ratios, OMEGA_N
    return "mu_k/mu_s", ratios, STATIC


def plan_of(options: FigureOptions, direction: str = "cold", *, damping: bool = False) -> Plan:
    """The paper's rule: 50 cycles dropped; 100 kept, 50 where it has to be quick."""
    return Plan(cycles=100 if options.quick else 150, discard=50, direction=options.direction or direction,
                section_points=SECTION_POINTS, damping=damping)


def _curves(row: PaperFigure, options: FigureOptions, plan: Plan) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Every series swept, as JSON values, and what the figure says of the axis."""
    found, axis = _swept(row, options, plan)
    curves = [curve_json(series, sweep) for series, sweep in zip(row.series, found)]
    if row.kind == "map" and plan.direction == "cold":
        for curve, sweep in zip(curves, found):
            curve["coexisting"] = coexisting(sweep, options.jobs)
    if options.branches and row.kind == "map":
        for curve, motions in zip(curves, motions_behind_each(found, options.jobs, options.progress)):
            curve.update(motions)
    return curves, axis


def _swept(row: PaperFigure, options: FigureOptions, plan: Plan) -> tuple[list[Sweep], dict[str, Any]]:
    """The sweep of every series, and what the figure says of the axis."""
    name, ratios, unit = _axis(row, options)
    scaled = np.minimum(ratios * unit, STATIC) if unit == STATIC else ratios * unit
    key_values = tuple(float(x) for x in scaled)
    wanted = [Curve(system_of(s, options), row.over, key_values) for s in row.series]
    missing = [curve for curve in wanted if (curve, plan) not in options.kept]
    if missing:
        for sweep in sweep_curves(missing, plan, jobs=options.jobs, progress=options.progress):
            options.kept[sweep.curve, plan] = sweep
    return [options.kept[curve, plan] for curve in wanted], {"axis": name, "x": ratios.tolist(), "unit": unit,
                                                            "cycles": plan.cycles, "discarded": 50}


def curve_json(series: Series, sweep: Sweep) -> dict[str, Any]:
    """One curve as JSON values."""
    data = sweep.as_json()
    names = ["max_slip_speed", "min_slip_speed", "period", "confirmed", "settled", "runaway", "stick_fraction",
             "regime", "theta2", "equivalent_damping", "negative_slope_mean", "status"]
    return {"label": series.label, "values": dict(series.values), "direction": data["direction"],
            **{name: data[name] for name in names if name in data}}


def _map(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Figs. 4, 8, 10, 11, 13 to 18."""
    curves, axis = _curves(row, options, plan_of(options))
    return {**axis, "curves": curves}


def _damping(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Fig. 5."""
    curves, axis = _curves(row, options, plan_of(options, damping=True))
    return {**axis, "threshold": -paper_system().driveline.damping, "curves": curves}


def _orbit(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Fig. 6: from the initial state, and continued up and down (only one of these where the options say which)."""
    sweeps: list[Sweep] = []
    axis: dict[str, Any] = {}
    for direction in (options.direction,) if options.direction else ("cold", "up", "down"):
        found, axis = _swept(row, options, plan_of(options, direction))
        sweeps += found
    curves = [curve_json(row.series[0], sweep) for sweep in sweeps]
    if options.branches:
        for curve, motions in zip(curves, motions_behind(sweeps, options.progress)):
            curve.update(motions)
    return {**axis, "curves": curves}


def _law(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Fig. 3: the smoothed law, near 0, and its slope; with the set-valued law beside it."""
    curves = []
    v = np.linspace(-2.0, 2.0, 2001)
    near = np.linspace(0.0, 0.2, 801)
    for series in row.series:
        terms = terms_of(paper_system(series.values))
        assert terms.smoothing is not None
        wide, close = (friction.smoothed_and_slope(x, terms.smoothing, terms.stribeck) for x in (v, near))
        peak, height = friction.peak(terms.smoothing, terms.stribeck)
        sliding = friction.sliding(near, 1.0, terms.stribeck) + 0.0 * near
        curves.append({"label": series.label, "values": dict(series.values), "coefficient": wide[0].tolist(),
                       "slope": wide[1].tolist(), "near_coefficient": close[0].tolist(),
                       "near_slope": close[1].tolist(),
                       "near_set_valued": sliding.tolist(), "peak_slip_speed": peak if math.isfinite(peak) else None,
                       "peak": height, "static": 1.0 + (terms.stribeck[0] if terms.stribeck else 0.0)})
    return {"slip_speed": v.tolist(), "near_slip_speed": near.tolist(), "curves": curves}


KINDS: dict[str, Callable[[PaperFigure, FigureOptions], dict[str, Any]]] = {
    "map": _map, "damping": _damping, "orbit": _orbit, "histories": settled_histories.histories,
    "delay": settled_histories.delay, "actuation": settled_histories.actuation, "law": _law,
    "solvers": settled_histories.solvers, "chart": chart}
