"""Curves of bifurcations in two parameters: two keys, or a key and the smoothing on its way to none.

Fold, period doubling, Neimark-Sacker, and the border of pure stick. Special points on them are located and named; what
ends them is one of these, the range, a closed curve, a canard, or another `StopReason`.

What becomes of a bifurcation of the smoothed law is traced in 1/sigma, from the scene's sigma towards 0: that is the
evidence of where it goes, or that it is one of the smoothing, and its extrapolation says how near to that it must be.
The value is the set-valued law's own: a branch of that law through the motion there, on which its own detection finds a
bifurcation of the same kind within the error of the extrapolation; the extrapolated value stands where it finds none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from tcc_sim.continuation.augmented import MinimallyAugmented
from tcc_sim.continuation.branch import branch_through, first_point
from tcc_sim.continuation.detection import End, StopReason
from tcc_sim.continuation.follow_curve import Bounds, follow_curve
from tcc_sim.continuation.palc import Equations, Solution, StepSize, corrector
from tcc_sim.continuation.problem import FAILURES, Floats, ParameterMap
from tcc_sim.continuation.settings import DEFAULTS, Settings
from tcc_sim.continuation.shooting import Linearised, ParameterRange, Shooting
from tcc_sim.continuation.special_points import Bifurcation
from tcc_sim.result import Described, json_of

TRACED = ("fold", "period_doubling", "neimark_sacker")
"""Kinds that have a minimally augmented system."""
KINDS = (*TRACED, "stick_border")
"""What can be followed in two keys."""
Ranges = tuple[ParameterRange, ParameterRange]


@dataclass(frozen=True)
class Special:
    """A point of codimension two: its kind and both parameters."""

    kind: str
    value: float
    second: float


@dataclass(frozen=True, repr=False)
class BifurcationCurve(Described):
    """A curve of one kind of bifurcation: both parameters along it, its special points, and its two ends."""

    kind: str
    values: tuple[float, ...]
    second: tuple[float, ...]
    ended: tuple[End, End]
    special: tuple[Special, ...] = ()

    def as_json(self) -> dict[str, object]:
        """As an entry of `curves`."""
        return {"kind": self.kind, "value": list(self.values), "second": list(self.second),
                "ended": [str(end) for end in self.ended], "special": json_of(self.special)}


class Border:
    """One equation in two parameters: a margin that vanishes."""

    rounding: ClassVar[float] = 1e-12
    settings: ClassVar[Settings] = DEFAULTS

    def __init__(self, margin: Callable[[float, float], float], ranges: Ranges) -> None:
        self.margin, self.ranges = margin, ranges

    def linearise(self, z: Floats) -> Linearised:
        """The margin and its derivatives by central differences, by one-sided ones where the keys' own ranges end."""
        def at(p: Floats) -> float:
            return self.margin(self.ranges[0].value(float(p[0])), self.ranges[1].value(float(p[1])))

        gradient, step = np.empty((1, 2)), self.settings.margin_step
        for k, away in enumerate(step * np.eye(2)):
            try:
                gradient[0, k] = (at(z + away) - at(z - away)) / (2.0 * step)
            except FAILURES:
                side = -1.0 if z[k] > 0.5 else 1.0
                gradient[0, k] = side * (at(z + side * away) - at(z)) / step
        return Linearised(np.array([at(z)]), gradient)


def bifurcation_curve(found: Bifurcation, of: ParameterMap, ranges: Ranges, second: float,
                      settings: Settings | None = None) -> BifurcationCurve | None:
    """The curve of a located bifurcation in two parameters, both ways; None where it cannot be set up.

    of : the map with both parameters free
    second : present value of the second one
    """
    orbit, shooting = found.point.orbit, found.point.shooting
    shooting = replace(shooting, map=of, ranges=ranges, settings=settings or shooting.settings)
    try:
        shooting, z = shooting.cut(shooting.unknowns(orbit.nodes, (orbit.values[0], second)))
        n = shooting.size
        ways = []
        for forward in (True, False):
            equations = MinimallyAugmented(found.kind, shooting, z)
            ways.append(_collected(equations, equations.start, forward, ((n + 1, 0.0, 1.0), (n, 0.0, 1.0)), ranges))
            if ways[-1].end.reason is StopReason.CLOSED:
                ways = ways[-1:]
                break
    except FAILURES:
        return None
    return _joined(found.kind, ways)


def border_curve(margin: Callable[[float, float], float], ranges: Ranges, value: float,
                 second: float) -> BifurcationCurve | None:
    """The curve of a margin that vanishes at (value, second), both ways; None where it cannot be set up."""
    border, u = Border(margin, ranges), np.array([ranges[0].scaled(value), ranges[1].scaled(second)])
    try:
        return _joined("stick_border", [_collected(border, u, forward, ((1, 0.0, 1.0), (0, 0.0, 1.0)), ranges)
                                        for forward in (True, False)])
    except FAILURES:
        return None


