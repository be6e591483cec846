"""A branch of periodic orbits: followed both ways within a range, with its bifurcations, and why it ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.studies.bifurcations import (
    Bifurcation,
    Chord,
    Station,
    event_border,
    smooth_bifurcations,
    station_at,
    with_branch,
)
from tcc_sim.studies.continuation import Heights, Point, Stride, advance, correct, null_direction, point_at, tangent_of
from tcc_sim.studies.event_borders import differ
from tcc_sim.studies.maps import FAILURES, Floats
from tcc_sim.studies.orbits import SAME, Orbit, shifts
from tcc_sim.studies.shooting import GROWTH, Shooting

MOST_POINTS = 3000
STEEP_START = 1e-3
"""First step with the largest sizes among the arclength's coordinates."""
HEIGHT_STEP = 1e-7
BESIDE = (1e-8, 1e-7, 1e-6, 1e-5)
"""How far beyond a change of the event sequence its other side is looked at."""

@dataclass
class Branch:
    """One branch in order along it.

    origin : "start", or the kind and value of the bifurcation it was switched at
    ended : two sentences, one for each end
    """

    period: int
    origin: Any
    stations: list[Station]
    ended: tuple[str, str]
    closed: bool = False
    bifurcations: list[Bifurcation] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """As an entry of `branches`."""
        rows = [s.orbit.as_json() for s in self.stations]
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        return {"period": self.period, "origin": self.origin, **columns, "ended": list(self.ended), "closed": self.closed}


@dataclass(frozen=True)
class Course:
    """How a branch is followed.

    name : of the parameter, for sentences
    most : points in one direction
    tick : called with every point
    detect : whether bifurcations are looked for
    """

    name: str
    most: int = MOST_POINTS
    tick: Callable[[Station], None] | None = None
    detect: bool = True


