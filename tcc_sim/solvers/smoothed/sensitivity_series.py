"""Derivatives of a series step of the smoothed engine, and how long such a step may be; see `sensitivity`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import fast
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.changes import carry_slip, expand_sines
from tcc_sim.solvers.collocation import NODES, TERMS
from tcc_sim.solvers.excitation import Pulsation
from tcc_sim.solvers.series import SLIP, fastest_at
from tcc_sim.solvers.smoothed.series_step import LocalFriction
from tcc_sim.solvers.smoothed.setup import Limits, Step
from tcc_sim.solvers.stages import LAYER, SLIDING, Place
from tcc_sim.solvers.terms import Terms

SHARED = np.dtype([("basis", np.float64, TERMS), ("slip", np.float64, NODES + 1), ("angle", np.float64, NODES),
                   ("speed", np.float64, NODES), ("peak", np.float64), ("extended", np.int64),
                   ("slopes", np.float64, 3), ("fastest", np.float64)])
"""Values that the lanes share: Chebyshev polynomials where a step is evaluated, and what the slip speeds
at its nodes add there to slip speed (that at the start first), plate angle and plate speed + kappa slip speed; the
largest |slip speed| of the cycle so far; the integrals of `sensitivity.add_slopes`, which are the further results of
`engine.Tangent`.
"""
SINE = 0.7
"""Angle of a sine within a series step that resolves it, per `Limits.resolved`, which assumes a decay."""


@fast
def reach_of(limits: Limits, fastest: float) -> float:
    """Return the longest series step, s, that resolves the fastest sine with derivatives by its amplitude."""
    return SINE * limits.resolved / fastest if fastest > 0.0 else math.inf


@fast
def resolved(step: Step, place: Place, friction: LocalFriction, rows: Any, stribeck: Stribeck, control: Any,
             limits: Limits, terms: Terms, drive: Any, fastest: float) -> float:
    """Return the part of a series step over which the series of its derivatives hold too.

    In stick the motion is on its slow manifold, and a step is as long as the creep's series allow; a change of the
    start or of the scene is off it and decays with friction's own rate. Nor does the motion show an exponential or a
    sine of zero amplitude, by which there may be derivatives.
    """
    rate = terms.linear.damping / terms.linear.plate + limits.slip_decay
    if place.region == LAYER:
        rate += limits.beta * drive.load * max(friction.slope, 0.0)
    x = min(step.x, reach_of(limits, fastest) / step.unit)
    if rate > 0.0:
        x = min(x, limits.resolved / (rate * step.unit))
    if stribeck is not None and place.region != SLIDING:
        while fastest_at(stribeck, 0.0) * (abs(rows[SLIP, 1]) + abs(rows[SLIP, 2]) * x) * x > limits.resolved:
            x *= 0.85
    control.unsettled -= rate * step.unit * x
    return x


@fast
def carry_series(tangent: Any, place: Place, friction: LocalFriction, step: Step, loaded: bool, limits: Limits,
                 terms: Terms, waves: Any, drive: Any, rows: Any, pulsation: Pulsation, stribeck: Stribeck) -> None:
    """Fill the coefficients of all derivatives over a series step; the law varies as in `series_step.expand_region`."""
    order, unit, sign, groups, along = step.degree, step.unit, place.sign, tangent.groups, tangent.along
    expand_sines(along.sines, order, unit, waves, pulsation, drive)
    if place.region == LAYER and loaded:
        carry_slip(order, unit, sign, groups, along, rows, terms.linear, pulsation, stribeck, limits.sigma)
    elif place.region == SLIDING or not loaded or stribeck is None:
        carry_slip(order, unit, sign, groups, along, rows, terms.linear, pulsation, None, None)
    else:
        carry_slip(order, unit, sign, groups, along, rows, terms.linear, pulsation, stribeck, None)
