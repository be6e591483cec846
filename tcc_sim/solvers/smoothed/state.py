"""What the smoothed kernel changes as it goes: named fields of one-element arrays, each one pointer in compiled
code.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tcc_sim.solvers.bernstein import WORKSPACE
from tcc_sim.solvers.series import COLUMNS, ROWS
from tcc_sim.solvers.smoothed.collocation_tables import FROM_WAVES, NODES, TERMS

ACCEPTED, REFUSED, FAILED = range(3)
"""How a step ends: taken; to be tried again with the method and the length now in `control`; no step is possible."""

SERIES, CREEP, STIFF = range(3)
"""Methods: Taylor series; collocation in stick, on the slow manifold; collocation where the linear part is stiff."""

SLIDING, FALLING, LAYER = range(3)
"""Regions by |v|: mubar is constant, its exponential varies, tanh varies too."""

WAVES_MAXIMUM = 33
"""Sines of the engine torque: the first and 32 harmonics."""

STATE = np.dtype([("slip_speed", np.float64), ("plate_angle", np.float64), ("plate_speed", np.float64),
                  ("flywheel_angle", np.float64), ("tau", np.float64)])
"""The motion, SI units; tau is the time into the engine cycle."""

CONTROL = np.dtype([("method", np.int64), ("level", np.int64), ("slope", np.float64), ("released", np.float64),
                    ("waited", np.int64), ("calm", np.int64),
                    ("last", np.float64), ("streak", np.int64), ("patience", np.int64), ("slip_before", np.float64),
                    ("slip_now", np.float64), ("speed_before", np.float64), ("speed_now", np.float64),
                    ("unsettled", np.float64)])
"""What steps are chosen by.

method, level : the method now, and the rung of the next collocation step
slope : rate rho = beta Ts mubar' at the end of the last collocation step, 1/s
released : that rate when stick was left for the series; 0 where nothing keeps it from coming back
waited, calm : series steps in the layer since then, and after how many it may come back all the same
last, streak, patience : length of the last series step, how many of one length there were, and how many are borne
slip_before, slip_now, speed_before, speed_now : largest |v| and |theta2'| in the cycle before and in this one
unsettled : where changes are carried along, what they have still to decay by before stick is stepped over, in powers
    of e
"""

COUNTERS = np.dtype([("steps", np.int64), ("rejected", np.int64), ("iterations", np.int64),
                     ("iterations_max", np.int64)])

WORK = np.dtype([
    ("rows", np.float64, (ROWS, COLUMNS)), ("bernstein", np.float64, WORKSPACE),
    ("slip", np.float64, NODES), ("law", np.float64, NODES), ("slope", np.float64, NODES), ("grip", np.float64, NODES),
    ("balance", np.float64, NODES), ("demand", np.float64, NODES), ("change", np.float64, NODES),
    ("chebyshev", np.float64, TERMS), ("measure", np.float64, 2),
                 ("weights", np.float64, FROM_WAVES + 2 * WAVES_MAXIMUM)])
"""Work space.

rows, bernstein : the polynomials of a step, in powers of its time, and what searches on them need
slip, law, slope, grip : at the nodes, V, mubar(V), mubar'(V) and beta Ts
balance, demand : at the nodes, b without the share of v(0), and b/(beta Ts), what mubar would be without inertia
change, measure : Newton's correction of V; sizes named in `stages`
chebyshev : coefficients over the step of the polynomial in hand
weights : how much of every source there is
"""


class Memory(NamedTuple):
    """What one solve changes as it goes; `drive` is that of `excitation`, `output` that of `step_output`."""

    state: Any
    control: Any
    drive: Any
    work: Any
    counters: Any
    output: Any


class Place(NamedTuple):
    """Where the state is: its region, the sign of v, and the errors of v and theta2' that a step may leave."""

    region: int
    sign: float
    slip_tolerance: float
    speed_tolerance: float


class Step(NamedTuple):
    """A step: how it ended, its unit of time (s), its length in that unit, the degree of its polynomials, its error
    relative to what is allowed.
    """

    status: int
    unit: float
    x: float
    degree: int
    error: float
