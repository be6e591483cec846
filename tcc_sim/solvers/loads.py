"""What clutch and shaft bear in a step: work and power of the friction torque, and the torque in the shaft.

(2b) gives the friction torque from the polynomials of the plate's motion, Tf = I2 theta2'' + C23 theta2' + K23 theta2,
so neither its law nor its mode is asked for. Integrals over a step are sums by the rule of Lobatto with six points,
which holds for polynomials up to degree nine (M. Abramowitz and I. A. Stegun (1964), 25.4.32).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.equations import Linear
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.series import ANGLE, SLIP, SPEED
from tcc_sim.trajectory import Loads, Transitions

LOADS = np.dtype([("energy", np.float64), ("peak_power", np.float64), ("highest_shaft_torque", np.float64),
                  ("lowest_shaft_torque", np.float64), ("wanted", np.float64)])
"""An engine cycle: J, W, N m, and 1 where they are asked for."""

_NEAR, _FAR = math.sqrt(1.0 / 3.0 - 2.0 * math.sqrt(7.0) / 21.0), math.sqrt(1.0 / 3.0 + 2.0 * math.sqrt(7.0) / 21.0)
POINTS = tuple(0.5 + 0.5 * x for x in (-1.0, -_FAR, -_NEAR, _NEAR, _FAR, 1.0))
WEIGHTS = tuple(w / 60.0 for w in (2.0, 14.0 - math.sqrt(7.0), 14.0 + math.sqrt(7.0), 14.0 + math.sqrt(7.0),
                                   14.0 - math.sqrt(7.0), 2.0))
"""Abscissae and weights of the rule on [0, 1]."""
POWER, SHAFT = 0, 1
LAST = len(POINTS) - 1
ROOM = 0.1
"""How far, in parts of the values at the points, an extreme may lie beyond the largest of them."""


def room_for_loads(problem: Problem) -> NDArray[Any] | None:
    """Records of LOADS for the cycles of a run and what follows them; None where no loads are asked for."""
    if problem.loads_from is None:
        return None
    out = np.zeros(problem.whole_cycles + 2, LOADS)
    out["highest_shaft_torque"], out["lowest_shaft_torque"] = -math.inf, math.inf
    out["wanted"][problem.loads_from:] = 1.0
    return out


def loads_of(records: NDArray[Any] | None, moves: Transitions, problem: Problem, whole: int) -> Loads | None:
    """The loads of the first `whole` cycles of a run, from their records and its transitions."""
    if records is None:
        return None
    left = moves.time[moves.before == 0]
    if problem.system.course is None:
        number = np.floor(left / problem.system.cycle).astype(np.int64) - problem.start_cycle
    else:
        number = np.searchsorted(problem.cycle_starts(), left, side="right") - 1
    counts = np.bincount(np.clip(number, 0, whole), minlength=whole + 1)[:whole].astype(np.float64)
    names = ("energy", "peak_power", "highest_shaft_torque", "lowest_shaft_torque")
    told = records["wanted"][:whole] > 0.0
    return Loads(*(np.where(told, column, math.nan) for column in (*(records[name][:whole] for name in names), counts)))


@fast
def power_and_shaft(rows: Any, degree: int, unit: float, x: float, linear: Linear) -> tuple[float, float]:
    """Power of the friction torque, W, and torque in the shaft, N m, at a place of a step."""
    v, angle, speed, rise = rows[SLIP, degree], rows[ANGLE, degree], rows[SPEED, degree], 0.0
    for k in range(degree - 1, -1, -1):
        v = v * x + rows[SLIP, k]
        angle = angle * x + rows[ANGLE, k]
        rise = rise * x + speed
        speed = speed * x + rows[SPEED, k]
    shaft = linear[2] * speed + linear[3] * angle
    return (linear[1] * rise / unit + shaft) * v, shaft


@fast
def near(rows: Any, degree: int, unit: float, which: int, sign: float, a: float, b: float, c: float,
         linear: Linear) -> float:
    """The largest of `sign` times POWER or SHAFT about a < b < c, b the largest of the three: the vertex of a parabola
    through them, and of one through closer points about that.
    """
    largest = -math.inf
    for closer in range(2):
        p = sign * power_and_shaft(rows, degree, unit, a, linear)[which]
        q = sign * power_and_shaft(rows, degree, unit, b, linear)[which]
        r = sign * power_and_shaft(rows, degree, unit, c, linear)[which]
        left, right = (q - p) / (b - a), (r - q) / (c - b)
        bend = (right - left) / (c - a)
        largest = max(largest, max(p, q, r))
        if not bend < 0.0:
            break
        vertex = min(max(0.5 * (a + b) - 0.5 * left / bend, a), c)
        if closer:
            largest = max(largest, sign * power_and_shaft(rows, degree, unit, vertex, linear)[which])
        low, high, apart = a, c, (c - a) / 16.0
        b = min(max(vertex, low + apart), high - apart)
        a, c = b - apart, b + apart
    return largest


@fast
def keep_loads(loads: Any, rows: Any, degree: int, unit: float, x: float, cut: float, cycle: int,
               linear: Linear) -> None:
    """Add a step over [0, x], which the end of the engine cycle cuts at `cut` (beyond x: not at all), to the records of
    LOADS from `cycle` on, as far as there are any and they are wanted.
    """
    if loads is not None:
        if loads[cycle].wanted > 0.0:
            add_part(rows, degree, unit, 0.0, min(x, cut), linear, loads[cycle])
        if cut < x and loads[cycle + 1].wanted > 0.0:
            add_part(rows, degree, unit, cut, x, linear, loads[cycle + 1])


@fast
def add_part(rows: Any, degree: int, unit: float, start: float, end: float, linear: Linear, load: Any) -> None:
    """Add the part [start, end] of a step to a cycle's record of LOADS."""
    width = end - start
    power, shaft = power_and_shaft(rows, degree, unit, start, linear)
    energy, most, high, low, least = WEIGHTS[0] * power, power, shaft, shaft, power
    at_power, at_high, at_low = 0, 0, 0
    for i in range(1, LAST + 1):
        power, shaft = power_and_shaft(rows, degree, unit, start + POINTS[i] * width, linear)
        energy += WEIGHTS[i] * power
        least = min(least, power)
        if power > most:
            most, at_power = power, i
        if shaft > high:
            high, at_high = shaft, i
        if shaft < low:
            low, at_low = shaft, i
    load.energy += width * unit * energy
    room = ROOM * (high - low)
    if most + ROOM * (most - least) > load.peak_power:
        a, b, c = around(start, width, at_power)
        load.peak_power = max(load.peak_power, near(rows, degree, unit, POWER, 1.0, a, b, c, linear))
    if high + room > load.highest_shaft_torque:
        a, b, c = around(start, width, at_high)
        load.highest_shaft_torque = max(load.highest_shaft_torque,
                                        near(rows, degree, unit, SHAFT, 1.0, a, b, c, linear))
    if low - room < load.lowest_shaft_torque:
        a, b, c = around(start, width, at_low)
        load.lowest_shaft_torque = min(load.lowest_shaft_torque,
                                       -near(rows, degree, unit, SHAFT, -1.0, a, b, c, linear))


@fast
def around(start: float, width: float, at: int) -> tuple[float, float, float]:
    """A point of the rule between its neighbours; an end of the part has the one inside for the middle."""
    at = min(max(at, 1), LAST - 1)
    return start + POINTS[at - 1] * width, start + POINTS[at] * width, start + POINTS[at + 1] * width
