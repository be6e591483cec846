"""Closed-form arcs of the set-valued law: what the exact engine knows of each mode before it starts, and their evaluation.

On an arc every signal has the form  c0 + c1 tau + sum_k Im(Z_k exp(i (w_k u + phase_k))) + A f(tau) + B g(tau),  where u is
the time since the start of the engine cycle, tau the time since the start of the arc, and f, g the two free motions of the
oscillator of the mode. The Z_k belong to the mode; only c0, A and B change from arc to arc.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

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


# Layout of a row of Tables.modes.
KIND, RATE_F, RATE_G, ROOT, FACTOR, POWER, DRIFT, MEAN, MIX, SIZE, BEND, FIRST = 4, 5, 6, 7, 8, 9, 13, 14, 17, 23, 25, 27
PER_SINE = 7
# Layout of Tables.inputs.
I1, I2, C23, K23, TM, TSM, TSP, LOAD_PHASE, LOAD_INDEX, FIRST_INPUT = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
PER_INPUT = 6
ENGINE, LOAD = 2, 4


class Tables(NamedTuple):
    """Constants of the four modes, in flat arrays because the inner loops read nothing else; m distinct frequencies.

    Slip: signal 0 is |v|. Stick: signals 0 and 1 are r Ts - lambda and r Ts + lambda, N m. Free: signal 0 is v. In every mode
    signal 2 is theta2.
    """

    modes: Floats
    """(4, 27 + 7 m). Free motion: x' as a matrix on (A, B) (4), kind of damping, decay rates that bound f and g, wd or its
    like, factor of g, moduli of the matrix to the power 4 (4). Then c1 of signal 0; constants of the 3 signals; their free
    part as a x + b x' of the free part x of theta2 (3 times 2); sums of |Z| and of |Z| w^4 of signals 0 and 1. Then for each
    frequency w and Z of the three signals (real, imaginary)."""
    inputs: Floats
    """(9 + 6 m,) I1, I2, C23, K23, Tm, Tsm, Tsp, phase of the load at t = 0, index of its frequency (-1 for a constant load).
    Then for each frequency w, w/omega, Z of Te and Z of Ts."""
    phase: Floats
    """(m,) phases of the frequencies at the start of the present engine cycle, rad; the kernel sets them."""


def tables_of(system: System, terms: Terms) -> Tables:
    """The tables of a system; sines of one frequency are added up first."""
    omega = system.engine.frequency
    rows: dict[float, list[complex]] = {}
    if terms.torque is not None:
        rows.setdefault(1.0, [0j, 0j])[0] += terms.torque[0]
    if terms.harmonics is not None:
        for frequency, amplitude, phase in terms.harmonics:
            rows.setdefault(float(np.rint(frequency / omega)), [0j, 0j])[0] += cmath.rect(amplitude, phase)
    pulsation, index = (0.0, 0.0, 0.0), -1
    if terms.pulsation is not None:
        pulsation, ratio = terms.pulsation, system.pressure.frequency_ratio
        rows.setdefault(ratio, [0j, 0j])[1] += cmath.rect(pulsation[0], pulsation[2])
        index = list(rows).index(ratio)
    turns = np.array(list(rows), dtype=np.float64)
    w = turns * omega
    engine = np.array([r[0] for r in rows.values()], dtype=np.complex128)
    load = np.array([r[1] for r in rows.values()], dtype=np.complex128)
    modes = [_mode_row(mode, sign, terms, w, engine, load)
             for mode, sign in ((STICK, 0.0), (POSITIVE, 1.0), (NEGATIVE, -1.0), (FREE, 0.0))]
    sines = np.stack([w, turns, engine.real, engine.imag, load.real, load.imag], axis=1)
    constants = [*terms.linear, terms.mean_torque, terms.mean_load, pulsation[0], pulsation[2], float(index)]
    return Tables(np.stack(modes), np.concatenate([constants, sines.ravel()]), np.zeros(len(w)))


def _mode_row(mode: int, sign: float, terms: Terms, w: Floats, engine: NDArray[np.complex128],
              load: NDArray[np.complex128]) -> Floats:
    """The row of Tables.modes of a mode whose friction torque is sign Ts (or what stick needs)."""
    i1, i2, c, k = terms.linear
    ratio = 1.0 + (terms.stribeck[0] if terms.stribeck is not None else 0.0)
    phasor, mean, mix = np.zeros((3, len(w)), np.complex128), np.zeros(3), np.zeros((3, 2))
    inertia, drift = (i1 + i2 if mode == STICK else i2), 0.0
    force, constant = (engine, terms.mean_torque) if mode == STICK else (sign * load, sign * terms.mean_load)
    stiffness = _clear_of_resonance(k, c, inertia, w[np.abs(force) > 0.0])
    angle = force / np.where(force == 0.0, 1.0, stiffness - inertia * w**2 + 1j * c * w)
    phasor[2], mean[2], mix[2, 0] = angle, constant / stiffness, 1.0
    if mode == STICK:
        interface = (i2 * engine + i1 * (stiffness + 1j * c * w) * angle) / (i1 + i2)
        for j, side in ((0, -1.0), (1, 1.0)):
            phasor[j] = ratio * load + side * interface
            mean[j] = ratio * terms.mean_load + side * terms.mean_torque
            mix[j] = side * i1 / (i1 + i2) * np.array([stiffness, c])
    else:
        upward = -1.0 if mode == NEGATIVE else 1.0
        phasor[0] = upward * ((engine - sign * load) / (1j * w * i1) - 1j * w * angle)
        drift = upward * (terms.mean_torque - sign * terms.mean_load) / i1
        mix[0, 1] = -upward
    size = np.abs(phasor[:2])
    sines = np.concatenate([w[:, None], np.stack([phasor.real, phasor.imag], axis=-1).transpose(1, 0, 2).reshape(-1, 6)], axis=1)
    return np.concatenate([_oscillator(inertia, c, stiffness), [drift], mean, mix.ravel(), size.sum(axis=1),
                           (size * w**4).sum(axis=1), sines.ravel()])


def _clear_of_resonance(k: float, c: float, inertia: float, w: Floats) -> float:
    """The stiffness, moved by a few RESONANT where a sine would meet an undamped resonance."""
    for factor in (1.0, 1.0 + 3.0 * RESONANT, 1.0 - 3.0 * RESONANT, 1.0 + 7.0 * RESONANT):
        if np.all(np.abs(factor * k - inertia * w**2 + 1j * c * w) > RESONANT * k):
            return factor * k
    return k * (1.0 + 13.0 * RESONANT)


def _oscillator(inertia: float, c: float, k: float) -> Floats:
    """The free motion part of a row of Tables.modes."""
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
def free_pair(tau: float, row: Floats) -> tuple[float, float, float, float]:
    """f, g of a mode at tau >= 0, and bounds of |f|, |g| from there on."""
    fade = np.exp(-row[RATE_F] * tau)
    if row[KIND] == LIGHT:
        return fade * np.cos(row[ROOT] * tau), fade * np.sin(row[ROOT] * tau), fade, fade
    other = np.exp(-row[RATE_G] * tau)
    if row[KIND] == HEAVY:
        return fade, other, fade, other
    if row[ROOT] > 0.0:
        return fade * np.cos(row[ROOT] * tau), row[FACTOR] * fade * np.sin(row[ROOT] * tau) / row[ROOT], fade, other
    shrunk = np.expm1(2.0 * row[ROOT] * tau)
    return fade * (1.0 + 0.5 * shrunk), row[FACTOR] * fade * 0.5 * shrunk / row[ROOT], fade, other


@compiled
def fourth_bound(a: float, b: float, fade: float, other: float, row: Floats) -> float:
    """Bound of the fourth derivative of A f + B g where |f| <= fade, |g| <= other."""
    a, b = abs(a), abs(b)
    near, far = row[POWER] * a + row[POWER + 1] * b, row[POWER + 2] * a + row[POWER + 3] * b
    return near * fade + far * other  # type: ignore[no-any-return]


@compiled
def start_arc(u: float, mode: int, speed: float, angle: float, rate: float, row: Floats, phase: Floats, arc: Floats) -> None:
    """Fill arc (3, 8), rows of c0, c1, A, B and A, B of the first two derivatives, from v, theta2 and theta2' at u."""
    steady, steady_rate, signal = row[MEAN + 2], 0.0, 0.0
    for k in range(len(phase)):
        i = FIRST + PER_SINE * k
        w = row[i]
        x = w * u + phase[k]
        sine, cosine = np.sin(x), np.cos(x)
        steady += row[i + 5] * sine + row[i + 6] * cosine
        steady_rate += w * (row[i + 5] * cosine - row[i + 6] * sine)
        signal += row[i + 1] * sine + row[i + 2] * cosine
    x, y = angle - steady, rate - steady_rate
    at_start = 0.0
    if row[KIND] == HEAVY:
        at_start = 1.0
        a, b = (y - row[3] * x) / (row[0] - row[3]), (y - row[0] * x) / (row[3] - row[0])
    else:
        a, b = x, (y - row[0] * x) / row[1]
    da, db = row[0] * a + row[1] * b, row[2] * a + row[3] * b
    for j in range(3):
        p, q = row[MIX + 2 * j], row[MIX + 2 * j + 1]
        arc[j, 0], arc[j, 1] = row[MEAN + j], 0.0
        arc[j, 2], arc[j, 3] = p * a + q * da, p * b + q * db
        arc[j, 4], arc[j, 5] = row[0] * arc[j, 2] + row[1] * arc[j, 3], row[2] * arc[j, 2] + row[3] * arc[j, 3]
        arc[j, 6], arc[j, 7] = row[0] * arc[j, 4] + row[1] * arc[j, 5], row[2] * arc[j, 4] + row[3] * arc[j, 5]
    if mode != STICK:
        upward = -speed if mode == NEGATIVE else speed
        arc[0, 0] = upward - signal - arc[0, 2] - at_start * arc[0, 3]
        arc[0, 1] = row[DRIFT]


