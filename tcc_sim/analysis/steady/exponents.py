"""Floquet multipliers, and the largest Lyapunov exponent for both friction laws, with an interval and a diagnosis.

A periodic motion of period N has the exponent log |mu|/(N T) of its largest Floquet multiplier mu, the largest
eigenvalue of the product of the tangent maps over a period. Any other motion has the mean growth of a tangent vector
that is renormalised after every engine cycle (G. Benettin et al. (1980), Meccanica 15, 9 to 20). The exponent does not
depend on the norm; this one is the energy of the linear part. The tangent is that of the engine's stroboscopic map;
with the set-valued law it jumps where slip ends.

An exponent near 0 does not prove a quasi-periodic motion: slip may grow, the period may be long, or chaos weak. On a
torus, averages over the section with the weight of a smooth bump converge faster than any power of their length; in
chaos their difference falls as its square root (S. Das, Y. Saiki, E. Sander and J. A. Yorke (2017), Nonlinearity 30,
4111 to 4140).
"""

from __future__ import annotations

import math
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.steady.summary import periodicity, slip_grows
from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.model.closed_forms import common_cycles
from tcc_sim.model.parameters import System
from tcc_sim.result import Described, reported, result_class
from tcc_sim.solvers import solve
from tcc_sim.solvers.stroboscopic import Prepared
from tcc_sim.solvers.terms import Terms, natural_frequency, terms_of
from tcc_sim.trajectory import Cycles, Floats, State, concatenated

LOST = 1e-8
"""Reciprocal of a multiplier below which the pencil of several segments has lost half its digits (its error is some
1e-16 of the largest multiplier): such multipliers are those of the product.
"""
PAIR = 1e-9  # Relative difference of two multipliers that are one pair.


def multipliers_of(*blocks: Floats) -> NDArray[np.complex128]:
    """Floquet multipliers, in the order of `largest_first`.

    Of several segments, given in order, they are the finite eigenvalues of the pencil whose rows are x_(k+1) = M_k x_k
    and M_m x_m = lambda x_1: the product of the M_k, which may grow and shrink by many orders, is never formed.
    """
    m, n = len(blocks), len(blocks[0])
    if m == 1:
        values = np.linalg.eigvals(blocks[0])
    else:
        from scipy.linalg import eig  # Nobody else of those who ask for multipliers needs it.

        left, right = np.zeros((m * n, m * n)), np.zeros((m * n, m * n))
        for k, block in enumerate(blocks):
            rows = slice(k * n, k * n + n)
            left[rows, rows] = block
            if k + 1 < m:
                left[rows, (k + 1) * n:(k + 2) * n] = -np.eye(n)
        right[(m - 1) * n:, :n] = np.eye(n)
        top, bottom = eig(left, right, right=False, homogeneous_eigvals=True)
        finite = np.argsort(-np.abs(bottom))[:n]
        large = np.abs(bottom[finite]) < LOST * np.abs(top[finite])
        values = np.where(large, 0.0, top[finite] / np.where(large, 1.0, bottom[finite]))
        if large.any():
            whole = np.linalg.eigvals(product_of(np.array(blocks)))
            values[large] = whole[np.argsort(-np.abs(whole))][:int(large.sum())]
    return largest_first(values)


def product_of(blocks: Floats) -> Floats:
    """The product of the blocks, the first one rightmost."""
    return reduce(lambda whole, block: np.asarray(block @ whole), blocks)


def largest_first(multipliers: NDArray[Any]) -> NDArray[np.complex128]:
    """Multipliers, largest modulus first; the positive imaginary part first in a pair, whose moduli rounding may tell
    apart.
    """
    ordered = sorted(multipliers.tolist(), key=lambda m: (-abs(m), -m.imag))
    for k in range(len(ordered) - 1):
        if ordered[k].imag < 0.0 and abs(ordered[k] - ordered[k + 1].conjugate()) <= PAIR * abs(ordered[k]):
            ordered[k:k + 2] = ordered[k + 1], ordered[k]
    return np.array(ordered, np.complex128)


