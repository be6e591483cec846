"""Follow a curve of solutions one way from its first point, and collect the special points on it.

A `Continuation` is the state of a curve that is being followed, and its iterator: it predicts, corrects and adapts the
step. Functions in `Rules` say what belongs to one kind of curve: branches of periodic orbits along a parameter, or
curves of their bifurcations in two. After the iterator of BifurcationKit.jl.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

import numpy as np

from tcc_sim.result import KEY_UNITS
from tcc_sim.shown_units import key_unit
from tcc_sim.study.continuation.newton import SAME
from tcc_sim.study.continuation.palc import (
    FLAT,
    Bracket,
    P,
    Solution,
    corrector,
    cosine_between,
    oriented,
    over_border,
    predictor,
    predictor_nodes,
    solution_at,
)
from tcc_sim.study.continuation.problem import FAILURES, Floats
from tcc_sim.study.continuation.shooting import Settings

GROWN = 10.0  # growth of a residual by the last step above which it has left the curve
NOTHING = 1e-12  # least residual in that comparison
CONTRACTION = 0.15  # second step over first step that is aimed at: four steps then reach rounding
FLAT_STEP = 1e-3  # first step without the amplitudes among the coordinates of the arclength
WANTED = 2e-3  # distance between predictor and corrector that is aimed at
FARTHEST = 0.3  # the largest one, relative to the step
SHORTER = 0.5  # least factor of the step
LONGER = 2.0  # largest factor of the step
LONGER_AFTER_REFUSED = 1.2  # the same after a longer step has failed
TURN = 0.9  # least cosine between neighbouring tangents
BRANCHING = 1e-4  # longest step in which the determinant may change its sign
NODES = 3  # points before the last one that the predictor uses
PASSING = 0.2  # distance from the first point, relative to the step, of a chord that may close a branch
PASSED = 0.02  # the same of a point on the branch that closes it


class StopReason(Enum):
    """Why a curve ends: a sentence with the parameter's `name` and `value`, a `limit`, and a special point `what`."""

    RANGE = "{name} reached {value}, the end of the range"
    CLOSED = "closed: back at its first point, {name} = {value}"
    DOUBLING = "ended in a period doubling of motions of a shorter period at {name} = {value}"
    BEGAN = "began in the period doubling at {name} = {value}"
    CANARD = ("ended at {name} = {value}: beyond it a multiplier is above {limit:g}, a canard, which double "
              "precision does not resolve")
    CANARD_CURVE = ("ended at {name} = {value}: beyond it a disturbance grows by more than {limit:g} along a part "
                    "of the motion, a canard, which double precision does not resolve")
    FAMILY = ("met a family of motions with a multiplier of exactly 1 at {name} = {value}: no branch can be "
              "followed through it")
    POINTS = "stopped after {limit:g} points at {name} = {value}"
    TRIES = "given up after {limit:g} steps tried at {name} = {value}: no progress"
    STEP = ("no further point was found beyond {name} = {value}: no step, however short, met a residual of "
            "{limit:g}")
    SPECIAL = "ended in a {what} at {name} = {value}"
    INTERRUPTED = "interrupted at {name} = {value}"


@dataclass(frozen=True)
class End:
    """One end of a branch or curve: the reason, and the parameter there."""

    reason: StopReason
    name: str
    value: float
    limit: float = 0.0
    what: str = ""

    def __str__(self) -> str:
        """The sentence, in SI units."""
        return self._sentence(KEY_UNITS.get(self.name, ""), 1.0)

    def described(self) -> str:
        """The sentence in the selected units."""
        return self._sentence(*key_unit(self.name))

    def _sentence(self, unit: str, factor: float) -> str:
        value = f"{self.value * factor:.9g} {unit}".rstrip()
        return self.reason.value.format(name=self.name, value=value, limit=self.limit, what=self.what)


S = TypeVar("S")
"""Kind of special point."""


