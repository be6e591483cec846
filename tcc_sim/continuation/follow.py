"""Follow a curve of solutions one way from its first point, and collect the special points on it.

`follow` predicts, corrects and adapts the step. A `Continuation` is the state of a curve that is being followed:
`BranchTrack` is one of periodic orbits along a parameter, `CurveTrack` one of their bifurcations in two. After the
iterator of BifurcationKit.jl.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Generic, TypeVar

import numpy as np

from tcc_sim.continuation.bracket import Bracket, P
from tcc_sim.continuation.palc import (
    FLAT,
    Solution,
    StepSize,
    corrector,
    next_solution,
    predictor,
    predictor_nodes,
)
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.settings import Settings
from tcc_sim.continuation.shooting import Shooting


class StopReason(Enum):
    """Why a curve ends: a sentence with the parameter's `name` and `value`, a `limit`, and a special point `what`."""

    RANGE = "{name} reached {value:.9g}, the end of the range"
    CLOSED = "closed: back at its first point, {name} = {value:.9g}"
    DOUBLING = "ended in a period doubling of motions of a shorter period at {name} = {value:.9g}"
    BEGAN = "began in the period doubling at {name} = {value:.9g}"
    CANARD = ("ended at {name} = {value:.9g}: beyond it a multiplier is above {limit:g}, a canard, which double "
              "precision does not resolve")
    CANARD_CURVE = ("ended at {name} = {value:.9g}: beyond it a disturbance grows by more than {limit:g} along a part "
                    "of the motion, a canard, which double precision does not resolve")
    FAMILY = ("met a family of motions with a multiplier of exactly 1 at {name} = {value:.9g}: no branch can be "
              "followed through it")
    POINTS = "stopped after {limit:g} points at {name} = {value:.9g}"
    TRIES = "given up after {limit:g} steps tried at {name} = {value:.9g}: no progress"
    STEP = ("no further point was found beyond {name} = {value:.9g}: no step, however short, met a residual of "
            "{limit:g}")
    SPECIAL = "ended in a {what} at {name} = {value:.9g}"
    INTERRUPTED = "interrupted at {name} = {value:.9g}"


@dataclass(frozen=True)
class End:
    """One end of a branch or curve: the reason, and the parameter there."""

    reason: StopReason
    name: str
    value: float
    limit: float = 0.0
    what: str = ""

    def __str__(self) -> str:
        """The sentence."""
        return self.reason.value.format(name=self.name, value=self.value, limit=self.limit, what=self.what)


S = TypeVar("S")
"""Kind of special point."""
Bounds = tuple[tuple[int, float, float], ...]
"""(number of a parameter, low, high) of every parameter that is bounded, scaled."""
UNIT: Bounds = ((0, 0.0, 1.0),)


