"""Polynomials of a step: values, the first crossing of a level and extremes, certified by their Bernstein form.

A polynomial stays within the hull of its coefficients in this form, and by Descartes' rule of signs it has no root in
the interval where they do not change sign, and exactly one where they change it once; otherwise the interval is halved
(J. M. Lane and R. F. Riesenfeld, BIT 21, 1981; A. Eigenwillig, V. Sharma and C. K. Yap, ISSAC 2006), so that a dip into
the layer and out again within one step is found. Coefficients within the error of their rounding count as neither sign,
so the halving ends at a double root. A polynomial is a row of an array of coefficients: a view of the row would cost
two atomic reference counts at every call.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator
from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import fast
from tcc_sim.compiling.unrolled import folded, greater, lesser, magnitude, row_of, unrolled, where

DEGREE_MAXIMUM = 31
HALVINGS = 40
"""Most halvings of an interval: 2^-40 of a step is where the curvature of any polynomial is lost in rounding."""
WORKSPACE = (HALVINGS + 4, 40)
"""Shape of the array of floats that crossings and extremes work in."""

BERNSTEIN = 0
"""Row of the workspace with the coefficients over the whole step; the rows behind it are a stack."""
LEFT, WIDTH, NOISE, LOW, HIGH = range(32, 37)
"""Columns behind the coefficients: start and length of the interval, error bound of the coefficients; in the first row
also their hull."""

ROUNDING = 1.12e-16
PASCAL = np.array([[math.comb(i, k) for i in range(32)] for k in range(32)], dtype=np.float64)
PER_BINOMIAL = np.array([[1.0 / math.comb(n, k) if k <= n else 0.0 for k in range(32)] for n in range(32)])


def powers_of(x: Any) -> Iterator[Any]:
    """Yield 1, x, x^2, ... in rows of eight, by a short chain of products."""
    square = x * x
    cube, fourth = square * x, square * square
    row = row_of([1.0, x, square, cube, fourth, fourth * x, fourth * square, fourth * cube])
    while True:
        yield row
        row = row * (fourth * fourth)


def staged_form(lanes: int) -> Any:
    """Return the staged function of `to_bernstein` for degrees below `lanes`."""
    places = range(0, lanes, 8)

    def staged(c: Any, x: Any, per_binomial: Any, out: Any) -> None:
        weights = [per_binomial.row(i, count=8) for i in places]
        terms = [where(w, ">", 0.0, c.row(i, count=8) * power, 0.0)
                 for i, w, power in zip(places, weights, powers_of(x))]
        scaled = [term * weight for term, weight in zip(terms, weights)]
        size: Any = 0.0
        low, high = math.inf, -math.inf
        for i, weight, term in zip(places, weights, terms):
            size = magnitude(term) + size
            sums: list[Any] = [0.0, 0.0]
            for k in range(i + 8):
                sums[k % 2] = scaled[k // 8][k % 8] * PASCAL[k, i:i + 8] + sums[k % 2]
            row = sums[0] + sums[1]
            out.set_row(row, i)
            low = lesser(where(weight, ">", 0.0, row, math.inf), low)
            high = greater(where(weight, ">", 0.0, row, -math.inf), high)
        out[NOISE,], out[LOW,], out[HIGH,] = folded(operator.add, size), folded(lesser, low), folded(greater, high)

    return staged


form_24, form_32 = (unrolled(staged_form(lanes)) for lanes in (24, 32))


@fast
def to_bernstein(c: Any, row: int, degree: int, x_end: float, workspace: Any) -> None:
    """Fill the first row of the workspace with the Bernstein coefficients over [0, x_end], their hull and error bound.

    b_i = sum_k C(i, k)/C(n, k) c_k x_end^k. The weights lie in [0, 1], so n products and sums of rounded terms
    are wrong by at most about 2 n units of rounding of sum |c_k| x_end^k.
    """
    if degree < 24:
        form_24(0, c[row], x_end, PER_BINOMIAL[degree], workspace[BERNSTEIN])
    else:
        form_32(0, c[row], x_end, PER_BINOMIAL[degree], workspace[BERNSTEIN])
    workspace[BERNSTEIN, LEFT] = 0.0
    workspace[BERNSTEIN, WIDTH] = x_end
    workspace[BERNSTEIN, NOISE] *= (2.0 * degree + 8.0) * ROUNDING


@fast
def halve(workspace: Any, row: int, degree: int) -> None:
    """Halve the interval by de Casteljau's algorithm: the left half goes to the next row, the right one stays."""
    for k in range(degree + 1):
        workspace[row + 1, k] = workspace[row, 0]
        for i in range(degree - k):
            workspace[row, i] = 0.5 * (workspace[row, i] + workspace[row, i + 1])
    size = 0.0
    for i in range(degree + 1):
        size = max(size, max(abs(workspace[row, i]), abs(workspace[row + 1, i])))
    half = 0.5 * workspace[row, WIDTH]
    noise = workspace[row, NOISE] + degree * ROUNDING * size
    workspace[row + 1, LEFT] = workspace[row, LEFT]
    workspace[row, LEFT] += half
    for i in range(row, row + 2):
        workspace[i, WIDTH] = half
        workspace[i, NOISE] = noise