def back_at_start(track: Continuation[P, S], new: P, special: list[S],
                  stop: End | None) -> tuple[P, list[S], End | None]:
    """Return the end of a curve at its first point, if the step to `new` passes it; else the arguments."""
    if track.passes_start(new):
        return track.points[0], special, stop or track.end(StopReason.CLOSED, track.points[0])
    return new, special, stop


def predicted(track: Continuation[P, S], before: P, corner: bool) -> None:
    """Update the predictor for a new last point."""
    track.before = [] if corner else [*track.before[1 - NODES:], before.solution]


def gave_up(track: Continuation[P, S]) -> tuple[list[S], End]:
    """Return the end of a curve without a special point, where no step succeeds."""
    return [], track.end(StopReason.STEP, limit=track.settings.residual)


def own_start(track: Continuation[P, S]) -> list[tuple[Floats, Floats]]:
    """Return unknowns and tangent of the first point."""
    equations, solution = track.here.equations, track.here.solution
    return [(equations.outer(solution.z), equations.outer(solution.tangent))]


@dataclass(frozen=True)
class Rules(Generic[P, S]):
    """Functions of a continuation for one kind of curve.

    starts : unknowns and tangents with which the curve may pass its first point again
    unresolved : the end where double precision does not resolve a new point
    special : special points up to a new point; None where the step has skipped a piece of the curve
    ended : the last point, its special points and the end where the curve ends before a new point; else the arguments
    stuck : the end where points pile up around the last one
    went_on : update for a new last point; the curve is not smooth between it and the one before if the flag is true
    cut_anew : cut the orbit into other segments where no step succeeds; return whether there are any
    lost : special points and the end where no step succeeds
    beyond_corner : the next point beyond a corner of the curve at the last point; None where there is no corner
    """

    starts: Callable[[Continuation[P, S]], list[tuple[Floats, Floats]]] = own_start
    unresolved: Callable[[Continuation[P, S], P], End | None] = lambda track, new: None
    special: Callable[[Continuation[P, S], P], list[S] | None] = lambda track, new: []
    ended: Callable[[Continuation[P, S], P, list[S], End | None], tuple[P, list[S], End | None]] = back_at_start
    stuck: Callable[[Continuation[P, S]], End | None] = lambda track: None
    went_on: Callable[[Continuation[P, S], P, bool], None] = predicted
    cut_anew: Callable[[Continuation[P, S]], bool] = lambda track: False
    lost: Callable[[Continuation[P, S]], tuple[list[S], End]] = gave_up
    beyond_corner: Callable[[Continuation[P, S]], P | None] = lambda track: None


