"""Periodic orbits of a map from cycle to cycle: the map's protocol, the equations of an orbit, and Newton's method.

A textbook map is one instance of the protocol, a scene of the driveline another (`DrivelineMap`). Changes of the event
sequence of a motion are the bifurcations that only set-valued friction has: grazing-, crossing-, switching- and
adding-sliding (M. di Bernardo, P. Kowalczyk, A. Nordmark, Bifurcations of dynamical systems with sliding, Physica D 170
(2002)). Sequences are compared as rings: an event that passes phase 0 changes nothing.

The equations are those of one or more segments whose ends meet (multiple shooting; U. M. Ascher, R. M. M. Mattheij,
R. D. Russell, Numerical Solution of Boundary Value Problems, SIAM 1995, Section 4.3). Unknowns are scaled: the nodes,
each by the map's natural sizes, then the free parameters, each by the width of its range, so that 0 to 1 is the range.
Lengths, steps and residuals are in natural sizes. Newton's method deflates known orbits (P. E. Farrell, A. Birkisson,
S. W. Funke, Deflation techniques for finding distinct solutions of nonlinear partial differential equations, SIAM J.
Sci. Comput. 37 (2015)).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.result import Described, reported, result_class

REPEATS = 8  # most changes of one kind at once (a symmetric motion has pairs of them)

Floats = NDArray[np.float64]
Values = tuple[float, ...]
"""Values of the free parameters, in the order of the map's keys."""


class Observation(NamedTuple):
    """Observation of a motion over some cycles.

    stick_fraction : 0 to 1
    events : the sequence of modes, such as "S+S"; empty for a map without
    amplitudes : the largest size of the motion in each cycle (for the driveline |slip speed|, rad/s), which can change
        much where the section hardly moves
    """

    stick_fraction: float = 0.0
    events: str = ""
    amplitudes: tuple[float, ...] = ()

    @property
    def largest(self) -> float:
        """The largest size of the motion."""
        return max(self.amplitudes, default=0.0)


class Image(NamedTuple):
    """Image of a state after some cycles, with derivatives.

    value : (n,) state after them
    derivatives : (n, n + P) with respect to the state before them, and to the free parameters
    seen : observation of these cycles
    amplitude_gradient : (N, n + P) derivatives of the N observed amplitudes, likewise; no rows if the map has none
    """

    value: Floats
    derivatives: Floats
    seen: Observation = Observation()
    amplitude_gradient: Floats = np.empty((0, 1))

    @property
    def jacobian(self) -> Floats:
        """(n, n) derivative with respect to the state before."""
        return self.derivatives[:, :len(self.value)]


class Margin(NamedTuple):
    """Distance of a motion from a change of its event sequence, relative to a natural size.

    slopes : (n + P,) derivatives of the value by the state and the free parameters
    grows : whether stick's margin grows where slip ends
    """

    value: float
    slopes: Floats
    grows: bool = False


Margins = Mapping[str, Margin]
"""Margins of a motion that has them, by name.

grazing : smallest |slip speed| at an extremum within slip
arrival : r Ts - |lambda| where slip ends, the one nearest to 0, negative where slip goes on the other way
stick : smallest margin r Ts - |lambda| at a minimum within stick
"""


class ParameterMap(Protocol):
    """A map with free parameters, from the start of cycle `first` over `cycles` cycles.

    dimension : number of states n
    scales : (n,) natural sizes of the states, in which distances are measured
    amplitude_scale : natural size of `Observation.largest` and of the amplitudes
    forcing_period : cycles after which the map repeats (1 where it is the same in every cycle)
    piecewise : whether the event sequence changes the map (set-valued friction)
    divisible : whether `first` and `cycles` of `evaluate` may be parts of cycles

    `evaluate` raises ArithmeticError where the system cannot be solved and ValueError outside its range.
    """

    dimension: int
    scales: Floats
    amplitude_scale: float
    forcing_period: int
    piecewise: bool
    divisible: bool

    def evaluate(self, x: Floats, values: Values, first: float, cycles: float) -> Image:
        """The state after `cycles` cycles from `x` at the start of cycle `first`, with derivatives."""

    def evaluate_each(self, states: Floats, values: Values, firsts: Sequence[float],
                      cycles: Sequence[float]) -> list[Image]:
        """`evaluate` for several states (m, n), each with its start and its length."""

    def margins(self, x: Floats, values: Values, first: float, cycles: float) -> Margins:
        """Distances of these cycles from another event sequence."""


