"""Loads of clutch and shaft in a step: work and power of the friction torque, and the torque in the shaft.

(2b) gives the friction torque from the polynomials of the plate's motion, Tf = I2 theta2'' + C23 theta2' + K23 theta2
+ p_v v (`model.equations.Linear`), under any law and in any mode. Integrals over a step are sums by the rule of Lobatto
with eight points, exact for polynomials up to degree thirteen (M. Abramowitz and I. A. Stegun (1964), 25.4.32). The
first row of the workspace, the hull of the step, is not changed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import fast
from tcc_sim.compiling.unrolled import unrolled, where
from tcc_sim.model.equations import Linear
from tcc_sim.polynomials.bernstein import PER_BINOMIAL
from tcc_sim.solvers.problem import Problem
from tcc_sim.solvers.series import ANGLE, SLIP, SPEED
from tcc_sim.trajectory import Loads

LOADS = np.dtype([("energy", np.float64), ("peak_power", np.float64), ("highest_shaft_torque", np.float64),
                  ("lowest_shaft_torque", np.float64), ("breakaways", np.float64), ("coupling_energy", np.float64),
                  ("wanted", np.float64)])
"""An engine cycle: the fields of `Loads`, and 1 where they are computed."""

COUNT = 8
POINTS = np.array([0.0, 0.06412992574519669, 0.20414990928342885, 0.3953503910487606,
                   0.6046496089512394, 0.7958500907165712, 0.9358700742548033, 1.0])
WEIGHTS = np.array([0.017857142857142856, 0.10535211357175302, 0.17056134624175218, 0.20622939732935194,
                    0.20622939732935194, 0.17056134624175218, 0.10535211357175302, 0.017857142857142856])
"""Abscissae and weights of the rule on [0, 1]."""
PLACE, POWER, SHAFT, CLOSER, SQUARE = 1, 2, 3, 3, 7
"""Rows of the workspace: places in a step, power and torque there; CLOSER rows further on the same, closer together;
the square of the slip speed at the last of these places.
"""
MARGIN = 0.1
"""Largest distance of an extreme from the values at the points, relative to their range."""
SHIFTS = 16
"""Most shifts of the closer places; fourteen take them from one end of their range to the other."""


def empty_loads(problem: Problem) -> NDArray[Any]:
    """Return records of LOADS for the cycles of a run and the rest behind them."""
    out = np.empty(problem.whole_cycles + 2, LOADS)
    begin_loads(out, problem.loads_from)
    return out


def begin_loads(records: NDArray[Any], first: int | None) -> None:
    """Reset records of LOADS of engine cycles (last axis), which are wanted from cycle `first` on; None for nowhere."""
    records[:] = np.zeros((), LOADS)
    records["highest_shaft_torque"], records["lowest_shaft_torque"] = -math.inf, math.inf
    if first is not None:
        records["wanted"][..., first:] = 1.0


def loads_of(records: NDArray[Any], problem: Problem, first: int, end: int) -> Loads | None:
    """Return the loads of the cycles `first` to `end` of a run, from their records; None if none are wanted."""
    if problem.loads_from is None:
        return None
    columns = records[first:end].view(np.float64).reshape(end - first, LOADS.itemsize // 8)[:, :-1].T.copy()
    columns[:, :max(problem.loads_from - first, 0)] = math.nan
    return Loads(*columns)


def staged_loads(lanes: int) -> Any:
    """Return the staged function of `evaluate_loads` for degrees below `lanes`."""
    def staged(rows: Any, per_binomial: Any, unit: Any, linear: Linear, places: Any, power: Any, shaft: Any,
               square: Any) -> None:
        x = places.row(0, count=COUNT)
        v, angle, speed, rise = 0.0, 0.0, 0.0, 0.0
        for i in range(lanes - 8, -1, -8):
            inside = per_binomial.row(i, count=8)
            a, b, c = (where(inside, ">", 0.0, rows.row(row, i, count=8), 0.0) for row in (SLIP, ANGLE, SPEED))
            for k in range(7, -1, -1):
                rise = x * rise + speed
                v, angle, speed = x * v + a[k], x * angle + b[k], x * speed + c[k]
        torque = speed * linear.damping + angle * linear.stiffness
        shaft.set_row(torque, 0)
        friction = rise * (linear.plate / unit) + torque
        if linear.plate_by_slip is not None:
            friction = friction + v * linear.plate_by_slip
            square.set_row(v * v, 0)
        power.set_row(friction * v, 0)

    return staged


loads_24, loads_32 = unrolled(staged_loads(24)), unrolled(staged_loads(32))


@fast
def evaluate_loads(rows: Any, degree: int, unit: float, linear: Linear, closer: int, workspace: Any) -> None:
    """Fill power of the friction torque, W, and torque in the shaft, N m, at COUNT places; `closer` is 0 or CLOSER."""
    places, power, shaft = workspace[PLACE + closer], workspace[POWER + closer], workspace[SHAFT + closer]
    if degree < 24:
        loads_24(0, rows, PER_BINOMIAL[degree], unit, linear, places, power, shaft, workspace[SQUARE])
    else:
        loads_32(0, rows, PER_BINOMIAL[degree], unit, linear, places, power, shaft, workspace[SQUARE])


@fast
def largest_near(rows: Any, degree: int, unit: float, which: int, sign: float, at: int, linear: Linear,
                 workspace: Any) -> float:
    """Return the largest of `sign` times POWER or SHAFT, whose value at the place `at` is the largest.

    It is the vertex of a parabola through three closer places, which are about the vertex of one through the places
    next to `at`, and move on as long as their largest value is at their end.
    """
    closer, most, moved = 0, -math.inf, 0
    low, high, middle, apart = 0.0, 0.0, 0.0, 0.0
    while True:
        most = max(most, sign * workspace[which + closer, at])
        towards = -1.0 if at == 0 else 1.0 if at == COUNT - 1 else 0.0
        following = min(max(middle + towards * apart, low + apart), high - apart)
        if closer > 0 and following != middle and moved < SHIFTS:
            middle, moved = following, moved + 1
        else:
            at = min(max(at, 1), COUNT - 2)
            a, b, c = (workspace[PLACE + closer, at - 1], workspace[PLACE + closer, at],
                       workspace[PLACE + closer, at + 1])
            p, q, r = (sign * workspace[which + closer, at - 1], sign * workspace[which + closer, at],
                       sign * workspace[which + closer, at + 1])
            left, right = (q - p) / (b - a), (r - q) / (c - b)
            bend = (right - left) / (c - a)
            vertex = 0.5 * (a + b) - 0.5 * left / bend if bend < 0.0 else math.copysign(math.inf, towards)
            if closer > 0:
                if a < vertex < c:
                    most = max(most, p + (vertex - a) * (left + bend * (vertex - b)))
                return float(most)
            low, high, apart = a, c, (c - a) / 16.0
            middle, closer = min(max(vertex, a + apart), c - apart), CLOSER
        for i in range(COUNT):
            workspace[PLACE + closer, i] = middle + apart * (2.0 * POINTS[i] - 1.0)
        evaluate_loads(rows, degree, unit, linear, closer, workspace)
        at = 0
        for i in range(COUNT):
            if sign * workspace[which + closer, i] > sign * workspace[which + closer, at]:
                at = i


@fast
def wanted(loads: Any, cycle: int) -> bool:
    """Return whether the loads of an engine cycle are computed."""
    if loads is None:
        return False
    else:
        return bool(loads[cycle].wanted > 0.0)


@fast
def keep_loads(loads: Any, rows: Any, degree: int, unit: float, x: float, cut: float, cycle: int,
               linear: Linear, workspace: Any) -> None:
    """Add a step over [0, x] to the records of LOADS, if any, of `cycle` and, behind `cut`, of the next one."""
    if loads is not None:
        if wanted(loads, cycle):
            add_part(rows, degree, unit, 0.0, min(x, cut), linear, loads[cycle], workspace)
        if cut < x and wanted(loads, cycle + 1):
            add_part(rows, degree, unit, cut, x, linear, loads[cycle + 1], workspace)


@fast
def keep_breakaway(loads: Any, cycle: int) -> None:
    """Count a change from stick to slip in a cycle."""
    if loads is not None:
        loads[cycle].breakaways += 1.0


@fast
def add_coupling(load: Any, seconds: float, by_slip: float | None, workspace: Any) -> None:
    """Add the heat of the torque that passes from flywheel to plate beside friction, -p_v v."""
    if by_slip is not None:
        square = 0.0
        for i in range(COUNT):
            square += WEIGHTS[i] * workspace[SQUARE, i]
        load.coupling_energy -= seconds * by_slip * square


@fast
def add_part(rows: Any, degree: int, unit: float, start: float, end: float, linear: Linear, load: Any,
             workspace: Any) -> None:
    """Add the part [start, end] of a step to a cycle's record of LOADS."""
    width = end - start
    if not width > 0.0:
        return
    for i in range(COUNT):
        workspace[PLACE, i] = start + POINTS[i] * width
    evaluate_loads(rows, degree, unit, linear, 0, workspace)
    energy, least = 0.0, math.inf
    most_at, high_at, low_at = 0, 0, 0
    most, high, low = workspace[POWER, 0], workspace[SHAFT, 0], workspace[SHAFT, 0]
    for i in range(COUNT):
        power, shaft = workspace[POWER, i], workspace[SHAFT, i]
        energy += WEIGHTS[i] * power
        least = min(least, power)
        if power > most:
            most, most_at = power, i
        if shaft > high:
            high, high_at = shaft, i
        if shaft < low:
            low, low_at = shaft, i
    load.energy += width * unit * energy
    add_coupling(load, width * unit, linear.plate_by_slip, workspace)
    margin = MARGIN * (high - low)
    if most + MARGIN * (most - least) > load.peak_power:
        load.peak_power = max(load.peak_power,
                              largest_near(rows, degree, unit, POWER, 1.0, most_at, linear, workspace))
    if high + margin > load.highest_shaft_torque:
        load.highest_shaft_torque = max(load.highest_shaft_torque,
                                        largest_near(rows, degree, unit, SHAFT, 1.0, high_at, linear, workspace))
    if low - margin < load.lowest_shaft_torque:
        load.lowest_shaft_torque = min(load.lowest_shaft_torque,
                                       -largest_near(rows, degree, unit, SHAFT, -1.0, low_at, linear, workspace))
