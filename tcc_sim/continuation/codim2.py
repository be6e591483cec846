"""Curves of bifurcations in two parameters: fold, period doubling, Neimark-Sacker, and the border of pure stick.

Special points on them are located and named; what ends them is one of these, the range, a closed curve, a canard, or
another `StopReason`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from tcc_sim.continuation.augmented import MinimallyAugmented
from tcc_sim.continuation.detection import End, StopReason
from tcc_sim.continuation.follow_curve import Bounds, follow_curve
from tcc_sim.continuation.palc import Equations
from tcc_sim.continuation.problem import FAILURES, Floats, ParameterMap
from tcc_sim.continuation.settings import DEFAULTS, Settings
from tcc_sim.continuation.shooting import Linearised, ParameterRange
from tcc_sim.continuation.special_points import Bifurcation
from tcc_sim.result import Described, json_of

KINDS = ("fold", "period_doubling", "neimark_sacker", "stick_border")
"""What can be followed in two parameters."""
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
