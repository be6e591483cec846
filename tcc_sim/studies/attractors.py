"""Attractors of a map: found by recurrence, polished by Newton, each with a radius within which a motion is its own.

Recurrence alone takes a slow phase of a transient for an attractor, so a repetition counts only where Newton's method
finds a stable orbit at it. A motion without a period is kept as the cloud of its section points. After G. Datseris and
A. Wagemakers, Effortless estimation of basins of attraction, Chaos 32 (2022), with labels by proximity instead of
cells.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tcc_sim.studies.maps import Floats, ParameterMap
from tcc_sim.studies.orbits import minimal_period, multipliers_of, newton
from tcc_sim.studies.shooting import Shooting

UNDECIDED, RUNAWAY = -1, -2
"""Labels of a motion that came to no attractor."""
Labels = NDArray[np.int64]
Counts = NDArray[np.int64]
CHUNK = 4
"""Cycles after which motions are asked where they are."""
MAXIMUM_PERIOD = 16
"""Longest period looked for, cycles."""
SETTLING = 256
"""Cycles after which a motion is first asked whether it repeats; doubled until LONGEST."""
LONGEST = 4096
"""Cycles after which a motion that repeats nowhere counts as one without a period."""
CLOUD = 2048
"""Section points kept of a motion without a period."""
NEAR = 0.3
"""Distance, in natural sizes, of two points a period apart from which Newton's method is tried."""
RADIUS = 0.2
"""Largest capture radius, in natural sizes."""
SMALLEST_RADIUS = 1e-4
PROBES = 24
"""Motions started on the sphere of the capture radius about an attractor to validate it."""
PROBE_CYCLES = 600
APART = 0.4
"""Largest capture radius, relative to the distance of the nearest other attractor."""


class Motion(Protocol):
    """What is asked of a system besides its map with derivatives: the sections of many motions, cheaply."""

    map: ParameterMap

    def sections(self, starts: Floats, first: int, cycles: int) -> Floats:
        """(m, cycles + 1, n) states of motions from `starts` (m, n) at the starts of cycles first to first + cycles.

        NaN from where one cannot be solved further.
        """

    def runs_away(self, points: Floats) -> NDArray[np.bool_]:
        """Whether motions with these section points (m, n) are sure to grow without bound."""

    def largest(self, x: Floats, first: int, cycles: int) -> float:
        """The largest size of the motion over some cycles."""


def section_of(of: Motion, x: Floats, first: int, cycles: int) -> Floats:
    """(m + 1, n) states of one motion at the starts of its cycles; m < cycles where it cannot be solved further."""
    points = of.sections(np.asarray(x, dtype=np.float64)[None], first, cycles)[0]
    out: Floats = points[np.isfinite(points).all(axis=1)]
    return out


@dataclass(frozen=True)
class Attractor:
    """One attractor.

    period : cycles; 0 where it has none
    section : (period, n) its points at the starts of the cycles from 0 on; of one without period the cloud (m, n)
    phases : (period or m,) cycle of each point modulo the map's forcing period
    multipliers : (n,) Floquet multipliers, largest modulus first; None where it has no period
    largest : the largest size of the motion
    radius : capture radius, in the map's natural sizes
    """

    period: int
    section: Floats
    phases: NDArray[np.int64]
    multipliers: NDArray[np.complex128] | None
    largest: float
    radius: float = 0.0


