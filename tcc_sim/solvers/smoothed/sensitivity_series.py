"""What changes over a series step of the smoothed engine, coefficient by coefficient; see `sensitivity`.

With Ts mubar'(v) as a series of its own the recurrences of the motion are linear in the changes. These are kept in
lanes, four at a time: those of slip speed, plate angle and plate speed at the start, and those by numbers of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers.collocation import NODES, TERMS
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.compiling.unrolled import unrolled
from tcc_sim.solvers.key_derivatives import NUMBERS
from tcc_sim.solvers.series import (
    ANGLE,
    COLUMNS,
    ENGINE,
    FRICTION_ORDER_MAXIMUM,
    LOAD,
    ORDER_MAXIMUM,
    SLIP,
    SPEED,
    add_sine,
    exponential,
    hyperbolic,
    product,
    total,
)
from tcc_sim.solvers.smoothed.series_step import LocalFriction
from tcc_sim.solvers.smoothed.setup import Limits, Step
from tcc_sim.solvers.stages import LAYER, SLIDING, Place
from tcc_sim.solvers.terms import Terms

LANES = 4

LAW, STIFFNESS_OF_LAW, RISING, FALLEN, TORQUE, LOADED, SCRATCH = range(7)
"""Rows of coefficients: mubar; Ts mubar'; (1 + E) (1 - T^2); F T with E = (r - 1) F; what Te and Ts change by; room."""

ON_FLYWHEEL, ON_CLUTCH, ON_PLATE = range(3)
"""Changes of torque: on the flywheel, of friction, on the plate."""

CHANGES = np.dtype([("now", np.float64, (3, LANES)), ("by", np.float64, (len(NUMBERS), LANES)), ("forced", np.int64),
                    ("rows", np.float64, (3, COLUMNS, LANES)), ("torques", np.float64, (3, COLUMNS, LANES)),
                    ("nodes", np.float64, (LANES, NODES)), ("applied", np.float64, (LANES, NODES)),
                    ("peak", np.float64, LANES)])
"""Four lanes of changes.

now : of slip speed, plate angle, plate speed
by : of the numbers of `key_derivatives`; `forced` has a bit for every lane of a key
rows, torques : over a series step, coefficients of the changes of the state, and of the torques ON_...
nodes, applied : at the nodes of a collocation step, change of slip speed, and torque on flywheel and plate together
peak : of the largest |slip speed| of the cycle
"""

SHARED = np.dtype([("series", np.float64, (7, COLUMNS)), ("basis", np.float64, TERMS), ("slip", np.float64, NODES + 1),
                   ("angle", np.float64, NODES), ("speed", np.float64, NODES), ("peak", np.float64),
                   ("averaged", np.int64), ("slopes", np.float64, 3), ("reach", np.float64)])
"""Room that the lanes share: rows LAW to SCRATCH; Chebyshev polynomials where a step is asked, and what the slip speeds
at its nodes add there to slip speed (that at the start first), plate angle and plate speed + kappa slip speed; the
largest |slip speed| of the cycle so far; whether the integrals of `sensitivity.add_slopes` are asked for, and
they; the longest series step that shows a sine by whose amplitude there are derivatives, s.
"""


class Tangent(NamedTuple):
    """What the kernel carries along: an array of CHANGES (groups,), SHARED, the torque's share in a collocation step
    (`collocation.Response.torque`), and per cycle the change of the largest |slip speed|, (cycles, groups,
    LANES).
    """

    groups: NDArray[Any]
    shared: Any
    torque: NDArray[np.float64]
    peaks: NDArray[np.float64]


def friction_text(rows: Any, parts: Any, decay: Any, factor: Any, excess: Any, sigma: Any, tanh: Any, sech: Any,
                  pulsation: Any) -> Iterator[int]:
    """Coefficients of mubar, Ts mubar' and its parts along a motion, in the rows LAW to FALLEN of `parts`.

    Parameters
    ----------
    rows : coefficients of the motion and of Ts
    decay, factor, excess : rate -alpha sgn(v) and value of F = exp(-alpha |v|), r - 1; None without a Stribeck term
    sigma, tanh, sech : sigma, T = tanh(sigma v), 1 - T^2; sigma is None where T does not vary
    pulsation : None where Ts does not vary
    """
    f, t, s = [factor], [tanh], [sech]
    weighted: list[Any] = [0.0]
    load: list[Any] = []
    slopes: list[Any] = []
    for k in range(FRICTION_ORDER_MAXIMUM):
        if k > 0:
            weighted.append(float(k) * rows[SLIP, k])
            if decay is not None:
                exponential(decay, weighted, f, k)
            if sigma is None:
                t.append(0.0)
            else:
                hyperbolic(sigma, weighted, t, s, k)
        law, fallen, rising = t[k], 0.0, 0.0 if sigma is None else s[k]
        slope: Any = 0.0
        if decay is not None:
            fallen = f[k] * t[0] if sigma is None else product(f, t, k)
            law = law + excess * fallen
            slope = decay * (excess * fallen)
            if sigma is not None:
                rising = rising + excess * product(f, s, k)
        if sigma is not None:
            slope = slope + sigma * rising
        slopes.append(slope)
        load.append(rows[LOAD, k] if k == 0 or pulsation is not None else 0.0)
        parts[LAW, k], parts[FALLEN, k], parts[RISING, k] = law, fallen, rising
        parts[STIFFNESS_OF_LAW, k] = product(load, slopes, k) if pulsation is not None else load[0] * slope
        if k % 2 == 1 and 8 <= k + 1 < FRICTION_ORDER_MAXIMUM:
            yield k + 1


