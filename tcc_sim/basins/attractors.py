"""Attractors of a map: found by recurrence, polished by Newton, each with a radius within which a motion is its own.

Recurrence alone takes a slow phase of a transient for an attractor, so a repetition counts only where Newton's method
finds a stable orbit at it. A motion without a period is kept as the cloud of its section points. After G. Datseris and
A. Wagemakers, Effortless estimation of basins of attraction, Chaos 32 (2022), with labels by proximity instead of
cells.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from tcc_sim.basins.proximity import UNDECIDED, Attractor, Motion, ProximityMapper, follow, section_of
from tcc_sim.continuation.newton import minimal_period, multipliers_of, newton
from tcc_sim.continuation.problem import Floats
from tcc_sim.continuation.shooting import Shooting

MAXIMUM_PERIOD = 16
"""Longest period looked for, cycles."""
SETTLING = 256
"""Cycles after which a motion is first asked whether it repeats; doubled until LONGEST."""
LONGEST = 4096
"""Cycles after which a motion that repeats nowhere counts as one without a period."""
CLOUD, MOST_CLOUDS = 2048, 32
"""Section points kept of a motion without a period, and how often so many more while they lie elsewhere."""
NEW = 0.05
"""Part of further points that may lie off a cloud that is whole."""
WITNESSES = 16
"""Motions from beside a cloud that are followed LONGEST cycles each: where one of them leaves, it was a transient."""
RETURNED = 1e-3
"""Distance, in natural sizes, of points a period apart at which such a motion has settled."""
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


def find_attractors(of: Motion, seeds: Iterable[Floats], known: Sequence[Attractor] = ()) -> list[Attractor]:
    """The attractors to which motions from the `seeds` (n,) lead, those `known` first, with validated radii.

    Motions that run away or cannot be solved lead to none; nor does one that stays without a period for long, but whose
    neighbours leave it.
    """
    scales, forcing = of.map.scales, of.map.forcing_period
    found, transients = list(known), list[Attractor]()
    for seed in seeds:
        if follow(of, ProximityMapper(found, scales, forcing), np.asarray(seed)[None], SETTLING)[0][0] != UNDECIDED:
            continue
        attractor = _settle(of, seed, transients)
        if attractor is not None and not any(_same(attractor, other, scales) for other in found):
            found.append(attractor)
            found = _validated(of, found)
    return found


def _settle(of: Motion, seed: Floats, transients: list[Attractor]) -> Attractor | None:
    """The attractor that a motion comes to, without its radius; None where it runs away or cannot be solved, or stays
    on one of the `transients`, to which a new one is added.
    """
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
    cloud = _cloud(of, x, cycle)
    if cloud is None:
        return None
    if any(_same(cloud, other, of.map.scales) for other in transients):
        return None
    left, orbit = _left(of, cloud)
    if left:
        transients.append(cloud)
        return orbit
    return cloud


def _cloud(of: Motion, x: Floats, cycle: int) -> Attractor | None:
    """The section points of a motion without a period, until further ones lie among them; None where it runs away.

    A quasi-periodic motion beside a resonance is for thousands of cycles on a few arcs of its curve, and on other ones
    where it was started elsewhere.
    """
    points = section_of(of, x, cycle, CLOUD)
    for k in range(1, MOST_CLOUDS + 1):
        if len(points) < k * CLOUD + 1 or of.runs_away(points[-1:])[0]:
            return None
        more = section_of(of, points[-1], cycle + k * CLOUD, CLOUD)[1:]
        tree = cKDTree(points / of.map.scales)
        if len(more) == CLOUD and np.mean(tree.query(more / of.map.scales)[0] > _spread(tree)) <= NEW:
            break
        points = np.concatenate([points, more])
    phases = (cycle + np.arange(len(points))) % of.map.forcing_period
    return Attractor(0, points, phases, None, of.largest(x, cycle, CLOUD))


def _spread(points: cKDTree) -> float:
    """Distance within which nearly every point of a cloud has a neighbour."""
    return float(np.quantile(points.query(points.data, k=2)[0][:, 1], 0.99))


def _left(of: Motion, cloud: Attractor) -> tuple[bool, Attractor | None]:
    """Whether a motion from beside a cloud leaves it, and the orbit that it comes to; None where it runs away.

    A chaotic set that is none of the attractors keeps motions for a time that differs from one to the next.
    """
    scales, random = of.map.scales, np.random.default_rng(2)
    alike = cloud.section[cloud.phases == cloud.phases[0]]
    x = alike[np.linspace(0, len(alike) - 1, WITNESSES).astype(int)]
    x, cycle = x + 1e-6 * scales * random.normal(size=x.shape), int(cloud.phases[0])
    for _ in range(LONGEST // SETTLING):
        points = of.sections(x, cycle, SETTLING)
        if not np.isfinite(points).all() or of.runs_away(points[:, -1]).any():
            return True, None
        x, cycle = points[:, -1], cycle + SETTLING
        last = points[:, -2 * MAXIMUM_PERIOD - 1:] / scales
        for period in range(of.map.forcing_period, MAXIMUM_PERIOD + 1, of.map.forcing_period):
            apart = np.abs(last[:, period:] - last[:, :-period]).max(axis=(1, 2))
            for row in np.flatnonzero(apart < RETURNED):
                orbit = _repeating(of, points[row, -2 * MAXIMUM_PERIOD:], cycle)
                if orbit is not None:
                    return True, orbit
    return False, None


def _repeating(of: Motion, points: Floats, cycle: int) -> Attractor | None:
    """The stable orbit near the last points, whose last one is at `cycle`; None where there is none."""
    scales, forcing = of.map.scales, of.map.forcing_period
    back = cycle % forcing
    last = len(points) - 1 - back
    for period in range(forcing, MAXIMUM_PERIOD + 1, forcing):
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
    return bool(np.mean(there.query(here.data)[0] <= max(_spread(there), 1e-3)) > 0.9)


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
