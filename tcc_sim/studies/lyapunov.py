"""The largest Lyapunov exponent of the smoothed model, with a confidence interval, and the diagnosis of motions without
period.

The variational equations are integrated beside the motion by the tangent of the same method: SDIRK3
(`solvers.fixed_step`), each stage of which is one scalar equation v + a mubar(v) = w, so that its tangent is dv = dw/(1
+ a mubar'(v)) and exact. The tangent vector is renormalised at the end of every engine cycle (G. Benettin et al.
(1980), Meccanica 15, 9 to 20), and the exponent is the mean of the logarithms of its growth. It is the same whatever
the norm; this one is the energy of the linear part.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.parameters import System
from tcc_sim.solvers.compiled import compiled, engine_torque, saturation_torque, smoothed_and_slope
from tcc_sim.solvers.fixed_step import GAMMA, substeps
from tcc_sim.solvers.scalar import scalar_root
from tcc_sim.solvers.terms import Terms, terms_of
from tcc_sim.trajectory import Floats, State

CONFIDENCE = 0.95
BATCHES = 20
"""Means of consecutive runs of cycles; they are long enough to be nearly independent."""
ALIGNING_CYCLES = 50
"""Cycles in which the tangent vector turns to the direction of largest growth, not counted."""
NEUTRAL = 0.02
"""Half width per cycle, in natural logarithm, up to which an interval that holds 0 counts as a zero exponent."""
_B1 = -0.25 * (6.0 * GAMMA * GAMMA - 16.0 * GAMMA + 1.0)
_B2 = 0.25 * (6.0 * GAMMA * GAMMA - 20.0 * GAMMA + 5.0)
_C2 = 0.5 * (1.0 + GAMMA)

Six = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Lyapunov:
    """The largest Lyapunov exponent, 1/s.

    exponent, low, high : mean growth rate of a small disturbance, and its confidence interval from batch means, 1/s
    confidence : of the interval
    cycles : engine cycles averaged
    diagnosis : periodic (a period up to 16 was found), chaotic (the whole interval is above 0), quasi-periodic (a
        narrow
        interval around 0), or unresolved
    """

    exponent: float
    low: float
    high: float
    confidence: float
    cycles: int
    diagnosis: str

    def as_json(self) -> dict[str, Any]:
        """The fields as JSON values; a number that is not finite becomes null."""
        return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(self).items()}


def largest_lyapunov_exponent(system: System, state: State, *, cycles: int = 2000, start_cycle: int = 0,
                              period: int = 0) -> Lyapunov:
    """The largest Lyapunov exponent of the motion that starts at `state`, which should lie on the attractor.

    Parameters
    ----------
    system : with the smoothed law
    state : at t = start_cycle 2 pi/omega
    cycles : engine cycles averaged, at least 40
    period : of the motion as its section shows it, in engine cycles; 0 for none

    Raises
    ------
    InputError
        The set-valued law, too few cycles, or a scene that needs too many sub-steps.
    """
    if system.friction.law != "smoothed":
        raise InputError(f"friction.law is {system.friction.law}; the Lyapunov exponent is that of the smoothed model")
    if not 2 * BATCHES <= cycles <= 10_000_000:
        raise InputError(f"cycles is {cycles}; a Lyapunov exponent needs {2 * BATCHES} to 10000000")
    terms = terms_of(system)
    n = substeps(terms, system.cycle)
    start = np.array([state.slip_speed, state.plate_angle, state.plate_speed])
    growth = tangent_growth(start, start_cycle, cycles + ALIGNING_CYCLES, n, system.cycle, terms)[ALIGNING_CYCLES:]
    if not np.isfinite(growth).all():
        return Lyapunov(math.nan, math.nan, math.nan, CONFIDENCE, cycles, "unresolved")
    mean, half = batch_means(growth)
    rate = 1.0 / system.cycle
    return Lyapunov(mean * rate, (mean - half) * rate, (mean + half) * rate, CONFIDENCE, cycles,
                    diagnosis(mean, half, period))


def diagnosis(mean: float, half: float, period: int) -> str:
    """What a section's period and a growth per cycle with the half width of its interval say about a motion."""
    if period:
        return "periodic"
    if mean - half > 0.0:
        return "chaotic"
    return "quasi-periodic" if abs(mean) <= half <= NEUTRAL else "unresolved"