FAILURES = (ArithmeticError, OutOfRange, np.linalg.LinAlgError)
"""Exceptions of a map where it has no value; continuation then takes a smaller step. A refusal is none of them."""


def ring(events: str) -> str:
    """The event sequence of a periodic motion as a ring: first and last mode joined, in the least rotation."""
    if len(events) > 1 and events[0] == events[-1]:
        events = events[:-1]
    return min(events[k:] + events[:k] for k in range(len(events))) if events else events


RULES: dict[str, tuple[tuple[str, str], ...]] = {
    "adding_sliding": (("S+S", "S"), ("S-S", "S")),
    "grazing_sliding": (("+S+", "+"), ("-S-", "-"), ("+-+", "+"), ("-+-", "-")),
    "crossing_sliding": (("+S-", "+-"), ("-S+", "-+")),
    "switching_sliding": (("+-S", "+S"), ("-+S", "-S")),
}
"""By kind, parts of the longer sequence with the parts of the shorter one that replace them."""


def _reduced(longer: str, rules: tuple[tuple[str, str], ...], shorter: str) -> bool:
    """Whether replacing parts of the ring `longer`, once or more, gives the ring `shorter`."""
    texts = {longer}
    for _ in range(REPEATS):
        texts = {new for text in texts for pattern, by in rules for new in _replaced(text, pattern, by)}
        if shorter in texts:
            return True
    return False


def _replaced(text: str, pattern: str, by: str) -> set[str]:
    """The rings in which `by` replaces `pattern` at one of its places on the ring `text`."""
    turns = (text[k:] + text[:k] for k in range(len(text)))
    return {ring(by + turned[len(pattern):]) for turned in turns if (turned + turned[0]).startswith(pattern)}


MARGINS = {"adding_sliding": "stick", "grazing_sliding": "grazing", "crossing_sliding": "arrival",
           "switching_sliding": "arrival", "stick_border": "stick"}
"""By kind, the margin that vanishes."""


def kind_of_change(before: str, after: str, near: Sequence[Margins]) -> str:
    """The kind of bifurcation between two event sequences; of several the one with the least of the margins `near`."""
    longer, shorter = sorted((ring(before), ring(after)), key=len, reverse=True)
    if shorter == "S":
        return "stick_border"
    # Both an interval of slip and one of stick that vanish make S+S of S+S+S.
    kinds = [kind for kind, rules in RULES.items() if _reduced(longer, rules, shorter)]
    kind = min(kinds or list(RULES)[:3], key=lambda kind: margin_residual(kind, near))
    if kinds or kind != "crossing_sliding":
        return kind
    arrival = min((m["arrival"] for m in near if "arrival" in m), key=lambda m: abs(m.value))
    return "switching_sliding" if arrival.grows else kind


def margin_residual(kind: str, near: Sequence[Margins]) -> float:
    """The least size of the margin that vanishes at a bifurcation of this kind, relative to its natural size."""
    return min((abs(m[MARGINS[kind]].value) for m in near if MARGINS[kind] in m), default=math.inf)


def differ(one: str, two: str) -> bool:
    """Whether two event sequences differ as rings."""
    return ring(one) != ring(two)


