"""Power series of a slip arc with mu_k < mu_s: coefficients by recurrence, to high order, with a step from their decay.

J. D. Lambert's automatic Taylor method as A. Jorba and M. Zou (Experimental Mathematics 14, 2005) run it: with
E = exp(-alpha |v|), E' = -alpha |v|' E gives the coefficients of E one by one beside those of the state.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.solvers.compiled import compiled
from tcc_sim.solvers.event_driven.arcs import (
    C23,
    ENGINE,
    FIRST_INPUT,
    I1,
    I2,
    K23,
    LOAD,
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
    engine, load, fade, plate, slope = work[0], work[1], work[2], work[3], work[4]
    fill_sines(u, inputs[TM], ENGINE, inputs, engine)
    fill_sines(u, inputs[TSM], LOAD, inputs, load)
    excess, decay = stribeck[0], stribeck[1]
    v, q = series[0], series[2]
    v[0], q[0], plate[0] = sign * speed, angle, rate
    fade[0] = np.exp(-decay * v[0])
    damping, stiffness, per_flywheel, per_inertia = inputs[C23], inputs[K23], 1.0 / inputs[I1], 1.0 / inputs[I2]
    for i in range(order):
        # Two sums of each kind: one long sum would wait for every addition in turn.
        grip, grip1, total, total1 = load[0] * fade[i], 0.0, 0.0, 0.0
        for k in range(0, i - 1, 2):
            grip += load[k + 1] * fade[i - 1 - k]
            total += slope[k] * fade[i - k]
            grip1 += load[k + 2] * fade[i - 2 - k]
            total1 += slope[k + 1] * fade[i - 1 - k]
        if i % 2 == 1:
            grip += load[i] * fade[0]
            total += slope[i - 1] * fade[1]
        friction = sign * (load[i] + excess * (grip + grip1))
        part = 1.0 / (i + 1.0)
        bend = (friction - damping * plate[i] - stiffness * q[i]) * per_inertia
        plate[i + 1] = bend * part
        q[i + 1] = plate[i] * part
        slope[i] = sign * ((engine[i] - friction) * per_flywheel - bend)
        v[i + 1] = slope[i] * part
        fade[i + 1] = -decay * part * (total + total1 + slope[i] * fade[0])
    step = np.inf
    for last in (order - 1, order):
        if plate[last] != 0.0:
            step = min(step, (tolerance * scale / abs(plate[last])) ** (1.0 / last))
        if v[last] != 0.0:
            best = 0.0
            for i in range(4 if decay * v[0] < 0.1 else 1):
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
