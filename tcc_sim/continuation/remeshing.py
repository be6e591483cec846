"""A continuation point in other segments, as the growth over them asks for; the segments are the problem's own affair.
"""

from __future__ import annotations

import numpy as np

from tcc_sim.continuation.newton import newton
from tcc_sim.continuation.palc import solution_at, tangent_of
from tcc_sim.continuation.special_points import ContinuationPoint, point_at


def remeshed(point: ContinuationPoint, count: int, anew: bool = False) -> ContinuationPoint | None:
    """The point in other segments, where the growth over one of them is large or fewer may do, or `anew`; None where
    these stay.

    count : of points until now; fewer segments are tried now and then
    """
    shooting, settings = point.shooting, point.shooting.settings
    large = float(np.abs(point.solution.found.blocks).max()) > settings.regrowth * settings.growth
    if not shooting.map.divisible and (shooting.period == 1 or len(shooting.segments) == shooting.period):
        return None
    fewer = len(shooting.segments) > 1 and count % settings.fewer_after == 0
    if not (large or fewer or anew):
        return None
    finer, z = shooting.cut(point.solution.z)
    if len(finer.segments) == len(shooting.segments) and not (large or anew):
        return None
    polished = newton(finer, z)
    if polished is None:
        return None
    found = finer.linearise(polished)
    along, n = np.zeros(len(z)), shooting.map.dimension
    along[:n], along[-1] = point.solution.tangent[:n], point.solution.tangent[-1]
    return point_at(finer, solution_at(polished, found, tangent_of(found, along)))
