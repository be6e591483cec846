"""Whether a motion lies on a branch: by its section where that is known, else by period and amplitude."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tcc_sim.continuation.branch import Branch
from tcc_sim.continuation.newton import shifts
from tcc_sim.continuation.problem import Floats
from tcc_sim.continuation.settings import DEFAULTS
from tcc_sim.continuation.special_points import ContinuationPoint


@dataclass(frozen=True)
class SettledMotion:
    """A motion that a sweep came to.

    value : of the parameter
    state : (n,) at the start of cycle `cycle`
    period : cycles; 0 where it has none
    amplitude : its largest size
    """

    value: float
    state: Floats
    cycle: int
    period: int
    amplitude: float

    def has_period(self, period: int, base: int = 1) -> bool:
        """Whether it repeats as motions of `period` cycles do, where the excitation repeats after `base`."""
        return self.period > 0 and math.lcm(self.period, base) == period


@dataclass(frozen=True)
class BranchPlace:
    """Where a motion lies: a branch, and the number of the point before it."""

    branch: int
    after: int


class BranchPiece(NamedTuple):
    """A piece of a branch at a value: the number of the point before it, its ends, and the part of the way between."""

    after: int
    a: ContinuationPoint
    b: ContinuationPoint
    part: float

    def holds(self, seen: SettledMotion, size: float) -> float:
        """How far a motion's amplitude is from that of the piece; inf where that is too far.

        size : amplitude of the largest motion
        """
        low, high = self.a.orbit.seen.largest, self.b.orbit.seen.largest
        away = abs(low + self.part * (high - low) - seen.amplitude)
        return away if away <= DEFAULTS.alike * size + DEFAULTS.off_chord * abs(high - low) else math.inf


def pieces_at(branch: Branch, value: float) -> list[BranchPiece]:
    """The pieces of a branch across a value."""
    out = []
    for k, a, b in _pieces(branch):
        if min(a.value, b.value) <= value <= max(a.value, b.value):
            width = b.value - a.value
            out.append(BranchPiece(k, a, b, (value - a.value) / width if width else 0.5))
    return out


def _pieces(branch: Branch) -> Iterator[tuple[int, ContinuationPoint, ContinuationPoint]]:
    """Neighbouring points of a branch, its folds among them: a branch goes on to there beyond its last point."""
    folds: dict[int, list[ContinuationPoint]] = {}
    for found in branch.bifurcations:
        if found.kind == "fold":
            folds.setdefault(found.after, []).append(found.point)
    for k, (a, b) in enumerate(pairwise(branch.points)):
        for one, two in pairwise([a, *folds.get(k, []), b]):
            yield k, one, two


def place_of(seen: SettledMotion, branches: Sequence[Branch], size: float, base: int = 1) -> BranchPlace | None:
    """Where a motion lies: on the stable piece with its period and amplitude; the nearest one of several."""
    best, place = math.inf, None
    for number, branch in enumerate(branches):
        if not seen.has_period(branch.period, base):
            continue
        for piece in pieces_at(branch, seen.value):
            if (piece.a.orbit.stable or piece.b.orbit.stable) and (away := piece.holds(seen, size)) < best:
                best, place = away, BranchPlace(number, piece.after)
    return place


def passes_through(branch: Branch, found: ContinuationPoint) -> bool:
    """Whether a branch passes through an orbit, whichever of its cycles it was taken up in."""
    of, orbit = found.shooting.map, found.orbit
    if branch.period != orbit.period:
        return False
    sections = np.array(shifts(of, orbit.section, orbit.values, orbit.period))
    for piece in pieces_at(branch, found.value):
        chord = piece.b.orbit.section - piece.a.orbit.section
        away = np.abs((piece.a.orbit.section + piece.part * chord - sections) / of.scales).max(axis=1)
        if away.min() <= DEFAULTS.on_chord + DEFAULTS.off_chord * np.abs(chord / of.scales).max():
            return True
    return False