@dataclass
class _Way:
    """One direction of a curve: its points in both parameters, what is special, and why it ended."""

    points: list[tuple[float, float]]
    special: list[Special]
    end: End


def _collected(equations: Equations, u: Floats, forward: bool, bounds: Bounds, ranges: Ranges) -> _Way:
    """One direction of a curve."""
    points, special = [], list[Special]()
    stream, extra = follow_curve(equations, u, forward, bounds), len(u) - 1 - bounds[0][0]

    def at(z: Floats) -> tuple[float, float]:
        n = len(z) - 1 - extra  # Of the second parameter: segments may have come or gone.
        return ranges[0].value(float(z[n - 1])), ranges[1].value(float(z[n]))

    while True:
        try:
            step = next(stream)
        except StopIteration as stopped:
            reason, bound = stopped.value
            break
        points.append(at(step.solution.z))
        special += [Special(kind, *at(z)) for kind, z in step.special]
    which = 0 if reason is StopReason.RANGE and bound == 1 else 1
    settings = equations.settings
    limit = {StopReason.POINTS: len(points) - 1, StopReason.STEP: settings.residual,
             StopReason.CANARD_CURVE: settings.canard}.get(reason, 0.0)
    what = special[-1].kind.replace("_", " ") if reason is StopReason.SPECIAL else ""
    return _Way(points, special, End(reason, ranges[which].name, points[-1][which], limit, what))


def _joined(kind: str, ways: list[_Way]) -> BifurcationCurve:
    """One curve of its two ways from the start."""
    ahead, behind = ways[0], ways[-1] if len(ways) > 1 else _Way([], [], ways[0].end)
    points = behind.points[:0:-1] + ahead.points
    return BifurcationCurve(kind, tuple(p[0] for p in points), tuple(p[1] for p in points), (behind.end, ahead.end),
                 tuple(behind.special[::-1] + ahead.special))


@dataclass(frozen=True)
class Limit:
    """The value of the parameter as sigma goes to infinity.

    value, error : and how exact it is; both None where there is none, or none was found
    why : empty; or that the bifurcation is one of the smoothing, or why its limit was not found
    """

    value: float | None
    error: float | None = None
    why: str = ""

    def as_json(self) -> dict[str, Any]:
        """The keys of an entry of `bifurcations`."""
        return {"limit": self.value, "limit_error": self.error, "limit_why": self.why}

    def __str__(self) -> str:
        """In words, no more digits than the error allows."""
        if self.value is None or self.error is None:
            return self.why
        digits = max(0, min(12, 1 - int(np.floor(np.log10(max(self.error, 1e-12))))))
        return f"limit {self.value:.{digits}f} +- {self.error:.1g}"


class Trace(NamedTuple):
    """A curve of a bifurcation over the smoothing.

    smoothness : (K,) smoothing factor of the scene over that of each point
    places : (K, 1 + n) parameter, and state at phase 0 in natural sizes
    last : the last point, and the equations that it solves
    """

    smoothness: Floats
    places: Floats
    last: Solution
    shooting: Shooting
    reason: StopReason
    bound: int


def limit_of(found: Bifurcation, smoothed: ParameterMap, set_valued: ParameterMap, span: ParameterRange,
             sigma: float) -> Limit:
    """The limit of a bifurcation of the smoothed law.

    Parameters
    ----------
    smoothed : the map with the parameter and friction.smoothing free
    set_valued : the map with the set-valued law and the parameter free
    span : range of the parameter
    sigma : the scene's smoothing factor, s/rad
    """
    if found.kind not in TRACED:
        return Limit(None, why=f"not found: the smoothing is not followed for a {found.kind}")
    settings = found.point.shooting.settings
    trace = _traced(found, smoothed, span, sigma)
    if trace is None:
        return Limit(None, why="not found: the curve of the bifurcation over the smoothing cannot be set up")
    reached = float(trace.smoothness.min())
    most = f"sigma = {sigma / reached:.6g}"
    if trace.reason is StopReason.SPECIAL or (trace.reason is StopReason.RANGE and trace.smoothness[-1] > 0.5
                                              and trace.bound == 0):
        return Limit(None, why=f"of the smoothing: there is none beyond {most}")
    if trace.reason is StopReason.RANGE and trace.bound == 1:
        return Limit(None, why=f"not found: it is {settings.limit_farthest:g} ranges away at {most}")
    extrapolated = _extrapolated(trace.smoothness, trace.places, settings)
    if extrapolated is None:
        return Limit(None, why=f"not found: the curve of the bifurcation was lost at {most}")
    limits, errors = extrapolated
    width = span.high - span.low
    limit, error = float(limits[0]), max(float(errors[0]), settings.limit_solved * width)
    own = _set_valued(found.kind, trace, limits, error, set_valued, width)
    return Limit(limit, error) if own is None else Limit(own, settings.limit_solved * width)


