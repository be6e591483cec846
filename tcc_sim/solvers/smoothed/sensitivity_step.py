"""One step of the smoothed engine carries the tangent along: what changes at its start, and by the scene's numbers."""

from __future__ import annotations

import math
from typing import Any

from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers import key_derivatives as of
from tcc_sim.solvers import polynomial
from tcc_sim.solvers.collocation import DEGREE, FROM_ANGLE, FROM_SPEED, NODES, TERMS, TO_CHEBYSHEV, C, Tables
from tcc_sim.solvers.compiling.compiled import fast
from tcc_sim.solvers.series import ANGLE, ENGINE, LOAD, SLIP, SPEED, add_sine
from tcc_sim.solvers.smoothed.sensitivity_series import (
    FALLEN,
    LANES,
    LAW,
    LOADED,
    ON_CLUTCH,
    ON_FLYWHEEL,
    ON_PLATE,
    RISING,
    SCRATCH,
    TORQUE,
    expand_changes,
    expand_friction,
)
from tcc_sim.solvers.smoothed.series_step import Friction
from tcc_sim.solvers.smoothed.setup import LAYER, SLIDING, Limits, Place, Step
from tcc_sim.solvers.smoothed.stages import eliminate_rows, law_at_nodes
from tcc_sim.solvers.terms import Terms


@fast
def resolved(step: Step, place: Place, friction: Friction, rows: Any, stribeck: Stribeck, control: Any, limits: Limits,
             terms: Terms, drive: Any, reach: float) -> float:
    """The part of a series step over which the series of its changes hold too.

    The motion may have forgotten what decays: in stick it is on its slow manifold, and a step is as long as the creep's
    series allow. A change of the start, or of the scene, is not on it and decays with friction's own rate. And where
    mu_k is nearly mu_s the motion does not know the exponential that mu_s/mu_k changes it by, nor, beyond `reach`
    seconds, a sine of no amplitude.
    """
    rate = terms.linear[2] / terms.linear[1]
    if place.region == LAYER:
        rate += limits.beta * drive.load * max(friction.slope, 0.0)
    x = min(step.x, reach / step.unit)
    if rate > 0.0:
        x = min(x, limits.resolved / (rate * step.unit))
    if stribeck is not None and place.region != SLIDING:
        while stribeck[1] * (abs(rows[SLIP, 1]) + abs(rows[SLIP, 2]) * x) * x > limits.resolved:
            x *= 0.85
    control.unsettled -= rate * step.unit * x
    return x


@fast
def friction_along(order: int, rows: Any, parts: Any, region: int, v: float, sign: float, sigma: float,
                   friction: Friction, pulsation: tuple[float, float, float] | None, stribeck: Stribeck) -> None:
    """Fill the rows LAW to FALLEN for a series step in the layer or on the falling branch."""
    if stribeck is None:
        expand_friction(order, rows, parts, None, None, None, sigma, friction.tanh, friction.sech, pulsation)
    elif region == LAYER:
        expand_friction(order, rows, parts, -stribeck[1] * sign, math.exp(-stribeck[1] * sign * v), stribeck[0], sigma,
                        friction.tanh, friction.sech, pulsation)
    else:
        expand_friction(order, rows, parts, -stribeck[1] * sign, math.exp(-stribeck[1] * sign * v), stribeck[0], None,
                        sign, 0.0, pulsation)


