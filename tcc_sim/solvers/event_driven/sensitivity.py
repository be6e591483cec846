"""How a step and an event of the exact engine change with the state and with the numbers of the equations.

Over a step the variational equation d' = J d + df/dp is solved by Taylor series along the step's own polynomials, in
time over the length of the step, so that its end is the sum of the coefficients. At an event the disturbance is taken
over by a saltation matrix (R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems,
Springer 2004, Section 7.2): S = I + (f+ - f-) e_v^T/v'- where slip ends, I where it begins, the field being continuous
there since mubar(0+) = mu_s/mu_k.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.compiling.unrolled import unrolled
from tcc_sim.solvers.event_driven.step import FALLING_ORDER, LINEAR_ORDER
from tcc_sim.solvers.series import (
    ANGLE,
    COLUMNS,
    ENGINE,
    INVERSE,
    LOAD,
    ROWS,
    SLIP,
    SPEED,
    add_sine,
    exponential,
    product,
    sine_and_cosine,
)
from tcc_sim.trajectory import FREE, STICK

LANES = 4
"""Disturbances that are carried at once."""
CONVERGED = 1e-10
"""Last terms of the friction's exponential, of its first, up to which its series counts as the exponential."""
SMALL = 0.02
EXCESS, HOLD, FALL, LOAD_CHANGE, MIXED, SINE, LOAD_SINE = range(ROWS, ROWS + 7)
"""Rows of the step's series beside those of the motion: exp(-alpha |v|), that times Ts, dTf/dv, change of Ts, a
product; sin(omega t) and the load's sine."""
class Rates(NamedTuple):
    """omega and omega_f, rad/s; Tsp, N m; whether any disturbance changes the first sine of Te, or that of Ts; and
    `stroboscopic.Prepared.fastest`.
    """

    engine: float
    load: float
    amplitude: float
    of_engine: bool
    of_load: bool
    fastest: float


VARIATION = np.dtype([("rows", np.float64, (ROWS + 7, COLUMNS)), ("force", np.float64, (3 * COLUMNS, LANES)),
                      ("series", np.float64, (3 * COLUMNS, LANES)), ("lanes", np.float64, (3, LANES))])
"""Work space of a step: its series with the end at 1; right-hand side and coefficients of slip speed, plate angle and
plate speed (three rows per order); the disturbances themselves."""


def grip(rows: Any, decay: Any, excess: Any, pulsation: Any) -> Iterator[int]:
    """Rows EXCESS and HOLD from SLIP and LOAD; text for `unrolled`."""
    e, load, weighted = [excess], [rows[LOAD, 0]], [0.0, rows[SLIP, 1]]
    for k in range(FALLING_ORDER):
        if k > 0:
            exponential(decay, weighted, e, k)
            weighted.append(float(k + 1) * rows[SLIP, k + 1])
            if pulsation is not None:
                load.append(rows[LOAD, k])
        rows[EXCESS, k] = e[k]
        rows[HOLD, k] = e[k] * load[0] if pulsation is None else product(e, load, k)
    yield FALLING_ORDER