@dataclass(frozen=True)
class Settings:
    """Bounds and steps of a continuation."""

    growth: float = 1e2  # growth over a segment above which it is cut: the solver's 1e-13 stays below 1e-10
    regrowth: float = 10.0  # growth over a segment, in `growth`, above which the orbit is cut into other segments
    fewer_after: int = 20  # points after which fewer segments are tried
    # Whether growth is also measured about every change between stick and slip: growth in slip that stick removes
    # within the same part is not in the part's derivative, but in how sharply it bends.
    thorough: bool = False
    # Largest residual of an orbit, however short the last step was: where the Jacobian is singular, as in runaway slip,
    # a short step does not make an orbit.
    residual: float = 5e-9
    correct_tolerance: float = 1e-9  # last step of a point
    first_step: float = 0.01
    smallest_step: float = 1e-9
    largest_step: float = 0.1
    max_points: int = 3000  # most points in one direction of a branch
    max_tries: int = 6000  # most steps tried in one direction
    # Modulus of a multiplier above which a branch ends: an orbit known to 1e-12 closes to 1e-2 only, so that neither
    # value nor sign of the multiplier can be trusted. Motions along the falling branch of friction reach it.
    canard: float = 1e10
    max_branches: int = 24  # most branches of a diagram
    longest_period: int = 12  # longest period in it, periods of the excitation


DEFAULTS = Settings()


PARTS = 16  # parts of a cycle, or of a part of it, over which growth is measured
FINEST = 1.0 / PARTS**3  # shortest part of a segment, cycles


@dataclass(frozen=True)
class ParameterRange:
    """The range of one free parameter."""

    low: float
    high: float
    name: str = "parameter"

    def value(self, scaled: float) -> float:
        """The parameter at 0 (low) to 1 (high)."""
        return self.low + scaled * (self.high - self.low)

    def scaled(self, value: float) -> float:
        """0 at low to 1 at high."""
        return (value - self.low) / (self.high - self.low)

    @property
    def width(self) -> float:
        """Change of the parameter per unit of the scaled one."""
        return self.high - self.low


class Linearised(NamedTuple):
    """Equations at a point, in natural sizes.

    residual, jacobian : (d,), (d, d + P)
    blocks : (m, n, n) derivatives of the segments' ends by their starts
    seen : observation over the period
    amplitudes, amplitude_gradient : (N,) the largest sizes of the motion, and (N, d + P) their derivatives
    """

    residual: Floats
    jacobian: Floats
    blocks: Floats = np.empty((0, 0, 0))
    seen: Observation = Observation()
    amplitudes: Floats = np.empty(0)
    amplitude_gradient: Floats = np.empty((0, 0))


Vectors = NDArray[Any]
"""Real or complex, (m, n): one for every segment."""


def cyclic(blocks: Floats, mu: complex) -> Vectors:
    """L(mu) x = (M_1 x_1 - x_2, ..., M_m x_m - mu x_1) of the segments' derivatives M (m, n, n)."""
    m, n = blocks.shape[:2]
    out = np.zeros((m * n, m * n), dtype=np.complex128 if np.imag(mu) else np.float64)
    for k in range(m):
        rows, following = slice(k * n, k * n + n), (k + 1) % m
        out[rows, rows] = blocks[k]
        out[rows, following * n:following * n + n] -= np.eye(n) * (mu if k + 1 == m else 1.0)
    return out


