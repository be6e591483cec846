"""The stroboscopic map of a scene by the engine of its friction law: with its exact derivatives, or section points of
many motions in one compiled call.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.model.parameters import System
from tcc_sim.solvers.changes import LANES
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.key_derivatives import (
    DECAY,
    EXCESS_RATIO,
    LOAD_AMPLITUDE,
    NUMBERS,
    SMOOTHING,
    TORQUE_AMPLITUDE,
    key_derivatives,
)
from tcc_sim.solvers.terms import terms_of
from tcc_sim.trajectory import NO_ORBITS, Floats, Orbits

SCALES = np.array([10.0, 0.1, 10.0])
"""Natural sizes of slip speed (rad/s), plate angle (rad) and plate speed (rad/s)."""
WITHIN = 1.0 - 1e-9
"""Part of a reach that a motion must be within to end: whoever asks again, with other roundings, finds the same."""


class Stroboscopic(NamedTuple):
    """What some engine cycles make of a state.

    state : (3,) slip speed, plate angle, plate speed after them
    derivatives : (3, 3 + P) by the state before, and by the keys, each at constant phase omega t; under the set-valued
        law a start in stick is projected on v = 0
    events : modes in order: S stick, + and - slip, F free
    heights : (N,) the largest |slip speed| of every cycle, rad/s; a part of a cycle counts as one
    heights_derivatives : (N, 3 + P) of `heights`, likewise
    stick_time : s
    moves : (time in s, mode before, mode after) of each change of mode; only the set-valued law's
    margins : (3, 2 + 3 + P) rows GRAZING, ARRIVAL, STUCK of `event_driven.margins`: value, whether stick's margin
        grows, derivatives by the state and the keys; inf where there is no such place. None where they were not asked
        for, and under the smoothed law
    """

    state: Floats
    derivatives: Floats
    events: str
    heights: Floats
    heights_derivatives: Floats
    stick_time: float
    moves: Sequence[tuple[float, int, int]] = ()
    margins: Floats | None = None

    @property
    def derivative(self) -> Floats:
        """(3, 3) by the state before."""
        return self.derivatives[:, :3]

    @property
    def by_parameter(self) -> Floats:
        """(3, P) by the keys."""
        return self.derivatives[:, 3:]


class Prepared(ABC):
    """A system with keys, ready to be evaluated at many states.

    changes : (len(NUMBERS), P) `key_derivatives`
    terms : the scene's, and those that it has not but that there are derivatives by
    by : (groups, len(NUMBERS), LANES) `changes`, columns in lanes behind those of the state
    forced : (groups,) a bit for every lane of a key
    shaped : whether alpha or sigma changes with a key
    period, count : engine cycle, s; columns of the derivatives
    fastest : rate of the fastest sine by whose amplitude there are derivatives, rad/s, 0 for none: no step is longer
        than its series hold, for the motion need not show it
    """

    def __init__(self, system: System, keys: tuple[str, ...]) -> None:
        system.check_repeats("a map of the section")
        self.changes = key_derivatives(system, keys)
        self.period, self.count = system.cycle, 3 + len(keys)
        terms, omega, self.fastest = terms_of(system), system.engine.frequency, 0.0
        if self.changes[TORQUE_AMPLITUDE].any():
            terms, self.fastest = terms._replace(torque=terms.torque or (0.0, omega)), omega
        if self.changes[LOAD_AMPLITUDE].any():
            pulsation = terms.pulsation or (0.0, system.pressure.frequency_ratio * omega, system.pressure.phase)
            terms, self.fastest = terms._replace(pulsation=pulsation), max(self.fastest, pulsation[1])
        if terms.stribeck is None and self.changes[EXCESS_RATIO].any():
            terms = terms._replace(stribeck=(0.0, system.friction.decay))
        self.terms = terms
        self.by = np.zeros((-(-self.count // LANES), len(NUMBERS), LANES))
        for k in range(3, self.count):
            self.by[k // LANES, :, k % LANES] = self.changes[:, k - 3]
        self.forced = [(1 << self.count) - 8 >> LANES * k & (1 << LANES) - 1 for k in range(len(self.by))]
        self.shaped = bool(self.changes[[DECAY, SMOOTHING]].any())

    def over(self, state: Floats, start: float, end: float, margins: bool = False) -> Stroboscopic:
        """From the phase `start` to the phase `end`, in engine cycles; see `stroboscopic_map`."""
        return self.each(state[None], [start], [end], margins)[0]

    @abstractmethod
    def each(self, states: Floats, starts: Sequence[float], ends: Sequence[float],
             margins: bool = False) -> list[Stroboscopic]:
        """`over` for several starts, states (m, 3)."""


def prepared(system: System, keys: tuple[str, ...], rtol: float) -> Prepared:
    """A system ready to be evaluated at many states, with derivatives by the state and by scene keys."""
    if system.friction.law == "set_valued":
        from tcc_sim.solvers.event_driven import stroboscopic as event_driven

        return event_driven.SetValued(system, keys, rtol)
    from tcc_sim.solvers.smoothed import stroboscopic as smoothed

    return smoothed.Smoothed(system, keys, rtol)


def stroboscopic_map(system: System, state: Floats, cycles: float, *, start_cycle: float = 0, rtol: float = 1e-12,
                     parameters: Sequence[str] = (), margins: bool = False) -> Stroboscopic:
    """The state after engine cycles (whole ones or parts), and its derivatives by the state and by scene keys.

    Parameters
    ----------
    state : (3,) slip speed (rad/s), plate angle (rad), plate speed (rad/s)
    cycles, start_cycle : number of engine cycles, and the phase of the start in cycles
    rtol : relative tolerance of the steps
    parameters : scene keys that are one number each
    margins : whether the set-valued law's margins to other event sequences are wanted

    Raises
    ------
    InputError
        A key that is not one number, or that the motion does not depend on continuously.
    NumericalFailure
        The engine stopped early, the state is not finite, or has no derivative.
    """
    return prepared(system, tuple(parameters), rtol).over(state, start_cycle, start_cycle + cycles, margins)


@fast
def within_reach(point: Any, k: int, orbits: Orbits) -> bool:
    """Whether a section point is within the reach of that of an orbit."""
    slip_speed = point[0] / SCALES[0] - orbits.points[k, 0]
    plate_angle = point[1] / SCALES[1] - orbits.points[k, 1]
    plate_speed = point[2] / SCALES[2] - orbits.points[k, 2]
    square = slip_speed * slip_speed + plate_angle * plate_angle + plate_speed * plate_speed
    return bool(square <= WITHIN * orbits.reach[k])


@fast
def ends(section: Any, since: int, until: int, output: Any, first: int, cycles: Any, orbits: Orbits) -> bool:
    """Take the points of a motion after cycle `since`; whether it ends there, as where it did not come to `until`."""
    for i in range(since + 1, output.cycle + 1):
        section[i, 0], section[i, 1], section[i, 2] = cycles[i].slip_speed, cycles[i].plate_angle, cycles[i].plate_speed
        for k in range(orbits.reach.shape[0]):
            if ((first + i - 1 - orbits.cycle[k]) % orbits.forcing == 0 and within_reach(section[i - 1], k, orbits)
                    and within_reach(section[i], orbits.following[k], orbits)):
                return True
    return bool(output.cycle < until)


def sections(system: System, starts: Floats, first: int, cycles: int, rtol: float,
             orbits: Orbits = NO_ORBITS) -> Floats:
    """(m, cycles + 1, 3) slip speed, plate angle and plate speed at the starts of cycles `first` to `first + cycles`.

    Parameters
    ----------
    starts : (m, 3) states at the start of cycle `first`
    rtol : relative tolerance
    orbits : where a motion ends, once two points in a row are by those of one; their points are in the sizes of SCALES

    Returns
    -------
    Section points, NaN from where a motion ended or could not be solved further. The interpreter's lock is free
    meanwhile.
    """
    if system.friction.law == "set_valued":
        from tcc_sim.solvers.event_driven.solve import fill_sections
    else:
        from tcc_sim.solvers.smoothed.solve import fill_sections
    out = np.full((len(starts), cycles + 1, 3), np.nan)
    out[:, 0] = starts
    fill_sections(out, system, first, rtol, orbits)
    return out
