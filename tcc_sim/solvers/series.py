"""Taylor series of the motion of the driveline by recurrences.

The recurrences are those of automatic differentiation (Hairer, Norsett and Wanner, Solving Ordinary Differential
Equations I, Sec. I.8; A. Jorba and M. Zou, Experimental Mathematics 14, 2005): E = exp(-alpha |v|) from
E' = -alpha sgn(v) v' E, T = tanh(sigma v) from T' = sigma (1 - T^2) v', a sine from its cosine. Coefficients are in
scaled time x = t/unit, so that none of them overflows. `product`, `exponential` and `motion` are staged
functions (`unrolled.unrolled`), and take plain numbers as well.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import fast, rebound
from tcc_sim.compiling.unrolled import exp, row_of, unrolled
from tcc_sim.model.equations import Linear, lost_torque
from tcc_sim.model.friction import decayed
from tcc_sim.polynomials.bernstein import powers_of

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
    """Return coefficient k >= 1 of the series with derivative rate v' `other`, without the share rate `other`_0 v_k;
    `weighted` holds j v_j.
    """
    return rate * (1.0 / k) * inner(weighted, other, k)


def exponential(rate: Any, weighted: Sequence[Any], e: list[Any], k: int) -> None:
    """Append coefficient k >= 1 of E = exp(rate v): E' = rate v' E."""
    e.append(driven(rate, weighted, e, k) + rate * (1.0 / k) * weighted[k] * e[0])


def decayed_along(out: Any, rows: Any, rate: Any) -> Iterator[int]:
    """Fill coefficients 0, 1, ... of exp(rate (v - v(0))); staged function."""
    e, weighted = [1.0], [0.0]
    out[0,] = 1.0
    for k in range(1, FRICTION_ORDER_MAXIMUM):
        weighted.append(float(k) * rows[SLIP, k])
        exponential(rate, weighted, e, k)
        out[k,] = e[k]
        if k % 2 == 1 and k >= 7:
            yield k


expand_decayed = unrolled(decayed_along)


def hyperbolic(rate: Any, weighted: Sequence[Any], tanh: list[Any], sech: list[Any], k: int) -> None:
    """Append coefficient k >= 1 of T = tanh(rate v) and of S = 1 - T^2: T' = rate v' S."""
    tanh.append(driven(rate, weighted, sech, k) + rate * (1.0 / k) * weighted[k] * sech[0])
    sech.append(-square(tanh, k))


def motion(rows: Any, unit: Any, linear: Linear, sign: Any, pulsation: Any, stribeck: Any, excess: Any, sigma: Any,
           tanh: Any, sech: Any) -> Iterator[int]:
    """Fill the coefficients of slip speed, plate angle and plate speed by equations (2), mubar by recurrence.

    Each coefficient waits for the one before it. Therefore v_k enters by one product: its share in coefficient k of
    mubar is the slope of mubar at the start times v_k, and the other terms are added up before.

    Parameters
    ----------
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
    on_flywheel, by_speed, on_plate = (None if loss is None else share * loss for share, loss in (
        (flywheel, linear.flywheel_by_slip), (flywheel, linear.flywheel_by_speed), (plate, linear.plate_by_slip)))
    v, x, u = [rows[SLIP, 0]], [rows[ANGLE, 0]], [rows[SPEED, 0]]
    rates = [] if stribeck is None else [-rate * sign for rate in stribeck[1::2]]
    each = [[share] for share in excesses(stribeck, excess, sign * v[0])]
    e, t, s = [added([one[0] for one in each])], [sign if tanh is None else tanh], [sech]
    drops = [rate * one[0] for rate, one in zip(rates, each)]
    fallen = added(drops)
    rising = 0.0 if tanh is None else sigma * sech
    slope = rising + (rising * e[0] + fallen * t[0])
    law, load, weighted = [t[0] + e[0] * t[0]], [rows[LOAD, 0]], [0.0]
    stiff = both * load[0] * slope
    if on_flywheel is not None:
        stiff = stiff + on_flywheel
    if on_plate is not None:
        stiff = stiff - on_plate
    pairs = [*((weighted, one) for one in each), None if tanh is None else (weighted, s),
             None if stribeck is None or tanh is None else (e, t), None if pulsation is None else (law, load)]
    packed: list[Any] = []
    for k in range(ORDER_MAXIMUM if stribeck is None and tanh is None else FRICTION_ORDER_MAXIMUM):
        spring = damping * u[k] + stiffness * x[k]
        push = flywheel * rows[ENGINE, k] + spring
        if by_speed is not None:
            push = push - by_speed * u[k]
        if k == 0:
            friction = load[0] * law[0]
            push = push - lost_torque(v[0], 0.0, on_flywheel, None)
            speed = push - both * friction + lost_torque(v[0], 0.0, on_plate, None)
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
        u.append(part * (plate * friction - spring - lost_torque(v[k], 0.0, on_plate, None)))
        x.append(part * unit * u[k])
        rows[SLIP, k + 1], rows[SPEED, k + 1], rows[ANGLE, k + 1] = v[k + 1], u[k + 1], x[k + 1]
        if k % 2 == 1 and k >= 7:
            yield k + 1


