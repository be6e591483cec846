"""How a step and an event of the exact engine change with the state and with the numbers of the equations.

Over a step the coefficients of its polynomials are differentiated (`changes`). At an event the change is taken over by
a saltation matrix (R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer
2004, Section 7.2): S = I + (f+ - f-) e_v^T/v'- where slip ends, I where it begins, the field being continuous there
since mubar(0+) = mu_s/mu_k.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.changes import LANES, Rows, carry_slip, changing, linear_of
from tcc_sim.solvers.compiling.changing import Changing
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.compiling.unrolled import unrolled
from tcc_sim.solvers.event_driven.step import Step, stuck
from tcc_sim.solvers.excitation import Pulsation
from tcc_sim.solvers.key_derivatives import EXCESS_RATIO
from tcc_sim.solvers.series import INVERSE, SLIP
from tcc_sim.solvers.terms import Terms
from tcc_sim.trajectory import FREE, STICK

CONVERGED = 1e-10
"""Last terms of the friction's exponential, of its first, up to which its series counts as the exponential."""
SMALL = 0.02
"""mu_s/mu_k - 1 up to which the motion need not show that exponential, though its derivatives do."""


def changed_stick(rows: Any, changes: Any, now: Any, by: Any, sines: Any, unit: Any, linear: Linear, ratio: Any,
                  pulsation: Any, margins: Any) -> Iterator[int]:
    """`step.stuck` and what changes in it; staged function."""
    yield from stuck(Rows(rows, changes, now, by, sines, unit, pulsation, margins), Changing(unit),
                     linear_of(linear, by), changing(ratio, by, EXCESS_RATIO), pulsation)


expand_stick_changes = unrolled(changed_stick)


@fast
def unresolved(step: Step, mode: int, stribeck: Stribeck, rows: Any, room: Any) -> bool:
    """Whether the last terms of exp(-alpha |v|) over a step count, where mu_s - mu_k is too small for the motion to
    show them; `room` takes them.
    """
    if stribeck is None or len(stribeck) > 2 or abs(stribeck[0]) > SMALL:
        return False
    room[0], power = 1.0, 1.0
    for k in range(1, step.degree):
        room[k], power = 0.0, power * step.x
        for j in range(1, k + 1):
            room[k] -= stribeck[1] * mode * j * rows[SLIP, j] * room[k - j] * INVERSE[k]
    return bool(max(abs(room[step.degree - 2]) / step.x, abs(room[step.degree - 1])) * power > CONVERGED)


@fast
def carry(mode: int, falls: bool, step: Step, ratio: float, terms: Terms, groups: Any, along: Any, rows: Any,
          pulsation: Pulsation, stribeck: Stribeck, margins: bool) -> None:
    """Coefficients of all changes over a step, and in stick of the margins to breakaway where they are asked for;
    `along` is a record of ALONG, whose sines are filled.
    """
    order, unit, sign = step.degree, step.unit, 0.0 if mode == FREE else float(mode)
    if mode == STICK:
        for i in range(groups.shape[0]):
            group = groups[i]
            for k in range(order + 1):
                for lane in range(LANES):
                    group.rows[SLIP, k, lane] = 0.0
            if margins:
                expand_stick_changes(order, rows, group.rows, group.now, group.by, along.sines, unit, terms.linear,
                                     ratio, pulsation, True)
            else:
                expand_stick_changes(order, rows, group.rows, group.now, group.by, along.sines, unit, terms.linear,
                                     ratio, pulsation, None)
    elif stribeck is None or not falls:
        carry_slip(order, unit, sign, groups, along, rows, terms.linear, pulsation, None, None, 0.0, 0.0)
    else:
        carry_slip(order, unit, sign, groups, along, rows, terms.linear, pulsation, stribeck, None, 0.0, 0.0)


@fast
def land(mode: int, following: int, state: Any, drive: Any, ratio: float, linear: Linear, groups: Any) -> bool:
    """Saltation where slip in direction `mode` ends at v = 0 and the mode is `following`; False where v' is 0 there."""
    flywheel, plate, damping, stiffness = linear
    spring = damping * state.plate_speed + stiffness * state.plate_angle
    friction = mode * ratio * drive.load
    speed_rate = (friction - spring) / plate
    slip_rate = (drive.torque - friction) / flywheel - speed_rate
    if slip_rate == 0.0:
        return False
    new_rate, share = (drive.torque - spring) / (flywheel + plate), 0.0
    if following != STICK:
        friction = following * ratio * drive.load
        new_rate = (friction - spring) / plate
        share = ((drive.torque - friction) / flywheel - new_rate) / slip_rate
    for b in range(groups.shape[0]):
        now = groups[b].now
        for lane in range(LANES):
            now[2, lane] += (new_rate - speed_rate) / slip_rate * now[0, lane]
            now[0, lane] *= share
    return True
