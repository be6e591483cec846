"""Ticks of the real-time solver from many starts, with the exact derivatives of the discrete solution.

The text of a sub-step (`fixed_step.stages`) is run on numbers that carry their derivatives (`law.Changing`), so
that no derivative of the method is written out. The count of sub-steps is held. The scalar equation v + a mubar(v) = w
of a stage has a rule of its own, by the implicit function theorem: (1 + a mubar'(v)) dv = dw - mubar da - a dmubar.
Sub-steps are small enough for one root, so that 1 + a mubar' is above 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.compiling.compiled import compiled, rebound
from tcc_sim.compiling.unrolled import unrolled, where
from tcc_sim.model import equations
from tcc_sim.model.equations import Linear
from tcc_sim.model.profile import LOAD, TORQUE
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers.changes import CHANGES, LANES, changing_linear
from tcc_sim.solvers.fixed_step import GAMMA, break_after, plate_of, slip_over_all, stage, stages, with_means
from tcc_sim.solvers.law import FRICTION, NUMBERS_OF_ALL, OF_SLIP, Changing, mubar_at, numbers_of
from tcc_sim.solvers.series import added
from tcc_sim.solvers.terms import Terms, for_ticks
from tcc_sim.trajectory import Floats


def law_of_stages(law: Any, speeds: Any, sigma: Any, stribeck: Any) -> None:
    """Fill the rows of `law` with mubar and its derivatives at three slip speeds; staged function."""
    for n, v in enumerate(speeds):
        mubar = mubar_at(v, where(v, ">", 0.0, 1.0, -1.0), sigma, stribeck)
        law[n, FRICTION] = mubar.value
        for cause in (OF_SLIP, *numbers_of(stribeck)):
            law[n, cause] = mubar.change[cause]


def changed_step(now: Any, by: Any, law: Any, start: Any, speeds: Any, torques: Any, loads: Any, h: Any, linear: Linear,
                 stribeck: Any) -> None:
    """Carry four derivatives over a sub-step; staged function.

    now, by : (3, LANES) and (len(NUMBERS), LANES) derivatives of the state and of the numbers of the equations
    law : see `law_of_stages`
    start : v, theta2, omega2
    speeds, torques, loads : v, Te, Ts of the three stages
    """
    solved = iter(enumerate(speeds))
    by_load = [by.row(of.MEAN_LOAD) * where(load, ">", 0.0, 1.0, 0.0) + by.row(of.LOG_LOAD) * load for load in loads]
    applied = iter([(Changing(torque, by.row(of.MEAN_TORQUE)), Changing(load, change))
                    for torque, load, change in zip(torques, loads, by_load)])

    def root(w: Changing, a: Changing, *_: Any) -> tuple[Changing, int]:
        """Return the slip speed of a stage with its derivatives."""
        n, v = next(solved)
        shares = [by.row(number) * law[n, cause] for cause, number in numbers_of(stribeck).items()]
        change = w.change - a.change * law[n, FRICTION] - added(shares) * a.value
        return Changing(v, change * (1.0 / (1.0 + a.value * law[n, OF_SLIP]))), 0

    names: dict[str, Any] = {"scalar_root": root, "torques_now": lambda *_: next(applied), "piece_at": lambda *_: 0}
    time = Changing(h)
    part = changing_linear(linear, by)
    names["lost_torque"] = equations.lost_torque
    names["slip_over_all"] = rebound(slip_over_all, lost_torque=equations.lost_torque)
    plate = rebound(plate_of, **names)(time * GAMMA, part)
    state = [Changing(number, now.row(i)) for i, number in enumerate(start)]
    terms = Terms(linear=part, mean_torque=0.0, torque=None, harmonics=None, mean_load=0.0, pulsation=None,
                  smoothing=None, stribeck=None)
    step = rebound(stages, stage=rebound(stage, **names), **names)
    after = step(*state, 0.0, time, plate, terms)
    for i, number in enumerate(after[10:13]):
        now.set_row(number.change, i)


expand_law, change_step = unrolled(law_of_stages), unrolled(changed_step)


@compiled
def _sub_step(state: Floats, start: float, h: float, plate: tuple[float, float, float, float, float, float],
              terms: Terms, groups: Any, law: Floats) -> None:
    """Carry the state and its derivatives, those of `groups`, over one step of SDIRK3."""
    v0, theta0, omega0 = state[0], state[1], state[2]
    v1, _, _, engine1, load1, v2, _, _, engine2, load2, v, theta, omega, engine, load, _, _ = \
        stages(v0, theta0, omega0, start, h, plate, terms)
    speeds, torques, loads = (v1, v2, v), (engine1, engine2, engine), (load1, load2, load)
    expand_law(0, law, speeds, terms.smoothing, terms.stribeck)
    for g in range(groups.shape[0]):
        change_step(0, groups[g].now, groups[g].by, law, (v0, theta0, omega0), speeds, torques, loads, h, terms.linear,
                    terms.stribeck)
    state[0], state[1], state[2] = v, theta, omega


@compiled
def _over(terms: Terms, profile: Floats | None, torque: float, load: float) -> Terms:
    """Return `terms` with more engine torque and saturation torque; `profile` is room for that of the sum."""
    if profile is not None:
        for i in range(len(profile)):
            profile[i, TORQUE] = terms.profile[i, TORQUE] + torque  # type: ignore[index]
            profile[i, LOAD] = terms.profile[i, LOAD] + load  # type: ignore[index]
    return with_means(terms, terms.mean_torque + torque, terms.mean_load + load, profile)


@compiled
def _keep(state: Floats, groups: Any, values: Floats, derivatives: Floats) -> None:
    for i in range(3):
        values[i] = state[i]
        for g in range(groups.shape[0]):
            for lane in range(LANES):
                derivatives[i, g * LANES + lane] = groups[g].now[i, lane]


@compiled
def _advance(starts: Floats, first: float, step: float, n: int, terms: Terms, profile: Floats | None, held: Floats,
             states: Floats, derivatives: Floats, state: Floats, groups: Any, law: Floats) -> None:
    """Fill `states` and `derivatives`; see `advance_windows`."""
    h, width = step / n, states.shape[1] - 1
    whole = plate_of(h * GAMMA, terms.linear)
    for j in range(len(starts)):
        for g in range(groups.shape[0]):
            groups[g].now[:] = 0.0
        for i in range(3):
            state[i] = starts[j, i]
            groups[0].now[i, i] = 1.0
        _keep(state, groups, states[j, 0], derivatives[j, 0])
        for k in range(width):
            tick = j * width + k
            for i in range(n):
                start, left = first + tick * step + i * h, h
                # An input that is linear over the tick is held over each sub-step at its value in the middle.
                share = (i + 0.5) / n
                applied = _over(terms, profile, held[tick, 0, 0] + share * (held[tick, 1, 0] - held[tick, 0, 0]),
                                held[tick, 0, 1] + share * (held[tick, 1, 1] - held[tick, 0, 1]))
                part = break_after(profile, start, left)
                while part < left:
                    _sub_step(state, start, part, plate_of(part * GAMMA, terms.linear), applied, groups, law)
                    start += part
                    left -= part
                    part = break_after(profile, start, left)
                _sub_step(state, start, left, whole if left == h else plate_of(left * GAMMA, terms.linear), applied,
                          groups, law)
            _keep(state, groups, states[j, k + 1], derivatives[j, k + 1])


def advance_windows(starts: Floats, first: float, step: float, width: int, n: int, terms: Terms, held: Floats | None,
                    by: Floats) -> tuple[Floats, Floats]:
    """Advance every window of `width` ticks from its start; one window follows the other in time.

    starts : (m, 3) slip speed, plate angle, plate speed
    first, step : time of the first window's start and length of a tick, s
    n : sub-steps of a tick
    terms : of the smoothed law
    held : (m width, 2, 2) engine torque and saturation torque, N m, at the start and at the end of each tick, linear
        between, beside those of `terms`, whose sum with the latter is at least 0; None where there are none
    by : (len(NUMBERS), P) derivatives of the numbers of the equations by the keys (`key_derivatives`); those of the
        sines' amplitudes, phase and frequency are not used
    returns : the states, (m, width + 1, 3), and their derivatives by the window's start and by the keys, (m, width + 1,
        3, 3 + P)
    """
    shape, count = (len(starts), width + 1, 3), 3 + by.shape[1]
    groups = np.zeros(-(-count // LANES), CHANGES)
    columns = np.zeros((len(by), len(groups) * LANES))
    columns[:, 3:count] = by
    groups["by"] = columns.reshape(len(by), len(groups), LANES).transpose(1, 0, 2)
    states, derivatives = np.empty(shape), np.empty((*shape, columns.shape[1]))
    if held is None:
        held = np.zeros((len(starts) * width, 2, 2))
    terms = for_ticks(terms)
    _advance(starts, first, step, n, terms, None if terms.profile is None else terms.profile.copy(), held, states,
             derivatives, np.empty(3), groups, np.empty((3, len(NUMBERS_OF_ALL) + 2)))
    return states, derivatives[..., :count]
