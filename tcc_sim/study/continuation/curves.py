"""Curves of bifurcations in two keys, and their points of codimension two, each with its error.

Curves are those of folds, doublings, Neimark-Sacker bifurcations and the border of stick. Points of codimension two are
roots of test functions: cusp, generalised doubling, fold-flip and the strong resonances 1:1 to 1:4 (Yu. A. Kuznetsov,
Elements of Applied Bifurcation Theory, chapter 9). The event sequence may change too.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.steady.exponents import multipliers_of
from tcc_sim.result import Described, reported, reporting, result_class
from tcc_sim.shown_units import key_unit
from tcc_sim.study.continuation import arclength, orbits
from tcc_sim.study.continuation.arclength import Bracket, Continuation, CurvePoint, End, P, Rules, StopReason
from tcc_sim.study.continuation.bifurcations import (
    BORDER_HALVINGS,
    Bifurcation,
    MinimallyAugmented,
    halve,
    nearest_margins,
)
from tcc_sim.study.continuation.orbits import Floats, Linearised, ParameterMap, ParameterRange, Settings, cyclic

CURVE_ROOT = 1e-9  # width of the bracket of a point of codimension two, relative to the step
CURVE_SLOPE = 1e-2  # distance from it of the slope of its test, relative to the bracket
RESOLVED = 3.0  # least value of a test on both sides, relative to its changes by steps of differences
CURVE_EXACT = 1e-11  # least error of a point of codimension two, relative to the ranges
SINGULAR_APART = 0.05  # least distance from a singular end of a curve in its extrapolation
CURVE_JUMP = 1e-2  # part of the larger end value above which a test jumps
BEND = 8e-3  # the same for second derivatives, relative to the length in which the Jacobian changes by one


AugmentedPoint = CurvePoint[MinimallyAugmented]
"""A point of a curve of bifurcations."""


@result_class
class Special:
    """A point of codimension two: its kind and both parameters, each with its error, and the point of the curve."""

    kind: str = reported("cusp, generalised_doubling, fold_flip, resonance_1_1 to 1_4, or the border that it meets")
    value: float = reported("value of the key of --over", "{over}")
    second: float = reported("value of the key of --second", "{second_over}")
    error: float = reported("error of `value`", "{over}")
    second_error: float = reported("error of `second`", "{second_over}")
    located: bool = reported(
        "whether it was found; else a test has two significant signs within the errors", default=True)
    point: AugmentedPoint = field(kw_only=True, repr=False)

    @staticmethod
    def of(kind: str, point: AugmentedPoint, error: NDArray[np.floating[Any]], located: bool = True) -> Special:
        """The special point at a point with an error (P,) of the scaled parameters."""
        value, second = point.values
        one, two = (w.width * float(e) for w, e in zip(point.equations.ranges, error))
        return Special(kind, value, second, one, two, located, point=point)

    def described(self, over: str, second: str) -> str:
        """The point in words, for the keys of its values, in the selected units."""
        values = []
        for key, value, error in ((over, self.value, self.error), (second, self.second, self.second_error)):
            unit, factor = key_unit(key)
            # No more digits than the error allows.
            digits = max(0, min(12, 1 - int(np.floor(np.log10(max(error * factor, 1e-12))))))
            values.append(f"{key} {value * factor:.{digits}f} +- {error * factor:.1g} {unit}".rstrip())
        where = "" if self.located else "  not located: its test changes sign in between"
        return f"{self.kind:>22}  {'  '.join(values)}{where}"


ENDING: dict[tuple[str, str], Callable[[AugmentedPoint], float]] = {
    ("neimark_sacker", "resonance_1_1"): lambda s: float(s.z[-1]),
    ("neimark_sacker", "resonance_1_2"): lambda s: math.pi - float(s.z[-1])}
"""Kinds of curves and special points in which they end because a pair of multipliers becomes real, with the distance of
the pair's angle from there.
"""


def values_of_tests(point: AugmentedPoint, longer: float = 0.0) -> dict[str, float]:
    """The test functions that have a value at a point, by the special point at which each has a simple root.

    None has a pole: the normal form's coefficient of a doubling is multiplied by the tests of fold-flip and of 1:2, at
    each of which it has one.

    longer : step of differences at the point relative to the usual one, to fourth order; 0 takes the linearisation of
        the point and second order
    """
    equations, u = point.equations, point.z
    out: dict[str, float] = {}
    try:
        linearised = equations.linearise(u, longer) if longer else point.linearised
        if equations.turning:
            angle = float(u[-1])
            return {"resonance_1_1": math.sin(angle) if angle < 0.5 * np.pi else 1.0,
                    "resonance_1_2": math.sin(angle) if angle > 0.5 * np.pi else 1.0,
                    "resonance_1_3": angle - 2.0 * np.pi / 3.0, "resonance_1_4": angle - 0.5 * np.pi}
        mu = equations.multiplier(u).real
        v, w, _ = equations.null_vectors(linearised.blocks, mu)
        q, p, m = v / np.linalg.norm(v), w / np.linalg.norm(w), multipliers_of(*linearised.blocks)
        others = m[np.argsort(np.abs(m - mu))[1:]]
        simple, flip = float(p[-1] @ q[0]), float(np.prod((others + mu) / (1.0 + np.abs(others))).real)
        if equations.kind == "fold":
            bend = float(linearised.jacobian[-1, :equations.shooting.size] @ v.ravel()) / float(np.linalg.norm(v))
            return {"cusp": bend, "resonance_1_1": simple, "fold_flip": flip}
        out |= {"resonance_1_2": simple, "fold_flip": flip}
        out["generalised_doubling"] = flip * _cubic(equations, u, q, p, longer)
    except orbits.FAILURES:
        pass
    return out


def _cubic(equations: MinimallyAugmented, u: Floats, q: Floats, p: Floats, longer: float) -> float:
    """The normal form's coefficient of third order at a doubling times p . E q; its sign tells the stability."""
    # p . (C(q, q, q) + 3 B(q, h))/2 with L(1) h = -B(q, q) (Kuznetsov, Section 5.4.2); E q is the factor of mu in L.
    # The second difference needs all three Jacobians at u.
    shooting, step = equations.shooting, (longer or 1.0) * BEND / max(equations.bend, 1.0)
    z, unit = u[:equations.unknowns], np.pad(q.ravel(), (0, equations.unknowns - q.size))
    blocks = shooting.linearise(z).blocks

    def differences(step: float) -> Floats:
        ahead, behind = (shooting.linearise(z + s * step * unit).blocks for s in (1.0, -1.0))
        return np.array([(ahead - behind) / (2.0 * step), (ahead - 2.0 * blocks + behind) / step**2])

    first, second = (4.0 * differences(step) - differences(2.0 * step)) / 3.0 if longer else differences(step)
    b, c = (np.einsum("kij,kj->ki", x, q) for x in (first, second))
    h = np.linalg.solve(cyclic(blocks, 1.0), -b.ravel()).reshape(q.shape)
    return float(0.5 * np.sum(p * (c + 3.0 * np.einsum("kij,kj->ki", first, h))))


