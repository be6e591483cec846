"""Closed-form arcs of the set-valued law: what the exact engine knows of each mode before it starts, and their
evaluation.

On an arc every signal has the form  c0 + c1 tau + sum_k Im(Z_k exp(i (w_k u + phase_k))) + A f(tau) + B g(tau),  where
u is the time since the start of the engine cycle, tau the time since the start of the arc, and f, g the two free
motions of the oscillator of the mode. The Z_k belong to the mode; only c0, A and B change from arc to arc.
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
"""Kinds of damping: f, g are exp(-d tau) cos and sin of wd tau; two real exponentials; or, near critical damping where
these two pairs lose their digits, exp(-d tau) times cos and sin(wd tau)/wd (or cosh and sinh) with g scaled to stay
below 1.
"""
RESONANT = 1e-8
"""Relative distance kept from an undamped resonance, where sine and free motion lose their digits: the stiffness moves.
"""


# Layout of the pad, the one array of the inner loops (each further array would cost a reference count per call): three
# looks
# of 3 signals (value, slope, second derivative); the largest and smallest v; evaluations and their limit; the present
# arc, 3
# signals of c0, c1, A, B and A, B of their first two derivatives; and the row of Tables.modes of the present mode.
LEFT, RIGHT, HERE, HIGHEST, LOWEST, COUNT, MOST, ARC, ROW = 0, 9, 18, 27, 28, 29, 30, 32, 56
# Layout of a row of Tables.modes, from ROW on.
KIND, RATE_F, RATE_G, ROOT, FACTOR, POWER = ROW + 4, ROW + 5, ROW + 6, ROW + 7, ROW + 8, ROW + 9
DRIFT, MEAN, MIX, SIZE, BEND, FIRST = ROW + 13, ROW + 14, ROW + 17, ROW + 23, ROW + 25, ROW + 27
PER_SINE = 8
# Layout of Tables.inputs.
I1, I2, C23, K23, TM, TSM, TSP, LOAD_PHASE, LOAD_INDEX, FIRST_INPUT = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
PER_INPUT = 7
ENGINE, LOAD = 3, 5


class Tables(NamedTuple):
    """Constants of the four modes, in flat arrays because the inner loops read nothing else; m distinct frequencies.

    Slip: signal 0 is |v|. Stick: signals 0 and 1 are r Ts - lambda and r Ts + lambda, N m. Free: signal 0 is v. In
    every mode signal 2 is theta2.
    """

    modes: Floats
    """(4, 27 + 8 m). Free motion: x' as a matrix on (A, B) (4), kind of damping, decay rates that bound f and g, wd or
    its like, factor of g, moduli of the matrix to the power 4 (4). Then c1 of signal 0; constants of the 3 signals;
    their free part as a x + b x' of the free part x of theta2 (3 times 2); sums of |Z| and of |Z| w^4 of signals 0 and
    1. Then for each frequency w, its phase at the start of the present engine cycle (rad, set by the kernel), Z of the
    three signals.
    """
    inputs: Floats
    """(9 + 7 m,) I1, I2, C23, K23, Tm, Tsm, Tsp, phase of the load at t = 0, index of its frequency (-1 for a constant
    load). Then for each frequency w, w/omega, its phase as above, Z of Te and Z of Ts.
    """
    noise: float
    """Relative rounding of the torques: that of double precision, magnified next to an undamped resonance."""


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
    sines = np.stack([w, turns, 0.0 * w, engine.real, engine.imag, load.real, load.imag], axis=1)
    constants = [*terms.linear, terms.mean_torque, terms.mean_load, pulsation[0], pulsation[2], float(index)]
    return Tables(np.stack([row for row, _ in modes]), np.concatenate([constants, sines.ravel()]),
                  max(n for _, n in modes))


def _mode_row(mode: int, sign: float, terms: Terms, w: Floats, engine: NDArray[np.complex128],
              load: NDArray[np.complex128]) -> tuple[Floats, float]:
    """The row of Tables.modes of a mode whose friction torque is sign Ts (or what stick needs), and its noise."""
    i1, i2, c, k = terms.linear
    ratio = 1.0 + (terms.stribeck[0] if terms.stribeck is not None else 0.0)
    phasor, mean, mix = np.zeros((3, len(w)), np.complex128), np.zeros(3), np.zeros((3, 2))
    inertia, drift = (i1 + i2 if mode == STICK else i2), 0.0
    force, constant = (engine, terms.mean_torque) if mode == STICK else (sign * load, sign * terms.mean_load)
    stiffness = _clear_of_resonance(k, c, inertia, w[np.abs(force) > 0.0])
    dynamic = np.where(force == 0.0, k, stiffness - inertia * w**2 + 1j * c * w)
    angle = force / dynamic
    noise = max(1e-12, 4e-15 * float(np.max(k / np.abs(dynamic), initial=0.0)), 10.0 * abs(stiffness / k - 1.0))
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
    parts = np.stack([phasor.real, phasor.imag], axis=-1).transpose(1, 0, 2).reshape(-1, 6)
    sines = np.concatenate([np.stack([w, 0.0 * w], axis=1), parts], axis=1)
    row = np.concatenate([_oscillator(inertia, c, stiffness), [drift], mean, mix.ravel(), size.sum(axis=1),
                          (size * w**4).sum(axis=1), sines.ravel()])
    return row, noise


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
def free_pair(tau: float, pad: Floats) -> tuple[float, float, float, float]:
    """f, g of the mode at tau >= 0, and bounds of |f|, |g| from there on."""
    fade = np.exp(-pad[RATE_F] * tau)
    if pad[KIND] == LIGHT:
        return fade * np.cos(pad[ROOT] * tau), fade * np.sin(pad[ROOT] * tau), fade, fade
    other = np.exp(-pad[RATE_G] * tau)
    if pad[KIND] == HEAVY:
        return fade, other, fade, other
    if pad[ROOT] > 0.0:
        return fade * np.cos(pad[ROOT] * tau), pad[FACTOR] * fade * np.sin(pad[ROOT] * tau) / pad[ROOT], fade, other
    shrunk = np.expm1(2.0 * pad[ROOT] * tau)
    return fade * (1.0 + 0.5 * shrunk), pad[FACTOR] * fade * 0.5 * shrunk / pad[ROOT], fade, other


@compiled
def fourth_bound(j: int, fade: float, other: float, pad: Floats) -> float:
    """Bound of the fourth derivative of signal j, where |f| <= fade, |g| <= other."""
    a, b = abs(pad[ARC + 8 * j + 2]), abs(pad[ARC + 8 * j + 3])
    near, far = pad[POWER] * a + pad[POWER + 1] * b, pad[POWER + 2] * a + pad[POWER + 3] * b
    return pad[BEND + j] + near * fade + far * other  # type: ignore[no-any-return]


@compiled
def start_arc(u: float, mode: int, speed: float, angle: float, rate: float, modes: Floats, pad: Floats) -> None:
    """Bring the row of the mode and the arc that starts at u with v, theta2 and theta2' into the pad."""
    for i in range(modes.shape[1]):
        pad[ROW + i] = modes[mode, i]
    steady, steady_rate, signal = pad[MEAN + 2], 0.0, 0.0
    for i in range(FIRST, len(pad), PER_SINE):
        w = pad[i]
        x = w * u + pad[i + 1]
        sine, cosine = np.sin(x), np.cos(x)
        steady += pad[i + 6] * sine + pad[i + 7] * cosine
        steady_rate += w * (pad[i + 6] * cosine - pad[i + 7] * sine)
        signal += pad[i + 2] * sine + pad[i + 3] * cosine
    x, y = angle - steady, rate - steady_rate
    m0, m1, m2, m3 = pad[ROW], pad[ROW + 1], pad[ROW + 2], pad[ROW + 3]
    at_start = 0.0
    if pad[KIND] == HEAVY:
        at_start = 1.0
        a, b = (y - m3 * x) / (m0 - m3), (y - m0 * x) / (m3 - m0)
    else:
        a, b = x, (y - m0 * x) / m1
    da, db = m0 * a + m1 * b, m2 * a + m3 * b
    for j in range(3):
        p, q, i = pad[MIX + 2 * j], pad[MIX + 2 * j + 1], ARC + 8 * j
        pad[i], pad[i + 1] = pad[MEAN + j], 0.0
        pad[i + 2], pad[i + 3] = p * a + q * da, p * b + q * db
        pad[i + 4], pad[i + 5] = m0 * pad[i + 2] + m1 * pad[i + 3], m2 * pad[i + 2] + m3 * pad[i + 3]
        pad[i + 6], pad[i + 7] = m0 * pad[i + 4] + m1 * pad[i + 5], m2 * pad[i + 4] + m3 * pad[i + 5]
    if mode != STICK:
        upward = -speed if mode == NEGATIVE else speed
        pad[ARC] = upward - signal - pad[ARC + 2] - at_start * pad[ARC + 3]
        pad[ARC + 1] = pad[DRIFT]


