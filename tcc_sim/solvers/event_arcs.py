"""Closed-form arcs of the set-valued law: what the exact engine knows of each mode before it starts, and their evaluation.

On an arc every signal has the form  c0 + c1 tau + sum_k Im(Z_k exp(i (w_k u + phase_k))) + A f(tau) + B g(tau),  where u is
the time since the start of the engine cycle, tau the time since the start of the arc, and f, g the two free motions of the
oscillator of the mode. The Z_k belong to the mode; only c0, A and B change from arc to arc.
"""

from __future__ import annotations

import cmath
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.parameters import System
from tcc_sim.solvers.compiled import compiled
from tcc_sim.solvers.terms import Terms

Floats = NDArray[np.float64]

STICK, POSITIVE, NEGATIVE, FREE = 0, 1, 2, 3
"""Rows of the tables."""
LIGHT, HEAVY, CRITICAL = 0.0, 1.0, 2.0
"""Kinds of damping: f, g are exp(-d tau) cos and sin of wd tau; two real exponentials; or, near critical damping where these
two pairs lose their digits, exp(-d tau) times cos and sin(wd tau)/wd (or cosh and sinh) with g scaled to stay below 1."""
RESONANT = 1e-8
"""Relative distance kept from an undamped resonance, where sine and free motion lose their digits: the stiffness moves."""


class Tables(NamedTuple):
    """Constants of the four modes; m distinct frequencies. Signal 0 and 1 are watched for events, signal 2 is theta2.

    Slip: signal 0 is |v|. Stick: signals 0 and 1 are r Ts - lambda and r Ts + lambda, N m. Free: signal 0 is v.
    """

    frequency: Floats
    """(m,) rad/s."""
    turns: Floats
    """(m,) frequency/omega, whose fraction sets the phase at the start of a cycle."""
    phase: Floats
    """(m,) phases at the start of the present cycle, rad: workspace of the kernel."""
    phasor: Floats
    """(4, 3, m, 2) real and imaginary parts of Z."""
    mean: Floats
    """(4, 3) constant parts."""
    drift: Floats
    """(4,) c1 of signal 0."""
    mix: Floats
    """(4, 3, 2) free part of a signal = mix[0] x + mix[1] x', x the free part of theta2."""
    oscillator: Floats
    """(4, 13): x' as a matrix on (A, B) (4 entries), kind, decay rates that bound f and g, wd or its like, factor of g,
    moduli of the matrix to the power 4 (4 entries)."""
    size: Floats
    """(4, 2) sums of |Z|."""
    bend: Floats
    """(4, 2) sums of |Z| w^4: bounds of the fourth derivative."""
    engine: Floats
    """(m, 2) phasors of Te."""
    load: Floats
    """(m, 2) phasors of Ts."""
    constants: Floats
    """(9,) I1, I2, C23, K23, Tm, Tsm, Tsp, the phase of the load at t = 0, index of its frequency (-1 for a constant load)."""


def tables_of(system: System, terms: Terms) -> Tables:
    """The tables of a system; sines of one frequency are added up first."""
    omega = system.engine.frequency
    rows: dict[float, list[complex]] = {}
    if terms.torque is not None:
        rows.setdefault(1.0, [0j, 0j])[0] += terms.torque[0]
    if terms.harmonics is not None:
        for frequency, amplitude, phase in terms.harmonics:
            rows.setdefault(float(np.rint(frequency / omega)), [0j, 0j])[0] += cmath.rect(amplitude, phase)
    amplitude, load_phase, index = 0.0, 0.0, -1
    if terms.pulsation is not None:
        amplitude, load_phase = terms.pulsation[0], terms.pulsation[2]
        ratio = system.pressure.frequency_ratio
        rows.setdefault(ratio, [0j, 0j])[1] += cmath.rect(amplitude, load_phase)
        index = list(rows).index(ratio)
    turns = np.array(list(rows), dtype=np.float64)
    w = turns * omega
    engine = np.array([r[0] for r in rows.values()], dtype=np.complex128)
    load = np.array([r[1] for r in rows.values()], dtype=np.complex128)
    i1, i2, c, k = terms.linear
    ratio_s = 1.0 + (terms.stribeck[0] if terms.stribeck is not None else 0.0)
    m = len(w)
    phasor, mean, drift = np.zeros((4, 3, m), np.complex128), np.zeros((4, 3)), np.zeros(4)
    mix, oscillator = np.zeros((4, 3, 2)), np.zeros((4, 13))
    mix[:, 2, 0] = 1.0
    for mode, sign in ((STICK, 0.0), (POSITIVE, 1.0), (NEGATIVE, -1.0), (FREE, 0.0)):
        inertia = i1 + i2 if mode == STICK else i2
        force, constant = (engine, terms.mean_torque) if mode == STICK else (sign * load, sign * terms.mean_load)
        stiffness = _clear_of_resonance(k, c, inertia, w[np.abs(force) > 0.0])
        oscillator[mode] = _oscillator(inertia, c, stiffness)
        angle = force / (stiffness - inertia * w**2 + 1j * c * w)
        phasor[mode, 2], mean[mode, 2] = angle, constant / stiffness
        if mode == STICK:
            interface = (i2 * engine + i1 * (stiffness + 1j * c * w) * angle) / (i1 + i2)
            for j, side in ((0, -1.0), (1, 1.0)):
                phasor[mode, j] = ratio_s * load + side * interface
                mean[mode, j] = ratio_s * terms.mean_load + side * terms.mean_torque
                mix[mode, j] = side * i1 / (i1 + i2) * np.array([stiffness, c])
        else:
            upward = -1.0 if mode == NEGATIVE else 1.0
            phasor[mode, 0] = upward * ((engine - sign * load) / (1j * w * i1) - 1j * w * angle)
            drift[mode] = upward * (terms.mean_torque - sign * terms.mean_load) / i1
            mix[mode, 0, 1] = -upward
    constants = np.array([i1, i2, c, k, terms.mean_torque, terms.mean_load, amplitude, load_phase, float(index)])
    return Tables(w, turns, np.zeros(m), _parts(phasor), mean, drift, mix, oscillator, np.abs(phasor[:, :2]).sum(axis=2),
                  (np.abs(phasor[:, :2]) * w**4).sum(axis=2), _parts(engine), _parts(load), constants)