class Continuation(Generic[P, S]):
    """One direction of a curve.

    points : all so far
    special : special points so far, each with the number of the point before it
    stop : why the curve ended; None until then
    bounds : of the parameters
    step_size : step-size control
    before : solutions behind the last point, from which the next one is predicted
    longest : longest next step, after one that has left the range or skipped a piece of the curve
    named : number of the parameter that names the ends
    """

    named: ClassVar[int] = 0

    def __init__(self, first: P, bounds: Bounds = UNIT, step_size: StepSize | None = None) -> None:
        self.points, self.bounds = [first], bounds
        self.special: list[tuple[int, S]] = []
        self.stop: End | None = None
        self.settings: Settings = first.equations.settings
        self.step_size = step_size or StepSize(self.settings)
        self.before: list[Solution] = []
        self.longest = math.inf
        self.starts = self.first_again()

    @property
    def ended(self) -> End:
        """Why the curve ended; an interruption while it is being followed."""
        return self.stop or self.end(StopReason.INTERRUPTED)

    def note(self, special: list[S]) -> None:
        """Add special points behind the last point."""
        self.special += [(len(self.points) - 1, found) for found in special]

    @property
    def here(self) -> P:
        """The last point."""
        return self.points[-1]

    def end(self, reason: StopReason, point: P | None = None, limit: float = 0.0, number: int | None = None) -> End:
        """An end at a point (the last one by default), named by the parameter of this number."""
        number, at = self.named if number is None else number, self.here if point is None else point
        span = at.equations.ranges[number]
        return End(reason, span.name, span.value(float(at.solution.z[at.equations.first_parameter + number])), limit)

    def onward(self) -> P | None:
        """The next point; by the unknowns alone where steps with the amplitudes as coordinates fail."""
        here, step_size = self.here, self.step_size
        for by_amplitude in (True, False):
            if not by_amplitude:
                if not len(here.solution.found.amplitudes):
                    return None
                step_size.length = min(step_size.settings.flat_step, self.longest)
            try:
                moved = next_solution(here.equations, here.solution, self.before, step_size, by_amplitude,
                                      here.equations.coarse)
                if moved is not None:
                    return self.reached(moved, by_amplitude)
            except FAILURES:
                continue
        return None

    def within(self, new: P) -> bool:
        """Whether a point lies within the bounds."""
        first = new.equations.first_parameter
        return all(low <= new.solution.z[first + k] <= high for k, low, high in self.bounds)

    def shorten(self, refused: P) -> None:
        """Halve the step that led to a point which is not the next one."""
        self.longest = 0.5 * min(float(np.linalg.norm(refused.solution.z - self.here.solution.z)), self.longest)

    def passes_start(self, new: P) -> bool:
        """Whether the step to `new` passes the first point."""
        p, q = (s.equations.outer(s.solution.z) for s in (self.here, new))
        for z, tangent in self.starts if len(self.points) > 3 else []:
            part = passing(z, tangent, p, q, self.settings)
            middle = None if part is None else Bracket(self.here, new).at(part)
            if middle is not None and np.linalg.norm(middle.equations.outer(middle.solution.z) - z) <= max(
                    self.settings.passed * float(np.linalg.norm(q - p)), self.settings.same):
                return True
        return False

    def went_on(self, before: P, corner: bool) -> None:
        """Update the predictor for a new last point; `corner`: the curve is not smooth between it and `before`."""
        self.before = [] if corner else [*self.before[1 - self.settings.nodes:], before.solution]

    def first_again(self) -> list[tuple[Floats, Floats]]:
        """Unknowns and tangents with which the curve may pass its first point again."""
        first = self.here
        return [(first.equations.outer(first.solution.z), first.equations.outer(first.solution.tangent))]

    def reached(self, solution: Solution, by_amplitude: bool = True) -> P:
        """The point of a solution after the last point."""
        return self.here.moved(solution)

    def beyond_corner(self) -> P | None:
        """The next point beyond a corner of the curve at the last point; None where there is no corner."""
        return None

    def unresolved(self, new: P) -> End | None:
        """The end where double precision does not resolve a point."""
        raise NotImplementedError

    def special_between(self, new: P) -> list[S] | None:
        """The special points up to `new`; None where the step has skipped a piece of the curve."""
        raise NotImplementedError

    def ended_by(self, new: P, special: list[S], stop: End | None) -> tuple[P, list[S], End | None]:
        """The last point, its special points and the end where the curve ends before `new`; else the arguments."""
        raise NotImplementedError

    def stuck(self) -> End | None:
        """The end where points pile up around the last one."""
        return None

    def cut_anew(self) -> bool:
        """Cut the orbit into other segments where no step succeeds; return whether there are any."""
        raise NotImplementedError

    def lost(self) -> tuple[list[S], End]:
        """The special point and the end where no step succeeds."""
        return [], self.end(StopReason.STEP, limit=self.settings.residual)