@dataclass
class Walk:
    """One direction of a branch, from a first station; the results are filled in as it goes."""

    course: Course
    stations: list[Station]
    bifurcations: list[Bifurcation] = field(default_factory=list)
    sentence: str = ""
    closed: bool = False
    done: bool = False
    stride: Stride = field(default_factory=Stride)
    steep: bool = False
    _ends: list[tuple[Floats, Floats]] = field(default_factory=list)

    def run(self) -> Walk:
        """Go on until an end; Ctrl-C is an end too, and passed on."""
        first = self.stations[0]
        self.sentence = f"interrupted at {self._where(first)}"
        self._ends = returning(first)
        before: tuple[Point, float] | None = None
        while not self.done:
            here = self.stations[-1]
            self.sentence = f"interrupted at {self._where(here)}"
            if len(self.stations) > self.course.most:
                self.sentence = f"stopped after {self.course.most} points at {self._where(here)}"
                break
            edge = self._edge(here)
            if edge is not None:
                self._take(edge)
                self.sentence = f"{self.course.name} reached {edge.value:.9g}, the end of the range"
                break
            length = self.stride.length
            new = self._onward(here, before)
            if new is None:
                if not self._turn_at_border(here):
                    self.sentence = f"no further point was found beyond {self._where(here)}"
                    break
                before = None
                continue
            if not 0.0 <= new.point.z[here.shooting.size] <= 1.0:
                self.stride.length = 0.5 * length
                continue
            self._take(new)
            before = here.point, float(np.linalg.norm(new.point.z - here.point.z))
            if self.done or self._in_family():
                break
            recut = self._recut(self.stations[-1])
            if recut is not None:
                self.stations[-1], before = recut, None
        return self

    def _onward(self, here: Station, before: tuple[Point, float] | None) -> Station | None:
        """The next station; where single steps in the unknowns fail, with the largest sizes as further coordinates."""
        for self.steep in (False, True):
            if self.steep:
                self.stride.length = STEEP_START
            try:
                moved = advance(here.shooting, here.point, before, self.stride,
                                heights_of(here.shooting) if self.steep else None)
                if moved is not None:
                    return station_at(here.shooting, moved[0])
            except FAILURES:
                continue
        return None

    def _where(self, station: Station) -> str:
        """The parameter of a station in words."""
        return f"{self.course.name} = {station.value:.9g}"

    def _take(self, new: Station) -> None:
        """Append a station, with the bifurcations on the way to it; look whether the branch has closed."""
        here = self.stations[-1]
        found = between(here, new, self.steep) if self.course.detect else []
        shorter = self._collapse(here, new) if here.point.sign != new.point.sign else None
        if shorter is not None:
            found = [f for f in found if f.kind not in ("branch_point", "fold")]
            new, self.done = shorter, True
            self.sentence = f"ended in a period doubling of motions of a shorter period at {self._where(new)}"
        self.bifurcations += found
        if self.course.tick is not None:
            self.course.tick(new)
        if len(self.stations) > 3 and not self.done and self._returned(here, new):
            self.closed = self.done = True
            self.sentence = f"closed: back at its first point, {self._where(self.stations[0])}"
            new = self.stations[0]
        self.stations.append(new)

    def _collapse(self, here: Station, new: Station) -> Station | None:
        """The station between two at which the orbit is one of a shorter period; None where there is none."""
        shooting = here.shooting
        of, period = shooting.map, shooting.period
        for shorter in range(of.forcing_period, period, of.forcing_period):
            if period % shorter:
                continue

            def apart(station: Station, cycles: int = shorter) -> Floats:
                x = station.orbit.section
                out: Floats = (of.evaluate(x, station.orbit.values, 0, cycles).value - x) / of.scales
                return out

            one, two = apart(here), apart(new)
            if float(one @ two) < -0.8 * float(np.linalg.norm(one) * np.linalg.norm(two)):
                return Chord(here, new).root(partial(_along, one, apart)) or here
        return None

    def _edge(self, here: Station) -> Station | None:
        """The station at the end of the range where the next step would pass it; the step is shortened until one is
        found.
        """
        size, stride, point = here.shooting.size, self.stride, here.point
        slope = here.slope
        while stride.length > stride.smallest:
            step = stride.length * slope
            bound = 1.0 if slope > 0.0 else 0.0
            room = bound - float(point.z[size])
            if abs(step) <= abs(room):
                return None
            if room == 0.0 and len(self.stations) == 1:
                return here
            row = np.zeros(len(point.z))
            row[size] = 1.0
            guess = point.z + room / slope * point.tangent
            guess[size] = bound
            found = correct(here.shooting, guess, row)
            if found is not None and found.distance <= 0.3 * stride.length:
                tangent = found.tangent if float(found.tangent @ point.tangent) > 0.0 else -found.tangent
                new = point_at(found.z, found.found, tangent)
                if float(tangent @ point.tangent) > stride.turn and new.sign == point.sign:
                    return station_at(here.shooting, new)
            stride.length *= 0.5
        return None

    def _returned(self, here: Station, new: Station) -> bool:
        """Whether the step from `here` to `new` passes the first point (or the same orbit some cycles later)."""
        if new.shooting.segments != self.stations[0].shooting.segments and len(new.shooting.segments) > 1:
            return False
        n, size = new.shooting.map.dimension, new.shooting.size
        for z, tangent in self._ends:
            p, q = (np.concatenate([s.point.z[:n], s.point.z[size:]]) for s in (here, new))
            ahead, behind = float(tangent @ (q - z)), float(tangent @ (p - z))
            if behind < 0.0 <= ahead:
                step = q - p
                part = -behind / (ahead - behind)
                if np.linalg.norm(p + part * step - z) <= 0.2 * np.linalg.norm(step) and float(step @ tangent) > 0.0:
                    middle = Chord(here, new).at(part)
                    if middle is not None:
                        at = np.concatenate([middle.point.z[:n], middle.point.z[size:]])
                        if np.linalg.norm(at - z) <= max(0.02 * float(np.linalg.norm(step)), SAME):
                            return True
        return False

    def _in_family(self) -> bool:
        """Whether the last two points belong to motions with a multiplier of exactly 1 at one parameter."""
        last = self.stations[-2:]
        if len(last) < 2 or any(np.abs(s.orbit.multipliers - 1.0).min() > 1e-7 or abs(s.slope) > 1e-7 for s in last):
            return False
        self.sentence = (f"met a family of motions with a multiplier of exactly 1 at {self._where(last[-1])}: no branch can "
                         "be followed through it")
        return True

    def _recut(self, station: Station) -> Station | None:
        """The station in more segments where the growth over its segments is large; None where it need not be."""
        shooting = station.shooting
        if len(shooting.segments) > 1 or shooting.period == 1:
            return None
        if float(np.abs(station.point.found.monodromy).max()) < GROWTH:
            return None
        finer, z = shooting.recut(station.point.z)
        found = finer.linearise(z)
        along = np.zeros(len(z))
        n = shooting.map.dimension
        along[:n], along[-1] = station.point.tangent[:n], station.point.tangent[-1]
        return station_at(finer, point_at(z, found, tangent_of(found, along)))

    def _turn_at_border(self, here: Station) -> bool:
        """Go on beyond a change of the event sequence at which the branch has a corner; whether that was possible."""
        shooting = here.shooting
        if not shooting.map.piecewise:
            return False
        for beside in BESIDE:
            try:
                found = shooting.linearise(here.point.z + beside * here.point.tangent)
                tangent = null_direction(found)
                sides = [self._events_at(shooting, here.point.z + s * beside * tangent) for s in (1.0, -1.0)]
            except FAILURES:
                continue
            changed = [differ(e, here.orbit.seen.events) for e in sides]
            if changed[0] == changed[1]:
                continue
            tangent = tangent if changed[0] else -tangent
            stride = Stride(length=beside, smallest=1e-10)
            start = point_at(here.point.z, found, tangent)
            try:
                moved = advance(shooting, start, None, stride)
                if moved is None:
                    continue
                new = station_at(shooting, moved[0])
            except FAILURES:
                continue
            if differ(new.orbit.seen.events, here.orbit.seen.events):
                self.stride.length = stride.length
                self._take(new)
                return True
        return False

    @staticmethod
    def _events_at(shooting: Shooting, z: Floats) -> str:
        """The event sequence of one period from a point near an orbit."""
        return shooting.map.observe(shooting.nodes(z)[0], shooting.values(z), 0, shooting.period).events


