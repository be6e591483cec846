"""Dense samples of a run for pictures, solved again from each of its samples."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from tcc_sim.analysis.settings import DEFAULTS as ANALYSIS
from tcc_sim.errors import OutOfRange
from tcc_sim.model import equations, friction
from tcc_sim.model.parameters import System
from tcc_sim.solvers import solve
from tcc_sim.solvers.fixed_step import advance
from tcc_sim.solvers.per_cycle import hermite
from tcc_sim.solvers.terms import Terms, stick_speed_of, substeps, terms_of, torques_at
from tcc_sim.trajectory import Floats, State, Trajectory, modes_of

SAMPLES = 2000
"""Points per engine cycle in a picture, at least: the friction torque passes its maximum within a thousandth of a
cycle.
"""
SAME = 1e-3
"""Largest distance of a step solved again from the next sample, relative to each maximum; else it is interpolated."""


def last_cycles(solved: Trajectory, count: int, samples: int = SAMPLES) -> Trajectory:
    """Solve the last `count` whole cycles of a run again with samples, from the section point where they start.

    A run that is shorter than a cycle or has no sections is returned unchanged.
    """
    cycles = solved.cycles
    if cycles is None or not len(cycles) or solved.system is None:
        return solved
    first = max(len(cycles) - count, 0)
    begin = math.ceil(float(solved.t[0]) / solved.cycle - 1e-9)
    solution = solve(solved.system, cycles=len(cycles) - first, start_cycle=begin + first, samples_per_cycle=samples,
                     state=State.of(cycles.section[first]))
    return solution.raise_for_status()


def between(recorded: Trajectory, samples: int = SAMPLES) -> Trajectory:
    """Return a run with at least `samples` points per engine cycle, the recorded ones included.

    Every tick is solved from the state recorded before it, with the scene's excitation or, where an input comes from a
    topic, with the value recorded at the end of the tick, which the tick applied. If the solution misses the next
    recorded state (parameters were changed, or the law is set-valued), cubics with the accelerations of (2a) and (2b),
    monotone in stick, interpolate the speeds, and straight lines the friction torque. In stick the friction torque is
    the interface torque, at which the slip acceleration is 0: the law's own torque, a small slip speed times a steep
    slope, overshoots where a tick ends right after the clutch has stuck. NaN separates the samples beside a gap.
    """
    t, system = recorded.t, recorded.system
    steps = np.diff(t)
    if system is None or len(t) < 3:
        return recorded
    tick = float(np.median(steps))
    points = max(math.ceil(samples * tick / recorded.cycle - 1e-9), 1)  # A solved tail has exactly as many.
    if points == 1:
        return recorded
    share = np.arange(1, points + 1) / points
    whole = steps < ANALYSIS.gap * tick
    times = t[:-1, None] + share * steps[:, None]
    terms = terms_of(system)
    known = np.stack([recorded.slip_speed, recorded.plate_angle, recorded.plate_speed], axis=1)
    states = _solved(recorded, system, known, points, whole)
    size = np.maximum(np.nanmax(np.abs(known), axis=0), 1e-12)
    wrong = ~(np.abs(states[:, -1] - known[1:]) <= SAME * size).all(axis=1)
    states[wrong] = _interpolated(recorded, terms, times[wrong].ravel()).reshape(-1, points, 3)
    states[~whole] = math.nan
    states[:, -1] = known[1:]
    engine, load = _excitation(recorded, system, times, share)
    torque = _friction(recorded, terms, states, engine, load, share)
    columns = {"t": times, "slip_speed": states[..., 0], "plate_angle": states[..., 1], "plate_speed": states[..., 2],
               "engine_torque": engine, "saturation_torque": load, "friction_torque": torque}
    sampled: dict[str, Any] = {name: np.concatenate([getattr(recorded, name)[:1], rest.ravel()])
                               for name, rest in columns.items()}
    return replace(recorded, **sampled, flywheel_angle=None,
                   state=modes_of(np.nan_to_num(sampled["slip_speed"]), stick_speed_of(terms)))


def _solved(recorded: Trajectory, system: System, known: Floats, points: int, whole: np.ndarray) -> Floats:
    """Return (n - 1, points, 3) states in every tick, NaN where the real-time solver does not apply."""
    terms = terms_of(system)
    out = np.full((len(recorded.t) - 1, points, 3), math.nan)
    if terms.smoothing is None:
        return out
    engine, load = recorded.engine_torque.tolist(), recorded.saturation_torque.tolist()
    topics = system.engine.source == "topic", system.pressure.source == "topic"
    fine = np.empty((0, 3))
    for k in np.flatnonzero(whole).tolist():
        applied = _applied(terms, engine[k + 1] if topics[0] else None, load[k + 1] if topics[1] else None)
        if applied is None:
            continue
        step = float(recorded.t[k + 1] - recorded.t[k])
        try:
            n = points * math.ceil(substeps(applied, step) / points)
        except OutOfRange:
            continue
        if len(fine) != n:
            fine = np.empty((n, 3))
        advance(known[k].copy(), float(recorded.t[k]), step / n, n, applied, None, fine)
        out[k] = fine[n // points - 1::n // points]
    return out


def _applied(terms: Terms, engine: float | None, load: float | None) -> Terms | None:
    """Return the terms of one tick; None if an input that it applied was not recorded."""
    if engine is not None:
        terms = terms._replace(mean_torque=engine)
    if load is not None:
        terms = terms._replace(mean_load=load)
    return terms if math.isfinite(terms.mean_torque) and math.isfinite(terms.mean_load) else None


def _excitation(recorded: Trajectory, system: System, times: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Return engine and saturation torque at `times`, (n - 1, points): from the scene, or held over each tick if from a
    topic; the engine torque is interpolated where the scene's differs from the recorded one.
    """
    engine, load = torques_at(terms_of(system), times)
    ends = recorded.engine_torque
    other = np.abs(engine[:, -1] - ends[1:]) > SAME * np.nanmax(np.abs(ends), initial=1e-12)
    engine = np.where(other[:, None], ends[:-1, None] + share * (ends[1:] - ends[:-1])[:, None], engine)
    if system.engine.source == "topic":
        engine = np.broadcast_to(recorded.engine_torque[1:, None], times.shape)
    if system.pressure.source == "topic":
        load = np.broadcast_to(recorded.saturation_torque[1:, None], times.shape)
    return engine, load


