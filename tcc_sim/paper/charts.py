"""Charts that the paper has not: where motions double, fold and stick in a plane of omega and a second key.

Bifurcations are looked for along some rows of a grid of cold starts and followed in both keys; what a curve has passed
already is not followed again.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from tcc_sim.continuation.codim2 import BifurcationCurve, Ranges, bifurcation_curve, border_curve
from tcc_sim.continuation.diagram import SWEPT
from tcc_sim.continuation.driveline import DrivelineMap
from tcc_sim.continuation.problem import Floats
from tcc_sim.continuation.settings import DEFAULTS
from tcc_sim.continuation.shooting import ParameterRange
from tcc_sim.continuation.special_points import Bifurcation, chandrupatla
from tcc_sim.model.parameters import System
from tcc_sim.model.pure_stick import stick_margin
from tcc_sim.paper.catalogue import NORMALISED, QUICK_SHARE, FigureOptions, PaperFigure, series_system
from tcc_sim.paper.figure_results import Chart, ChartCurve
from tcc_sim.paper.seen_motions import creeps, seen_in, surveyed
from tcc_sim.sweeps.simulation import Plan
from tcc_sim.sweeps.sweep import sweep_grid

FOLLOWED = ("fold", "period_doubling")
LONGEST = 2
FEW = replace(SWEPT, longest_period=LONGEST)
"""Longest period, in those of the excitation, whose bifurcations are followed."""
ENDING = 1.001
"""Largest multiplier of a bifurcation at which stable motions begin or end; others are of unstable ones alone."""
PASSED = 4e-3
"""Distance from a curve, in parts of the axes, within which a bifurcation of its kind and period lies on it."""


def chart(row: PaperFigure, options: FigureOptions) -> Chart:
    """Figs. 19 and 20: the grid of cold starts, and the curves."""
    system = series_system(row.series[0], options)
    share = QUICK_SHARE if options.quick else 1
    x, y = (np.linspace(*span, (count - 1) // share + 1)
            for span, count in ((row.span, row.count), (row.second_span, row.second_count)))
    cuts = np.array(row.cuts[::2] if options.quick else row.cuts)
    y = np.unique(np.concatenate([y, cuts]))
    (x_name, x_unit), (y_name, y_unit) = NORMALISED[row.over], NORMALISED[row.second]
    plan = Plan(cycles=100 if options.quick else 150, discard=50)
    grid = sweep_grid(system, row.over, (x * x_unit).tolist(), row.second, (y * y_unit).tolist(), plan,
                      jobs=options.jobs, progress=options.progress)
    ranges = (ParameterRange(row.span[0] * x_unit, row.span[1] * x_unit, name=row.over),
               ParameterRange(row.second_span[0] * y_unit, row.second_span[1] * y_unit, name=row.second))
    curves = stick_borders(system, (row.over, row.second), ranges)
    both = DrivelineMap(system, (row.over, row.second))
    for cut in cuts:
        sweep = grid.sweeps[int(np.argmin(np.abs(y - cut)))]
        for branch in surveyed(sweep.curve, seen_in(sweep), options.progress, FEW):
            for found in branch.bifurcations:
                curve = followed(found, both, ranges, float(cut) * y_unit, curves)
                if curve is not None:
                    curves.append(_charted(curve, found.point.orbit.period, creeps(found, sweep.curve.system)))
    summaries = [[None if p is None else p.summary for p in sweep.points] for sweep in grid.sweeps]
    return Chart(x_name, x.tolist(), x_unit, row.over, y_name, y.tolist(), y_unit, row.second,
                 plan.cycles, 50, curves,
                 period=[[None if s is None else s.period for s in line] for line in summaries],
                 regime=[[None if s is None else "runaway" if s.runaway else s.regime for s in line]
                         for line in summaries])


def followed(found: Bifurcation, of: DrivelineMap, ranges: Ranges, second: float,
              known: list[ChartCurve]) -> BifurcationCurve | None:
    """The curve of a bifurcation; None where it is not of those followed, or lies on a curve that is known."""
    orbit = found.point.orbit
    if found.kind not in FOLLOWED or orbit.period > LONGEST * of.forcing_period or abs(orbit.multipliers[0]) > ENDING:
        return None
    at = np.array([ranges[0].scaled(found.value), ranges[1].scaled(second)])
    for curve in known:
        if (curve.kind, curve.period) == (found.kind, orbit.period) and distance(at, _scaled(curve, ranges)) < PASSED:
            return None
    return bifurcation_curve(found, of, ranges, second, DEFAULTS)


def _scaled(curve: ChartCurve, ranges: Ranges) -> Floats:
    """(n, 2) points of a curve in parts of the axes."""
    return np.array([[ranges[0].scaled(a), ranges[1].scaled(b)] for a, b in zip(curve.value, curve.second)])


def _charted(curve: BifurcationCurve, period: int, creep: bool) -> ChartCurve:
    """A curve as the chart has it."""
    words = f"{curve.kind}, period {period}".replace("_", " ")
    words = "pure stick ends, by (10)" if curve.kind == "stick_border" else words
    return ChartCurve(words, curve.kind, period, creep, curve.values, curve.second, [str(end) for end in curve.ended],
                      [end.reason.name.lower() for end in curve.ended], curve.special)


def distance(at: Floats, line: Floats) -> float:
    """Of a point (2,) from a line through points (n, 2)."""
    if len(line) < 2:
        return float(np.linalg.norm(line - at, axis=1).min(initial=math.inf))
    a, d = line[:-1], np.diff(line, axis=0)
    size = np.maximum((d * d).sum(axis=1), 1e-300)
    part = np.clip(((at - a) * d).sum(axis=1) / size, 0.0, 1.0)
    return float(np.linalg.norm(a + part[:, None] * d - at, axis=1).min())


def stick_borders(system: System, keys: tuple[str, str], ranges: Ranges,
                  count: int = 150) -> list[ChartCurve]:
    """Curves on which pure stick ends by (10), corrected, in the plane of two keys."""
    of = DrivelineMap(system, keys)

    def margin(first: float, second: float) -> float:
        at = of.system_at((first, second))
        return stick_margin(at).torque / (at.friction_ratio * at.saturation_mean)

    out: list[ChartCurve] = []
    for part in (0.0, 0.25, 0.5, 0.75, 1.0):
        second = ranges[1].value(part)
        values = [ranges[0].value(u) for u in np.linspace(0.0, 1.0, count)]
        margins = np.array([margin(v, second) for v in values])
        for k in np.flatnonzero(margins[1:] * margins[:-1] < 0.0):
            root = chandrupatla(partial(margin, second=second), values[k], values[k + 1])
            at = np.array([ranges[0].scaled(root), part])
            if any(distance(at, _scaled(known, ranges)) < PASSED for known in out):
                continue
            curve = border_curve(margin, ranges, root, second)
            if curve is not None:
                out.append(_charted(curve, 1, False))
    return out
