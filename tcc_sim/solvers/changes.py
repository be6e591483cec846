"""Derivatives of a Taylor step by its start and by numbers of the scene, the same for both engines.

The text of the equations runs on numbers that carry their derivatives (`law.Changing`), so that no derivative is
written out. A lane is one derivative; four lanes are worked on together. The first three lanes are the derivatives by
slip speed, plate angle and plate speed, the others those by the scene's keys.

Time is constant within a step. Derivatives by the engine frequency are at constant phase (`key_derivatives`): at s
after the start of a step the torques change by s Te'(s) d(omega)/omega, and time by -s d(omega)/omega (`changed_at`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import fast
from tcc_sim.compiling.unrolled import unrolled
from tcc_sim.model.equations import Linear, lost_torque
from tcc_sim.model.friction import Stribeck
from tcc_sim.polynomials import polynomial
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers import series
from tcc_sim.solvers.collocation import NODES
from tcc_sim.solvers.key_derivatives import NUMBERS
from tcc_sim.solvers.law import FRICTION, NARROW, OF_SLIP, WIDE, Changing, law_along, numbers_of

LANES = 4

CHANGES = np.dtype([("now", np.float64, (3, LANES)), ("by", np.float64, (len(NUMBERS), LANES)), ("forced", np.int64),
                    ("rows", np.float64, (series.ROWS + 2, series.COLUMNS, LANES)),
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
ALONG, ALONG_ALL = (np.dtype([("sines", np.float64, (2, series.COLUMNS)), ("mubar", np.float64, series.COLUMNS),
                              ("law", np.float64, (series.COLUMNS, width)), ("at_nodes", np.float64, (width, NODES)),
                              ("shaped", np.int64)]) for width in (NARROW, WIDE))
"""Numbers that all lanes share over a step: coefficients of `expand_sines` and of `law.law_along`;
derivatives of mubar by its numbers at the nodes, a row for each column of `law`; whether another number of the law than
c_1 changes.
ALONG_ALL has columns for the later exponentials: kernels without them do not pay.
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
        for row in (series.SLIP, series.ANGLE, series.SPEED):
            self[row, 0] = Changing(rows[row, 0], now.row(row))

    def __getitem__(self, key: tuple[int, int]) -> Changing:
        if key not in self.known:
            self.known[key] = self._driven(*key)
        return Changing(self.rows[key], self.known[key])

    def __setitem__(self, key: tuple[int, int], number: Changing) -> None:
        self.known[key] = number.change
        if key[0] < series.ROWS or self.margins is not None:
            self.changes.set_row(number.change, *key)

    def _driven(self, row: int, k: int) -> Any:
        by = self.by
        if by is None:
            return None
        if row == series.ENGINE:
            change = by.row(of.TORQUE_AMPLITUDE) * self.sines[OF_ENGINE, k]
            rise = by.row(of.LOG_FREQUENCY) * (k * self.rows[series.ENGINE, k]) if k else by.row(of.MEAN_TORQUE)
            return change + rise
        change = by.row(of.LOG_FREQUENCY) * (k * self.rows[series.LOAD, k]) if k else by.row(of.MEAN_LOAD)
        if self.turn is None:
            return change
        cosine = self.turn * ((k + 1) * self.sines[OF_LOAD, k + 1])
        return change + (by.row(of.LOAD_AMPLITUDE) * self.sines[OF_LOAD, k] + by.row(of.LOAD_PHASE) * cosine)


def changing(number: Any, by: Any, which: int) -> Changing:
    """Return one of the numbers of `key_derivatives` with its derivatives."""
    return Changing(number, None if by is None else by.row(which))


def changing_linear(linear: Linear, by: Any) -> Any:
    """Return the linear part, complete, with the derivatives of its coefficients."""
    numbers: Any = [changing(number, by, i) for i, number in enumerate(linear)]
    return Linear(*numbers)


