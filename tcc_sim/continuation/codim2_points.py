"""Points of codimension two on curves of bifurcations: found between two points of a curve, each with its error.

Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, chapter 9: cusp, generalised doubling, fold-flip and the
strong resonances 1:1 to 1:4; and changes of the event sequence. Such a point is a root of a test function.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.continuation.augmented import MinimallyAugmented
from tcc_sim.continuation.bracket import Bracket, CurvePoint, chandrupatla
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.sliding import differ, kind_of_change, nearest_margins


@dataclass(frozen=True)
class SpecialPoint:
    """A point of codimension two.

    error : (P,) of the scaled parameters
    located : whether its root was found; else it lies within `error` of the middle of the last bracket
    """

    kind: str
    point: CurvePoint
    error: NDArray[np.floating[Any]]
    located: bool = True


ENDING: dict[tuple[str, str], Callable[[CurvePoint], float]] = {
    ("neimark_sacker", "resonance_1_1"): lambda s: float(s.solution.z[-1]),
    ("neimark_sacker", "resonance_1_2"): lambda s: math.pi - float(s.solution.z[-1])}
"""Kinds of curves and special points in which they end, as the pair of multipliers becomes real there: and how far the
angle of the pair is from that.
"""


def values_of_tests(point: CurvePoint, longer: float = 0.0) -> dict[str, float]:
    """The test functions at a point, those that have a value there: by its own linearisation, or a new one at the very
    point with differences whose steps are `longer` than the usual ones by this factor.
    """
    equations, z = point.equations, point.solution.z
    if not isinstance(equations, MinimallyAugmented):
        return {}
    try:
        found = equations.linearise(z, longer) if longer else point.solution.found
        return equations.tests(z, found, longer)
    except FAILURES:
        return {}


Test = Callable[[CurvePoint, float], float]
"""A test function of a point and of the step of its differences, relative to the usual one."""


def measured(point: CurvePoint, test: Test) -> tuple[float, float, Floats]:
    """A test at a point, how much it changes with the steps of differences and with one more Newton step, and by how
    much that changes the parameters.
    """
    try:
        found, value = point.equations.linearise(point.solution.z), test(point, 1.0)
        step = np.linalg.lstsq(found.jacobian, -found.residual, rcond=None)[0]
        polished = point.moved(point.solution._replace(z=point.solution.z + step))
        changes = [abs(test(s, longer) - value) for s, longer in ((point, 0.5), (polished, 2.0))]
        return value, max(changes), np.abs(parameters(point, step))
    except (*FAILURES, KeyError):
        return 0.0, math.inf, np.full(2, math.inf)


def special_point(kind: str, a: CurvePoint, b: CurvePoint, test: Test) -> SpecialPoint:
    """The special point between two points at which a test has different signs, with its error: by its root where that
    is found, else as the middle of the narrowest bracket.
    """
    if a.equations is not b.equations:
        return midway(kind, a, b, False)
    bracket, values, settings = Bracket(a, b, False), dict[float, float](), a.equations.settings

    def value(part: float) -> float:
        point = bracket.at(part)
        if point is None:
            raise ArithmeticError("the curve is lost between two of its points")
        values[part] = test(point, 1.0)
        return values[part]

    try:
        part = chandrupatla(value, 0.0, 1.0, settings.curve_root)
        low, high = max(part - settings.curve_slope, 0.0), min(part + settings.curve_slope, 1.0)
        slope, root = (value(high) - value(low)) / (high - low), bracket.at(part)
        assert root is not None
        _, noise, step = measured(root, test)
        error = settings.resolved * (noise + abs(values[part])) / abs(slope) + settings.curve_root
        if error < 1.0 and abs(values[part]) <= settings.curve_jump * max(abs(values[0.0]), abs(values[1.0])):
            chord, tangent = b.solution.z - a.solution.z, root.solution.tangent
            along = np.abs(parameters(root, tangent)) * float(chord @ chord) / abs(float(chord @ tangent))
            return SpecialPoint(kind, root, error * along + settings.resolved * step + settings.curve_exact)
    except (*FAILURES, KeyError):
        pass
    first = values.get(0.0, 0.0)
    low = max((k for k in values if values[k] * first > 0.0 and k < 1.0), default=0.0)
    high = min((k for k in values if values[k] * first < 0.0 and k > low), default=1.0)
    return midway(kind, bracket.at(low) or a, bracket.at(high) or b, False)


def singular_end(kind: str, points: Sequence[CurvePoint], distance: Callable[[CurvePoint], float],
                 beyond: CurvePoint | None = None) -> SpecialPoint | None:
    """The special point in which a curve ends behind some `points`, where its equations are singular: the resonances
    1:1 and 1:2 on a Neimark-Sacker curve, and a generalised doubling on a curve of folds of doubled motions.

    The parameters are extrapolated to it through four points at which the `distance` from it (of an angle from 0 or pi,
    of the halves of an orbit from each other) is larger. As a rule they are even functions of it.

    beyond : the first point with a distance below 0, where there is one; None is returned without it and near points
    """
    last = points[-1] if beyond is None else beyond
    settings, alike = last.equations.settings, [s for s in points if s.equations is last.equations]
    # The equations of points nearer than this are so nearly singular that rounding moves the parameters.
    apart = [s for s in alike if distance(s) > settings.singular_apart]
    nodes = (apart if len(apart) >= 4 else alike)[-4:]
    if beyond is not None:
        a = next((s for s in reversed(points) if s.equations is beyond.equations
                  and distance(s) > settings.singular_apart), nodes[0] if nodes else points[-1])
        bracket, start, nodes = Bracket(a, beyond, False), distance(a), [a]
        for part in (0.7, 0.45, 0.25) if a.equations is beyond.equations else ():
            found = bracket.locate(lambda s, at=part * start: distance(s) - at)  # type: ignore[misc]
            nodes += [] if found is None else [found]
    if len(nodes) < 4:
        return None if beyond is None else midway(kind, points[-1], beyond, False)
    x, places = np.array([distance(s) for s in nodes]), np.array([parameters(s, s.solution.z) for s in nodes])

    def at_end(x: Floats, k: int) -> Floats:
        return np.array(np.linalg.solve(np.vander(x[k:], increasing=True), places[k:])[0], np.float64)

    at: NDArray[np.floating[Any]] = at_end(x, 0)
    error: NDArray[np.floating[Any]] = np.abs(at - at_end(x, 1))
    even = at_end(x**2, 0)
    if (np.abs(even - at) <= 10.0 * error + settings.curve_exact).all():
        at, error = even, np.abs(even - at_end(x**2, 1))
    z = last.solution.z.copy()
    parameters(last, z)[:] = at
    error = error + settings.resolved * last.equations.rounding
    return SpecialPoint(kind, last.moved(last.solution._replace(z=z)), error)


def midway(kind: str, a: CurvePoint, b: CurvePoint, is_located: bool) -> SpecialPoint:
    """The special point between two points; its error is half of the way from one to the other."""
    z, way = b.solution.z.copy(), parameters(b, b.solution.z) - parameters(a, a.solution.z)
    parameters(b, z)[:] -= 0.5 * way
    error = 0.5 * np.abs(way) + b.equations.settings.curve_exact
    return SpecialPoint(kind, b.moved(b.solution._replace(z=z)), error, is_located)


def parameters(point: CurvePoint, vector: NDArray[np.floating[Any]]) -> Floats:
    """The two parameters' part of a vector of unknowns."""
    first = point.equations.first_parameter
    out: Any = vector[first:first + 2]
    return out  # type: ignore[no-any-return]


def change_of_events(equations: MinimallyAugmented, a: CurvePoint, b: CurvePoint) -> SpecialPoint:
    """The change of the event sequence between two points, by halvings of the piece of the curve between them."""
    bracket, ends, parts = Bracket(a, b, False), [a, b], [0.0, 1.0]
    for _ in range(equations.settings.border_halvings[0]):
        middle = 0.5 * (parts[0] + parts[1])
        point = bracket.at(middle)
        if point is None:
            break
        side = int(differ(events_of(point), events_of(a)))
        ends[side], parts[side] = point, middle
    near = [nearest_margins(equations.shooting, s.solution.z[:equations.unknowns]).margins for s in ends]
    kind = kind_of_change(events_of(ends[0]), events_of(ends[1]), (near[0], near[1]))
    return midway(kind, ends[0], ends[1], True)


def events_of(point: CurvePoint) -> str:
    """The event sequence of the motion at a point."""
    seen = point.solution.found.seen
    return "" if seen is None else seen.events
