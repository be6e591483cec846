"""The nonlinear equations of a collocation step, b - L V - beta Ts mubar(V) = 0 for the slip speeds V at the nodes.

They are solved by Newton's method, with the diagonal alone where friction outweighs the rest. Operations on all nodes
are straight-line code on rows of 16 numbers (`unrolled`), which the processor handles four or eight at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tcc_sim.compiling.compiled import fast
from tcc_sim.compiling.unrolled import (
    folded,
    largest_size,
    lesser,
    limited,
    row_of,
    unrolled,
)
from tcc_sim.model.friction import Stribeck
from tcc_sim.polynomials.bernstein import WORKSPACE
from tcc_sim.solvers.collocation import FROM_WAVES, NODES, TERMS, TO_CHEBYSHEV, TO_POWERS
from tcc_sim.solvers.law_on import STAGED, law_on
from tcc_sim.solvers.series import COLUMNS, ROWS, added

ITERATIONS_MAXIMUM = 20
DOMINANT = 6.0
"""Ratio of beta Ts mubar' to the last, largest diagonal term of L above which Newton's matrix counts as diagonal."""
FOLLOWED = 0.7
"""Largest change of sigma V in an iteration of Newton's method: over a longer one tanh changes too much."""
LEAST_SLOPE = 0.05
"""Slope of mubar, relative to sigma, below which a residual does not measure the distance of V from the solution."""
STALLED, ROUNDED = 0.3, 100.0
"""Corrections are rounding if they shrink by less than the first factor and are below the second times `accuracy`."""
LARGEST, LEAST = range(2)
"""Entries of `measure`: Newton's largest correction, and the least beta Ts mubar' at the nodes."""
WIDTH = 4
"""Numbers in a part of a column."""

SLIDING, FALLING, LAYER = range(3)
"""Regions by |v|: mubar is constant, its exponential varies, tanh varies too."""

WAVES_MAXIMUM = 33
"""Sines of the engine torque: the first and 32 harmonics."""

WORK = np.dtype([
    ("rows", np.float64, (ROWS + 2, COLUMNS)), ("bernstein", np.float64, WORKSPACE),
    ("slip", np.float64, NODES), ("law", np.float64, NODES), ("slope", np.float64, NODES),
    ("friction_rate", np.float64, NODES),
    ("balance", np.float64, NODES), ("demand", np.float64, NODES), ("change", np.float64, NODES),
    ("chebyshev", np.float64, TERMS), ("measure", np.float64, 2),
    ("weights", np.float64, FROM_WAVES + 2 * WAVES_MAXIMUM)])
"""Work space.

rows, bernstein : the polynomials of a step, in powers of its time, two of them an engine's own; work space of searches
slip, law, slope, friction_rate : at the nodes, V, mubar(V), mubar'(V) and beta Ts
balance, demand : at the nodes, b without the share of v(0), and b/(beta Ts), what mubar would be without inertia
change, measure : Newton's correction of V; LARGEST and LEAST
chebyshev : coefficients over the step of the polynomial in hand
weights : factors of the sources
"""


class Place(NamedTuple):
    """Region of the state, sign of v, and tolerances of v and theta2' of a step."""

    region: int
    sign: float
    slip_tolerance: float
    speed_tolerance: float


@unrolled
def evaluate_law(slip: Any, law: Any, slope: Any, sign: Any, sigma: Any, stribeck: Any) -> None:
    """Fill mubar of (7), or of (6) where sigma is None, and its slope at the nodes, with |v| continued as sign * v
    through v = 0, where a step ends.
    """
    v, total, fall = slip.row(), 0.0, 0.0
    if stribeck is not None:
        _, total, fall = STAGED.exponentials_at(v * sign, stribeck)
    elif sigma is None:
        return  # mubar is constant in slip.
    step, rest = (sign, 0.0) if sigma is None else STAGED.step_and_rest(v * sigma)
    values, falls = STAGED.with_slope(total, fall, sign, 0.0 if sigma is None else sigma, step, rest)
    law.set_row(values)
    slope.set_row(falls)


@unrolled
def guess(demand: Any, slip: Any, sign: Any, sigma: Any, stribeck: Any) -> None:
    """Fill the slip speeds at which mubar meets the demand on its rising branch, to two per cent."""
    required = demand.row()
    if stribeck is None:
        v = inverse_tanh(limited(required, -0.98, 0.98))
    else:
        v = inverse_tanh(limited(required * (1.0 / (1.0 + added(stribeck[::2]))), -0.98, 0.98)) / sigma
        _, total, _ = law_on(quadratic).exponentials_at(v * sign, stribeck)
        v = inverse_tanh(limited(required / (1.0 + total), -0.985, 0.985))
    slip.set_row(v / sigma)