def changes_text(out: Any, parts: Any, torques: Any, unit: Any, linear: Any, forced: Any) -> Iterator[int]:
    """Coefficients of the changes of slip speed, plate angle and plate speed by equations (2), four lanes at once.

    Parameters
    ----------
    out : (3, COLUMNS, LANES) array; coefficient 0 is given
    parts : rows of which STIFFNESS_OF_LAW is used; None where friction does not depend on the slip speed
    torques : (3, COLUMNS, LANES) array, changes of the torques, used where `forced` is not None
    """
    flywheel, plate = unit / linear[0], unit / linear[1]
    v, x, u = [out.row(0, 0)], [out.row(1, 0)], [out.row(2, 0)]
    last = ORDER_MAXIMUM if parts is None else FRICTION_ORDER_MAXIMUM
    for k in range(last):
        friction: Any = 0.0
        if parts is not None:
            friction = total([parts[STIFFNESS_OF_LAW, j] * v[k - j] for j in range(k, -1, -1)])
        pull = linear[2] * u[k] + linear[3] * x[k]
        push: Any = 0.0
        if forced is not None:
            friction = friction + torques.row(ON_CLUTCH, k)
            pull, push = pull - torques.row(ON_PLATE, k), torques.row(ON_FLYWHEEL, k)
        pull, push = friction - pull, push - friction
        part = 1.0 / (k + 1)
        v.append(part * (flywheel * push - plate * pull))
        u.append(part * plate * pull)
        x.append(part * unit * u[k])
        for i, series in enumerate((v, x, u)):
            out.set_row(series[k + 1], i, k + 1)
        if k % 2 == 1 and 8 <= k + 1 < last:
            yield k + 1


expand_friction = unrolled(friction_text)
expand_changes = unrolled(changes_text)


@fast
def resolved(step: Step, place: Place, friction: LocalFriction, rows: Any, stribeck: Stribeck, control: Any,
             limits: Limits, terms: Terms, drive: Any, reach: float) -> float:
    """The part of a series step over which the series of its changes hold too.

    The motion may have forgotten what decays: in stick it is on its slow manifold, and a step is as long as the creep's
    series allow. A change of the start, or of the scene, is not on it and decays with friction's own rate. And where
    mu_k is nearly mu_s the motion does not know the exponential that mu_s/mu_k changes it by, nor, beyond `reach`
    seconds, a sine of no amplitude.
    """
    rate = terms.linear[2] / terms.linear[1]
    if place.region == LAYER:
        rate += limits.beta * drive.load * max(friction.slope, 0.0)
    x = min(step.x, reach / step.unit)
    if rate > 0.0:
        x = min(x, limits.resolved / (rate * step.unit))
    if stribeck is not None and place.region != SLIDING:
        while stribeck[1] * (abs(rows[SLIP, 1]) + abs(rows[SLIP, 2]) * x) * x > limits.resolved:
            x *= 0.85
    control.unsettled -= rate * step.unit * x
    return x


@fast
def friction_along(order: int, rows: Any, parts: Any, region: int, v: float, sign: float, sigma: float,
                   friction: LocalFriction, pulsation: tuple[float, float, float] | None, stribeck: Stribeck) -> None:
    """Fill the rows LAW to FALLEN for a series step in the layer or on the falling branch."""
    if stribeck is None:
        expand_friction(order, rows, parts, None, None, None, sigma, friction.tanh, friction.sech, pulsation)
    elif region == LAYER:
        expand_friction(order, rows, parts, -stribeck[1] * sign, math.exp(-stribeck[1] * sign * v), stribeck[0], sigma,
                        friction.tanh, friction.sech, pulsation)
    else:
        expand_friction(order, rows, parts, -stribeck[1] * sign, math.exp(-stribeck[1] * sign * v), stribeck[0], None,
                        sign, 0.0, pulsation)


