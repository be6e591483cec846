"""One way along a branch, step by step, until it ends; every end has a sentence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tcc_sim.continuation.detection import between, collapse, returned, returning
from tcc_sim.continuation.newton import LARGEST_LEFT, newton
from tcc_sim.continuation.palc import (
    Solution,
    StepSize,
    corrector,
    next_solution,
    null_direction,
    solution_at,
    tangent_of,
)
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.shooting import GROWTH, Linearised, Shooting
from tcc_sim.continuation.sliding import differ
from tcc_sim.continuation.special_points import SMOOTH, Bifurcation, ContinuationPoint, point_at, turned

MOST_POINTS = 3000
MOST_TRIES = 6000
"""Steps tried along one direction of a branch, the halved ones too, after which it is given up."""
SAME_END = 1e-6
"""Distance, relative to the range, at which a fold is the end itself where a branch passes into that of its own
shift.
"""
FLAT_START = 1e-3
"""First step without the largest sizes among the arclength's coordinates."""
FAR_GROWN = 10.0
"""Growth over a segment per what it may be at first, above which the orbit is cut anew."""
CHECKED = 20
"""Points after which fewer segments are tried."""
CANARD = 1e10
"""Modulus of a multiplier above which a branch ends: an orbit known to 1e-12 closes to no better than 1e-2 over its
period, and neither value nor sign of such a multiplier can be trusted. Motions along the falling branch of friction get
there."""
EXACTLY_ONE, FAMILY_LENGTH = 1e-7, 1e-2
"""Distance of a multiplier from 1, and of the tangent from one without a change of the parameter, on a family of
motions at one value of the parameter; and how far a branch runs along it, in natural sizes, before it counts as one."""
BESIDE = (1e-8, 1e-7, 1e-6, 1e-5)
"""How far beyond a change of the event sequence its other side is looked at."""


@dataclass(frozen=True)
class Course:
    """How a branch is followed.

    name : of the parameter, for sentences
    most : points in one direction
    tick : called with every point
    detect : whether bifurcations are looked for
    largest : step, in natural sizes
    """

    name: str
    most: int = MOST_POINTS
    tick: Callable[[ContinuationPoint], None] | None = None
    detect: bool = True
    largest: float = 0.1


def away_from(found: list[Bifurcation], new: ContinuationPoint) -> ContinuationPoint:
    """The point behind a change of the event sequence, with its tangent away from there.

    Where two pieces of a branch meet on one side of a border, tangents that point alike lead back to it.
    """
    borders = [f.point.solution.z for f in found if f.kind not in SMOOTH]
    if not borders or len(borders[-1]) != len(new.solution.z):
        return new
    way = new.solution.z - borders[-1]
    if float(way @ new.solution.tangent) > -0.5 * float(np.linalg.norm(way)):
        return new
    return turned(new)


