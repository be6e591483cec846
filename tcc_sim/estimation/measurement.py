"""Measurements of a driveline: evenly spaced samples of its speeds, and of measured inputs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.profile import smooth_corners
from tcc_sim.replay.given_inputs import BRIDGED_ROWS
from tcc_sim.replay.timeline import measured_run
from tcc_sim.scene import Scene, parse_scene
from tcc_sim.tables.chosen_columns import CHANNELS
from tcc_sim.tables.file_columns import TIME
from tcc_sim.tables.measured_table import HOLDS, MeasuredTable, longest_part
from tcc_sim.tables.sampling import holes_in, in_words
from tcc_sim.topics import FAR_END, INPUTS
from tcc_sim.trajectory import Floats

UNEVEN = 1e-3  # Largest deviation of a step between samples from the others, relative.
FEWEST_SAMPLES = 50  # Shortest measurement, samples.
MOST_SAMPLES = 1_000_000  # Longest measurement, samples.
DEAD = 1e-12  # A channel whose spread is below this part of its size is dead.
EXACT = 1e-4  # Precision of the real-time solver and least noise, relative to a signal's largest value.


@dataclass(frozen=True)
class Measurement:
    """Evenly spaced samples.

    t : (n,) simulation time, s, which sets the phase of a scene's engine torque
    channels : (n,) arrays by name of CHANNELS, with slip_speed
    inputs : arrays by name of INPUTS; the others come from the scene. (n,) values at the samples, or (n, 2) values at
        both ends of the step after each sample, which is linear
    hold : course of the inputs between two samples, one of HOLDS; None if it is unknown
    source : origin of the data, for messages
    notes : sentences on how a file was read
    """

    t: Floats
    channels: dict[str, Floats]
    inputs: dict[str, Floats] = field(default_factory=dict)
    source: str = "the measurement"
    hold: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def step(self) -> float:
        """Time between samples, s."""
        return float(self.t[-1] - self.t[0]) / (len(self.t) - 1)

    def ends_of(self, name: str) -> Floats:
        """Return an input at the start and the end of the step after each sample, (n, 2), N m or Pa; 0 without data."""
        if name not in self.inputs:
            return np.zeros((len(self.t), 2))
        values, hold = self.inputs[name], self.hold or HOLDS[0]
        if values.ndim == 2:
            return values
        if hold == "smooth":
            values = smooth_corners(self.t, values, *((0.0,) if name == INPUTS[1] else ()))
        after = np.append(values[1:], values[-1:])
        return np.stack({"previous": (values, values), "next": (after, after)}.get(hold, (values, after)), axis=1)

    def at_samples(self, name: str) -> Floats:
        """Return a measured input at the samples, (n,), N m or Pa: those of the steps after them where both differ."""
        values = self.inputs[name]
        return values if values.ndim == 1 else values[:, 0]

    def __post_init__(self) -> None:
        n = len(self.t)
        if not FEWEST_SAMPLES <= n <= MOST_SAMPLES:
            raise InputError(f"{self.source} has {n} samples; {FEWEST_SAMPLES} to {MOST_SAMPLES} are needed")
        if "slip_speed" not in self.channels:
            raise InputError(f"{self.source} has no slip_speed; identification needs it")
        for name, column in (("t", self.t), *self.channels.items(), *self.inputs.items()):
            if not np.isfinite(column).all():
                k = int(np.flatnonzero(~np.isfinite(column))[0])
                raise InputError(f"{self.source}: {name} of sample {k} is not a number")
        steps = np.diff(self.t)
        usual = float(np.median(steps))
        if usual <= 0.0:
            raise InputError(f"{self.source}: the times do not increase")
        if len(gaps := holes_in(self.t)):
            raise InputError(f"{self.source} has no samples from {in_words(gaps)} beside steps of {usual:.6g} s; "
                             "identification needs evenly spaced samples: give a part without a gap")
        worst = int(np.argmax(np.abs(steps - usual)))
        if abs(steps[worst] - usual) > UNEVEN * usual:
            raise InputError(f"{self.source} has a step of {steps[worst]:.6g} s at {self.t[worst]:.6g} s beside steps "
                             f"of {usual:.6g} s; identification needs evenly spaced samples")
        for name, column in self.channels.items():
            if np.ptp(column) <= DEAD * max(1.0, float(np.abs(column).max())):
                raise InputError(f"{self.source}: {name} is {column[0]:g} {CHANNELS[name]} throughout; the channel is "
                                 "dead, or nothing moved")


def measurement_in(table: MeasuredTable) -> Measurement:
    """Return the measurement in a table: columns t, slip_speed, and further ones of CHANNELS and INPUTS; raise
    InputError if the far end of the shaft moves, or the data cannot be used.
    """
    _check_still(Path(table.source), table.columns.get(FAR_END))
    table = _without_holes(table)
    rows = np.isfinite(table.columns["slip_speed"])
    columns = {name: values[rows] for name, values in table.columns.items()
               if name in (TIME, "slip_speed") or np.isfinite(values).any()}
    slower = [name for name, values in columns.items() if name in (*CHANNELS, *INPUTS)
              and not np.isfinite(values).all() and not len(table.holes(name))]
    for name in slower:
        first, last = table.filled(name)[0][[0, -1]]
        inside = (columns[TIME] >= first) & (columns[TIME] <= last)
        columns = {other: values[inside] for other, values in columns.items()}
    for name in slower:
        columns[name] = np.interp(columns[TIME], *table.filled(name))
    if slower:
        table = table.noting(f"{table.source}: {', '.join(slower)} joined by straight lines where cells are empty, "
                             "between its regular samples")
    held = {table.hold[name] for name in INPUTS if name in columns and name in table.hold}
    return _evenly_spaced(columns[TIME], {name: columns[name] for name in CHANNELS if name in columns},
                          {name: columns[name] for name in INPUTS if name in columns}, table.source,
                          held.pop() if len(held) == 1 else None, table.notes)


def _without_holes(table: MeasuredTable) -> MeasuredTable:
    """Return the longest part of a table without a hole in a column that is used. Holes of one or two rows in an input
    are bridged by straight lines, as `simulate --inputs` bridges them.
    """
    used = [name for name in (*CHANNELS, *INPUTS)
            if name in table.columns and np.isfinite(table.columns[name]).any()]
    columns, bridged = dict(table.columns), []
    for name in (name for name in used if name in INPUTS):
        short = table.holes(name)
        short = short[np.diff(short)[:, 0] < BRIDGED_ROWS * table.usual_step(name)]
        inside = np.searchsorted(short[:, 0], table.t) > np.searchsorted(short[:, 1], table.t, side="right")
        if inside.any():
            columns[name] = np.where(inside, np.interp(table.t, *table.filled(name)), columns[name])
            bridged.append(f"{table.source}: {name} is joined by straight lines over {in_words(short)}")
    table = replace(table, columns=columns).noting(*bridged)
    holes = table.holes(*used)
    if not len(holes):
        return table
    begin, end = longest_part(table.t, holes)
    return table.part(begin, end).noting(f"{table.source}: only {begin:.6g} to {end:.6g} s is used, the longest part "
                                         "without a hole")


def read_recording(path: Path, scene: Scene | None = None, **driveline: Any) -> tuple[Measurement, Scene]:
    """Return the longest run of a recording, and the run's scene; without one, `scene`. `driveline` selects a driveline
    (see `recording.reader.Run`).

    Inputs from topics count as measured, with their values at both ends of the tick after each sample
    (`replay.timeline`). Raise InputError if there is no scene, or if the scene changed or the far end moved during the
    run, and RecordingError if nothing can be read.
    """
    from tcc_sim.recording.reader import Run

    recorded = Run(path, **driveline)
    if recorded.scene_text is not None:
        scene = parse_scene(recorded.scene_text, str(path))
    if scene is None:
        raise InputError(f"{path} holds no scene of the recorded driveline; name it with --scene")
    states, ticks, scene = measured_run(recorded, scene)
    _check_still(path, states.of("output_speed"))
    inputs = {name: np.concatenate([values, values[-1:]])[states.known] for name, values in ticks.items()}
    states = states[states.known]
    t, channels = states.stamp_ns.astype(np.float64) * 1e-9, {
        "slip_speed": states.flywheel_speed - states.plate_speed, "plate_speed": states.plate_speed}
    part, losses = _without_gaps(t, str(path))
    return _evenly_spaced(t[part], {name: column[part] for name, column in channels.items()},
                          {name: ends[part] for name, ends in inputs.items()}, str(path), HOLDS[0], losses), scene


def _without_gaps(t: Floats, source: str) -> tuple[slice, tuple[str, ...]]:
    """Return the longest part of a recording in which no state was lost, and a sentence if there are others."""
    steps = np.diff(t)
    lost = np.flatnonzero(steps > 1.5 * np.median(steps)) if len(steps) else np.empty(0, np.int64)
    if not len(lost):
        return slice(0, len(t)), ()
    begin, end = longest_part(t, np.stack([t[lost], t[lost + 1]], axis=1))
    first, last = np.searchsorted(t, [begin, end]).tolist()
    return slice(first, last + 1), (f"{source}: only {begin:.6g} to {end:.6g} s is used, the longest part without a "
                                    "lost state",)


def _evenly_spaced(t: Floats, channels: dict[str, Floats], inputs: dict[str, Floats], source: str, hold: str | None,
                   notes: tuple[str, ...]) -> Measurement:
    """Return a Measurement without the last sample after a shorter step, and with a sentence about it.

    A simulation whose duration is no multiple of its output step ends with such a step.
    """
    usual, last = (float(np.median(np.diff(t))), float(t[-1] - t[-2])) if len(t) > 1 else (0.0, 0.0)
    if last < (1.0 - UNEVEN) * usual:
        t, notes = t[:-1], (*notes, f"{source}: the last sample is left out; its step of {last:.6g} s is shorter than "
                            f"the others, {usual:.6g} s")
    return Measurement(t, {name: column[:len(t)] for name, column in channels.items()},
                       {name: column[:len(t)] for name, column in inputs.items()}, source, hold, notes)


def _check_still(path: Path, speed: Floats | None) -> None:
    if speed is not None and (np.isfinite(speed) & (speed != 0.0)).any():
        raise InputError(f"{path}: the far end of the shaft moved (output_speed up to "
                         f"{np.nanmax(np.abs(speed)):.4g} rad/s); identification needs one at rest")


def noise_of(signal: Floats) -> float:
    """Return the standard deviation of the white noise on a signal, from its sixth differences.

    They leave (w h)^6 of a signal of frequency w, and sqrt(924) of white noise; the median ignores kinks of the signal.
    It is an upper estimate for coarse sampling, and at least EXACT.
    """
    noise = float(np.median(np.abs(np.diff(signal, 6)))) / 0.6745 / math.sqrt(924.0)
    return max(noise, EXACT * float(np.abs(signal).max()))
