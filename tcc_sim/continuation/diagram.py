"""Bifurcation diagrams: a branch through every motion of a sweep that lies on no other one, and doubled branches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tcc_sim.continuation.branch import (
    Branch,
    BranchOrigin,
    SettledMotion,
    Tick,
    branch_through,
    first_point,
    passes_through,
    place_of,
)
from tcc_sim.continuation.follow import End, StopReason
from tcc_sim.continuation.newton import find_orbit, minimal_period
from tcc_sim.continuation.palc import corrector
from tcc_sim.continuation.problem import FAILURES, Floats, ParameterMap
from tcc_sim.continuation.settings import DEFAULTS, Settings
from tcc_sim.continuation.shooting import ParameterRange, Shooting, product_of
from tcc_sim.continuation.special_points import Bifurcation, ContinuationPoint, point_at

SWEPT = Settings(max_points=200, largest_step=0.3)
"""Settings for pictures: steps of about a hundredth of their width, and bounded branches."""


def bifurcation_diagram(of: ParameterMap, span: ParameterRange, seen: Sequence[SettledMotion],
                        tick: Tick | None = None, settings: Settings = SWEPT) -> list[Branch]:
    """Branches through the periodic motions of a sweep, and the branches from their doublings.

    Parameters
    ----------
    of, span : the map with one free parameter, and its range
    seen : motions along the sweep, in order; the longest run of one period that lies on no branch is followed first
    tick : called with every point
    """
    out: list[Branch] = []
    size, longest = amplitude_of(seen), settings.longest_period * of.forcing_period
    left = {k: s for k, s in enumerate(seen) if 0 < s.period <= longest}
    while left and len(out) < settings.max_branches:
        left = {k: s for k, s in left.items() if place_of(s, out, size, of.forcing_period) is None}
        run = _longest_run(left)
        if not run:
            break
        first = point_of(of, span, left.pop(run[len(run) // 2]), settings)
        if first is not None and not any(passes_through(branch, first) for branch in out):
            branch_through(first, number=len(out), tick=tick, keep=out)
    switch(out, 1, longest, settings.max_branches, tick)
    return out


def left_out(seen: Sequence[SettledMotion], branches: Sequence[Branch], base: int = 1,
             settings: Settings = SWEPT) -> list[str]:
    """Sentences on motions and branches that a diagram leaves out."""
    size, longest, out = amplitude_of(seen), settings.longest_period * base, list[str]()
    alone = [s for s in seen if s.period and place_of(s, branches, size, base) is None]
    long = sum(s.period > longest for s in alone)
    if len(alone) > long:
        full = len(branches) >= settings.max_branches
        reason = f"{settings.max_branches} branches are followed" if full else "none was found there"
        out.append(f"{len(alone) - long} of {len(seen)} motions lie on no branch: {reason}")
    if long:
        out.append(f"{long} of {len(seen)} motions have a period above {longest} and lie on no branch")
    stopped = sum(any(end.reason is StopReason.POINTS for end in branch.ended) for branch in branches)
    if stopped:
        out.append(f"{stopped} of {len(branches)} branches go on: {settings.max_points} points are followed either way")
    return out


def amplitude_of(seen: Sequence[SettledMotion]) -> float:
    """The largest size of the periodic motions of a sweep; of all motions where these are too small."""
    most = max((s.amplitude for s in seen), default=0.0)
    periodic = max((s.amplitude for s in seen if s.period), default=0.0)
    return periodic if periodic > DEFAULTS.next_to_nothing * most else most


def point_of(of: ParameterMap, span: ParameterRange, seen: SettledMotion,
             settings: Settings = DEFAULTS) -> ContinuationPoint | None:
    """The point of a branch at a motion of a sweep; None where Newton's method finds no orbit there."""
    shooting = Shooting.single(of, math.lcm(seen.period, of.forcing_period), span, settings=settings)
    try:
        z = find_orbit(shooting, (seen.value,), [state_at_phase_0(of, seen)])
        return None if z is None else first_point(shooting, z)
    except FAILURES:
        return None


def state_at_phase_0(of: ParameterMap, seen: SettledMotion) -> Floats:
    """The state of a motion at the next cycle in which the excitation repeats."""
    phase = seen.cycle % of.forcing_period
    return of.evaluate(seen.state, (seen.value,), phase, of.forcing_period - phase).value if phase else seen.state


def _longest_run(left: dict[int, SettledMotion]) -> list[int]:
    """The longest run of neighbours with one period."""
    runs: list[list[int]] = []
    for k, s in left.items():
        if runs and runs[-1][-1] == k - 1 and left[k - 1].period == s.period:
            runs[-1].append(k)
        else:
            runs.append([k])
    return max(runs, key=len, default=[])


def doubled(found: Bifurcation) -> ContinuationPoint | None:
    """A first point on the branch of doubled motions; None where none is found.

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
                return point_at(shooting, got.facing(sign * row))
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