def _friction(recorded: Trajectory, terms: Terms, states: Floats, engine: Floats, load: Floats,
              share: Floats) -> Floats:
    """Return the friction torque in every tick: law (7), in stick the interface torque; set-valued: interpolated."""
    ends = recorded.friction_torque
    linear = ends[:-1, None] + share * (ends[1:] - ends[:-1])[:, None]
    if terms.smoothing is None:
        return linear
    law = np.asarray(friction.smoothed_coefficient(states[..., 0], terms.smoothing, terms.stribeck)) * load
    stuck = np.abs(states[..., 0]) <= stick_speed_of(terms)
    needed = equations.interface_torque(states[..., 1], states[..., 2], engine, terms.linear)
    most = friction.largest_ratio(terms.stribeck) * load
    return np.where(stuck & (np.abs(needed) <= most), needed, np.where(np.isfinite(load), law, linear))


def _interpolated(recorded: Trajectory, terms: Terms, at: Floats) -> Floats:
    """Interpolate states at times `at`, (m, 3), with the accelerations that follow from the recorded torques."""
    t, v, angle, speed = recorded.t, recorded.slip_speed, recorded.plate_angle, recorded.plate_speed
    slip, plate = equations.accelerations(v, angle, speed, recorded.engine_torque, recorded.friction_torque,
                                          terms.linear)
    chord = np.diff(v) / np.diff(t)
    before, after = np.concatenate([chord[:1], chord]), np.concatenate([chord, chord[-1:]])
    # A monotone cubic where the clutch sticks: F. N. Fritsch and R. E. Carlson (1980), SIAM J. Numer. Anal. 17.
    bound = np.where(before * after > 0.0, 3.0 * np.minimum(np.abs(before), np.abs(after)), 0.0)
    stuck = recorded.state == 0
    near = stuck | np.concatenate([[False], stuck[:-1]]) | np.concatenate([stuck[1:], [False]])
    slip = np.where(near, np.clip(slip, -bound, bound), slip)
    return np.stack([hermite(at, t, v, slip), hermite(at, t, angle, speed), hermite(at, t, speed, plate)], axis=1)
