"""How small changes of the state and of the scene's numbers pass through the steps of the smoothed engine.

The method is differentiated, not the equations again solved. A series step is differentiated coefficient by
coefficient: with Ts mubar'(v) as a series of its own the recurrences of the motion are linear in the changes. A
collocation step is differentiated at its nodes, which needs the matrix of its last Newton step once more. Changes are
kept in lanes, four at a time: those of slip speed, plate angle and plate speed at the start, and those by numbers of
the scene.

At the edges of the regions, of the clamp and at v = 0 the accelerations are continuous, so nothing jumps there.

An engine frequency that changes is taken at constant phase: within a step time is constant and the torques change by
s Te'(s) d(omega)/omega, s from the start of the step; at its end the time changes by -s d(omega)/omega.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.solvers.collocation import NODES, TERMS
from tcc_sim.solvers.compiling.unrolled import unrolled
from tcc_sim.solvers.key_derivatives import NUMBERS
from tcc_sim.solvers.series import (
    COLUMNS,
    FRICTION_ORDER_MAXIMUM,
    LOAD,
    ORDER_MAXIMUM,
    SLIP,
    exponential,
    hyperbolic,
    product,
    total,
)

LANES = 4

LAW, STIFFNESS_OF_LAW, RISING, FALLEN, TORQUE, LOADED, SCRATCH = range(7)
"""Rows of coefficients: mubar; Ts mubar'; (1 + E) (1 - T^2); F T with E = (r - 1) F; what Te and Ts change by; room."""

ON_FLYWHEEL, ON_CLUTCH, ON_PLATE = range(3)
"""Changes of torque: on the flywheel, of friction, on the plate."""

CHANGES = np.dtype([("now", np.float64, (3, LANES)), ("by", np.float64, (len(NUMBERS), LANES)), ("forced", np.int64),
                    ("rows", np.float64, (3, COLUMNS, LANES)), ("torques", np.float64, (3, COLUMNS, LANES)),
                    ("nodes", np.float64, (LANES, NODES)), ("applied", np.float64, (LANES, NODES)),
                    ("peak", np.float64, LANES)])
"""Four lanes of changes.

now : of slip speed, plate angle, plate speed
by : of the numbers of `key_derivatives`; `forced` has a bit for every lane of a key
rows, torques : over a series step, coefficients of the changes of the state, and of the torques ON_...
nodes, applied : at the nodes of a collocation step, change of slip speed, and torque on flywheel and plate together
peak : of the largest |slip speed| of the cycle
"""

SHARED = np.dtype([("series", np.float64, (7, COLUMNS)), ("basis", np.float64, TERMS), ("slip", np.float64, NODES + 1),
                   ("angle", np.float64, NODES), ("speed", np.float64, NODES), ("peak", np.float64),
                   ("averaged", np.int64), ("slopes", np.float64, 3), ("reach", np.float64)])
"""Room that the lanes share: rows LAW to SCRATCH; Chebyshev polynomials where a step is asked, and what the slip speeds
at its nodes add there to slip speed (that at the start first), plate angle and plate speed + kappa slip speed; the
largest |slip speed| of the cycle so far; whether the integrals of `sensitivity_carried.add_slopes` are asked for, and
they; the longest series step that shows a sine by whose amplitude there are derivatives, s.
"""


class Tangent(NamedTuple):
    """What the kernel carries along: an array of CHANGES (groups,), SHARED, the torque's share in a collocation step
    (`collocation.Response.torque`), and per cycle the change of the largest |slip speed|, (cycles, groups,
    LANES).
    """

    groups: NDArray[Any]
    shared: Any
    torque: NDArray[np.float64]
    peaks: NDArray[np.float64]


def friction_text(rows: Any, parts: Any, decay: Any, factor: Any, excess: Any, sigma: Any, tanh: Any, sech: Any,
                  pulsation: Any) -> Iterator[int]:
    """Coefficients of mubar, Ts mubar' and its parts along a motion, in the rows LAW to FALLEN of `parts`.

    Parameters
    ----------
    rows : coefficients of the motion and of Ts
    decay, factor, excess : rate -alpha sgn(v) and value of F = exp(-alpha |v|), r - 1; None without a Stribeck term
    sigma, tanh, sech : sigma, T = tanh(sigma v), 1 - T^2; sigma is None where T does not vary
    pulsation : None where Ts does not vary
    """
    f, t, s = [factor], [tanh], [sech]
    weighted: list[Any] = [0.0]
    load: list[Any] = []
    slopes: list[Any] = []
    for k in range(FRICTION_ORDER_MAXIMUM):
        if k > 0:
            weighted.append(float(k) * rows[SLIP, k])
            if decay is not None:
                exponential(decay, weighted, f, k)
            if sigma is None:
                t.append(0.0)
            else:
                hyperbolic(sigma, weighted, t, s, k)
        law, fallen, rising = t[k], 0.0, 0.0 if sigma is None else s[k]
        slope: Any = 0.0
        if decay is not None:
            fallen = f[k] * t[0] if sigma is None else product(f, t, k)
            law = law + excess * fallen
            slope = decay * (excess * fallen)
            if sigma is not None:
                rising = rising + excess * product(f, s, k)
        if sigma is not None:
            slope = slope + sigma * rising
        slopes.append(slope)
        load.append(rows[LOAD, k] if k == 0 or pulsation is not None else 0.0)
        parts[LAW, k], parts[FALLEN, k], parts[RISING, k] = law, fallen, rising
        parts[STIFFNESS_OF_LAW, k] = product(load, slopes, k) if pulsation is not None else load[0] * slope
        if k % 2 == 1 and 8 <= k + 1 < FRICTION_ORDER_MAXIMUM:
            yield k + 1


def changes_text(out: Any, parts: Any, torques: Any, unit: Any, linear: Any, forced: Any) -> Iterator[int]:
    """Coefficients of the changes of slip speed, plate angle and plate speed by equations (2), four lanes at once.

    Parameters
    ----------
    out : (3, COLUMNS, LANES) array; coefficient 0 is given
    parts : rows of which STIFFNESS_OF_LAW is used; None where friction does not depend on the slip speed
    torques : (3, COLUMNS, LANES) array, changes of the torques, used where `forced` is not None
    """
    flywheel, plate = unit / linear[0], unit / linear[1]
    v, x, u = [out.row(0, 0)], [out.row(1, 0)], [out.row(2, 0)]
    last = ORDER_MAXIMUM if parts is None else FRICTION_ORDER_MAXIMUM
    for k in range(last):
        friction: Any = 0.0
        if parts is not None:
            friction = total([parts[STIFFNESS_OF_LAW, j] * v[k - j] for j in range(k, -1, -1)])
        pull = linear[2] * u[k] + linear[3] * x[k]
        push: Any = 0.0
        if forced is not None:
            friction = friction + torques.row(ON_CLUTCH, k)
            pull, push = pull - torques.row(ON_PLATE, k), torques.row(ON_FLYWHEEL, k)
        pull, push = friction - pull, push - friction
        part = 1.0 / (k + 1)
        v.append(part * (flywheel * push - plate * pull))
        u.append(part * plate * pull)
        x.append(part * unit * u[k])
        for i, series in enumerate((v, x, u)):
            out.set_row(series[k + 1], i, k + 1)
        if k % 2 == 1 and 8 <= k + 1 < last:
            yield k + 1


expand_friction = unrolled(friction_text)
expand_changes = unrolled(changes_text)
