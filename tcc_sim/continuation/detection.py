"""What lies between two neighbouring points of a branch: bifurcations, the collapse to a shorter period, the way back.
"""

from __future__ import annotations

import numpy as np

from tcc_sim.continuation.codim2 import locate
from tcc_sim.continuation.newton import SAME, shifts
from tcc_sim.continuation.palc import point_at
from tcc_sim.continuation.problem import Floats
from tcc_sim.continuation.shooting import Shooting
from tcc_sim.continuation.sliding import differ
from tcc_sim.continuation.sliding_location import event_border
from tcc_sim.continuation.special_points import Bifurcation, Chord, Station, smooth_bifurcations, station_at


def between(a: Station, b: Station, climbing: bool = True) -> list[Bifurcation]:
    """The bifurcations between two neighbouring stations, in order."""
    if a.shooting is not b.shooting and a.shooting != b.shooting:
        return []
    chord = Chord(a, b, climbing)
    if not (a.shooting.map.piecewise and differ(a.orbit.seen.events, b.orbit.seen.events)):
        return smooth_bifurcations(chord)
    out: list[Bifurcation] = []
    for _ in range(6):
        left, right, found = event_border(chord)
        out += smooth_bifurcations(Chord(chord.a, left, climbing))
        if found is not None:
            out.append(found)
        chord = Chord(right, b, climbing)
        if not differ(right.orbit.seen.events, b.orbit.seen.events):
            break
    return out + smooth_bifurcations(chord)


def collapse(here: Station, new: Station) -> Station | None:
    """The station between two at which the orbit is one of a shorter period; None where there is none.

    What tells the halves of the orbit apart changes its sign there. It is a period doubling of the shorter motions, and
    solved as such: the branch itself is singular there.
    """
    shooting = here.shooting
    of, period = shooting.map, shooting.period
    for shorter in range(of.forcing_period, period, of.forcing_period):
        if period % shorter:
            continue
        ways = []
        for station in (here, new):
            x, values = station.orbit.section, station.orbit.values
            ways.append((of.evaluate(x, values, 0, shorter).value - x) / of.scales)
        one, two = ways
        if float(one @ two) < -0.8 * float(np.linalg.norm(one) * np.linalg.norm(two)):
            simple = Shooting.single(of, shorter, *shooting.windows)
            middle = here.orbit.section + 0.5 * one * of.scales
            z = locate("period_doubling", simple, simple.point(middle[None], here.orbit.values))
            if z is None or not np.abs(z - simple.point(middle[None], here.orbit.values)).max() < 0.1:
                return here
            whole = Shooting.single(of, period, *shooting.windows)
            point = here.point
            tangent = np.concatenate([point.tangent[:of.dimension], point.tangent[shooting.size:]])
            return station_at(whole, point_at(z, whole.linearise(z), tangent))
    return None


def returning(first: Station) -> list[tuple[Floats, Floats]]:
    """Point and tangent, both of single shooting, at which a closed branch comes back, for every shift of its orbit."""
    of, size = first.shooting.map, first.shooting.size
    n, scales = of.dimension, of.scales
    z, t = first.point.z, first.point.tangent
    x, values = first.shooting.nodes(z)[0], first.shooting.values(z)
    out = [(np.concatenate([z[:n], z[size:]]), np.concatenate([t[:n], t[size:]]))]
    width = np.array([w.width(float(u)) for w, u in zip(first.shooting.windows, z[size:])])
    for k, point in enumerate(shifts(of, x, values, first.shooting.period)[1:], 1):
        image = of.evaluate(x, values, 0, k * of.forcing_period)
        along = (image.jacobian @ (t[:n] * scales) + image.by_parameter @ (width * t[size:])) / scales
        tangent = np.concatenate([along, t[size:]])
        out.append((np.concatenate([point / scales, z[size:]]), tangent / float(np.linalg.norm(tangent))))
    return out


def returned(ends: list[tuple[Floats, Floats]], first: Station, here: Station, new: Station) -> bool:
    """Whether the step from `here` to `new` passes the first point (or the same orbit some cycles later).

    `ends` is what `returning` gives for the first point of the branch, `first`.
    """
    n, size = new.shooting.map.dimension, new.shooting.size
    for z, tangent in ends:
        p, q = (np.concatenate([s.point.z[:n], s.point.z[size:]]) for s in (here, new))
        ahead, behind = float(tangent @ (q - z)), float(tangent @ (p - z))
        if behind < 0.0 <= ahead:
            step = q - p
            part = -behind / (ahead - behind)
            if np.linalg.norm(p + part * step - z) <= 0.2 * np.linalg.norm(step) and float(step @ tangent) > 0.0:
                middle = Chord(here, new).at(part)
                if middle is not None:
                    at = np.concatenate([middle.point.z[:n], middle.point.z[size:]])
                    if np.linalg.norm(at - z) <= max(0.02 * float(np.linalg.norm(step)), SAME):
                        return True
    return False
