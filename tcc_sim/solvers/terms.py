"""What a kernel is given: the numbers of a scene, with None for every term that the scene does not have.

The types of the fields select the compiled code: a kernel is one source text, and Numba leaves out the branches of a
term that is None (pass the field on as an argument of its own: the pruning looks at arguments).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model import friction
from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.parameters import System
from tcc_sim.solvers.per_system import per_system


class Terms(NamedTuple):
    """The terms of equations (1) to (7) that one scene needs; see the functions of `model` for each field."""

    linear: Linear
    mean_torque: float
    torque: tuple[float, float] | None
    harmonics: NDArray[np.float64] | None
    mean_load: float
    pulsation: tuple[float, float, float] | None
    smoothing: float | None
    stribeck: Stribeck


@per_system
def terms_of(system: System) -> Terms:
    """The terms of `system`. An input that comes from a topic is its fallback: what applies where nobody commands
    it.
    """
    d, e, p, f = system.driveline, system.engine, system.pressure, system.friction
    omega = e.frequency
    torque = (e.torque_amplitude, omega) if e.harmonic and e.torque_amplitude > 0.0 else None
    harmonics = None
    if e.harmonic and any(a > 0.0 for a in e.harmonic_amplitudes):
        rows = [(n * omega, a, phase) for n, (a, phase) in enumerate(zip(e.harmonic_amplitudes, e.harmonic_phases), 2)
                if a > 0.0]
        harmonics = np.array(rows, dtype=np.float64)
    pulsation = None
    if p.harmonic and p.amplitude > 0.0:
        pulsation = (system.saturation_amplitude, p.frequency_ratio * omega, p.phase)
    ratio = system.friction_ratio
    return Terms(
        linear=(d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness),
        mean_torque=e.mean_torque,
        torque=torque,
        harmonics=harmonics,
        mean_load=system.saturation_mean,
        pulsation=pulsation,
        smoothing=f.smoothing if f.law == "smoothed" else None,
        stribeck=(ratio - 1.0, f.decay) if ratio > 1.0 else None,
    )


def holding(terms: Terms, torque: float | None, load: float | None) -> Terms:
    """`terms` with a commanded engine torque and saturation torque (N m) held; None leaves the scene's own.

    The harmonics of an input that is held stay as terms of zero amplitude, so that the kernel is the same.
    """
    if torque is not None:
        terms = terms._replace(mean_torque=torque, torque=terms.torque and (0.0, terms.torque[1]),
                               harmonics=None if terms.harmonics is None else terms.harmonics * (1.0, 0.0, 1.0))
    if load is not None:
        terms = terms._replace(mean_load=load, pulsation=terms.pulsation and (0.0, *terms.pulsation[1:]))
    return terms


def general_terms(system: System) -> Terms:
    """The same physics with every term present, absent ones at zero amplitude: for comparison, and for live changes."""
    own = terms_of(system)
    omega = system.engine.frequency
    return own._replace(
        torque=own.torque or (0.0, omega),
        harmonics=np.array([[2.0 * omega, 0.0, 0.0]]) if own.harmonics is None else own.harmonics,
        pulsation=own.pulsation or (0.0, omega, 0.0),
        stribeck=own.stribeck or (0.0, system.friction.decay),
    )


def peak_load(terms: Terms) -> float:
    """The largest saturation torque, N m."""
    return terms.mean_load + (abs(terms.pulsation[0]) if terms.pulsation is not None else 0.0)


def held_and_left_out(terms: Terms) -> tuple[list[str], list[str]]:
    """The names of the terms a kernel holds, and of those it leaves out."""
    present = {
        "engine torque sine": terms.torque is not None,
        "engine torque harmonics 2, 3, ...": terms.harmonics is not None,
        "pressure sine": terms.pulsation is not None,
        "smoothing tanh": terms.smoothing is not None,
        "Stribeck exponential": terms.stribeck is not None,
        "pressure clamp": terms.pulsation is not None and terms.pulsation[0] > terms.mean_load,
    }
    return [n for n, on in present.items() if on], [n for n, on in present.items() if not on]


def excitation_frequency(terms: Terms) -> float:
    """The largest angular frequency in the excitation, rad/s (0 for constant inputs)."""
    found = [0.0]
    if terms.torque is not None:
        found.append(terms.torque[1])
    if terms.pulsation is not None:
        found.append(terms.pulsation[1])
    if terms.harmonics is not None:
        found.append(float(terms.harmonics[:, 0].max()))
    return max(found)


def natural_frequency(terms: Terms) -> float:
    """omega_n = sqrt(K23/I2), rad/s."""
    return math.sqrt(terms.linear[3] / terms.linear[1])


def stick_speed_of(terms: Terms) -> float:
    """The slip speed at or below which this package says stick; 0 for the set-valued law."""
    return friction.stick_speed(terms.smoothing, terms.stribeck) if terms.smoothing is not None else 0.0
