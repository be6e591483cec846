"""Rules for following a branch of periodic orbits: corners, segments, families of motions, and ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tcc_sim.continuation.bracket import CurvePoint
from tcc_sim.continuation.follow import Continuation, End, StopReason
from tcc_sim.continuation.newton import newton, shifts
from tcc_sim.continuation.palc import null_direction, oriented, solution_at, tangent_of
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
        return super().ended_by(new, special, stop)

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
        if not corner:
            self._remesh()

    def cut_anew(self) -> bool:
        """Cut the orbit into other segments where no step succeeds; return whether there are any."""
        # A segment may start at an onset of slip, and Newton's method then alternates between two event sequences. The
        # onset moves along a branch, so segments are cut by growth. This passes the canards behind both folds of period
        # two, with either law.
        if self.cut_at == len(self.points):
            return False
        self.cut_at = len(self.points)
        if not self._remesh(anew=True):
            return False
        self.length = self.settings.flat_step
        return True

    def _remesh(self, anew: bool = False) -> bool:
        """Cut the last orbit into other segments where the growth over one is large, or `anew`; now and then fewer."""
        here, shooting, settings = self.here, self.here.shooting, self.here.shooting.settings
        blocks, count = here.solution.found.blocks, len(shooting.segments)
        fewer = count > 1 and len(self.points) % settings.fewer_after == 0
        if shooting.keeps_segments(blocks, settings.regrowth, fewer or anew):
            return False
        finer, z = shooting.cut(here.solution.z)
        if len(finer.segments) == count and not anew and shooting.keeps_segments(blocks, settings.regrowth, False):
            return False
        if anew and finer.segments == shooting.segments:
            return False
        polished = newton(finer, z)
        if polished is None:
            return False
        found = finer.linearise(polished)
        along, n = np.zeros(len(z)), shooting.map.dimension
        along[:n], along[-1] = here.solution.tangent[:n], here.solution.tangent[-1]
        self.points[-1] = point_at(finer, solution_at(polished, found, tangent_of(found, along)))
        self.before = []
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
        settings = replace(shooting.settings, first_step=beside, smallest_step=self.settings.corner_step)
        for known in (found, None):
            try:
                start = known or shooting.linearise(z + beside * along)
                short: Continuation[CurvePoint, None] = Continuation(CurvePoint(
                    solution_at(z, start, tangent_of(start, along)), replace(shooting, settings=settings)))
                moved = short.step(by_amplitude=False)
                new = None if moved is None else here.moved(moved, by_amplitude=False)
            except FAILURES:
                continue
            if new is not None and new.orbit.seen.events != here.orbit.seen.events:
                self.length = short.length
                return new
        return None
