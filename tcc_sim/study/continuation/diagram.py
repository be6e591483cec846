"""Bifurcation diagrams: a branch through every motion of a sweep that lies on no other one, and doubled branches.

A motion lies on a branch by its section if that is known, else by its period and amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tcc_sim.analysis.steady.multipliers import product_of
from tcc_sim.study.continuation.branch import Branch, BranchOrigin, Tick, branch_through, first_point
from tcc_sim.study.continuation.follow import End, StopReason
from tcc_sim.study.continuation.newton import find_orbit, minimal_period, shifts
from tcc_sim.study.continuation.palc import corrector
from tcc_sim.study.continuation.problem import FAILURES, Floats, ParameterMap
from tcc_sim.study.continuation.shooting import DEFAULTS, ParameterRange, Settings, Shooting
from tcc_sim.study.continuation.special_points import Bifurcation, ContinuationPoint, point_at

MERGED = 1e-5  # distance, relative to the range, at which two ends of branches are one doubling
# Distances from a doubling at which its branch is tried; beside a canard, where the map bends within 1e-5, only the
# smallest ones lie on it.
AMPLITUDES = (3e-3, 1e-3, 1e-2, 3e-4, 3e-5, 3e-6, 1e-6)
ALIKE = 0.01  # difference of two amplitudes of one motion, relative to the largest of a sweep
NEXT_TO_NOTHING = 1e-3  # part of a sweep's largest size below which its periodic motions are no measure
OFF_CHORD = 0.3  # distance of a motion from the chord between two points, relative to its rise
ON_CHORD = 1e-3  # the same where the chord does not rise

SWEPT = Settings(max_points=200, largest_step=0.3)
"""Settings for pictures: steps of about a hundredth of their width, and bounded branches."""


@dataclass(frozen=True)
class SettledMotion:
    """A motion that a sweep found.

    value : of the parameter
    state : (n,) at the start of cycle `cycle`
    period : cycles; 0 for none
    amplitude : its largest size
    """

    value: float
    state: Floats
    cycle: int
    period: int
    amplitude: float

    def has_period(self, period: int, base: int = 1) -> bool:
        """Whether it repeats after `period` cycles, where the excitation repeats after `base`."""
        return self.period > 0 and math.lcm(self.period, base) == period


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
        runs: list[list[int]] = []
        for k, s in left.items():
            if runs and runs[-1][-1] == k - 1 and left[k - 1].period == s.period:
                runs[-1].append(k)
            else:
                runs.append([k])
        if not runs:
            break
        run = max(runs, key=len)
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


class BranchPiece(NamedTuple):
    """A piece of a branch at a value: the number of the point before it, its ends, and the part of the chord there."""

    after: int
    a: ContinuationPoint
    b: ContinuationPoint
    part: float

    def holds(self, seen: SettledMotion, size: float) -> float:
        """Distance of a motion's amplitude from the piece; inf where too far for a largest amplitude of `size`."""
        low, high = self.a.orbit.seen.largest, self.b.orbit.seen.largest
        away = abs(low + self.part * (high - low) - seen.amplitude)
        return away if away <= ALIKE * size + OFF_CHORD * abs(high - low) else math.inf


def pieces_at(branch: Branch, value: float) -> list[BranchPiece]:
    """The pieces of a branch across a value; its folds extend it beyond its extreme points."""
    folds, out = dict[int, list[ContinuationPoint]](), []
    for bifurcation in branch.bifurcations:
        if bifurcation.kind == "fold":
            folds.setdefault(bifurcation.after, []).append(bifurcation.point)
    for k, ends in enumerate(pairwise(branch.points)):
        for a, b in pairwise([ends[0], *folds.get(k, []), ends[1]]):
            if min(a.value, b.value) <= value <= max(a.value, b.value):
                width = b.value - a.value
                out.append(BranchPiece(k, a, b, (value - a.value) / width if width else 0.5))
    return out


def place_of(seen: SettledMotion, branches: Sequence[Branch], size: float, base: int = 1) -> tuple[int, int] | None:
    """The stable piece with the period and amplitude of a motion, the nearest one of several; None for no piece.

    The piece is the number of its branch and that of the point before it.
    """
    best, place = math.inf, None
    for number, branch in enumerate(branches):
        if not seen.has_period(branch.period, base):
            continue
        for piece in pieces_at(branch, seen.value):
            if (piece.a.orbit.stable or piece.b.orbit.stable) and (away := piece.holds(seen, size)) < best:
                best, place = away, (number, piece.after)
    return place


def passes_through(branch: Branch, point: ContinuationPoint) -> bool:
    """Whether a branch passes through an orbit, which may begin in any of its cycles."""
    of, orbit = point.shooting.map, point.orbit
    if branch.period != orbit.period:
        return False
    sections = np.array(shifts(of, orbit.section, orbit.values, orbit.period))
    for piece in pieces_at(branch, point.value):
        chord = piece.b.orbit.section - piece.a.orbit.section
        away = np.abs((piece.a.orbit.section + piece.part * chord - sections) / of.scales).max(axis=1)
        if away.min() <= ON_CHORD + OFF_CHORD * np.abs(chord / of.scales).max():
            return True
    return False


def amplitude_of(seen: Sequence[SettledMotion]) -> float:
    """The largest size of the periodic motions of a sweep; of all motions where these are too small."""
    most = max((s.amplitude for s in seen), default=0.0)
    periodic = max((s.amplitude for s in seen if s.period), default=0.0)
    return periodic if periodic > NEXT_TO_NOTHING * most else most


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


def doubled(bifurcation: Bifurcation) -> ContinuationPoint | None:
    """A first point on the branch of doubled motions; None where none is found.

    It lies in the plane phi . (x - x*) = eps, phi the eigenvector of the multiplier -1, so the orbit of the simple
    period is not in it; the tangent points away from the doubling.
    """
    point = bifurcation.point
    single = point.shooting
    of, blocks = single.map, point.solution.linearised.blocks
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
            for bifurcation in parent.bifurcations:
                if bifurcation.kind != "period_doubling" or (longest is not None and 2 * parent.period > longest):
                    continue
                if most is not None and len(branches) >= most:
                    continue
                scaled, merged = bifurcation.point.shooting.ranges[0].scaled, MERGED
                if any(abs(scaled(bifurcation.value) - scaled(end.value)) < merged for b in branches
                       if b.period == 2 * parent.period for end in (b.points[0], b.points[-1])):
                    continue
                start = doubled(bifurcation)
                if start is not None and not any(passes_through(branch, start) for branch in branches):
                    began = End(StopReason.BEGAN, start.shooting.ranges[0].name, bifurcation.value)
                    origin = BranchOrigin(bifurcation.kind, bifurcation.value, number)
                    branch_through(start, origin, len(branches), both=False, began=began, tick=tick, keep=branches)
