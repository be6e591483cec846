"""Find attractors of a map by recurrence, polish them by Newton's method, and assign motions to them by proximity.

Recurrence alone takes a slow transient for an attractor, so a repetition counts only where Newton's method finds a
stable orbit near it. A motion without a period is stored as the cloud of its section points. After G. Datseris and
A. Wagemakers, Effortless estimation of basins of attraction, Chaos 32 (2022), with labels by proximity to section
points, within validated capture radii, instead of cells.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tcc_sim.analysis.steady.exponents import multipliers_of
from tcc_sim.result import Described
from tcc_sim.study.continuation.orbits import Floats, ParameterMap, Shooting, minimal_period, newton
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
        self.clouds = [(k, a.radius, [cKDTree(a.section[a.phases == phase] / scales)
                                      for phase in range(forcing_period)])
                       for k, a in enumerate(attractors) if not a.period]

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
        for k, radius, trees in self.clouds:
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
        # Motions that reach an orbit end earlier; those that reach a cloud do not.
        length = min(settings.chunk if mapper.clouds else max(settings.chunk, cycle), most - cycle)
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


LONGEST_PERIOD = 16  # longest period of an attractor, cycles
NEAR = 0.3  # distance of two points a period apart below which Newton's method starts
RETURNED = 1e-3  # the same for a motion that starts near a cloud
MOST_CLOUDS = 32  # largest number of additions of as many points while new ones lie off the cloud
NEW_POINTS = 0.05  # fraction of new points that may lie off a complete cloud
SAME_ORBIT = 1e-6  # distance at which two orbits are one
SAME_CLOUD = 1e-3  # distance at which two clouds' points are one
SHARED = 0.9  # share of a cloud's points that must be that near
GOES_ON = 0.5  # largest distance between an attractor and its continuation at the next value
LARGEST_RADIUS, SMALLEST_RADIUS = 0.2, 1e-4  # largest capture radius, and bound below which none is halved further
APART = 0.4  # largest capture radius, relative to the distance of the nearest other attractor
PROBE_CYCLES = 600  # longest time of a probe
PROBES = 24  # motions from the capture sphere that validate the radius


def find_attractors(of: DynamicalSystem, seeds: Iterable[Floats], known: Sequence[Attractor] = (),
                    settings: Settings = DEFAULTS) -> list[Attractor]:
    """Return the attractors that motions from the `seeds` (n,) reach, after the `known` ones, with validated radii.

    Motions that run away or cannot be solved reach none, and neither does a long transient without a period, which
    neighbouring motions leave.
    """
    scales, forcing = of.map.scales, of.map.forcing_period
    attractors, transients = list(known), list[Attractor]()
    for seed in seeds:
        mapper = ProximityMapper(attractors, scales, forcing)
        (label,), _ = labelled(of, mapper, np.asarray(seed)[None], settings.settling, settings)
        if label != UNDECIDED:
            continue
        attractor = _settle(of, seed, transients, settings)
        if attractor is not None and not any(_same(attractor, other, scales) for other in attractors):
            attractors.append(attractor)
            attractors = _validated(of, attractors)
    return attractors


def _settle(of: DynamicalSystem, seed: Floats, transients: list[Attractor], settings: Settings) -> Attractor | None:
    """Return the attractor that a motion reaches, without its radius.

    The result is None if the motion runs away, cannot be solved or stays on one of the `transients`. New transients are
    added to these.
    """
    # `sweeps.steady_state` waits until a scene's motion repeats. Here Newton's method finds the orbit of any map long
    # earlier, also for a slow approach.
    x, cycle, length = seed, 0, settings.settling
    while cycle < settings.longest:
        points = section_points(of, x, cycle, length)
        if len(points) < length + 1 or of.runs_away(points[-1:])[0]:
            return None
        x, cycle = points[-1], cycle + length
        orbit = _repeating(of, points[-2 * LONGEST_PERIOD:], cycle)
        if orbit is not None:
            return orbit
        length = min(2 * length, settings.longest)
    cloud = _cloud(of, x, cycle, settings)
    if cloud is None or any(_same(cloud, other, of.map.scales) for other in transients):
        return None
    left, orbit = _left(of, cloud, settings)
    if left:
        transients.append(cloud)
        return orbit
    return cloud


def _cloud(of: DynamicalSystem, x: Floats, cycle: int, settings: Settings) -> Attractor | None:
    """Collect section points of an aperiodic motion until further points lie among them; None for a runaway."""
    # Near a resonance a quasi-periodic motion stays on a few arcs of its curve for thousands of cycles, and on other
    # arcs from another initial state.
    points = section_points(of, x, cycle, settings.cloud)
    for k in range(1, MOST_CLOUDS + 1):
        if len(points) < k * settings.cloud + 1 or of.runs_away(points[-1:])[0]:
            return None
        more = section_points(of, points[-1], cycle + k * settings.cloud, settings.cloud)[1:]
        tree = cKDTree(points / of.map.scales)
        if len(more) == settings.cloud and np.mean(tree.query(more / of.map.scales)[0] > _spread(tree)) <= NEW_POINTS:
            break
        points = np.concatenate([points, more])
    phases = (cycle + np.arange(len(points))) % of.map.forcing_period
    return Attractor(0, points, phases, None, of.largest(x, cycle, settings.cloud))


def _spread(points: cKDTree) -> float:
    """Return the distance within which 99 % of the points of a cloud have a neighbour."""
    return float(np.quantile(points.query(points.data, k=2)[0][:, 1], 0.99))


def _left(of: DynamicalSystem, cloud: Attractor, settings: Settings) -> tuple[bool, Attractor | None]:
    """Return whether a motion from near a cloud leaves it, and the orbit that it reaches (None for a runaway)."""
    # Motions leave a chaotic transient after different times.
    scales, random = of.map.scales, np.random.default_rng(2)
    alike = cloud.section[cloud.phases == cloud.phases[0]]
    x = alike[np.linspace(0, len(alike) - 1, settings.witnesses).astype(int)]
    x, cycle = x + 1e-6 * scales * random.normal(size=x.shape), int(cloud.phases[0])
    for _ in range(settings.longest // settings.settling):
        points = of.sections(x, cycle, settings.settling)
        if not np.isfinite(points).all() or of.runs_away(points[:, -1]).any():
            return True, None
        x, cycle = points[:, -1], cycle + settings.settling
        last = points[:, -2 * LONGEST_PERIOD - 1:] / scales
        for period in range(of.map.forcing_period, LONGEST_PERIOD + 1, of.map.forcing_period):
            apart = np.abs(last[:, period:] - last[:, :-period]).max(axis=(1, 2))
            for row in np.flatnonzero(apart < RETURNED):
                orbit = _repeating(of, points[row, -2 * LONGEST_PERIOD:], cycle)
                if orbit is not None:
                    return True, orbit
    return False, None


def _repeating(of: DynamicalSystem, points: Floats, cycle: int) -> Attractor | None:
    """Return the stable orbit near the last points, the last of which is at `cycle`; None without one."""
    scales, forcing = of.map.scales, of.map.forcing_period
    back = cycle % forcing
    last = len(points) - 1 - back
    for period in range(forcing, LONGEST_PERIOD + 1, forcing):
        if last - period < 0 or np.linalg.norm((points[last] - points[last - period]) / scales) > NEAR:
            continue
        shooting = Shooting.single(of.map, period)
        z = newton(shooting, shooting.unknowns(points[last][None], ()))
        if z is None:
            continue
        x = shooting.nodes(z)[0]
        true_period = minimal_period(of.map, x, (), period)
        multipliers = multipliers_of(of.map.evaluate(x, (), 0, true_period).jacobian)
        if abs(multipliers[0]) >= 1.0 or np.linalg.norm((x - points[last]) / scales) > 4.0 * NEAR:
            continue
        section = section_points(of, x, 0, true_period)[:-1]
        return Attractor(true_period, section, np.arange(true_period) % forcing, multipliers,
                         of.largest(x, 0, true_period))
    return None


def _distance(one: Attractor, other: Attractor, scales: Floats) -> float:
    """Return the smallest distance of two points of the same phase, in the map's scales."""
    best = np.inf
    for phase in np.unique(one.phases):
        points, other_points = one.section[one.phases == phase], other.section[other.phases == phase]
        if len(other_points):
            best = min(best, float(cKDTree(other_points / scales).query(points / scales)[0].min()))
    return best


