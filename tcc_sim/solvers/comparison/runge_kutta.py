"""The classical fixed-step Runge-Kutta method of order 4, for contrast: it needs steps below about 2.8/(beta Ts sigma).
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from tcc_sim.solvers import SOLVERS
from tcc_sim.solvers.compiling.compiled import accelerations, compiled
from tcc_sim.solvers.compiling.compiled import smoothed as smoothed_coefficient
from tcc_sim.solvers.excitation import piece_at, torques_now
from tcc_sim.solvers.per_cycle import cycles_from_samples
from tcc_sim.solvers.problem import Problem, assemble
from tcc_sim.solvers.terms import Terms, piece_of, stick_speed_of, terms_of
from tcc_sim.trajectory import Floats, Statistics, Status, Trajectory, concatenated

STEPS = 2_000_000_000
"""Most steps of one solve."""
KEPT_PER_CYCLE = 4096
"""States kept per cycle for its extremes and stick time; every state where there are fewer."""


def rk4(problem: Problem) -> Trajectory:
    """Classical Runge-Kutta (Kutta 1901) with equal steps of at most `problem.step` between the times to keep.

    A blow-up, which is what too large a step gives, ends with Status.NOT_FINITE at the last finite sample.
    """
    terms = terms_of(problem.system)
    step = SOLVERS["rk4"].default if problem.step is None else problem.step
    cycle = problem.system.cycle
    y, width = np.array([*problem.state.numbers, problem.state.flywheel_angle]), len(problem.first)
    samples = problem.sample_times()
    total = (problem.end - problem.start) / step
    if total > STEPS:
        return assemble(problem, "rk4", samples[:1], y[None, :width], status=Status.REFUSED,
                        detail=f"{total:.3g} steps of {step:g} s are more than {STEPS:.3g}")
    ends, breaks = problem.cycle_starts(), problem.breaks()[1:-1]
    stick_speed = stick_speed_of(terms)
    _advance(problem.start, step, 0, 1, y.copy(), terms, np.empty((1, 7)))
    began = time.perf_counter()
    kept, found, steps, status = [(samples[0], y.copy())], [], 0, Status.DONE
    for n in range(len(ends)):
        low = ends[n]
        high = ends[n + 1] if n + 1 < len(ends) else samples[-1]
        if not low < high:
            continue
        inner = np.union1d(samples, breaks)
        marks = np.append(inner[(inner > low) & (inner < high)], high)
        rows = []
        for a, b in zip(np.concatenate([[low], marks[:-1]]), marks):
            count = max(math.ceil((b - a) / step * (1.0 - 1e-12)), 1)
            stride = max(math.ceil(count * cycle / (b - a) / KEPT_PER_CYCLE), 1)
            out = np.empty(((count - 1) // stride + 2, 7))
            used = _advance(a, (b - a) / count, count, stride, y, piece_of(terms, a, b), out)
            steps += count
            out[used - 1, 0] = b
            rows.append(out[:used - 1])
            if not np.all(np.isfinite(y)):
                status = Status.NOT_FINITE
                break
            kept.append((b, y.copy()))
        if status is not Status.DONE:
            break
        rows.append(out[used - 1:used])
        if n + 1 < len(ends):
            r = np.concatenate(rows)
            found.append(cycles_from_samples(r[:, 0], r[:, 1], r[:, 4], r[:, 2], r[:, 3], r[:, 5],
                                             starts=ends[n:n + 2], stick_speed=stick_speed,
                                             linear=terms.linear))
    wanted = np.isin([t for t, _ in kept], samples)
    wanted[-1] = True
    t = np.array([t for t, _ in kept])[wanted]
    states = np.array([row for _, row in kept])[wanted, :width]
    return assemble(problem, "rk4", t, states, cycles=concatenated(found) if found else None, status=status,
                    statistics=Statistics(steps=steps, seconds=time.perf_counter() - began))


@compiled
def slopes(t: float, v: float, plate_angle: float, plate_speed: float, terms: Any) -> tuple[float, float]:
    """v' and omega2' of (2) with the smoothed law (7), rad/s^2; `terms` are Terms."""
    engine, load = torques_now(t, piece_at(terms.course, t), terms.course, terms)
    friction = smoothed_coefficient(v, terms.smoothing, terms.stribeck) * load
    return accelerations(plate_angle, plate_speed, engine, friction, terms.linear)  # type: ignore[no-any-return]


@compiled
def rates(t: float, y: Floats, terms: Any, out: Floats) -> None:
    """y' of (1), (2) into `out`; y is (slip speed, plate angle, plate speed[, flywheel angle])."""
    out[0], out[2] = slopes(t, y[0], y[1], y[2], terms)
    out[1] = y[2]
    if len(y) > 3:
        out[3] = y[0] + y[2]


@compiled
def _advance(start: float, h: float, count: int, stride: int, y: Floats, terms: Terms, out: Floats) -> int:
    """Take `count` steps in place.

    Fills rows (t, v, theta2, omega2, v', omega2', theta1), every `stride` steps and at the end; returns their number.
    """
    v, q, w, f = y[0], y[1], y[2], y[3]
    used = 0
    for i in range(count + 1):
        t = start + i * h
        a1, b1 = slopes(t, v, q, w, terms)
        if i % stride == 0 or i == count:
            out[used, 0] = t
            out[used, 1] = v
            out[used, 2] = q
            out[used, 3] = w
            out[used, 4] = a1
            out[used, 5] = b1
            out[used, 6] = f
            used += 1
        if i == count:
            break
        v2, w2 = v + 0.5 * h * a1, w + 0.5 * h * b1
        a2, b2 = slopes(t + 0.5 * h, v2, q + 0.5 * h * w, w2, terms)
        v3, w3 = v + 0.5 * h * a2, w + 0.5 * h * b2
        a3, b3 = slopes(t + 0.5 * h, v3, q + 0.5 * h * w2, w3, terms)
        v4, w4 = v + h * a3, w + h * b3
        a4, b4 = slopes(t + h, v4, q + h * w3, w4, terms)
        f += h / 6.0 * (v + w + 2.0 * (v2 + w2 + v3 + w3) + v4 + w4)
        q += h / 6.0 * (w + 2.0 * (w2 + w3) + w4)
        v += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        w += h / 6.0 * (b1 + 2.0 * (b2 + b3) + b4)
    y[0], y[1], y[2], y[3] = v, q, w, f
    return used