def follow(track: Continuation[P, S]) -> Iterator[P]:
    """Yield the points of a track behind its first one along the tangent, until the curve ends."""
    while track.stop is None:
        here, track.stop = track.here, _exhausted(track)
        if track.stop is not None:
            return
        track.step_size.length = min(track.step_size.length, track.longest)
        edge, bound = _at_a_bound(track) or (None, 0)
        if edge is here:
            track.stop = track.end(StopReason.RANGE, number=bound)
            return
        new = track.onward() if edge is None else edge
        corner = new is None and (new := track.beyond_corner()) is not None
        if new is None:
            if not track.cut_anew():
                special, track.stop = track.lost()
                track.note(special)
            continue
        if edge is None and not corner and not track.within(new):
            track.shorten(new)
            continue
        track.stop = None if corner else track.unresolved(new)
        if track.stop is not None:
            return
        found = track.special_between(new)
        if found is None and not corner:
            track.shorten(new)
            continue
        track.longest = math.inf
        stop = None if edge is None else track.end(StopReason.RANGE, edge, number=bound)
        new, special, stop = track.ended_by(new, found or [], stop)
        track.note(special)
        track.points.append(new)
        track.stop = stop or (None if corner else track.stuck())
        if track.stop is None:
            track.went_on(here, corner)
        yield track.here


def _exhausted(track: Continuation[P, S]) -> End | None:
    """The end after the largest number of points or tries."""
    if len(track.points) > track.settings.max_points:
        return track.end(StopReason.POINTS, limit=track.settings.max_points)
    if track.step_size.tried > track.settings.max_tries:
        return track.end(StopReason.TRIES, limit=track.step_size.tried)
    return None


def _at_a_bound(track: Continuation[P, S]) -> tuple[P, int] | None:
    """The point on a bound that the next step would pass, and the parameter's number; None where it passes none.

    The step is shortened until the point is found. A curve that begins on a bound and leaves the range ends there.
    """
    here, step_size = track.here, track.step_size
    solution, settings = here.solution, step_size.settings
    for number, low, high in track.bounds:
        k = here.equations.first_parameter + number
        slope = float(solution.tangent[k])
        bound = high if slope > 0.0 else low
        room = bound - float(solution.z[k])
        while step_size.length > step_size.smallest and abs(step_size.length * slope) > abs(room):
            if room == 0.0 and len(track.points) == 1:
                return here, number
            row = np.zeros(len(solution.z))
            row[k] = 1.0
            nodes, way = predictor_nodes(solution, track.before, FLAT.weights, settings.nodes), room / slope
            for _ in range(2):
                way += (room - float(predictor(nodes, way)[k])) / slope
            guess = solution.z + predictor(nodes, way)
            guess[k] = bound
            farthest = settings.farthest * step_size.length
            found = corrector(here.equations, guess, row, farthest=farthest,
                              first=here.equations.coarse if step_size.missed > settings.missed else None)
            if found is not None and found.distance <= farthest:
                new = found.facing(solution.tangent)
                if float(new.tangent @ solution.tangent) > settings.turn and new.sign == solution.sign:
                    return track.reached(new), number
            step_size.length *= settings.shorter
    return None


def passing(z: Floats, tangent: Floats, p: Floats, q: Floats, settings: Settings) -> float | None:
    """The part of the step from p to q at which it passes z along `tangent`; None where it does not."""
    ahead, behind, step = float(tangent @ (q - z)), float(tangent @ (p - z)), q - p
    if not (behind < 0.0 <= ahead and float(step @ tangent) > 0.0):
        return None
    part = -behind / max(ahead - behind, 1e-300)
    near = np.linalg.norm(p + part * step - z) <= settings.passing * np.linalg.norm(step)
    return part if near else None


def segments_fit(shooting: Shooting, blocks: Floats, settings: Settings, anew: bool) -> bool:
    """Whether an orbit keeps its segments: the growth over each is bounded and `anew` is false, or it has no others."""
    large = float(np.abs(blocks).max()) > settings.regrowth * settings.growth
    return not (large or anew) or (not shooting.map.divisible and len(shooting.segments) == shooting.period)