def _same(one: Attractor, other: Attractor, scales: Floats) -> bool:
    """Return whether two attractors are the same orbit, or two clouds that cover each other."""
    if one.period != other.period:
        return False
    if one.period:
        return _distance(one, other, scales) < SAME_ORBIT
    tree, other_tree = cKDTree(one.section / scales), cKDTree(other.section / scales)
    return bool(np.mean(other_tree.query(tree.data)[0] <= max(_spread(other_tree), SAME_CLOUD)) > SHARED)


def numbered(of: DynamicalSystem, before: Sequence[Sequence[Attractor]],
             attractors: Sequence[Attractor]) -> tuple[Attractor, ...]:
    """Number the attractors; an attractor that continues from the last value of the key has the same number.

    An orbit continues in the attractor that Newton's method reaches from it, otherwise in the nearest one, possibly
    with another period. The nearest pairs are matched first.
    """
    scales, pairs, numbers = of.map.scales, list[tuple[float, int, int]](), dict[int, int]()
    unused = max((a.number + 1 for each in before for a in each), default=0)
    for old in before[-1] if before else ():
        shooting = Shooting.single(of.map, old.period) if old.period else None
        z = None if shooting is None else newton(shooting, shooting.unknowns(old.section[:1], ()))
        moved = old if shooting is None or z is None else replace(
            old, section=section_points(of, shooting.nodes(z)[0], 0, old.period)[:-1])
        pairs += [(_distance(moved, new, scales), k, old.number) for k, new in enumerate(attractors)]
    for distance, k, number in sorted(pairs):
        if distance <= GOES_ON and k not in numbers and number not in numbers.values():
            numbers[k] = number
    for k in range(len(attractors)):
        if k not in numbers:
            numbers[k], unused = unused, unused + 1
    return tuple(replace(attractor, number=numbers[k]) for k, attractor in enumerate(attractors))


