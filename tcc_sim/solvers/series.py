"""Taylor series of the motion of the driveline by recurrences, and of its excitation.

The recurrences are those of automatic differentiation (Hairer, Norsett and Wanner, Solving Ordinary Differential
Equations I, Sec. I.8; A. Jorba and M. Zou, Experimental Mathematics 14, 2005): E = exp(-alpha |v|) from E' = -alpha
sgn(v) v' E, T = tanh(sigma v) from T' = sigma (1 - T^2) v', a sine from its cosine. Coefficients are in scaled time x =
t/unit, so that none of them overflows. `product`, `driven` and `motion` are staged functions
(`unrolled.unrolled`), and take plain numbers as well.

Excitation of a kernel: engine torque and saturation torque, their Taylor coefficients, and the times at which the clamp
of the pressure at 0 begins and ends.

For the engines time is `tau`, seconds into an engine cycle. The sines of the engine torque repeat with the cycle; the
load's phase at the start of the cycle is `shift` (rad), so that no large angle loses digits however long a run is.

Where frequency, means or amplitudes vary in time there is a `profile`, one piece of `model.profile` as a row, else
None: sines have a quadratic phase then, means and amplitudes are linear. Times of the row are seconds into the engine
cycle, phases those since its start, and the rates of waves and load are per rad of phi.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import fast, rebound
from tcc_sim.compiling.unrolled import exp, row_of, unrolled
from tcc_sim.model import profile as of
from tcc_sim.model.friction import decayed
from tcc_sim.polynomials.polynomial import powers_of
from tcc_sim.solvers.terms import Terms

SLIP, ANGLE, SPEED, FLYWHEEL, ENGINE, LOAD = range(6)
"""Rows of the coefficients: slip speed, plate angle, plate speed, flywheel angle; Te, Ts."""
ROWS = 6

ORDER_MAXIMUM = 30
FRICTION_ORDER_MAXIMUM = 22
"""Highest order with E or T: their recurrences cost as the square of it, and every order takes its time to compile."""
COLUMNS = 32

INVERSE = 1.0 / np.maximum(np.arange(COLUMNS + 2), 1.0)
"""1/k: the recurrences multiply by it, a division being the slowest thing in them."""

OF_SINE, OF_COSINE = (np.array([(0.0, 1.0, 0.0, -1.0)[(k + start) % 4] / math.factorial(k) for k in range(COLUMNS)])
                      for start in (1, 0))
"""Shares of sine and cosine at the start in the Taylor coefficients of a sine of rate 1."""
ENDLESS = 900.0
"""log2 of an unlimited length."""
MANTISSA, EXPONENT_OF_1 = 0x000F_FFFF_FFFF_FFFF, 0x3FF0_0000_0000_0000
"""Bits of a number: the mantissa's, and the exponent's of numbers from 1 to 2."""


def total(terms: Sequence[Any]) -> Any:
    """Return the sum of terms; the last two, which the processor computes last, are added last."""
    early, late = terms[:-2], terms[-2:]
    out: Any = 0.0
    for chain in (early[0::2], early[1::2]):
        part: Any = 0.0
        for term in chain:
            part = part + term
        out = out + part
    for term in late:
        out = out + term
    return out


def product(a: Sequence[Any], b: Sequence[Any], k: int) -> Any:
    """Return coefficient k of the product of two series: sum over j of a_j b_(k-j)."""
    return total([a[j] * b[k - j] for j in sorted(range(k + 1), key=lambda j: max(j, k - j))])


def square(a: Sequence[Any], k: int) -> Any:
    """Return coefficient k of the square of a series."""
    mixed = [2.0 * a[j] * a[k - j] for j in range((k - 1) // 2, -1, -1)]
    return total([a[k // 2] * a[k // 2], *mixed] if k % 2 == 0 else mixed)


def inner(a: Sequence[Any], b: Sequence[Any], k: int) -> Any:
    """Return coefficient k of the product of two series without its ends a_0 b_k and a_k b_0."""
    return total([a[j] * b[k - j] for j in sorted(range(1, k), key=lambda j: max(j, k - j))])


def side_by_side(pairs: Sequence[Any], rows: list[Any], k: int) -> list[Any]:
    """Return `inner` of several pairs of series in the lanes of one row, 0 for a pair that is None; `rows` holds the
    coefficients below k - 1.
    """
    present = [pair for pair in pairs if pair is not None]
    if not present:
        return [0.0] * len(pairs)
    rows.append([row_of([series[k - 1] for series in side]) for side in zip(*present)])
    lefts, rights = zip(*rows)
    sums = inner(lefts, rights, k)
    lanes = iter(range(len(present)))
    return [0.0 if pair is None or k == 1 else sums[next(lanes)] for pair in pairs]


def driven(rate: Any, weighted: Sequence[Any], other: Sequence[Any], k: int) -> Any:
    """Return coefficient k >= 1 of the series with derivative rate v' `other`; `weighted` holds j v_j."""
    return rate * (1.0 / k) * inner(weighted, other, k) + rate * (1.0 / k) * weighted[k] * other[0]


