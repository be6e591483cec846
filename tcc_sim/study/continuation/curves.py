"""Curves of bifurcations in two keys, with points of codimension two: folds, doublings, Neimark-Sacker, stick border.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from tcc_sim.result import Described, reported, reporting
from tcc_sim.study.continuation.bordered import MinimallyAugmented
from tcc_sim.study.continuation.bracket import OPPOSITE, CurvePoint, P, turned_round
from tcc_sim.study.continuation.codim2_points import (
    ENDING,
    RESOLVED,
    AugmentedPoint,
    Special,
    change_of_events,
    measured,
    parameter_values,
    parameters,
    singular_end,
    special_point,
    values_of_tests,
)
from tcc_sim.study.continuation.follow import FLAT_STEP, Continuation, End, StopReason
from tcc_sim.study.continuation.palc import corrector, null_direction, solution_at
from tcc_sim.study.continuation.problem import FAILURES, Floats, ParameterMap, differ
from tcc_sim.study.continuation.settings import DEFAULTS, Settings
from tcc_sim.study.continuation.shooting import Linearised, ParameterRange
from tcc_sim.study.continuation.special_points import Bifurcation

# Distance between the halves of a fold's orbit at which a curve that ends has reached a generalised doubling, whose
# parameters are then known to its square.
HALVES_MET = 1e-2
FINER_GROWTHS = (10.0, 3.0)  # growths over a segment of thorough cuts after failed steps
MARGIN_STEP = 1e-6  # step of differences of a margin by the two parameters

TRACED = ("fold", "period_doubling", "neimark_sacker")
"""Kinds that have a minimally augmented system."""
KINDS = (*TRACED, "stick_border")
"""Kinds that can be followed in two keys."""
Ranges = tuple[ParameterRange, ParameterRange]


@dataclass(frozen=True, repr=False)
class BifurcationCurve(Described):
    """A curve of one kind of bifurcation: both parameters along it, its special points, and its two ends."""

    kind: str = field(metadata=reported("kind of bifurcation"))
    values: tuple[float, ...] = field(metadata=reported("values of the key of --over", "{over}", name="value"))
    second: tuple[float, ...] = field(metadata=reported("values of the key of --second", "{second_over}"))
    ended: tuple[End, End]
    special: tuple[Special, ...] = field(default=(), metadata=reported("points of codimension two on it"))

    @property
    @reporting("a sentence for each end", name="ended")
    def sentences(self) -> list[str]:
        """Its two ends in words."""
        return [str(end) for end in self.ended]


class CurveTrack(Continuation[AugmentedPoint, Special]):
    """One direction of a curve of bifurcations in two parameters.

    A point of codimension two is listed where its test function has two signs, each of which is resolved: larger than
    the changes that other difference steps and one more Newton step make.
    """

    cut_to = math.inf
    """Growth over a segment below which failed steps have cut the orbit at the last point."""

    def __init__(self, first: AugmentedPoint) -> None:
        super().__init__(first)
        self.signs: dict[str, list[tuple[AugmentedPoint, float]]] = {}
        """Points and values of each test, since the last change of its sign."""
        self._test(first)

    def unresolved(self, new: AugmentedPoint) -> End | None:
        """The end before a motion along a part of which disturbances grow beyond double precision."""
        blocks, most = new.solution.linearised.blocks, 0.0
        ahead = np.broadcast_to(np.eye(blocks.shape[1]), blocks.shape)
        for k in range(len(blocks)):
            ahead = np.roll(blocks, -k, axis=0) @ ahead
            most = max(most, float(np.abs(ahead).max()))
        return None if most <= self.settings.canard else self.end(StopReason.CANARD_CURVE, limit=self.settings.canard)

    def special_between(self, new: AugmentedPoint) -> list[Special]:
        """The special points up to `new`, in order."""
        here = self.here
        if here.equations.shooting.map.piecewise and differ(here.events, new.events):
            self.signs.clear()
            self._test(new)
            return [change_of_events(here, new)]
        way = new.solution.z - here.solution.z
        return sorted(self._test(new), key=lambda s: float(way @ s.point.solution.z))

    def _test(self, new: AugmentedPoint) -> list[Special]:
        """Evaluate the tests at a point, and locate special points where their signs have changed."""
        out: list[Special] = []
        for name, value in values_of_tests(new).items():
            known = self.signs.setdefault(name, [])
            if not known or known[-1][1] * value > 0.0:
                known.append((new, value))
            else:
                out += self._crossed(name, new)
        return out

    def _crossed(self, name: str, new: AugmentedPoint) -> list[Special]:
        """The special point between the last point at which a test is resolved and a new one with another sign."""
        def test(point: AugmentedPoint, longer: float) -> float:
            return values_of_tests(point, longer)[name]

        known, factor, before = self.signs[name], RESOLVED, 0.0
        value, noise, _ = measured(new, test)
        if not abs(value) > factor * noise:
            return []
        while known:
            before, noise, _ = measured(known[-1][0], test)
            if abs(before) > factor * noise:
                break
            known.pop()
        last = known[-1][0] if known and before * value < 0.0 else None
        known.append((new, value))
        if last is None:
            return []
        apart = ENDING.get((new.equations.kind, name))
        end = None if apart is None else singular_end(name, self.points, apart, new)
        return [end or special_point(name, last, new, test)]

    def ended_by(self, new: AugmentedPoint, special: list[Special],
                 stop: End | None) -> tuple[AugmentedPoint, list[Special], End | None]:
        """The end of the curve in a special point, or at its first point."""
        equations = self.here.equations
        last = next((s for s in special if (equations.kind, s.kind) in ENDING), None)
        if equations.doubled:
            halves = equations.between_halves(self.here.solution.z)
            if turned_round(halves, equations.between_halves(new.solution.z), OPPOSITE):
                last = singular_end("generalised_doubling", self.points, self._apart(), new)
                special = [*special, *([] if last is None else [last])]
        if last is None:
            return super().ended_by(new, special, stop)
        return last.point, special, self.end(StopReason.SPECIAL, last.point, what=last.kind)

    def lost(self) -> tuple[list[Special], End]:
        """The special point and the end where no step succeeds."""
        # Folds of doubled motions of amplitude a lie within a^2 of a generalised doubling, where they meet the
        # doublings of the halves, so that the equations are singular.
        last = None
        if self.here.equations.doubled and (apart := self._apart())(self.here) <= HALVES_MET:
            last = singular_end("generalised_doubling", self.points, apart)
        return super().lost() if last is None else ([last], self.end(StopReason.SPECIAL, last.point, what=last.kind))

    def _apart(self) -> Callable[[AugmentedPoint], float]:
        """The distance between the halves of an orbit, along that of the last point."""
        equations = self.here.equations
        halves = equations.between_halves(self.here.solution.z)
        unit = halves / max(float(np.linalg.norm(halves)), 1e-300)
        return lambda s: float(unit @ equations.between_halves(s.solution.z))

    def went_on(self, before: AugmentedPoint, corner: bool) -> None:
        """Update predictor and borders for a new last point, and cut its orbit into other segments where needed."""
        super().went_on(before, corner)
        self.cut_to, here = math.inf, self.here
        here.equations.update_borders(here.solution.z, here.solution.linearised)
        self._remesh(others=(len(self.points) - 1) % self.settings.fewer_after == 0)

    def cut_anew(self) -> bool:
        """Cut the orbit into segments over which disturbances grow less; return whether there are any."""
        # Where disturbances grow by 1e3 in slip and stick removes them within one segment, its derivative is not large,
        # but changes within 1e-5, and its error is the state's over that length. Curves pass cusps only in segments
        # over which disturbances grow by about 10.
        equations = self.here.equations
        for growth in FINER_GROWTHS:
            if growth <= equations.shooting.settings.growth and growth < self.cut_to:
                self.cut_to = growth
                if self._remesh(growth):
                    self.length = FLAT_STEP
                    return True
        return False

    def _remesh(self, growth: float | None = None, others: bool = False) -> bool:
        """Cut the last orbit into other segments if growth is large, above `growth`, or `others` may do."""
        here, old = self.here, self.here.equations
        settings, shooting = old.settings, old.shooting
        # Only a thorough search finds growth that the same segment removes again.
        others = others and (settings.thorough or len(shooting.segments) > 1)
        if shooting.keeps_segments(here.solution.linearised.blocks, settings.regrowth, others or growth is not None):
            return False
        if growth is not None:
            shooting = replace(shooting, settings=replace(shooting.settings, growth=growth, thorough=True))
        try:
            finer, z = shooting.cut(here.solution.z[:old.unknowns])
            if finer.segments == shooting.segments:
                return False
            other = MinimallyAugmented(old.kind, finer, z)
            start = np.append(z, here.solution.z[-1:]) if old.turning else z
            linearised = other.linearise(start)
            other.update_borders(start, linearised, old)
            polished = corrector(other, start, null_direction(linearised))
        except FAILURES:
            return False
        if polished is None:
            return False
        # The first node and the parameters do not depend on the segments; the other nodes have the motion's errors.
        sign = 1.0 if float(old.outer(here.solution.tangent) @ other.outer(polished.tangent)) > 0.0 else -1.0
        self.points[-1] = AugmentedPoint(solution_at(polished.z, polished.linearised, sign * polished.tangent), other)
        self.before = []
        self.note(self._test(self.here))
        return True


def start_of_curve(equations: MinimallyAugmented) -> AugmentedPoint:
    """The first point of a curve, without a direction."""
    linearised = equations.linearise(equations.start)
    return AugmentedPoint(solution_at(equations.start, linearised, null_direction(linearised)), equations)


def facing(point: P, forward: bool) -> P:
    """The point with the tangent along which the second parameter grows, or falls."""
    growing = float(parameters(point, point.solution.tangent)[1]) > 0.0
    return point if growing == forward else point.turned()


class Border:
    """The equation of a border in two parameters: a margin vanishes."""

    rounding: ClassVar[float] = 1e-12
    settings: ClassVar[Settings] = DEFAULTS
    size: ClassVar[int] = 0

    def __init__(self, margin: Callable[[float, float], float], ranges: Ranges) -> None:
        self.margin, self.ranges, self.coarse = margin, ranges, self

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
            except FAILURES:
                side = -1.0 if z[k] > 0.5 else 1.0
                gradient[0, k] = side * (at(z + side * away) - at(z)) / step
        return Linearised(np.array([at(z)]), gradient)


def bifurcation_curve(bifurcation: Bifurcation, of: ParameterMap, ranges: Ranges, second: float,
                      settings: Settings | None = None) -> BifurcationCurve:
    """The curve of a bifurcation in two parameters, both ways; the bifurcation alone where it cannot be set up.

    of : the map with both parameters free
    second : value of the second parameter at the bifurcation
    """
    orbit, shooting = bifurcation.point.orbit, bifurcation.point.shooting
    shooting = replace(shooting, map=of, ranges=ranges, settings=settings or shooting.settings)

    def begun(forward: bool) -> CurveTrack:
        finer, z = shooting.cut(shooting.unknowns(orbit.nodes, (orbit.values[0], second)))
        return CurveTrack(facing(start_of_curve(MinimallyAugmented(bifurcation.kind, finer, z)), forward))

    return _both_ways(bifurcation.kind, begun, End(StopReason.STEP, ranges[0].name, bifurcation.value,
                                                   shooting.settings.residual),
                      second)


def border_curve(margin: Callable[[float, float], float], ranges: Ranges, value: float,
                 second: float) -> BifurcationCurve:
    """The curve of a margin that vanishes at (value, second), both ways; that point alone where it cannot be set up."""
    border, at = Border(margin, ranges), np.array([ranges[0].scaled(value), ranges[1].scaled(second)])

    def begun(forward: bool) -> Continuation[CurvePoint, Special]:
        linearised = border.linearise(at)
        return Continuation(facing(CurvePoint(solution_at(at, linearised, null_direction(linearised)), border),
                                   forward))

    return _both_ways("stick_border", begun, End(StopReason.STEP, ranges[0].name, value, DEFAULTS.residual), second)


def _both_ways(kind: str, begun: Callable[[bool], Continuation[Any, Special]], lost: End,
               second: float) -> BifurcationCurve:
    """The curve through a point, both ways from it or once round.

    lost, second : the end where no way can be set up, and the second parameter there
    """
    tracks: list[Continuation[Any, Special]] = []
    for forward in (True, False):
        try:
            tracks.append(begun(forward))
            deque(tracks[-1].follow(), 0)
        except FAILURES:
            if not tracks:
                return BifurcationCurve(kind, (lost.value,), (second,), (lost, lost))
            tracks[-1].stop = tracks[-1].stop or tracks[-1].end(StopReason.STEP, limit=lost.limit)
        if tracks[-1].ended.reason is StopReason.CLOSED:
            del tracks[:-1]
            break
    ahead, behind = tracks[0], tracks[-1]
    points, special = ahead.points, [s for _, s in ahead.special]
    if behind is not ahead:
        points, special = behind.points[:0:-1] + points, [s for _, s in reversed(behind.special)] + special
    values, others = zip(*map(parameter_values, points))
    return BifurcationCurve(kind, values, others, (behind.ended, ahead.ended), tuple(special))
