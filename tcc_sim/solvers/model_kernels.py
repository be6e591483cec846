"""Kernels of the model's equations, compiled from their only text."""

import math

import numpy as np

from tcc_sim.compiling.compiled import compiled, rebound
from tcc_sim.model import equations, friction, profile

# By np.exp: two of math.exp become one of a row, with other bits than in C.
decayed = compiled(rebound(friction.decayed, exp=np.exp))
exponentials_at = compiled(rebound(friction.exponentials_at, decayed=decayed))
steepness = compiled(rebound(friction.steepness, decayed=decayed))
step_and_rest = compiled(rebound(friction.step_and_rest, exp=math.exp, magnitude=abs, with_sign=math.copysign))
with_slope = compiled(friction.with_slope)
step_at, largest_ratio = compiled(friction.step_at), compiled(friction.largest_ratio)
step_after = compiled(rebound(friction.step_after, step_at=step_at))
smoothed_coefficient = compiled(rebound(friction.smoothed_coefficient, exponentials_at=exponentials_at))
smoothed_and_slope = compiled(rebound(friction.smoothed_and_slope, exponentials_at=exponentials_at,
                                      with_slope=with_slope))
engine_torque = compiled(equations.engine_torque)
saturation_torque = compiled(equations.saturation_torque)
lost_torque = compiled(equations.lost_torque)
accelerations = compiled(rebound(equations.accelerations, lost_torque=lost_torque))
reached, swelling = compiled(profile.reached), compiled(profile.swelling)