def measured(point: AugmentedPoint, name: str) -> tuple[float, float, Floats]:
    """A test at a point, its change by other difference steps and one more Newton step, and the parameters' change."""
    try:
        linearised, value = point.equations.linearise(point.z), values_of_tests(point, 1.0)[name]
        step: Any = np.linalg.lstsq(linearised.jacobian, -linearised.residual, rcond=None)[0]
        polished = replace(point, z=point.z + step)
        changes = [abs(values_of_tests(s, longer)[name] - value) for s, longer in ((point, 0.5), (polished, 2.0))]
        return value, max(changes), np.abs(point.free(step))
    except (*orbits.FAILURES, KeyError):
        return 0.0, math.inf, np.full(2, math.inf)


def special_point(kind: str, a: AugmentedPoint, b: AugmentedPoint) -> Special:
    """The special point between two points at which a test has different signs: a root, or the narrowest bracket."""
    if a.equations is not b.equations:
        return midway(kind, a, b, False)
    bracket, values = Bracket(a, b, False), dict[float, float]()

    def value(part: float) -> float:
        point = bracket.at(part)
        if point is None:
            raise ArithmeticError("the curve is lost between two of its points")
        values[part] = values_of_tests(point, 1.0)[kind]
        return values[part]

    try:
        part = arclength.chandrupatla(value, 0.0, 1.0, CURVE_ROOT)
        low, high = max(part - CURVE_SLOPE, 0.0), min(part + CURVE_SLOPE, 1.0)
        slope, root = (value(high) - value(low)) / (high - low), bracket.at(part)
        assert root is not None
        _, noise, step = measured(root, kind)
        error = RESOLVED * (noise + abs(values[part])) / abs(slope) + CURVE_ROOT
        if error < 1.0 and abs(values[part]) <= CURVE_JUMP * max(abs(values[0.0]), abs(values[1.0])):
            chord, tangent = b.z - a.z, root.tangent
            along = np.abs(root.free(tangent)) * float(chord @ chord) / abs(float(chord @ tangent))
            return Special.of(kind, root, error * along + RESOLVED * step + CURVE_EXACT)
    except (*orbits.FAILURES, KeyError):
        pass
    first = values.get(0.0, 0.0)
    low = max((k for k in values if values[k] * first > 0.0 and k < 1.0), default=0.0)
    high = min((k for k in values if values[k] * first < 0.0 and k > low), default=1.0)
    return midway(kind, bracket.at(low) or a, bracket.at(high) or b, False)