def disturbed(lanes: Any, force: Any, series: Any, rows: Any, length: Any, linear: Linear, slips: Any,
              falls: Any) -> Iterator[int]:
    """The disturbances at the end of a step, into `lanes`, and their coefficients, into `series`; text for `unrolled`.

    slips : None in stick, where both inertias move and the slip speed does not
    falls : None where friction does not change with the slip speed
    """
    inertia = linear[1] if slips is not None else linear[0] + linear[1]
    plate, flywheel = length / inertia, length / linear[0]
    v, x, u = ([lanes.row(i, 0, count=LANES)] for i in range(3))
    slope: list[Any] = []
    ends = [v[0], x[0], u[0]]
    for i, start in enumerate(ends):
        series.set_row(start, i, 0)
    last = LINEAR_ORDER if falls is None else FALLING_ORDER
    for k in range(last):
        part = 1.0 / (k + 1)
        pull = -(linear[2] * u[k] + linear[3] * x[k])
        slip = force.row(3 * k, 0, count=LANES)
        if falls is not None:
            slope.append(rows[FALL, k])
            friction = product(slope, v, k)
            pull = pull + friction
            slip = slip - part * flywheel * friction
        if slips is not None:
            slip = slip - part * plate * pull
        v.append(slip)
        x.append(part * length * u[k] + force.row(3 * k + 1, 0, count=LANES))
        u.append(part * plate * pull + force.row(3 * k + 2, 0, count=LANES))
        for i, new in enumerate((v[k + 1], x[k + 1], u[k + 1])):
            ends[i] = ends[i] + new
            series.set_row(new, 3 * (k + 1) + i, 0)
    for i, end in enumerate(ends):
        lanes.set_row(end, i, 0)
    yield last


expand_grip, expand_disturbed = unrolled(grip), unrolled(disturbed)


@fast
def scale_step(mode: int, falls: bool, order: int, x: float, rows: Any, rates: Rates, tau: float,
               shift: float, length: float, pulsation: tuple[float, float, float] | None, stribeck: Stribeck,
               into: Any) -> None:
    """The series of a step in time over its length, with what friction adds to them."""
    power = 1.0
    for k in range(order + 1):
        into[SLIP, k] = rows[SLIP, k] * power
        into[ANGLE, k] = rows[ANGLE, k] * power
        into[SPEED, k] = rows[SPEED, k] * power
        into[ENGINE, k] = rows[ENGINE, k] * power
        into[LOAD, k] = rows[LOAD, k] * power if k == 0 or pulsation is not None else 0.0
        into[FALL, k] = 0.0
        into[SINE, k] = 0.0
        into[LOAD_SINE, k] = 0.0
        into[EXCESS, k] = 0.0
        into[HOLD, k] = 0.0
        power *= x
    if stribeck is not None and falls:
        decay = -stribeck[1] * mode
        expand_grip(FALLING_ORDER, into, decay, math.exp(decay * rows[SLIP, 0]), pulsation)
        for k in range(order):
            into[FALL, k] = -stribeck[1] * stribeck[0] * into[HOLD, k]
    if rates.of_engine:
        sine, cosine = sine_and_cosine(rates.engine * tau)
        add_sine(into, SINE, order, sine, cosine, rates.engine * length)
    if rates.of_load:
        sine, cosine = sine_and_cosine(rates.load * tau + shift)
        add_sine(into, LOAD_SINE, order + 1, sine, cosine, rates.load * length)


@fast
def unresolved(rows: Any, stribeck: Stribeck) -> bool:
    """Whether the last terms of exp(-alpha |v|) over the step count, where mu_s - mu_k is too small for the motion to
    show them.
    """
    if stribeck is None or abs(stribeck[0]) > SMALL:
        return False
    last = max(abs(rows[EXCESS, FALLING_ORDER - 2]), abs(rows[EXCESS, FALLING_ORDER - 1]))
    return bool(last > CONVERGED * abs(rows[EXCESS, 0]))