def changed_motion(rows: Any, changes: Any, now: Any, by: Any, sines: Any, coefficients: Any, law: Any,
                   unit: Any, linear: Linear, sign: Any, pulsation: Any, stribeck: Any, sigma: Any) -> Iterator[int]:
    """Fill the derivatives of `series.motion`, equations (2), with the values of `rows`; staged function.

    rows, changes, now, by, sines : the motion's coefficients, `rows`, `now` and `by` of CHANGES, `expand_sines`
    coefficients, law : see `law_along`
    stribeck, sigma : None where the exponential, or tanh, does not vary; mubar is `sign` where both are None
    """
    moving, time = Rows(rows, changes, now, by, sines, unit, pulsation), Changing(unit)
    part_of = changing_linear(linear, by)
    per_flywheel, per_plate = time / part_of.flywheel, time / part_of.plate
    varies = stribeck is not None or sigma is not None
    slope, slip, mubar, load = ([] for _ in range(4))
    for k in range(series.FRICTION_ORDER_MAXIMUM if varies else series.ORDER_MAXIMUM):
        x, u = moving[series.ANGLE, k], moving[series.SPEED, k]
        load.append(moving[series.LOAD, k] if k == 0 or pulsation is not None else Changing(0.0))
        if varies:
            slope.append(law[k, OF_SLIP])
            slip.append(moving[series.SLIP, k].change)
            mubar.append(coefficients[k,])
            change = series.product(slope, slip, k)
            if by is not None:
                change = change + series.product(mubar, [0.0 if p.change is None else p.change for p in load], k)
                for cause, number in numbers_of(stribeck, law.shape[-1]).items():
                    change = change + by.row(number) * law[k, cause]
            friction = Changing(law[k, FRICTION], change)
        else:
            friction = load[k] * sign
        part, pull = 1.0 / (k + 1), friction - part_of.damping * u - part_of.stiffness * x
        pull = pull - lost_torque(moving[series.SLIP, k], part_of.plate_by_slip)
        push = moving[series.ENGINE, k] - friction - lost_torque(moving[series.SLIP, k], part_of.flywheel_by_slip)
        moving[series.SLIP, k + 1] = part * (per_flywheel * push - per_plate * pull)
        moving[series.SPEED, k + 1] = part * per_plate * pull
        moving[series.ANGLE, k + 1] = part * time * u
        if k % 2 == 1 and k >= 7:
            yield k + 1


def ending(now: Any, changes: Any, x: Any) -> Iterator[int]:
    """Fill `now` with the derivatives of the state at x of a step; staged function."""
    power, ends = x, [changes.row(row, 0) for row in range(3)]
    for k in range(1, series.COLUMNS):
        ends = [end + changes.row(row, k) * power for row, end in enumerate(ends)]
        power = power * x
        if k % 2 == 0 and k >= 8:
            for row, end in enumerate(ends):
                now.set_row(end, row)
            yield k


expand_law, expand_changes, end_changes = unrolled(law_along), unrolled(changed_motion), unrolled(ending)


@fast
def carry_slip(order: int, unit: float, sign: float, groups: Any, along: Any, rows: Any, linear: Linear,
               pulsation: series.Pulsation, stribeck: Stribeck, sigma: float | None) -> None:
    """Fill the coefficients of all derivatives over a step in slip or near v = 0, with the sines of `along` (ALONG);
    `stribeck` and `sigma` as in `changed_motion`.
    """
    mubar, law = along.mubar, along.law
    if along.shaped != 0:
        expand_law(order, rows, mubar, law, True, sign, pulsation, stribeck, sigma)
    else:
        expand_law(order, rows, mubar, law, None, sign, pulsation, stribeck, sigma)
    for i in range(groups.shape[0]):
        group = groups[i]
        if group.forced != 0:
            expand_changes(order, rows, group.rows, group.now, group.by, along.sines, mubar, law, unit, linear, sign,
                           pulsation, stribeck, sigma)
        else:
            expand_changes(order, rows, group.rows, group.now, None, along.sines, mubar, law, unit, linear, sign,
                           pulsation, stribeck, sigma)


@fast
def expand_sines(sines: Any, count: int, unit: float, waves: Any, pulsation: series.Pulsation, drive: Any) -> None:
    """Fill the coefficients of sin(omega t) and of the load's sine, one more than `count` of the latter."""
    for k in range(series.COLUMNS):
        sines[OF_ENGINE, k], sines[OF_LOAD, k] = 0.0, 0.0
    if waves.shape[0] > 0:
        series.expand_sine(count - 1, sines[OF_ENGINE], None, waves[0].sine, waves[0].cosine, waves[0].rate * unit)
    if pulsation is not None:
        series.expand_sine(count, sines[OF_LOAD], None, drive.load_sine, drive.load_cosine, pulsation[1] * unit)


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