def _validated(of: DynamicalSystem, attractors: Sequence[Attractor]) -> list[Attractor]:
    """Give each attractor a radius: spheres do not overlap, and motions that start on a sphere return to its centre."""
    # The radius is halved until all probes return, or until it is too small.
    out = []
    for k, attractor in enumerate(attractors):
        others = [other for i, other in enumerate(attractors) if i != k]
        gap = min((_distance(attractor, other, of.map.scales) for other in others), default=np.inf)
        radius = min(LARGEST_RADIUS, APART * gap)
        if attractor.period == 0:
            tree = cKDTree(attractor.section / of.map.scales)
            radius = min(radius, float(np.quantile(tree.query(tree.data, k=2)[0][:, 1], 0.95)))
        if attractor.radius and attractor.radius <= radius:
            radius, validated = attractor.radius, attractor.validated
        else:
            while not (validated := _captures(of, attractor, radius)) and radius > SMALLEST_RADIUS:
                radius *= 0.5
        out.append(replace(attractor, radius=radius, validated=validated))
    return out


def _captures(of: DynamicalSystem, attractor: Attractor, radius: float) -> bool:
    """Return whether motions that start on the sphere of this radius return to the attractor."""
    random = np.random.default_rng(1)
    tree = cKDTree(attractor.section / of.map.scales)
    within = 0.05 * radius if attractor.period else radius
    for probe in range(PROBES):
        k = probe % len(attractor.section) if attractor.period else int(random.integers(len(attractor.section)))
        away = random.normal(size=of.map.dimension)
        start = attractor.section[k] + radius * away / np.linalg.norm(away) * of.map.scales
        first = k if attractor.period else int(attractor.phases[k])
        for cycle in range(first, first + PROBE_CYCLES, 4 * LONGEST_PERIOD):
            points = section_points(of, start, cycle, 4 * LONGEST_PERIOD)
            if len(points) < 4 * LONGEST_PERIOD + 1:
                return False
            if tree.query(points[-LONGEST_PERIOD:] / of.map.scales)[0].max() <= max(within, SAME_ORBIT):
                break
            start = points[-1]
        else:
            return False
    return True
