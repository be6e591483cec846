"""Limits of bifurcations of the smoothed law as sigma goes to infinity.

A bifurcation is traced in 1/sigma, from the scene's sigma towards 0, and extrapolated; or it exists only at finite
sigma. A branch of the set-valued law through the extrapolated motion then gives the limit, if it has a bifurcation of
the same kind within the error of the extrapolation.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from tcc_sim.result import reported
from tcc_sim.study.continuation.bordered import MinimallyAugmented
from tcc_sim.study.continuation.branch import branch_through, first_point
from tcc_sim.study.continuation.codim2_points import AugmentedPoint, with_error
from tcc_sim.study.continuation.curves import TRACED, CurveTrack, facing, start_of_curve
from tcc_sim.study.continuation.follow import End, StopReason
from tcc_sim.study.continuation.palc import corrector
from tcc_sim.study.continuation.problem import FAILURES, Floats, ParameterMap
from tcc_sim.study.continuation.settings import Settings
from tcc_sim.study.continuation.shooting import ParameterRange, Shooting
from tcc_sim.study.continuation.special_points import Bifurcation


@dataclass(frozen=True)
class Limit:
    """The value of the parameter as sigma goes to infinity."""

    value: float | None = field(metadata=reported(
        "value as sigma goes to infinity; null where there is none, or none was found", "{over}", name="limit"))
    error: float | None = field(default=None, metadata=reported("error of the limit", "{over}", name="limit_error"))
    why: str = field(default='', metadata=reported(
        "that the bifurcation is one of the smoothing, or why its limit was not found; else empty", name="limit_why"))

    def __str__(self) -> str:
        """In words."""
        return self.why if self.value is None or self.error is None else f"limit {with_error(self.value, self.error)}"


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
    trace, end = _traced(found, smoothed, span, sigma)
    if not trace:
        return Limit(None, why="not found: the curve of the bifurcation over the smoothing cannot be set up")
    smoothness = np.array([smoothness_at(s) for s in trace])
    most = f"sigma = {sigma / float(smoothness.min()):.6g}"
    if end.reason is StopReason.RANGE and end.name == span.name:
        return Limit(None, why=f"not found: it is {settings.limit_farthest:g} ranges away at {most}")
    if end.reason is StopReason.SPECIAL or (end.reason is StopReason.RANGE and smoothness[-1] > 0.5):
        return Limit(None, why=f"of the smoothing: there is none beyond {most}")
    # Parameter, and state at phase 0 in natural sizes.
    places = np.array([[span.value(float(u[n])), *u[:smoothed.dimension]]
                       for u, n in ((s.solution.z, s.equations.size) for s in trace)])
    extrapolated = _extrapolated(smoothness, places, settings)
    if extrapolated is None:
        return Limit(None, why=f"not found: the curve of the bifurcation was lost at {most}")
    limits, errors = extrapolated
    width = span.high - span.low
    limit, error = float(limits[0]), max(float(errors[0]), settings.limit_solved * width)
    own = _set_valued(found, trace[-1], places[-1], limits, error, set_valued, width)
    return Limit(limit, error) if own is None else Limit(own, settings.limit_solved * width)


def _traced(found: Bifurcation, smoothed: ParameterMap, span: ParameterRange,
            sigma: float) -> tuple[list[AugmentedPoint], End]:
    """The trace of a bifurcation towards infinite sigma, and why it ended; no points where it cannot be set up."""
    ranges, tracks = (span, ParameterRange(sigma, np.inf, inverse=True, name="friction.smoothing")), list[CurveTrack]()
    orbit, settings = found.point.orbit, found.point.shooting.settings
    first, smallest = settings.limit_steps
    settings = replace(settings, first_step=first, smallest_step=smallest, curve_step=settings.largest_step)
    shooting = replace(found.point.shooting, map=smoothed, ranges=ranges, settings=settings)
    end = End(StopReason.STEP, span.name, found.value)
    try:
        shooting, z = shooting.cut(shooting.unknowns(orbit.nodes, (orbit.values[0], sigma)))
        last = start_of_curve(MinimallyAugmented(found.kind, shooting, z))
        for landing in settings.limit_landings:
            tracks.append(CurveTrack(facing(last, False), (
                (1, landing, 1.0), (0, -settings.limit_farthest, settings.limit_farthest))))
            deque(tracks[-1].follow(), 0)
            last, end = tracks[-1].here, tracks[-1].ended
            if end.reason is not StopReason.RANGE or end.name == span.name or smoothness_at(last) > landing:
                break
    except FAILURES:
        end = replace(end, reason=StopReason.STEP)
    return [point for track in tracks for point in track.points], end


def smoothness_at(point: AugmentedPoint) -> float:
    """The scene's smoothing factor over that of a point."""
    return float(point.solution.z[point.equations.size + 1])


def _extrapolated(smoothness: Floats, places: Floats, settings: Settings) -> tuple[Floats, Floats] | None:
    """The places at infinite sigma with their errors; None for a trace that is too short."""
    # A motion leaves stick after a time of order log(sigma)/sigma, so a + b e + c e log(e) is fitted through three of
    # four points at about equal ratios; the other three, and a straight line, give the error.
    ratio = min(2.0, float(smoothness.max() / smoothness[-1]) ** (1.0 / 3.0))
    chosen = [int(np.abs(np.log(smoothness / (smoothness[-1] * ratio**k))).argmin()) for k in range(4)]
    if smoothness[-1] > min(settings.limit_least, *smoothness[:-1]) or len(set(chosen)) < 4:
        return None
    e, y = smoothness[chosen], places[chosen]
    terms = np.stack([np.ones(4), e, e * np.log(e)], axis=1)
    near, far = (np.linalg.solve(terms[k:k + 3], y[k:k + 3])[0] for k in (0, 1))
    straight = y[0] - e[0] * (y[1] - y[0]) / (e[1] - e[0])
    return near, settings.limit_safety * np.maximum(np.abs(near - far), settings.limit_gain * np.abs(near - straight))


def _set_valued(found: Bifurcation, traced: AugmentedPoint, last: Floats, limits: Floats, error: float,
                of: ParameterMap, width: float) -> float | None:
    """The nearest bifurcation of the set-valued law within the error of an extrapolation; None where there is none."""
    # The branch begins at the extrapolated motion, or at the last one of the trace, where the corrector changes the
    # parameter as much as on the smoothed law's branch. The first range lies between these two motions, where steps are
    # short enough for a canard, the second one has the whole width.
    old = traced.equations.shooting
    settings = replace(found.point.shooting.settings, growth=old.settings.growth, thorough=old.settings.thorough)
    along = np.linalg.svd(traced.solution.found.jacobian[:old.size, :old.size + 1])[2][-1]
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
                near = branch_through(first_point(finer, started.z)).bifurcations
            except FAILURES:
                continue
            away = {abs(f.value - limits[0]): f.value for f in near if f.kind == found.kind}
            if away and min(away) <= error:
                return away[min(away)]
    return None