def added(numbers: Sequence[Any]) -> Any:
    """Return the sum of a few numbers, 0 of none."""
    return functools.reduce(operator.add, numbers) if numbers else 0.0


def excesses(stribeck: Any, first: Any, size: Any) -> list[Any]:
    """Return the values c exp(-a |v|) of the exponentials at a size |v|; the first one is given."""
    if stribeck is None:
        return []
    faded = rebound(decayed, exp=exp)
    return [first, *(stribeck[j] * faded(stribeck[j + 1], size) for j in range(2, len(stribeck), 2))]


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


def sine_coefficients(now: Any, quadrature: Any, rate: Any) -> Iterator[tuple[int, Any]]:
    """Yield coefficients of a sine, eight at a time, with the number of the first one."""
    for i, powers in zip(range(0, COLUMNS, 8), powers_of(rate)):
        yield i, powers * (now * OF_SINE[i:i + 8] + quadrature * OF_COSINE[i:i + 8])


def sine(out: Any, now: Any, quadrature: Any, rate: Any) -> Iterator[int]:
    """Add the coefficients of a sine; staged function."""
    for i, coefficients in sine_coefficients(now, quadrature, rate):
        out.set_row(out.row(i, count=8) + coefficients, i)
        yield i + 7


def sine_about(out: Any, mean: Any, now: Any, quadrature: Any, rate: Any) -> Iterator[int]:
    """Set the coefficients of a sine about a mean; staged function.

    A row of lanes that is read just after its numbers were written one by one would stall the processor.
    """
    for i, coefficients in sine_coefficients(now, quadrature, rate):
        out.set_row(coefficients + row_of([mean] + 7 * [0.0]) if i == 0 else coefficients, i)
        yield i + 7


expand_sine, expand_sine_about = unrolled(sine), unrolled(sine_about)


@fast
def add_sine(rows: Any, row: int, count: int, sine: float, cosine: float, rate: float) -> None:
    """Add `count` or up to seven more coefficients of a sine, given at the start with its quadrature, to a row."""
    expand_sine(count - 1, rows[row], sine, cosine, rate)


@fast
def set_sine(rows: Any, row: int, count: int, mean: float, sine: float, cosine: float, rate: float) -> None:
    """Set `count` or up to seven more coefficients of a row to those of a sine about a mean."""
    expand_sine_about(count - 1, rows[row], mean, sine, cosine, rate)


@fast
def add_integral(rows: Any, order: int, unit: float) -> None:
    """Fill coefficients 1 to `order` of theta1, the integral of slip speed + plate speed."""
    for k in range(order):
        rows[FLYWHEEL, k + 1] = unit * (rows[SLIP, k] + rows[SPEED, k]) * INVERSE[k + 1]
