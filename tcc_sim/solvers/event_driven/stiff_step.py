"""Steps of an arc whose damper is far faster than everything else: collocation at the nodes of Radau IIA.

A Taylor series of an overdamped plate is held to steps of a few I2/C23 for as long as the arc lasts. Collocation is
held to them only while the fast part dies down (E. Hairer and G. Wanner, Solving Ordinary Differential Equations II,
Sec. IV.5). It leaves a polynomial as well, so events and output are those of every other step.
"""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.collocation import chebyshev_to_powers, radau, to_chebyshev
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.event_driven.setup import Bounds
from tcc_sim.solvers.event_driven.step import DOWNWARD, NO_EVENT, UPWARD, Step, slip_event, stick_event
from tcc_sim.solvers.series import ANGLE, SLIP, SPEED
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import FREE, STICK

NODES = 8
"""Nodes, and degree of the polynomials: the powers of more would lose digits. The order at the end of a step is 15."""
LAST_TERM = 2.0 ** (1 - 2 * NODES)
"""Coefficient of a polynomial in Chebyshev's form over [0, 1] for its last one in powers."""
LEAST_TRUNCATION = 1e-11
"""Rounding of the last coefficient, of the size of the signal, behind a matrix of the condition of C23 h A/I2."""
NEWTON_MAXIMUM = 30
SHORTEST = 1e-9
"""Shortest step, of the time that the fast part takes to die down."""

UNKNOWN_SLIP, UNKNOWN_SPEED, PLATE, TORQUE, FRICTION, SLOPE, LOAD_NODES, RESIDUAL = range(8)
"""Rows of the values at the nodes."""
VALUES = (8, NODES)
MATRICES = (3, NODES, NODES + 1)
"""Work space: the plate's response to forces, Newton's matrix with its right side, and a copy."""


C, A = radau(NODES)
POWERS = chebyshev_to_powers(NODES).T @ to_chebyshev(C)
"""Powers of the time in a step from the values at its start and at the nodes."""
SQUARED = A @ A


@fast
def solve_linear(m: Any, which: int) -> bool:
    """Solve the (n, n + 1) system in m[which] by elimination with pivots; the solution takes the last column."""
    for k in range(NODES):
        best = k
        for i in range(k + 1, NODES):
            if abs(m[which, i, k]) > abs(m[which, best, k]):
                best = i
        if not abs(m[which, best, k]) > 0.0:
            return False
        for j in range(NODES + 1):
            m[which, k, j], m[which, best, j] = m[which, best, j], m[which, k, j]
        for i in range(NODES):
            if i != k:
                factor = m[which, i, k] / m[which, k, k]
                for j in range(k, NODES + 1):
                    m[which, i, j] -= factor * m[which, k, j]
    for i in range(NODES):
        m[which, i, NODES] /= m[which, i, i]
    return True


@fast
def plate_speeds(h: float, inertia: float, linear: Linear, x0: float, u0: float, at: Any, m: Any) -> bool:
    """Row UNKNOWN_SPEED for the forces in row FRICTION: (I + h C/m A + h^2 K/m A^2) U = u0 + h/m A (F - K x0)."""
    for i in range(NODES):
        m[2, i, NODES] = u0
        for j in range(NODES):
            m[2, i, NODES] += h / inertia * A[i, j] * (at[FRICTION, j] - linear[3] * x0)
            m[2, i, j] = h / inertia * (linear[2] * A[i, j] + linear[3] * h * SQUARED[i, j])
        m[2, i, i] += 1.0
    if not solve_linear(m, 2):
        return False
    for i in range(NODES):
        at[UNKNOWN_SPEED, i] = m[2, i, NODES]
        at[PLATE, i] = x0
    for i in range(NODES):
        for j in range(NODES):
            at[PLATE, i] += h * A[i, j] * at[UNKNOWN_SPEED, j]
    return True