def singular_end(kind: str, points: Sequence[AugmentedPoint], distance: Callable[[AugmentedPoint], float],
                 beyond: AugmentedPoint | None = None) -> Special | None:
    """The special point in which a curve ends behind some `points`, where its equations are singular.

    These are the resonances 1:1 and 1:2 of Neimark-Sacker curves and generalised doublings of folds of doubled motions.
    The parameters, usually even functions of the `distance` from the end (of an angle from 0 or pi, of the halves of an
    orbit from each other), are extrapolated through four points at larger distances.

    beyond : the first point with a distance below 0, if there is one; else None is returned without four points
    """
    last = points[-1] if beyond is None else beyond
    alike = [s for s in points if s.equations is last.equations]
    # Nearer to the end the equations are so close to singular that rounding changes the parameters.
    apart = [s for s in alike if distance(s) > SINGULAR_APART]
    nodes = (apart if len(apart) >= 4 else alike)[-4:]
    if beyond is not None:
        a = next((s for s in reversed(points) if s.equations is beyond.equations
                  and distance(s) > SINGULAR_APART), nodes[0] if nodes else points[-1])
        bracket, start, nodes = Bracket(a, beyond, False), distance(a), [a]
        for part in (0.7, 0.45, 0.25) if a.equations is beyond.equations else ():
            located = bracket.locate(lambda s, at=part * start: distance(s) - at)  # type: ignore[misc]
            nodes += [] if located is None else [located]
    if len(nodes) < 4:
        return None if beyond is None else midway(kind, points[-1], beyond, False)
    x, places = np.array([distance(s) for s in nodes]), np.array([s.free(s.z) for s in nodes])

    def at_end(x: Floats, k: int) -> Floats:
        return np.array(np.linalg.solve(np.vander(x[k:], increasing=True), places[k:])[0], np.float64)

    at: NDArray[np.floating[Any]] = at_end(x, 0)
    error: NDArray[np.floating[Any]] = np.abs(at - at_end(x, 1))
    even = at_end(x**2, 0)
    if (np.abs(even - at) <= 10.0 * error + CURVE_EXACT).all():
        at, error = even, np.abs(even - at_end(x**2, 1))
    z = last.z.copy()
    last.free(z)[:] = at
    error = error + RESOLVED * last.equations.rounding
    return Special.of(kind, replace(last, z=z), error)


