"""What lies between two neighbouring points of a branch: bifurcations, the collapse to a shorter period, the way back.
"""

from __future__ import annotations

import numpy as np

from tcc_sim.continuation.codim2 import locate
from tcc_sim.continuation.newton import SAME, shifts
from tcc_sim.continuation.palc import solution_at
from tcc_sim.continuation.problem import Floats
from tcc_sim.continuation.shooting import Shooting
from tcc_sim.continuation.sliding import differ
from tcc_sim.continuation.sliding_location import sliding_bifurcation
from tcc_sim.continuation.special_points import Bifurcation, Bracket, ContinuationPoint, point_at, smooth_bifurcations


def between(a: ContinuationPoint, b: ContinuationPoint, by_amplitude: bool = True) -> list[Bifurcation]:
    """The bifurcations between two neighbouring points, in order."""
    if a.shooting is not b.shooting and a.shooting != b.shooting:
        return []
    bracket = Bracket(a, b, by_amplitude)
    if not (a.shooting.map.piecewise and differ(a.orbit.seen.events, b.orbit.seen.events)):
        return smooth_bifurcations(bracket)
    out: list[Bifurcation] = []
    for _ in range(6):
        left, right, found = sliding_bifurcation(bracket)
        out += smooth_bifurcations(Bracket(bracket.a, left, by_amplitude))
        if found is not None:
            out.append(found)
        bracket = Bracket(right, b, by_amplitude)
        if not differ(right.orbit.seen.events, b.orbit.seen.events):
            break
    return out + smooth_bifurcations(bracket)


def collapse(here: ContinuationPoint, new: ContinuationPoint) -> ContinuationPoint | None:
    """The point between two at which the orbit is one of a shorter period; None where there is none.

    What tells the halves of the orbit apart changes its sign there. It is a period doubling of the shorter motions, and
    solved as such: the branch itself is singular there.
    """
    shooting = here.shooting
    of, period = shooting.map, shooting.period
    for shorter in range(of.forcing_period, period, of.forcing_period):
        if period % shorter:
            continue
        ways = []
        for point in (here, new):
            x, values = point.orbit.section, point.orbit.values
            ways.append((of.evaluate(x, values, 0, shorter).value - x) / of.scales)
        one, two = ways
        if float(one @ two) < -0.8 * float(np.linalg.norm(one) * np.linalg.norm(two)):
            simple = Shooting.single(of, shorter, *shooting.ranges)
            middle = here.orbit.section + 0.5 * one * of.scales
            z = locate("period_doubling", simple, simple.unknowns(middle[None], here.orbit.values))
            if z is None or not np.abs(z - simple.unknowns(middle[None], here.orbit.values)).max() < 0.1:
                return here
            whole = Shooting.single(of, period, *shooting.ranges)
            along = here.solution.tangent
            tangent = np.concatenate([along[:of.dimension], along[shooting.size:]])
            return point_at(whole, solution_at(z, whole.linearise(z), tangent))
    return None


def returning(first: ContinuationPoint) -> list[tuple[Floats, Floats]]:
    """Unknowns and tangent, of single shooting, at which a closed branch comes back, for every shift of its orbit."""
    of, size = first.shooting.map, first.shooting.size
    n, scales = of.dimension, of.scales
    z, t = first.solution.z, first.solution.tangent
    x, values = first.shooting.nodes(z)[0], first.shooting.values(z)
    out = [(np.concatenate([z[:n], z[size:]]), np.concatenate([t[:n], t[size:]]))]
    width = np.array([w.width(float(u)) for w, u in zip(first.shooting.ranges, z[size:])])
    for k, point in enumerate(shifts(of, x, values, first.shooting.period)[1:], 1):
        image = of.evaluate(x, values, 0, k * of.forcing_period)
        along = (image.jacobian @ (t[:n] * scales) + image.by_parameter @ (width * t[size:])) / scales
        tangent = np.concatenate([along, t[size:]])
        out.append((np.concatenate([point / scales, z[size:]]), tangent / float(np.linalg.norm(tangent))))
    return out


def returned(ends: list[tuple[Floats, Floats]], first: ContinuationPoint, here: ContinuationPoint,
             new: ContinuationPoint) -> bool:
    """Whether the step from `here` to `new` passes the first point (or the same orbit some cycles later).

    `ends` is what `returning` gives for the first point of the branch, `first`.
    """
    n, size = new.shooting.map.dimension, new.shooting.size
    for z, tangent in ends:
        p, q = (np.concatenate([s.solution.z[:n], s.solution.z[size:]]) for s in (here, new))
        ahead, behind = float(tangent @ (q - z)), float(tangent @ (p - z))
        if behind < 0.0 <= ahead:
            step = q - p
            part = -behind / (ahead - behind)
            if np.linalg.norm(p + part * step - z) <= 0.2 * np.linalg.norm(step) and float(step @ tangent) > 0.0:
                middle = Bracket(here, new).at(part)
                if middle is not None:
                    at = np.concatenate([middle.solution.z[:n], middle.solution.z[size:]])
                    if np.linalg.norm(at - z) <= max(0.02 * float(np.linalg.norm(step)), SAME):
                        return True
    return False
