"""Power series of a slip arc with mu_k < mu_s: coefficients by recurrence, to high order, with a step from their decay.

J. D. Lambert's automatic Taylor method as A. Jorba and M. Zou (Experimental Mathematics 14, 2005) run it: with
E = exp(-alpha |v|), E' = -alpha |v|' E gives the coefficients of E one by one beside those of the state.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.solvers.compiled import compiled
from tcc_sim.solvers.event_arcs import (
    C23,
    ENGINE,
    FIRST_INPUT,
    I1,
    I2,
    K23,
    LOAD,
    LOAD_INDEX,
    PER_INPUT,
    TM,
    TSM,
    Floats,
)

ORDER = 20


@compiled
def fill_sines(u: float, mean: float, which: int, inputs: Floats, out: Floats) -> None:
    """Coefficients of mean + sum of sines at u, into out (order + 1,)."""
    for i in range(len(out)):
        out[i] = 0.0
    out[0] = mean
    for j in range(FIRST_INPUT, len(inputs), PER_INPUT):
        re, im = inputs[j + which], inputs[j + which + 1]
        if re != 0.0 or im != 0.0:
            w = inputs[j]
            x = w * u + inputs[j + 2]
            sine, cosine = np.sin(x), np.cos(x)
            a, b = re * sine + im * cosine, re * cosine - im * sine
            for i in range(len(out)):
                out[i] += a
                factor = w / (i + 1.0)
                a, b = factor * b, -factor * a


@compiled
def expand(u: float, sign: float, speed: float, angle: float, rate: float, stribeck: Any, inputs: Floats,
           scale: float, tolerance: float, series: Floats, work: Floats) -> float:
    """Fill series (3, order + 1): |v| in row 0, theta2 in row 2. Returns the step.

    The last terms kept are below `tolerance` times the largest term of |v|, and times `scale` (rad/s) in theta2'.
    """
    order = series.shape[1] - 1
    engine, load, fade, plate = work[0], work[1], work[2], work[3]
    fill_sines(u, inputs[TM], ENGINE, inputs, engine)
    fill_sines(u, inputs[TSM], LOAD, inputs, load)
    excess, decay = stribeck[0], stribeck[1]
    v, q = series[0], series[2]
    v[0], q[0], plate[0] = sign * speed, angle, rate
    fade[0] = np.exp(-decay * v[0])
    steady = inputs[LOAD_INDEX] < 0.0
    flywheel, inertia, damping, stiffness = inputs[I1], inputs[I2], inputs[C23], inputs[K23]
    for i in range(order):
        grip = load[0] * fade[i]
        if not steady:
            for k in range(1, i + 1):
                grip += load[k] * fade[i - k]
        friction = sign * (load[i] + excess * grip)
        n = i + 1.0
        plate[i + 1] = (friction - damping * plate[i] - stiffness * q[i]) / (inertia * n)
        q[i + 1] = plate[i] / n
        v[i + 1] = sign * ((engine[i] - friction) / (flywheel * n) - plate[i + 1])
        total = 0.0
        for k in range(i + 1):
            total += (k + 1.0) * v[k + 1] * fade[i - k]
        fade[i + 1] = -decay * total / n
    step = np.inf
    for last in (order - 1, order):
        if plate[last] != 0.0:
            step = min(step, (tolerance * scale / abs(plate[last])) ** (1.0 / last))
        if v[last] != 0.0:
            best = 0.0
            for i in range(4):
                if v[i] != 0.0:
                    best = max(best, (tolerance * abs(v[i] / v[last])) ** (1.0 / (last - i)))
            step = min(step, best)
    return step


@compiled
def measure(step: float, series: Floats) -> tuple[float, float]:
    """Bounds over [0, step] of the fourth derivative and of the size of row 0."""
    bend, size, power = 0.0, 0.0, 1.0
    order = series.shape[1] - 1
    for i in range(order + 1):
        size += abs(series[0, i]) * power
        power *= step
    power = 1.0
    for i in range(4, order + 1):
        bend += i * (i - 1.0) * (i - 2.0) * (i - 3.0) * abs(series[0, i]) * power
        power *= step
    return bend, size
