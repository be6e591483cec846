"""Pseudo-arclength continuation of any curve of solutions, with one equation fewer than unknowns, and its brackets.

H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, 1977. Each step is Newton's method in
the plane at right angles to the tangent, from a polynomial predictor. The largest sizes of the motion (amplitudes) are
coordinates of the arclength beside the unknowns: they measure steps where a motion grows while its section hardly
moves. T. R. Chandrupatla's bracketing method (Adv. Eng. Softw. 28, 1997) finds roots of test functions between two
points of a curve to rounding, with a corrector in every evaluation.

A `Continuation` is the state of a curve that is being followed, and its iterator: it predicts, corrects and adapts the
step. Functions in `Rules` say what belongs to one kind of curve: branches of periodic orbits along a parameter, or
curves of their bifurcations in two. After the iterator of BifurcationKit.jl.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.result import KEY_UNITS, Described
from tcc_sim.shown_units import key_unit
from tcc_sim.study.continuation.orbits import FAILURES, SAME, Floats, Linearised, ParameterRange, Settings, Values

CORRECT_ITERATIONS = 8  # most steps
CORRECT_STEP = 10.0  # step above which the corrector fails
SQUARED = 1e-5  # step below which the error is its square, so that the residual before it decides too
SLOWEST = 0.7  # share of the last step above which the corrector fails: a shorter predictor costs less


class Equations(Protocol):
    """d equations in d + 1 scaled unknowns; below a residual of `rounding` no Newton step helps."""

    rounding: ClassVar[float]

    @property
    def settings(self) -> Settings:
        """Tolerances of the corrector."""

    @property
    def ranges(self) -> tuple[ParameterRange, ...]:
        """The free parameters."""

    @property
    def size(self) -> int:
        """Number of unknowns before the parameters."""

    def outer(self, vector: Floats) -> Floats:
        """The unknowns that do not depend on the segments: the first node, and those that are no nodes."""

    def linearise(self, z: Floats) -> Linearised:
        """Residual and Jacobian."""


class Corrected(NamedTuple):
    """Result of the corrector.

    z, linearised, tangent : a solution, the last linearisation and the tangent's direction
    distance : from the guess, with the amplitudes where they are coordinates
    slopes : change of the amplitudes along the tangent
    contraction : Newton's second step over the first one
    """

    z: Floats
    linearised: Linearised
    tangent: Floats
    distance: float
    slopes: Floats
    contraction: float


FLAT = (np.empty(0), np.empty(0))
"""No amplitudes as coordinates of the arclength."""


def corrector(equations: Equations, guess: Floats, row: Floats, plane: tuple[Floats, Floats] = FLAT,
              start: Floats | None = None, farthest: float = math.inf) -> Corrected | None:
    """Newton to the solution with row . (z - guess) + weights . (amplitudes - those at the guess) = 0, from `start`.

    It starts at the guess by default. None where it does not converge or a step is longer than `farthest`.

    plane : weights (N,) of the amplitudes, and their values (N,) at the guess
    """
    weights, known = plane
    z, last, away = guess.copy() if start is None else start.copy(), np.inf, 0.0
    contraction, settings = 0.0, equations.settings
    size, by_amplitude = len(guess), len(weights) > 0
    matrix, sides = np.empty((size, size)), np.zeros((size, 2))
    sides[-1, 1] = 1.0
    for _ in range(CORRECT_ITERATIONS):
        try:
            linearised = equations.linearise(z)
            matrix[:-1], matrix[-1] = linearised.jacobian, row
            sides[:-1, 0], sides[-1, 0] = -linearised.residual, -float(row @ (z - guess))
            if by_amplitude:
                if len(linearised.amplitudes) != len(known):
                    return None
                matrix[-1] += weights @ linearised.amplitude_gradient
                apart = linearised.amplitudes - known
                sides[-1, 0] -= float(weights @ apart)
                away = math.sqrt(apart @ apart)
            solved: Any = np.linalg.solve(matrix, sides)
        except FAILURES:
            return None
        step = solved[:, 0]
        length, left = (float(np.maximum.reduce(np.abs(x))) for x in (step, linearised.residual))
        if not length < min(farthest, CORRECT_STEP):
            return None
        z = z + step
        if (length <= settings.correct_tolerance and left <= settings.residual) or (
                length <= SQUARED and left <= equations.rounding):
            tangent: Floats = np.ascontiguousarray(solved[:, 1])
            tangent = tangent / math.sqrt(tangent @ tangent)
            slopes = linearised.amplitude_gradient @ tangent if by_amplitude else weights
            way = z - guess
            return Corrected(z, linearised, tangent, float(np.hypot(math.sqrt(way @ way), away)), slopes, contraction)
        if length > (SLOWEST if length > SQUARED else 1.0) * last:
            return None
        contraction = contraction or (length / last if last < np.inf else 0.0)
        last = length
    return None


def tangent_of(linearised: Linearised, along: Floats) -> Floats:
    """The unit tangent of the curve that points along `along`."""
    side = np.zeros(len(along))
    side[-1] = 1.0
    t = np.linalg.solve(np.vstack([linearised.jacobian, along]), side)
    return np.asarray(t / float(np.linalg.norm(t)))


def null_direction(linearised: Linearised) -> Floats:
    """A unit vector that the Jacobian maps to zero."""
    return np.asarray(np.linalg.svd(linearised.jacobian)[2][-1])


def cosine_between(here: CurvePoint[Any], new: CurvePoint[Any], by_amplitude: bool) -> float:
    """Cosine between the chord from one point to the next and the tangent there."""
    # Along a curve that bends little the chord lies between both tangents; else the corrector has left the curve.
    way, along = new.z - here.z, new.tangent
    if by_amplitude:
        way = np.concatenate([way, new.linearised.amplitudes - here.linearised.amplitudes])
        along = np.concatenate([along, new.linearised.amplitude_gradient @ new.tangent])
    return float(way @ along) / max(float(np.sqrt((way @ way) * (along @ along))), 1e-300)


def predictor_nodes(here: CurvePoint[Any], before: Sequence[CurvePoint[Any]],
                    slopes: Floats) -> list[tuple[float, Floats]]:
    """Nodes of the predictor: the distance of each along the tangent, and its unknowns and amplitudes less those here.

    The first two are `here` itself; the second one holds the tangent.
    """
    size, used = len(here.z), len(slopes)
    nodes = [(0.0, np.zeros(size + used)), (0.0, np.concatenate([here.tangent, slopes]) / (1.0 + slopes @ slopes))]
    for point in before[:-NODES - 1:-1]:
        if len(point.z) != size or (used and len(point.linearised.amplitudes) != used):
            break
        away = np.concatenate([point.z - here.z, point.linearised.amplitudes[:used]
                               - here.linearised.amplitudes[:used]])
        at = float(here.tangent @ away[:size] + slopes @ away[size:])
        if not at < nodes[-1][0]:
            break
        nodes.append((at, away))
    return nodes


def predictor(nodes: list[tuple[float, Floats]], at: float) -> Floats:
    """The polynomial through nodes at a distance, by divided differences; a second node at one place is its slope."""
    places, column = [place for place, _ in nodes], [value for _, value in nodes]
    slope = column[1] if places[0] == places[1] else None
    if slope is not None:
        column[1] = column[0]
    out, product = column[0], 1.0
    for order in range(1, len(nodes)):
        column = [slope if slope is not None and order == 1 and k == 0 else
                  (column[k + 1] - column[k]) / (places[k + order] - places[k]) for k in range(len(nodes) - order)]
        product *= at - places[order - 1]
        out = out + product * column[0]
    return out


ROOT = 1e-13  # width of a bracket, relative to the step, of a root
ENOUGH = 1e-11  # residual of a root, however wide the bracket is
NOISE = 1e-6  # part of the larger end value below which a test may be rounding
IDLE = 2  # evaluations in a row that may then fail to halve the least one: a narrower bracket is noise
FORWARD = 0.1  # least cosine between tangent and chord of a cubic through the ends of a bracket
OPPOSITE = 0.8  # cosine, but for its sign, above which the halves of two orbits are opposite


E = TypeVar("E", bound=Equations)
"""Kind of equations."""


@dataclass(frozen=True, repr=False)
class CurvePoint(Described, Generic[E]):
    """A point of a curve: its equations, unknowns (d + 1,), their linearisation there, and the unit tangent."""

    equations: E
    z: Floats
    linearised: Linearised
    tangent: Floats

    @classmethod
    def at(cls: type[P], equations: Any, z: Floats) -> P:
        """The point at a solution, with one of its two tangents."""
        linearised = equations.linearise(z)
        return cls(equations, z, linearised, null_direction(linearised))

    @cached_property
    def sign(self) -> float:
        """The sign of det [Jacobian; tangent]."""
        return float(np.sign(np.linalg.det(np.vstack([self.linearised.jacobian, self.tangent]))))

    def free(self, vector: Floats) -> Floats:
        """The part (P,) of a vector of unknowns that belongs to the free parameters."""
        return vector[self.equations.size:self.equations.size + len(self.equations.ranges)]

    @property
    def values(self) -> Values:
        """The free parameters."""
        return tuple(w.value(u) for w, u in zip(self.equations.ranges, self.free(self.z).tolist()))

    @property
    def value(self) -> float:
        """The first free parameter."""
        return self.values[0]

    @property
    def events(self) -> str:
        """Event sequence of the motion."""
        return self.linearised.seen.events

    def moved(self: P, to: Corrected, way: Floats) -> P:
        """The point at another solution of the same equations, with the tangent that points along `way`."""
        return replace(self, z=to.z, linearised=to.linearised,
                       tangent=to.tangent if float(to.tangent @ way) > 0.0 else -to.tangent)

    def turned(self: P) -> P:
        """The point with its tangent reversed."""
        return replace(self, tangent=-self.tangent)

    def oriented(self: P, sign: float) -> P:
        """The point with the tangent for which det [Jacobian; tangent] has this sign.

        Where the event sequence changes, the Jacobians of a continuous map on both sides differ by c n^T, with n normal
        to the border, so det [Jacobian; n] is the same: a branch with tangents of one orientation crosses the border,
        whichever way its parameter goes there. M. di Bernardo, C. J. Budd, A. R. Champneys, P. Kowalczyk,
        Piecewise-smooth Dynamical Systems, Springer 2008, Section 3.1.
        """
        return self if self.sign == sign else self.turned()


P = TypeVar("P", bound=CurvePoint[Any])
"""Kind of point of a curve."""


@dataclass(frozen=True)
class Bracket(Generic[P]):
    """The piece of a curve between two points of the same equations."""

    a: P
    b: P
    by_amplitude: bool = True
    """Whether the amplitudes are coordinates of the arclength, as they were on the step from a to b."""

    kept: dict[float, P] = field(default_factory=dict, compare=False, repr=False)
    """Solved points, by their part of the chord."""

    def at(self, part: float) -> P | None:
        """The point at `part` (0 to 1) of the chord; None where the corrector fails."""
        p, q = self.a, self.b
        chord = q.z - p.z
        length = float(np.linalg.norm(chord))
        if part in (0.0, 1.0) or length == 0.0:
            return q if part == 1.0 else p
        if part in self.kept:
            return self.kept[part]
        start, plane, low, high = None, FLAT, p.linearised.amplitudes, q.linearised.amplitudes
        if self.by_amplitude and len(low) and len(low) == len(high):
            guess, plane = p.z + part * chord, ((high - low) / length, low + part * (high - low))
            start = self._start(part, chord / length, plane[0])
        else:
            guess = _hermite(p.z, q.z, p.tangent * length, q.tangent * length, part)
        corrected = corrector(p.equations, guess, chord / length, plane, start=start)
        if corrected is None:
            return None
        self.kept[part] = p.moved(corrected, p.tangent + q.tangent)
        return self.kept[part]

    def _start(self, part: float, row: Floats, weights: Floats) -> Floats | None:
        """The cubic through the known points about `part`, with tangents; None where a tangent points backwards."""
        known = {0.0: self.a, 1.0: self.b, **self.kept}
        low, high = max(k for k in known if k < part), min(k for k in known if k > part)
        length = float(np.linalg.norm(self.b.z - self.a.z))
        whole, slopes = length * (1.0 + float(weights @ weights)), []
        for point in (known[low], known[high]):
            tangent = point.tangent
            along = float(row @ tangent + weights @ (point.linearised.amplitude_gradient @ tangent))
            if not along > FORWARD * float(np.sqrt(1.0 + weights @ weights)):
                return None
            slopes.append(tangent * (whole / along * (high - low)))
        return _hermite(known[low].z, known[high].z, slopes[0], slopes[1],
                        (part - low) / (high - low))

    def locate(self, test: Callable[[P], float], residual: Callable[[P], float] | None = None) -> P | None:
        """The point where `test` changes sign; None where it does not, or where the corrector fails.

        residual : of the bifurcation; the search ends where it is small enough
        """
        def value(part: float) -> float:
            point = self.at(part)
            if point is None:
                raise NumericalFailure("the branch is lost between two of its points")
            return 0.0 if residual is not None and residual(point) <= ENOUGH else test(point)

        try:
            return self.at(chandrupatla(value, 0.0, 1.0))
        except SameSign:
            return None
        except NumericalFailure:
            return replace(self, by_amplitude=False, kept={}).locate(test, residual) if self.by_amplitude else None


def _hermite(p: Floats, q: Floats, dp: Floats, dq: Floats, t: float) -> Floats:
    """The cubic through p and q with derivatives dp and dq, at t from 0 to 1."""
    s = 1.0 - t
    return s * s * (1.0 + 2.0 * t) * p + t * s * s * dp + t * t * (3.0 - 2.0 * t) * q - t * t * s * dq


class SameSign(ArithmeticError):
    """A function has the same sign at both ends of a bracket."""


def chandrupatla(f: Callable[[float], float], a: float, b: float, tolerance: float = ROOT) -> float:
    """A root of `f` between `a` and `b`, where its signs differ: the argument at which it was least.

    The search ends where the bracket is as narrow as `tolerance`, or where `f` is only rounding.

    Raises SameSign: the signs do not differ.
    """
    fa, fb = f(a), f(b)
    if fa == 0.0 or fb == 0.0:
        return a if fa == 0.0 else b
    if (fa > 0.0) == (fb > 0.0):
        raise SameSign("no change of sign")
    c, fc, part = a, fa, 0.5
    noise, idle = NOISE * max(abs(fa), abs(fb)), 0
    best, least = (a, abs(fa)) if abs(fa) < abs(fb) else (b, abs(fb))
    for _ in range(100):
        t = a + part * (b - a)
        ft = f(t)
        idle = 0 if abs(ft) < 0.5 * least or least > noise else idle + 1
        if abs(ft) < least:
            best, least = t, abs(ft)
        if (ft > 0.0) == (fa > 0.0):
            c, fc = a, fa
        else:
            c, b, fc, fb = b, a, fb, fa
        a, fa = t, ft
        width = tolerance / max(abs(b - c), 1e-300)
        if fa == 0.0 or width > 0.5 or abs(b - a) <= tolerance or idle >= IDLE:
            return best
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        if phi**2 < xi and (1.0 - phi) ** 2 < 1.0 - xi:
            part = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        else:
            part = 0.5
        part = min(max(part, width), 1.0 - width)
    return best


def turned_round(one: Floats, two: Floats) -> bool:
    """Whether two vectors are opposite: the cosine between them is below -OPPOSITE."""
    return float(one @ two) < -OPPOSITE * float(np.linalg.norm(one) * np.linalg.norm(two))


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


def own_start(track: Continuation[P, S]) -> list[tuple[Floats, Floats]]:
    """Return unknowns and tangent of the first point."""
    return [(track.here.equations.outer(track.here.z), track.here.equations.outer(track.here.tangent))]


def back_at_start(track: Continuation[P, S], new: P, special: list[S],
                  stop: End | None) -> tuple[P, list[S], End | None]:
    """Return the end of a curve at its first point, if the step to `new` passes it; else the arguments."""
    if track.passes_start(new):
        return track.points[0], special, stop or track.end(StopReason.CLOSED, track.points[0])
    return new, special, stop


def give_up(track: Continuation[P, S]) -> None:
    """End a curve where no step succeeds."""
    track.stop = track.end(StopReason.STEP, limit=track.settings.residual)


@dataclass(frozen=True)
class Rules(Generic[P, S]):
    """Functions of a continuation for one kind of curve.

    starts : unknowns and tangents with which the curve may pass its first point again
    unresolved : the end where double precision does not resolve a new point
    special : special points up to a new point; None where the step has skipped a piece of the curve
    ended : the last point, its special points and the end where the curve ends before a new point; else the arguments
    went_on : update for a new last point, or end the curve there
    lost : change the track where no step succeeds, or end the curve
    beyond_corner : the next point beyond a corner of the curve at the last point; None where there is no corner
    """

    starts: Callable[[Continuation[P, S]], list[tuple[Floats, Floats]]] = own_start
    unresolved: Callable[[Continuation[P, S], P], End | None] = lambda track, new: None
    special: Callable[[Continuation[P, S], P], list[S] | None] = lambda track, new: []
    ended: Callable[[Continuation[P, S], P, list[S], End | None], tuple[P, list[S], End | None]] = back_at_start
    went_on: Callable[[Continuation[P, S]], None] = lambda track: None
    lost: Callable[[Continuation[P, S]], None] = give_up
    beyond_corner: Callable[[Continuation[P, S]], P | None] = lambda track: None


class Continuation(Generic[P, S]):
    """One direction of a curve; lengths are in natural sizes.

    rules : what belongs to its kind
    special : special points so far, each with the number of the point before it
    stop : why the curve ended; None until then
    before : points behind the last point, from which the next one is predicted
    length : of the next step
    longest : longest next step, after one that has left the range or skipped a piece of the curve
    by_amplitude : whether the amplitudes were coordinates of the arclength on the last step
    cut : number of points, and growth over a segment, at which failed steps last cut the orbit anew
    tests : points and values of each test function since the last change of its sign
    """

    def __init__(self, first: P, rules: Rules[P, S] | None = None) -> None:
        self.rules: Rules[P, S] = rules or Rules()
        self.points = [first]
        self.special: list[tuple[int, S]] = []
        self.stop: End | None = None
        self.settings: Settings = first.equations.settings
        self.before: list[P] = []
        self.length, self.longest, self.tried, self.by_amplitude = self.settings.first_step, math.inf, 0, True
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
        return End(reason, at.equations.ranges[number].name, at.values[number], limit, what.replace("_", " "))

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
                self.rules.lost(self)
                continue
            inside = corner or edge is not None or all(0.0 <= scaled <= 1.0 for scaled in new.free(new.z))
            self.stop = self.rules.unresolved(self, new) if inside and not corner else None
            if self.stop is not None:
                return
            special_points = self.rules.special(self, new) if inside else None
            if special_points is None and not corner:
                self.longest = 0.5 * min(float(np.linalg.norm(new.z - here.z)), self.longest)
                continue
            self.longest = math.inf
            stop = None if edge is None else self.end(StopReason.RANGE, edge, number=bound)
            new, special, stop = self.rules.ended(self, new, special_points or [], stop)
            self.note(special)
            self.points.append(new)
            self.stop = stop
            if corner:
                self.before = []
            elif stop is None:
                self.before = [*self.before[1 - NODES:], here]
                self.rules.went_on(self)
            yield self.here

    def onward(self) -> P | None:
        """The next point; by the unknowns alone where steps with the amplitudes as coordinates fail."""
        for by_amplitude in (True, False) if len(self.here.linearised.amplitudes) else (True,):
            if not by_amplitude:
                self.length = min(FLAT_STEP, self.longest)
            try:
                new = self.step(by_amplitude)
                if new is not None:
                    return new
            except FAILURES:
                continue
        return None

    def step(self, by_amplitude: bool = True) -> P | None:
        """The next point along the curve; None where no step is short enough.

        A step is halved where the corrector goes far from the predictor, where the tangent turns by more than a set
        angle, or where the determinant of Jacobian and tangent changes sign, because the curve has met another one.

        by_amplitude : whether the amplitudes are coordinates of the arclength, where there are any
        """
        here, equations, settings = self.here, self.here.equations, self.settings
        self.by_amplitude = by_amplitude
        used = by_amplitude and len(here.linearised.amplitudes) > 0
        slopes = here.linearised.amplitude_gradient @ here.tangent if used else FLAT[0]
        reach = float(np.sqrt(1.0 + slopes @ slopes))
        known, most = predictor_nodes(here, self.before, slopes), LONGER
        while self.length >= settings.smallest_step:
            ahead = predictor(known, self.length * reach)
            guess = here.z + ahead[:len(here.z)]
            amplitudes = here.linearised.amplitudes[:len(slopes)] + ahead[len(here.z):]
            self.tried += 1
            corrected = corrector(equations, guess, here.tangent, (slopes, amplitudes), farthest=FARTHEST * self.length)
            if corrected is not None:
                along = float(corrected.tangent @ here.tangent + corrected.slopes @ slopes)
                new = here.moved(corrected, corrected.tangent if along > 0.0 else -corrected.tangent)
                if here.events != new.events:
                    new = new.oriented(here.sign)
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

    def astray_beyond(self, new: P) -> bool:
        """Whether a step over a change of the event sequence has not reached a solution."""
        # The curve may have a corner there, and Newton's method a cycle of two points, one on either side of it: the
        # last step from a small residual on one side leads back to a large one on the other.
        if self.here.events == new.events:
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
        here, settings = self.here, self.settings
        for number in reversed(range(len(here.equations.ranges))):
            k = here.equations.size + number
            slope = float(here.tangent[k])
            bound = 1.0 if slope > 0.0 else 0.0
            room = bound - float(here.z[k])
            while self.length > settings.smallest_step and abs(self.length * slope) > abs(room):
                if room == 0.0 and len(self.points) == 1:
                    return here, number
                row = np.zeros(len(here.z))
                row[k] = 1.0
                nodes, way = predictor_nodes(here, self.before, FLAT[0]), room / slope
                for _ in range(2):
                    way += (room - float(predictor(nodes, way)[k])) / slope
                guess = here.z + predictor(nodes, way)
                guess[k] = bound
                farthest = FARTHEST * self.length
                corrected = corrector(here.equations, guess, row, farthest=farthest)
                if corrected is not None and corrected.distance <= farthest:
                    new = here.moved(corrected, here.tangent)
                    if float(new.tangent @ here.tangent) > TURN and new.sign == here.sign:
                        self.by_amplitude = True
                        return new, number
                self.length *= SHORTER
        return None

    def passes_start(self, new: P) -> bool:
        """Whether the step to `new` passes the first point along its tangent."""
        p, q = (s.equations.outer(s.z) for s in (self.here, new))
        length = float(np.linalg.norm(q - p))
        for z, tangent in self.starts if len(self.points) > 3 else []:
            ahead, behind = float(tangent @ (q - z)), float(tangent @ (p - z))
            part = -behind / max(ahead - behind, 1e-300)
            if not (behind < 0.0 <= ahead and float((q - p) @ tangent) > 0.0) or not (
                    np.linalg.norm(p + part * (q - p) - z) <= PASSING * length):
                continue
            middle = Bracket(self.here, new).at(part)
            if middle is not None and np.linalg.norm(middle.equations.outer(middle.z) - z) <= max(
                    PASSED * length, SAME):
                return True
        return False


def joined(tracks: Sequence[Continuation[P, S]]) -> tuple[list[P], list[tuple[int, S]], tuple[End, End]]:
    """Points, numbered special points and both ends of a curve that was followed one way, or that way and the other."""
    ahead, behind = tracks[0], tracks[-1]
    nodes = [] if behind is ahead else [point.turned() for point in behind.points[:0:-1]]
    before = [] if behind is ahead else [(len(nodes) - 1 - after, item) for after, item in reversed(behind.special)]
    return (nodes + ahead.points, before + [(len(nodes) + after, item) for after, item in ahead.special],
            (behind.ended, ahead.ended))
