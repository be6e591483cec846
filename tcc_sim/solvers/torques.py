"""Torques at a time since cycle 0, by a whole profile: engine torque; saturation torque, also of an actuator that
approaches a command; and the pull of a moving far end of the shaft.
"""

from __future__ import annotations

import numpy as np

from tcc_sim.compiling.compiled import compiled, engine_torque, saturation_torque, swelling
from tcc_sim.compiling.compiled import reached as reached_unfused
from tcc_sim.model.equations import Linear
from tcc_sim.model.profile import FAR_ANGLE, FAR_RATE, FAR_SPEED
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import Floats

START, BEFORE, RISE, RATE = range(4)
"""Columns of an approach: time, s, at which the load is BEFORE, N m; after t s it is BEFORE + RISE (1 - exp(-RATE t)),
or BEFORE + RISE t where RATE, 1/s, is 0.
"""


@compiled
def torques_now(t: float, piece: int, profile: Floats | None, terms: Terms) -> tuple[float, float]:
    """Return Te and Ts at time t; with a profile, by its piece of this number."""
    if profile is None:
        return (engine_torque(t, terms.mean_torque, terms.torque, terms.harmonics),
                load_on_approach(t, saturation_torque(t, terms.mean_load, terms.pulsation), terms.approach))
    else:
        angle, mean_torque, mean_load = reached_unfused(t, profile[piece])
        mean_torque = mean_torque + swelling(t, angle, profile[piece])
        return (engine_torque(angle, mean_torque, terms.torque, terms.harmonics),
                load_on_approach(t, saturation_torque(angle, mean_load, terms.pulsation), terms.approach))


@compiled
def load_on_approach(t: float, load: float, approach: Floats | None) -> float:
    """Return Ts at time t: `load`, or that of an actuator whose pressure approaches a command."""
    if approach is None:
        return load
    else:
        past, rate = t - approach[0, START], approach[0, RATE]
        share = past
        if rate > 0.0:
            share = 1.0 - np.exp(-rate * past)
        return float(np.maximum(approach[0, BEFORE] + approach[0, RISE] * share, 0.0))


@compiled
def pull_of_far_end(t: float, far: Floats | None, piece: int, linear: Linear) -> float:
    """Return C23 w3 + K23 theta3 at time t, N m, the torque of the moving far end of the shaft on the plate."""
    if far is None:
        return 0.0
    else:
        row = min(piece, len(far) - 1)
        past = t - far[row, START]
        angle = far[row, FAR_ANGLE] + past * (far[row, FAR_SPEED] + 0.5 * far[row, FAR_RATE] * past)
        return float(linear.damping * (far[row, FAR_SPEED] + far[row, FAR_RATE] * past) + linear.stiffness * angle)


@compiled
def piece_at(profile: Floats | None, t: float) -> int:
    """Return the number of the piece of the profile at time t; 0 without a profile."""
    if profile is None:
        return 0
    else:
        return int(max(np.searchsorted(profile[:, 0], t, side="right") - 1, 0))


@compiled
def break_after(profile: Floats | None, t: float, h: float) -> float:
    """Return the time from t to the next corner or jump of the profile, at most h, s."""
    if profile is None:
        return h
    else:
        following = np.searchsorted(profile[:, 0], t, side="right")
        if following == len(profile) or not profile[following, 0] - t < h * (1.0 - 1e-9):
            return h
        return float(max(profile[following, 0] - t, 1e-9 * h))
