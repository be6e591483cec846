"""Samples of a run for pictures: gaps where messages were lost, and points between samples."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import OutOfRange
from tcc_sim.model import equations, friction
from tcc_sim.model.parameters import System
from tcc_sim.solvers.fixed_step import advance_ticks
from tcc_sim.solvers.terms import Terms, for_ticks, stick_speed_of, substeps, terms_of, torques_at
from tcc_sim.trajectory import Floats, Trajectory, modes_of

SAMPLES = 2000
"""Points per engine cycle in a picture, at least: the friction torque passes its maximum within a thousandth of a
cycle.
"""
SAME = 1e-3
"""Largest distance of a step solved again from the next sample, relative to each maximum; else a line joins them."""
COLUMNS = ("t", "slip_speed", "plate_angle", "plate_speed", "engine_torque", "saturation_torque", "friction_torque",
           "state")


def sliced(run: Trajectory, part: slice) -> Trajectory:
    """Return consecutive samples of a run."""
    columns: dict[str, Any] = {name: getattr(run, name)[part] for name in COLUMNS}
    return replace(run, **columns, flywheel_angle=None, output_angle=None, output_speed=None, cycles=None)


def with_gaps(run: Trajectory) -> Trajectory:
    """Return a run with a sample of NaN wherever messages between two samples were lost."""
    gaps = np.flatnonzero(np.diff(run.t) > run.largest_step) + 1
    if not len(gaps):
        return run
    columns: dict[str, Any] = {name: np.insert(values, gaps, 0 if name == "state" else math.nan) for name in (
        *COLUMNS, "output_angle", "output_speed") if (values := getattr(run, name)) is not None}
    columns["t"][gaps + np.arange(len(gaps))] = 0.5 * (run.t[gaps - 1] + run.t[gaps])
    return replace(run, **columns, flywheel_angle=None)


def stuck_in(run: Trajectory) -> NDArray[np.bool_]:
    """Return which samples are in stick, (n,); one whose slip speed is unknown is not."""
    stuck: NDArray[np.bool_] = (run.state == 0) & np.isfinite(run.slip_speed)
    return stuck


def between(recorded: Trajectory, samples: int = SAMPLES) -> Trajectory:
    """Return a run with at least `samples` points per engine cycle, the recorded ones included.

    Every tick is solved from the state recorded before it, with the scene's excitation or, where an input comes from a
    topic, with the value recorded at the end of the tick, which the tick applied. If the solution misses the next
    recorded state (parameters were changed, or the law is set-valued), straight lines join the two. In stick the
    friction torque is the interface torque, at which the slip acceleration is 0: the law's own torque, a small slip
    speed times a steep slope, overshoots where a tick ends right after the clutch has stuck. NaN separates the samples
    beside lost messages.
    """
    recorded = with_gaps(recorded)
    t, system = recorded.t, recorded.system_at(recorded.t[0])
    steps = np.diff(t)
    if system is None or len(t) < 3:
        return recorded
    points = max(math.ceil(samples * float(np.median(steps)) / recorded.cycle - 1e-9), 1)
    if points == 1:
        return recorded
    share = np.arange(1, points + 1) / points
    times = t[:-1, None] + share * steps[:, None]
    terms = terms_of(system)
    known = np.stack([recorded.slip_speed, recorded.plate_angle, recorded.plate_speed], axis=1)
    states = _solved(recorded, system, known, points)
    size = np.maximum(np.nanmax(np.abs(known), axis=0, initial=0.0), 1e-12)
    missed = ~(np.abs(states[:, -1] - known[1:]) <= SAME * size).all(axis=1)
    states[missed] = known[:-1][missed][:, None] + share[:, None] * np.diff(known, axis=0)[missed][:, None]
    states[:, -1] = known[1:]
    engine, load = _excitation(recorded, system, times, share)
    torque = _friction(recorded, terms, states, engine, load, share, missed)
    unknown = ~(np.isfinite(known[1:]).all(axis=1) & np.isfinite(known[:-1]).all(axis=1))
    for values, ends in ((engine, recorded.engine_torque), (load, recorded.saturation_torque),
                         (torque, recorded.friction_torque)):
        values[unknown] = math.nan
        values[:, -1] = ends[1:]
    mode = modes_of(np.where(np.isfinite(states[..., 0]), states[..., 0], math.inf), stick_speed_of(terms))
    mode[:, -1] = recorded.state[1:]
    columns: dict[str, Any] = {
        "t": times, "slip_speed": states[..., 0], "plate_angle": states[..., 1], "plate_speed": states[..., 2],
        "engine_torque": engine, "saturation_torque": load, "friction_torque": torque, "state": mode}
    sampled: dict[str, Any] = {name: np.concatenate([getattr(recorded, name)[:1], rest.ravel()])
                               for name, rest in columns.items()}
    return replace(recorded, **sampled, flywheel_angle=None, output_angle=None, output_speed=None)


def _solved(recorded: Trajectory, system: System, known: Floats, points: int) -> Floats:
    """Return (n - 1, points, 3) states in every tick, NaN where the real-time solver does not apply."""
    terms = terms_of(system)
    out = np.full((len(recorded.t) - 1, points, 3), math.nan)
    if terms.smoothing is None:
        return out
    engine, load = recorded.engine_torque.tolist(), recorded.saturation_torque.tolist()
    topics = system.engine.source == "topic", system.pressure.source == "topic"
    fine = np.empty((0, 3))
    finite: Any = np.isfinite(known).all(axis=1)
    for k in np.flatnonzero(finite[:-1] & finite[1:]).tolist():
        applied = terms._replace(mean_torque=engine[k + 1] if topics[0] else terms.mean_torque,
                                 mean_load=load[k + 1] if topics[1] else terms.mean_load)
        if not (math.isfinite(applied.mean_torque) and math.isfinite(applied.mean_load)):
            continue  # An input that the tick applied was not recorded.
        step = float(recorded.t[k + 1] - recorded.t[k])
        try:
            n = points * math.ceil(substeps(applied, step) / points)
        except OutOfRange:
            continue
        if len(fine) != n:
            fine = np.empty((n, 3))
        advance_ticks(known[k].copy(), float(recorded.t[k]), step, 0, 1, n, for_ticks(applied), None, fine)
        out[k] = fine[n // points - 1::n // points]
    return out


def _excitation(recorded: Trajectory, system: System, times: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Return engine and saturation torque at `times`, (n - 1, points): from the scene, or held over each tick if from a
    topic; a line from sample to sample where the scene's differs from the recorded one.
    """
    out = []
    for source, ends, of_scene in ((system.engine.source, recorded.engine_torque, 0),
                                   (system.pressure.source, recorded.saturation_torque, 1)):
        if source == "topic":
            out.append(np.broadcast_to(ends[1:, None], times.shape).copy())
            continue
        values = torques_at(terms_of(system), times)[of_scene]
        other = ~(np.abs(values[:, -1] - ends[1:]) <= SAME * np.nanmax(np.abs(ends), initial=1e-12))
        out.append(np.where(other[:, None], ends[:-1, None] + share * np.diff(ends)[:, None], values))
    return out[0], out[1]


def _friction(recorded: Trajectory, terms: Terms, states: Floats, engine: Floats, load: Floats,
              share: Floats, missed: NDArray[np.bool_]) -> Floats:
    """Return the friction torque in every tick: law (7), in stick the interface torque; a line where it was `missed`.
    """
    ends = recorded.friction_torque
    linear = ends[:-1, None] + share * (ends[1:] - ends[:-1])[:, None]
    if terms.smoothing is None:
        return linear
    law = np.asarray(friction.smoothed_coefficient(states[..., 0], terms.smoothing, terms.stribeck)) * load
    stuck = np.abs(states[..., 0]) <= stick_speed_of(terms)
    needed = equations.interface_torque(states[..., 1], states[..., 2], engine, terms.linear)
    most = friction.largest_ratio(terms.stribeck) * load
    torque = np.where(stuck & (np.abs(needed) <= most), needed, np.where(np.isfinite(load), law, linear))
    torque[missed] = linear[missed]
    return np.asarray(torque)