@dataclass(frozen=True)
class Shooting:
    """The equations G = 0 of orbits of `period` cycles in segments, whose lengths `segments` are in cycles."""

    map: ParameterMap
    period: int
    ranges: tuple[ParameterRange, ...]
    segments: tuple[float, ...]
    settings: Settings = DEFAULTS

    rounding: ClassVar[float] = 1e-10

    @staticmethod
    def single(of: ParameterMap, period: int, *ranges: ParameterRange, settings: Settings = DEFAULTS) -> Shooting:
        """One segment over the whole period.

        Raises InputError: a period in which the excitation does not repeat.
        """
        if period < 1 or period % of.forcing_period:
            raise InputError(f"the period is {period} cycles; it must be a multiple of {of.forcing_period}, after "
                             "which the excitation repeats")
        return Shooting(of, period, ranges, (period,), settings)

    @property
    def size(self) -> int:
        """Number of equations, and of unknowns before the parameters."""
        return len(self.segments) * self.map.dimension

    def outer(self, vector: Floats) -> Floats:
        """The unknowns of single shooting: the first node, and those that are no nodes."""
        return np.concatenate([vector[:self.map.dimension], vector[self.size:]])

    def values(self, z: Floats) -> Values:
        """The free parameters of a point."""
        return tuple([w.value(u) for w, u in zip(self.ranges, z[self.size:].tolist())])

    @cached_property
    def sizes(self) -> Floats:
        """(n + P,) sizes of a node and of the parameters."""
        return np.concatenate([self.map.scales, [w.width for w in self.ranges]])

    @cached_property
    def starts(self) -> list[float]:
        """Starts of the segments, in cycles."""
        return [sum(self.segments[:k]) for k in range(len(self.segments))]

    def nodes(self, z: Floats) -> Floats:
        """(m, n) states at the starts of the segments."""
        return np.asarray(z[:self.size].reshape(-1, self.map.dimension) * self.map.scales)

    def unknowns(self, nodes: Floats, values: Values) -> Floats:
        """The scaled unknowns of nodes (m, n) and parameters."""
        return np.concatenate([(nodes / self.map.scales).ravel(), [w.scaled(v) for w, v in zip(self.ranges, values)]])

    def linearise(self, z: Floats) -> Linearised:
        """Residual and derivative at `z`, with the map's exceptions."""
        n, scales, nodes = self.map.dimension, self.map.scales, self.nodes(z)
        images = self.map.evaluate_each(nodes, self.values(z), self.starts, self.segments)
        parts = np.array([image.derivatives for image in images]) * (self.sizes / scales[:, None])
        blocks = parts[..., :n]
        jacobian = np.hstack([cyclic(blocks, 1.0), parts[..., n:].reshape(self.size, -1)])
        ends, following = np.array([image.value for image in images]), np.concatenate([nodes[1:], nodes[:1]])
        residual = ((ends - following) / scales).ravel()
        seen, scale = joined_observation([image.seen for image in images], self.segments), self.map.amplitude_scale
        gradient, row, size = np.zeros((len(seen.amplitudes), self.size + len(self.ranges))), 0, self.size
        for k, image in enumerate(images):
            part = image.amplitude_gradient * (self.sizes / scale)
            columns = gradient[row:row + len(part)]
            columns[:, k * n:k * n + n], columns[:, size:] = part[:, :n], part[:, n:]
            row += len(part)
        return Linearised(residual, jacobian, blocks, seen, np.array(seen.amplitudes[:row]) / scale, gradient[:row])

    def cut(self, z: Floats) -> tuple[Shooting, Floats]:
        """The same orbit in as few segments as bound the growth over each, and its unknowns.

        A map that cannot be divided is cut between cycles.
        """
        values, x = self.values(z), self.nodes(z)
        parts: list[tuple[float, Floats, Floats]] = []
        first = 0.0
        for k, cycles in enumerate(self.segments):
            at, end = x[k], first + cycles
            while first < end:
                length = min(1.0 - first % 1.0, end - first)
                pieces, at = self._pieces(at, values, first, length)
                parts += pieces
                first += length
        lengths, nodes = greedy(parts, self.settings.growth)
        if not self.map.divisible:
            lengths = [round(length) for length in lengths]
        finer = replace(self, segments=tuple(lengths))
        return finer, finer.unknowns(np.array(nodes), values)

    def keeps_segments(self, blocks: Floats, regrowth: float, anew: bool) -> bool:
        """Whether the growth over each segment is bounded and `anew` is false, or there are no other segments."""
        large = float(np.abs(blocks).max()) > regrowth * self.settings.growth
        return not (large or anew) or (not self.map.divisible and len(self.segments) == self.period)

    def _pieces(self, x: Floats, values: Values, first: float,
                length: float) -> tuple[list[tuple[float, Floats, Floats]], Floats]:
        """Length, start and scaled derivative of pieces with bounded growth, and the end of the last one."""
        scales, parts = self.map.scales, PARTS
        whole: Image = self.map.evaluate(x, values, first if self.map.divisible else round(first),
                                         length if self.map.divisible else round(length))
        block = whole.jacobian * scales / scales[:, None]
        if not self.map.divisible or length <= 1.5 * FINEST:
            return [(length, x, block)], whole.value
        steady = not self.settings.thorough or len(whole.seen.events) < 2
        if length <= 1.0 / parts and steady and float(np.abs(block).max()) < self.settings.growth**0.5:
            return [(length, x, block)], whole.value
        out: list[tuple[float, Floats, Floats]] = []
        begin, end, step = first, first + length, 1.0 / parts
        while step >= length:
            step /= parts
        while begin < end:
            following = min((math.floor(begin / step + 1e-9) + 1.0) * step, end)
            pieces, x = self._pieces(x, values, begin, following - begin)
            out += pieces
            begin = following
        return out, x