@compiled
def evaluate(tau: float, u: float, count: int, pad: Floats) -> tuple[float, float]:
    """Value and first two derivatives of the first `count` signals at u + tau, into the look HERE; bounds of |f|, |g|.
    """
    f, g, fade, other = free_pair(tau, pad)
    for j in range(count):
        a, i = ARC + 8 * j, HERE + 3 * j
        pad[i] = pad[a] + pad[a + 1] * tau + pad[a + 2] * f + pad[a + 3] * g
        pad[i + 1] = pad[a + 1] + pad[a + 4] * f + pad[a + 5] * g
        pad[i + 2] = pad[a + 6] * f + pad[a + 7] * g
    for k in range(FIRST, len(pad), PER_SINE):
        w = pad[k]
        x = w * (u + tau) + pad[k + 1]
        sine, cosine = np.sin(x), np.cos(x)
        for j in range(count):
            re, im, i = pad[k + 2 + 2 * j], pad[k + 3 + 2 * j], HERE + 3 * j
            value = re * sine + im * cosine
            pad[i] += value
            pad[i + 1] += w * (re * cosine - im * sine)
            pad[i + 2] -= w * w * value
    return fade, other


@compiled
def slip_angle(tau: float, u: float, mode: int, pad: Floats) -> float:
    """The integral of v over [u, u + tau], rad; 0 in stick."""
    if mode == STICK:
        return 0.0
    f, g, _, _ = free_pair(tau, pad)
    f -= 1.0
    if pad[KIND] == HEAVY:
        g -= 1.0
    upward = -1.0 if mode == NEGATIVE else 1.0
    total = upward * (pad[ARC] + 0.5 * pad[ARC + 1] * tau) * tau - pad[ARC + 18] * f - pad[ARC + 19] * g
    for i in range(FIRST, len(pad), PER_SINE):
        half = 0.5 * pad[i] * tau
        middle = pad[i] * u + pad[i + 1] + half
        total += upward * (pad[i + 2] * np.sin(middle) + pad[i + 3] * np.cos(middle)) * 2.0 * np.sin(half) / pad[i]
    return total  # type: ignore[no-any-return]