def _parts(values: NDArray[np.complex128]) -> Floats:
    """Real and imaginary parts along a last axis."""
    return np.ascontiguousarray(np.stack([values.real, values.imag], axis=-1))


def _clear_of_resonance(k: float, c: float, inertia: float, w: Floats) -> float:
    """The stiffness, moved by a few RESONANT where a sine would meet an undamped resonance."""
    for factor in (1.0, 1.0 + 3.0 * RESONANT, 1.0 - 3.0 * RESONANT, 1.0 + 7.0 * RESONANT):
        if np.all(np.abs(factor * k - inertia * w**2 + 1j * c * w) > RESONANT * k):
            return factor * k
    return k * (1.0 + 13.0 * RESONANT)


def _oscillator(inertia: float, c: float, k: float) -> Floats:
    """The row of Tables.oscillator."""
    square, decay = k / inertia, 0.5 * c / inertia
    gap = square - decay * decay
    root = math.sqrt(max(abs(gap), 1e-24 * square))
    if gap < 0.0 and root > 0.2 * decay:
        fast, slow = decay + root, square / (decay + root)
        matrix, own = np.diag([-fast, -slow]), [HEAVY, fast, slow, 0.0, 0.0]
    elif gap > 0.0 and root > 0.2 * decay:
        matrix, own = np.array([[-decay, root], [-root, -decay]]), [LIGHT, decay, decay, root, 1.0]
    else:
        slowest = decay - root if gap < 0.0 else decay
        factor = 0.5 * math.e * slowest
        matrix = np.array([[-decay, factor], [-gap / factor, -decay]])
        own = [CRITICAL, slowest, 0.5 * slowest, math.copysign(root, gap), factor]
    power = np.abs(np.linalg.matrix_power(matrix, 4))
    return np.concatenate([matrix.ravel(), own, power.ravel()])


@compiled
def free_pair(tau: float, o: Floats) -> tuple[float, float, float, float]:
    """f, g of an oscillator row at tau >= 0, and bounds of |f|, |g| from there on."""
    fade = np.exp(-o[5] * tau)
    if o[4] == LIGHT:
        return fade * np.cos(o[7] * tau), fade * np.sin(o[7] * tau), fade, fade
    other = np.exp(-o[6] * tau)
    if o[4] == HEAVY:
        return fade, other, fade, other
    if o[7] > 0.0:
        return fade * np.cos(o[7] * tau), o[8] * fade * np.sin(o[7] * tau) / o[7], fade, other
    shrunk = np.expm1(2.0 * o[7] * tau)
    return fade * (1.0 + 0.5 * shrunk), o[8] * fade * 0.5 * shrunk / o[7], fade, other


@compiled
def fourth_bound(a: float, b: float, fade: float, other: float, o: Floats) -> float:
    """Bound of the fourth derivative of A f + B g where |f| <= fade, |g| <= other."""
    a, b = abs(a), abs(b)
    return (o[9] * a + o[10] * b) * fade + (o[11] * a + o[12] * b) * other  # type: ignore[no-any-return]


