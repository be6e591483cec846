"""Where on a branch the event sequence changes: bracketed by the sequences, then solved for by the margin that vanishes.

The orbit's equations with the margin as one more are regular up to the border from the side on which the margin is
defined, so Newton's method on them finds it; it goes nine tenths of the way at a time, so as not to leave that side.
"""

from __future__ import annotations

import numpy as np

from tcc_sim.studies.bifurcations import Bifurcation, Chord, Station, station_at
from tcc_sim.studies.continuation import point_at, tangent_of
from tcc_sim.studies.event_borders import border_residual, differ, kind_of_change, margin_of, ring
from tcc_sim.studies.maps import FAILURES, Floats, Margins
from tcc_sim.studies.shooting import Linearised, Shooting

HALVINGS, MORE_HALVINGS = 24, 20
"""Halvings of the bracket before Newton's method, and further ones where it does not get through."""
CLOSED = 1e-11
"""Residual of the orbit itself, in natural sizes, at which it counts as closed."""
LEFT_OVER = 0.1
"""Share of the margin that a Newton step leaves."""
CLOSE = 1e-12
"""Margin, relative to its natural size, at which a border counts as found."""
FINEST = 1e-12
"""Distance from the border, in natural sizes, below which it is not resolved where the margin changes very fast (on a
canard: slip that follows the falling branch of friction); that distance is the residual then."""
ITERATIONS = 40
ASTRAY = 10.0
"""Distance from the bracket, in its lengths, beyond which another border has been found."""


def event_border(chord: Chord) -> tuple[Station, Station, Bifurcation | None]:
    """The stations on both sides of a change of the event sequence, and the bifurcation there.

    None where the change is none of friction (the pressure meeting 0).
    """
    low, high = 0.0, 1.0
    left, right = chord.a, chord.b
    for count in (HALVINGS, MORE_HALVINGS):
        for _ in range(count):
            middle = 0.5 * (low + high)
            station = chord.at(middle)
            if station is None:
                break
            if differ(station.orbit.seen.events, chord.a.orbit.seen.events):
                high, right = middle, station
            else:
                low, left = middle, station
        events = left.orbit.seen.events, right.orbit.seen.events
        if differ(events[0].replace("F", ""), events[1].replace("F", "")) is False:
            return left, right, None
        near = margins_at(left), margins_at(right)
        kind = kind_of_change(*events, near)
        found = solved(kind, left, right, near)
        if found is not None:
            return left, right, found
    at = left if left.orbit.residual <= right.orbit.residual else right
    return left, right, Bifurcation(kind, at, max(border_residual(kind, near), at.orbit.residual))


def margins_at(station: Station) -> Margins:
    """The margins of a station's orbit."""
    orbit = station.orbit
    return station.shooting.map.margins(orbit.section, orbit.values, 0, orbit.period)


def solved(kind: str, left: Station, right: Station, near: tuple[Margins, Margins]) -> Bifurcation | None:
    """The border between two stations by Newton's method on its own margin; None where that does not get through."""
    name = margin_of(kind)
    if any(not m.slopes for m in near):
        return None
    sides = [(s, m) for s, m in zip((left, right), near) if np.isfinite(getattr(m, name))]
    if not sides:
        return None
    # The margin that is to vanish belongs to the side without the event that it would make.
    start, margin = min(sides, key=lambda side: (len(ring(side[0].orbit.seen.events)), abs(getattr(side[1], name))))
    shooting, z = start.shooting, start.point.z
    apart = max(float(np.linalg.norm(right.point.z - left.point.z)), 1e-9)
    one_sided = name != "arrival"
    try:
        for _ in range(ITERATIONS):
            found, value = shooting.linearise(z), float(getattr(margin, name))
            if abs(value) <= CLOSE and float(np.abs(found.residual).max()) <= CLOSED:
                return located(kind, start, z, found, abs(value))
            matrix = np.vstack([found.jacobian, gradient(shooting, z, margin, name)])
            keep = LEFT_OVER if one_sided and abs(value) > CLOSE else 0.0
            step = np.linalg.solve(matrix, np.append(-found.residual, (keep - 1.0) * value))
            distance = float(np.linalg.norm(step))
            if distance <= FINEST and abs(value) > CLOSE:
                return located(kind, start, z, found, distance)
            for part in (1.0, 0.5, 0.25, 0.1, 0.03):
                trial = z + part * step
                x, values = shooting.nodes(trial)[0], shooting.values(trial)
                margin = shooting.map.margins(x, values, 0, shooting.period)
                events = shooting.map.observe(x, values, 0, shooting.period).events
                if one_sided and differ(events, start.orbit.seen.events):
                    continue
                if abs(getattr(margin, name)) <= 2.0 * abs(value) + CLOSE:
                    z = trial
                    break
            else:
                return None
            if float(np.linalg.norm(z - start.point.z)) > ASTRAY * apart:
                return None
    except FAILURES:
        return None
    return None


def gradient(shooting: Shooting, z: Floats, margins: Margins, name: str) -> Floats:
    """Derivatives of a margin by the scaled unknowns."""
    by_state, by_parameter = margins.slopes[name]
    out, size = np.zeros(len(z)), shooting.size
    out[:shooting.map.dimension] = by_state * shooting.map.scales
    out[size:] = by_parameter * np.array([w.width(float(u)) for w, u in zip(shooting.windows, z[size:])])
    return out


def located(kind: str, near: Station, z: Floats, found: Linearised, margin: float) -> Bifurcation:
    """The bifurcation at a solution."""
    station = station_at(near.shooting, point_at(z, found, tangent_of(found, near.point.tangent)))
    return Bifurcation(kind, station, max(margin, station.orbit.residual))