@compiled
def sines(u: float, mean: float, which: int, inputs: Floats) -> tuple[float, float]:
    """Value and derivative at u of mean + the sines of Te (`which` ENGINE) or Ts (LOAD)."""
    value, slope = mean, 0.0
    for i in range(FIRST_INPUT, len(inputs), PER_INPUT):
        re, im = inputs[i + which], inputs[i + which + 1]
        if re != 0.0 or im != 0.0:
            x = inputs[i] * u + inputs[i + 2]
            sine, cosine = np.sin(x), np.cos(x)
            value += re * sine + im * cosine
            slope += inputs[i] * (re * cosine - im * sine)
    return value, slope


@compiled
def set_phases(cycle: float, tables: Tables) -> None:
    """Phases at the start of engine cycle number `cycle`; the fraction of turns x cycle is taken without rounding."""
    inputs, modes = tables.inputs, tables.modes
    for k in range((len(inputs) - FIRST_INPUT) // PER_INPUT):
        i = FIRST_INPUT + PER_INPUT * k
        large = 134217729.0 * inputs[i + 1]
        head = large - (large - inputs[i + 1])
        whole, rest = head * cycle, (inputs[i + 1] - head) * cycle
        phase = 2.0 * np.pi * ((whole - np.floor(whole)) + (rest - np.floor(rest)))
        inputs[i + 2] = phase
        for mode in range(4):
            modes[mode, FIRST - ROW + PER_SINE * k + 1] = phase
