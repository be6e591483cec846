"""Sliding friction found from a measurement: mu(v) = m (1 + sum over j of s_j exp(-a_j |v|)) with a band around it.

The numbers m, s_j and a_j are free parameters of the fit. They depend on each other so much that they mean little by
themselves; what a measurement tells is mu(v) at the slip speeds that the motion passed through.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.model.friction import exponentials
from tcc_sim.model.friction_curve import FASTEST_RATE, MOST_TERMS, SLOWEST
from tcc_sim.model.groups import TABLE, TABULATED, Friction
from tcc_sim.result import reported
from tcc_sim.trajectory import Floats

CURVE = "friction.curve"
"""What may be free in the place of TABULATED: the whole curve."""
CONSTANT = f"{CURVE}.constant"
SHARES = tuple(f"{CURVE}.share_{j}" for j in range(1, MOST_TERMS + 1))
RATES = tuple(f"{CURVE}.rate_{j}" for j in range(1, MOST_TERMS + 1))
PAIRS = 2
"""Exponentials of a curve unless another count is asked for."""
SPEEDS, DRAWS = 81, 4000
"""Slip speeds at which a curve is given, and random curves that the width of its band is taken from."""
STEEPEST = 1000.0
"""Largest rate times the fastest slip speed: what fades sooner is passed within a sample or two."""
LARGEST_SHARE, LEAST_SHARE = 20.0, 0.02
"""Bound of a share, and the least size that one begins with, since the rate of none has no effect."""


@dataclass(frozen=True)
class IdentifiedCurve:
    """Sliding friction coefficient over slip speed, as a measurement tells it.

    The band contains the whole curve over the visited slip speeds with a probability of 95 %. Where a speed was not
    visited, coefficient, low and high are NaN. The curve is mu(v) = constant + sum of amplitudes exp(-rates |v|).
    """

    slip_speeds: Floats = field(metadata=reported(
        "slip speeds, from 0 to beyond the fastest that was visited", "rad/s"))
    coefficient: Floats = field(metadata=reported("friction coefficient mu; null where the slip speed was not visited"))
    low: Floats = field(metadata=reported(
        "lower end of the band that contains the whole curve with a probability of 95 %"))
    high: Floats = field(metadata=reported("upper end of the band"))
    visited: NDArray[np.bool_] = field(metadata=reported("whether the motion passed through the slip speed"))
    constant: float = field(metadata=reported(
        "coefficient of fast slip in mu(v) = constant + sum of amplitudes exp(-rates |v|)"))
    amplitudes: tuple[float, ...] = field(metadata=reported("amplitudes of the exponentials"))
    rates: tuple[float, ...] = field(metadata=reported("rates of the exponentials", "s/rad"))
    scene: Floats = field(
        repr=False, metadata=reported("friction coefficient of the scene at the slip speeds"))

    def table(self) -> dict[str, list[float]]:
        """The scene values of the curve up to the fastest slip speed that was visited."""
        v = self.slip_speeds[:int(np.flatnonzero(self.visited)[-1]) + 1]
        mu = self.constant + np.exp(-np.outer(v, self.rates)) @ np.array(self.amplitudes)
        return dict(zip(TABLE, (v.tolist(), np.clip(mu, 1e-3, 2.0).tolist())))


def keys_of(count: float | None) -> tuple[str, ...]:
    """The free parameters of a curve of so many exponentials.

    Raises
    ------
    InputError
        No count from 1 to MOST_TERMS.
    """
    count = PAIRS if count is None else count
    if count not in range(1, MOST_TERMS + 1):
        raise InputError(f"{CURVE} has {count:g} exponentials; it must have 1 to {MOST_TERMS}")
    return CONSTANT, *(key for pair in zip(SHARES[:int(count)], RATES) for key in pair)


def curve_starts(friction: Friction, keys: tuple[str, ...], fastest: float) -> dict[str, float]:
    """The numbers of a curve with a scene's largest exponentials; `fastest` slip speed that was measured, rad/s."""
    count = len(keys) // 2
    pairs = sorted(exponentials(friction.stribeck), key=lambda pair: -abs(pair[0]))[:count]
    low, high = rates_allowed(fastest)
    # Slow fall and rise are told by most of the samples: what the scene has no exponential for begins there.
    spare = np.geomspace(10.0 * low, 100.0 * low, MOST_TERMS)
    while len(pairs) < count:
        pairs.append((LEAST_SHARE, float(spare[len(pairs)])))
    numbers = [friction.kinetic]
    for share, rate in pairs:
        numbers += [math.copysign(max(abs(share), LEAST_SHARE), share), min(max(rate, low), high)]
    return dict(zip(keys, numbers))


