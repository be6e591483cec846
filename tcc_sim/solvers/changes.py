"""Derivatives of a Taylor step by its start and by numbers of the scene, the same for both engines.

The text of the equations runs on numbers that carry their derivatives (`compiling.changing`), so that no derivative is
written out. A lane is one derivative; four lanes are worked on together. The first three lanes are the derivatives by
slip speed, plate angle and plate speed, the others those by the scene's keys.

Time is constant within a step. Derivatives by the engine frequency are at constant phase (`key_derivatives`): at s
after the start of a step the torques change by s Te'(s) d(omega)/omega, and time by -s d(omega)/omega (`changed_at`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain
from typing import Any

import numpy as np

from tcc_sim.compiling.changing import Causes, Changing
from tcc_sim.compiling.compiled import fast
from tcc_sim.compiling.unrolled import exp, limited, row_of, unrolled
from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.polynomials import polynomial
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers.collocation import NODES
from tcc_sim.solvers.excitation import Pulsation
from tcc_sim.solvers.key_derivatives import DECAY, EXCESS_RATIO, LATER, NUMBERS, SMOOTHING
from tcc_sim.solvers.series import (
    ANGLE,
    COLUMNS,
    ENGINE,
    FRICTION_ORDER_MAXIMUM,
    LOAD,
    ORDER_MAXIMUM,
    ROWS,
    SLIP,
    SPEED,
    add_sine,
    added,
    exponential,
    hyperbolic,
    product,
)

LANES = 4

CHANGES = np.dtype([("now", np.float64, (3, LANES)), ("by", np.float64, (len(NUMBERS), LANES)), ("forced", np.int64),
                    ("rows", np.float64, (ROWS + 2, COLUMNS, LANES)),
                    ("nodes", np.float64, (LANES, NODES)), ("applied", np.float64, (LANES, NODES)),
                    ("peak", np.float64, LANES)])
"""Four lanes of derivatives.

