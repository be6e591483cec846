"""Sliding friction from a measurement: mu(v) = m (1 + sum over j of s_j exp(-a_j |v|)) with a confidence band.

The numbers m, s_j and a_j are free parameters of the fit. They are strongly correlated and mean little individually; a
measurement determines mu(v) at the slip speeds of the motion.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.stats import chi2

from tcc_sim.errors import InputError
from tcc_sim.estimation.measurement import Measurement, noise_of
from tcc_sim.model.friction import decayed, exponentials
from tcc_sim.model.friction_curve import FASTEST_RATE, MOST_TERMS, SLOWEST, FrictionCurve
from tcc_sim.model.groups import TABLE, TABULATED, Friction
from tcc_sim.model.parameters import System
from tcc_sim.result import reported, result_class
from tcc_sim.solvers.law import sliding_at
from tcc_sim.solvers.terms import terms_of, torques_at
from tcc_sim.trajectory import Floats

CURVE = "friction.curve"  # Free key of the whole curve, in place of TABULATED.
CONSTANT = f"{CURVE}.constant"
SHARES = tuple(f"{CURVE}.share_{j}" for j in range(1, MOST_TERMS + 1))
RATES = tuple(f"{CURVE}.rate_{j}" for j in range(1, MOST_TERMS + 1))
PAIRS = 2  # Default number of exponentials of a curve.
SPEEDS = 81  # Number of slip speeds of a curve.
TRIED, FEWEST = 16, 40
"""Number of start rates, evenly spaced in logarithm, and least number of samples in slip for their choice."""
STEEPEST = 1000.0  # Largest rate times the fastest slip speed; a faster decay lasts only a sample or two.
VISITS, NEAR = 8, 1.5  # Number of samples that visit a slip speed, and largest ratio of their speeds to it.
LARGEST_SHARE, LEAST_SHARE, USUAL_SHARE = 20.0, 0.02, 0.1
"""Largest share; least size of a start, since the rate of a zero share has no effect; and usual size of a share."""


@result_class
class IdentifiedCurve:
    """Sliding friction coefficient over slip speed from a measurement; NaN at speeds that were not visited."""

    slip_speeds: Floats = reported("from 0 to beyond the fastest visited", "rad/s")
    coefficient: Floats = reported("friction coefficient mu; null if not visited")
    low: Floats = reported("lower end of the band that contains the whole curve with a probability of at least 95 %")
    high: Floats = reported("upper end")
    visited: NDArray[np.bool_] = reported("whether at least 8 samples slip within a factor of 1.5")
    constant: float = reported("of mu(v) = constant + sum of amplitudes exp(-rates |v|)")
    amplitudes: tuple[float, ...] = reported("amplitudes of the exponentials")
    rates: tuple[float, ...] = reported("rates of the exponentials", "s/rad")
    scene: Floats = reported("friction coefficient of the scene at the slip speeds", repr=False)

    def table(self) -> dict[str, list[float]]:
        """Return the scene values of the curve up to the fastest visited slip speed."""
        v = self.slip_speeds[:int(np.flatnonzero(self.visited)[-1]) + 1]
        mu = FrictionCurve(self.constant, self.amplitudes, self.rates).at(v)
        return dict(zip(TABLE, (v.tolist(), np.clip(mu, 1e-3, 2.0).tolist())))


def not_visited(slip_speeds: Floats, visited: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return the intervals of slip speed, rad/s, that were not visited."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], visited, [True]])))
    last = len(slip_speeds) - 1
    return [(float(slip_speeds[max(low - 1, 0)]), float(slip_speeds[min(high, last)]))
            for low, high in zip(edges[::2], edges[1::2])]


def keys_of(count: float | None) -> tuple[str, ...]:
    """Return the free keys of a curve with `count` exponentials; raise InputError unless it is 1 to MOST_TERMS."""
    count = PAIRS if count is None else count
    if count not in range(1, MOST_TERMS + 1):
        raise InputError(f"{CURVE} has {count:g} exponentials; it must have 1 to {MOST_TERMS}")
    return CONSTANT, *(key for pair in zip(SHARES[:int(count)], RATES) for key in pair)


def curve_starts(system: System, measured: Measurement, keys: tuple[str, ...]) -> dict[str, float]:
    """Return start values for the numbers of a curve; raise InputError if no slip speed was visited.

    They explain best the change of the flywheel's speed from sample to sample in slip. Without the speeds of both
    sides, they are those of the scene's largest exponentials.
    """
    _visited(speed := np.abs(measured.channels["slip_speed"]), speed, system.friction)
    slip, count = measured.channels["slip_speed"], len(keys) // 2
    low, high = rates_allowed(float(np.abs(slip).max()))
    numbers = _seen_in_slip(system, measured, count, np.geomspace(10.0 * low, high, TRIED))
    if numbers is None:
        pairs = sorted(exponentials(system.friction.stribeck), key=lambda pair: -abs(pair[0]))[:count]
        spare = np.geomspace(10.0 * low, 100.0 * low, MOST_TERMS)
        while len(pairs) < count:
            pairs.append((LEAST_SHARE, float(spare[len(pairs)])))
        numbers = [system.friction.kinetic, *(number for pair in pairs for number in pair)]
    for i in range(1, len(numbers), 2):
        numbers[i] = math.copysign(max(abs(numbers[i]), LEAST_SHARE), numbers[i])
        numbers[i + 1] = min(max(numbers[i + 1], low), high)
    return dict(zip(keys, numbers))


def _seen_in_slip(system: System, measured: Measurement, count: int, rates: Floats) -> list[float] | None:
    """Return constant, shares and rates that fit the flywheel's speed in slip best; None without enough slip.

    Over each time of slip, I1 times the change of the flywheel's speed is the integral of the engine torque less that
    of the friction torque, which is linear in the constant and the amplitudes: a linear fit for each set of rates.
    """
    slip, plate = measured.channels["slip_speed"], measured.channels.get("plate_speed")
    if plate is None:
        return None
    engine, load = torques_at(terms_of(system), measured.t)
    engine = measured.at_samples("engine_torque") if "engine_torque" in measured.inputs else engine
    normal = load / system.friction.kinetic
    if "actuation_pressure" in measured.inputs:
        normal = measured.at_samples("actuation_pressure") * (system.torque_per_pressure / system.friction.kinetic)
    speed, noise = np.abs(slip), noise_of(slip + plate)
    slips = speed > max(3.0 / system.friction.smoothing, 3.0 * noise_of(slip))
    begins = np.append(True, ~(slips[1:] & slips[:-1] & (slip[1:] * slip[:-1] > 0.0)))
    part = np.cumsum(begins)[slips]
    if slips.sum() - len(np.unique(part)) < FEWEST:
        return None
    shapes = np.column_stack([np.ones(len(speed)), decayed(rates, speed[:, None])])
    torques = np.column_stack([(np.sign(slip) * normal)[:, None] * shapes, engine])
    changes = cumulative_trapezoid(torques, measured.t, axis=0, initial=0.0) / system.driveline.flywheel_inertia
    changes[:, -1] -= slip + plate
    changes = changes[slips] / noise
    length = np.bincount(part)
    for column in changes.T:  # The speed at the start of each time of slip is unknown.
        column -= (np.bincount(part, column) / np.maximum(length, 1))[part]
    squares = changes.T @ changes
    usual = np.diag(np.append(0.0, np.full(count, 1.0 / (USUAL_SHARE * system.friction.kinetic)))) ** 2
    best, amplitudes = math.inf, None
    for chosen in itertools.combinations(range(1, len(rates) + 1), count):
        columns = [0, *chosen]
        factors = np.linalg.solve(squares[np.ix_(columns, columns)] + usual, squares[columns, -1])
        left = float(squares[-1, -1] - squares[columns, -1] @ factors)
        if left < best and factors[0] > 0.0 and (shapes[slips][:, columns] @ factors).min() > 0.0:
            best = left
            amplitudes = [float(factors[0]), *(x for c, k in zip(factors[1:], chosen)
                                               for x in (float(c / factors[0]), float(rates[k - 1])))]
    return amplitudes


def rates_allowed(fastest: float) -> tuple[float, float]:
    """Return the slowest and fastest rate, s/rad, of a curve measured up to a slip speed, rad/s."""
    return SLOWEST / fastest, min(STEEPEST / fastest, FASTEST_RATE)


def pairs_of(named: Mapping[str, float]) -> Iterator[float]:
    """Yield shares and rates, s/rad, in turn."""
    for share, rate in zip(SHARES, RATES):
        if share in named:
            yield named[share]
            yield named[rate]


def refuse_parts(free: Mapping[str, object], friction: Friction) -> None:
    """Raise InputError for single coefficients that are free beside a curve or a table that replaces them."""
    for key in TABULATED:
        if key in free and CURVE in free:
            raise InputError(f"{key} is a part of {CURVE}; free one of them")
        if key in free and friction.curve is not None:
            raise InputError(f"{key} is not used where friction.slip_speeds and friction.coefficients are given; free "
                             f"{CURVE} instead")


def _visited(v: Floats, speed: Floats, friction: Friction) -> NDArray[np.bool_]:
    """Return whether enough samples slip near each slip speed v (m,), for samples of `speed` (n,), rad/s."""
    slips = np.sort(speed[speed > math.atanh(0.99) / friction.smoothing])
    visits = np.searchsorted(slips, NEAR * v, side="right") - np.searchsorted(slips, v / NEAR)
    if not (visits >= VISITS).any():
        raise InputError(f"fewer than {VISITS} samples slip near any speed; {CURVE} needs a measurement with slip")
    return np.asarray((visits >= VISITS) & (slips[0] <= v) & (v <= slips[-1]))


def curve_of(keys: tuple[str, ...], values: Floats, covariance: Floats, slip: Floats,
             friction: Friction) -> IdentifiedCurve:
    """Return the curve of a fit with its band (H. Scheffe, The Analysis of Variance, 1959, Section 3.5).

    keys, values, covariance : (P,), (P, P) of all free parameters
    slip : (n,) fitted slip speed, rad/s
    friction : of the scene
    """
    named = dict(zip(keys, map(float, values)))
    numbers = np.array(list(pairs_of(named))).reshape(-1, 2)
    places = [keys.index(key) for key in keys_of(len(numbers))]
    fastest, constant = float(np.abs(slip).max()), named[CONSTANT]
    v = fastest * np.linspace(0.0, 1.0, SPEEDS) ** 2
    v = np.append(v, fastest * np.linspace(1.05, 1.25, 5))
    visited = _visited(v, np.abs(slip), friction)
    ratio, by_numbers = sliding_at(v, tuple(numbers.ravel().tolist()))
    mu, by = constant * ratio, np.column_stack([ratio, *(constant * change for change in by_numbers)])
    sizes, vectors = np.linalg.eigh(covariance[np.ix_(places, places)])
    moved = (by[visited] @ vectors) * np.sqrt(np.maximum(sizes, 0.0))
    error = np.sqrt(np.sum(moved**2, axis=1))
    # Scheffe's band holds every curve with numbers in their confidence ellipsoid, at all speeds at once.
    width = math.sqrt(chi2.ppf(0.95, len(places)))
    out = np.full((3, len(v)), np.nan)
    out[:, visited] = mu[visited] + width * error * np.array([[0.0], [-1.0], [1.0]])
    scene = np.asarray(friction.sliding.at(v)) + 0.0 * v
    return IdentifiedCurve(v, out[0], out[1], out[2], visited, constant, tuple(constant * numbers[:, 0]),
                           tuple(numbers[:, 1]), scene)