def rates_allowed(fastest: float) -> tuple[float, float]:
    """Slowest and fastest rate, s/rad, of a curve that is measured up to a slip speed, rad/s."""
    return SLOWEST / fastest, min(STEEPEST / fastest, FASTEST_RATE)


def pairs_of(named: Mapping[str, float]) -> Iterator[float]:
    """Shares and rates, s/rad, in turn."""
    for share, rate in zip(SHARES, RATES):
        if share in named:
            yield named[share]
            yield named[rate]


def refuse_parts(free: Mapping[str, object], friction: Friction) -> None:
    """Raise InputError where single coefficients are free beside a curve or a table that takes their place."""
    for key in TABULATED:
        if key in free and CURVE in free:
            raise InputError(f"{key} is a part of {CURVE}; free one of them")
        if key in free and friction.curve is not None:
            raise InputError(f"{key} is not used where friction.slip_speeds and friction.coefficients are given; free "
                             f"{CURVE} instead")


def _law(friction: Friction, v: Floats) -> Floats:
    """mu at slip speeds of a scene."""
    shares, rates = np.array(exponentials(friction.stribeck)).reshape(-1, 2).T
    return np.asarray(friction.kinetic * (1.0 + np.exp(-np.outer(v, rates)) @ shares))


def curve_of(keys: tuple[str, ...], values: Floats, covariance: Floats, slip: Floats,
             friction: Friction) -> IdentifiedCurve:
    """The curve of a fit with its band.

    Parameters
    ----------
    keys, values, covariance : (P,), (P, P) of all free parameters
    slip : (n,) fitted slip speed, rad/s
    friction : of the scene
    """
    named = dict(zip(keys, map(float, values)))
    numbers = np.array(list(pairs_of(named))).reshape(-1, 2)
    places = [keys.index(key) for key in keys_of(len(numbers))]
    slowest = 0.0 if slip.min() < 0.0 < slip.max() else float(np.abs(slip).min())
    fastest, constant = float(np.abs(slip).max()), named[CONSTANT]
    v = fastest * np.linspace(0.0, 1.0, SPEEDS) ** 2
    v = np.append(v, fastest * np.linspace(1.05, 1.25, 5))
    visited = (slowest <= v) & (v <= fastest)
    fade = np.exp(-np.outer(v, numbers[:, 1]))
    mu = constant * (1.0 + fade @ numbers[:, 0])
    by = np.empty((len(v), 1 + 2 * len(numbers)))
    by[:, 0] = mu / constant
    by[:, 1::2], by[:, 2::2] = constant * fade, -constant * v[:, None] * fade * numbers[:, 0]
    sizes, vectors = np.linalg.eigh(covariance[np.ix_(places, places)])
    moved = (by[visited] @ vectors) * np.sqrt(np.maximum(sizes, 0.0))
    error = np.sqrt(np.sum(moved**2, axis=1))
    # The whole curve lies within so many standard errors in 95 of 100 cases.
    draws = np.random.default_rng(1).standard_normal((moved.shape[1], DRAWS))
    width = float(np.quantile(np.max(np.abs(moved @ draws) / np.maximum(error, 1e-300)[:, None], axis=0), 0.95))
    out = np.full((3, len(v)), np.nan)
    out[:, visited] = mu[visited] + width * error * np.array([[0.0], [-1.0], [1.0]])
    return IdentifiedCurve(v, out[0], out[1], out[2], visited, constant, tuple(constant * numbers[:, 0]),
                           tuple(numbers[:, 1]), _law(friction, v))