now : of slip speed, plate angle, plate speed
by : of the numbers of `key_derivatives`; `forced` has a bit for every lane of a key
rows : of the coefficients of the motion over a Taylor step
nodes, applied : of the slip speed, and of the torque on flywheel and plate together, at the nodes of a collocation step
peak : of the largest |slip speed| of the cycle
"""

OF_ENGINE, OF_LOAD = range(2)
"""Rows of the sines with derivatives by amplitude: the first of Te, and that of Ts."""
FRICTION, OF_SLIP, OF_EXCESS, OF_DECAY, OF_SMOOTHING, OF_LATER = range(6)
"""Columns of `law`: Ts mubar, and its derivatives by v, c_1, a_1, sigma; the first of those by c_2, a_2, c_3, a_3."""
NUMBERS_OF_LAW = {OF_EXCESS: EXCESS_RATIO, OF_DECAY: DECAY, OF_SMOOTHING: SMOOTHING}
NUMBERS_OF_ALL = {**NUMBERS_OF_LAW, **{OF_LATER + j: number for j, number in enumerate(LATER)}}
COLUMNS_OF_PAIRS = (OF_EXCESS, OF_DECAY), (OF_LATER, OF_LATER + 1), (OF_LATER + 2, OF_LATER + 3)
"""Columns of amplitude and rate of each exponential."""
NARROW, WIDE = 8, 16
"""Columns of `law` without those of the later exponentials, and with them."""

ALONG, ALONG_ALL = (np.dtype([("sines", np.float64, (2, COLUMNS)), ("mubar", np.float64, COLUMNS),
                              ("law", np.float64, (COLUMNS, width)), ("at_nodes", np.float64, (width, NODES)),
                              ("shaped", np.int64)]) for width in (NARROW, WIDE))
"""Numbers that all lanes share over a step: coefficients of `expand_sines` and of `law_along`; mubar and its
derivatives at the nodes, a row for each column of `law`; whether another number of the law than c_1 changes. ALONG_ALL
has columns for the later exponentials: kernels without them do not pay.
"""


class Rows:
    """Coefficients of a motion, which are known, with their derivatives, which the code writes to `changes`.

    Derivatives of the state at the start are `now`, those of the numbers `by`, or None if there are none. Te and Ts
    change at constant time. Rows of margins are written unless `margins` is None.
    """

    def __init__(self, rows: Any, changes: Any, now: Any, by: Any, sines: Any, unit: Any, pulsation: Any,
                 margins: Any = None) -> None:
        self.rows, self.changes, self.by, self.sines, self.margins = rows, changes, by, sines, margins
        self.turn = None if pulsation is None else pulsation[0] / (pulsation[1] * unit)
        self.known: dict[tuple[int, int], Any] = {}
        for row in (SLIP, ANGLE, SPEED):
            self[row, 0] = Changing(rows[row, 0], now.row(row))

    def __getitem__(self, key: tuple[int, int]) -> Changing:
        if key not in self.known:
            self.known[key] = self._driven(*key)
        return Changing(self.rows[key], self.known[key])

    def __setitem__(self, key: tuple[int, int], number: Changing) -> None:
        self.known[key] = number.change
        if key[0] < ROWS or self.margins is not None:
            self.changes.set_row(number.change, *key)

    def _driven(self, row: int, k: int) -> Any:
        by = self.by
        if by is None:
            return None
        if row == ENGINE:
            change = by.row(of.TORQUE_AMPLITUDE) * self.sines[OF_ENGINE, k]
            return change + (by.row(of.LOG_FREQUENCY) * (k * self.rows[ENGINE, k]) if k else by.row(of.MEAN_TORQUE))
        change = by.row(of.LOG_FREQUENCY) * (k * self.rows[LOAD, k]) if k else by.row(of.MEAN_LOAD)
        if self.turn is None:
            return change
        cosine = self.turn * ((k + 1) * self.sines[OF_LOAD, k + 1])
        return change + (by.row(of.LOAD_AMPLITUDE) * self.sines[OF_LOAD, k] + by.row(of.LOAD_PHASE) * cosine)


def changing(number: Any, by: Any, which: int) -> Changing:
    """Return one of the numbers of `key_derivatives` with its derivatives."""
    return Changing(number, None if by is None else by.row(which))


def linear_of(linear: Linear, by: Any) -> tuple[Changing, ...]:
    """Return I1, I2, C23 and K23 with their derivatives."""
    return tuple(changing(number, by, i) for i, number in enumerate(linear))


def numbers_of(stribeck: Stribeck, width: int = WIDE) -> dict[int, int]:
    """Return the numbers of the law by their columns in a `law` of this width."""
    pairs = COLUMNS_OF_PAIRS[:min(len(stribeck or ()) // 2, 3 if width > NARROW else 1)]
    return {cause: NUMBERS_OF_ALL[cause] for cause in (OF_SMOOTHING, *chain(*pairs))}


def mubar_at(v: Any, side: Any, sigma: Any, stribeck: Any) -> Changing:
    """Return mubar of (7) at a slip speed v, or at a row of them, on one side of v = 0, with its derivatives by v and
    by the numbers of the law, in the columns of `law`.
    """
    size = Changing(v, Causes({OF_SLIP: 1.0})) * side
    angle = size * Changing(sigma, Causes({OF_SMOOTHING: 1.0}))
    left = exp(-2.0 * angle.value)
    tanh, ratio = (1.0 - left) / (1.0 + left), Changing(1.0)
    for j, (of_share, of_rate) in zip(range(0, len(stribeck or ()), 2), COLUMNS_OF_PAIRS):
        exponent = -size * Changing(stribeck[j + 1], Causes({of_rate: 1.0}))
        factor = exp(limited(exponent.value, -700.0, 1.0))
        ratio = ratio + Changing(stribeck[j], Causes({of_share: 1.0})) * Changing(factor, exponent.change * factor)
    return ratio * Changing(tanh, angle.change * (1.0 - tanh * tanh)) * side


class Exponential:
    """Series of F = exp(rate v), which starts with `factor`, with its derivatives dF = F d(rate v)."""

    def __init__(self, factor: Any, share: Changing, rate: Changing) -> None:
        self.share, self.rate, self._factors, self._bent = share, rate, [factor], list[Any]()

    def following(self, v: Changing, weighted: list[Any], k: int) -> Changing:
        """Return coefficient k, from that of v and from k v_k at the end of `weighted`."""
        if k > 0:
            exponential(self.rate.value, weighted, self._factors, k)
        self._bent.append((v * self.rate).change)
        return Changing(self._factors[k], product(self._bent, self._factors, k))


def law_along(rows: Any, coefficients: Any, law: Any, shaped: Any, sign: Any, pulsation: Any, stribeck: Any,
              factor: Any, sigma: Any, tanh: Any, sech: Any) -> Iterator[int]:
    """Fill the coefficients of mubar, and of Ts mubar with its derivatives, along a motion; staged function.

    The rules are those of series: dF = F d(-alpha |v|), dT = (1 - T^2) d(sigma v).

    Parameters
    ----------
    rows, coefficients : the motion's coefficients, and those of mubar
    law : (COLUMNS, 8 or 16) columns FRICTION to OF_SMOOTHING, and with 16 from OF_LATER on; only the first four are
        filled where `shaped` is None, with 0 by a_1 and sigma
    sign : of the slip speed
    stribeck, factor : amplitudes and rates in turn, and F = exp(-a |v|) of the first one; None where they do not vary
    sigma, tanh, sech : sigma, T = tanh(sigma v) and 1 - T^2; None where it does not vary
    """
    if stribeck is None and sigma is None:
        return
    decays, sharpens = (None, None) if shaped is None else (Causes({OF_DECAY: 1.0}), Causes({OF_SMOOTHING: 1.0}))
    weighted, t, s, side = [0.0], [tanh], [sech], Changing(sign)
    turned, fallen, load = ([] for _ in range(3))
    falls: list[Exponential] = []
    causes = range(OF_SLIP, OF_DECAY + 1 if shaped is None else law.shape[-1])
    later = shaped is not None and law.shape[-1] > NARROW
    rising: list[Any] = []
    mubar: list[Any] = []
    side_by_side: list[Any] = []
    if stribeck is not None:
        falls.append(Exponential(factor, Changing(stribeck[0], Causes({OF_EXCESS: 1.0})),
                                 Changing(stribeck[1], decays) * -side))
        for j, causes_of_pair in zip(range(2, len(stribeck), 2), COLUMNS_OF_PAIRS[1:]):
            share, rate = (Causes({cause: 1.0}) if later else None for cause in causes_of_pair)
            falls.append(Exponential(exp(-stribeck[j + 1] * sign * rows[SLIP, 0]), Changing(stribeck[j], share),
                                     Changing(stribeck[j + 1], rate) * -side))
    if sigma is not None:
        sharpness = Changing(sigma, sharpens)
    for k in range(FRICTION_ORDER_MAXIMUM):
        v = Changing(rows[SLIP, k], Causes({OF_SLIP: 1.0} if k == 0 else {}))
        if k > 0:
            weighted.append(float(k) * v.value)
        if sigma is None:
            rising.append(side if k == 0 else 0.0)
        else:
            if k > 0:
                hyperbolic(sigma, weighted, t, s, k)
            turned.append((v * sharpness).change)
            rising.append(Changing(t[k], product(turned, s, k)))
        mubar.append(rising[k])
        if stribeck is not None:
            fallen.append(added([one.share * one.following(v, weighted, k) for one in falls]))
            mubar[k] = mubar[k] + product(fallen, rising, k)
        load.append(rows[LOAD, k] if k == 0 or pulsation is not None else 0.0)
        coefficients[k,] = mubar[k].value
        side_by_side.append(row_of([mubar[k].value, *(mubar[k].change.get(cause, 0.0) for cause in causes)]))
        law.set_row(product(side_by_side, load, k), k)
        if shaped is None:
            law[k, OF_SMOOTHING] = 0.0
        if k % 2 == 1 and k >= 7:
            yield k + 1


def changed_motion(rows: Any, changes: Any, now: Any, by: Any, sines: Any, coefficients: Any, law: Any,
                   unit: Any, linear: Linear, sign: Any, pulsation: Any, stribeck: Any, sigma: Any) -> Iterator[int]:
    """Fill the derivatives of `series.motion`, equations (2), with the values of `rows`; staged function.

    Parameters
    ----------
    rows, changes, now, by, sines : the motion's coefficients, `rows`, `now` and `by` of CHANGES, `expand_sines`
    coefficients, law : see `law_along`
    stribeck, sigma : None where the exponential, or tanh, does not vary; mubar is `sign` where both are None
    """
    moving, time = Rows(rows, changes, now, by, sines, unit, pulsation), Changing(unit)
    flywheel, plate, damping, stiffness = linear_of(linear, by)
    per_flywheel, per_plate = time / flywheel, time / plate
    varies = stribeck is not None or sigma is not None
    slope, slip, mubar, load = ([] for _ in range(4))
    for k in range(FRICTION_ORDER_MAXIMUM if varies else ORDER_MAXIMUM):
        x, u = moving[ANGLE, k], moving[SPEED, k]
        load.append(moving[LOAD, k] if k == 0 or pulsation is not None else Changing(0.0))
        if varies:
            slope.append(law[k, OF_SLIP])
            slip.append(moving[SLIP, k].change)
            mubar.append(coefficients[k,])
            change = product(slope, slip, k)
            if by is not None:
                change = change + product(mubar, [0.0 if p.change is None else p.change for p in load], k)
                for cause, number in (NUMBERS_OF_ALL if law.shape[-1] > NARROW else NUMBERS_OF_LAW).items():
                    change = change + by.row(number) * law[k, cause]
            friction = Changing(law[k, FRICTION], change)
        else:
            friction = load[k] * sign
        part, pull = 1.0 / (k + 1), friction - damping * u - stiffness * x
        moving[SLIP, k + 1] = part * (per_flywheel * (moving[ENGINE, k] - friction) - per_plate * pull)
        moving[SPEED, k + 1] = part * per_plate * pull
        moving[ANGLE, k + 1] = part * time * u
        if k % 2 == 1 and k >= 7:
            yield k + 1


def ending(now: Any, changes: Any, x: Any) -> Iterator[int]:
    """Fill `now` with the derivatives of the state at x of a step; staged function."""
    power, ends = x, [changes.row(row, 0) for row in range(3)]
    for k in range(1, COLUMNS):
        ends = [end + changes.row(row, k) * power for row, end in enumerate(ends)]
        power = power * x
        if k % 2 == 0 and k >= 8:
            for row, end in enumerate(ends):
                now.set_row(end, row)
            yield k


expand_law, expand_changes, end_changes = unrolled(law_along), unrolled(changed_motion), unrolled(ending)


@fast
def carry_slip(order: int, unit: float, sign: float, groups: Any, along: Any, rows: Any, linear: Linear,
               pulsation: Pulsation, stribeck: Stribeck, sigma: float | None, tanh: float, sech: float) -> None:
    """Fill the coefficients of all derivatives over a step in slip or near v = 0, with the sines of `along` (ALONG);
    `stribeck` and `sigma` as in `changed_motion`.
    """
    factor, mubar, law = 0.0, along.mubar, along.law
    if stribeck is not None:
        factor = math.exp(-stribeck[1] * sign * rows[SLIP, 0])
    if along.shaped != 0:
        expand_law(order, rows, mubar, law, True, sign, pulsation, stribeck, factor, sigma, tanh, sech)
    else:
        expand_law(order, rows, mubar, law, None, sign, pulsation, stribeck, factor, sigma, tanh, sech)
    for i in range(groups.shape[0]):
        group = groups[i]
        if group.forced != 0:
            expand_changes(order, rows, group.rows, group.now, group.by, along.sines, mubar, law, unit, linear, sign,
                           pulsation, stribeck, sigma)
        else:
            expand_changes(order, rows, group.rows, group.now, None, along.sines, mubar, law, unit, linear, sign,
                           pulsation, stribeck, sigma)


@fast
def expand_sines(sines: Any, count: int, unit: float, waves: Any, pulsation: Pulsation, drive: Any) -> None:
    """Fill the coefficients of sin(omega t) and of the load's sine, one more than `count` of the latter."""
    for k in range(COLUMNS):
        sines[OF_ENGINE, k], sines[OF_LOAD, k] = 0.0, 0.0
    if waves.shape[0] > 0:
        add_sine(sines, OF_ENGINE, count, waves[0].sine, waves[0].cosine, waves[0].rate * unit)
    if pulsation is not None:
        add_sine(sines, OF_LOAD, count + 1, drive.load_sine, drive.load_cosine, pulsation[1] * unit)


@fast
def changed_at(group: Any, row: int, lane: int, order: int, degree: int, x: float, rows: Any) -> float:
    """Return the derivative of a row at x of a step at constant phase; `order` and `degree` are of both series."""
    out = group.rows[row, order, lane]
    for k in range(order - 1, -1, -1):
        out = out * x + group.rows[row, k, lane]
    if group.by[of.LOG_FREQUENCY, lane] != 0.0:
        out -= group.by[of.LOG_FREQUENCY, lane] * x * polynomial.value_and_slope(rows, row, degree, x)[1]
    return float(out)


@fast
def hold_phase(group: Any, degree: int, x: float, rows: Any) -> None:
    """Turn derivatives at constant time since the start of a step into those at constant phase."""
    now, by, any_slower = group.now, group.by, False
    for lane in range(LANES):
        any_slower = any_slower or by[of.LOG_FREQUENCY, lane] != 0.0
    if not any_slower:
        return
    for c in range(3):
        slope = x * polynomial.value_and_slope(rows, c, degree, x)[1]
        for lane in range(LANES):
            now[c, lane] -= by[of.LOG_FREQUENCY, lane] * slope
