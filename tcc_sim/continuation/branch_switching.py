"""From a period doubling onto the branch of twice the period, and orbits at given values of the parameter."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tcc_sim.continuation.branch import Branch, follow
from tcc_sim.continuation.newton import Orbit, minimal_period
from tcc_sim.continuation.palc import corrector, solution_at
from tcc_sim.continuation.problem import FAILURES
from tcc_sim.continuation.shooting import Shooting, product_of
from tcc_sim.continuation.special_points import Bifurcation, Bracket, ContinuationPoint, point_at
from tcc_sim.continuation.walk import Course

AMPLITUDES = (3e-3, 1e-3, 1e-2, 3e-4, 3e-5, 3e-6, 1e-6)
"""Distances from the doubling, in natural sizes, at which its branch is looked for; next to a canard, where the map
bends within 1e-5, only the smallest are on it."""
MERGED = 1e-5
"""Distance of two doublings, relative to the range, that one doubled branch joins."""


def doubled(found: Bifurcation) -> ContinuationPoint | None:
    """A first point on the branch that a period doubling begets; None where none is found.

    It lies in the plane phi . (x - x*) = eps, phi the eigenvector of the multiplier -1, so the orbit of the simple
    period is not in it; the tangent points away from the doubling.
    """
    point = found.point
    single = point.shooting
    of, blocks = single.map, point.solution.found.blocks
    values, vectors = np.linalg.eig(product_of(blocks))
    phi = np.real(vectors[:, int(np.abs(values + 1.0).argmin())])
    phi = phi / np.linalg.norm(phi)
    along = [phi]
    for block in blocks[:-1]:
        along.append(block @ along[-1])
    x, directions, segments = point.orbit.nodes, np.array(along), single.segments
    if len(segments) == 1:
        shooting = Shooting.single(of, 2 * single.period, *single.ranges)
    else:
        shooting = Shooting(of, 2 * single.period, single.ranges, segments + segments)
        x, directions = np.vstack([x, x]), np.vstack([directions, -directions])
    start = shooting.unknowns(x, point.orbit.values)
    direction, row = np.zeros(len(start)), np.zeros(len(start))
    direction[:-1], row[:len(phi)] = directions.ravel(), phi
    for amplitude in AMPLITUDES:
        for sign in (1.0, -1.0):
            got = corrector(shooting, start + sign * amplitude * direction, row)
            if got is None or not 0.0 <= got.z[-1] <= 1.0:
                continue
            try:
                at = shooting.nodes(got.z)[0]
                half = minimal_period(shooting.map, at, shooting.values(got.z), shooting.period, 0.1 * amplitude)
                if half != shooting.period:
                    continue
                tangent = got.tangent if sign * float(got.tangent @ row) > 0.0 else -got.tangent
                return point_at(shooting, solution_at(got.z, got.found, tangent))
            except FAILURES:
                continue
    return None


def switch(branches: list[Branch], course: Course, depth: int) -> None:
    """Append the doubled branches of every period doubling, and theirs, down to `depth`."""
    generation = list(enumerate(branches))
    for _ in range(depth):
        following: list[tuple[int, Branch]] = []
        for number, parent in generation:
            reached: list[float] = []
            for found in [f for f in parent.bifurcations if f.kind == "period_doubling"]:
                span = found.point.shooting.ranges[0]
                if any(abs(span.scaled(found.value) - r) < MERGED for r in reached):
                    continue
                first = doubled(found)
                if first is None:
                    continue
                origin = {"kind": found.kind, "value": found.value, "branch": number}
                child = follow(first, course, origin, len(branches), both=False,
                               began=f"began in the period doubling at {course.name} = {found.value:.9g}",
                               keep=branches)
                reached += [span.scaled(s.value) for s in child.points[-1:]]
                following.append((len(branches) - 1, child))
        generation = following


def orbits_at(branch: Branch, value: float) -> list[Orbit]:
    """The orbits of a branch at exactly this value of its parameter, one for every crossing."""
    out: list[Orbit] = []
    points = branch.points
    for a, b in pairwise(points):
        if a.value == value:
            out.append(a.orbit)
        elif (a.value - value) * (b.value - value) < 0.0:
            orbit = _crossing(a, b, value)
            if orbit is not None:
                out.append(orbit)
    if points[-1].value == value and not branch.closed:
        out.append(points[-1].orbit)
    return out


def _crossing(a: ContinuationPoint, b: ContinuationPoint, value: float) -> Orbit | None:
    """The orbit at `value` between two points of the same equations."""
    if a.shooting != b.shooting:
        return None
    bracket = Bracket(a, b)
    at = a.shooting.ranges[0].scaled(value)
    size = a.shooting.size
    near = bracket.locate(lambda s: float(s.solution.z[size]) - at)
    if near is None:
        return None
    row, guess = np.zeros(size + 1), near.solution.z.copy()
    row[size], guess[size] = 1.0, at
    found = corrector(a.shooting, guess, row)
    if found is None:
        return near.orbit
    orbit = point_at(a.shooting, solution_at(found.z, found.found, near.solution.tangent)).orbit
    return Orbit(orbit.period, (value,), orbit.nodes, orbit.multipliers, orbit.seen, orbit.residual)