@result_class(repr=False)
class Lyapunov(Described):
    """The largest Lyapunov exponent.

    Examples
    --------
    >>> Lyapunov(1.51, 1.4, 1.6, 0.95, 2000, "chaotic")
    <Lyapunov 1.51 1/s (1.4 to 1.6): chaotic>
    """

    exponent: float = reported("mean growth rate of a small disturbance", "1/s")
    low: float = reported("lower end of its interval, for errors of steps and of sampling", "1/s")
    high: float = reported("upper end", "1/s")
    confidence: float = reported("confidence of the sampling, by batch means")
    cycles: int = reported("cycles averaged, or those of the period")
    diagnosis: str = reported(
        "periodic (up to `long_period`), chaotic (interval above 0), contracting (below 0, but no period found), "
        "quasi-periodic (interval around 0, averages converge as on a torus), runaway, or unresolved")

    def _text(self) -> str:
        return f"Lyapunov {self.exponent:.6g} 1/s ({self.low:.6g} to {self.high:.6g}): {self.diagnosis}"


CONFIDENCE, BATCHES = 0.95, 20
"""Confidence of the interval of a mean growth, and means of consecutive runs of cycles that it is computed from."""
ALIGNING = 50  # First engine cycles, not counted, in which the tangent vector turns to the direction of largest growth.
NEUTRAL = 0.02
"""Half width per cycle, in natural logarithm, up to which an interval that holds 0 counts as a zero exponent."""
FINE, COARSE, COMPARED, TOGETHER = 1e-7, 1e-6, 4, 1000
"""Relative tolerances of a mean growth, whose difference is its error, computed at one of so many cycles; cycles whose
tangent maps are computed in one call.
"""
PERIODIC_FINE, PERIODIC_COARSE, POLISHINGS = 1e-10, 1e-9, 4
"""The same tolerances about a periodic motion, and Newton steps towards it."""
CLOSED, NEARBY, PASSED = 1e-9, 0.1, 1e-6
"""Largest distances of a state from its image after a period and from the periodic motion, relative to its size;
logarithm of a multiplier above which a periodic motion is unstable, so that no motion settles on it.
"""
LONG_PERIOD, LONGEST_PERIOD = 128, 512
"""Longest period that is searched before another diagnosis; longest one of motion and excitation together."""
CONVERGED = 1e-6
"""Largest difference, relative to the size of the motion, of bump averages over the halves of a section on a torus."""
FIRST = np.array([1.0, 0.01, 1.0])
"""Initial tangent vector, in no special direction; in stick a change of slip speed alone has no effect."""