@fast
def friction_response(h: float, linear: Linear, m: Any) -> None:
    """m[0]: how the slip speed at the nodes falls with the friction at the nodes: h A/I1 + (I + ...)^-1 h A/I2."""
    for column in range(NODES):
        for i in range(NODES):
            for j in range(NODES):
                m[2, i, j] = h / linear[1] * (linear[2] * A[i, j] + linear[3] * h * SQUARED[i, j])
            m[2, i, i] += 1.0
            m[2, i, NODES] = h / linear[1] * A[i, column]
        solve_linear(m, 2)
        for i in range(NODES):
            m[0, i, column] = m[2, i, NODES] + h / linear[0] * A[i, column]


@fast
def slip_speeds(h: float, linear: Linear, sign: float, stribeck: Stribeck, v0: float, x0: float, u0: float,
                tolerance: float, at: Any, m: Any) -> bool:
    """Rows UNKNOWN_SLIP, UNKNOWN_SPEED, PLATE of a step in slip: Newton's method on the slip speeds at the nodes."""
    for i in range(NODES):
        at[UNKNOWN_SLIP, i] = v0
    if stribeck is not None:
        friction_response(h, linear, m)
    for _ in range(NEWTON_MAXIMUM):
        for i in range(NODES):
            at[FRICTION, i] = sign * at[LOAD_NODES, i]
            at[SLOPE, i] = 0.0
            if stribeck is not None:
                excess = stribeck[0] * math.exp(-stribeck[1] * max(sign * at[UNKNOWN_SLIP, i], -1.0 / stribeck[1]))
                steep = stribeck[1] * excess
                for j in range(2, len(stribeck), 2):
                    rate = stribeck[j + 1]
                    share = stribeck[j] * math.exp(-rate * max(sign * at[UNKNOWN_SLIP, i], -1.0 / rate))
                    excess += share
                    steep += rate * share
                at[SLOPE, i] = -steep * at[LOAD_NODES, i] * abs(sign)
                at[FRICTION, i] *= 1.0 + excess
        if not plate_speeds(h, linear[1], linear, x0, u0, at, m):
            return False
        size = 0.0
        for i in range(NODES):
            new = v0 - (at[UNKNOWN_SPEED, i] - u0)
            for j in range(NODES):
                new += h * A[i, j] * (at[TORQUE, j] - at[FRICTION, j]) / linear[0]
            at[RESIDUAL, i] = new - at[UNKNOWN_SLIP, i]
            size = max(size, abs(at[RESIDUAL, i]))
        if stribeck is None:
            for i in range(NODES):
                at[UNKNOWN_SLIP, i] += at[RESIDUAL, i]
            return True
        else:
            for i in range(NODES):
                for j in range(NODES):
                    m[1, i, j] = m[0, i, j] * at[SLOPE, j]
                m[1, i, i] += 1.0
                m[1, i, NODES] = at[RESIDUAL, i]
            if not solve_linear(m, 1):
                return False
            for i in range(NODES):
                at[UNKNOWN_SLIP, i] += m[1, i, NODES]
            if size <= tolerance:
                return True
    return False


@fast
def to_powers(rows: Any, row: int, start: float, at: Any, which: int) -> float:
    """Fill a row with the polynomial through `start` at 0 and a row of values; returns the size of its last term."""
    for k in range(NODES + 1):
        rows[row, k] = 0.0
        for i in range(NODES):
            rows[row, k] += POWERS[k, i + 1] * (at[which, i] - start)
    rows[row, 0] = start
    return float(LAST_TERM * abs(rows[row, NODES]))


@fast
def torques_at_nodes(mean_torque: float, waves: Any, mean_load: float, pulsation: tuple[float, float, float] | None,
                     h: float, state: Any, at: Any) -> None:
    """Rows TORQUE and LOAD_NODES of a step of h seconds."""
    for i in range(NODES):
        t = state.tau + C[i] * h
        at[TORQUE, i] = mean_torque
        for k in range(waves.shape[0]):
            at[TORQUE, i] += waves[k].amplitude * math.sin(waves[k].rate * t + waves[k].phase)
        at[LOAD_NODES, i] = mean_load
        if pulsation is not None:
            at[LOAD_NODES, i] += pulsation[0] * math.sin(pulsation[1] * t + state.shift)


