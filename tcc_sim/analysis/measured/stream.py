"""Engine cycles of a recording from batches of samples, in bounded memory, with gaps and resets."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.measured.engine_clock import SLACK, EngineClock, Tracked, clock_of_scene
from tcc_sim.analysis.measured.signals import BRIDGED_TICKS
from tcc_sim.analysis.steady.summary import (
    CycleTimes,
    Laws,
    Span,
    Summary,
    cycle_times_of,
    dropped_of,
    summarise_cycles,
)
from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.model.parameters import System
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.stamps import Break, StampCounter, Stamps
from tcc_sim.solvers.per_cycle import STAMP
from tcc_sim.trajectory import STILL, Cycles, FarEnd, Floats, Loads, concatenated

RECORDING_TOLERANCE = 2e-3
"""TOLERANCE of a recorded section: ticks do not fall on cycle ends, and fixed steps are coarse."""
DRIFTING = 5e-3  # A cycle that differs by this part of the length of the last ones belongs to no period.
AT_THE_END = 16  # Number of these last cycles, periods of excitation.

BRIDGED = -1  # Row of the waiting samples: 1 where a single state before is lost.
PART = -1  # Number of a part of a cycle.


@dataclass(frozen=True)
class CyclePiece:
    """Consecutive whole engine cycles of one run, with their start times."""

    first: int
    cycles: Cycles


class Kept(NamedTuple):
    """Part of a run after the dropped cycles.

    cycles : whole engine cycles; one NaN cycle stands for each gap between them
    first : number of the first of them
    dropped : number of dropped cycles, those within gaps at the start included
    broken : number of later cycles that a gap interrupts or hides
    parts : each of the times beside whole cycles, as one "cycle"
    span : its start and end, and the time between them without observation, s
    """

    cycles: Cycles
    first: int
    dropped: int
    broken: int
    parts: list[Cycles]
    span: Span


@dataclass
class RunCycles:
    """Engine cycles of one run, from a start or a reset of the driveline to the next.

    begin, end : times of its first and last state, s
    pieces : whole engine cycles
    parts : beside them, with their start and end, s
    gaps : times (s) of the states before and after each gap, single lost states included
    """

    clock: EngineClock
    begin: float
    end: float = 0.0
    pieces: list[CyclePiece] = field(default_factory=list)
    parts: list[tuple[float, float, Cycles]] = field(default_factory=list)
    gaps: list[tuple[float, float]] = field(default_factory=list)

    def add_parts(self, partial: Cycles) -> None:
        """Add parts of cycles with their `starts`."""
        assert partial.starts is not None
        self.parts += [(*ends, partial[k:k + 1]) for k, ends in enumerate(pairwise(partial.starts.tolist()))]

    def observed(self) -> int:
        """Return the number of whole engine cycles."""
        return sum(len(p.cycles) for p in self.pieces)

    def kept(self, discard: int | None) -> Kept:
        """Return the part of the run after the first `discard` cycles.

        Raise InputError if no whole cycle is left, or for a negative number.
        """
        if not self.pieces:
            raise OutOfRange("the recording holds no whole period of excitation: its states go from "
                             f"{self.begin:.6g} to {self.end:.6g} s")
        breaks = [k for k, (a, b) in enumerate(pairwise(self.pieces), 1) if b.first != a.first + len(a.cycles)]
        self.pieces = [replace(self.pieces[a], cycles=concatenated([p.cycles for p in self.pieces[a:b]]))
                       for a, b in pairwise([0, *breaks, len(self.pieces)])]
        first, last = self._numbers()
        dropped = dropped_of(last - first, discard)
        whole = [p.cycles[max(first + dropped - p.first, 0):] for p in self.pieces
                 if p.first + len(p.cycles) > first + dropped]
        if not whole:
            raise OutOfRange(f"gaps interrupt or hide every period of excitation after the first {dropped}")
        joined = concatenated([whole[0], *(part for a, b in pairwise(whole) for part in (_hidden(a, b), b))])
        begin, parts = self.begin, self.parts
        if dropped:
            since = self._start_of(first + dropped)
            parts = [part for part in parts if part[1] > since + STAMP]
            begin = max([since, *(end for start, end, _ in parts if start < since - STAMP)])
            parts = [part for part in parts if part[0] >= begin - STAMP]
        gaps = np.clip(np.array(self.gaps).reshape(-1, 2), begin, None)
        whole_cycles = sum(map(len, whole))
        until = self.pieces[-1].first + len(self.pieces[-1].cycles)
        return Kept(joined, until - len(joined), dropped, last - first - dropped - whole_cycles,
                    [part for *_, part in parts], Span(begin, self.end, float(np.diff(gaps).sum())))

    def _numbers(self) -> tuple[int, int]:
        """Return the number of the first cycle that starts within the run, and of the first one that ends after it; of
        known ones, if the scene does not set the cycles.
        """
        if isinstance(self.clock, Tracked):
            return self.pieces[0].first, self.pieces[-1].first + len(self.pieces[-1].cycles)
        begin, end = (self.clock.cycles_until(t) for t in (self.begin - STAMP, self.end + STAMP))
        return math.ceil(begin - SLACK), math.floor(end + SLACK)

    def _start_of(self, number: int) -> float:
        """Return the start of a cycle, s; if the scene does not set it, cycles within a gap have one length."""
        if not isinstance(self.clock, Tracked):
            return self.clock.start_of(number)
        numbers = np.concatenate([p.first + np.arange(len(p.cycles) + 1) for p in self.pieces])
        starts = np.concatenate([p.cycles.starts for p in self.pieces if p.cycles.starts is not None])
        return float(np.interp(number, numbers, starts))


def _hidden(before: Cycles, after: Cycles) -> Cycles:
    """Return the one cycle of NaN that stands for the gap between cycles."""
    assert before.starts is not None
    assert after.starts is not None
    nan = np.array([math.nan])
    return Cycles(np.stack([before.section[-1], after.section[0]]), nan, nan, nan, Loads(*[nan] * len(fields(Loads))),
                  np.array([before.starts[-1], after.starts[0]]))


def lengths_of(cycles: Cycles) -> Floats:
    """Return the length of each cycle, s, (n,)."""
    assert cycles.starts is not None
    return np.diff(cycles.starts)


class CycleStream:
    """Engine cycles from batches of samples in the order of recording.

    Samples are stored only until their engine cycle is complete. The accelerations for the interpolation are those of
    (2a) and (2b) with the recorded torques. A stamp that goes back starts a new run. A gap interrupts its cycle, and
    the parts of the cycle before and after it count beside the whole cycles; a single lost state is bridged.

    system : gives the equations for the accelerations, where a batch comes without a system of its own
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
        self._system, self._laws = system, Laws()
        self._waiting: list[Floats] = []
        self._from = 0.0

    def feed(self, stamp_ns: Stamps, slip_speed: Floats, plate_angle: Floats, plate_speed: Floats,
             engine_torque: Floats, friction_torque: Floats, run: int = 0,
             far: FarEnd = STILL, system: System | None = None) -> list[CyclePiece]:
        """Take the next batch, (n,) arrays in ns, rad/s, rad, rad/s, N m, N m, and return the completed cycles.

        `far` is the motion of the shaft's far end, whose speed is held between samples. A sample that is not finite is
        left out and counted, and becomes a gap. `run` is the number of the batch's run, if the recording distinguishes
        runs, and `system` the one that held at it, if keys changed.

        Raises InputError: there are fewer samples than engine cycles.
        """
        t = np.asarray(stamp_ns, dtype=np.float64) * 1e-9
        law = self._laws.number_of(system or self._system)
        rows = np.stack(np.broadcast_arrays(t, slip_speed, plate_angle, plate_speed, engine_torque, friction_torque,
                                            far.angle, far.speed, law, 0.0))
        finite = np.isfinite(rows).all(axis=0)
        if not finite.all():
            self.not_finite += int(np.count_nonzero(~finite))
            rows, stamp_ns = rows[:, finite], stamp_ns[finite]
        pieces: list[CyclePiece] = []
        for piece, preceded in self.continuity.pieces(stamp_ns, run):
            begin = float(rows[0, piece.start])
            if preceded.begins_a_run:
                self._close()
                self.numbers[run] = len(self.runs)
                self.runs.append(RunCycles(self.clock, begin))
            elif preceded is Break.GAP:
                before = self.runs[-1].end
                self.runs[-1].gaps.append((before, begin))
                if begin - before > BRIDGED_TICKS * self.continuity.tick_s:
                    self._close()
                else:
                    rows[BRIDGED, piece.start] = 1.0
            pieces += self._take(rows[:, piece], run)
        return pieces

    def feed_states(self, states: JointStates, system: System | None = None) -> list[CyclePiece]:
        """Take the next states of a recording, as `feed`."""
        return self.feed(states.stamp_ns, states.flywheel_speed - states.plate_speed, states.plate_angle,
                         states.plate_speed, states.engine_torque, states.friction_torque, states.run,
                         states.far_end, system)

    def longest(self) -> tuple[int, RunCycles]:
        """Return number and cycles of the run with the most cycles, the last of several; raise InputError without
        samples.
        """
        if not self.runs:
            raise InputError("the recording holds no samples" + (
                f": none of its {self.not_finite} states has finite angles, speeds and torques" if self.not_finite
                else ""))
        number = max(range(len(self.runs)), key=lambda k: (self.runs[k].observed(), k))
        return number, self.runs[number]

    def summary(self, discard: int | None = None, number: int | None = None) -> Summary:
        """Return the summary of the longest run, or of run `number`; raise InputError if no whole cycle is left."""
        run = self.longest()[1] if number is None else self.runs[number]
        kept = run.kept(discard if self.clock.identified else 0)
        rest = self._rest() if run is self.runs[-1] else None
        parts = kept.parts if rest is None else [*kept.parts, rest]
        if not self.clock.identified:
            summary = summarise_cycles(kept.cycles, CycleTimes(lengths_of(kept.cycles)), partial=parts, span=kept.span)
            return replace(summary, period=0, section=[], section_states=[], cycles=0, broken=0, settled=False,
                           section_change=math.nan, longest_period=0)
        times = self._cycle_times_of(kept.cycles, kept.first)
        return summarise_cycles(kept.cycles, times, tolerance=RECORDING_TOLERANCE, dropped=kept.dropped,
                                broken=kept.broken, partial=parts, span=kept.span)

    def _cycle_times_of(self, cycles: Cycles, first: int) -> CycleTimes:
        """Return the timing of cycles; without a scene's profile, their lengths show changes of the excitation."""
        if not isinstance(self.clock, Tracked):
            return cycle_times_of(self.clock.system, self.clock.cycle, first, len(cycles))
        cycle = lengths_of(cycles)
        drifts = np.flatnonzero(np.abs(cycle / np.median(cycle[-AT_THE_END:]) - 1.0) > DRIFTING)
        return CycleTimes(cycle, first, varied=int(drifts[-1]) + 1 if len(drifts) else 0)

    def _take(self, rows: Floats, run: int) -> list[CyclePiece]:
        """Add samples to the waiting ones, and return the cycles that are now whole."""
        if not self._waiting:
            self._from = float(rows[0, 0])
        self._waiting.append(rows)
        begin, end = float(self._waiting[0][0, 0]), float(rows[0, -1])
        self.runs[-1].end = end
        held = sum(part.shape[1] for part in self._waiting)
        if (end - begin) / self.clock.cycle > held:
            raise InputError(f"{held} stamps lie {end - begin:.3g} s apart and a period of excitation takes "
                             f"{self.clock.cycle:.3g} s: there must be at least one for each cycle")
        cuts, numbers = self._cuts(run, end)
        if not len(numbers):
            return []
        rows = np.concatenate(self._waiting, axis=1)
        cycles = self._laws.cycles(rows, cuts)
        self._from = float(cuts[-1])
        pieces = []
        ends = np.flatnonzero((numbers[1:] != numbers[:-1] + 1) | (numbers[:-1] == PART)) + 1
        for a, b in pairwise([0, *ends.tolist(), len(numbers)]):
            if numbers[a] == PART:
                self.runs[-1].add_parts(cycles[a:b])
            else:
                pieces.append(CyclePiece(int(numbers[a]), cycles[a:b]))
        self.runs[-1].pieces += pieces
        start = int(np.searchsorted(rows[0], self._from + SLACK * self.clock.cycle, side="right")) - 1
        self._waiting = [rows[:, start:].copy()]
        return pieces

    def _cuts(self, run: int, end: float) -> tuple[Floats, NDArray[np.int64]]:
        """Return the times from `_from` on that separate cycles and parts up to `end`, and the numbers of the cycles
        between them, `PART` for a part of a cycle or of a time without known cycles.
        """
        stretches = self.clock.stretches(run, self._from - STAMP, end + STAMP)
        cuts, numbers = [np.array([self._from])], []
        for first, starts in stretches:
            starts = starts[starts <= end + STAMP]
            if not len(starts):
                continue
            if starts[0] > cuts[-1][-1] + self._near:
                numbers.append(np.array([PART]))
                cuts.append(starts)
            else:
                cuts[-1] = np.append(cuts[-1][:-1], starts)
            numbers.append(first + np.arange(len(starts) - 1))
        if not stretches and end > self._from + self._near:
            numbers.append(np.array([PART]))
            cuts.append(np.array([end]))
        return np.concatenate(cuts), np.concatenate(numbers) if numbers else np.empty(0, np.int64)

    @property
    def _near(self) -> float:
        """Longest part that counts as none, s."""
        return STAMP + 1e-8 * self.clock.cycle

    def _rest(self) -> Cycles | None:
        """Return the waiting samples after the last cycle as a part; None for none."""
        if not self._waiting or self.runs[-1].end <= self._from + self._near:
            return None
        return self._laws.cycles(np.concatenate(self._waiting, axis=1), np.array([self._from, self.runs[-1].end]))

    def _close(self) -> None:
        """End at a gap or at the end of a run: the waiting samples are a part of a cycle."""
        rest = self._rest()
        if rest is not None:
            self.runs[-1].add_parts(rest)
        self._waiting = []