@fast
def later_part(workspace: Any, row: int, degree: int, at: float) -> None:
    """Cut the first part `at` of the interval away, by de Casteljau's algorithm."""
    for k in range(degree):
        for i in range(degree - k):
            workspace[row, i] = (1.0 - at) * workspace[row, i] + at * workspace[row, i + 1]
    low, high = workspace[row, 0], workspace[row, 0]
    for i in range(1, degree + 1):
        low, high = min(low, workspace[row, i]), max(high, workspace[row, i])
    workspace[row, LOW], workspace[row, HIGH] = low, high
    workspace[row, LEFT] += at * workspace[row, WIDTH]
    workspace[row, WIDTH] *= 1.0 - at
    workspace[row, NOISE] += 3.0 * degree * ROUNDING * max(abs(low), abs(high))


@fast
def slope_changes(workspace: Any, row: int, degree: int) -> tuple[int, float, float]:
    """Return for the polynomial of a row the number of sign changes of its slope by Descartes' rule, the place of the
    last one as a share of the interval, and the last step between coefficients.
    """
    noise, changes, last, place = workspace[row, NOISE], 0, 0.0, 0.0
    for i in range(degree):
        difference = workspace[row, i + 1] - workspace[row, i]
        if abs(difference) > 2.0 * noise:
            if difference * last < 0.0:
                changes += 1
                place = (i - difference / (difference - last)) / (degree - 1.0)  # The slope's own degree.
            last = difference
    return changes, place, last


@fast
def search_on(workspace: Any, row: int, degree: int, changes: int, shortest: float) -> int:
    """Halve the interval of the stack's top row if its slope changes sign more than once, else drop it; return the top.
    """
    if changes < 2 or workspace[row, WIDTH] <= shortest or row + 2 >= WORKSPACE[0]:
        return row - 1
    halve(workspace, row, degree)
    return row + 1


@fast
def isolate(workspace: Any, degree: int, threshold: float) -> tuple[float, float, float]:
    """Return an interval with exactly one root, the first at which the polynomial of row 1 falls, and a guess of it.

    Coefficients within `threshold` or within their rounding of 0 have no sign, but count as positive at the start of
    an interval, so that a root there is found. (inf, inf, inf) where it does not fall through 0.
    """
    top = 1
    shortest = workspace[1, WIDTH] * 2.0 ** -HALVINGS
    while top > 0:
        tiny = max(workspace[top, NOISE], threshold)
        last = -1.0 if workspace[top, 0] < -tiny else 1.0
        start = last
        changes = 0
        place = 1
        for i in range(degree + 1):
            coefficient = workspace[top, i]
            if abs(coefficient) > tiny and coefficient * last < 0.0:
                changes += 1
                last = -last
                place = i
        left, width = workspace[top, LEFT], workspace[top, WIDTH]
        if changes == 1 and start > 0.0:
            fall = workspace[top, place - 1] - workspace[top, place] if place > 0 else 0.0
            part = min(max(workspace[top, place - 1] / fall, 0.0), 1.0) if fall > 0.0 else 0.5
            return left, left + width, left + width * (place - 1.0 + part) / degree
        if changes < 2:
            top -= 1
        elif width <= shortest or top + 2 >= WORKSPACE[0]:
            return left, left, left
        else:
            halve(workspace, top, degree)
            top += 1
    return math.inf, math.inf, math.inf


@fast
def value(c: Any, row: int, degree: int, x: float) -> float:
    """Return sum over k of c[row, k] x^k, k = 0 to degree."""
    out = c[row, degree]
    for k in range(degree - 1, -1, -1):
        out = out * x + c[row, k]
    return float(out)