class Captures:
    """Tells by proximity to which of some attractors a motion has come.

    Two consecutive section points must be within the capture radius of two consecutive points of the same attractor (of
    two points of the cloud, for one without a period), at the same phase of the excitation.
    """

    def __init__(self, attractors: Sequence[Attractor], scales: Floats, forcing_period: int) -> None:
        self._scales, self._forcing = scales, forcing_period
        orbits = [(k, a) for k, a in enumerate(attractors) if a.period]
        self._points = np.concatenate([a.section for _, a in orbits] or [np.empty((0, len(scales)))]) / scales
        self._owner = np.array([k for k, a in orbits for _ in range(a.period)], dtype=np.int64)
        self._cycle = np.array([i for _, a in orbits for i in range(a.period)], dtype=np.int64)
        self._reach = np.array([a.radius**2 for _, a in orbits for _ in range(a.period)])
        starts = np.cumsum([0, *(a.period for _, a in orbits)])
        self._following = np.array([starts[j] + (i + 1) % a.period for j, (_, a) in enumerate(orbits)
                                    for i in range(a.period)],
                                   dtype=np.int64)
        self._clouds = [(k, a.radius, [cKDTree(a.section[a.phases == phase] / scales)
                                       for phase in range(forcing_period)])
                        for k, a in enumerate(attractors) if not a.period]

    def find(self, points: Floats, first: int) -> tuple[Labels, Counts]:
        """Indices of attractors (k,) and cycles until they were reached (k,) of section points (k, m + 1, n).

        UNDECIDED where a motion comes to none, as where its points are NaN.
        """
        scaled = points / self._scales
        inside = ((scaled[:, :, None] - self._points) ** 2).sum(axis=3) <= self._reach
        phases = (first + np.arange(scaled.shape[1])) % self._forcing
        if self._forcing > 1:
            inside &= (phases[:, None] - self._cycle) % self._forcing == 0
        both = inside[:, :-1] & inside[:, 1:, self._following]
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
                near[known, i] = trees[phase].query(scaled[known, i], distance_upper_bound=radius)[0] <= radius
            two = near[:, 1:] & near[:, :-1]
            sooner = two.any(axis=1) & (two.argmax(axis=1) < after)
            labels[sooner], after[sooner] = k, two[sooner].argmax(axis=1)
        return labels, after


def follow(of: Motion, captures: Captures, starts: Floats, most: int) -> tuple[Labels, Counts]:
    """Labels and cycles (m,) of initial states (m, n): the attractor that each comes to, RUNAWAY or UNDECIDED.

    A motion counts as come to an attractor at the first of two section points by it, whatever chunks it is solved in.
    """
    labels, cycles = np.full(len(starts), UNDECIDED), np.full(len(starts), most)
    going, x, cycle = np.arange(len(starts)), np.asarray(starts, dtype=np.float64), 0
    while cycle < most and len(going):
        length = min(CHUNK, most - cycle)
        points = of.sections(x, cycle, length)
        solved = np.isfinite(points).all(axis=2).sum(axis=1) - 1
        last = points[np.arange(len(going)), solved]
        found, after = captures.find(points, cycle)
        away = (found == UNDECIDED) & of.runs_away(last)
        found[away] = RUNAWAY
        ended = (found != UNDECIDED) | (solved < length)
        labels[going[ended]] = found[ended]
        cycles[going[ended]] = cycle + np.where(found[ended] >= 0, after[ended], solved[ended])
        going, x, cycle = going[~ended], last[~ended], cycle + length
    return labels, cycles


def find_attractors(of: Motion, seeds: Iterable[Floats], known: Sequence[Attractor] = ()) -> list[Attractor]:
    """The attractors to which motions from the `seeds` (n,) lead, those `known` first, with validated radii.

    Motions that run away or cannot be solved lead to none.
    """
    scales, forcing = of.map.scales, of.map.forcing_period
    found = list(known)
    for seed in seeds:
        if follow(of, Captures(found, scales, forcing), np.asarray(seed)[None], SETTLING)[0][0] != UNDECIDED:
            continue
        attractor = _settle(of, seed)
        if attractor is not None and not any(_same(attractor, other, scales) for other in found):
            found.append(attractor)
            found = _validated(of, found)
    return found


def _settle(of: Motion, seed: Floats) -> Attractor | None:
    """The attractor that a motion comes to, without its radius; None where it runs away or cannot be solved."""
    x, cycle, length = seed, 0, SETTLING
    while cycle < LONGEST:
        points = section_of(of, x, cycle, length)
        if len(points) < length + 1 or of.runs_away(points[-1:])[0]:
            return None
        x, cycle = points[-1], cycle + length
        orbit = _repeating(of, points[-2 * MAXIMUM_PERIOD:], cycle)
        if orbit is not None:
            return orbit
        length = min(2 * length, LONGEST)
    points = section_of(of, x, cycle, CLOUD)
    if len(points) < CLOUD + 1 or of.runs_away(points[-1:])[0]:
        return None
    phases = (cycle + np.arange(len(points))) % of.map.forcing_period
    return Attractor(0, points, phases, None, of.largest(x, cycle, CLOUD))


