"""What becomes of a bifurcation of the smoothed law as the smoothing factor grows: one that stays, or one of the
smoothing.

It is followed in 1/sigma, about which everything is smooth, from the scene's sigma towards 0. What reaches the end is
predictor along the curve and, where the set-valued law has the same bifurcation there, solved with that law.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tcc_sim.continuation.codim2 import Defining, locate, still_complex, trace
from tcc_sim.continuation.palc import StepSize
from tcc_sim.continuation.problem import FAILURES, ParameterMap
from tcc_sim.continuation.shooting import ParameterRange, Shooting
from tcc_sim.continuation.special_points import Bifurcation

SMOOTHEST = 1e-3
"""Smoothing of the scene over that at which the curve ends."""
FARTHEST = 100.0
"""How far the parameter may go, in widths of its range: the limit of a bifurcation within it may lie outside."""
STUCK = 1e-3
"""Slip speed, in natural sizes, at which a smoothed motion on the section is one in stick."""
NEAR = 0.02
"""Distance of the set-valued bifurcation from the predictor one, relative to the range, at which they are the
same.
"""


def limit_of(found: Bifurcation, smoothed: ParameterMap, set_valued: ParameterMap, span: ParameterRange,
             sigma: float) -> float | None:
    """The value of the parameter as sigma goes to infinity; None where the bifurcation does not get there.

    Parameters
    ----------
    smoothed : the map with the parameter and friction.smoothing free
    set_valued : the map with the set-valued law and the parameter free
    span : range of the parameter
    sigma : the scene's smoothing factor, s/rad
    """
    orbit = found.point.orbit
    ranges = span, ParameterRange(sigma, np.inf, inverse=True)
    shooting = replace(found.point.shooting, map=smoothed, ranges=ranges)
    z, n = shooting.unknowns(orbit.nodes, (orbit.values[0], sigma)), shooting.size
    inside = still_complex if found.kind == "neimark_sacker" else lambda _: True
    try:
        points, _ = trace(Defining(found.kind, shooting, z), z, False, inside, StepSize(length=0.02, smallest=1e-7),
                          ((n + 1, SMOOTHEST, 1.0), (n, -FARTHEST, FARTHEST)))
    except FAILURES:
        return None
    last = points[-1]
    if last.z[n + 1] > 1.001 * SMOOTHEST:
        return None
    before = points[-2] if len(points) > 1 else last
    step = float(before.z[n + 1] - last.z[n + 1])
    slope = float(before.z[n] - last.z[n]) / step if step > 0.0 else 0.0
    limit = span.value(float(last.z[n]) - slope * float(last.z[n + 1]))
    states = shooting.map.dimension
    start = np.append(last.z[:states], last.z[n])
    if set_valued.piecewise and abs(start[0]) < STUCK:
        start[0] = 0.0
    solved = locate(found.kind, Shooting.single(set_valued, orbit.period, span), start)
    exact = np.inf if solved is None else span.value(float(solved[states]))
    return exact if abs(exact - limit) < NEAR * (span.high - span.low) else limit