@fast
def change_excitation(group: Any, lane: int, count: int, unit: float, loaded: bool, rows: Any, waves: Any,
                      pulsation: tuple[float, float, float] | None, drive: Any, series: Any) -> None:
    """The rows TORQUE and LOADED: coefficients of what Te and Ts change by, at constant time from the step's start."""
    by = group.by
    for k in range(count):
        series[TORQUE, k] = by[of.LOG_FREQUENCY, lane] * k * rows[ENGINE, k]
        series[LOADED, k] = 0.0
    series[TORQUE, 0] += by[of.MEAN_TORQUE, lane]
    if by[of.TORQUE_AMPLITUDE, lane] != 0.0:
        share = by[of.TORQUE_AMPLITUDE, lane]
        add_sine(series, TORQUE, count, share * waves[0].sine, share * waves[0].cosine, waves[0].rate * unit)
    if loaded:
        series[LOADED, 0] = by[of.MEAN_LOAD, lane]
        if pulsation is not None:
            if by[of.LOG_FREQUENCY, lane] != 0.0:
                for k in range(1, count):
                    series[LOADED, k] = by[of.LOG_FREQUENCY, lane] * k * rows[LOAD, k]
            share, turned = by[of.LOAD_AMPLITUDE, lane], by[of.LOAD_PHASE, lane] * pulsation[0]
            if share != 0.0 or turned != 0.0:
                add_sine(series, LOADED, count, share * drive.load_sine + turned * drive.load_cosine,
                         share * drive.load_cosine - turned * drive.load_sine, pulsation[1] * unit)


@fast
def change_law(group: Any, lane: int, count: int, sign: float, rows: Any, stribeck: Stribeck, series: Any) -> None:
    """The row SCRATCH: coefficients of what mubar changes by at constant slip speed."""
    by = group.by
    for k in range(count):
        series[SCRATCH, k] = 0.0
    if by[of.SMOOTHING, lane] != 0.0:
        for k in range(count):
            for j in range(k + 1):
                series[SCRATCH, k] += by[of.SMOOTHING, lane] * series[RISING, j] * rows[SLIP, k - j]
    if stribeck is not None:
        if by[of.EXCESS_RATIO, lane] != 0.0:
            for k in range(count):
                series[SCRATCH, k] += by[of.EXCESS_RATIO, lane] * series[FALLEN, k]
        if by[of.DECAY, lane] != 0.0:
            share = -by[of.DECAY, lane] * stribeck[0] * sign
            for k in range(count):
                for j in range(k + 1):
                    series[SCRATCH, k] += share * series[FALLEN, j] * rows[SLIP, k - j]


@fast
def change_torques(group: Any, lane: int, count: int, unit: float, constant: bool, rows: Any,
                   pulsation: tuple[float, float, float] | None, series: Any) -> None:
    """The torques of one lane over a series step; `constant` where mubar is."""
    by, torques = group.by, group.torques
    for k in range(count):
        friction = series[LAW, 0] * series[LOADED, k]
        if not constant:
            for j in range(1, k + 1):
                friction += series[LAW, j] * series[LOADED, k - j]
            friction += rows[LOAD, 0] * series[SCRATCH, k]
            if pulsation is not None:
                for j in range(1, k + 1):
                    friction += rows[LOAD, j] * series[SCRATCH, k - j]
        plate, slip = (k + 1) * rows[SPEED, k + 1] / unit, (k + 1) * rows[SLIP, k + 1] / unit
        torques[ON_CLUTCH, k, lane] = friction
        torques[ON_FLYWHEEL, k, lane] = series[TORQUE, k] - by[of.FLYWHEEL_INERTIA, lane] * (slip + plate)
        torques[ON_PLATE, k, lane] = -(by[of.PLATE_INERTIA, lane] * plate + by[of.DAMPING, lane] * rows[SPEED, k]
                                       + by[of.STIFFNESS, lane] * rows[ANGLE, k])


@fast
def carry_series(tangent: Any, place: Place, friction: Friction, step: Step, loaded: bool, limits: Limits, terms: Terms,
                 waves: Any, drive: Any, rows: Any, pulsation: tuple[float, float, float] | None,
                 stribeck: Stribeck) -> None:
    """Coefficients of all changes over a series step."""
    series, order, unit = tangent.shared.series, step.degree, step.unit
    varies = place.region != 0 and loaded
    if varies:
        friction_along(order, rows, series, place.region, rows[SLIP, 0], place.sign, limits.sigma, friction, pulsation,
                       stribeck)
    else:
        series[LAW, 0] = place.sign
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        for c in range(3):
            for lane in range(LANES):
                group.rows[c, 0, lane] = group.now[c, lane]
        if group.forced:
            for lane in range(LANES):
                if group.forced & (1 << lane):
                    change_excitation(group, lane, order, unit, loaded, rows, waves, pulsation, drive, series)
                    if varies:
                        change_law(group, lane, order, place.sign, rows, stribeck, series)
                    change_torques(group, lane, order, unit, not varies, rows, pulsation, series)
            if varies:
                expand_changes(order, group.rows, series, group.torques, unit, terms.linear, True)
            else:
                expand_changes(order, group.rows, None, group.torques, unit, terms.linear, True)
        elif varies:
            expand_changes(order, group.rows, series, None, unit, terms.linear, None)
        else:
            expand_changes(order, group.rows, None, None, unit, terms.linear, None)