def decayed_along(out: Any, rows: Any, rate: Any) -> Iterator[int]:
    """Fill coefficients 0, 1, ... of exp(rate (v - v(0))); staged function."""
    e, weighted = [1.0], [0.0]
    out[0,] = 1.0
    for k in range(1, FRICTION_ORDER_MAXIMUM):
        weighted.append(float(k) * rows[SLIP, k])
        e.append(driven(rate, weighted, e, k))
        out[k,] = e[k]
        if k % 2 == 1 and k >= 7:
            yield k


expand_decayed = unrolled(decayed_along)


def motion(rows: Any, unit: Any, linear: Any, sign: Any, pulsation: Any, stribeck: Any, excess: Any, sigma: Any,
           tanh: Any, sech: Any) -> Iterator[int]:
    """Fill the coefficients of slip speed, plate angle and plate speed by equations (2), mubar by recurrence.

    Each coefficient waits for the one before it. Therefore v_k enters by one product: its share in coefficient k of
    mubar is the slope of mubar at the start times v_k, and the other terms are added up before.

    rows : (ROWS, COLUMNS) array; coefficients 0 of SLIP, ANGLE, SPEED and all of ENGINE and LOAD are given (of LOAD
        only the first where `pulsation` is None), the others of SLIP, ANGLE and SPEED are filled
    unit : unit of time of the coefficients, s
    sign : value of T where it does not vary: the sign of v, or 0 without load
    stribeck, excess : amplitudes and rates in turn, and value c exp(-a |v|) of the first one; None where they do not
        vary
    sigma, tanh, sech : sigma, tanh(sigma v) and 1 - tanh^2; None where T does not vary
    """
    flywheel, plate = unit / linear.flywheel, unit / linear.plate
    both, damping, stiffness = flywheel + plate, plate * linear.damping, plate * linear.stiffness
    on_flywheel, on_plate = flywheel * linear.flywheel_by_slip, plate * linear.plate_by_slip
    v, x, u = [rows[SLIP, 0]], [rows[ANGLE, 0]], [rows[SPEED, 0]]
    rates = [] if stribeck is None else [-rate * sign for rate in stribeck[1::2]]
    faded, later = rebound(decayed, exp=exp), [] if stribeck is None else zip(stribeck[2::2], stribeck[3::2])
    each = [] if stribeck is None else [[excess], *([c * faded(a, sign * v[0])] for c, a in later)]
    e, t, s = [added([one[0] for one in each])], [sign if tanh is None else tanh], [sech]
    drops = [rate * one[0] for rate, one in zip(rates, each)]
    fallen = added(drops)
    rising = 0.0 if tanh is None else sigma * sech
    slope = rising + (rising * e[0] + fallen * t[0])
    law, load, weighted = [t[0] + e[0] * t[0]], [rows[LOAD, 0]], [0.0]
    stiff = both * load[0] * slope + on_flywheel - on_plate
    pairs = [*((weighted, one) for one in each), None if tanh is None else (weighted, s),
             None if stribeck is None or tanh is None else (e, t), None if pulsation is None else (law, load)]
    packed: list[Any] = []
    for k in range(ORDER_MAXIMUM if stribeck is None and tanh is None else FRICTION_ORDER_MAXIMUM):
        spring = damping * u[k] + stiffness * x[k]
        push = flywheel * rows[ENGINE, k] + spring
        if k == 0:
            friction = load[0] * law[0]
            push = push - on_flywheel * v[0]
            speed = push - both * friction + on_plate * v[0]
        else:
            load.append(0.0 if pulsation is None else rows[LOAD, k])
            *by_each, by_t, by_both, by_load = side_by_side(pairs, packed, k)
            parts = [rate * (1.0 / k) * by_e for rate, by_e in zip(rates, by_each)]
            e_early = added(parts)
            t_early = 0.0 if tanh is None else sigma * (1.0 / k) * by_t
            for one, early_part, drop in zip(each, parts, drops):
                one.append(early_part + drop * v[k])
            e.append(added([one[k] for one in each]))
            t.append(t_early + rising * v[k])
            if tanh is not None:
                s.append(-square(t, k))
            law_early = t_early * (1.0 + e[0]) + (e_early * t[0] + by_both)
            early = law[0] * load[k] + by_load + load[0] * law_early
            law.append(law_early + slope * v[k])
            friction = early + load[0] * slope * v[k]
            speed = (push - both * early) - stiff * v[k]
        part = 1.0 / (k + 1)
        weighted.append(speed)
        v.append(part * speed)
        u.append(part * (plate * friction - spring - on_plate * v[k]))
        x.append(part * unit * u[k])
        rows[SLIP, k + 1], rows[SPEED, k + 1], rows[ANGLE, k + 1] = v[k + 1], u[k + 1], x[k + 1]
        if k % 2 == 1 and k >= 7:
            yield k + 1


