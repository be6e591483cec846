"""A constant plus sines: the form of every excitation and of every steady state of the linear part."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import OutOfRange
from tcc_sim.model.groups import Driveline
from tcc_sim.model.parameters import System

Floats = NDArray[np.float64]
Response = Callable[[float], complex]


@dataclass(frozen=True)
class Sines:
    """mean + sum_k amplitude_k sin(frequency_k t + phase_k); the three arrays are (m,), frequencies in rad/s."""

    mean: float
    frequency: Floats
    amplitude: Floats
    phase: Floats

    @staticmethod
    def of(mean: float, rows: list[tuple[float, float, float]]) -> Sines:
        """Return the sum of a mean and rows of frequency, amplitude and phase; rows of equal frequency are added."""
        merged: dict[float, complex] = {}
        for frequency, amplitude, phase in rows:
            merged[frequency] = merged.get(frequency, 0j) + amplitude * np.exp(1j * phase)
        phasors = np.array(list(merged.values()), dtype=np.complex128)
        return Sines(mean, np.array(list(merged), dtype=np.float64), np.abs(phasors), np.angle(phasors))

    def __call__(self, t: Any) -> Floats:
        """Return the value at the times t, (n,) array or float."""
        angle = np.multiply.outer(np.asarray(t, dtype=np.float64), self.frequency) + self.phase
        return self.mean + np.sin(angle) @ self.amplitude

    def through(self, response: Response) -> Sines:
        """Return the steady output of a linear system with the frequency response `response`(w)."""
        factors = np.array([response(float(w)) for w in self.frequency], dtype=np.complex128)
        return Sines(self.mean * float(response(0.0).real), self.frequency, self.amplitude * np.abs(factors),
                     self.phase + np.angle(factors))

    def plus(self, other: Sines, factor: float = 1.0) -> Sines:
        """Return the sum of this and `factor` times `other`."""
        rows = [(float(w), float(a) * s, float(p)) for part, s in ((self, 1.0), (other, factor))
                for w, a, p in zip(part.frequency, part.amplitude, part.phase)]
        return Sines.of(self.mean + factor * other.mean, rows)

    def rate(self) -> Sines:
        """Return the derivative with respect to time."""
        return Sines(0.0, self.frequency, self.amplitude * self.frequency, self.phase + 0.5 * np.pi)

    def swing(self) -> float:
        """Return the sum of the amplitudes, a bound of the distance from the mean."""
        return float(self.amplitude.sum())

    def bend(self) -> float:
        """Return the sum of the amplitudes times squares of frequencies, a bound of the second derivative."""
        return float(self.amplitude @ self.frequency**2)


def smallest(value: Callable[[Floats], Floats], slack: Callable[[Floats, float], Any], end: float, width: float,
             close: float) -> tuple[float, float]:
    """Return the smallest value of a function over [0, end] and its time, by branch and bound on cells of time.

    Parameters
    ----------
    slack : largest distance of the function below both ends of cells with given starts (n,) and width
    close : tolerance of the smallest value
    """
    t, best, when = np.arange(0.0, max(end, width), width), math.inf, 0.0
    for _ in range(60):
        ends = np.stack([value(t), value(t + width)])
        least = ends.min(axis=0)
        k = int(least.argmin())
        if least[k] < best:
            best, when = float(least[k]), float(t[k] if ends[0, k] <= ends[1, k] else t[k] + width)
        keep = least - slack(t, width) < best - close
        if not keep.any():
            break
        width *= 0.5
        t = np.concatenate([t[keep], t[keep] + width])
    return best, when


def dynamic_stiffness(d: Driveline, inertia: float, omega: float, resonance: str) -> complex:
    """K23 - J w^2 + i C23 w of an inertia J on the spring, N m/rad; OutOfRange with `resonance` if it is 0."""
    stiffness = complex(d.stiffness - inertia * omega**2, d.damping * omega)
    if stiffness == 0.0:
        raise OutOfRange(f"{resonance} resonance, {omega:g} rad/s: no steady state")
    return stiffness


def engine_series(system: System) -> Sines:
    """Return Te(t), N m: the mean and the harmonics of omega, Section 2.2 of the paper.

    Raises
    ------
    InputError
        The excitation has a profile in time.
    """
    system.check_repeats("a closed form")
    e = system.engine
    if not e.harmonic:
        return Sines.of(e.mean_torque, [])
    higher = [(n * e.frequency, a, p) for n,
              (a, p) in enumerate(zip(e.harmonic_amplitudes, e.harmonic_phases), 2) if a > 0.0]
    return Sines.of(e.mean_torque,
                    ([(e.frequency, e.torque_amplitude, 0.0)] if e.torque_amplitude > 0.0 else []) + higher)


def load_series(system: System) -> Sines:
    """Return Ts(t) of (5b), N m, before the clamp at 0; InputError for a profile in time."""
    system.check_repeats("a closed form")
    frequency = system.pressure.frequency_ratio * system.engine.frequency
    amplitude = system.saturation_amplitude
    return Sines.of(system.saturation_mean, [(frequency, amplitude, system.pressure.phase)] if amplitude > 0.0 else [])


def common_cycles(system: System, most: int = 1000) -> int:
    """Return the period of the excitation in engine cycles: N of omega_f = (M/N) omega in lowest terms.

    It is 1 for a constant pressure, and 0 if N exceeds `most`.
    """
    if len(load_series(system).frequency) == 0:
        return 1
    ratio = system.pressure.frequency_ratio
    nearest = Fraction(ratio).limit_denominator(most)
    return nearest.denominator if abs(float(nearest) - ratio) <= 1e-12 * ratio else 0