@fast
def change_at_nodes(group: Any, lane: int, level: int, sign: float, loaded: bool, limits: Limits, waves: Any,
                    tables: Tables, drive: Any, work: Any, pulsation: tuple[float, float, float] | None,
                    stribeck: Stribeck) -> None:
    """Torque on flywheel and plate together, and what the balance of the nodes changes by, of one lane."""
    by, rows, turn, h = group.by, work.rows, tables.turns[level], tables.rungs[level].length
    for n in range(NODES):
        s = C[n] * h
        torque, load = by[of.MEAN_TORQUE, lane], 0.0
        if by[of.TORQUE_AMPLITUDE, lane] != 0.0:
            angle = waves[0].rate * s
            torque += by[of.TORQUE_AMPLITUDE, lane] * (
                waves[0].sine * math.cos(angle) + waves[0].cosine * math.sin(angle))
        if by[of.LOG_FREQUENCY, lane] != 0.0:
            for i in range(waves.shape[0]):
                angle = waves[i].rate * s
                torque += by[of.LOG_FREQUENCY, lane] * angle * waves[i].amplitude * (
                    waves[i].cosine * math.cos(angle) - waves[i].sine * math.sin(angle))
        if loaded:
            load = by[of.MEAN_LOAD, lane]
            if pulsation is not None:
                sine = drive.load_sine * turn.cosine[n] + drive.load_cosine * turn.sine[n]
                cosine = drive.load_cosine * turn.cosine[n] - drive.load_sine * turn.sine[n]
                turned = by[of.LOAD_PHASE, lane] + by[of.LOG_FREQUENCY, lane] * pulsation[1] * s
                load += by[of.LOAD_AMPLITUDE, lane] * sine + turned * pulsation[0] * cosine
        v, law, rising, change = work.slip[n], work.law[n], work.slope[n], 0.0
        if stribeck is not None:
            factor = math.exp(-stribeck[1] * sign * v)
            fallen = law * factor / (1.0 + stribeck[0] * factor)
            rising += stribeck[1] * sign * stribeck[0] * fallen
            change += by[of.EXCESS_RATIO, lane] * fallen - by[of.DECAY, lane] * stribeck[0] * sign * v * fallen
        change += by[of.SMOOTHING, lane] * rising * v / limits.sigma
        plate_speed = polynomial.value(rows, SPEED, DEGREE, C[n])
        plate = polynomial.value_and_slope(rows, SPEED, DEGREE, C[n])[1] / h
        slip = polynomial.value_and_slope(rows, SLIP, DEGREE, C[n])[1] / h
        pull = -(by[of.PLATE_INERTIA, lane] * plate + by[of.DAMPING, lane] * plate_speed
                 + by[of.STIFFNESS, lane] * polynomial.value(rows, ANGLE, DEGREE, C[n]))
        group.applied[lane, n] = torque - by[of.FLYWHEEL_INERTIA, lane] * (slip + plate) + pull
        group.nodes[lane, n] -= limits.beta * (law * load + pull) + work.grip[n] * change


