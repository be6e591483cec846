"""Periodic orbits at given parameters: Newton's method with deflation of known orbits, multipliers, stability.

Deflation: P. E. Farrell, A. Birkisson, S. W. Funke, Deflation techniques for finding distinct solutions of nonlinear
partial differential equations, SIAM J. Sci. Comput. 37 (2015).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.steady.multipliers import multipliers_of
from tcc_sim.result import Described, reported
from tcc_sim.study.continuation.problem import FAILURES, Floats, Observation, ParameterMap, Values
from tcc_sim.study.continuation.shooting import Linearised, Shooting

NEWTON_TOLERANCE = 1e-10  # last step of an orbit
NEWTON_ITERATIONS = 25  # most steps
NEWTON_ROUNDING = 1e-12  # residual below which no further step helps
NEWTON_STEP = 2.0  # longest step; a longer one is scaled to it
# Parts of a step that are tried in order until the residual falls or the event sequence is unchanged.
NEWTON_PARTS = (1.0, 0.5, 0.25, 0.1, 0.03)
SINGULAR = 1e-12  # singular value, relative to the largest one, below which a Jacobian is singular
SAME = 1e-6  # distance below which two orbits are the same
NEUTRAL = 1e-9  # distance from the unit circle that may be rounding: neither stable nor a change of sign


@dataclass(frozen=True)
class OrbitState:
    """Section, size and multipliers of a periodic orbit."""

    value: float = field(metadata=reported("value of the key", "{over}"))
    slip_speed: float = field(metadata=reported("on the section at phase 0", "rad/s"))
    plate_angle: float = field(metadata=reported("on the section", "rad"))
    plate_speed: float = field(metadata=reported("on the section", "rad/s"))
    max_slip_speed: float = field(metadata=reported("largest |slip speed|", "rad/s"))
    multipliers: NDArray[np.complex128] = field(metadata=reported(
        "Floquet multipliers, [re, im], largest first"))


@dataclass(frozen=True)
class OrbitFigures(OrbitState, Described):
    """A periodic orbit as `continue --json` has it."""

    stick_fraction: float = field(metadata=reported("time in stick over time"))
    stable: bool = field(metadata=reported("whether every multiplier is inside the unit circle"))
    events: str = field(metadata=reported("sequence of slip (+, -) and stick (S)"))
    residual: float = field(metadata=reported("largest residual of the equations, in natural sizes"))


@dataclass(frozen=True)
class Orbit:
    """A periodic orbit of the map.

    period : cycles
    values : the free parameters
    nodes : (m, n) states at the starts of its segments; the first is the section at phase 0
    multipliers : (n,) Floquet multipliers, largest modulus first
    seen : largest size, stick fraction and event sequence
    residual : largest component of the equations, in natural sizes
    """

    period: int
    values: Values
    nodes: Floats
    multipliers: NDArray[np.complex128]
    seen: Observation
    residual: float

    @property
    def section(self) -> Floats:
        """(n,) state at phase 0."""
        out: Floats = self.nodes[0]
        return out

    @property
    def stable(self) -> bool:
        """Whether every multiplier lies inside the unit circle by more than rounding."""
        return bool(abs(self.multipliers[0]) < 1.0 - NEUTRAL)

    @property
    def state(self) -> OrbitState:
        """The figures that every result reports."""
        v, angle, speed = map(float, self.section)
        return OrbitState(self.values[0], v, angle, speed, self.seen.largest, self.multipliers)

    @property
    def figures(self) -> OrbitFigures:
        """All figures that are reported."""
        return OrbitFigures(**vars(self.state), stick_fraction=self.seen.stick_fraction, stable=self.stable,
                            events=self.seen.events, residual=self.residual)


def orbit_at(shooting: Shooting, z: Floats, linearised: Linearised) -> Orbit:
    """The orbit of a solution `z` with its linearisation."""
    return Orbit(shooting.period, shooting.values(z), shooting.nodes(z), multipliers_of(*linearised.blocks),
                 linearised.seen, float(np.abs(linearised.residual).max()))


def newton(shooting: Shooting, z: Floats, known: Sequence[Floats] = ()) -> Floats | None:
    """A solution near `z` at its parameters, apart from the `known` ones; None where Newton's method fails.

    `z` and `known` are scaled unknowns; the parameters of `z` stay. Steps are halved until the residual falls.
    """
    z, size, settings = z.copy(), shooting.size, shooting.settings
    try:
        linearised = shooting.linearise(z)
        for _ in range(NEWTON_ITERATIONS):
            step = _newton_step(linearised.jacobian[:, :size], linearised.residual, SINGULAR)
            turn = sum(_slope(z[:size] - k[:size], step) for k in known)
            if turn:
                step = step / (1.0 - turn)
            length = float(np.abs(step).max())
            if not np.isfinite(length):
                return None
            left = float(np.abs(linearised.residual).max())
            if left < NEWTON_ROUNDING or (length < NEWTON_TOLERANCE and left <= settings.residual):
                z[:size] += step
                return z if all(np.abs(z[:size] - k[:size]).max() > SAME for k in known) else None
            step *= min(1.0, NEWTON_STEP / length)
            before = _weight(z, known, size) * float(np.linalg.norm(linearised.residual))
            for part in NEWTON_PARTS:
                trial = z.copy()
                trial[:size] += part * step
                try:
                    after = shooting.linearise(trial)
                except FAILURES:
                    continue
                if _weight(trial, known, size) * float(np.linalg.norm(after.residual)) < before:
                    z, linearised = trial, after
                    break
            else:
                return None
    except FAILURES:
        return None
    return None


def _newton_step(jacobian: Floats, residual: Floats, singular: float) -> Floats:
    """Newton's step; the shortest one where the Jacobian is singular, in a family of motions."""
    try:
        return np.asarray(np.linalg.solve(jacobian, -residual))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(jacobian, -residual, rcond=singular)[0])