def _repeating(of: Motion, points: Floats, cycle: int) -> Attractor | None:
    """The stable orbit near the last points, whose last one is at `cycle`; None where there is none."""
    scales, forcing = of.map.scales, of.map.forcing_period
    back = cycle % forcing
    last = len(points) - 1 - back
    for period in range(forcing, MAXIMUM_PERIOD + 1, forcing):
        if last - period < 0 or np.linalg.norm((points[last] - points[last - period]) / scales) > NEAR:
            continue
        shooting = Shooting.single(of.map, period)
        z = newton(shooting, shooting.point(points[last][None], ()))
        if z is None:
            continue
        x = shooting.nodes(z)[0]
        true_period = minimal_period(of.map, x, (), period)
        multipliers = multipliers_of(of.map.evaluate(x, (), 0, true_period).jacobian)
        if abs(multipliers[0]) >= 1.0 or np.linalg.norm((x - points[last]) / scales) > 4.0 * NEAR:
            continue
        section = section_of(of, x, 0, true_period)[:-1]
        return Attractor(true_period, section, np.arange(true_period) % forcing, multipliers,
                         of.largest(x, 0, true_period))
    return None


def _distance(one: Attractor, other: Attractor, scales: Floats) -> float:
    """Smallest distance of points of the same phase, in natural sizes."""
    best = np.inf
    for phase in np.unique(one.phases):
        here, there = one.section[one.phases == phase], other.section[other.phases == phase]
        if len(there):
            best = min(best, float(cKDTree(there / scales).query(here / scales)[0].min()))
    return best


def _same(one: Attractor, other: Attractor, scales: Floats) -> bool:
    """Whether two attractors are one: the same orbit, or clouds of which each point of one is near the other."""
    if one.period != other.period:
        return False
    if one.period:
        return _distance(one, other, scales) < 1e-6
    here, there = cKDTree(one.section / scales), cKDTree(other.section / scales)
    spread = np.quantile(there.query(there.data, k=2)[0][:, 1], 0.99)
    return bool(np.mean(there.query(here.data)[0] <= max(spread, 1e-3)) > 0.9)


def _validated(of: Motion, found: Sequence[Attractor]) -> list[Attractor]:
    """The attractors with radii: apart from each other, and such that motions from the sphere come back to each.

    Each radius is halved until all of PROBES motions from its sphere end at the attractor.
    """
    out = []
    for k, attractor in enumerate(found):
        others = [other for i, other in enumerate(found) if i != k]
        gap = min((_distance(attractor, other, of.map.scales) for other in others), default=np.inf)
        radius = min(RADIUS, APART * gap)
        if attractor.period == 0:
            tree = cKDTree(attractor.section / of.map.scales)
            radius = min(radius, float(np.quantile(tree.query(tree.data, k=2)[0][:, 1], 0.95)))
        if attractor.radius and attractor.radius <= radius:
            radius = attractor.radius
        else:
            while radius > SMALLEST_RADIUS and not _captures(of, attractor, radius):
                radius *= 0.5
        out.append(Attractor(attractor.period, attractor.section, attractor.phases, attractor.multipliers,
                             attractor.largest, radius))
    return out


def _captures(of: Motion, attractor: Attractor, radius: float) -> bool:
    """Whether motions from the sphere of this radius come back to the attractor."""
    random = np.random.default_rng(1)
    tree = cKDTree(attractor.section / of.map.scales)
    within = 0.05 * radius if attractor.period else radius
    for probe in range(PROBES):
        k = probe % len(attractor.section) if attractor.period else int(random.integers(len(attractor.section)))
        away = random.normal(size=of.map.dimension)
        start = attractor.section[k] + radius * away / np.linalg.norm(away) * of.map.scales
        first = k if attractor.period else int(attractor.phases[k])
        for cycle in range(first, first + PROBE_CYCLES, 4 * MAXIMUM_PERIOD):
            points = section_of(of, start, cycle, 4 * MAXIMUM_PERIOD)
            if len(points) < 4 * MAXIMUM_PERIOD + 1:
                return False
            if tree.query(points[-MAXIMUM_PERIOD:] / of.map.scales)[0].max() <= max(within, 1e-6):
                break
            start = points[-1]
        else:
            return False
    return True


def halton(count: int, dimensions: int) -> Floats:
    """(count, dimensions) points of the unit cube that fill it evenly (J. H. Halton, Numer. Math. 2, 1960)."""
    out = np.zeros((count, dimensions))
    for d, base in enumerate((2, 3, 5, 7, 11)[:dimensions]):
        for i in range(count):
            n, part = i + 1, 1.0
            while n:
                part /= base
                out[i, d] += part * (n % base)
                n //= base
    return out