def greedy(parts: list[tuple[float, Floats, Floats]], growth: float) -> tuple[list[float], list[Floats]]:
    """Lengths and first nodes of the longest segments with bounded growth from any of their pieces to their ends."""
    lengths: list[float] = []
    nodes: list[Floats] = []
    ahead = np.empty((0, *parts[0][2].shape))
    for length, node, block in parts:
        ahead = np.concatenate([block @ ahead, block[None]])
        if not lengths or float(np.abs(ahead).max()) > growth:
            lengths.append(length)
            nodes.append(node)
            ahead = block[None]
        else:
            lengths[-1] += length
    return lengths, nodes


def joined_observation(seen: list[Observation], segments: tuple[float, ...]) -> Observation:
    """The observation over several segments."""
    if len(seen) == 1:
        return seen[0]
    events = "".join(mode for mode, _ in groupby("".join(part.events for part in seen)))
    stick = sum(part.stick_fraction * length for part, length in zip(seen, segments)) / sum(segments)
    return Observation(stick, events, tuple(h for part in seen for h in part.amplitudes))


NEWTON_TOLERANCE = 1e-10  # last step of an orbit
NEWTON_ITERATIONS = 25  # most steps
NEWTON_ROUNDING = 1e-12  # residual below which no further step helps
NEWTON_STEP = 2.0  # longest step; a longer one is scaled to it
# Parts of a step that are tried in order until the residual falls or the event sequence is unchanged.
NEWTON_PARTS = (1.0, 0.5, 0.25, 0.1, 0.03)
SINGULAR = 1e-12  # singular value, relative to the largest one, below which a Jacobian is singular
SAME = 1e-6  # distance below which two orbits are the same
NEUTRAL = 1e-9  # distance from the unit circle that may be rounding: neither stable nor a change of sign


@result_class
class OrbitState:
    """Section, size and multipliers of a periodic orbit."""

    value: float = reported("value of the key", "{over}")
    slip_speed: float = reported("on the section at phase 0", "rad/s")
    plate_angle: float = reported("on the section", "rad")
    plate_speed: float = reported("on the section", "rad/s")
    max_slip_speed: float = reported("largest |slip speed|", "rad/s")
    multipliers: NDArray[np.complex128] = reported("Floquet multipliers, [re, im], largest first")


@result_class
class OrbitFigures(OrbitState, Described):
    """A periodic orbit as `continue --json` has it."""

    stick_fraction: float = reported("time in stick over time")
    stable: bool = reported("whether every multiplier is inside the unit circle")
    events: str = reported("sequence of slip (+, -) and stick (S)")
    residual: float = reported("largest residual of the equations, in natural sizes")