def added(numbers: Sequence[Any]) -> Any:
    """Return the sum of a few numbers, 0 of none."""
    return functools.reduce(operator.add, numbers) if numbers else 0.0


expand = unrolled(motion)
"""expand(order, rows, ...): `motion` to the even order at or above `order`, at most ORDER_MAXIMUM, without E and T, or
FRICTION_ORDER_MAXIMUM."""


@fast
def fastest_at(stribeck: tuple[float, ...], speed: float) -> float:
    """Return the largest rate, s/rad, of the exponentials that have not decayed at this speed, or of the first one."""
    rate = stribeck[1]
    for j in range(2, len(stribeck), 2):
        if stribeck[j + 1] * speed < 40.0 or rate * speed > 80.0:
            rate = max(rate, stribeck[j + 1]) if rate * speed <= 80.0 else stribeck[j + 1]
    return rate


@fast
def logarithm(x: float) -> float:
    """Return log2 x, up to 0.09 too small and never too large, for x limited to 1e-307 and 1e300.

    The number's bits hold its exponent and mantissa; to call C's frexp takes longer.
    """
    bits = np.float64(min(max(x, 1e-307), 1e300)).view(np.int64)
    return float((bits >> 52) - 1024 + np.int64(bits & MANTISSA | EXPONENT_OF_1).view(np.float64))


@fast
def power_of_two(x: float) -> float:
    """Return 2^x for x from -1000 to 1000, up to 0.9 % too small and never too large: enough for a length, and faster
    than exp.
    """
    whole = np.floor(max(x, -1000.0))
    part = max(x, -1000.0) - whole
    return float((1.0 + part * (0.6565 + 0.3435 * part) - 0.004) * np.int64((int(whole) + 1023) << 52).view(np.float64))


@fast
def sine_and_cosine(angle: float) -> tuple[float, float]:
    """Return sine and cosine of an angle within about 1e6 rad, to the last bit or two, in the time of one.

    S. L. Moshier's polynomials (Cephes, sin.c) on [-pi/4, pi/4]; pi/2 in three parts makes the reduction exact.
    """
    turns = np.floor(angle * 0.6366197723675814 + 0.5)
    x = ((angle - turns * 1.570796251296997) - turns * 7.549789415861596e-8) - turns * 5.390302858158119e-15
    y = x * x
    s = -1.66666666666666307295e-1 + y * (8.33333333332211858878e-3 + y * (
        -1.98412698295895385996e-4 + y * (2.75573136213857245213e-6 + y * (
            -2.50507477628578072866e-8 + y * 1.58962301576546568060e-10))))
    c = 4.16666666666665929218e-2 + y * (-1.38888888888730564116e-3 + y * (
        2.48015872888517045348e-5 + y * (-2.75573141792967388112e-7 + y * (
            2.08757008419747316778e-9 - y * 1.13585365213876817300e-11))))
    s = x + x * y * s
    c = 1.0 - 0.5 * y + y * y * c
    quadrant = int(turns) & 3
    if quadrant & 1:
        s, c = c, s
    return (-s if quadrant & 2 else s), (-c if quadrant in (1, 2) else c)


@unrolled
def expand_sine(out: Any, mean: Any, now: Any, quadrature: Any, rate: Any) -> Iterator[int]:
    """Set the coefficients up to an order, or up to seven more, of a sine about a mean, by sine and cosine at the
    start; add them if the mean is None.

    A row of lanes that is read just after its numbers were written one by one would stall the processor.
    """
    for i, powers in zip(range(0, COLUMNS, 8), powers_of(rate)):
        coefficients = powers * (now * OF_SINE[i:i + 8] + quadrature * OF_COSINE[i:i + 8])
        if mean is None:
            coefficients = out.row(i, count=8) + coefficients
        elif i == 0:
            coefficients = coefficients + row_of([mean] + 7 * [0.0])
        out.set_row(coefficients, i)
        yield i + 7


