"""Rules for following a branch of periodic orbits: corners, segments, families of motions, and ends."""

from __future__ import annotations

import numpy as np

from tcc_sim.continuation.follow import Continuation, End, StopReason, segments_fit
from tcc_sim.continuation.newton import newton, shifts
from tcc_sim.continuation.palc import (
    Solution,
    StepSize,
    next_solution,
    null_direction,
    oriented,
    solution_at,
    tangent_of,
)
from tcc_sim.continuation.problem import FAILURES, Floats
from tcc_sim.continuation.shooting import Linearised
from tcc_sim.continuation.sliding import differ
from tcc_sim.continuation.special_points import (
    Bifurcation,
    ContinuationPoint,
    period_doubling_end,
    point_at,
    special_points_between,
)


class BranchTrack(Continuation[ContinuationPoint, Bifurcation]):
    """One direction of a branch of periodic orbits along one parameter."""

    cut_at = 0
    """Number of points when a failed step last cut the orbit into other segments."""

    def first_again(self) -> list[tuple[Floats, Floats]]:
        """Unknowns and tangent of single shooting at the first orbit, for every cycle in which it may begin."""
        out, first = super().first_again(), self.here
        shooting, z = first.shooting, first.solution.z
        of, size, tangent = shooting.map, shooting.size, shooting.outer(first.solution.tangent)
        x, values = shooting.nodes(z)[0], shooting.values(z)
        sizes = np.concatenate([of.scales, shooting.widths(z)])
        for k, shifted in enumerate(shifts(of, x, values, shooting.period)[1:], 1):
            image = of.evaluate(x, values, 0, k * of.forcing_period)
            way = np.concatenate([image.derivatives @ (sizes * tangent) / of.scales, tangent[of.dimension:]])
            out.append((np.concatenate([shifted / of.scales, z[size:]]), way / float(np.linalg.norm(way))))
        return out

    def reached(self, solution: Solution, by_amplitude: bool = True) -> ContinuationPoint:
        """The point of a solution after the last point."""
        return point_at(self.here.shooting, solution, by_amplitude)

    def unresolved(self, new: ContinuationPoint) -> End | None:
        """The end before a point with a multiplier that double precision does not resolve."""
        if abs(new.orbit.multipliers[0]) <= self.settings.canard:
            return None
        return self.end(StopReason.CANARD, limit=self.settings.canard)

    def special_between(self, new: ContinuationPoint) -> list[Bifurcation] | None:
        """The bifurcations up to `new`; None where the step has skipped a piece of the branch."""
        return special_points_between(self.here, new) if self.settings.detect else []

    def ended_by(self, new: ContinuationPoint, special: list[Bifurcation],
                 stop: End | None) -> tuple[ContinuationPoint, list[Bifurcation], End | None]:
        """The end of the branch where the orbit's period becomes shorter, or at its first point."""
        shorter = period_doubling_end(self.here, new) if self.here.solution.sign != new.solution.sign else None
        if shorter is not None:
            # Beyond it the branch is its own shift: the multiplier of 1 there is no fold and no branch point.
            special, span = [f for f in special if f.kind not in ("branch_point", "fold")], shorter.shooting.ranges[0]
            while not special and self.special and self.special[-1][1].kind in ("branch_point", "fold") and abs(
                    span.scaled(self.special[-1][1].value) - span.scaled(shorter.value)) < self.settings.same_end:
                self.special.pop()
            return shorter, special, stop or self.end(StopReason.DOUBLING, shorter)
        if self.passes_start(new):
            return self.points[0], special, stop or self.end(StopReason.CLOSED, self.points[0])
        return new, special, stop

    def stuck(self) -> End | None:
        """The end where some length of the branch has motions with a multiplier of 1 at one parameter."""
        # Two points do not show it: beside a doubling, where the parameter grows as the square of the length, it hardly
        # changes and a multiplier is 1 as well.
        last, settings = self.here, self.settings
        for point in reversed(self.points):
            if abs(point.slope) > settings.family or np.abs(point.orbit.multipliers - 1.0).min() > settings.family:
                return None
            away = (last.orbit.section - point.orbit.section) / last.shooting.map.scales
            if float(np.linalg.norm(away)) >= settings.family_length:
                return self.end(StopReason.FAMILY)
        return None

    def went_on(self, before: ContinuationPoint, corner: bool) -> None:
        """Update the predictor for a new last point, and cut its orbit into other segments where needed."""
        here = self.here
        super().went_on(before, corner or (before.shooting.map.piecewise
                                           and differ(before.orbit.seen.events, here.orbit.seen.events)))
        finer = None if corner else remeshed(here, len(self.points))
        if finer is not None:
            self.points[-1], self.before = finer, []

    def cut_anew(self) -> bool:
        """Cut the orbit into other segments where no step succeeds; return whether there are any."""
        # A segment may start at an onset of slip, and Newton's method then alternates between two event sequences. The
        # onset moves along a branch, so segments are cut by growth. This passes the canards behind both folds of period
        # two, with either law.
        if self.cut_at == len(self.points):
            return False
        self.cut_at, here = len(self.points), self.here
        other = remeshed(here, len(self.points), anew=True)
        if other is None or other.shooting.segments == here.shooting.segments:
            return False
        self.points[-1], self.step_size.length, self.before = other, here.shooting.settings.flat_step, []
        return True

    def beyond_corner(self) -> ContinuationPoint | None:
        """The next point beyond a change of the event sequence at which the branch has a corner; None without one."""
        # An end of slip that passes phase 0 is a corner too, as motions that stick there have no slip speed.
        here, shooting = self.here, self.here.shooting
        if not shooting.map.piecewise:
            return None
        for beside in self.settings.beside:
            try:
                found = shooting.linearise(here.solution.z + beside * here.solution.tangent)
                along = oriented(solution_at(here.solution.z, found, null_direction(found)), here.solution.sign).tangent
                z = here.solution.z + beside * along
                events = shooting.map.observe(shooting.nodes(z)[0], shooting.values(z), 0, shooting.period).events
            except FAILURES:
                continue
            new = None if events == here.orbit.seen.events else self._beyond(found, along, beside)
            if new is not None:
                return new
        return None

    def _beyond(self, found: Linearised, along: Floats, beside: float) -> ContinuationPoint | None:
        """The next point beyond a corner at the last one; None where none is found."""
        # found : derivative `beside` the corner; where it belongs to neither piece, the one along the other piece
        here, shooting, z = self.here, self.here.shooting, self.here.solution.z
        for known in (found, None):
            short = StepSize(shooting.settings, length=beside, smallest=shooting.settings.corner_step)
            try:
                start = known or shooting.linearise(z + beside * along)
                moved = next_solution(shooting, solution_at(z, start, tangent_of(start, along)), [], short, False)
                new = None if moved is None else point_at(shooting, moved, False)
            except FAILURES:
                continue
            if new is not None and new.orbit.seen.events != here.orbit.seen.events:
                self.step_size.length = short.length
                return new
        return None


def remeshed(point: ContinuationPoint, count: int, anew: bool = False) -> ContinuationPoint | None:
    """The point in other segments where the growth over one is large, or `anew`; None where the segments stay.

    count : number of points so far; fewer segments are tried now and then
    """
    shooting, blocks = point.shooting, point.solution.found.blocks
    fewer = len(shooting.segments) > 1 and count % shooting.settings.fewer_after == 0
    if segments_fit(shooting, blocks, shooting.settings, fewer or anew):
        return None
    finer, z = shooting.cut(point.solution.z)
    if len(finer.segments) == len(shooting.segments) and (
            not anew and segments_fit(shooting, blocks, shooting.settings, False)):
        return None
    polished = newton(finer, z)
    if polished is None:
        return None
    found = finer.linearise(polished)
    along, n = np.zeros(len(z)), shooting.map.dimension
    along[:n], along[-1] = point.solution.tangent[:n], point.solution.tangent[-1]
    return point_at(finer, solution_at(polished, found, tangent_of(found, along)))