@fast
def values(c: Any, degree: int, x: float) -> tuple[float, float, float]:
    """Return the values of rows 0, 1 and 2, two powers at a time, which halves the chain of dependent sums."""
    odd, square = degree % 2, x * x
    first, second, third = odd * c[0, degree], odd * c[1, degree], odd * c[2, degree]
    for k in range(degree - 1 - odd, 0, -2):
        first = first * square + (c[0, k + 1] * x + c[0, k])
        second = second * square + (c[1, k + 1] * x + c[1, k])
        third = third * square + (c[2, k + 1] * x + c[2, k])
    return c[0, 0] + x * first, c[1, 0] + x * second, c[2, 0] + x * third


@fast
def value_and_slope(c: Any, row: int, degree: int, x: float) -> tuple[float, float]:
    """Return the polynomial and its first derivative."""
    out = c[row, degree]
    slope = 0.0
    for k in range(degree - 1, -1, -1):
        slope = slope * x + out
        out = out * x + c[row, k]
    return out, slope


@fast
def slope_and_curvature(c: Any, row: int, degree: int, x: float) -> tuple[float, float]:
    """Return the first and second derivative of the polynomial."""
    slope = 0.0
    curvature = 0.0
    for k in range(degree, 0, -1):
        curvature = curvature * x + slope
        slope = slope * x + k * c[row, k]
    return slope, curvature


@fast
def variation(c: Any, row: int, degree: int, x: float) -> float:
    """Return a bound on the distance of the polynomial from its first value over [0, x]."""
    out = 0.0
    for k in range(degree, 0, -1):
        out = (out + abs(c[row, k])) * x
    return out


@fast
def fall_within(c: Any, row: int, degree: int, low: float, high: float, x: float, sign: float, level: float,
                accuracy: float, since: float) -> float:
    """Return the one root between low and high at which sign * polynomial falls to `level`, by Newton's method.

    A root `since` at or above 0, where the polynomial was at the level before, is divided out.
    """
    last = 4e-16 * high
    for _ in range(80):
        v, slope = value_and_slope(c, row, degree, x)
        q, way = sign * v - level, sign * slope
        if since >= 0.0:
            ahead = max(x - since, 1e-300)
            way = (way - q / ahead) / ahead
            q /= ahead
        if q > 0.0:
            low = x
        else:
            high = x
        following = x - q / way if way < 0.0 else math.inf
        if not low <= following <= high:
            following = 0.5 * (low + high)
        if abs(following - x) <= last or (since < 0.0 and abs(q) <= accuracy):
            return following
        x = following
    return x


@fast
def fall_from(c: Any, row: int, degree: int, x_start: float, sign: float, level: float, accuracy: float,
              workspace: Any) -> float:
    """Return `first_crossing` from x_start on, for the polynomial whose Bernstein coefficients are in row 1."""
    noise = workspace[1, NOISE] + 2.0 * ROUNDING * abs(level)
    for i in range(degree + 1):
        workspace[1, i] = sign * workspace[1, i] - level
    workspace[1, NOISE] = noise
    first = workspace[1, 0]
    if first <= accuracy and workspace[1, 1] - first < -2.0 * noise:
        return x_start
    since, threshold, last = -1.0, 0.5 * accuracy, degree
    if abs(first) <= accuracy:
        # The quotient by (x - x_start), whose own Bernstein coefficients these are, has the other roots.
        for i in range(degree):
            workspace[1, i] = (workspace[1, i + 1] - first) * (degree / (i + 1.0))
        workspace[1, NOISE] = 2.0 * degree * noise
        since, threshold, last = x_start, 0.0, degree - 1
        level += first
    low, high, guess = isolate(workspace, last, threshold)
    if low < high:
        return float(fall_within(c, row, degree, low, high, guess, sign, level, accuracy, since))
    return float(low)


@fast
def crossing_of(c: Any, row: int, degree: int, sign: float, level: float, accuracy: float, workspace: Any) -> float:
    """Return `first_crossing` of the polynomial whose Bernstein coefficients are in the workspace."""
    tiny = max(workspace[BERNSTEIN, NOISE] + 2.0 * ROUNDING * abs(level), 0.5 * accuracy)
    least = workspace[BERNSTEIN, LOW] if sign > 0.0 else -workspace[BERNSTEIN, HIGH]
    if not least - level < -tiny:
        return math.inf
    for i in range(WORKSPACE[1]):
        workspace[1, i] = workspace[BERNSTEIN, i]
    return float(fall_from(c, row, degree, 0.0, sign, level, accuracy, workspace))


