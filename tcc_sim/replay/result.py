"""Result of the analysis of a recording: fields, JSON, and text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.analysis.loop.control import Control
from tcc_sim.analysis.measured.orders import Orders, Spectrum
from tcc_sim.analysis.steady.damping import Damping
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.errors import counted, printable
from tcc_sim.output.tables import aligned, covers_row, damping_row, summary_rows
from tcc_sim.recording.drivelines import RecordedDriveline
from tcc_sim.recording.stamps import StampCounter
from tcc_sim.replay.inputs import CommandAge, HeldInput
from tcc_sim.replay.segments import Segment
from tcc_sim.replay.timing import Timing
from tcc_sim.result import Result, reported, reporting, result_class
from tcc_sim.scene import Scene
from tcc_sim.trajectory import Cycles, Trajectory

STEP_TOLERANCE = 1e-6
"""Largest difference, relative to each signal's maximum, for a tick that is solved from the recorded state before it:
the slip speed is then a difference of two recorded speeds, and an onset of slip amplifies its rounding error.
"""
SEGMENTS_SHOWN = 20
"""Largest number of segments in the printed table; --json has all."""


@result_class
class Verification:
    """Comparison of a recording with its own solution.

    exact : number of compared states that had to agree to the last bit
    first_difference_ns : stamp of the first message that differs by more than the tolerance
    detail : reason why nothing was compared, or possible reasons of the first difference
    """

    verified: bool = reported(
        "whether all inputs are known and every value agrees with its solution, to the last bit if recorded from the "
        "start")
    largest_difference: float = reported("of any value, relative to its signal's maximum; null if not finite")
    compared: int = reported("states compared", name="states")
    solved: int = reported("those that were solved; the first after a start or a gap is not")
    exact: int
    first_difference_ns: int | None
    detail: str

    @reporting("the result in a sentence", name="verification")
    def sentence(self) -> str:
        if self.verified:
            how = "to the last bit" if self.exact == self.compared else (
                f"within {STEP_TOLERANCE:g} (exactly for {self.exact})")
            agree = f"{counted(self.solved, 'message')} agree{'s' if self.solved == 1 else ''}"
            rest = self.compared - self.solved
            left = f"; {counted(rest, 'message')} without a state before it to solve from" if rest else ""
            return f"verified: {agree} {how} with the solution from the recording alone{left}{self.detail}"
        return f"not verified: {self.detail}"


@result_class(repr=False)
class Replay(Result):
    """Result of the analysis of a recording; summary, trajectory and cycles are of the longest run.

    trajectory : the last cycles of the run, at most 200 000 samples
    cycles, first_cycle : every engine cycle of the run, NaN at a gap, and the number of the first
    control : target, pressures, cycle means and events of the run
    parts_missing : whether a part of the recording is not there
    """

    path: Path
    scene: Scene
    summary: Summary = reported("figures of the longest run", spread=True)
    trajectory: Trajectory
    cycles: Cycles
    first_cycle: int
    timing: Timing = reported("timing of the periods of excitation", spread=True)
    continuity: StampCounter = reported("gaps, resets and restarts by the stamps", spread=True)
    messages: int = reported("joint_states read")
    lost_messages: int = reported("joint_states missing by their stamps")
    complete: bool = reported("false if the recording was cut short")
    warnings: tuple[str, ...] = reported("one sentence for each damage")
    pace: float = reported(
        "simulated over real time from first to last receipt; null if not recorded", name="real_time_factor")
    control: Control
    run: int = reported("number of the longest run, counted from 0", default=0)
    parts_missing: bool = False
    segments: tuple[Segment, ...] = reported("parts of the run, in order", default=())
    verification: Verification | None = reported(
        "comparison with the recording solved again", spread=True, optional=True, default=None)
    damping: Damping | None = reported("equivalent damping", spread=True, optional=True, default=None)
    inputs: Mapping[str, HeldInput] = reported("sources of each input, by topic", default_factory=dict)
    command_age: CommandAge | None = reported(
        "from the state that a command answers to the first tick that applies it; null if most commands have no stamp",
        "s", default=None)
    drivelines: tuple[RecordedDriveline, ...] = reported("drivelines and other nodes with joint states", default=())
    missed_ticks: int | None = reported("ticks missed; null without recorded diagnostics", default=None)
    late_ticks: int | None = reported("ticks more than a period late; null likewise", default=None)
    late_share: float = reported("their share of paced ticks; null likewise", default=math.nan)
    late_first: float = reported("simulation time of the first one; null if not stated", "s", default=math.nan)
    late_last: float = reported("that of the last; null likewise", "s", default=math.nan)
    latest_tick: float = reported("largest lateness; null likewise", "s", default=math.nan)
    orders: Orders | None = reported("orders, transmissibility and judder", optional=True, default=None)
    spectrum: Spectrum | None = reported("amplitudes over frequency and order", optional=True, default=None)

    def _text(self) -> str:
        summary, ended = self.summary, "complete" if self.complete else "cut short"
        period = f"period {summary.period}" if summary.period else "no period"
        return (f"Replay of {self.path.name}: {counted(self.messages, 'message')}, {self.lost_messages} lost, "
                f"{ended}; {counted(summary.cycles, 'cycle')}, {period}, {summary.regime}; largest |slip speed| "
                f"{summary.max_slip_speed:.5g} rad/s")

    def columns(self) -> dict[str, list[Any]]:
        """Return a row for every segment: its interval, the reason of its start, and the columns of its summary."""
        rows = [{"start": s.start, "end": s.end, "began_by": s.began_by,
                 **({name: column[0] for name, column in s.summary.columns().items()} if s.summary is not None else {})}
                for s in self.segments]
        return {name: [row.get(name) for row in rows] for name in max(rows, key=len)} if rows else {}

    @property
    def frequency(self) -> float:
        """Frequency of a typical engine cycle, rad/s; NaN without identified cycles."""
        return self.timing.frequency

    @property
    def frequency_source(self) -> str:
        """Source of the frequency: given, scene, found, or none."""
        return self.timing.source

    @property
    def unbroken(self) -> int:
        """Number of kept engine cycles at the end of the run without a gap before or between them."""
        broken = np.flatnonzero(np.isnan(self.cycles.highest))
        after = len(self.cycles) - (int(broken[-1]) + 1 if len(broken) else 0)
        return min(after, self.summary.cycles - self.summary.discarded)

    def lines(self) -> list[str]:
        """Return the result as lines for a terminal."""
        stamps = f"{self.continuity.tick * 1e-6:.6g} ms apart" if self.continuity.tick else "single"
        gaps = self.continuity.gaps
        stamps += f", {counted(gaps, 'gap')}" if gaps else ", no gap"
        if self.continuity.uneven:
            stamps += f", {self.continuity.uneven} of them uneven"
        if self.continuity.runs > 1:
            stamps += f"; {self.continuity.runs} runs, the figures are those of the longest"
        table = [("recording", self._ended()),
                 ("messages", f"{self.messages} of joint_states, {self.lost_messages} lost"), ("stamps", stamps),
                 ("rate", self._pace()),
                 ("frequency", self.timing.sentence()),
                 *summary_rows(self.summary, "record for longer"), *covers_row(self.summary)]
        for name, held in self.inputs.items():
            table.append((name.replace("_", " "), f"held {held.sentence()}"))
        if self.command_age is not None:
            table.append(("command age", self.command_age.sentence()))
        elif any(held.publishers for held in self.inputs.values()):
            table.append(("command age", "not known: most commands have no stamp, or none was applied"))
        if self.missed_ticks:
            table.append(("missed ticks", f"{self.missed_ticks} in real time"))
        if self.late_ticks:
            share = ("of an unknown number of paced ones" if math.isnan(self.late_share) else
                     f"{100.0 * self.late_share:.3g} % of the paced ones")
            when = "" if math.isnan(self.latest_tick) else f", at most by {self.latest_tick:.2g} s"
            if not math.isnan(self.late_first):
                when += f", from {self.late_first:.5g} to {self.late_last:.5g} s"
            table.append(("late ticks", f"{self.late_ticks}, {share}, by more than a period{when}"))
        if self.damping is not None:
            table.append(damping_row(self.damping))
        if self.verification is not None:
            table.append(("solved again", self.verification.sentence))
        if len(self.segments) > 1 or any(segment.tracking is not None for segment in self.segments):
            for number, segment in enumerate(self.segments[:SEGMENTS_SHOWN], 1):
                table += segment.rows(number)
            if len(self.segments) > SEGMENTS_SHOWN:
                table.append(("", f"--json has {counted(len(self.segments) - SEGMENTS_SHOWN, 'more segment')}"))
        notes = [f"  note: {text}" for text in self.warnings]
        lines = [f"{self.path}: {self.scene.description or self.scene.name}", *aligned(table), *notes]
        return [printable(line) for line in lines]

    def _ended(self) -> str:
        if not self.complete:
            return ("not complete: a part is missing" if self.parts_missing else
                    "cut short; data up to the last flush is read")
        return f"closed properly; {counted(self.lost_messages, 'message')} lost" if self.lost_messages else "complete"

    def _pace(self) -> str:
        if not math.isfinite(self.pace) or not self.continuity.tick:
            return "not known: the times of receipt do not show it"
        return f"{self.pace * 1e9 / self.continuity.tick:.2f} Hz reached, {self.pace:.5f} of real time"

    def markdown(self) -> str:
        """Return the result as a Markdown table."""
        cells = [line.strip().split("  ", 1) for line in self.lines()[1:]]
        table = [f"| {cell[0]} | {cell[1].strip()} |" if len(cell) > 1 else f"| | {cell[0]} |" for cell in cells]
        return "\n".join([f"# {printable(self.path.name)}", "", "| | |", "|---|---|", *table, ""])