@fast
def add_integral(rows: Any, order: int, unit: float) -> None:
    """Fill coefficients 1 to `order` of theta1, the integral of slip speed + plate speed."""
    for k in range(order):
        rows[FLYWHEEL, k + 1] = unit * (rows[SLIP, k] + rows[SPEED, k]) * INVERSE[k + 1]


TWO_PI = 2.0 * math.pi
Pulsation = Any
"""(Tsp in N m, omega_f in rad/s or rad/rad, psi in rad), or None for a constant load; with a profile always there."""
GRID = math.pi / 8.0
"""Step in the load's angle within which the load less its clamp has one extremum at most."""
BISECTIONS = 60
PAST = 1e-7
"""Part of such a step behind a root in which no other is searched for."""

WAVE = np.dtype([("rate", np.float64), ("amplitude", np.float64), ("phase", np.float64), ("sine", np.float64),
                 ("cosine", np.float64)])
"""A sine of the engine torque: rad/s, N m, rad; the sine and the cosine of its angle now."""

DRIVE = np.dtype([("torque", np.float64), ("torque_rate", np.float64), ("load", np.float64), ("load_rate", np.float64),
                  ("load_sine", np.float64), ("load_cosine", np.float64)])
"""Te, Te' (N m, N m/s), Ts, Ts', and the sine and cosine of the load's angle, now."""


def waves_of(terms: Terms) -> NDArray[Any]:
    """Return the sines of the engine torque as an array of WAVE, the first harmonic first."""
    rows = [] if terms.torque is None else [(terms.torque[1], terms.torque[0], 0.0, 0.0, 1.0)]
    if terms.harmonics is not None:
        rows += [(rate, amplitude, phase, 0.0, 1.0) for rate, amplitude, phase in terms.harmonics.tolist()]
    return np.array(rows, WAVE)


reached = fast(of.reached)


@fast
def frequency_at(tau: float, row: Any) -> float:
    """Return omega at tau, rad/s."""
    return float(row[of.FREQUENCY] + row[of.FREQUENCY_RATE] * (tau - row[of.TIME]))


@fast
def swell_and_rate(tau: float, phase: float, omega: float, row: Any) -> tuple[float, float]:
    """Return the sum at tau of the harmonics whose amplitude varies, N m, and its rate, N m/s."""
    torque, rate, k = 0.0, 0.0, of.SWELLS
    while k < row.shape[0]:
        sine, cosine = sine_and_cosine(row[k] * phase + row[k + 1])
        amplitude = row[k + 2] + row[k + 3] * (tau - row[of.TIME])
        torque += amplitude * sine
        rate += row[k + 3] * sine + amplitude * row[k] * omega * cosine
        k += of.SWELL
    return torque, rate


@fast
def excite(tau: float, shift: float, loaded: bool, terms: Terms, waves: Any, pulsation: Pulsation, profile: Any,
           drive: Any) -> None:
    """Fill `drive` and the sines and cosines of `waves` at tau; Ts is 0 unless `loaded`."""
    phase, omega, torque, torque_rate, load, load_rate = tau, 1.0, terms.mean_torque, 0.0, terms.mean_load, 0.0
    if profile is not None:
        phase, torque, load = reached(tau, profile)
        omega, shift = frequency_at(tau, profile), profile[of.SHIFT]
        torque_rate, load_rate = profile[of.TORQUE_RATE], profile[of.LOAD_RATE]
        swell, swell_rate = swell_and_rate(tau, phase, omega, profile)
        torque += swell
        torque_rate += swell_rate
    for i in range(waves.shape[0]):
        sine, cosine = sine_and_cosine(waves[i].rate * phase + waves[i].phase)
        waves[i].sine = sine
        waves[i].cosine = cosine
        torque += waves[i].amplitude * sine
        torque_rate += waves[i].amplitude * waves[i].rate * omega * cosine
    drive.torque = torque
    drive.torque_rate = torque_rate
    drive.load = load if loaded else 0.0
    drive.load_rate = 0.0
    if pulsation is not None:
        sine, cosine = sine_and_cosine(pulsation[1] * phase + shift)
        drive.load_sine = sine
        drive.load_cosine = cosine
        if loaded:
            drive.load = max(load + pulsation[0] * sine, 0.0)
            drive.load_rate = load_rate + pulsation[0] * pulsation[1] * omega * cosine