def quadratic(x: Any) -> Any:
    """Return e^x to second order within [-1, 1]."""
    x = limited(x, -1.0, 1.0)
    return 1.0 + x * (1.0 + 0.5 * x)


def inverse_tanh(y: Any) -> Any:
    """Return a number whose tanh is y to two per cent, for |y| up to 0.985."""
    s = y * y
    return y * (1.0 - s * (0.7789 - 0.0936 * s)) / (1.0 - s * (1.1122 - 0.2236 * s))


@unrolled
def evaluate_residual(coupling: Any, slip: Any, law: Any, slope: Any, friction_rate: Any, balance: Any, start: Any,
                      v: Any, change: Any, measure: Any) -> None:
    """Fill `change` with b - L V - beta Ts mubar(V), and measure[LEAST]."""
    speeds = slip.row()
    sums = [0.0, 0.0, 0.0, 0.0]
    for j in range(NODES):
        sums[j % 4] = sums[j % 4] + coupling.row(j, 0) * speeds[j]
    change.set_row((balance.row() - friction_rate.row() * law.row() + start.row() * v)
                   - ((sums[0] + sums[1]) + (sums[2] + sums[3])))
    measure[LEAST,] = folded(lesser, friction_rate.row() * slope.row())


@unrolled
def correct_by_friction(change: Any, slip: Any, friction_rate: Any, slope: Any, sigma: Any) -> None:
    """Correct V by the residual over the slope of friction alone, at most by FOLLOWED."""
    stiffness = friction_rate.row() * limited(slope.row() / sigma, LEAST_SLOPE, 1e300)
    correction = limited(change.row() / stiffness, -FOLLOWED, FOLLOWED)
    slip.set_row(slip.row() + correction / sigma)


@unrolled
def divide(change: Any, diagonal: Any, friction_rate: Any, slope: Any, measure: Any) -> None:
    """Fill Newton's correction by the diagonal of its matrix alone."""
    out = change.row() / (diagonal.row() + friction_rate.row() * slope.row())
    change.set_row(out)
    measure[LARGEST,] = largest_size(out)


