"""What changes over a Taylor step, by the start of the step and by numbers of the scene: the same for both engines.

The equations are run on numbers that know what they change by (`unrolled.Changing`), so that no derivative is written
out: the coefficients of a change are the derivatives of the coefficients of the motion. Changes are kept in lanes, four
at a time: those of slip speed, plate angle and plate speed first, then those by the scene's keys.

Time is constant within a step. An engine frequency that changes is taken at constant phase (`key_derivatives`): at s
after the start of a step the torques change by s Te'(s) d(omega)/omega, and time by -s d(omega)/omega (`changed_at`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tcc_sim.model.equations import Linear
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers import polynomial
from tcc_sim.solvers.collocation import NODES
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.compiling.unrolled import Changing, unrolled
from tcc_sim.solvers.excitation import Pulsation
from tcc_sim.solvers.key_derivatives import DECAY, EXCESS_RATIO, NUMBERS, SMOOTHING
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
    exponential,
    hyperbolic,
    product,
)

LANES = 4

CHANGES = np.dtype([("now", np.float64, (3, LANES)), ("by", np.float64, (len(NUMBERS), LANES)), ("forced", np.int64),
                    ("rows", np.float64, (ROWS + 2, COLUMNS, LANES)),
                    ("nodes", np.float64, (LANES, NODES)), ("applied", np.float64, (LANES, NODES)),
                    ("peak", np.float64, LANES)])
"""Four lanes of changes.

now : of slip speed, plate angle, plate speed
by : of the numbers of `key_derivatives`; `forced` has a bit for every lane of a key
rows : over a Taylor step, of the coefficients of the motion
nodes, applied : at the nodes of a collocation step, change of slip speed, and torque on flywheel and plate together
peak : of the largest |slip speed| of the cycle
"""

OF_ENGINE, OF_LOAD = range(2)
"""Rows of the sines whose amplitudes are changed: the first of Te, and that of Ts."""


class Rows:
    """Rows of coefficients with what they change by, given those of the state now, `now`, and of numbers, `by`.

    What is written is the change alone: the values are there. Te and Ts change at constant time.
    """

    def __init__(self, rows: Any, changes: Any, now: Any, by: Any, sines: Any, unit: Any, pulsation: Any) -> None:
        self.rows, self.changes, self.by, self.sines = rows, changes, by, sines
        self.turn = None if pulsation is None else pulsation[0] / (pulsation[1] * unit)
        self.known: dict[tuple[int, int], Any] = {}
        for row in (SLIP, ANGLE, SPEED):
            self[row, 0] = Changing(rows[row, 0], now.row(row))

    def __getitem__(self, key: tuple[int, int]) -> Changing:
        if key not in self.known:
            self.known[key] = self._of_engine(key[1]) if key[0] == ENGINE else self._of_load(key[1])
        return Changing(self.rows[key], self.known[key])

    def __setitem__(self, key: tuple[int, int], number: Changing) -> None:
        self.known[key] = number.change
        self.changes.set_row(number.change, *key)

    def _of_engine(self, k: int) -> Any:
        by, change = self.by, self.by.row(of.TORQUE_AMPLITUDE) * self.sines[OF_ENGINE, k]
        return change + (by.row(of.LOG_FREQUENCY) * (k * self.rows[ENGINE, k]) if k else by.row(of.MEAN_TORQUE))

    def _of_load(self, k: int) -> Any:
        by = self.by
        change = by.row(of.LOG_FREQUENCY) * (k * self.rows[LOAD, k]) if k else by.row(of.MEAN_LOAD)
        if self.turn is None:
            return change
        cosine = self.turn * ((k + 1) * self.sines[OF_LOAD, k + 1])
        return change + (by.row(of.LOAD_AMPLITUDE) * self.sines[OF_LOAD, k] + by.row(of.LOAD_PHASE) * cosine)


def linear_of(linear: Linear, by: Any) -> tuple[Changing, ...]:
    """I1, I2, C23 and K23 with what they change by."""
    return tuple(Changing(number, by.row(i)) for i, number in enumerate(linear))


def changed_motion(rows: Any, changes: Any, now: Any, by: Any, sines: Any, unit: Any, linear: Linear, sign: Any,
                   pulsation: Any, decay: Any, excess: Any, factor: Any, sigma: Any, tanh: Any,
                   sech: Any) -> Iterator[int]:
    """What changes in `series.motion`: equations (2) as they stand, their values being those of `rows`.

    A function of the slip speed changes by the series of its derivative times that of v: dF = F d(-alpha |v|),
    dT = (1 - T^2) d(sigma v).

    Parameters
    ----------
    rows, changes, now, by, sines : the motion's coefficients, `rows`, `now` and `by` of CHANGES, `expand_sines`
    decay, excess, factor : alpha, r - 1 and F = exp(-alpha |v|); None where it does not vary
    sigma, tanh, sech : sigma, T = tanh(sigma v) and 1 - T^2; None where it does not vary
    """
    moving, side, time = Rows(rows, changes, now, by, sines, unit, pulsation), Changing(sign), Changing(unit)
    flywheel, plate, damping, stiffness = linear_of(linear, by)
    per_flywheel, per_plate = time / flywheel, time / plate
    weighted, f, t, s = [0.0], [factor], [tanh], [sech]
    bent, turned, fallen, rising, law, load = ([] for _ in range(6))
    if decay is not None:
        rate, share = -side * Changing(decay, by.row(DECAY)), Changing(excess, by.row(EXCESS_RATIO))
    if sigma is not None:
        sharpness = Changing(sigma, by.row(SMOOTHING))
    last = ORDER_MAXIMUM if decay is None and sigma is None else FRICTION_ORDER_MAXIMUM
    for k in range(last):
        v, x, u = moving[SLIP, k], moving[ANGLE, k], moving[SPEED, k]
        if k > 0:
            weighted.append(float(k) * v.value)
        if sigma is None:
            rising.append(side if k == 0 else 0.0)
        else:
            if k > 0:
                hyperbolic(sigma, weighted, t, s, k)
            turned.append((sharpness * v).change)
            rising.append(Changing(t[k], product(s, turned, k)))
        law.append(rising[k])
        if decay is not None:
            if k > 0:
                exponential(rate.value, weighted, f, k)
            bent.append((rate * v).change)
            fallen.append(Changing(f[k], product(f, bent, k)))
            law[k] = law[k] + share * product(fallen, rising, k)
        load.append(moving[LOAD, k] if k == 0 or pulsation is not None else 0.0)
        friction, part = product(load, law, k), 1.0 / (k + 1)
        pull = friction - damping * u - stiffness * x
        moving[SLIP, k + 1] = part * (per_flywheel * (moving[ENGINE, k] - friction) - per_plate * pull)
        moving[SPEED, k + 1] = part * per_plate * pull
        moving[ANGLE, k + 1] = part * time * u
        if k % 2 == 1 and k >= 7:
            yield k + 1


expand_changes = unrolled(changed_motion)


@fast
def expand_sines(sines: Any, count: int, unit: float, waves: Any, pulsation: Pulsation, drive: Any) -> None:
    """Coefficients of sin(omega t) and of the load's sine, one more than `count` of the latter."""
    for k in range(COLUMNS):
        sines[OF_ENGINE, k], sines[OF_LOAD, k] = 0.0, 0.0
    if waves.shape[0] > 0:
        add_sine(sines, OF_ENGINE, count, waves[0].sine, waves[0].cosine, waves[0].rate * unit)
    if pulsation is not None:
        add_sine(sines, OF_LOAD, count + 1, drive.load_sine, drive.load_cosine, pulsation[1] * unit)