@fast
def change_excitation(group: Any, lane: int, count: int, unit: float, loaded: bool, rows: Any, waves: Any,
                      pulsation: tuple[float, float, float] | None, drive: Any, series: Any) -> None:
    """The rows TORQUE and LOADED: coefficients of what Te and Ts change by, at constant time from the step's start."""
    by = group.by
    for k in range(count):
        series[TORQUE, k] = by[of.LOG_FREQUENCY, lane] * k * rows[ENGINE, k]
        series[LOADED, k] = 0.0
    series[TORQUE, 0] += by[of.MEAN_TORQUE, lane]
    if by[of.TORQUE_AMPLITUDE, lane] != 0.0:
        share = by[of.TORQUE_AMPLITUDE, lane]
        add_sine(series, TORQUE, count, share * waves[0].sine, share * waves[0].cosine, waves[0].rate * unit)
    if loaded:
        series[LOADED, 0] = by[of.MEAN_LOAD, lane]
        if pulsation is not None:
            if by[of.LOG_FREQUENCY, lane] != 0.0:
                for k in range(1, count):
                    series[LOADED, k] = by[of.LOG_FREQUENCY, lane] * k * rows[LOAD, k]
            share, turned = by[of.LOAD_AMPLITUDE, lane], by[of.LOAD_PHASE, lane] * pulsation[0]
            if share != 0.0 or turned != 0.0:
                add_sine(series, LOADED, count, share * drive.load_sine + turned * drive.load_cosine,
                         share * drive.load_cosine - turned * drive.load_sine, pulsation[1] * unit)


@fast
def change_law(group: Any, lane: int, count: int, sign: float, rows: Any, stribeck: Stribeck, series: Any) -> None:
    """The row SCRATCH: coefficients of what mubar changes by at constant slip speed."""
    by = group.by
    for k in range(count):
        series[SCRATCH, k] = 0.0
    if by[of.SMOOTHING, lane] != 0.0:
        for k in range(count):
            for j in range(k + 1):
                series[SCRATCH, k] += by[of.SMOOTHING, lane] * series[RISING, j] * rows[SLIP, k - j]
    if stribeck is not None:
        if by[of.EXCESS_RATIO, lane] != 0.0:
            for k in range(count):
                series[SCRATCH, k] += by[of.EXCESS_RATIO, lane] * series[FALLEN, k]
        if by[of.DECAY, lane] != 0.0:
            share = -by[of.DECAY, lane] * stribeck[0] * sign
            for k in range(count):
                for j in range(k + 1):
                    series[SCRATCH, k] += share * series[FALLEN, j] * rows[SLIP, k - j]


@fast
def change_torques(group: Any, lane: int, count: int, unit: float, constant: bool, rows: Any,
                   pulsation: tuple[float, float, float] | None, series: Any) -> None:
    """The torques of one lane over a series step; `constant` where mubar is."""
    by, torques = group.by, group.torques
    for k in range(count):
        friction = series[LAW, 0] * series[LOADED, k]
        if not constant:
            for j in range(1, k + 1):
                friction += series[LAW, j] * series[LOADED, k - j]
            friction += rows[LOAD, 0] * series[SCRATCH, k]
            if pulsation is not None:
                for j in range(1, k + 1):
                    friction += rows[LOAD, j] * series[SCRATCH, k - j]
        plate, slip = (k + 1) * rows[SPEED, k + 1] / unit, (k + 1) * rows[SLIP, k + 1] / unit
        torques[ON_CLUTCH, k, lane] = friction
        torques[ON_FLYWHEEL, k, lane] = series[TORQUE, k] - by[of.FLYWHEEL_INERTIA, lane] * (slip + plate)
        torques[ON_PLATE, k, lane] = -(by[of.PLATE_INERTIA, lane] * plate + by[of.DAMPING, lane] * rows[SPEED, k]
                                       + by[of.STIFFNESS, lane] * rows[ANGLE, k])


@fast
def carry_series(tangent: Any, place: Place, friction: LocalFriction, step: Step, loaded: bool, limits: Limits,
                 terms: Terms, waves: Any, drive: Any, rows: Any, pulsation: tuple[float, float, float] | None,
                 stribeck: Stribeck) -> None:
    """Coefficients of all changes over a series step."""
    series, order, unit = tangent.shared.series, step.degree, step.unit
    varies = place.region != 0 and loaded
    if varies:
        friction_along(order, rows, series, place.region, rows[SLIP, 0], place.sign, limits.sigma, friction, pulsation,
                       stribeck)
    else:
        series[LAW, 0] = place.sign
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        for c in range(3):
            for lane in range(LANES):
                group.rows[c, 0, lane] = group.now[c, lane]
        if group.forced:
            for lane in range(LANES):
                if group.forced & (1 << lane):
                    change_excitation(group, lane, order, unit, loaded, rows, waves, pulsation, drive, series)
                    if varies:
                        change_law(group, lane, order, place.sign, rows, stribeck, series)
                    change_torques(group, lane, order, unit, not varies, rows, pulsation, series)
            if varies:
                expand_changes(order, group.rows, series, group.torques, unit, terms.linear, True)
            else:
                expand_changes(order, group.rows, None, group.torques, unit, terms.linear, True)
        elif varies:
            expand_changes(order, group.rows, series, None, unit, terms.linear, None)
        else:
            expand_changes(order, group.rows, None, None, unit, terms.linear, None)