def largest_lyapunov_exponent(system: System, state: State, *, cycles: int = 2000, start_cycle: int = 0,
                              period: int = 0) -> Lyapunov:
    """Return the largest Lyapunov exponent of the motion from `state`, which should lie on the attractor.

    state : at t = start_cycle 2 pi/omega
    cycles : engine cycles averaged if there is no period, at least 40
    period : period of the section, engine cycles; 0 for none

    Raises InputError: too few cycles.
    """
    if not 2 * BATCHES <= cycles <= 10_000_000:
        raise InputError(f"cycles is {cycles}; a Lyapunov exponent needs {2 * BATCHES} to 10000000")
    unresolved = Lyapunov(math.nan, math.nan, math.nan, CONFIDENCE, cycles, "unresolved")
    start = np.array(state.numbers)
    if not np.isfinite(start).all():
        return unresolved
    excitation = common_cycles(system, LONGEST_PERIOD)
    together = math.lcm(period, excitation)
    if 0 < together <= LONGEST_PERIOD:
        return _periodic(system, start, start_cycle, together)
    try:
        growth, difference, run = tangent_growth(system, start, start_cycle, cycles + ALIGNING)
    except NumericalFailure:
        return unresolved
    growth, difference = growth[ALIGNING:], difference[ALIGNING // COMPARED:]
    if not (np.isfinite(growth).all() and np.isfinite(difference).all()):
        return unresolved
    mean, half = batch_means(growth)
    half += abs(float(difference.mean())) + 2.0 * float(difference.std()) / math.sqrt(len(difference))
    rate = 1.0 / system.cycle
    verdict = diagnosis(mean, half)
    if verdict != "chaotic":
        seen, long = _seen(run)
        together = math.lcm(long, excitation)
        if 0 < together <= LONGEST_PERIOD:
            return _periodic(system, run.section[-1], start_cycle + len(run), together)
        verdict = seen if verdict == "quasi-periodic" or seen == "runaway" else verdict
    return Lyapunov(mean * rate, (mean - half) * rate, (mean + half) * rate, CONFIDENCE, cycles, verdict)


def _periodic(system: System, start: Floats, first: int, period: int) -> Lyapunov:
    """Return the exponent of a motion of known period; none near an unstable orbit, which the motion only passes."""
    exponent, error = floquet_exponent(system, start, first, period)
    if (exponent - error) * period * system.cycle > PASSED:
        return Lyapunov(math.nan, math.nan, math.nan, CONFIDENCE, period, "unresolved")
    return Lyapunov(exponent, exponent - error, exponent + error, CONFIDENCE, period, "periodic")


def _seen(cycles: Cycles) -> tuple[str, int]:
    """Diagnose by its section a motion whose disturbances neither grow nor decay; return its long period, or 0, too."""
    if slip_grows(cycles):
        return "runaway", 0
    repetition = periodicity(cycles, maximum=LONG_PERIOD)
    if repetition.settled:
        return "periodic", repetition.period
    return ("quasi-periodic" if change_of_averages(cycles.section) <= CONVERGED else "unresolved"), 0


def change_of_averages(points: Floats) -> float:
    """Return the largest difference of bump averages over the two halves of a section (n, 3), relative to its size.

    The weight is exp(-1/(s (1 - s))) over each half, 0 < s < 1.
    """
    half = len(points) // 2
    s = (np.arange(half) + 1.0) / (half + 1.0)
    weight = np.exp(-1.0 / (s * (1.0 - s)))
    early, late = (weight @ part / weight.sum() for part in (points[:half], points[half:2 * half]))
    size = np.maximum(np.abs(points).max(axis=0), 1e-300)
    return float((np.abs(late - early) / size).max())


def diagnosis(mean: float, half: float) -> str:
    """Diagnose a motion without a period by its growth per cycle and the half width of the interval."""
    if mean - half > 0.0:
        return "chaotic"
    if mean + half < 0.0:
        return "contracting"
    return "quasi-periodic" if half <= NEUTRAL else "unresolved"


def batch_means(growth: Floats) -> tuple[float, float]:
    """Return the mean and the half width of its confidence interval, from batch means and Student's t."""
    from scipy.stats import t

    width = len(growth) // BATCHES
    means = growth[len(growth) - BATCHES * width:].reshape(BATCHES, width).mean(axis=1)
    half = float(t.ppf(0.5 + 0.5 * CONFIDENCE, BATCHES - 1)) * float(means.std(ddof=1)) / math.sqrt(BATCHES)
    return float(means.mean()), half


def floquet_exponent(system: System, state: Floats, first: int, period: int) -> tuple[float, float]:
    """Return log |mu|/(N T) of the largest multiplier of the periodic motion near `state`, and its error, 1/s.

    Newton's method brings the state onto the motion. The error is the difference between two tolerances, and for a
    state that does not close between two successive periods.
    """
    scale = natural_sizes(terms_of(system))
    at, start = state, state
    image, matrix = mapped(system, at, first, period, PERIODIC_FINE)
    gap = float(np.abs((image - at) / scale).max())
    for _ in range(POLISHINGS):
        if not gap > CLOSED:
            break
        step = np.linalg.lstsq(matrix - np.eye(3), at - image, rcond=1e-10)[0]
        following = at + step
        further, changed = mapped(system, following, first, period, PERIODIC_FINE)
        left = float(np.abs((further - following) / scale).max())
        if not left < gap or np.abs((following - start) / scale).max() > NEARBY:
            break
        at, image, matrix, gap = following, further, changed, left
    exponent = _exponent(matrix, system, period)
    error = abs(exponent - _exponent(mapped(system, at, first, period, PERIODIC_COARSE)[1], system, period))
    if not gap <= CLOSED:
        further = mapped(system, image, first, period, PERIODIC_FINE)[1]
        error += abs(exponent - _exponent(further, system, period))
    return exponent, error


def mapped(system: System, state: Floats, first: int, cycles: int, tolerance: float) -> tuple[Floats, Floats]:
    """Return the state after some engine cycles and the tangent map to it, (3, 3); NaN if a step fails."""
    try:
        image = Prepared(system, (), tolerance).over(state, first, first + cycles)
    except NumericalFailure:
        return np.full(3, math.nan), np.full((3, 3), math.nan)
    return image.state, image.derivative


def natural_sizes(terms: Terms) -> Floats:
    """Return the sizes of slip speed (rad/s), plate angle (rad) and plate speed (rad/s) of a motion, (3,)."""
    torque = abs(terms.mean_torque) + abs(terms.mean_load) + (terms.torque[0] if terms.torque is not None else 0.0)
    angle = max(torque, 1.0) / terms.linear.stiffness
    speed = angle * natural_frequency(terms)
    return np.array([speed, angle, speed])


def _exponent(matrix: Floats, system: System, period: int) -> float:
    """Return log |mu|/(N T) of the largest eigenvalue of a tangent map over N cycles, 1/s."""
    if not np.isfinite(matrix).all():
        return math.nan
    largest = float(np.abs(np.linalg.eigvals(matrix)).max())
    return math.log(max(largest, 1e-300)) / (period * system.cycle)


def tangent_growth(system: System, state: Floats, first: int, cycles: int) -> tuple[Floats, Floats, Cycles]:
    """Return the growth of a tangent vector along a motion; raise NumericalFailure if a step fails.

    returns : logarithm of the growth in every engine cycle, (cycles,); its difference from a coarser tolerance in one
        of `COMPARED` cycles; and the cycles
    """
    every, runs = COMPARED, list[Cycles]()
    growth, difference = np.full(cycles, np.nan), np.full(cycles // every, np.nan)
    linear = terms_of(system).linear
    i1, i2, stiffness = linear.flywheel, linear.plate, linear.stiffness
    energy = np.sqrt(np.array([[i1, 0.0, i1], [0.0, 0.0, i2], [0.0, stiffness, 0.0]]))
    fine, coarse = (Prepared(system, (), tolerance) for tolerance in (FINE, COARSE))
    vector = FIRST  # The caller drops its growth.
    for begin in range(0, cycles, TOGETHER):
        count = min(TOGETHER, cycles - begin)
        run = solve(system, cycles=count, state=State.of(state), start_cycle=first + begin).raise_for_status()
        assert run.cycles is not None
        runs.append(run.cycles)
        section, numbers = run.cycles.section, range(first + begin, first + begin + count)
        compared = range(every - 1 - begin % every, count, every)
        ends = [n + 1.0 for n in numbers]
        maps = [m.derivative for m in fine.each(section[:-1], list(numbers), ends)]
        rough = {c: coarse.over(section[c], numbers[c], ends[c]).derivative for c in compared}
        for c, matrix in enumerate(maps):
            following = matrix @ vector
            size = float(np.linalg.norm(energy @ following))
            growth[begin + c] = math.log(size)
            if c in rough:
                other = float(np.linalg.norm(energy @ (rough[c] @ vector)))
                difference[(begin + c) // every] = growth[begin + c] - math.log(other)
            vector = following / size
        state = section[-1]
    return growth, difference, concatenated(runs)
