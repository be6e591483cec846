"""Assign motions to attractors by proximity to their section points, within validated capture radii."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tcc_sim.result import Described
from tcc_sim.study.continuation.orbits import Floats, ParameterMap
from tcc_sim.trajectory import NO_ORBITS, Orbits


@dataclass(frozen=True)
class Settings:
    """Lengths of the search for attractors, in cycles."""

    settling: int = 256  # before the first test of whether a motion repeats; doubled up to `longest`
    longest: int = 4096  # after which a motion that has not repeated has no period
    cloud: int = 2048  # section points in the cloud of a motion without a period
    witnesses: int = 16  # motions from near a cloud, followed for `longest`; it is a transient if one leaves
    chunk: int = 4  # after which motions are first compared with attractors


DEFAULTS = Settings()

UNDECIDED, RUNAWAY = -1, -2
"""Labels of a motion that reached no attractor."""
Labels = NDArray[np.integer[Any]]
Counts = NDArray[np.integer[Any]]
"""(m,) labels and numbers of cycles of motions."""


class DynamicalSystem(Protocol):
    """Map with derivatives, and a cheap computation of sections of many motions at once."""

    map: ParameterMap

    def sections(self, starts: Floats, first: int, cycles: int, orbits: Orbits = NO_ORBITS) -> Floats:
        """Return (m, cycles + 1, n) states of motions from `starts` (m, n) at the starts of cycles from `first` on.

        States are NaN after a failure, and after two consecutive points near one of the `orbits`.
        """

    def runs_away(self, points: Floats) -> NDArray[np.bool_]:
        """Return (m,) whether motions with these section points (m, n) certainly grow without bound."""

    def largest(self, x: Floats, first: int, cycles: int) -> float:
        """Return the largest size of the motion over these cycles."""


def section_points(of: DynamicalSystem, x: Floats, first: int, cycles: int) -> Floats:
    """Return (m + 1, n) states of one motion at the starts of its cycles; m < cycles after a failed solve."""
    points = of.sections(np.asarray(x, dtype=np.float64)[None], first, cycles)[0]
    out: Floats = points[np.isfinite(points).all(axis=1)]
    return out


@dataclass(frozen=True, repr=False)
class Attractor(Described):
    """Attractor of a map.

    period : cycles; 0 for none
    section : (period, n) points at the starts of the cycles from 0 on; without a period a cloud of points (m, n)
    phases : (period or m,) cycle of each point modulo the map's forcing period
    multipliers : (n,) Floquet multipliers, largest modulus first; None without a period
    largest : largest size of the motion
    radius : capture radius, in the map's scales
    validated : whether motions that start at that radius return
    number : number of the attractor along a key
    """

    period: int
    section: Floats
    phases: NDArray[np.int64]
    multipliers: NDArray[np.complex128] | None
    largest: float
    radius: float = 0.0
    validated: bool = True
    number: int = 0


class ProximityMapper:
    """Determine the attractor that a motion has reached, by proximity.

    Two consecutive section points must be within the capture radius of two consecutive points of the same attractor (of
    two points of the cloud, for one without a period), at the same phase of the excitation.
    """

    def __init__(self, attractors: Sequence[Attractor], scales: Floats, forcing_period: int) -> None:
        self._scales = scales
        orbits = [(k, a) for k, a in enumerate(attractors) if a.period]
        self._owner = np.array([k for k, a in orbits for _ in range(a.period)], dtype=np.int64)
        cycle = np.array([i for _, a in orbits for i in range(a.period)], dtype=np.int64)
        starts = np.cumsum([0, *(a.period for _, a in orbits)])
        self.orbits = Orbits(
            np.concatenate([a.section for _, a in orbits] or [np.empty((0, len(scales)))]) / scales,
            np.array([a.radius**2 for _, a in orbits for _ in range(a.period)]), cycle,
            np.array([starts[j] + (i + 1) % a.period for j, (_, a) in enumerate(orbits) for i in range(a.period)],
                     dtype=np.int64), forcing_period)
        self._clouds = [(k, a.radius, [cKDTree(a.section[a.phases == phase] / scales)
                                       for phase in range(forcing_period)])
                        for k, a in enumerate(attractors) if not a.period]

    def patience(self, cycle: int, settings: Settings) -> int:
        """Return the number of cycles to solve after `cycle`; motions that reach an orbit end earlier."""
        return settings.chunk if self._clouds else max(settings.chunk, cycle)

    def find(self, points: Floats, first: int) -> tuple[Labels, Counts]:
        """Return the attractors (k,) that section points (k, m + 1, n) reach, and the cycles until then (k,).

        UNDECIDED if a motion reaches none or its points are NaN.
        """
        scaled = points / self._scales
        places, reach, cycle, following, forcing = self.orbits
        inside = ((scaled[:, :, None] - places) ** 2).sum(axis=3) <= reach
        phases = (first + np.arange(scaled.shape[1])) % forcing
        if forcing > 1:
            inside &= (phases[:, None] - cycle) % forcing == 0
        both = inside[:, :-1] & inside[:, 1:, following]
        reached = both.any(axis=2)
        labels, after = np.full(len(points), UNDECIDED), np.full(len(points), scaled.shape[1])
        at = np.flatnonzero(reached.any(axis=1))
        if len(at):
            after[at] = reached[at].argmax(axis=1)
            labels[at] = self._owner[both[at, after[at]].argmax(axis=1)]
        for k, radius, trees in self._clouds:
            near = np.zeros(scaled.shape[:2], dtype=bool)
            for i, phase in enumerate(phases):
                known = np.isfinite(scaled[:, i]).all(axis=1)
                near[known, i] = trees[phase].query(scaled[known, i], distance_upper_bound=radius)[0] < np.inf
            two = near[:, 1:] & near[:, :-1]
            sooner = two.any(axis=1) & (two.argmax(axis=1) < after)
            labels[sooner], after[sooner] = k, two[sooner].argmax(axis=1)
        return labels, after


def labelled(of: DynamicalSystem, mapper: ProximityMapper, starts: Floats, most: int,
           settings: Settings = DEFAULTS) -> tuple[Labels, Counts]:
    """Return labels and cycles (m,) of initial states (m, n): the attractor that each reaches, RUNAWAY or UNDECIDED.

    A motion reaches an attractor at the first of two consecutive section points near it. The result does not depend
    on the chunks in which the motion is solved.
    """
    labels, cycles = np.full(len(starts), UNDECIDED), np.full(len(starts), most)
    going, x, cycle = np.arange(len(starts)), np.asarray(starts, dtype=np.float64), 0
    while cycle < most and len(going):
        length = min(mapper.patience(cycle, settings), most - cycle)
        points = of.sections(x, cycle, length, mapper.orbits)
        solved = np.isfinite(points).all(axis=2).sum(axis=1) - 1
        last = points[np.arange(len(going)), solved]
        reached, after = mapper.find(points, cycle)
        away = (reached == UNDECIDED) & of.runs_away(last)
        reached[away] = RUNAWAY
        ended = (reached != UNDECIDED) | (solved < length)
        labels[going[ended]] = reached[ended]
        cycles[going[ended]] = cycle + np.where(reached[ended] >= 0, after[ended], solved[ended])
        going, x, cycle = going[~ended], last[~ended], cycle + length
    return labels, cycles