def newton(shooting: Shooting, z: Floats, known: Sequence[Floats] = ()) -> Floats | None:
    """A solution near `z` at its parameters, apart from the `known` ones; None where Newton's method fails.

    `z` and `known` are scaled unknowns; the parameters of `z` stay. Steps are halved until the residual falls.
    """
    z, size, settings = z.copy(), shooting.size, shooting.settings
    try:
        linearised = shooting.linearise(z)
        for _ in range(NEWTON_ITERATIONS):
            step = _newton_step(linearised.jacobian[:, :size], linearised.residual)
            turn = sum(_slope(z[:size] - k[:size], step) for k in known)
            if turn:
                step = step / (1.0 - turn)
            length = float(np.abs(step).max())
            if not np.isfinite(length):
                return None
            left = float(np.abs(linearised.residual).max())
            if left < NEWTON_ROUNDING or (length < NEWTON_TOLERANCE and left <= settings.residual):
                z[:size] += step
                return z if all(np.abs(z[:size] - k[:size]).max() > SAME for k in known) else None
            step *= min(1.0, NEWTON_STEP / length)
            before = _weight(z, known, size) * float(np.linalg.norm(linearised.residual))
            for part in NEWTON_PARTS:
                trial = z.copy()
                trial[:size] += part * step
                try:
                    after = shooting.linearise(trial)
                except FAILURES:
                    continue
                if _weight(trial, known, size) * float(np.linalg.norm(after.residual)) < before:
                    z, linearised = trial, after
                    break
            else:
                return None
    except FAILURES:
        return None
    return None


def _newton_step(jacobian: Floats, residual: Floats) -> Floats:
    """Newton's step; the shortest one where the Jacobian is singular, in a family of motions."""
    try:
        return np.asarray(np.linalg.solve(jacobian, -residual))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(jacobian, -residual, rcond=SINGULAR)[0])


def _weight(z: Floats, known: Sequence[Floats], size: int) -> float:
    """The deflation operator: product of 1 + 1/|z - known|^2."""
    return math.prod(1.0 + 1.0 / max(float(np.sum((z[:size] - k[:size]) ** 2)), 1e-300) for k in known)


def _slope(away: Any, step: Any) -> float:
    """Derivative of the logarithm of 1 + 1/|away|^2 along `step`."""
    square = max(float(away @ away), 1e-300)
    return -2.0 * float(away @ step) / (square * (square + 1.0))


def shifts(of: ParameterMap, x: Floats, values: Values, period: int) -> list[Floats]:
    """The points of a periodic orbit at the starts of all cycles at which the map repeats."""
    points, at = [x], x
    for first in range(0, period - of.forcing_period, of.forcing_period):
        at = of.evaluate(at, values, first, of.forcing_period).value
        points.append(at)
    return points


def minimal_period(of: ParameterMap, x: Floats, values: Values, period: int, same: float = SAME) -> int:
    """The smallest number of cycles after which an orbit of `period` cycles repeats, to `same` natural sizes."""
    points = shifts(of, x, values, period)
    for k in range(1, len(points)):
        if len(points) % k == 0 and np.abs((points[k] - x) / of.scales).max() < same:
            return k * of.forcing_period
    return period


def find_orbit(shooting: Shooting, values: Values, guesses: Iterable[Floats],
               known: Sequence[Floats] = ()) -> Floats | None:
    """The scaled unknowns of an orbit with exactly the period of `shooting` from the first guess that leads to one.

    guesses : states (n,) at phase 0
    known : states (n,) at phase 0 of orbits to avoid; orbits of shorter periods that are found join them
    """
    deflated = [shooting.unknowns(x[None], values) for x in known]
    for guess in guesses:
        start = shooting.unknowns(np.asarray(guess, dtype=np.float64)[None], values)
        for _ in range(4):
            z = newton(shooting, start, deflated)
            if z is None:
                break
            x = shooting.nodes(z)[0]
            if minimal_period(shooting.map, x, values, shooting.period) == shooting.period:
                return z
            deflated.append(shooting.unknowns(x[None], values))
    return None