def midway(kind: str, a: AugmentedPoint, b: AugmentedPoint, is_located: bool) -> Special:
    """The special point in the middle between two points; its error is half of their distance."""
    z, way = b.z.copy(), b.free(b.z) - a.free(a.z)
    b.free(z)[:] -= 0.5 * way
    error = 0.5 * np.abs(way) + CURVE_EXACT
    return Special.of(kind, replace(b, z=z), error, is_located)


# Distance between the halves of a fold's orbit at which a curve that ends has reached a generalised doubling, whose
# parameters are then known to its square.
HALVES_MET = 1e-2
FINER_GROWTHS = (10.0, 3.0)  # growths over a segment of thorough cuts after failed steps
MARGIN_STEP = 1e-6  # step of differences of a margin by the two parameters

KINDS = ("fold", "period_doubling", "neimark_sacker", "stick_border")
"""Kinds that can be followed in two keys."""
Ranges = tuple[ParameterRange, ParameterRange]


@result_class(repr=False)
class BifurcationCurve(Described):
    """A curve of one kind of bifurcation: both parameters along it, its special points, and its two ends."""

    kind: str = reported("kind of bifurcation")
    values: tuple[float, ...] = reported("values of the key of --over", "{over}", name="value")
    second: tuple[float, ...] = reported("values of the key of --second", "{second_over}")
    ended: tuple[End, End]
    special: tuple[Special, ...] = reported("points of codimension two on it", default=())

    @reporting("a sentence for each end", name="ended")
    def sentences(self) -> list[str]:
        return [str(end) for end in self.ended]


CurveTrack = Continuation[AugmentedPoint, Special]
"""One direction of a curve of bifurcations.

A point of codimension two is listed where its test function has two signs, each of which is resolved: larger than the
changes that other difference steps and one more Newton step make.
"""


def _unresolved(track: CurveTrack, new: AugmentedPoint) -> End | None:
    """The end before a motion along a part of which disturbances grow beyond double precision."""
    blocks, most = new.linearised.blocks, 0.0
    ahead = np.broadcast_to(np.eye(blocks.shape[1]), blocks.shape)
    for k in range(len(blocks)):
        ahead = np.roll(blocks, -k, axis=0) @ ahead
        most = max(most, float(np.abs(ahead).max()))
    return None if most <= track.settings.canard else track.end(StopReason.CANARD_CURVE, limit=track.settings.canard)


def _special(track: CurveTrack, new: AugmentedPoint) -> list[Special]:
    """The change of the event sequence, or the special points between which the signs of tests change."""
    here = track.here
    if here.equations.shooting.map.piecewise and orbits.differ(here.events, new.events):
        track.tests.clear()
        _test(track, new)
        ends = [here, new]
        halve(Bracket(here, new, False), ends, [0.0, 1.0], BORDER_HALVINGS[0])
        near = [nearest_margins(s.equations.shooting, s.z[:s.equations.unknowns]) for s in ends]
        kind = orbits.kind_of_change(ends[0].events, ends[1].events, near)
        return [midway(kind, ends[0], ends[1], True)]
    way = new.z - here.z
    return sorted(_test(track, new), key=lambda s: float(way @ s.point.z))


def _test(track: CurveTrack, new: AugmentedPoint) -> list[Special]:
    """Evaluate the tests at a point, and locate special points where their signs have changed."""
    out: list[Special] = []
    for name, value in values_of_tests(new).items():
        known = track.tests.setdefault(name, [])
        if not known or known[-1][1] * value > 0.0:
            known.append((new, value))
        else:
            out += _crossed(track, name, new)
    return out


def _crossed(track: CurveTrack, name: str, new: AugmentedPoint) -> list[Special]:
    """The special point between the last point at which a test is resolved and a new one with another sign."""
    known, factor, before = track.tests[name], RESOLVED, 0.0
    value, noise, _ = measured(new, name)
    if not abs(value) > factor * noise:
        return []
    while known:
        before, noise, _ = measured(known[-1][0], name)
        if abs(before) > factor * noise:
            break
        known.pop()
    last = known[-1][0] if known and before * value < 0.0 else None
    known.append((new, value))
    if last is None:
        return []
    apart = ENDING.get((new.equations.kind, name))
    end = None if apart is None else singular_end(name, track.points, apart, new)
    return [end or special_point(name, last, new)]