@fast
def polynomials(bounds: Bounds, state: Any, rows: Any, at: Any) -> float:
    """Fill the rows with the polynomials through the values at the nodes; returns their last terms, 1 where they are
    as large as they may be.
    """
    goal = max(bounds.truncation, LEAST_TRUNCATION)
    slip, speed = abs(state.slip_speed), abs(state.plate_speed)
    for i in range(NODES):
        slip = max(slip, abs(at[UNKNOWN_SLIP, i]))
        speed = max(speed, abs(at[UNKNOWN_SPEED, i]))
    error = to_powers(rows, SPEED, state.plate_speed, at, UNKNOWN_SPEED) / (goal * max(speed, bounds.creep))
    to_powers(rows, ANGLE, state.plate_angle, at, PLATE)
    if state.mode != STICK:
        last = to_powers(rows, SLIP, state.slip_speed, at, UNKNOWN_SLIP)
        error = max(error, last / (goal * max(slip, bounds.creep)))
    return float(error)


@fast
def breakaway_margins(ratio: float, linear: Linear, state: Any, drive: Any, rows: Any, at: Any) -> None:
    """Rows UPWARD and DOWNWARD of a step in stick: what the torque that holds the disks together is short of the
    breakaway torque.
    """
    inertia = linear[0] + linear[1]
    for row in (UPWARD, DOWNWARD):
        side = -1.0 if row == UPWARD else 1.0
        for i in range(NODES):
            need = (linear[1] * at[TORQUE, i] + linear[0] * (linear[2] * at[UNKNOWN_SPEED, i]
                                                            + linear[3] * at[PLATE, i])) / inertia
            at[RESIDUAL, i] = ratio * at[LOAD_NODES, i] + side * need
        need = (linear[1] * drive.torque + linear[0] * (linear[2] * state.plate_speed
                                                        + linear[3] * state.plate_angle)) / inertia
        to_powers(rows, row, ratio * drive.load + side * need, at, RESIDUAL)


@fast
def stiff_arc(bounds: Bounds, terms: Terms, waves: Any, state: Any, drive: Any, remaining: float, rows: Any, at: Any,
              m: Any, workspace: Any) -> Step:
    """A step of any mode of at most `remaining` seconds, no longer than `state.length`, which it adapts."""
    mode, v0, x0, u0, linear = state.mode, state.slip_speed, state.plate_angle, state.plate_speed, terms.linear
    sign = 0.0 if mode == FREE else float(mode)
    inertia = linear[0] + linear[1] if mode == STICK else linear[1]
    shortest = SHORTEST * inertia / linear[2]
    while True:
        h = min(state.length, remaining)
        torques_at_nodes(terms.mean_torque, waves, terms.mean_load, terms.pulsation, h, state, at)
        if mode == STICK:
            for i in range(NODES):
                at[FRICTION, i] = at[TORQUE, i]
                at[UNKNOWN_SLIP, i] = 0.0
            done = plate_speeds(h, inertia, linear, x0, u0, at, m)
        else:
            done = slip_speeds(h, linear, sign, terms.stribeck, v0, x0, u0, 1e-6 * bounds.slip_tolerance ** 0.5, at, m)
        error = polynomials(bounds, state, rows, at) if done else math.inf
        length = h * min(4.0, max(0.2, 0.8 * max(error, 1e-12) ** (-1.0 / NODES)))
        if error <= 1.0 or h <= shortest:
            state.length = max(length, state.length) if h < state.length else length
            break
        state.length = length
    if not error < math.inf:
        return Step(h, math.nan, NODES, NO_EVENT, 0, 0.0)
    if mode == STICK:
        for k in range(NODES + 1):
            rows[SLIP, k] = 0.0
        breakaway_margins(bounds.ratio, linear, state, drive, rows, at)
        return stick_event(bounds, h, 1.0, NODES, rows, workspace)
    if state.at_rest == 1:
        friction = sign * bounds.ratio * drive.load
        rate = (drive.torque - friction) / linear[0] - (friction - linear[2] * u0 - linear[3] * x0) / linear[1]
        rows[SLIP, 1] = sign * max(sign * rows[SLIP, 1], 0.0) if sign * rate >= -bounds.steepest else rate * h
    return slip_event(bounds, h, 1.0, NODES, 0.0, state, rows, workspace)