def batch_means(growth: Floats) -> tuple[float, float]:
    """Mean and half width of its confidence interval, from the means of BATCHES consecutive runs and Student's t."""
    from scipy.stats import t

    width = len(growth) // BATCHES
    means = growth[len(growth) - BATCHES * width:].reshape(BATCHES, width).mean(axis=1)
    half = float(t.ppf(0.5 + 0.5 * CONFIDENCE, BATCHES - 1)) * float(means.std(ddof=1)) / math.sqrt(BATCHES)
    return float(means.mean()), half


@compiled
def _tangent_stage(known: Six, guess: float, engine: float, load: float, hg: float, linear: Linear, smoothing: Any,
                   stribeck: Stribeck) -> Six:
    """One implicit stage x = known + hg f(x) with its tangent: v, theta2, omega2, dv, dtheta2, domega2."""
    inertia1, inertia2, damping, stiffness = linear
    share = 1.0 / (1.0 + hg * (damping + hg * stiffness) / inertia2)
    gain = share * hg / inertia2
    free = share * known[2] - gain * stiffness * known[1]
    w = known[0] + known[2] - free + hg * engine / inertia1
    a = hg / inertia1 + gain
    v, _ = scalar_root(w, a * load, guess, smoothing, stribeck)
    omega = free + gain * ((w - v) / a)
    dfree = share * known[5] - gain * stiffness * known[4]
    dw = known[3] + known[5] - dfree
    dv = dw / (1.0 + a * load * smoothed_and_slope(v, smoothing, stribeck)[1])
    domega = dfree + gain * ((dw - dv) / a)
    return v, known[1] + hg * omega, omega, dv, known[4] + hg * domega, domega


@compiled
def tangent_growth(state: Floats, first: int, cycles: int, n: int, cycle: float, terms: Terms) -> Floats:
    """Logarithm of the growth of a tangent vector in every one of `cycles` engine cycles of n steps, (cycles,) array.
    """
    growth = np.empty(cycles)
    inertia1, inertia2, stiffness = terms.linear[0], terms.linear[1], terms.linear[3]
    h = cycle / n
    hg = h * GAMMA
    x = (state[0], state[1], state[2], 1.0, 1.0 / math.sqrt(stiffness / inertia1), 1.0)
    for c in range(cycles):
        for k in range(n):
            start = ((first + c) + k / n) * cycle
            at = start + hg
            one = _tangent_stage(x, x[0], engine_torque(at, terms.mean_torque, terms.torque, terms.harmonics),
                                 saturation_torque(at, terms.mean_load, terms.pulsation), hg, terms.linear,
                                 terms.smoothing,
                                 terms.stribeck)
            a = 0.5 * (1.0 - GAMMA) / GAMMA
            known = (x[0] + a * (one[0] - x[0]), x[1] + a * (one[1] - x[1]), x[2] + a * (one[2] - x[2]),
                     x[3] + a * (one[3] - x[3]), x[4] + a * (one[4] - x[4]), x[5] + a * (one[5] - x[5]))
            at = start + _C2 * h
            two = _tangent_stage(known, one[0], engine_torque(at, terms.mean_torque, terms.torque, terms.harmonics),
                                 saturation_torque(at, terms.mean_load, terms.pulsation), hg, terms.linear,
                                 terms.smoothing,
                                 terms.stribeck)
            p, q = _B1 / GAMMA, _B2 / GAMMA
            last = (x[0] + p * (one[0] - x[0]) + q * (two[0] - known[0]),
                    x[1] + p * (one[1] - x[1]) + q * (two[1] - known[1]),
                    x[2] + p * (one[2] - x[2]) + q * (two[2] - known[2]),
                    x[3] + p * (one[3] - x[3]) + q * (two[3] - known[3]),
                    x[4] + p * (one[4] - x[4]) + q * (two[4] - known[4]),
                    x[5] + p * (one[5] - x[5]) + q * (two[5] - known[5]))
            at = start + h
            x = _tangent_stage(last, two[0], engine_torque(at, terms.mean_torque, terms.torque, terms.harmonics),
                               saturation_torque(at, terms.mean_load, terms.pulsation), hg, terms.linear,
                               terms.smoothing,
                               terms.stribeck)
        size = math.sqrt(inertia1 * (x[3] + x[5]) ** 2 + inertia2 * x[5] ** 2 + stiffness * x[4] ** 2)
        growth[c] = math.log(size)
        x = (x[0], x[1], x[2], x[3] / size, x[4] / size, x[5] / size)
    # The first vector was not of unit size; its growth is among those that the caller leaves out.
    return growth