@fast
def first_crossing(c: Any, row: int, degree: int, x_end: float, sign: float, level: float, accuracy: float,
                   workspace: Any) -> float:
    """Return the first x in [0, x_end] at which sign * polynomial falls to `level`; inf if it does not.

    A polynomial that starts within `accuracy` of the level crosses at 0 if it falls, else where it returns to its first
    value; one that starts below crosses at 0 if it falls, else where it falls back after it has passed the level. A dip
    below the level by less than half of `accuracy`, or than the rounding of its coefficients, is no crossing.

    c : array of coefficients; the polynomial is sum over k of c[row, k] x^k, k = 0 to degree, at most DEGREE_MAXIMUM
    workspace : array of shape WORKSPACE; its first row is left with the Bernstein coefficients over [0, x_end]
    """
    to_bernstein(c, row, degree, x_end, workspace)
    return float(crossing_of(c, row, degree, sign, level, accuracy, workspace))


@fast
def stick_crossing(c: Any, row: int, degree: int, x_start: float, x_end: float, mode: int, level: float,
                   workspace: Any) -> float:
    """Return the first x in (x_start, x_end] at which the slip speed leaves `mode` (-1, 1: slip; 0: |v| <= level).

    The first row of the workspace holds the Bernstein coefficients over [0, x_end] (`to_bernstein`).
    """
    crossing = math.inf
    for side in range(-1, 2, 2):
        if mode != 0 and side != mode:
            continue
        for i in range(WORKSPACE[1]):
            workspace[1, i] = workspace[BERNSTEIN, i]
        if x_start > 0.0:
            later_part(workspace, 1, degree, x_start / x_end)
        sign, limit = (float(side), level) if mode != 0 else (-float(side), -level)
        crossing = min(crossing, fall_from(c, row, degree, x_start, sign, limit, 1e-11 * level, workspace))
    return crossing


@fast
def turning(c: Any, row: int, degree: int, low: float, high: float, x: float, rising: bool, small: float,
            near: float) -> float:
    """Return the one root of the polynomial's slope between low, where it is `rising` or not, and high, from a guess x,
    by Newton's method; its last step changes the polynomial by `small` or x by `near` times `high` at most.
    """
    for _ in range(80):
        slope, curvature = slope_and_curvature(c, row, degree, x)
        if (slope > 0.0) == rising:
            low = x
        else:
            high = x
        following = x - slope / curvature if curvature != 0.0 else math.inf
        if not low <= following <= high:
            following = 0.5 * (low + high)
        if abs(slope * (following - x)) <= small or abs(following - x) <= near * high:
            return float(following)
        x = following
    return x


@fast
def one_way(degree: int, noise: float, workspace: Any) -> bool:
    """Return whether the polynomial whose Bernstein coefficients are in the first row is monotone."""
    rises, falls = 0, 0
    for i in range(degree):
        change = workspace[BERNSTEIN, i + 1] - workspace[BERNSTEIN, i]
        rises += 1 if change > noise else 0
        falls += 1 if change < -noise else 0
    return rises == 0 or falls == 0


@fast
def extremes_of(c: Any, row: int, degree: int, x_end: float, highest: float, lowest: float,
                workspace: Any) -> tuple[float, float]:
    """Return `highest` and `lowest` widened by a polynomial's extremes over [0, x_end]; its Bernstein coefficients are
    in the workspace.
    """
    if not (workspace[BERNSTEIN, HIGH] > highest or workspace[BERNSTEIN, LOW] < lowest):
        return highest, lowest
    start, end = workspace[BERNSTEIN, 0], workspace[BERNSTEIN, degree]
    highest, lowest = max(highest, max(start, end)), min(lowest, min(start, end))
    if one_way(degree, 2.0 * workspace[BERNSTEIN, NOISE], workspace):
        return highest, lowest
    for i in range(WORKSPACE[1]):
        workspace[1, i] = workspace[BERNSTEIN, i]
    top = 1
    shortest = x_end * 2.0 ** -HALVINGS
    while top > 0:
        noise = workspace[top, NOISE]
        outside, changes, place, last = 0, 0, 0.0, 0.0
        for i in range(degree + 1):
            coefficient = workspace[top, i]
            outside += 1 if coefficient > highest + noise or coefficient < lowest - noise else 0
        if outside > 0:
            highest = max(highest, workspace[top, 0], workspace[top, degree])
            lowest = min(lowest, workspace[top, 0], workspace[top, degree])
            changes, place, last = slope_changes(workspace, top, degree)
        if changes == 1:
            left, width = workspace[top, LEFT], workspace[top, WIDTH]
            at = turning(c, row, degree, left, left + width, left + width * place, last < 0.0, 0.1 * noise, 4e-16)
            v = value(c, row, degree, at)
            highest, lowest = max(highest, v), min(lowest, v)
        top = search_on(workspace, top, degree, changes, shortest)
    return highest, lowest
