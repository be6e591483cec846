"""Tracking of a target slip speed: errors of the cycle means, peaks, pressures, and the verdict on a run or segment.

The target is a signal. Each engine cycle has the mean of the target over it, also a cycle in which the target jumps.
The first cycle of a segment is the one that contains its start, so that nothing after a change is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.loop import BAND
from tcc_sim.analysis.loop import loop_verdict as verdicts
from tcc_sim.analysis.loop.control import CycleMeans, Steps
from tcc_sim.analysis.loop.loop_verdict import Errors, Judged, LoopCycles, LoopVerdict, Signal
from tcc_sim.analysis.measured.engine_clock import EngineClock
from tcc_sim.analysis.measured.stream import CyclePiece, CycleStream
from tcc_sim.errors import InputError
from tcc_sim.model.profile import latest
from tcc_sim.result import reported, result_class
from tcc_sim.shown_units import speed
from tcc_sim.trajectory import Floats, Trajectory

SETTLED = 0.02
"""Part of the step of the target, or of the peak after a disturbance, within which the cycle mean counts as settled."""
ISOLATED = 4.0
"""A change of the target is a jump if it is larger than its neighbours by this factor; else the target moves."""
STEP_TIME = 0.5
"""Longest change of the target in one direction, with rest before and after it, that counts as one step, s."""
OBSERVED = 0.9  # Least part of a segment whose cycles must be known for a verdict.
OF_NOISE = 4.5  # Standard deviations of a noise of the cycle means that leave them on target.
STAYS = 1e-3  # Range of the pressure's means over cycles, relative to the largest, that counts as none.
LAGS = 400  # Delays of a moving target that are tried, up to a quarter of the segment.
AS_GOOD = 0.02  # Part of the variance of the cycle means by which a smaller delay may explain less.
ALIKE = 0.5  # Part of the variance of the cycle means that a delayed target must explain for a lag and a gain.
SAME_PRESSURE = 1e-5  # Difference of pressures, relative to the largest, that counts as none.
AT_A_LIMIT = 0.5  # Part of the end of a run with the pressure at a limit that counts as saturated.
STICKS = 0.02  # Part of the end of a run in stick that counts as sticking.

Limits = tuple[float, float]
UNKNOWN: Limits = (math.nan, math.nan)
LEAST_LIMIT: Limits = (0.0, math.nan)  # Limits where nobody stated them: no pressure is below 0.
LARGEST_BAND = 1e4  # Largest band, rad/s.
SPEEDS = (-1e5, 1e5)  # Smallest and largest target, rad/s.


@result_class
class Tracking:
    """Slip speed against a target; the fields are JSON keys of `analyse`. NaN marks what was not observed."""

    target: float = reported("target slip speed at the end", "rad/s")
    mean_slip: float = reported("mean over the kept cycles", "rad/s", default=math.nan)
    rms_error: float = reported("rms of cycle mean minus target over the kept cycles", "rad/s", default=math.nan)
    largest_error: float = reported("largest size of that difference", "rad/s", default=math.nan)
    overshoot: float = reported("largest distance of the cycle mean beyond the target", "rad/s", default=math.nan)
    settling_time: float = reported(
        "from the segment's start until the cycle mean stays within `band`; null unless settled", "s", default=math.nan)
    target_low: float = reported("smallest target, below `target_high` if it moves", "rad/s", default=math.nan)
    target_high: float = reported("largest target", "rad/s", default=math.nan)
    verdict: str | None = reported(
        "settled, hunting, growing, saturated, sticking, off target, follows, too short to judge, or too little "
        "observed; null without a cycle mean", default=None)
    verdict_why: str = reported("reason of the verdict, or why there is none", default="")
    band: float = reported("error that counts as settled", "rad/s", default=math.nan)
    overshoot_time: float = reported("simulation time", "s", default=math.nan)
    peak_deviation: float = reported(
        "largest deviation of the cycle mean, signed, after it reached the target", "rad/s", default=math.nan)
    peak_time: float = reported("simulation time", "s", default=math.nan)
    hunting_amplitude: float = reported(
        "amplitude of a lasting oscillation of the cycle mean; null without one", "rad/s", default=math.nan)
    hunting_period: float = reported("its period; null without one", "s", default=math.nan)
    judder_amplitude: float = reported(
        "amplitude of a fast slip oscillation that does not repeat with the excitation; null without one", "rad/s",
        default=math.nan)
    judder_frequency: float = reported("its frequency; null without one", "Hz", default=math.nan)
    lag: float = reported("delay behind a moving target; null without one", "s", default=math.nan)
    gain: float = reported("motion of the cycle mean over that of the target; null likewise", default=math.nan)
    peak_mean: float = reported(
        "largest deviation of the cycle mean in size, approach included", "rad/s", default=math.nan)
    peak_slip: float = reported("that of the slip speed itself", "rad/s", default=math.nan)
    iae: float = reported("integral of the cycle mean's |error|", "rad", default=math.nan)
    ripple: float = reported("rms of the slip speed about its mean over each cycle", "rad/s", default=math.nan)
    stick_fraction: float = reported("time in stick over time", default=math.nan)
    pressure_low: float = reported("least applied pressure", "Pa", default=math.nan)
    pressure_high: float = reported("largest applied pressure", "Pa", default=math.nan)
    pressure_rate: float = reported("rms of its rate", "Pa/s", default=math.nan)
    time_at_limit: float = reported("share of time at one of `limits`", default=math.nan)
    limits: Limits = reported("limits of the pressure as stated; else 0 and null", "Pa", default=UNKNOWN)
    command_rate: float = reported(
        "pressure commands applied per simulated second; null without recorded commands", "Hz", default=math.nan)
    commands_applied: int | None = reported("pressure commands held during a tick or more; null likewise", default=None)
    commands_superseded: int | None = reported(
        "pressure commands replaced before the next tick; null likewise", default=None)
    seconds: float = reported("time observed", "s", default=0.0)
    lost_seconds: float = reported("time without recorded states within and between cycles", "s", default=0.0)

    @property
    def settled(self) -> bool:
        """Whether the verdict is settled."""
        return self.verdict == LoopVerdict.SETTLED.value

    def within(self, *, settling: float | None = None, overshoot: float | None = None,
               peak: float | None = None) -> bool:
        """Return True if the loop meets a specification; otherwise raise AssertionError, which names each miss.

        A figure that is not known misses its bound.

        Parameters
        ----------
        settling : largest settling time, s; the verdict must be settled
        overshoot : largest overshoot, rad/s
        peak : largest size of the peak deviation, rad/s
        """
        missed = [f"{name} {'not known' if math.isnan(value) else f'{value:.4g}'}, allowed {bound:g} {unit}"
                  for name, value, bound, unit in (
                      ("settling time", self.settling_time if self.settled else math.nan, settling, "s"),
                      ("overshoot", self.overshoot, overshoot, "rad/s"),
                      ("peak deviation", abs(self.peak_deviation), peak, "rad/s"))
                  if bound is not None and not value <= bound]
        if missed:
            why = f" ({self.verdict_why})" if self.verdict_why else ""
            raise AssertionError(f"{'; '.join(missed)}; verdict: {self.verdict or 'none'}{why}")
        return True


def loop_cycles(clock: EngineClock, parts: Iterable[tuple[bool, Floats, Floats]], pieces: Iterable[CyclePiece] = (),
                run: int = 0) -> tuple[LoopCycles, Signal]:
    """Return the cycles of a run in order of time, and all samples of its slip speed.

    parts : whether a gap precedes, times, s, and slip speeds, rad/s
    pieces : cycles of a CycleStream with the same clock, for the extremes; unknown without
    """
    means, squares = CycleMeans(clock), CycleMeans(clock)
    rows: dict[int, tuple[float, ...]] = {}
    samples = [np.empty((2, 0))]
    for after_gap, t, v in parts:
        if after_gap:
            means.restart()
            squares.restart()
        samples.append(np.stack([t, v]))
        for (first, ends, mean), (_, _, square) in zip(means.feed(t, v, run), squares.feed(t, v * v, run)):
            rows |= zip(range(first, first + len(ends)), zip(ends.tolist(), mean.tolist(), square.tolist()))
    numbers = np.array(sorted(rows), dtype=np.int64)
    ends, mean, square = np.array([rows[k] for k in numbers.tolist()]).reshape(-1, 3).T
    columns = np.full((4, len(numbers)), math.nan)
    for piece in pieces:
        cycles = piece.cycles
        assert cycles.starts is not None
        _, at, known = np.intersect1d(numbers, piece.first + np.arange(len(cycles)), True, True)
        columns[:, at] = np.stack([cycles.starts[:-1], cycles.highest, cycles.lowest, cycles.stick_time])[:, known]
    starts = columns[0]
    follows = np.diff(numbers, prepend=-1) == 1
    starts = np.where(np.isfinite(starts) | ~follows, starts, np.append(0.0, ends)[:len(ends)])
    if len(ends) and not np.isfinite(starts).all():  # After a gap, without extremes.
        lengths = ends - starts
        usual = float(np.nanmedian(lengths)) if np.isfinite(lengths).any() else 0.0
        starts = np.where(np.isfinite(starts), starts, ends - usual)
    return LoopCycles(starts, ends, mean, square, *columns[1:]), Signal(*np.concatenate(samples, axis=1))


def checked_limits(limits: Limits | None) -> Limits | None:
    """Return stated limits of the pressure, Pa; raise InputError unless 0 <= low < high."""
    if limits is not None:
        low, high = limits
        if not 0.0 <= low < high:
            raise InputError(f"limits of the pressure are {low:g} and {high:g} Pa; the lower one must be 0 Pa or more, "
                             "and below the upper one")
    return limits


def target_steps(target: float | Mapping[float, float]) -> Steps:
    """Return a target, rad/s, or targets from times (s) on, as steps.

    Raises InputError: there is no target, or one is out of range.
    """
    given = target if isinstance(target, Mapping) else {0.0: target}
    times = sorted(float(t) for t in given)
    values = [float(given[t]) for t in sorted(given)]
    if not values:
        raise InputError("there is no target; give a slip speed, or times with slip speeds")
    for value in values:
        if not SPEEDS[0] <= value <= SPEEDS[1]:
            raise InputError(f"target is {value:g} rad/s; it must be {SPEEDS[0]:g} to {SPEEDS[1]:g} rad/s")
    if not all(math.isfinite(t) for t in times):
        raise InputError("a time of the target is not a number; it must be a time in s")
    return Steps(np.array(times), np.array(values))


def target_jumps(reference: Steps, least: float, near: float) -> Steps:
    """Return the jumps of a reference: their times, s, and the values after them, rad/s.

    A target that moves is published as many small steps, or as larger ones far apart. A change is a jump if it is
    larger than `least`, rad/s, and four times as large as the changes within `near`, s, before and after it. So are
    changes in one direction for `STEP_TIME` at most, less than `near` apart, together: a rate limiter's step
    is one step.
    """
    rows = np.flatnonzero(np.diff(reference.values)) + 1
    change, t = np.diff(reference.values)[rows - 1], reference.t[rows]

    def isolated(first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which sums of changes, from a first to a last one, are large enough, (m,)."""
        sums = np.append(0.0, np.cumsum(change))
        size, apart = np.abs(sums[last + 1] - sums[first]), t[first[1:]] - t[last[:-1]] > near
        before = np.append(0.0, np.where(apart, 0.0, size[:-1]))[:len(size)]
        after = np.append(np.where(apart, 0.0, size[1:]), 0.0)[:len(size)]
        return np.asarray((size > least) & (size >= ISOLATED * np.maximum(before, after)))

    every = np.arange(len(rows))
    alone = isolated(every, every)
    first = np.flatnonzero((np.diff(np.sign(change), prepend=0.0) != 0.0) | (np.diff(t, prepend=-math.inf) > near))
    last = np.append(first[1:], len(rows))[:len(first)] - 1
    together = isolated(first, last) & (t[last] - t[first] <= STEP_TIME)
    together &= np.add.reduceat(np.append(alone, False), first)[:len(first)] == 0
    first, last = (np.sort(np.append(edge[together], every[alone])) for edge in (first, last))
    return Steps(t[first], reference.values[rows[last]])