@dataclass
class Walk:
    """One direction of a branch, from a first point; the results are filled in as it goes."""

    course: Course
    points: list[ContinuationPoint]
    bifurcations: list[Bifurcation] = field(default_factory=list)
    sentence: str = ""
    closed: bool = False
    done: bool = False
    step_size: StepSize = field(default_factory=StepSize)
    by_amplitude: bool = True
    _anew: int = 0
    """Number of points when the orbit was cut anew for want of a step."""
    _ends: list[tuple[Floats, Floats]] = field(default_factory=list)

    def run(self) -> Walk:
        """Go on until an end; Ctrl-C is an end too, and passed on."""
        first, self.step_size.largest = self.points[0], self.course.largest
        self.sentence = f"interrupted at {self._where(first)}"
        self._ends = returning(first)
        before: list[Solution] = []
        while not self.done:
            here = self.points[-1]
            self.sentence = f"interrupted at {self._where(here)}"
            if len(self.points) > self.course.most:
                self.sentence = f"stopped after {self.course.most} points at {self._where(here)}"
                break
            if self.step_size.tried > MOST_TRIES:
                self.sentence = f"given up after {self.step_size.tried} steps tried at {self._where(here)}: no progress"
                break
            edge = self._edge(here)
            if edge is not None and self._too_steep(edge):
                break
            if edge is not None:
                self._take(edge)
                self.sentence = f"{self.course.name} reached {edge.value:.9g}, the end of the range"
                break
            length = self.step_size.length
            new = self._onward(here, before)
            if new is None:
                if not (self._turn_at_border(here) or self._cut_anew(here)):
                    self.sentence = (f"no further point was found beyond {self._where(here)}: no step down to "
                                     f"{self.step_size.smallest:.0e} of the natural sizes met a residual of "
                                     f"{LARGEST_LEFT:.0e}")
                    break
                before = []
                continue
            if not 0.0 <= new.solution.z[here.shooting.size] <= 1.0:
                self.step_size.length = 0.5 * length
                continue
            if self._too_steep(new):
                break
            self._take(new)
            before.append(here.solution)
            if here.shooting.map.piecewise and differ(here.orbit.seen.events, new.orbit.seen.events):
                before = []  # Beyond a corner the points before it tell nothing.
            if self.done or self._in_family():
                break
            recut = self._recut(self.points[-1])
            if recut is not None:
                self.points[-1], before = recut, []
        return self

    def _onward(self, here: ContinuationPoint, before: list[Solution]) -> ContinuationPoint | None:
        """The next point; where steps with the largest sizes as further coordinates fail, by the unknowns alone."""
        for self.by_amplitude in (True, False):
            if not self.by_amplitude:
                if not len(here.solution.found.amplitudes):
                    return None
                self.step_size.length = FLAT_START
            try:
                moved = next_solution(here.shooting, here.solution, before, self.step_size, self.by_amplitude)
                if moved is not None:
                    return point_at(here.shooting, moved)
            except FAILURES:
                continue
        return None

    def _where(self, point: ContinuationPoint) -> str:
        """The parameter of a point in words."""
        return f"{self.course.name} = {point.value:.9g}"

    def _take(self, new: ContinuationPoint) -> None:
        """Append a point, with the bifurcations on the way to it; look whether the branch has closed."""
        here = self.points[-1]
        found = between(here, new, self.by_amplitude) if self.course.detect else []
        shorter = collapse(here, new) if here.solution.sign != new.solution.sign else None
        if shorter is not None:
            found = [f for f in found if f.kind not in ("branch_point", "fold")]
            new, self.done = shorter, True
            span, last = new.shooting.ranges[0], self.bifurcations
            while last and last[-1].kind in ("branch_point", "fold") and abs(
                    span.scaled(last[-1].value) - span.scaled(new.value)) < SAME_END:
                last.pop()
            self.sentence = f"ended in a period doubling of motions of a shorter period at {self._where(new)}"
        self.bifurcations += found
        new = away_from(found, new)
        if self.course.tick is not None:
            self.course.tick(new)
        if len(self.points) > 3 and not self.done and returned(self._ends, self.points[0], here, new):
            self.closed = self.done = True
            self.sentence = f"closed: back at its first point, {self._where(self.points[0])}"
            new = self.points[0]
        self.points.append(new)

    def _edge(self, here: ContinuationPoint) -> ContinuationPoint | None:
        """The point at the end of the range where the next step would pass it; the step is shortened until one is
        found.
        """
        size, step_size, at = here.shooting.size, self.step_size, here.solution
        slope = here.slope
        while step_size.length > step_size.smallest:
            step = step_size.length * slope
            bound = 1.0 if slope > 0.0 else 0.0
            room = bound - float(at.z[size])
            if abs(step) <= abs(room):
                return None
            if room == 0.0 and len(self.points) == 1:
                return here
            row = np.zeros(len(at.z))
            row[size] = 1.0
            guess = at.z + room / slope * at.tangent
            guess[size] = bound
            found = corrector(here.shooting, guess, row)
            if found is not None and found.distance <= 0.3 * step_size.length:
                tangent = found.tangent if float(found.tangent @ at.tangent) > 0.0 else -found.tangent
                new = solution_at(found.z, found.found, tangent)
                if float(tangent @ at.tangent) > step_size.turn and new.sign == at.sign:
                    return point_at(here.shooting, new)
            step_size.length *= 0.5
        return None

    def _too_steep(self, new: ContinuationPoint) -> bool:
        """Whether an orbit grows so much that it is not followed; nothing is looked for on the way to it."""
        if not abs(new.orbit.multipliers[0]) > CANARD:
            return False
        self.sentence = (f"ended at {self._where(self.points[-1])}: beyond it a multiplier is above {CANARD:.0e}, a "
                         "canard, which double precision does not resolve")
        return True

    def _in_family(self) -> bool:
        """Whether the branch has run for FAMILY_LENGTH through motions with a multiplier of exactly 1 at one parameter.

        Two points alone tell nothing: beside a doubling, where the parameter goes as the square of the way, it stands
        still and a multiplier is 1 as well.
        """
        last = self.points[-1]
        for point in reversed(self.points):
            if np.abs(point.orbit.multipliers - 1.0).min() > EXACTLY_ONE or abs(point.slope) > EXACTLY_ONE:
                return False
            away = (last.orbit.section - point.orbit.section) / last.shooting.map.scales
            if float(np.linalg.norm(away)) >= FAMILY_LENGTH:
                self.sentence = (f"met a family of motions with a multiplier of exactly 1 at {self._where(last)}: no "
                                 "branch can be followed through it")
                return True
        return False

    def _cut_anew(self, here: ContinuationPoint) -> bool:
        """Go on in other segments where no step is possible in these: one of them may start where slip does, and
        Newton's method then goes to and fro between two event sequences. Whether there are other ones.

        That is why segments are cut by growth and no node is put at an onset of slip: the onset moves along a branch,
        and a node on it would be in the way at every step, not at one. The canards behind both folds of period two
        are passed so with either law.
        """
        if self._anew == len(self.points):
            return False
        self._anew = len(self.points)
        other = self._recut(here, True)
        if other is None or other.shooting.segments == here.shooting.segments:
            return False
        self.points[-1], self.step_size.length = other, FLAT_START
        return True

    def _recut(self, point: ContinuationPoint, anew: bool = False) -> ContinuationPoint | None:
        """The point in other segments, where the growth over one of them is large or fewer may do, or `anew`; None
        where these stay.
        """
        shooting, grown = point.shooting, float(np.abs(point.solution.found.blocks).max())
        if not shooting.map.divisible and (shooting.period == 1 or len(shooting.segments) == shooting.period):
            return None
        fewer = len(shooting.segments) > 1 and len(self.points) % CHECKED == 0
        if not (grown > FAR_GROWN * GROWTH or fewer or anew):
            return None
        finer, z = shooting.cut(point.solution.z)
        if len(finer.segments) == len(shooting.segments) and not (grown > FAR_GROWN * GROWTH or anew):
            return None
        polished = newton(finer, z)
        if polished is None:
            return None
        found = finer.linearise(polished)
        along = np.zeros(len(z))
        n = shooting.map.dimension
        along[:n], along[-1] = point.solution.tangent[:n], point.solution.tangent[-1]
        return point_at(finer, solution_at(polished, found, tangent_of(found, along)))

    def _turn_at_border(self, here: ContinuationPoint) -> bool:
        """Go on beyond a change of the event sequence at which the branch has a corner; whether that was possible.

        An end of slip that passes phase 0 makes one too: of motions that stick there none has a slip speed.
        """
        shooting = here.shooting
        if not shooting.map.piecewise:
            return False
        for beside in BESIDE:
            try:
                found = shooting.linearise(here.solution.z + beside * here.solution.tangent)
                tangent = null_direction(found)
                sides = [self._events_at(shooting, here.solution.z + s * beside * tangent) for s in (1.0, -1.0)]
            except FAILURES:
                continue
            for along, events in zip((tangent, -tangent), sides):
                new = None if events == here.orbit.seen.events else self._beyond(here, found, along, beside)
                if new is not None:
                    self._take(new)
                    return True
        return False

    def _beyond(self, here: ContinuationPoint, found: Linearised, along: Floats,
                beside: float) -> ContinuationPoint | None:
        """The next point on the other piece of a branch that has a corner at `here`; None where none is found.

        found : derivative `beside` the corner; where it is neither piece's, that along the other one is taken
        """
        shooting, z = here.shooting, here.solution.z
        for known in (found, None):
            step_size = StepSize(length=beside, smallest=1e-10)
            try:
                start = known or shooting.linearise(z + beside * along)
                moved = next_solution(shooting, solution_at(z, start, tangent_of(start, along)), [], step_size, False)
                new = None if moved is None else point_at(shooting, moved)
            except FAILURES:
                continue
            if new is not None and new.orbit.seen.events != here.orbit.seen.events:
                self.step_size.length = step_size.length
                return new
        return None

    @staticmethod
    def _events_at(shooting: Shooting, z: Floats) -> str:
        """The event sequence of one period from a point near an orbit."""
        return shooting.map.observe(shooting.nodes(z)[0], shooting.values(z), 0, shooting.period).events
