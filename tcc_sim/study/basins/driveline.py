"""Driveline scene as a `DynamicalSystem`, with a criterion for runaway slip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcc_sim.model.friction import exponentials
from tcc_sim.model.parameters import System
from tcc_sim.solvers import solve
from tcc_sim.solvers.runs import sections
from tcc_sim.solvers.terms import peak_load, terms_of
from tcc_sim.study.continuation.motions import DrivelineMap
from tcc_sim.study.continuation.orbits import Floats, ParameterMap
from tcc_sim.trajectory import NO_ORBITS, Orbits, State

ATTRACTOR_RTOL = 1e-8  # relative tolerance of the motions that find attractors
CONSTANT_FROM = 40.0  # times 1/alpha, a slip speed with the law's exponential below 1e-17 of the rest


class DrivelineMotion:
    """Driveline as a dynamical system: its section at phase 0 of the engine torque.

    States are slip speed (rad/s), plate angle (rad) and plate speed (rad/s). `rtol` is the relative
    tolerance of its sections.
    """

    def __init__(self, system: System, rtol: float = ATTRACTOR_RTOL) -> None:
        self.system, self._rtol = system, rtol
        self.map: ParameterMap = DrivelineMap(system, ())
        terms = terms_of(system)
        slowest = min([rate for _, rate in exponentials(terms.stribeck)], default=0.0)
        self._constant = CONSTANT_FROM / slowest if slowest > 0.0 else 0.0
        # A torque that grows with slip ends any growth.
        self._drift = 0.0 if terms.linear.flywheel_by_slip else terms.mean_torque
        self._drag = mean_load(system) * (system.friction_ratio if terms.stribeck and slowest == 0.0 else 1.0)
        torques = abs(terms.mean_torque) + system.engine.torque_amplitude + sum(system.engine.harmonic_amplitudes)
        torque = torques + system.largest_friction_ratio * peak_load(terms)
        plate_speed = torque / terms.linear.stiffness * system.natural_frequency
        self._swing = torques / terms.linear.flywheel * system.cycle + 4.0 * plate_speed
        """Bound of the swing of slip about its mean within a few cycles, rad/s."""

    def sections(self, starts: Floats, first: int, cycles: int, orbits: Orbits = NO_ORBITS) -> Floats:
        """Return (m, cycles + 1, 3) states at the starts of cycles first to first + cycles.

        States are NaN after a failure and after two consecutive points near one of the `orbits`.
        """
        return sections(self.system, starts, first, cycles, self._rtol, orbits)

    def runs_away(self, points: Floats) -> NDArray[np.bool_]:
        """Return (m,) whether slip is so fast that friction is constant and below the mean engine torque.

        Slip then gains (Tm - Tsm)/I1 per second on average, (1a) with a bounded plate, and never returns. With a
        coupling b it ends at (Tm - Tsm)/b.
        """
        v = points[:, 0]
        out: NDArray[np.bool_] = (np.abs(v) > self._constant + self._swing) & (self._drift * np.sign(v) > self._drag)
        return out

    def largest(self, x: Floats, first: int, cycles: int) -> float:
        """Return the largest |slip speed| over these cycles, rad/s."""
        cycles_of = solve(self.system, cycles=cycles, state=State.of(x), start_cycle=first, rtol=self._rtol).cycles
        assert cycles_of is not None
        return max(float(cycles_of.highest.max()), -float(cycles_of.lowest.min()))


def mean_load(system: System) -> float:
    """Return the time average of the saturation torque Ts, clamped at 0, N m."""
    terms = terms_of(system)
    if terms.pulsation is None or abs(terms.pulsation[0]) <= terms.mean_load:
        return terms.mean_load
    edge = np.arcsin(-terms.mean_load / terms.pulsation[0])
    return float((terms.mean_load * (np.pi - 2.0 * edge) + 2.0 * terms.pulsation[0] * np.cos(edge)) / (2.0 * np.pi))