@compiled
def evaluate(tau: float, u: float, count: int, row: Floats, phase: Floats, arc: Floats, work: Floats,
             slot: int) -> tuple[float, float]:
    """Value, first and second derivative of the first `count` signals at u + tau, into work[slot] (3, 3); bounds of |f|, |g|."""
    f, g, fade, other = free_pair(tau, row)
    for j in range(count):
        work[slot, j, 0] = arc[j, 0] + arc[j, 1] * tau + arc[j, 2] * f + arc[j, 3] * g
        work[slot, j, 1] = arc[j, 1] + arc[j, 4] * f + arc[j, 5] * g
        work[slot, j, 2] = arc[j, 6] * f + arc[j, 7] * g
    for k in range(len(phase)):
        i = FIRST + PER_SINE * k
        w = row[i]
        x = w * (u + tau) + phase[k]
        sine, cosine = np.sin(x), np.cos(x)
        for j in range(count):
            re, im = row[i + 1 + 2 * j], row[i + 2 + 2 * j]
            value = re * sine + im * cosine
            work[slot, j, 0] += value
            work[slot, j, 1] += w * (re * cosine - im * sine)
            work[slot, j, 2] -= w * w * value
    return fade, other


@compiled
def slip_angle(tau: float, u: float, mode: int, row: Floats, phase: Floats, arc: Floats) -> float:
    """The integral of v over [u, u + tau], rad; 0 in stick."""
    if mode == STICK:
        return 0.0
    f, g, _, _ = free_pair(tau, row)
    f -= 1.0
    if row[KIND] == HEAVY:
        g -= 1.0
    upward = -1.0 if mode == NEGATIVE else 1.0
    total = upward * (arc[0, 0] + 0.5 * arc[0, 1] * tau) * tau - arc[2, 2] * f - arc[2, 3] * g
    for k in range(len(phase)):
        i = FIRST + PER_SINE * k
        half = 0.5 * row[i] * tau
        middle = row[i] * u + phase[k] + half
        total += upward * (row[i + 1] * np.sin(middle) + row[i + 2] * np.cos(middle)) * 2.0 * np.sin(half) / row[i]
    return total  # type: ignore[no-any-return]


@compiled
def sines(u: float, mean: float, which: int, inputs: Floats, phase: Floats) -> tuple[float, float]:
    """Value and derivative at u of mean + the sines of Te (`which` ENGINE) or Ts (LOAD)."""
    value, slope = mean, 0.0
    for k in range(len(phase)):
        i = FIRST_INPUT + PER_INPUT * k
        re, im = inputs[i + which], inputs[i + which + 1]
        if re != 0.0 or im != 0.0:
            x = inputs[i] * u + phase[k]
            sine, cosine = np.sin(x), np.cos(x)
            value += re * sine + im * cosine
            slope += inputs[i] * (re * cosine - im * sine)
    return value, slope


@compiled
def set_phases(cycle: float, inputs: Floats, phase: Floats) -> None:
    """Phases at the start of engine cycle number `cycle`; the fraction of turns x cycle is taken without rounding."""
    for k in range(len(phase)):
        turns = inputs[FIRST_INPUT + PER_INPUT * k + 1]
        large = 134217729.0 * turns
        head = large - (large - turns)
        whole, rest = head * cycle, (turns - head) * cycle
        phase[k] = 2.0 * np.pi * ((whole - np.floor(whole)) + (rest - np.floor(rest)))
