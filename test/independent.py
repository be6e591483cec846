"""Oracles of the tests by SciPy, on the equations that `study.benchmarks.references` writes out: motions of either law,
derivatives of the map from cycle to cycle, and multipliers of periodic motions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import odeint, solve_ivp

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.parameters import System, replace
from tcc_sim.study.benchmarks.references import Law
from tcc_sim.trajectory import Floats

Rates = Callable[[float, Any], list[float]]
Jacobian = Callable[[float, Any], list[list[float]]]


class Piecewise(Law):
    """A run of the set-valued law from the system's initial state by SciPy's DOP853 from event to event."""

    def __init__(self, system: System, rtol: float = 1e-12, atol: float = 1e-13, drag: float = 0.0) -> None:
        super().__init__(replace(system, {"friction.law": "set_valued"}), drag=drag)
        self.rtol, self.atol = rtol, atol

    def run(self, end: float, times: Any, slices: int = 200) -> tuple[Floats, list[tuple[float, int, int]], float]:
        """Return states at `times` (n, 4), transitions (time, mode before, mode after), and the time in stick, s;
        steps are of end/slices at most.
        """
        i = self.system.initial
        y, t, stuck = np.array([i.slip_speed, i.plate_angle, i.plate_speed, i.plate_angle]), 0.0, 0.0
        out, changes = np.empty((len(times), 4)), []
        for _, mode, run, _, after in self.arcs(y, [end], "DOP853", self.rtol, self.atol, end / slices, len(times) > 0):
            new = float(run.t[-1])
            inside = (times >= t) & (times <= new)
            if inside.any():
                out[inside] = run.sol(times[inside]).T[:, :4]
            stuck += new - t if mode == 0 else 0.0
            if after != mode:
                changes.append((new, mode, after))
            t = new
        return out, changes, stuck


def equations(system: System, drag: float = 0.0) -> tuple[Rates, Jacobian]:
    """Return the rates of the smoothed law at a time and state (4,), and their Jacobian; `drag` as in Law."""
    law = Law(system, drag=drag)
    return partial(law.rates, mode=3), partial(law.jacobian, mode=3)


def smoothed_scales(system: System) -> Floats:
    """Return the magnitudes below which errors of the four states are absolute."""
    return np.array([1.0 / max(1.0, system.friction.smoothing / 50.0), 1e-2, 1.0, 0.1])


def smoothed_states(system: System, state: Sequence[float], cycles: int, per_cycle: int, rtol: float = 1e-12,
                    drag: float = 0.0) -> Floats:
    """Return the states of the smoothed law by LSODA from a state (4,) at `per_cycle` samples a cycle, (n, 4)."""
    rates, jacobian = equations(system, drag)
    rows: list[Floats] = [np.array(state, dtype=float)[None]]
    for n in range(cycles):
        t = (n + np.arange(per_cycle + 1) / per_cycle) * system.cycle
        rows.append(odeint(rates, rows[-1][-1], t, Dfun=jacobian, tfirst=True, rtol=rtol, mxstep=100_000,
                           atol=smoothed_scales(system) * rtol)[1:])
    return np.vstack(rows)


def smoothed_run(system: System, state: Sequence[float], cycles: int, per_cycle: int, stick_speed: float) -> tuple[
        Floats, list[tuple[float, int, int]], float]:
    """Return for the smoothed law as `Piecewise.run`, with the transitions through a stick speed, rad/s."""
    rates, jacobian = equations(system)
    edges = [lambda t, y: y[0] - stick_speed, lambda t, y: y[0] + stick_speed]
    solution = solve_ivp(rates, (0.0, cycles * system.cycle), state, "LSODA", rtol=1e-12, jac=jacobian, events=edges,
                         atol=smoothed_scales(system) * 1e-12)
    changes = sorted((float(u), *((0, side) if rates(u, x)[0] * side > 0.0 else (side, 0)))
                     for side, times, states in zip((1, -1), solution.t_events, solution.y_events)
                     for u, x in zip(times, states))
    marks = [0.0, *(u for u, _, _ in changes), cycles * system.cycle]
    modes = [0 if abs(state[0]) <= stick_speed else 1, *(after for _, _, after in changes)]
    stuck = sum(b - a for a, b, mode in zip(marks, marks[1:], modes) if mode == 0)
    return smoothed_states(system, state, cycles, per_cycle), changes, stuck


def tangent_map(system: System, x: Any, start: float, cycles: float, rtol: float = 1e-11,
                by: Callable[[float], System] | None = None) -> tuple[Floats, Floats]:
    """Return the state (3,) of the smoothed law some cycles after `start` cycles, and its derivatives by the state and,
    last, by a number of which `by(k)` is the system moved by k steps of one unit, at constant phase; from the
    variational equations.
    """
    rates, jacobian = equations(system)
    cycle, columns = system.cycle, 3 if by is None else 4
    moved = [] if by is None else [(k, equations(by(n))[0], by(n).cycle / 12.0)
                                   for n, k in ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0))]

    def right(phase: float, z: Floats) -> list[float]:  # Phase in cycles: a varied frequency leaves the sines in place.
        y, (a, _, b, _) = z[:3].tolist(), jacobian(phase * cycle, z)
        out, tangent = [cycle * rate for rate in rates(phase * cycle, y)[:3]], z[3:].tolist()
        first, second, third = tangent[:columns], tangent[columns:2 * columns], tangent[2 * columns:]
        extra = [[0.0] * columns for _ in range(3)]
        for k, of, length in moved:
            for row, rate in zip(extra, of(phase * length * 12.0, y)):
                row[3] += k * length * rate
        out += [cycle * (a[0] * p + a[1] * q + a[2] * r) + s for p, q, r, s in zip(first, second, third, extra[0])]
        out += [cycle * r + s for r, s in zip(third, extra[1])]
        out += [cycle * (b[0] * p + b[1] * q + b[2] * r) + s for p, q, r, s in zip(first, second, third, extra[2])]
        return out

    def steering(phase: float, z: Floats) -> Floats:  # Terms that it omits only steer LSODA's Newton iteration.
        a = np.array(jacobian(phase * cycle, z))[:3, :3] * cycle
        out = np.zeros((len(z), len(z)))
        out[:3, :3], out[3:, 3:] = a, np.kron(a, np.eye(columns))
        return out

    initial = np.concatenate([x, np.eye(3, columns).ravel()])
    end = odeint(right, initial, [start, start + cycles], Dfun=steering, tfirst=True, rtol=rtol, atol=1e-2 * rtol,
                 mxstep=100_000)[-1]
    return end[:3], end[3:].reshape(3, columns)


def multipliers(system: System, x: Any, cycles: int) -> Any:
    """Return the Floquet multipliers of the periodic motion through x (3,) at phase 0: from variational equations, or
    under the set-valued law from differences of fourth order of the motion from event to event.

    Raises
    ------
    NumericalFailure
        The motion does not close to 1e-7.
    """
    if system.friction.law == "smoothed":
        end, matrix = tangent_map(system, x, 0, cycles)
    else:
        def moved(y: Floats) -> Floats:
            start = dict(zip(("initial.slip_speed", "initial.plate_angle", "initial.plate_speed"), map(float, y)))
            length = cycles * system.cycle
            return Piecewise(replace(system, start)).run(length, np.array([length]), slices=12 * cycles)[0][-1, :3]

        end, held = moved(x), int(x[0] == 0.0)  # In stick the map is one of plate angle and speed.
        columns = []
        for h in np.diag((1e-3, 1e-5, 1e-3))[held:]:
            behind, before, after, ahead = (moved(x + k * h)[held:] for k in (-2.0, -1.0, 1.0, 2.0))
            columns.append((8.0 * (after - before) - (ahead - behind)) / (12.0 * h.max()))
        matrix = np.column_stack(columns)
    if not np.allclose(end, x, rtol=1e-7, atol=1e-7):
        raise NumericalFailure(f"the motion through {x} ends at {end}")
    return np.linalg.eigvals(matrix)
