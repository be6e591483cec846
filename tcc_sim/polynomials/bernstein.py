"""Bernstein form of a polynomial on an interval: coefficients, halving, and isolation of a root.

A polynomial stays within the hull of its coefficients in this form, and by Descartes' rule of signs it has no root in
the interval where they do not change sign, and exactly one where they change it once; otherwise the interval is halved
(J. M. Lane and R. F. Riesenfeld, BIT 21, 1981; A. Eigenwillig, V. Sharma and C. K. Yap, ISSAC 2006). Coefficients
within the error of their rounding count as neither sign, so the halving ends at a double root.
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


form_16, form_24, form_32 = (unrolled(staged_form(lanes)) for lanes in (16, 24, 32))


@fast
def to_bernstein(c: Any, row: int, degree: int, x_end: float, workspace: Any) -> None:
    """Fill the first row of the workspace with the Bernstein coefficients over [0, x_end], their hull and error bound.

    b_i = sum_k C(i, k)/C(n, k) c_k x_end^k. The weights lie in [0, 1], so n products and sums of rounded terms
    are wrong by at most about 2 n units of rounding of sum |c_k| x_end^k.
    """
    if degree < 16:
        form_16(0, c[row], x_end, PER_BINOMIAL[degree], workspace[BERNSTEIN])
    elif degree < 24:
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