def value_at(reference: Steps, t: float) -> float:
    """Return the value of a reference at t, s; before the first, the first."""
    return float(reference.values[max(int(np.searchsorted(reference.t, t + 1e-9, side="right")) - 1, 0)])


def mean_between(reference: Steps, starts: Floats, ends: Floats) -> Floats:
    """Return the mean of a reference over each cycle, (n,); before its first value, that holds."""
    t, values = reference.t, reference.values
    area = np.append(0.0, np.cumsum(values[:-1] * np.diff(t)))

    def integral_to(at: Floats) -> Floats:
        row = latest(t, at)
        return np.asarray(area[row] + values[row] * (at - t[row]), dtype=np.float64)

    return np.where(ends > starts, (integral_to(ends) - integral_to(starts)) / np.maximum(ends - starts, 1e-300),
                    values[latest(t, ends)])


@dataclass(frozen=True)
class Loop:
    """A run of a controlled driveline, of which segments are judged.

    reference : target slip speed, rad/s
    pressure : applied through the time from each sample before, Pa; empty if it was not recorded
    limits : of the pressure as stated, Pa; None if nobody stated them
    floor : least band that counts as settled, rad/s
    why : reason in a sentence if there are no cycle means
    note : sentence that every reason of a verdict ends with
    before : mean slip speed of the last cycle before the run, rad/s; NaN if unknown
    bridged : (m, 2) times of the states before and after each single lost one, s
    slip : samples of the slip speed, rad/s
    """

    course: LoopCycles
    reference: Steps
    pressure: Signal = verdicts.NO_SIGNAL
    limits: Limits | None = None
    floor: float = BAND
    why: str = ""
    note: str = ""
    before: float = math.nan
    bridged: Floats = field(default_factory=lambda: np.empty((0, 2)))
    slip: Signal = verdicts.NO_SIGNAL

    @cached_property
    def jumps(self) -> Steps:
        """Jumps of the target, which begin segments."""
        lengths = self.course.ends - self.course.starts
        cycle = float(np.median(lengths)) if len(lengths) else 0.0
        return target_jumps(self.reference, self.floor, verdicts.SETTLED_CYCLES * cycle)

    def tracking(self, begin: float, end: float, *, stepped: bool | None = None, discard: int = 0,
                 commands: tuple[int, int] | None = None) -> Tracking:
        """Judge the time from `begin` to `end`, s.

        stepped : whether the segment begins with a step of the target or a start of the driveline; None if it may.
            Without a recorded step, one counts that is larger than a quarter of what follows
        discard : cycles left out of mean and errors
        commands : numbers of applied and of superseded pressure commands in this time
        """
        course = self.course.within(begin, end)
        target = value_at(self.reference, end)
        counts: dict[str, Any] = {} if commands is None else {
            "command_rate": commands[0] / (end - begin) if end > begin else math.nan,
            "commands_applied": commands[0], "commands_superseded": commands[1]}
        pressed = self.pressure.within(begin, end)
        counts |= self._pressure_figures(pressed)
        if not len(course.mean):
            return Tracking(target, verdict=None if self.why else LoopVerdict.TOO_SHORT.value,
                            verdict_why=self.why or "no whole period of excitation", **counts)
        half = slice(len(course.mean) // 2, None)
        judder, frequency = verdicts.judder_line(self.slip, course.starts[half], course.ends[half], self.floor)
        apart = 1
        if math.isfinite(judder):
            apart += math.ceil(1.0 / frequency / float(np.median(course.ends - course.starts)))
            means = verdicts.means_without(self.slip, course.starts, course.ends, 1.0 / frequency)
            course = replace(course, mean=np.where(np.isfinite(means), means, course.mean))
        # The last third, of five cycles at least.
        lasts = max((end - begin) / 3.0, verdicts.SETTLED_CYCLES * float(course.ends[0] - course.starts[0]))
        tail = course.starts >= max(float(course.ends[-1]) - lasts, 0.0) - 1e-9
        moved = self._changes(float(course.starts[tail.argmax()]), float(course.ends[-1]))
        moving = float(np.abs(moved).sum()) > self.floor
        errors, peak = self._errors(course, *self._step(course, begin, stepped), moving, apart)
        lag, gain = self._lag(course, end - begin) if moving else (math.nan, math.nan)
        if math.isfinite(lag):
            errors = replace(errors, late=mean_between(self.reference, course.starts - lag, course.ends - lag))
        error = errors.error
        kept = error[discard:]
        length = errors.ends - errors.starts
        first, last = float(errors.starts[0]), float(errors.ends[-1])
        seconds = float(length.sum()) - self._bridged_in(course)
        lost = last - first - seconds
        held = self.reference
        aimed = np.append(value_at(held, begin), held.values[(held.t > begin + 1e-9) & (held.t <= end)])
        peak_figures: dict[str, Any] = {}
        # The run may begin and end within a cycle.
        missing = end - begin - float(length.sum()) - 2.0 * float(np.median(length))
        if missing > (1.0 - OBSERVED) * (end - begin):
            verdict = Judged(LoopVerdict.TOO_LITTLE, f"{missing:.3g} of {end - begin:.3g} s were not observed; a "
                             f"verdict needs {100.0 * OBSERVED:g} %")
            beyond = np.full(1, -math.inf)
        else:
            verdict = self._verdict(errors, pressed, tail, end - begin)
            beyond = np.abs(error) if errors.step == 0.0 else error * math.copysign(1.0, errors.step)
            peak_figures = {
                "largest_error": float(np.abs(kept).max()) if len(kept) else math.nan,
                "peak_deviation": float(error[peak]), "peak_time": float(errors.t[peak]),
                "overshoot": abs(max(float(beyond.max()), 0.0)),
                "peak_mean": float(np.abs(error).max()),
                "peak_slip": float(np.fmax.reduce(np.maximum(course.highest - errors.reference,
                                                             errors.reference - course.lowest)))}
        judders = f"; it judders by +-{speed(judder, 3)} at {frequency:.3g} Hz" if math.isfinite(judder) else ""
        known = np.isfinite(course.stick_time)
        return Tracking(
            target=target, target_low=float(aimed.min()), target_high=float(aimed.max()),
            mean_slip=float(course.mean[discard:].mean()) if len(kept) else math.nan,
            rms_error=float(np.sqrt(np.mean(kept * kept))) if len(kept) else math.nan,
            overshoot_time=float(errors.t[int(beyond.argmax())]) if beyond.max() > 0.0 else math.nan,
            settling_time=max(float(errors.starts[verdict.since]) - begin, 0.0)
            if verdict.verdict is LoopVerdict.SETTLED else math.nan,
            verdict=verdict.verdict.value, verdict_why=verdict.why + judders + self.note, band=errors.band,
            hunting_amplitude=verdict.amplitude, hunting_period=verdict.period,
            judder_amplitude=judder, judder_frequency=frequency, lag=lag, gain=gain,
            iae=float((np.abs(error) * length).sum()), ripple=float(np.sqrt(np.mean(errors.ripple**2))),
            stick_fraction=float(course.stick_time[known].sum() / length[known].sum()) if known.any() else math.nan,
            seconds=seconds, lost_seconds=lost if lost > 1e-9 * (last - first) else 0.0, **peak_figures, **counts)

    def _changes(self, begin: float = -math.inf, end: float = math.inf) -> Floats:
        """Return the changes of the target within a time other than by jumps, rad/s."""
        inside = (self.reference.t[1:] > begin) & (self.reference.t[1:] <= end)
        return np.asarray(np.diff(self.reference.values)[inside & ~self._in_jumps[1:]])

    @cached_property
    def _in_jumps(self) -> np.ndarray:
        """Which values of the reference are within a jump, (n,)."""
        t, values, out = self.reference.t, self.reference.values, np.zeros(len(self.reference.t), dtype=np.bool_)
        for at, value in zip(self.jumps.t, self.jumps.values):
            first = int(np.searchsorted(t, at))
            out[first:first + int((values[first:] == value).argmax()) + 1] = True
        return out

    @cached_property
    def _turns(self) -> bool:
        """Whether the target moves up and down, other than by jumps."""
        change = self._changes()
        return bool((change > 0.0).any() and (change < 0.0).any())

    def _bridged_in(self, course: LoopCycles) -> float:
        """Return the time of single lost states within cycles, s."""
        edges = np.ravel(np.column_stack([course.starts, course.ends]))
        covered = np.repeat(np.append(0.0, np.cumsum(course.ends - course.starts)), 2)[1:-1]
        return float(np.diff(np.interp(self.bridged, edges, covered), axis=1).sum())

    def _lag(self, course: LoopCycles, whole: float) -> tuple[float, float]:
        """Return the delay, s, and the gain with which the cycle means follow the reference; NaN if they do not.

        Least squares over delays of up to a quarter of the segment: of those that fit nearly as well as the best, as a
        period more does where the target repeats, the smallest. A target that moves one way only has no mean of its
        own: an offset from it is a delay.
        """
        values, tried = course.mean, list[tuple[float, float, float]]()
        cycle = float(np.median(course.ends - course.starts))
        kept = course.starts >= course.starts[0] + 0.25 * whole
        if np.count_nonzero(kept) < verdicts.SETTLED_CYCLES:
            return math.nan, math.nan
        for delay in np.linspace(-cycle, 0.25 * whole, LAGS):
            late = mean_between(self.reference, course.starts - delay, course.ends - delay)[kept]
            about = late - late.mean()
            offset = float(values[kept].mean()) if self._turns else float(late.mean())
            gain = float(about @ (values[kept] - offset)) / max(float(about @ about), 1e-300)
            left = float(np.sum((values[kept] - offset - gain * about) ** 2)) if gain > 0.0 else math.inf
            tried.append((left, float(delay), gain))
        spread, best = float(np.sum((values[kept] - values[kept].mean()) ** 2)), min(tried)[0]
        if best >= (1.0 - ALIKE) * spread:
            return math.nan, math.nan
        at = min((k for k, one in enumerate(tried) if one[0] <= best + AS_GOOD * spread),
                 key=lambda k: abs(tried[k][1]))
        while (to := min(range(max(at - 1, 0), min(at + 2, LAGS)), key=lambda k: tried[k][0])) != at:
            at = to
        return tried[at][1:]

    def _step(self, course: LoopCycles, begin: float, stepped: bool | None) -> tuple[float, float, bool]:
        """Return the step from the last value before `begin` to the target, rad/s, 0 if no step begins the segment; the
        end of the step, s; and whether it is certain.

        The value before a start is extrapolated from the first two cycles.
        """
        if stepped is False:
            return 0.0, begin, True
        target, until = value_at(self.reference, begin), begin
        jump = np.flatnonzero(np.abs(self.jumps.t - begin) < 1e-7)
        if len(jump):
            target = float(self.jumps.values[jump[0]])
            after = int(np.searchsorted(self.reference.t, begin - 1e-7))
            until = float(self.reference.t[after + int((self.reference.values[after:] == target).argmax())])
        cycle = float(course.ends[0] - course.starts[0])
        before = np.flatnonzero((self.course.ends <= begin + 1e-7) & (self.course.ends > begin - 1.5 * cycle))
        if len(before):
            return target - float(self.course.mean[before[-1]]), until, stepped is True
        if math.isfinite(self.before):
            return target - self.before, until, True
        first = course.mean[:2]
        return target - float(first[0] if len(first) < 2 else 1.5 * first[0] - 0.5 * first[1]), until, False

    def _errors(self, course: LoopCycles, step: float, until: float, certain: bool, moving: bool,
                apart: int) -> tuple[Errors, int]:
        """Return the errors of the cycle means with their band, and the index of the peak of the deviation."""
        reference = mean_between(self.reference, course.starts, course.ends)
        error = course.mean - reference
        if not certain and abs(step) < 0.25 * float(np.abs(error).max()):
            step = 0.0
        step = step if abs(step) > self.floor else 0.0
        noise = OF_NOISE * verdicts.noise_of_means(error, apart)
        wide = (float(np.ptp(reference)) if self._turns else 0.0) if moving else abs(step)
        band = max(self.floor, SETTLED * wide, noise)
        errors = Errors(**vars(course), error=error, reference=reference, step=step, band=band, floor=self.floor,
                        moving=moving, until=until, noise=noise, apart=apart)
        first = errors.arrived
        counts = (np.arange(len(error)) >= first) | (np.abs(error) > abs(step) + band)
        counts = counts if first < len(error) else np.full(len(error), True)
        peak = int(np.where(counts, np.abs(error), -1.0).argmax())
        # No loop follows a moving target more closely than by its largest step.
        fine = float(np.abs(self._changes(float(course.starts[0]), float(course.ends[-1]))).max(initial=0.0))
        of_peak = 0.0 if moving else SETTLED * abs(float(error[peak]))
        return replace(errors, band=max(band, fine, of_peak), floor=max(self.floor, fine)), peak

    def _pressure_figures(self, pressed: Signal) -> dict[str, Any]:
        if not len(pressed.t):
            return {"limits": self.limits or UNKNOWN}
        (t, p), limits = pressed, self.limits or LEAST_LIMIT
        step = np.diff(t, prepend=t[0] - (t[1] - t[0] if len(t) > 1 else 0.0))
        total = float(step.sum())
        at_limit = _at_level(p, limits[0], -1) | _at_level(p, limits[1], 1)
        return {"pressure_low": float(p.min()), "pressure_high": float(p.max()), "limits": limits,
                "pressure_rate": math.sqrt(float(np.sum(np.diff(p) ** 2 / step[1:])) / total) if len(p) > 1 else 0.0,
                "time_at_limit": float(step[at_limit].sum()) / total if total else math.nan}

    def _verdict(self, errors: Errors, pressed: Signal, tail: np.ndarray, whole: float) -> Judged:
        if len(errors.error) < verdicts.SETTLED_CYCLES or not tail.any():
            return verdicts.loop_verdict(errors, whole)
        if limit := self._saturated(errors, tail, pressed):
            return Judged(LoopVerdict.SATURATED, limit)
        known = np.isfinite(errors.stick_time[tail])
        stick = errors.stick_time[tail][known]
        lasts = float((errors.ends - errors.starts)[tail][known].sum())
        share = float(stick.sum()) / lasts if lasts else 0.0
        if (not errors.moving and share >= STICKS and 2 * np.count_nonzero(stick) > len(stick)
                and float(np.abs(errors.reference[tail]).min()) > errors.floor):
            return Judged(LoopVerdict.STICKING, f"in stick for {100.0 * share:.3g} % of the last {lasts:.3g} s")
        if stays := self._stays(errors, tail, pressed):
            return Judged(LoopVerdict.OFF_TARGET, stays)
        return verdicts.loop_verdict(errors, whole)

    def _saturated(self, errors: Errors, tail: np.ndarray, pressed: Signal) -> str:
        """Return the reason for the verdict saturated; empty if the end of the segment is not.

        A higher pressure brings the slip speed towards 0, so that the upper limit explains a slip speed on the far side
        of the target, and the lower one a slip speed on the near side of it, or none.
        """
        error, limits = errors.error, self.limits or LEAST_LIMIT
        slips = np.abs(errors.mean) > errors.floor
        side = np.where(slips & (errors.mean * error > 0.0), 1, -1) * (np.abs(error) > errors.band)
        if not (errors.moving or np.abs(side[tail].sum()) == np.count_nonzero(tail)):
            return ""
        for name, value, sign in (("upper", limits[1], 1), ("lower", limits[0], -1)):
            at = errors.means_of(pressed.t, _at_level(pressed.values, value, sign))[tail]
            held = (at >= 0.5) & (side[tail] == sign)
            if held.mean() < AT_A_LIMIT or np.mean(side[tail] == -sign) > 1.0 - OBSERVED:
                continue
            away = speed(float(np.abs(error[tail][held]).mean()), 3)
            return (f"the pressure is at its {name} limit, {value:.6g} Pa, for {100.0 * float(np.nanmean(at)):.3g} % "
                    f"of the last {errors.ends[-1] - errors.starts[tail][0]:.3g} s, and the mean {away} "
                    f"{'above' if error[tail][held][0] > 0.0 else 'below'} the target")
        return ""

    def _stays(self, errors: Errors, tail: np.ndarray, pressed: Signal) -> str:
        """Return the reason why a pressure that stays keeps the mean off target; empty if it does not."""
        pressure, error = errors.means_of(*pressed)[tail], errors.error[tail]
        pressure = pressure[np.isfinite(pressure)]
        if not (len(pressure) and np.ptp(pressure) <= STAYS * float(np.abs(pressure).max())
                and ((error > errors.band).all() or (error < -errors.band).all())):
            return ""
        size = np.abs(error)
        third = max(len(size) // 3, 1)
        grows = float(size[-third:].mean()) > (1.0 + verdicts.STANDING) * float(size[:third].mean())
        return (f"the pressure stays at {float(pressure.mean()):.6g} Pa while the error "
                f"{'grows' if grows else 'lasts'}: the mean is {speed(float(size.mean()), 3)} "
                f"{'above' if error[-1] > 0.0 else 'below'} the target")


def loop_of(run: Trajectory, clock: EngineClock, reference: Steps, pressure: Floats | None = None,
            limits: Limits | None = None, floor: float = BAND, before: float = math.nan) -> Loop:
    """Return a run as a Loop; without its system the extremes and the time in stick of the cycles are unknown.

    pressure : (n,) applied pressure before each sample, Pa
    reference, limits, floor, before : as in `Loop`
    """
    slip, pieces = Signal(run.t, run.slip_speed), list[CyclePiece]()
    if run.system is not None and len(run.t) > 1:
        pieces = CycleStream(run.system, clock).feed(
            np.rint(run.t * 1e9).astype(np.int64), run.slip_speed, run.plate_angle, run.plate_speed, run.engine_torque,
            run.friction_torque, far=run.far_end)
    course, slip = loop_cycles(clock, ((True, *part) for part in slip.stretches() or [slip]), pieces)
    return Loop(course, reference, verdicts.NO_SIGNAL if pressure is None else Signal(run.t, pressure), limits, floor,
                before=before, slip=slip)


def _at_level(pressure: Floats, level: float, side: int) -> NDArray[np.bool_]:
    """Return which pressures are at a level, Pa, or beyond it on one side (1: above, -1: below); none at NaN."""
    near = SAME_PRESSURE * max(abs(level), float(np.nanmax(np.abs(pressure), initial=0.0)) * 1e-3)
    return np.asarray(side * (pressure - level) >= -near)