class Continuation(Generic[P, S]):
    """One direction of a curve; lengths are in natural sizes.

    rules : what belongs to its kind
    points : all so far
    special : special points so far, each with the number of the point before it
    stop : why the curve ended; None until then
    before : solutions behind the last point, from which the next one is predicted
    length : of the next step
    longest : longest next step, after one that has left the range or skipped a piece of the curve
    tried : number of steps tried
    cut : number of points, and growth over a segment, at which failed steps last cut the orbit anew
    tests : points and values of each test function since the last change of its sign
    """

    def __init__(self, first: P, rules: Rules[P, S] | None = None) -> None:
        self.rules: Rules[P, S] = rules or Rules()
        self.points = [first]
        self.special: list[tuple[int, S]] = []
        self.stop: End | None = None
        self.settings: Settings = first.equations.settings
        self.before: list[Solution] = []
        self.length, self.longest, self.tried = self.settings.first_step, math.inf, 0
        self.cut: tuple[int, float] = (0, math.inf)
        self.tests: dict[str, list[tuple[P, float]]] = {}
        self.starts = self.rules.starts(self)

    @property
    def here(self) -> P:
        """The last point."""
        return self.points[-1]

    @property
    def ended(self) -> End:
        """Why the curve ended; an interruption while it is being followed."""
        return self.stop or self.end(StopReason.INTERRUPTED)

    def end(self, reason: StopReason, point: P | None = None, limit: float = 0.0, number: int = -1,
            what: str = "") -> End:
        """An end at a point (the last one by default), named by the parameter of this number."""
        at = self.here if point is None else point
        spans, first = at.equations.ranges, at.equations.size
        span, scaled = spans[number], at.solution.z[first:first + len(spans)][number]
        return End(reason, span.name, span.value(float(scaled)), limit, what.replace("_", " "))

    def note(self, special: list[S]) -> None:
        """Add special points behind the last point."""
        self.special += [(len(self.points) - 1, point) for point in special]

    def follow(self) -> Iterator[P]:
        """Yield the points behind the first one along the tangent, until the curve ends."""
        while self.stop is None:
            here = self.here
            if len(self.points) > self.settings.max_points:
                self.stop = self.end(StopReason.POINTS, limit=self.settings.max_points)
                return
            if self.tried > self.settings.max_tries:
                self.stop = self.end(StopReason.TRIES, limit=self.tried)
                return
            self.length = min(self.length, self.longest)
            edge, bound = self.at_a_bound() or (None, 0)
            if edge is here:
                self.stop = self.end(StopReason.RANGE, number=bound)
                return
            new = self.onward() if edge is None else edge
            corner = new is None and (new := self.rules.beyond_corner(self)) is not None
            if new is None:
                if not self.rules.cut_anew(self):
                    special, self.stop = self.rules.lost(self)
                    self.note(special)
                continue
            first = new.equations.size
            inside = corner or edge is not None or all(
                0.0 <= scaled <= 1.0 for scaled in new.solution.z[first:first + len(new.equations.ranges)])
            self.stop = self.rules.unresolved(self, new) if inside and not corner else None
            if self.stop is not None:
                return
            special_points = self.rules.special(self, new) if inside else None
            if special_points is None and not corner:
                self.longest = 0.5 * min(float(np.linalg.norm(new.solution.z - here.solution.z)), self.longest)
                continue
            self.longest = math.inf
            stop = None if edge is None else self.end(StopReason.RANGE, edge, number=bound)
            new, special, stop = self.rules.ended(self, new, special_points or [], stop)
            self.note(special)
            self.points.append(new)
            self.stop = stop or (None if corner else self.rules.stuck(self))
            if self.stop is None:
                self.rules.went_on(self, here, corner)
            yield self.here

    def onward(self) -> P | None:
        """The next point; by the unknowns alone where steps with the amplitudes as coordinates fail."""
        for by_amplitude in (True, False):
            if not by_amplitude:
                if not len(self.here.solution.linearised.amplitudes):
                    return None
                self.length = min(FLAT_STEP, self.longest)
            try:
                moved = self.step(by_amplitude)
                if moved is not None:
                    return self.here.moved(moved, by_amplitude)
            except FAILURES:
                continue
        return None

    def step(self, by_amplitude: bool = True) -> Solution | None:
        """The next solution along the curve; None where no step is short enough.

        A step is halved where the corrector goes far from the predictor, where the tangent turns by more than a set
        angle, or where the determinant of Jacobian and tangent changes sign, because the curve has met another one.

        by_amplitude : whether the amplitudes are coordinates of the arclength, where there are any
        """
        here, equations, settings = self.here.solution, self.here.equations, self.settings
        used = by_amplitude and len(here.linearised.amplitudes) > 0
        slopes = here.linearised.amplitude_gradient @ here.tangent if used else FLAT[0]
        reach = float(np.sqrt(1.0 + slopes @ slopes))
        known, most = predictor_nodes(here, self.before, slopes, NODES), LONGER
        while self.length >= settings.smallest_step:
            ahead = predictor(known, self.length * reach)
            guess = here.z + ahead[:len(here.z)]
            amplitudes = here.linearised.amplitudes[:len(slopes)] + ahead[len(here.z):]
            self.tried += 1
            corrected = corrector(equations, guess, here.tangent, (slopes, amplitudes),
                                  farthest=FARTHEST * self.length)
            if corrected is not None:
                along = float(corrected.tangent @ here.tangent + corrected.slopes @ slopes)
                new = solution_at(corrected.z, corrected.linearised, corrected.tangent if along > 0.0
                                  else -corrected.tangent)
                if over_border(here, new):
                    new = oriented(new, here.sign)
                turned = abs(along) < TURN * reach * float(np.sqrt(1.0 + corrected.slopes @ corrected.slopes))
                jumped = new.sign != here.sign and self.length > BRANCHING
                astray = cosine_between(here, new, len(slopes) > 0) < TURN
                if corrected.distance <= FARTHEST * self.length and not (turned or jumped or astray
                                                                                  or self.astray_beyond(new)):
                    # The corrector's distance grows as the third power of the length.
                    ways = corrected.distance / WANTED, corrected.contraction / CONTRACTION
                    factor = float(max(*ways, 1e-9) ** (-1.0 / 3.0))
                    self.length = min(self.length * min(max(factor, SHORTER), most), settings.largest_step)
                    return new
            self.length *= SHORTER
            most, known = LONGER_AFTER_REFUSED, known[:max(len(known) - 2, 2)]
        return None

    def astray_beyond(self, new: Solution) -> bool:
        """Whether a step over a change of the event sequence has not reached a solution."""
        # The curve may have a corner there, and Newton's method a cycle of two points, one on either side of it: the
        # last step from a small residual on one side leads back to a large one on the other.
        if not over_border(self.here.solution, new):
            return False
        try:
            left = float(np.abs(self.here.equations.linearise(new.z).residual).max())
        except FAILURES:
            return True
        return left > GROWN * max(float(np.abs(new.linearised.residual).max()), NOTHING)

    def at_a_bound(self) -> tuple[P, int] | None:
        """The point on a bound that the next step would pass, and the parameter's number; None where it passes none.

        The step is shortened until the point is found. A curve that begins on a bound and leaves the range ends there.
        """
        here, settings, solution = self.here, self.settings, self.here.solution
        for number in reversed(range(len(here.equations.ranges))):
            k = here.equations.size + number
            slope = float(solution.tangent[k])
            bound = 1.0 if slope > 0.0 else 0.0
            room = bound - float(solution.z[k])
            while self.length > settings.smallest_step and abs(self.length * slope) > abs(room):
                if room == 0.0 and len(self.points) == 1:
                    return here, number
                row = np.zeros(len(solution.z))
                row[k] = 1.0
                nodes, way = predictor_nodes(solution, self.before, FLAT[0], NODES), room / slope
                for _ in range(2):
                    way += (room - float(predictor(nodes, way)[k])) / slope
                guess = solution.z + predictor(nodes, way)
                guess[k] = bound
                farthest = FARTHEST * self.length
                corrected = corrector(here.equations, guess, row, farthest=farthest)
                if corrected is not None and corrected.distance <= farthest:
                    new = corrected.facing(solution.tangent)
                    if float(new.tangent @ solution.tangent) > TURN and new.sign == solution.sign:
                        return here.moved(new), number
                self.length *= SHORTER
        return None

    def passes_start(self, new: P) -> bool:
        """Whether the step to `new` passes the first point along its tangent."""
        p, q = (s.equations.outer(s.solution.z) for s in (self.here, new))
        length = float(np.linalg.norm(q - p))
        for z, tangent in self.starts if len(self.points) > 3 else []:
            ahead, behind = float(tangent @ (q - z)), float(tangent @ (p - z))
            part = -behind / max(ahead - behind, 1e-300)
            if not (behind < 0.0 <= ahead and float((q - p) @ tangent) > 0.0) or not (
                    np.linalg.norm(p + part * (q - p) - z) <= PASSING * length):
                continue
            middle = Bracket(self.here, new).at(part)
            if middle is not None and np.linalg.norm(middle.equations.outer(middle.solution.z) - z) <= max(
                    PASSED * length, SAME):
                return True
        return False