@fast
def expand_excitation(rows: Any, count: int, unit: float, tau: float, loaded: bool, terms: Terms, waves: Any,
                      pulsation: Pulsation, profile: Any, drive: Any) -> None:
    """Fill the first `count` Taylor coefficients in t/unit of Te and Ts about tau, for which `drive` and `waves` are
    filled. Of a constant load only coefficient 0 is written.
    """
    if profile is not None:
        expand_varying(rows, count, unit, tau, loaded, waves, pulsation, profile, drive)
    else:
        if waves.shape[0] == 0:
            for k in range(COLUMNS):
                rows[ENGINE, k] = 0.0
            rows[ENGINE, 0] = terms.mean_torque
        for i in range(waves.shape[0]):
            sine, cosine = waves[i].amplitude * waves[i].sine, waves[i].amplitude * waves[i].cosine
            if i == 0:
                expand_sine(count - 1, rows[ENGINE], terms.mean_torque, sine, cosine, waves[i].rate * unit)
            else:
                expand_sine(count - 1, rows[ENGINE], None, sine, cosine, waves[i].rate * unit)
        if pulsation is None:
            rows[LOAD, 0] = terms.mean_load if loaded else 0.0
        elif loaded:
            expand_sine(count - 1, rows[LOAD], terms.mean_load, pulsation[0] * drive.load_sine,
                        pulsation[0] * drive.load_cosine, pulsation[1] * unit)
        else:
            for k in range(COLUMNS):
                rows[LOAD, k] = 0.0


@fast
def add_chirp(rows: Any, row: int, count: int, sine: float, cosine: float, rate: float, growth: float,
              ahead: int = 0) -> None:
    """Add the first `count` coefficients of the sine of a quadratic angle, times x^ahead, to a row.

    Its derivative is (rate + growth x) times the cosine, which is the recurrence.
    """
    sine_before, cosine_before = 0.0, 0.0
    for k in range(count):
        rows[row, k + ahead] += sine
        following = (rate * cosine + growth * cosine_before) * INVERSE[k + 1]
        cosine_before, cosine = cosine, -(rate * sine + growth * sine_before) * INVERSE[k + 1]
        sine_before, sine = sine, following


@fast
def add_swells(rows: Any, count: int, unit: float, tau: float, phase: float, rate: float, growth: float,
               row: Any) -> None:
    """Add to Te the first `count` coefficients of the harmonics with varying amplitude, chirps times a + b x."""
    k = of.SWELLS
    while k < row.shape[0]:
        sine, cosine = sine_and_cosine(row[k] * phase + row[k + 1])
        amplitude, gain = row[k + 2] + row[k + 3] * (tau - row[of.TIME]), row[k + 3] * unit
        add_chirp(rows, ENGINE, count, amplitude * sine, amplitude * cosine, row[k] * rate, row[k] * growth)
        add_chirp(rows, ENGINE, count - 1, gain * sine, gain * cosine, row[k] * rate, row[k] * growth, 1)
        k += of.SWELL


@fast
def expand_varying(rows: Any, count: int, unit: float, tau: float, loaded: bool, waves: Any,
                   pulsation: Pulsation, row: Any, drive: Any) -> None:
    """Fill the coefficients of `expand_excitation` by a row of the profile."""
    rate, growth = frequency_at(tau, row) * unit, row[of.FREQUENCY_RATE] * unit * unit
    phase, torque, load = reached(tau, row)
    for k in range(count):
        rows[ENGINE, k] = 0.0
        rows[LOAD, k] = 0.0
    rows[ENGINE, 0] = torque
    rows[ENGINE, 1] = row[of.TORQUE_RATE] * unit
    for i in range(waves.shape[0]):
        wave = waves[i]
        add_chirp(rows, ENGINE, count, wave.amplitude * wave.sine, wave.amplitude * wave.cosine, wave.rate * rate,
                  wave.rate * growth)
    add_swells(rows, count, unit, tau, phase, rate, growth, row)
    if loaded:
        rows[LOAD, 0] = load
        rows[LOAD, 1] = row[of.LOAD_RATE] * unit
        add_chirp(rows, LOAD, count, pulsation[0] * drive.load_sine, pulsation[0] * drive.load_cosine,
                  pulsation[1] * rate, pulsation[1] * growth)


