"""Engine cycles of a recording from batches of samples, in bounded memory, with gaps and resets."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tcc_sim.analysis.engine_clock import EngineClock, Scheduled, Tracked, clock_of_scene
from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.summary import Summary, dropped_of, spans_of, summarise_cycles
from tcc_sim.errors import InputError
from tcc_sim.model import equations
from tcc_sim.model.parameters import System
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.stamps import Break, StampCounter, Stamps
from tcc_sim.solvers.per_cycle import STAMP, cycles_from_samples
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.trajectory import STILL, Cycles, FarEnd, Floats, Loads, concatenated, far_end_of


@dataclass(frozen=True)
class CyclePiece:
    """Consecutive whole engine cycles of one run, with their start times."""

    run: int
    first: int
    cycles: Cycles


@dataclass
class RunCycles:
    """Engine cycles of one run, from a start or a reset of the driveline to the next."""

    pieces: list[CyclePiece] = field(default_factory=list)
    summary: tuple[tuple[int, int | None], Summary] | None = None
    """The last summary, with the number of cycles and of cycles to drop for which it was made."""

    def add(self, piece: CyclePiece) -> None:
        """Add a piece; consecutive pieces are joined, longer ones rarely, so that there are few."""
        while self.pieces and _follows(self.pieces[-1], piece) and len(self.pieces[-1].cycles) <= 2 * len(piece.cycles):
            before = self.pieces.pop()
            piece = CyclePiece(before.run, before.first, concatenated([before.cycles, piece.cycles]))
        self.pieces.append(piece)

    def _join_all(self) -> None:
        """Join consecutive pieces, so that the kept part of the run is a view and not a copy."""
        joined: list[list[CyclePiece]] = []
        for piece in self.pieces:
            if joined and _follows(joined[-1][-1], piece):
                joined[-1].append(piece)
            else:
                joined.append([piece])
        self.pieces = [replace(group[0], cycles=concatenated([p.cycles for p in group])) if len(group) > 1 else group[0]
                       for group in joined]

    def observed(self) -> int:
        """Return the number of whole engine cycles without a gap."""
        return sum(len(p.cycles) for p in self.pieces)

    def kept(self, discard: int | None) -> tuple[Cycles, int, int]:
        """Return the cycles after the first `discard`, the number of the first of them, and the number of dropped ones.

        One NaN cycle stands for each gap between cycles; cycles within gaps at the start count as dropped too. Raise
        InputError if no cycle is left, or for a negative number.
        """
        if not self.pieces:
            raise InputError("the recording holds no whole period of excitation")
        self._join_all()
        first, last = self.pieces[0].first, self.pieces[-1].first + len(self.pieces[-1].cycles)
        dropped = dropped_of(last - first, discard)
        joined = _with_gaps([p.cycles[max(first + dropped - p.first, 0):] for p in self.pieces
                             if p.first + len(p.cycles) > first + dropped])
        return joined, last - len(joined), dropped


def _follows(a: CyclePiece, b: CyclePiece) -> bool:
    """Return whether b starts where a ends."""
    return b.first == a.first + len(a.cycles)


def _with_gaps(parts: list[Cycles]) -> Cycles:
    """Join cycles that gaps separate, with one NaN cycle for each gap; return a single part unchanged."""
    if len(parts) == 1:
        return parts[0]
    gap = np.array([math.nan])
    columns = [np.concatenate([column for part in of_parts[:-1] for column in (part, gap)] + [of_parts[-1]])
               for of_parts in zip(*map(_columns, parts))]
    starts = [p.starts for p in parts if p.starts is not None]
    highest, lowest, stick_time, *loads = columns
    return Cycles(np.concatenate([p.section for p in parts]), highest, lowest, stick_time, Loads(*loads),
                  np.concatenate(starts) if len(starts) == len(parts) else None)


def _columns(part: Cycles) -> list[Floats]:
    """Return the numbers of each cycle, its loads last."""
    assert part.loads is not None
    return [part.highest, part.lowest, part.stick_time, *part.loads.columns()]


def lengths_of(cycles: Cycles) -> Floats:
    """Return the length of each cycle, s, (n,)."""
    assert cycles.starts is not None
    return np.diff(cycles.starts)


class CycleStream:
    """Engine cycles from batches of samples in the order of recording.

    Samples are stored only until their engine cycle is complete. The accelerations for the interpolation are those of
    (2a) and (2b) with the recorded torques. A gap ends its cycle; a stamp that goes back starts a new run.

    Parameters
    ----------
    system : gives the equations for the accelerations
    clock : start times of the engine cycles; by default those of the system's frequency. For slices of time instead of
        cycles there are extremes, but neither section nor period
    """

    def __init__(self, system: System, clock: EngineClock | None = None) -> None:
        self.clock = clock or clock_of_scene(system)
        self.continuity = StampCounter()
        self.not_finite = 0
        self.runs: list[RunCycles] = []
        self.numbers: dict[int, int] = {}
        """Which of `runs` has the batches of a run, by the number that these were fed with."""
        self._stick_speed, self._linear = stick_speed_of(terms_of(system)), terms_of(system).linear
        self._waiting: list[Floats] = []
        self._from = 0.0

    def feed(self, stamp_ns: Stamps, slip_speed: Floats, plate_angle: Floats, plate_speed: Floats,
             engine_torque: Floats, friction_torque: Floats, run: int = 0,
             far: FarEnd = STILL) -> list[CyclePiece]:
        """Take the next batch, (n,) arrays in ns, rad/s, rad, rad/s, N m, N m, and return the completed cycles.

        `far` is the motion of the shaft's far end, whose speed is held between samples. A sample that is not finite is
        left out and counted, and becomes a gap. `run` is the number of the batch's run, if the recording distinguishes
        runs.

        Raises
        ------
        InputError
            There are fewer samples than engine cycles.
        """
        t = np.asarray(stamp_ns, dtype=np.float64) * 1e-9
        rows = np.stack(np.broadcast_arrays(t, slip_speed, plate_angle, plate_speed, engine_torque, friction_torque,
                                            far.angle, far.speed))
        finite = np.isfinite(rows).all(axis=0)
        if not finite.all():
            self.not_finite += int(np.count_nonzero(~finite))
            rows, stamp_ns = rows[:, finite], stamp_ns[finite]
        found: list[CyclePiece] = []
        for piece, preceded in self.continuity.pieces(stamp_ns, run):
            if preceded.begins_a_run:
                self.numbers[run] = len(self.runs)
                self.runs.append(RunCycles())
            if preceded is not Break.NOTHING:
                self._waiting = []
            found += self._take(rows[:, piece], run)
        return found

    def feed_states(self, states: JointStates) -> list[CyclePiece]:
        """Take the next states of a recording, as `feed`."""
        return self.feed(states.stamp_ns, states.flywheel_speed - states.plate_speed, states.plate_angle,
                         states.plate_speed, states.engine_torque, states.friction_torque, states.run,
                         far_end_of(states.output_angle, states.output_speed))

    def longest(self) -> tuple[int, RunCycles]:
        """Return number and cycles of the run with the most cycles, the last of several; raise InputError without
        samples.
        """
        if not self.runs:
            raise InputError("the recording holds no samples")
        number = max(range(len(self.runs)), key=lambda k: (self.runs[k].observed(), k))
        return number, self.runs[number]

    def summary(self, discard: int | None = None, number: int | None = None) -> Summary:
        """Return the summary of the longest run, or of run `number`; raise InputError if no whole cycle is left."""
        run = self.longest()[1] if number is None else self.runs[number]
        made_of = run.observed(), discard
        if run.summary is None or run.summary[0] != made_of:
            run.summary = made_of, self._summary_of(run, discard)
        return run.summary[1]

    def _summary_of(self, run: RunCycles, discard: int | None) -> Summary:
        """Summarise a run."""
        if not self.clock.told:
            cycles = run.kept(0)[0]
            return replace(summarise_cycles(cycles, lengths_of(cycles)), period=0, section=[], cycles=0, settled=False,
                           section_change=math.nan)
        cycles, first, dropped = run.kept(discard)
        found = summarise_cycles(cycles, first=first, tolerance=DEFAULTS.recording_tolerance,
                                 **self._spans_of(cycles, first))
        return replace(found, cycles=run.observed(), discarded=dropped)

    def _spans_of(self, cycles: Cycles, first: int) -> dict[str, Any]:
        """Return `summary.spans_of`; without a scene's profile, the lengths of the cycles show changes of the
        excitation.
        """
        if not isinstance(self.clock, Tracked):
            system = self.clock.system if isinstance(self.clock, Scheduled) else None
            return spans_of(system, self.clock.cycle, first, len(cycles))
        cycle = lengths_of(cycles)
        drifts = np.flatnonzero(np.abs(cycle / np.median(cycle[-DEFAULTS.at_the_end:]) - 1.0) > DEFAULTS.drifting)
        return {"cycle": cycle, "varied": int(drifts[-1]) + 1 if len(drifts) else 0}

    def _take(self, rows: Floats, run: int) -> list[CyclePiece]:
        """Add samples to the waiting ones, and return the cycles that are now whole."""
        if not self._waiting:
            self._from = float(rows[0, 0])
        self._waiting.append(rows)
        begin, end = float(self._waiting[0][0, 0]), float(rows[0, -1])
        held = sum(part.shape[1] for part in self._waiting)
        if (end - begin) / self.clock.cycle > held:
            raise InputError(f"{held} stamps lie {end - begin:.3g} s apart and a period of excitation takes "
                             f"{self.clock.cycle:.3g} s: there must be at least one for each cycle")
        stretches = self.clock.stretches(run, self._from - STAMP, end + STAMP)
        whole = [(first, starts) for first, starts in stretches if len(starts) > 1]
        if not whole:
            if not stretches:
                self._waiting, self._from = [rows[:, -1:].copy()], end
            return []
        rows = np.concatenate(self._waiting, axis=1)
        t, slip_speed, plate_angle, plate_speed, engine, friction, *far = rows
        slip, plate = equations.accelerations(plate_angle - far[0], plate_speed - far[1], engine, friction,
                                              self._linear)
        found = []
        for first, starts in whole:
            cycles = cycles_from_samples(t, slip_speed, slip, plate_angle, plate_speed, plate, starts=starts,
                                         stick_speed=self._stick_speed, linear=self._linear, far=FarEnd(*far))
            found.append(CyclePiece(len(self.runs) - 1, first, replace(cycles, starts=starts)))
            self.runs[-1].add(found[-1])
        self._from = float(whole[-1][1][-1])
        start = int(np.searchsorted(t, self._from + DEFAULTS.slack * self.clock.cycle, side="right")) - 1
        self._waiting = [rows[:, start:].copy()]
        return found
