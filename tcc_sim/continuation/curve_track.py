"""Rules for following a curve of bifurcations in two parameters: segments, points of codimension two, and ends.

A point of codimension two is listed where its test function has two signs, each of which is resolved: larger than the
changes that other difference steps and one more Newton step make.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tcc_sim.continuation.bordered import MinimallyAugmented
from tcc_sim.continuation.bracket import CurvePoint, turned_round
from tcc_sim.continuation.codim2_points import (
    ENDING,
    SpecialPoint,
    change_of_events,
    events_of,
    measured,
    parameters,
    singular_end,
    special_point,
    values_of_tests,
)
from tcc_sim.continuation.follow import Bounds, Continuation, End, StopReason, segments_fit
from tcc_sim.continuation.palc import (
    Equations,
    StepSize,
    corrector,
    null_direction,
    oriented,
    solution_at,
)
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.sliding import differ


class CurveTrack(Continuation[CurvePoint, SpecialPoint]):
    """One direction of a curve of bifurcations, or of the border of pure stick, in two parameters."""

    named = 1
    cut_to = math.inf
    """Growth over a segment below which failed steps have cut the orbit at the last point."""

    def __init__(self, first: CurvePoint, bounds: Bounds, step_size: StepSize | None = None) -> None:
        super().__init__(first, bounds, step_size)
        self.signs: dict[str, list[tuple[CurvePoint, float]]] = {}
        """Points and values of each test, since the last change of its sign."""
        self._test(first)

    def unresolved(self, new: CurvePoint) -> End | None:
        """The end before a motion along a part of which disturbances grow beyond double precision."""
        if not len(new.solution.found.blocks) or growth_over_parts(new.solution.found.blocks) <= self.settings.canard:
            return None
        return self.end(StopReason.CANARD_CURVE, limit=self.settings.canard)

    def special_between(self, new: CurvePoint) -> list[SpecialPoint]:
        """The special points up to `new`, in order."""
        here = self.here
        if not isinstance(here.equations, MinimallyAugmented):
            return []
        if here.equations.shooting.map.piecewise and differ(events_of(here), events_of(new)):
            self.signs.clear()
            self._test(new)
            return [change_of_events(here.equations, here, new)]
        way = new.solution.z - here.solution.z
        return sorted(self._test(new), key=lambda s: float(way @ s.point.solution.z))

    def _test(self, new: CurvePoint) -> list[SpecialPoint]:
        """Evaluate the tests at a point, and locate special points where their signs have changed."""
        out: list[SpecialPoint] = []
        for name, value in values_of_tests(new).items():
            known = self.signs.setdefault(name, [])
            if not known or known[-1][1] * value > 0.0:
                known.append((new, value))
            else:
                out += self._crossed(name, new)
        return out

    def _crossed(self, name: str, new: CurvePoint) -> list[SpecialPoint]:
        """The special point between the last point at which a test is resolved and a new one with another sign."""
        def test(point: CurvePoint, longer: float) -> float:
            return values_of_tests(point, longer)[name]

        known, factor, before = self.signs[name], self.settings.resolved, 0.0
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
        apart = ENDING.get((getattr(new.equations, "kind", ""), name))
        end = None if apart is None else singular_end(name, self.points, apart, new)
        return [end or special_point(name, last, new, test)]

    def ended_by(self, new: CurvePoint, special: list[SpecialPoint],
                 stop: End | None) -> tuple[CurvePoint, list[SpecialPoint], End | None]:
        """The end of the curve in a special point, or at its first point."""
        equations = self.here.equations
        if isinstance(equations, MinimallyAugmented):
            last = next((s for s in special if (equations.kind, s.kind) in ENDING), None)
            if equations.doubled:
                halves = equations.between_halves(self.here.solution.z)
                if turned_round(halves, equations.between_halves(new.solution.z), equations.settings.opposite):
                    last = singular_end("generalised_doubling", self.points, self._apart(equations), new)
                    special = [*special, *([] if last is None else [last])]
            if last is not None:
                return last.point, special, self._ended_in(last)
        if self.passes_start(new):
            return self.points[0], special, stop or self.end(StopReason.CLOSED, self.points[0])
        return new, special, stop

    def _ended_in(self, special: SpecialPoint) -> End:
        """The end at a special point."""
        return replace(self.end(StopReason.SPECIAL, special.point), what=special.kind.replace("_", " "))

    def lost(self) -> tuple[list[SpecialPoint], End]:
        """The special point and the end where no step succeeds."""
        # Folds of doubled motions of amplitude a lie within a^2 of a generalised doubling, where they meet the
        # doublings of the halves, so that the equations are singular.
        equations, here = self.here.equations, self.here
        if not isinstance(equations, MinimallyAugmented) or not equations.doubled:
            return super().lost()
        apart = self._apart(equations)
        special = singular_end("generalised_doubling", self.points, apart) if apart(
            here) <= self.settings.halves_met else None
        return ([special], self._ended_in(special)) if special is not None else super().lost()

    def _apart(self, equations: MinimallyAugmented) -> Callable[[CurvePoint], float]:
        """The distance between the halves of an orbit, along that of the last point."""
        halves = equations.between_halves(self.here.solution.z)
        unit = halves / max(float(np.linalg.norm(halves)), 1e-300)
        return lambda s: float(unit @ equations.between_halves(s.solution.z))

    def went_on(self, before: CurvePoint, corner: bool) -> None:
        """Update predictor and borders for a new last point, and cut its orbit into other segments where needed."""
        super().went_on(before, corner)
        self.cut_to, here = math.inf, self.here
        if isinstance(here.equations, MinimallyAugmented):
            here.equations.update_borders(here.solution.z, here.solution.found)
            self._remesh(others=(len(self.points) - 1) % self.settings.fewer_after == 0)

    def cut_anew(self) -> bool:
        """Cut the orbit into segments over which disturbances grow less; return whether there are any."""
        # Where disturbances grow by 1e3 in slip and stick removes them within one segment, its derivative is not large,
        # but changes within 1e-5, and its error is the state's over that length. Curves pass cusps only in segments
        # over which disturbances grow by about 10.
        equations = self.here.equations
        if not isinstance(equations, MinimallyAugmented):
            return False
        for growth in equations.settings.finer_growths:
            if growth <= equations.shooting.settings.growth and growth < self.cut_to:
                self.cut_to = growth
                if self._remesh(growth):
                    self.step_size.length = self.settings.flat_step
                    return True
        return False

    def _remesh(self, growth: float | None = None, others: bool = False) -> bool:
        """Cut the last orbit into other segments if growth is large, above `growth`, or `others` may do."""
        here, old = self.here, self.here.equations
        if not isinstance(old, MinimallyAugmented) or not len(here.solution.found.blocks):
            return False
        settings, shooting = old.settings, old.shooting
        # Only a thorough search finds growth that the same segment removes again.
        others = others and (settings.thorough or len(shooting.segments) > 1)
        if segments_fit(shooting, here.solution.found.blocks, settings, others or growth is not None):
            return False
        if growth is not None:
            shooting = replace(shooting, settings=replace(shooting.settings, growth=growth, thorough=True))
        try:
            finer, z = shooting.cut(here.solution.z[:old.unknowns])
            if finer.segments == shooting.segments:
                return False
            other = MinimallyAugmented(old.kind, finer, z)
            start = np.append(z, here.solution.z[-1:]) if old.turning else z
            found = other.linearise(start)
            other.update_borders(start, found, old)
            polished = corrector(other, start, null_direction(found))
        except FAILURES:
            return False
        if polished is None:
            return False
        # The first node and the parameters do not depend on the segments; the other nodes have the motion's errors.
        sign = 1.0 if float(old.outer(here.solution.tangent) @ other.outer(polished.tangent)) > 0.0 else -1.0
        self.points[-1] = CurvePoint(solution_at(polished.z, polished.found, sign * polished.tangent), other)
        self.before = []
        self.note(self._test(self.here))
        return True


def start_of_curve(equations: Equations, u: Floats) -> CurvePoint:
    """The first point of a curve, without a direction."""
    found = equations.linearise(u)
    return CurvePoint(solution_at(u, found, null_direction(found)), equations)


def facing(point: CurvePoint, forward: bool) -> CurvePoint:
    """The point with the tangent along which the second parameter grows, or falls."""
    growing = float(parameters(point, point.solution.tangent)[1]) > 0.0
    return point if growing == forward else point.moved(oriented(point.solution, -point.solution.sign))


def growth_over_parts(blocks: Floats) -> float:
    """The largest growth of a disturbance from any node to a later one within a period; blocks (m, n, n)."""
    count, most = len(blocks), 0.0
    ahead = np.broadcast_to(np.eye(blocks.shape[1]), blocks.shape)
    for k in range(count):
        ahead = np.roll(blocks, -k, axis=0) @ ahead
        most = max(most, float(np.abs(ahead).max()))
    return most