@fast
def changed_at(group: Any, row: int, lane: int, order: int, degree: int, x: float, rows: Any) -> float:
    """Change of a row at x of a step, at constant phase; `order` is that of the changes, `degree` that of the row."""
    out = group.rows[row, order, lane]
    for k in range(order - 1, -1, -1):
        out = out * x + group.rows[row, k, lane]
    if group.by[of.LOG_FREQUENCY, lane] != 0.0:
        out -= group.by[of.LOG_FREQUENCY, lane] * x * polynomial.value_and_slope(rows, row, degree, x)[1]
    return float(out)


@fast
def end_changes(group: Any, order: int, x: float) -> None:
    """The changes of the state at x of a step, at constant time."""
    now, changes = group.now, group.rows
    for c in range(3):
        for lane in range(LANES):
            now[c, lane] = changes[c, order, lane]
        for k in range(order - 1, -1, -1):
            for lane in range(LANES):
                now[c, lane] = now[c, lane] * x + changes[c, k, lane]


@fast
def hold_phase(group: Any, degree: int, x: float, rows: Any) -> None:
    """From changes at constant time since the start of a step to those at constant phase."""
    now, by, any_slower = group.now, group.by, False
    for lane in range(LANES):
        any_slower = any_slower or by[of.LOG_FREQUENCY, lane] != 0.0
    if not any_slower:
        return
    for c in range(3):
        slope = x * polynomial.value_and_slope(rows, c, degree, x)[1]
        for lane in range(LANES):
            now[c, lane] -= by[of.LOG_FREQUENCY, lane] * slope
