"""Engine and saturation torque at a time, as compiled functions of it: with a course, by the piece that it lies in."""

from __future__ import annotations

import numpy as np

from tcc_sim.solvers.compiling.compiled import compiled, engine_torque, reached, saturation_torque
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import Floats


@compiled
def torques_now(t: float, piece: int, course: Floats | None, terms: Terms) -> tuple[float, float]:
    """Te and Ts at time t; with a course, by its piece of this number."""
    if course is None:
        return (engine_torque(t, terms.mean_torque, terms.torque, terms.harmonics),
                saturation_torque(t, terms.mean_load, terms.pulsation))
    else:
        angle, mean_torque, mean_load = reached(t, course[piece])
        return (engine_torque(angle, mean_torque, terms.torque, terms.harmonics),
                saturation_torque(angle, mean_load, terms.pulsation))


@compiled
def piece_at(course: Floats | None, t: float) -> int:
    """The number of the piece of the course that holds at time t; 0 where there is none."""
    if course is None:
        return 0
    else:
        return int(max(np.searchsorted(course[:, 0], t, side="right") - 1, 0))


@compiled
def break_after(course: Floats | None, t: float, h: float) -> float:
    """How far the next corner or jump of the course is from time t, at most h seconds."""
    if course is None:
        return h
    else:
        following = np.searchsorted(course[:, 0], t, side="right")
        if following == len(course) or not course[following, 0] - t < h * (1.0 - 1e-9):
            return h
        return float(max(course[following, 0] - t, 1e-9 * h))