@fast
def carry_collocation(tangent: Any, place: Place, level: int, loaded: bool, limits: Limits, waves: Any, tables: Tables,
                      drive: Any, work: Any, pulsation: tuple[float, float, float] | None, stribeck: Stribeck) -> None:
    """Changes of the slip speed at the nodes of a collocation step."""
    rung = tables.rungs[level]
    law_at_nodes(place, limits.sigma, stribeck, work)
    from_angle, from_speed = tables.sources[level, FROM_ANGLE].balance, tables.sources[level, FROM_SPEED].balance
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        now, nodes = group.now, group.nodes
        for lane in range(LANES):
            w = now[2, lane] + limits.kappa * now[0, lane]
            for n in range(NODES):
                nodes[lane, n] = now[1, lane] * from_angle[n] + w * from_speed[n] + now[0, lane] * rung.start[n]
            if group.forced & (1 << lane):
                change_at_nodes(group, lane, level, place.sign, loaded, limits, waves, tables, drive, work, pulsation,
                                stribeck)
                for m in range(NODES):
                    for n in range(NODES):
                        nodes[lane, m] += tangent.torque[level, m, n] * group.applied[lane, n]
        eliminate_rows(0, nodes, rung.coupling, work.grip, work.slope)


@fast
def look_at(x: float, rung: Any, shared: Any) -> None:
    """What the node values of a collocation step come to at x: the rows basis, slip, angle and speed of `shared`."""
    basis, t = shared.basis, 2.0 * x - 1.0
    basis[0], basis[1] = 1.0, t
    for i in range(2, DEGREE + 1):
        basis[i] = 2.0 * t * basis[i - 1] - basis[i - 2]
    for j in range(NODES + 1):
        shared.slip[j] = 0.0
        for i in range(DEGREE + 1):
            shared.slip[j] += TO_CHEBYSHEV[j, i] * basis[i]
    for j in range(NODES):
        shared.angle[j], shared.speed[j] = 0.0, 0.0
        for i in range(DEGREE + 1):
            shared.angle[j] += rung.angle[j, i] * basis[i]
            shared.speed[j] += rung.speed[j, i] * basis[i]


@fast
def end_collocation(tangent: Any, level: int, x: float, whole: bool, limits: Limits, tables: Tables) -> None:
    """All changes at x of a collocation step, its end where it is taken whole."""
    rung, shared = tables.rungs[level], tangent.shared
    if not whole:
        look_at(x, rung, shared)
    from_angle, from_speed = tables.sources[level, FROM_ANGLE], tables.sources[level, FROM_SPEED]
    for i in range(tangent.groups.shape[0]):
        group = tangent.groups[i]
        now, nodes = group.now, group.nodes
        for lane in range(LANES):
            x0, w0 = now[1, lane], now[2, lane] + limits.kappa * now[0, lane]
            forced = (group.forced & (1 << lane)) != 0
            if whole:
                v = nodes[lane, NODES - 1]
                angle = x0 * from_angle.end_angle + w0 * from_speed.end_angle
                speed = x0 * from_angle.end_speed + w0 * from_speed.end_speed
                for n in range(NODES):
                    angle += rung.end_angle[n] * nodes[lane, n]
                    speed += rung.end_speed[n] * nodes[lane, n]
                    if forced:
                        angle += tangent.torque[level, NODES + 2 * TERMS, n] * group.applied[lane, n]
                        speed += tangent.torque[level, NODES + 2 * TERMS + 1, n] * group.applied[lane, n]
            else:
                v, angle, speed = shared.slip[0] * now[0, lane], 0.0, 0.0
                for k in range(DEGREE + 1):
                    at, to = x0 * from_angle.angle[k], x0 * from_angle.speed[k]
                    at += w0 * from_speed.angle[k]
                    to += w0 * from_speed.speed[k]
                    if forced:
                        for n in range(NODES):
                            at += tangent.torque[level, NODES + k, n] * group.applied[lane, n]
                            to += tangent.torque[level, NODES + TERMS + k, n] * group.applied[lane, n]
                    angle += shared.basis[k] * at
                    speed += shared.basis[k] * to
                for n in range(NODES):
                    v += shared.slip[n + 1] * nodes[lane, n]
                    angle += shared.angle[n] * nodes[lane, n]
                    speed += shared.speed[n] * nodes[lane, n]
            now[0, lane], now[1, lane], now[2, lane] = v, angle, speed - limits.kappa * v
