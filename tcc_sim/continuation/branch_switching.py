"""From period doublings onto the branches of twice the period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tcc_sim.continuation.branch import Branch, BranchOrigin, Tick, branch_through
from tcc_sim.continuation.newton import minimal_period
from tcc_sim.continuation.on_branch import passes_through
from tcc_sim.continuation.palc import corrector, solution_at
from tcc_sim.continuation.problem import FAILURES
from tcc_sim.continuation.shooting import Shooting, product_of
from tcc_sim.continuation.special_points import Bifurcation, ContinuationPoint, point_at
from tcc_sim.continuation.stopping import End, StopReason


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
        shooting = Shooting.single(of, 2 * single.period, *single.ranges, settings=single.settings)
    else:
        shooting = replace(single, period=2 * single.period, segments=segments + segments)
        x, directions = np.vstack([x, x]), np.vstack([directions, -directions])
    start = shooting.unknowns(x, point.orbit.values)
    direction, row = np.zeros(len(start)), np.zeros(len(start))
    direction[:-1], row[:len(phi)] = directions.ravel(), phi
    for amplitude in single.settings.amplitudes:
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


def switch(branches: list[Branch], depth: int, longest: int | None = None, most: int | None = None,
           tick: Tick | None = None) -> None:
    """Append the doubled branch of every period doubling in which none of the others ends, and theirs, to `depth`.

    longest, most : period followed, in cycles, and branches, where they are bounded
    """
    first = 0
    for _ in range(depth):
        generation, first = list(enumerate(branches))[first:], len(branches)
        for number, parent in generation:
            for found in parent.bifurcations:
                if found.kind != "period_doubling" or (longest is not None and 2 * parent.period > longest):
                    continue
                if (most is not None and len(branches) >= most) or _ends_in(found, branches):
                    continue
                start = doubled(found)
                if start is not None and not any(passes_through(branch, start) for branch in branches):
                    began = End(StopReason.BEGAN, start.shooting.ranges[0].name, found.value)
                    origin = BranchOrigin(found.kind, found.value, number)
                    branch_through(start, origin, len(branches), both=False, began=began, tick=tick, keep=branches)


def _ends_in(found: Bifurcation, branches: Sequence[Branch]) -> bool:
    """Whether a branch of twice the period begins or ends in a doubling."""
    shooting = found.point.shooting
    span = shooting.ranges[0]
    return any(abs(span.scaled(found.value) - span.scaled(end.value)) < shooting.settings.merged
               for b in branches if b.period == 2 * shooting.period for end in (b.points[0], b.points[-1]))