def _weight(z: Floats, known: Sequence[Floats], size: int) -> float:
    """The deflation operator: product of 1 + 1/|z - known|^2."""
    return math.prod(1.0 + 1.0 / max(float(np.sum((z[:size] - k[:size]) ** 2)), 1e-300) for k in known)


def _slope(away: Any, step: Any) -> float:
    """Derivative of the logarithm of 1 + 1/|away|^2 along `step`."""
    square = max(float(away @ away), 1e-300)
    return -2.0 * float(away @ step) / (square * (square + 1.0))


def shifts(of: ParameterMap, x: Floats, values: Values, period: int) -> list[Floats]:
    """The points of a periodic orbit at the starts of all cycles at which the map repeats."""
    points, at = [x], x
    for first in range(0, period - of.forcing_period, of.forcing_period):
        at = of.evaluate(at, values, first, of.forcing_period).value
        points.append(at)
    return points


def minimal_period(of: ParameterMap, x: Floats, values: Values, period: int, same: float = SAME) -> int:
    """The smallest number of cycles after which an orbit of `period` cycles repeats, to `same` natural sizes."""
    points = shifts(of, x, values, period)
    for k in range(1, len(points)):
        if len(points) % k == 0 and np.abs((points[k] - x) / of.scales).max() < same:
            return k * of.forcing_period
    return period


def find_orbit(shooting: Shooting, values: Values, guesses: Iterable[Floats],
               known: Sequence[Floats] = ()) -> Floats | None:
    """The scaled unknowns of an orbit with exactly the period of `shooting` from the first guess that leads to one.

    guesses : states (n,) at phase 0
    known : states (n,) at phase 0 of orbits to avoid; orbits of shorter periods that are found join them
    """
    deflated = [shooting.unknowns(x[None], values) for x in known]
    for guess in guesses:
        start = shooting.unknowns(np.asarray(guess, dtype=np.float64)[None], values)
        for _ in range(4):
            z = newton(shooting, start, deflated)
            if z is None:
                break
            x = shooting.nodes(z)[0]
            if minimal_period(shooting.map, x, values, shooting.period) == shooting.period:
                return z
            deflated.append(shooting.unknowns(x[None], values))
    return None