@compiled
def start_arc(u: float, mode: int, speed: float, angle: float, rate: float, tables: Tables, arc: Floats) -> None:
    """Fill arc (3, 4), rows of c0, c1, A, B for the three signals, from v, theta2 and theta2' at u."""
    steady, steady_rate, signal = tables.mean[mode, 2], 0.0, 0.0
    for k in range(len(tables.frequency)):
        w = tables.frequency[k]
        x = w * u + tables.phase[k]
        sine, cosine = np.sin(x), np.cos(x)
        z = tables.phasor[mode, 2, k]
        steady += z[0] * sine + z[1] * cosine
        steady_rate += w * (z[0] * cosine - z[1] * sine)
        z = tables.phasor[mode, 0, k]
        signal += z[0] * sine + z[1] * cosine
    o = tables.oscillator[mode]
    x, y = angle - steady, rate - steady_rate
    at_start = 1.0 if o[4] == HEAVY else 0.0
    if o[4] == HEAVY:
        a, b = (y - o[3] * x) / (o[0] - o[3]), (y - o[0] * x) / (o[3] - o[0])
    else:
        a, b = x, (y - o[0] * x) / o[1]
    da, db = o[0] * a + o[1] * b, o[2] * a + o[3] * b
    for j in range(3):
        arc[j, 0] = tables.mean[mode, j]
        arc[j, 1] = 0.0
        arc[j, 2] = tables.mix[mode, j, 0] * a + tables.mix[mode, j, 1] * da
        arc[j, 3] = tables.mix[mode, j, 0] * b + tables.mix[mode, j, 1] * db
    if mode != STICK:
        upward = -speed if mode == NEGATIVE else speed
        arc[0, 0] = upward - signal - arc[0, 2] - at_start * arc[0, 3]
        arc[0, 1] = tables.drift[mode]


@compiled
def evaluate(tau: float, u: float, mode: int, rows: int, arc: Floats, tables: Tables, out: Floats) -> tuple[float, float]:
    """Value, first and second derivative of the first `rows` signals at u + tau, into out (3, 3); and |f|, |g| bounds."""
    o = tables.oscillator[mode]
    f, g, fade, other = free_pair(tau, o)
    for j in range(rows):
        a, b = arc[j, 2], arc[j, 3]
        da, db = o[0] * a + o[1] * b, o[2] * a + o[3] * b
        out[j, 0] = arc[j, 0] + arc[j, 1] * tau + a * f + b * g
        out[j, 1] = arc[j, 1] + da * f + db * g
        out[j, 2] = (o[0] * da + o[1] * db) * f + (o[2] * da + o[3] * db) * g
    for k in range(len(tables.frequency)):
        w = tables.frequency[k]
        x = w * (u + tau) + tables.phase[k]
        sine, cosine = np.sin(x), np.cos(x)
        for j in range(rows):
            re, im = tables.phasor[mode, j, k, 0], tables.phasor[mode, j, k, 1]
            value = re * sine + im * cosine
            out[j, 0] += value
            out[j, 1] += w * (re * cosine - im * sine)
            out[j, 2] -= w * w * value
    return fade, other


@compiled
def slip_angle(tau: float, u: float, mode: int, arc: Floats, tables: Tables) -> float:
    """The integral of v over [u, u + tau], rad; 0 in stick."""
    if mode == STICK:
        return 0.0
    o = tables.oscillator[mode]
    f, g, _, _ = free_pair(tau, o)
    f -= 1.0
    if o[4] == HEAVY:
        g -= 1.0
    upward = -1.0 if mode == NEGATIVE else 1.0
    total = upward * (arc[0, 0] + 0.5 * arc[0, 1] * tau) * tau - arc[2, 2] * f - arc[2, 3] * g
    for k in range(len(tables.frequency)):
        w = tables.frequency[k]
        x = w * u + tables.phase[k]
        middle, half = x + 0.5 * w * tau, 0.5 * w * tau
        z = tables.phasor[mode, 0, k]
        total += upward * (z[0] * np.sin(middle) + z[1] * np.cos(middle)) * 2.0 * np.sin(half) / w
    return total  # type: ignore[no-any-return]


@compiled
def set_phases(cycle: float, tables: Any) -> None:
    """Phases at the start of engine cycle number `cycle`; the fraction of turns x cycle is taken without rounding."""
    for k in range(len(tables.turns)):
        turns = tables.turns[k]
        large = 134217729.0 * turns
        head = large - (large - turns)
        whole, rest = head * cycle, (turns - head) * cycle
        tables.phase[k] = 2.0 * np.pi * ((whole - np.floor(whole)) + (rest - np.floor(rest)))