def _along(direction: Floats, measure: Callable[[Station], Floats], station: Station) -> float:
    """A measure of a station along a direction."""
    return float(direction @ measure(station))


def between(a: Station, b: Station, steep: bool = False) -> list[Bifurcation]:
    """The bifurcations between two neighbouring stations, in order."""
    if a.shooting is not b.shooting and a.shooting != b.shooting:
        return []
    chord = Chord(a, b, heights_of(a.shooting) if steep else None)
    if not (a.shooting.map.piecewise and differ(a.orbit.seen.events, b.orbit.seen.events)):
        return smooth_bifurcations(chord)
    out: list[Bifurcation] = []
    for _ in range(6):
        left, right, found = event_border(chord)
        out += smooth_bifurcations(Chord(chord.a, left))
        if found is not None:
            out.append(found)
        chord = Chord(right, b)
        if not differ(right.orbit.seen.events, b.orbit.seen.events):
            break
    return out + smooth_bifurcations(chord)


def returning(first: Station) -> list[tuple[Floats, Floats]]:
    """Point and tangent, both of single shooting, at which a closed branch comes back, for every shift of its orbit."""
    of, size = first.shooting.map, first.shooting.size
    n, scales = of.dimension, of.scales
    z, t = first.point.z, first.point.tangent
    x, values = first.shooting.nodes(z)[0], first.shooting.values(z)
    out = [(np.concatenate([z[:n], z[size:]]), np.concatenate([t[:n], t[size:]]))]
    width = np.array([w.width(float(u)) for w, u in zip(first.shooting.windows, z[size:])])
    for k, point in enumerate(shifts(of, x, values, first.shooting.period)[1:], 1):
        image = of.evaluate(x, values, 0, k * of.forcing_period)
        along = (image.jacobian @ (t[:n] * scales) + image.by_parameter @ (width * t[size:])) / scales
        tangent = np.concatenate([along, t[size:]])
        out.append((np.concatenate([point / scales, z[size:]]), tangent / float(np.linalg.norm(tangent))))
    return out


def heights_of(shooting: Shooting) -> Heights:
    """The largest sizes per cycle as coordinates, with gradients by differences (they only tilt the corrector's plane).
    """
    scale, period, size = shooting.map.height_scale, shooting.period, shooting.size
    n = shooting.map.dimension

    def heights(z: Floats) -> tuple[Floats, Floats]:
        def largest(at: Floats) -> Floats:
            return np.array(shooting.map.observe(shooting.nodes(at)[0], shooting.values(at), 0, period).heights) / scale

        base = largest(z)
        gradient = np.zeros((len(base), len(z)))
        for k in [*range(n), *range(size, len(z))]:
            step = np.zeros(len(z))
            step[k] = HEIGHT_STEP if not (k == size and z[k] > 0.5) else -HEIGHT_STEP
            gradient[:, k] = (largest(z + step) - base) / step[k]
        return base, gradient

    return heights


def follow(first: Station, course: Course, origin: Any, number: int, *, both: bool = True, began: str = "",
           keep: list[Branch] | None = None) -> Branch:
    """The branch through `first`, both ways, or only along its tangent.

    began : the sentence for the end it starts at, where only one way is followed
    keep : takes the branch, what there is of it after Ctrl-C too
    """
    branch = Branch(first.orbit.period, origin, [first], (began, ""))
    walks: list[Walk] = []
    try:
        for sign in (1.0, -1.0) if both else (1.0,):
            point = first.point
            turned = point if sign > 0.0 else point._replace(tangent=-point.tangent, sign=-point.sign)
            walks.append(Walk(course, [replace(first, point=turned)]))
            if walks[-1].run().closed:
                break
    finally:
        forward = walks[0]
        backward = walks[1] if len(walks) > 1 else None
        branch.stations = ([] if backward is None else [_turned(s) for s in backward.stations[:0:-1]]) + forward.stations
        branch.bifurcations = [with_branch(f, number) for w in (backward, forward) if w is not None
                               for f in (w.bifurcations[::-1] if w is backward else w.bifurcations)]
        branch.closed = forward.closed
        ahead = forward.sentence
        if keep is not None:
            keep.append(branch)
        branch.ended = (ahead if forward.closed else backward.sentence if backward is not None else began or ahead, ahead)
    return branch


def _turned(station: Station) -> Station:
    """The station with its tangent the other way round."""
    point = station.point
    return replace(station, point=point._replace(tangent=-point.tangent, sign=-point.sign))


def first_station(shooting: Shooting, z: Floats) -> Station:
    """The station of a solution that no walk has led to; its tangent points to growing parameters."""
    found = shooting.linearise(z)
    tangent = null_direction(found)
    if tangent[shooting.size] < 0.0:
        tangent = -tangent
    return station_at(shooting, point_at(z, found, tangent))


__all__ = ["Branch", "Course", "Orbit", "Walk", "between", "first_station", "follow", "returning"]
