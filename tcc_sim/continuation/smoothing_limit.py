"""What becomes of a bifurcation of the smoothed law as the smoothing factor grows: one that stays, or one of the
smoothing.

It is followed in 1/sigma, about which everything is smooth, from the scene's sigma towards 0. What reaches the end is
solved with the set-valued law where that has the same bifurcation there, and extrapolated along the curve elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tcc_sim.continuation.augmented import MinimallyAugmented, locate
from tcc_sim.continuation.follow_curve import CurveStep, follow_curve
from tcc_sim.continuation.palc import StepSize, corrector
from tcc_sim.continuation.problem import FAILURES, Floats, ParameterMap
from tcc_sim.continuation.shooting import ParameterRange, Shooting
from tcc_sim.continuation.special_points import Bifurcation
from tcc_sim.continuation.stopping import StopReason

SMOOTHEST = 1e-3
"""Smoothing of the scene over that at which the curve ends; the limit is extrapolated from there, and from two and four
times as much."""
FARTHEST = 100.0
"""How far the parameter may go, in widths of its range: the limit of a bifurcation within it may lie outside."""
STUCK = 1e-3
"""Slip speed, in natural sizes, at which a smoothed motion on the section is one in stick."""
SOLVED = 1e-9
"""Error, relative to the range, of what Newton's method has solved."""
SAME_ONE = 20.0
"""Errors of an extrapolation within which a bifurcation of the set-valued law is its limit."""
LEAST_GAIN = 0.1
"""Part of what an extrapolation adds that its error is at least: terms in log(sigma)/sigma make them slow."""


@dataclass(frozen=True)
class Limit:
    """The value of the parameter as sigma goes to infinity.

    value, error : and how exact it is; both None where there is none, or none was found
    why : empty; or that the bifurcation is one of the smoothing, or why its limit was not found
    """

    value: float | None
    error: float | None = None
    why: str = ""

    def as_json(self) -> dict[str, Any]:
        """The keys of an entry of `bifurcations`."""
        return {"limit": self.value, "limit_error": self.error, "limit_why": self.why}

    def __str__(self) -> str:
        """In words, no more digits than the error allows."""
        if self.value is None or self.error is None:
            return self.why
        digits = max(0, min(12, 1 - int(np.floor(np.log10(max(self.error, 1e-12))))))
        return f"limit {self.value:.{digits}f} +- {self.error:.1g}"


def limit_of(found: Bifurcation, smoothed: ParameterMap, set_valued: ParameterMap, span: ParameterRange,
             sigma: float) -> Limit:
    """The limit of a bifurcation of the smoothed law.

    Parameters
    ----------
    smoothed : the map with the parameter and friction.smoothing free
    set_valued : the map with the set-valued law and the parameter free
    span : range of the parameter
    sigma : the scene's smoothing factor, s/rad
    """
    ranges = span, ParameterRange(sigma, np.inf, inverse=True, name="friction.smoothing")
    shooting, orbit = replace(found.point.shooting, map=smoothed, ranges=ranges), found.point.orbit
    steps: list[CurveStep] = []
    try:
        shooting, z = shooting.cut(shooting.unknowns(orbit.nodes, (orbit.values[0], sigma)))
        equations, n = MinimallyAugmented(found.kind, shooting, z), shooting.size
        extra = len(equations.start) - n - 1
        bounds = (n + 1, SMOOTHEST, 1.0), (n, -FARTHEST, FARTHEST)
        stream = follow_curve(equations, equations.start, False, bounds, StepSize(shooting.settings, 0.02, 1e-7))
        while True:
            steps.append(next(stream))
    except StopIteration as stopped:
        reason, bound = stopped.value
    except FAILURES:
        return Limit(None, why="not found: the curve of the bifurcation over the smoothing cannot be set up")
    smoothness = [float(step.solution.z[-extra]) for step in steps]
    most = f"sigma = {ranges[1].value(min(smoothness)):.6g}"
    if reason is StopReason.SPECIAL or (reason is StopReason.RANGE and bound == 0 and smoothness[-1] > 0.5):
        return Limit(None, why=f"of the smoothing: there is none beyond {most}")
    if reason is StopReason.RANGE and bound == 1:
        return Limit(None, why=f"of the smoothing: it is {FARTHEST:g} ranges away at {most}")
    if reason is not StopReason.RANGE:
        return Limit(None, why=f"not found: the curve of the bifurcation was lost at {most}")
    return _at_infinity(found.kind, steps[-1], set_valued, span, extra)


def _at_infinity(kind: str, last: CurveStep, set_valued: ParameterMap, span: ParameterRange, extra: int) -> Limit:
    """The limit of a curve that reaches the smoothest scene."""
    assert isinstance(last.equations, MinimallyAugmented)
    shooting, solution = last.equations.shooting, last.solution
    row, tangent = np.zeros(len(solution.z)), solution.tangent
    row[-extra] = 1.0
    unknowns = [solution.z]
    for times in (2.0, 4.0):
        away = (times - 1.0) * SMOOTHEST / float(tangent[-extra])
        got = corrector(last.equations, solution.z + away * tangent, row)
        if got is None:
            return Limit(None, why="not found: the curve of the bifurcation was lost where its limit is extrapolated")
        unknowns.append(got.z)
    z, errors = _extrapolated(unknowns)
    limit, width = span.value(float(z[shooting.size])), span.high - span.low
    error = max(float(errors[shooting.size]), SOLVED) * width
    start = z[:shooting.size + 1].copy()
    slips = start[:shooting.size:shooting.map.dimension]
    if set_valued.piecewise:
        slips[np.abs(slips) < STUCK] = 0.0
    for equations in (replace(shooting, map=set_valued, ranges=(span,)),
                      Shooting.single(set_valued, shooting.period, span, settings=shooting.settings)):
        solved = locate(kind, equations, np.append(start[:equations.size], start[-1]))
        exact = np.inf if solved is None else span.value(float(solved[-1]))
        if abs(exact - limit) <= SAME_ONE * error:
            return Limit(exact, SOLVED * width)
    return Limit(limit, error)


def _extrapolated(values: list[Floats]) -> tuple[Floats, Floats]:
    """The limits of values at s, 2 s, 4 s, and their errors."""
    one, two, four = values
    linear, coarser = 2.0 * one - two, 2.0 * two - four
    out = (4.0 * linear - coarser) / 3.0
    return out, np.maximum(np.abs(out - linear), LEAST_GAIN * np.abs(out - one))