@fast
def friction_change(mode: int, order: int, number: Any, rates: Rates, length: float,
                    stribeck: Stribeck, falls: bool, rows: Any) -> None:
    """Row MIXED: how the friction torque changes with the numbers at a given motion; row LOAD_CHANGE: how Ts does."""
    varies = 1
    if number[of.LOAD_AMPLITUDE] != 0.0 or number[of.LOAD_PHASE] != 0.0:
        varies = order
    turn = number[of.LOAD_PHASE] * rates.amplitude / (rates.load * length)
    for k in range(order):
        change = number[of.LOAD_AMPLITUDE] * rows[LOAD_SINE, k] + turn * (k + 1) * rows[LOAD_SINE, k + 1]
        rows[LOAD_CHANGE, k] = change + (number[of.MEAN_LOAD] if k == 0 else 0.0)
        rows[MIXED, k] = mode * rows[LOAD_CHANGE, k]
    if stribeck is not None and falls:
        share, excess = mode * number[of.EXCESS_RATIO], mode * stribeck[0]
        for k in range(order):
            rows[MIXED, k] += share * rows[HOLD, k]
        for j in range(varies):
            change = excess * rows[LOAD_CHANGE, j]
            for k in range(j, order):
                rows[MIXED, k] += change * rows[EXCESS, k - j]
        if number[of.DECAY] != 0.0:
            for j in range(order):
                change = number[of.DECAY] * stribeck[0] * rows[SLIP, j]
                for k in range(j, order):
                    rows[MIXED, k] -= change * rows[HOLD, k - j]


@fast
def add_force(mode: int, order: int, length: float, linear: Linear, number: Any, lane: int, rows: Any,
              force: Any) -> None:
    """The right-hand side df/dp of a lane, in the units of the series, from row MIXED; see `key_derivatives`."""
    flywheel, plate, damping, stiffness = linear
    per_length, slower = 1.0 / length, number[of.LOG_FREQUENCY]
    per_flywheel, per_plate, per_both = 1.0 / flywheel, 1.0 / plate, 1.0 / (flywheel + plate)
    for k in range(order):
        weight = length * INVERSE[k + 1]
        speed_rate = (k + 1) * rows[SPEED, k + 1] * per_length
        held = number[of.DAMPING] * rows[SPEED, k] + number[of.STIFFNESS] * rows[ANGLE, k]
        torque = number[of.TORQUE_AMPLITUDE] * rows[SINE, k] + (number[of.MEAN_TORQUE] if k == 0 else 0.0)
        force[3 * k + 1, lane] = -weight * slower * rows[SPEED, k]
        if mode == STICK:
            push = torque - held - speed_rate * (number[of.FLYWHEEL_INERTIA] + number[of.PLATE_INERTIA])
            force[3 * k, lane] = 0.0
            force[3 * k + 2, lane] = weight * (push * per_both - slower * speed_rate)
        else:
            friction = plate * speed_rate + damping * rows[SPEED, k] + stiffness * rows[ANGLE, k]
            change = rows[MIXED, k] if mode != FREE else 0.0
            drive = torque - change - (rows[ENGINE, k] - friction) * per_flywheel * number[of.FLYWHEEL_INERTIA]
            pull = (change - held - speed_rate * number[of.PLATE_INERTIA]) * per_plate
            slip_rate = (k + 1) * rows[SLIP, k + 1] * per_length
            force[3 * k, lane] = weight * (drive * per_flywheel - pull - slower * slip_rate)
            force[3 * k + 2, lane] = weight * (pull - slower * speed_rate)


@fast
def land(mode: int, following: int, state: Any, drive: Any, ratio: float, linear: Linear, columns: Any) -> bool:
    """Saltation where slip in direction `mode` ends at v = 0 and the mode is `following`; False where v' is 0 there."""
    flywheel, plate, damping, stiffness = linear
    spring = damping * state.plate_speed + stiffness * state.plate_angle
    friction = mode * ratio * drive.load
    speed_rate = (friction - spring) / plate
    slip_rate = (drive.torque - friction) / flywheel - speed_rate
    if slip_rate == 0.0:
        return False
    new_rate, share = (drive.torque - spring) / (flywheel + plate), 0.0
    if following != STICK:
        friction = following * ratio * drive.load
        new_rate = (friction - spring) / plate
        share = ((drive.torque - friction) / flywheel - new_rate) / slip_rate
    for b in range(columns.shape[0]):
        for lane in range(LANES):
            columns[b, 2, lane] += (new_rate - speed_rate) / slip_rate * columns[b, 0, lane]
            columns[b, 0, lane] *= share
    return True