def _ended(track: CurveTrack, new: AugmentedPoint, special: list[Special],
           stop: End | None) -> tuple[AugmentedPoint, list[Special], End | None]:
    """The end of the curve in a special point, or at its first point."""
    equations = track.here.equations
    last = next((s for s in special if (equations.kind, s.kind) in ENDING), None)
    if equations.doubled:
        halves = equations.between_halves(track.here.z)
        if arclength.turned_round(halves, equations.between_halves(new.z)):
            last = singular_end("generalised_doubling", track.points, _apart(track), new)
            special = [*special, *([] if last is None else [last])]
    if last is None:
        return arclength.back_at_start(track, new, special, stop)
    return last.point, special, track.end(StopReason.SPECIAL, last.point, what=last.kind)


def _apart(track: CurveTrack) -> Callable[[AugmentedPoint], float]:
    """The distance between the halves of an orbit, along that of the last point."""
    equations = track.here.equations
    halves = equations.between_halves(track.here.z)
    unit = halves / max(float(np.linalg.norm(halves)), 1e-300)
    return lambda s: float(unit @ equations.between_halves(s.z))


def _went_on(track: CurveTrack) -> None:
    track.cut, here = (0, math.inf), track.here
    here.equations.update_borders(here.z, here.linearised)
    _remesh(track, others=(len(track.points) - 1) % track.settings.fewer_after == 0)


def _lost(track: CurveTrack) -> None:
    # Where disturbances grow by 1e3 in slip and stick removes them within one segment, its derivative is not large,
    # but changes within 1e-5, and its error is the state's over that length. Curves pass cusps only in segments
    # over which disturbances grow by about 10.
    equations = track.here.equations
    for growth in FINER_GROWTHS:
        if growth <= equations.shooting.settings.growth and growth < track.cut[1]:
            track.cut = len(track.points), growth
            if _remesh(track, growth):
                track.length = arclength.FLAT_STEP
                return
    arclength.give_up(track)
    # Folds of doubled motions of amplitude a lie within a^2 of a generalised doubling, where they meet the
    # doublings of the halves, so that the equations are singular.
    if equations.doubled and (apart := _apart(track))(track.here) <= HALVES_MET:
        last = singular_end("generalised_doubling", track.points, apart)
        if last is not None:
            track.note([last])
            track.stop = track.end(StopReason.SPECIAL, last.point, what=last.kind)


def _remesh(track: CurveTrack, growth: float | None = None, others: bool = False) -> bool:
    """Cut the last orbit into other segments if growth is large, above `growth`, or `others` may do."""
    here, old = track.here, track.here.equations
    settings, shooting = old.settings, old.shooting
    # Only a thorough search finds growth that the same segment removes again.
    others = others and (settings.thorough or len(shooting.segments) > 1)
    if shooting.keeps_segments(here.linearised.blocks, settings.regrowth, others or growth is not None):
        return False
    if growth is not None:
        shooting = replace(shooting, settings=replace(shooting.settings, growth=growth, thorough=True))
    try:
        finer, z = shooting.cut(here.z[:old.unknowns])
        if finer.segments == shooting.segments:
            return False
        other = MinimallyAugmented(old.kind, finer, z)
        start = np.append(z, here.z[-1:]) if old.turning else z
        linearised = other.linearise(start)
        other.update_borders(start, linearised, old)
        polished = arclength.corrector(other, start, arclength.null_direction(linearised))
    except orbits.FAILURES:
        return False
    if polished is None:
        return False
    # The first node and the parameters do not depend on the segments; the other nodes have the motion's errors.
    sign = 1.0 if float(old.outer(here.tangent) @ other.outer(polished.tangent)) > 0.0 else -1.0
    track.points[-1] = AugmentedPoint(other, polished.z, polished.linearised, sign * polished.tangent)
    track.before = []
    track.note(_test(track, track.here))
    return True


