"""What drives a kernel: engine torque and saturation torque, their Taylor coefficients, and where the clamp of the
pressure at 0 sets in and ends.

Time is `tau`, seconds into an engine cycle. The sines of the engine torque repeat with the cycle; the load's phase at
the start of the cycle is `shift` (rad), so that no large angle loses digits however long a run is.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.series import COLUMNS, ENGINE, LOAD, add_sine, sine_and_cosine
from tcc_sim.solvers.terms import Terms

TWO_PI = 2.0 * math.pi

WAVE = np.dtype([("rate", np.float64), ("amplitude", np.float64), ("phase", np.float64), ("sine", np.float64),
                 ("cosine", np.float64)])
"""A sine of the engine torque: rad/s, N m, rad; the sine and the cosine of its angle now."""

DRIVE = np.dtype([("torque", np.float64), ("torque_rate", np.float64), ("load", np.float64), ("load_rate", np.float64),
                  ("load_sine", np.float64), ("load_cosine", np.float64)])
"""Te, Te' (N m, N m/s), Ts, Ts', and the sine and cosine of the load's angle, now."""


def waves_of(terms: Terms) -> NDArray[Any]:
    """The sines of the engine torque as an array of WAVE, the first harmonic first."""
    rows = [] if terms.torque is None else [(terms.torque[1], terms.torque[0], 0.0, 0.0, 1.0)]
    if terms.harmonics is not None:
        rows += [(rate, amplitude, phase, 0.0, 1.0) for rate, amplitude, phase in terms.harmonics.tolist()]
    return np.array(rows, WAVE)


@fast
def excite(tau: float, shift: float, loaded: bool, mean_torque: float, waves: Any, mean_load: float,
           pulsation: tuple[float, float, float] | None, drive: Any) -> None:
    """Fill `drive` and the sines and cosines of `waves` at tau; Ts is 0 where `loaded` is False."""
    torque = mean_torque
    torque_rate = 0.0
    for i in range(waves.shape[0]):
        sine, cosine = sine_and_cosine(waves[i].rate * tau + waves[i].phase)
        waves[i].sine = sine
        waves[i].cosine = cosine
        torque += waves[i].amplitude * sine
        torque_rate += waves[i].amplitude * waves[i].rate * cosine
    drive.torque = torque
    drive.torque_rate = torque_rate
    drive.load = mean_load if loaded else 0.0
    drive.load_rate = 0.0
    if pulsation is not None:
        sine, cosine = sine_and_cosine(pulsation[1] * tau + shift)
        drive.load_sine = sine
        drive.load_cosine = cosine
        if loaded:
            drive.load = max(mean_load + pulsation[0] * sine, 0.0)
            drive.load_rate = pulsation[0] * pulsation[1] * cosine


@fast
def expand_excitation(rows: Any, count: int, unit: float, loaded: bool, mean_torque: float, waves: Any,
                      mean_load: float, pulsation: tuple[float, float, float] | None, drive: Any) -> None:
    """The first `count` Taylor coefficients in t/unit of Te and Ts, about where `drive` and `waves` are.

    Of a load that does not vary only coefficient 0 is written.
    """
    for k in range(COLUMNS):
        rows[ENGINE, k] = 0.0
    rows[ENGINE, 0] = mean_torque
    for i in range(waves.shape[0]):
        add_sine(rows, ENGINE, count, waves[i].amplitude * waves[i].sine, waves[i].amplitude * waves[i].cosine,
                 waves[i].rate * unit)
    if pulsation is None:
        rows[LOAD, 0] = mean_load if loaded else 0.0
    else:
        for k in range(COLUMNS):
            rows[LOAD, k] = 0.0
        if loaded:
            rows[LOAD, 0] = mean_load
            add_sine(rows, LOAD, count, pulsation[0] * drive.load_sine, pulsation[0] * drive.load_cosine,
                     pulsation[1] * unit)


@fast
def clamp_edge(tau: float, end: float, shift: float, mean_load: float,
               pulsation: tuple[float, float, float] | None) -> tuple[float, bool]:
    """The next time at which the clamp of Ts at 0 sets in or ends, at most `end`, and whether Ts is above 0 until then.
    """
    if pulsation is None:
        return end, mean_load > 0.0
    else:
        amplitude, rate = pulsation[0], pulsation[1]
        if abs(amplitude) <= mean_load:
            return end, mean_load > 0.0
        angle = (rate * tau + shift) % TWO_PI
        below = math.asin(mean_load / abs(amplitude))
        closing = math.pi + below if amplitude > 0.0 else below
        opening = TWO_PI - below if amplitude > 0.0 else math.pi - below
        ahead = math.inf
        for turn in range(3):
            for edge in (closing, opening):
                distance = edge + (turn - 1) * TWO_PI - angle
                if distance > 1e-11:
                    ahead = min(ahead, distance)
        until = min(end, tau + ahead / rate)
        if not until > tau:
            until = end
        middle = rate * (0.5 * (tau + until)) + shift
        return until, mean_load + amplitude * math.sin(middle) > 0.0