def _traced(found: Bifurcation, smoothed: ParameterMap, span: ParameterRange, sigma: float) -> Trace | None:
    """The curve of a bifurcation towards a smoothing of none; None where it cannot be set up."""
    ranges = span, ParameterRange(sigma, np.inf, inverse=True, name="friction.smoothing")
    shooting, orbit = replace(found.point.shooting, map=smoothed, ranges=ranges), found.point.orbit
    settings, rows, last = shooting.settings, list[Floats](), None
    reason, bound = StopReason.STEP, 0
    try:
        shooting, z = shooting.cut(shooting.unknowns(orbit.nodes, (orbit.values[0], sigma)))
        equations = MinimallyAugmented(found.kind, shooting, z)
        u = equations.start
        for smallest in settings.limit_landings:
            n = equations.shooting.size
            bounds = (n + 1, smallest, 1.0), (n, -settings.limit_farthest, settings.limit_farthest)
            stream = follow_curve(equations, u, False, bounds, StepSize(settings, *settings.limit_steps))
            try:
                while True:
                    last, _, on_the_curve = next(stream)
                    assert isinstance(on_the_curve, MinimallyAugmented)
                    equations, n, u = on_the_curve, on_the_curve.shooting.size, last.z
                    rows.append(np.array([u[n + 1], span.value(float(u[n])), *u[:smoothed.dimension]]))
            except StopIteration as stopped:
                reason, bound = stopped.value
            if reason is not StopReason.RANGE or bound or u[n + 1] > smallest:
                break
    except FAILURES:
        reason = StopReason.STEP
    if last is None:
        return None
    table = np.array(rows)
    return Trace(table[:, 0], table[:, 1:], last, equations.shooting, reason, bound)


def _extrapolated(smoothness: Floats, places: Floats, settings: Settings) -> tuple[Floats, Floats] | None:
    """Where places go as the smoothness goes to 0, and the errors of that; None for a trace that does not tell."""
    # A motion leaves stick after a time that goes as log(sigma)/sigma, so a + b e + c e log(e) is put through three of
    # four points at about equal ratios; the other three, and a straight line, tell its error.
    ratio = min(2.0, float(smoothness.max() / smoothness[-1]) ** (1.0 / 3.0))
    chosen = [int(np.abs(np.log(smoothness / (smoothness[-1] * ratio**k))).argmin()) for k in range(4)]
    if smoothness[-1] > min(settings.limit_least, *smoothness[:-1]) or len(set(chosen)) < 4:
        return None
    e, y = smoothness[chosen], places[chosen]
    terms = np.stack([np.ones(4), e, e * np.log(e)], axis=1)
    near, far = (np.linalg.solve(terms[k:k + 3], y[k:k + 3])[0] for k in (0, 1))
    straight = y[0] - e[0] * (y[1] - y[0]) / (e[1] - e[0])
    return near, settings.limit_safety * np.maximum(np.abs(near - far), settings.limit_gain * np.abs(near - straight))


def _set_valued(kind: str, trace: Trace, limits: Floats, error: float, of: ParameterMap, width: float) -> float | None:
    """The bifurcation of a kind that the set-valued law has within the error of an extrapolation, the nearest to it."""
    # A branch is begun at the extrapolated motion, or at the last one of the trace, with a corrector that leaves the
    # parameter as free as it is on the smoothed law's branch; first between these two, where steps are as fine as the
    # bend of a canard, then in the whole width of the range.
    old, settings, last = trace.shooting, trace.shooting.settings, trace.places[-1]
    along = np.linalg.svd(trace.last.found.jacobian[:old.size, :old.size + 1])[2][-1]
    for half in (2.0 * max(error, abs(last[0] - limits[0])), 0.5 * width):
        span = ParameterRange(limits[0] - half, limits[0] + half, name=old.ranges[0].name)
        shooting = Shooting.single(of, old.period, span, settings=settings)
        for place in (limits, last):
            z = np.append(place[1:], span.scaled(place[0]))
            if of.piecewise and abs(z[0]) < settings.limit_stuck:
                z[0] = 0.0
            try:
                finer, z = shooting.cut(z)
                row = np.zeros(len(z))
                row[:of.dimension], row[-1] = along[:of.dimension], along[-1] * 2.0 * half / width
                started = corrector(finer, z, row / float(np.linalg.norm(row)))
                if started is None or not 0.0 <= started.z[-1] <= 1.0:
                    continue
                found = branch_through(first_point(finer, started.z)).bifurcations
            except FAILURES:
                continue
            away = {abs(f.value - limits[0]): f.value for f in found if f.kind == kind}
            if away and min(away) <= error:
                return away[min(away)]
    return None