CURVE = Rules(unresolved=_unresolved, special=_special, ended=_ended, went_on=_went_on, lost=_lost)
"""A curve of bifurcations in two parameters."""


@dataclass(frozen=True)
class Border:
    """The equation of a border in two parameters: a margin vanishes."""

    margin: Callable[[float, float], float]
    ranges: Ranges
    rounding: ClassVar[float] = 1e-12
    settings: ClassVar[Settings] = orbits.DEFAULTS
    size: ClassVar[int] = 0

    def outer(self, vector: Floats) -> Floats:
        """All unknowns; there are no segments."""
        return vector

    def linearise(self, z: Floats) -> Linearised:
        """The margin and its derivatives by central differences; one-sided ones where the keys' own ranges end."""
        def at(p: Floats) -> float:
            return self.margin(self.ranges[0].value(float(p[0])), self.ranges[1].value(float(p[1])))

        gradient, step = np.empty((1, 2)), MARGIN_STEP
        for k, away in enumerate(step * np.eye(2)):
            try:
                gradient[0, k] = (at(z + away) - at(z - away)) / (2.0 * step)
            except orbits.FAILURES:
                side = -1.0 if z[k] > 0.5 else 1.0
                gradient[0, k] = side * (at(z + side * away) - at(z)) / step
        return Linearised(np.array([at(z)]), gradient)


def bifurcation_curve(bifurcation: Bifurcation, of: ParameterMap, ranges: Ranges, second: float,
                      settings: Settings | None = None) -> BifurcationCurve:
    """The curve of a bifurcation in two parameters, both ways; the bifurcation alone where it cannot be set up.

    of : the map with both parameters free
    second : value of the second parameter at the bifurcation
    """
    point = bifurcation.point
    shooting = replace(point.equations, map=of, ranges=ranges, settings=settings or point.equations.settings)

    def first() -> AugmentedPoint:
        finer, z = shooting.cut(shooting.unknowns(point.equations.nodes(point.z), (point.value, second)))
        system = MinimallyAugmented(bifurcation.kind, finer, z)
        return AugmentedPoint.at(system, system.start)

    def begun(point: AugmentedPoint) -> CurveTrack:
        track = Continuation(point, CURVE)
        _test(track, point)
        return track

    lost = End(StopReason.STEP, ranges[0].name, point.value, shooting.settings.residual)
    return _both_ways(bifurcation.kind, first, begun, lost, second)


def border_curve(margin: Callable[[float, float], float], ranges: Ranges, value: float,
                 second: float) -> BifurcationCurve:
    """The curve of a margin that vanishes at (value, second), both ways; that point alone where it cannot be set up."""
    border, at = Border(margin, ranges), np.array([ranges[0].scaled(value), ranges[1].scaled(second)])

    lost = End(StopReason.STEP, ranges[0].name, value, border.settings.residual)
    return _both_ways("stick_border", lambda: CurvePoint[Border].at(border, at), Continuation, lost, second)


def _both_ways(kind: str, first: Callable[[], P], track_from: Callable[[P], Continuation[P, Special]], lost: End,
               second: float) -> BifurcationCurve:
    """The curve through its first point, both ways from it, first to larger second parameters, or once round.

    lost, second : the end where no way can be set up, and the second parameter there
    """
    tracks: list[Continuation[P, Special]] = []
    for forward in (True, False):
        try:
            point = first()
            growing = float(point.free(point.tangent)[1]) > 0.0
            tracks.append(track_from(point if growing == forward else point.turned()))
            deque(tracks[-1].follow(), 0)
        except orbits.FAILURES:
            if not tracks:
                return BifurcationCurve(kind, (lost.value,), (second,), (lost, lost))
            tracks[-1].stop = tracks[-1].stop or tracks[-1].end(StopReason.STEP, limit=lost.limit)
        if tracks[-1].ended.reason is StopReason.CLOSED:
            del tracks[:-1]
            break
    points, special, ended = arclength.joined(tracks)
    values, others = zip(*(point.values for point in points))
    return BifurcationCurve(kind, values, others, ended, tuple(item for _, item in special))