@unrolled
def eliminate(change: Any, coupling: Any, friction_rate: Any, slope: Any, measure: Any) -> None:
    """Fill Newton's correction: (L + beta Ts mubar') x = change, by Gauss and Jordan's elimination.

    It needs no pivoting: L is dominated by a^-1, whose leading minors do not vanish, and friction adds to the diagonal
    where it is strong.
    """
    correction, = eliminated(coupling, friction_rate, slope,
                             [[change.row(WIDTH * p, count=WIDTH) for p in range(NODES // WIDTH)]])
    change.set_row(correction)
    measure[LARGEST,] = largest_size(correction)


@unrolled
def eliminate_rows(rows: Any, coupling: Any, friction_rate: Any, slope: Any) -> None:
    """Solve the same equations for every row of `rows`."""
    count, parts = rows.shape[0], range(NODES // WIDTH)
    right = [[rows.row(i, WIDTH * p, count=WIDTH) for p in parts] for i in range(count)]
    for i, correction in enumerate(eliminated(coupling, friction_rate, slope, right)):
        rows.set_row(correction, i, 0)


def eliminated(coupling: Any, friction_rate: Any, slope: Any, sides: list[list[Any]]) -> list[Any]:
    """Return the solutions for right-hand sides, each in parts of WIDTH numbers."""
    parts = range(NODES // WIDTH)
    columns = [[coupling.row(j, WIDTH * p, count=WIDTH) for p in parts] for j in range(NODES)]
    for p in parts:
        added = friction_rate.row(WIDTH * p, count=WIDTH) * slope.row(WIDTH * p, count=WIDTH)
        for lane in range(WIDTH):
            columns[WIDTH * p + lane][p] = columns[WIDTH * p + lane][p] + added * _lanes(lambda i, lane=lane: i == lane)
    inverses = []
    for k in range(NODES):
        vector, lane = divmod(k, WIDTH)
        inverses.append(1.0 / columns[k][vector][lane])
        factors = [part * inverses[k] for part in columns[k]]
        factors[vector] = factors[vector] * _lanes(lambda i, lane=lane: i != lane)
        for column in [*columns[k + 1:], *sides]:
            head = column[vector][lane]
            for p, factor in enumerate(factors):
                column[p] = column[p] - factor * head
    return [row_of([right[k // WIDTH][k % WIDTH] * inverses[k] for k in range(NODES)]) for right in sides]


def _lanes(chosen: Any) -> tuple[float, ...]:
    """Return 1 in the chosen lanes of a part of a column, 0 elsewhere."""
    return tuple(1.0 if chosen(i) else 0.0 for i in range(WIDTH))


@unrolled
def add_share(total: Any, share: Any, weight: Any) -> None:
    """Add a source times its weight."""
    total.set_row(total.row() + share.row() * weight)


@unrolled
def add_slip(slip: Any, shares: Any, chebyshev: Any) -> None:
    """Add the shares of the slip speeds at the nodes to Chebyshev coefficients."""
    speeds, out = slip.row(), chebyshev.row()
    for j in range(NODES):
        out = out + shares.row(j, 0) * speeds[j]
    chebyshev.set_row(out)


@unrolled
def slip_polynomial(slip: Any, v: Any, chebyshev: Any, powers: Any) -> None:
    """Fill the polynomial through v at the start and V at the nodes: Chebyshev coefficients, and powers of x."""
    speeds = slip.row()
    sums = [v * TO_CHEBYSHEV[0], 0.0]
    for j in range(NODES):
        sums[(j + 1) % 2] = sums[(j + 1) % 2] + speeds[j] * TO_CHEBYSHEV[j + 1]
    chebyshev.set_row(sums[0] + sums[1])
    staged_powers(chebyshev, powers)


def staged_powers(chebyshev: Any, powers: Any) -> None:
    """Fill powers of x from Chebyshev coefficients over [0, 1]."""
    coefficients = chebyshev.row()
    out: Any = 0.0
    for i in range(NODES + 1):
        out = out + coefficients[i] * TO_POWERS[i]
    powers.set_row(out, 0)


to_powers = unrolled(staged_powers)


@fast
def follow_manifold(step_size: Any, v: float, sign: float, sigma: float, stribeck: Stribeck, work: Any) -> None:
    """Improve the guess in stick, where V changes little from node to node, by b - L V - beta Ts mubar(V) = 0 with the
    guess in L V. It costs a third of an iteration, and saves one.
    """
    evaluate_law(0, work.slip, work.law, work.slope, sign, sigma, stribeck)
    evaluate_residual(0, step_size.coupling, work.slip, work.law, work.slope, work.friction_rate, work.balance,
                      step_size.start, v, work.change, work.measure)
    correct_by_friction(0, work.change, work.slip, work.friction_rate, work.slope, sigma)


@fast
def law_at_nodes(place: Place, sigma: float | None, stribeck: Stribeck, work: Any) -> None:
    """Fill mubar and its slope at the nodes; mubar stays constant past the region's edge, where the step is cut."""
    if place.region == SLIDING:
        for i in range(NODES):
            work.law[i], work.slope[i] = place.sign, 0.0
    else:
        evaluate_law(0, work.slip, work.law, work.slope, place.sign, sigma, stribeck)


@fast
def solve_stages(step_size: Any, v: float, place: Place, sharpness: float, sigma: float | None, stribeck: Stribeck,
                 accuracy: float, work: Any) -> int:
    """Solve by Newton's method from the guess in work.slip; mubar changes with v as fast as `sharpness`, s/rad.

    Returns the iterations, negative where they did not converge to `accuracy` (rad/s).
    """
    slip, law, slope, friction_rate, change = work.slip, work.law, work.slope, work.friction_rate, work.change
    measure, coupling, diagonal = work.measure, step_size.coupling, step_size.diagonal
    law_at_nodes(place, sigma, stribeck, work)
    last = 1e300
    for count in range(1, ITERATIONS_MAXIMUM + 1):
        evaluate_residual(0, coupling, slip, law, slope, friction_rate, work.balance, step_size.start, v, change,
                          measure)
        contraction = 0.0
        if measure[LEAST] > DOMINANT * diagonal[NODES - 1]:
            divide(0, change, diagonal, friction_rate, slope, measure)
            contraction = 0.5
        else:
            eliminate(0, change, coupling, friction_rate, slope, measure)
        size = measure[LARGEST]
        if not size < 1e300:
            return -count
        step = FOLLOWED / (sharpness * size) if sharpness * size > FOLLOWED else 1.0
        for i in range(NODES):
            slip[i] += step * change[i]
        if count > 1:
            contraction = min(size / last, contraction)
        if step == 1.0 and (2.0 * sharpness * size + contraction) * size <= accuracy:
            return count
        if STALLED * last < size <= ROUNDED * accuracy:
            return count
        if count > 4 and size > 2.0 * last:
            return -count
        last = size
        law_at_nodes(place, sigma, stribeck, work)
    return -ITERATIONS_MAXIMUM