@fast
def load_phase(ratio: float, pulsation: Pulsation, cycle: int) -> float:
    """Return the load's phase at the start of an engine cycle, rad, without its whole turns, which are exact.

    The ratio of the frequencies is split by T. J. Dekker's method (Numerische Mathematik 18, 1971), so that the product
    of its greater part and the number of the cycle is exact.
    """
    if pulsation is None:
        return 0.0
    else:
        large = 134217729.0 * ratio
        head = large - (large - ratio)
        whole, rest = head * cycle, (ratio - head) * cycle
        return float(TWO_PI * ((whole - math.floor(whole)) + (rest - math.floor(rest))) + pulsation[2])


@fast
def clamp_edge(tau: float, end: float, shift: float, mean_load: float, pulsation: Pulsation,
               profile: Any) -> tuple[float, bool]:
    """Return the next time at which the clamp of Ts at 0 switches or the profile has a corner, at most `end`, and
    whether Ts is above 0 until then.
    """
    if profile is not None:
        return edge_varying(tau, end, pulsation, profile)
    elif pulsation is None:
        return end, mean_load > 0.0
    else:
        amplitude, rate = pulsation[0], pulsation[1]
        if abs(amplitude) <= mean_load:
            return end, mean_load > 0.0
        angle = (rate * tau + shift) % TWO_PI
        below = math.asin(mean_load / abs(amplitude))
        closing = math.pi + below if amplitude > 0.0 else below
        opening = TWO_PI - below if amplitude > 0.0 else math.pi - below
        ahead = math.inf
        for turn in range(3):
            for edge in (closing, opening):
                distance = edge + (turn - 1) * TWO_PI - angle
                if distance > 1e-11:
                    ahead = min(ahead, distance)
        until = min(end, tau + ahead / rate)
        if not until > tau:
            until = end
        middle = rate * (0.5 * (tau + until)) + shift
        return until, mean_load + amplitude * math.sin(middle) > 0.0


@fast
def torque_about_mean(tau: float, mean: float, waves: Any, row: Any) -> float:
    """Return Te at tau less a mean, N m."""
    phase, now, _ = reached(tau, row)
    torque = float(now - mean) + swell_and_rate(tau, phase, 1.0, row)[0]
    for i in range(waves.shape[0]):
        torque += waves[i].amplitude * sine_and_cosine(waves[i].rate * phase + waves[i].phase)[0]
    return torque


@fast
def load_and_rate(tau: float, pulsation: Pulsation, row: Any) -> tuple[float, float]:
    """Return Ts before the clamp, N m, and its rate, N m/s."""
    phase, _, load = reached(tau, row)
    sine, cosine = sine_and_cosine(pulsation[1] * phase + row[of.SHIFT])
    return (load + pulsation[0] * sine,
            row[of.LOAD_RATE] + pulsation[0] * pulsation[1] * frequency_at(tau, row) * cosine)


@fast
def bisected(low: float, high: float, which: int, pulsation: Pulsation, row: Any) -> float:
    """Return the time just behind a change of sign between low and high of the load (`which` 0) or its rate (1)."""
    rising = load_and_rate(high, pulsation, row)[which] > 0.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if (load_and_rate(middle, pulsation, row)[which] > 0.0) == rising:
            high = middle
        else:
            low = middle
    return high


@fast
def edge_varying(tau: float, end: float, pulsation: Pulsation, row: Any) -> tuple[float, bool]:
    """Return `clamp_edge` by a row of the profile, at most the end of the piece."""
    until = min(end, row[of.UNTIL])
    before, after = reached(tau, row)[2], reached(until, row)[2]
    if abs(pulsation[0]) <= min(before, after):
        return until, max(before, after) > 0.0
    step = GRID / (pulsation[1] * max(frequency_at(tau, row), frequency_at(until, row)))
    low = min(tau + PAST * step, 0.5 * (tau + until))
    value, rate = load_and_rate(low, pulsation, row)
    loaded = value > 0.0
    while low < until:
        high = min(low + step, until)
        value, following = load_and_rate(high, pulsation, row)
        if (rate > 0.0) != (following > 0.0):
            turn = bisected(low, high, 1, pulsation, row)
            if (load_and_rate(turn, pulsation, row)[0] > 0.0) != loaded:
                return bisected(low, turn, 0, pulsation, row), loaded
        if (value > 0.0) != loaded:
            return bisected(low, high, 0, pulsation, row), loaded
        low, rate = high, following
    return until, loaded
