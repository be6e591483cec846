"""Figures of a controlled run: cycle means beside the target, pressures, events, and tracking errors."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.engine_clock import EngineClock, Uniform, clock_of_scene
from tcc_sim.analysis.settings import DEFAULTS
from tcc_sim.analysis.summary import cycle_parts_of, default_discard
from tcc_sim.result import reported
from tcc_sim.trajectory import Cycles, Floats, Trajectory, integral


@dataclass(frozen=True)
class Steps:
    """A signal that keeps its value until the next one: times (s) and values, (n,) arrays."""

    t: Floats
    values: Floats

    def until(self, end: float) -> Steps:
        """Return the steps with the last value repeated at `end`, for drawing."""
        if not len(self.t) or self.t[-1] >= end:
            return self
        return Steps(np.append(self.t, end), np.append(self.values, self.values[-1]))

    @staticmethod
    def none() -> Steps:
        """Return steps without a value."""
        return Steps(np.empty(0), np.empty(0))


@dataclass(frozen=True)
class Event:
    """A change of the run at a simulation time, s, other than by physics, with its description."""

    t: float
    text: str


@dataclass(frozen=True)
class Control:
    """One run of a recording as a test of a controller.

    t, mean_slip : (n,) ends of the whole engine cycles, s, and the mean slip speed in each, rad/s
    target : target of the slip controller, rad/s
    command, applied : actuation pressure as commanded and as applied at the end of each cycle, Pa
    events : changed parameters, fallbacks and resets
    """

    t: Floats
    mean_slip: Floats
    target: Steps = field(default_factory=Steps.none)
    command: Steps = field(default_factory=Steps.none)
    applied: Steps = field(default_factory=Steps.none)
    events: tuple[Event, ...] = ()

    @property
    def controlled(self) -> bool:
        """Whether a pressure or a target was recorded."""
        return bool(len(self.target.t) or len(self.command.t) or len(self.applied.t))


@dataclass(frozen=True)
class Tracking:
    """Slip speed against a constant target; the fields are JSON keys of `analyse`. NaN marks what was not observed."""

    target: float = field(metadata=reported("target slip speed", "rad/s"))
    mean_slip: float = field(metadata=reported("mean slip speed over the kept cycles", "rad/s"))
    rms_error: float = field(metadata=reported("rms of the cycle mean minus the target over the kept cycles", "rad/s"))
    largest_error: float = field(metadata=reported("largest size of that difference", "rad/s"))
    overshoot: float = field(metadata=reported(
        "how far the cycle mean went beyond the target in the direction of the step to it, in all cycles; where it "
        "began at the target there is no step, and this is how far it went to either side", "rad/s"))
    settling_time: float = field(metadata=reported(
        "time until the cycle mean stays, for five cycles or more to the end, within 2 % of the step or of the "
        "target, whichever is larger; null where it does not", "s"))
    peak_mean: float = field(default=math.nan, metadata=reported(
        "largest deviation of the cycle mean from the target in all cycles, the transient included", "rad/s"))
    peak_slip: float = field(default=math.nan, metadata=reported(
        "largest deviation of the slip speed itself, likewise", "rad/s"))
    iae: float = field(default=math.nan, metadata=reported(
        "integral of the cycle mean's |error| over all cycles", "rad"))
    ripple: float = field(default=math.nan, metadata=reported(
        "rms of the slip speed about its mean over each cycle", "rad/s"))
    stick_fraction: float = field(default=math.nan, metadata=reported("time in stick over time"))
    pressure_low: float = field(default=math.nan, metadata=reported("least applied pressure", "Pa"))
    pressure_high: float = field(default=math.nan, metadata=reported("largest applied pressure", "Pa"))
    pressure_rate: float = field(default=math.nan, metadata=reported("rms of the rate of the applied pressure", "Pa/s"))
    time_at_limit: float = field(default=math.nan, metadata=reported(
        "share of time in which the pressure is at a limit"))


def tracking(target: float, means: Floats, cycle: float, discard: int) -> Tracking:
    """Judge cycle means, (n,) array in rad/s, NaN where a cycle was not observed.

    Parameters
    ----------
    target : rad/s
    cycle : engine cycle, s
    discard : cycles dropped from mean and errors
    """
    error = means - target
    kept = error[discard:][np.isfinite(error[discard:])]
    seen = error[np.isfinite(error)]
    if not len(seen):
        return Tracking(target, *(math.nan,) * 5)
    start = float(seen[0])
    band = DEFAULTS.settled * max(abs(start), abs(target))
    beyond = np.abs(seen) if abs(start) <= band else -seen if start > 0.0 else seen
    outside = np.flatnonzero(~(np.abs(error) <= band))
    settled = int(outside[-1]) + 1 if len(outside) else 0
    stays = len(error) - settled >= DEFAULTS.settled_cycles
    return Tracking(
        target=target, mean_slip=float(kept.mean()) + target if len(kept) else math.nan,
        rms_error=float(np.sqrt(np.mean(kept * kept))) if len(kept) else math.nan,
        largest_error=float(np.abs(kept).max()) if len(kept) else math.nan,
        overshoot=max(float(beyond.max()), 0.0), settling_time=settled * cycle if stays else math.nan,
        peak_mean=float(np.abs(seen).max()), iae=float(np.abs(seen).sum()) * cycle)


def tracking_of(run: Trajectory, target: float, pressure: Floats | None = None,
                limits: tuple[float, float] = (0.0, math.inf)) -> Tracking:
    """Judge how a run held a target from its first sample on.

    Parameters
    ----------
    run : samples with their system; between them slip speed and time in stick are those of the cubics through the
        samples with the rates of the equations
    target : rad/s
    pressure : (n,) applied pressure, Pa
    limits : of the pressure, Pa
    """
    before, cycles, behind = cycle_parts_of(replace(run, cycles=None, rest=None))
    running = MeansOfCycles(Uniform(run.cycle) if run.system is None else clock_of_scene(run.system))
    running.feed(run.t, run.slip_speed)
    means = running.means()
    parts = [part for part in (before, cycles, behind) if part is not None]
    highest, lowest, stick = (np.concatenate([getattr(part, name) for part in parts])
                              for name in ("highest", "lowest", "stick_time"))
    step = np.diff(run.t)
    more = {}
    if pressure is not None:
        p = pressure[1:]  # A sample is what was held through the tick that led to it.
        low, high = limits
        more = {"pressure_low": float(p.min()), "pressure_high": float(p.max()),
                "pressure_rate": math.sqrt(float(np.sum(np.diff(p) ** 2 / step[1:])) / float(step.sum())),
                "time_at_limit": float(step[(p <= low) | (p >= high)].sum()) / float(step.sum())}
    return replace(tracking(target, means, run.cycle, default_discard(len(means))),
                   peak_slip=max(float(highest.max()) - target, target - float(lowest.min())),
                   ripple=_ripple(run, cycles, means), stick_fraction=float(stick.sum()) / float(step.sum()), **more)


def _ripple(run: Trajectory, cycles: Cycles, means: Floats) -> float:
    """Return the rms of the slip speed about the mean over each whole cycle."""
    if cycles.starts is None or not len(means) or len(means) != len(cycles):
        return math.nan
    number = np.searchsorted(cycles.starts, run.t, side="right") - 1
    inside = (number >= 0) & (number < len(means))
    apart = run.slip_speed[inside] - means[number[inside]]
    return math.sqrt(float(np.mean(apart * apart)))


class CycleMeans:
    """Means over whole engine cycles by the trapezoidal rule, of samples in batches; none without known cycles.

    A gap (`Settings.gap`) between batches leaves the cycles in it without a mean.
    """

    def __init__(self, clock: EngineClock) -> None:
        self._clock = clock
        self._t = self._v = np.empty(0)

    def restart(self) -> None:
        """Begin after a reset of time, or after a gap: the cycles in it have no mean."""
        self._t = self._v = np.empty(0)

    def feed(self, t: Floats, v: Floats, run: int = 0) -> list[tuple[int, Floats, Floats]]:
        """Take the next samples of a run, (n,) arrays: time, s, and the signal.

        Returns
        -------
        for each stretch of completed cycles, the number of the first, and ends (s) and means, (m,) arrays
        """
        if len(self._t) and len(t) > 1 and t[0] - self._t[-1] > DEFAULTS.gap * float(np.median(np.diff(t))):
            self.restart()
        t, v = np.concatenate([self._t, t]), np.concatenate([self._v, v])
        if not self._clock.told or (t[-1] - t[0]) / self._clock.cycle > len(t):
            # Fewer samples than cycles: time has leapt.
            self._t, self._v = t[-1:], v[-1:]
            return []
        stretches = self._clock.stretches(run, float(t[0]), float(t[-1]))
        whole = [(first, starts) for first, starts in stretches if len(starts) > 1]
        if not whole:
            self._t, self._v = (t, v) if stretches else (t[-1:], v[-1:])
            return []
        area = integral(v, t)
        found = []
        for first, starts in whole:
            ends = np.clip(starts, t[0], t[-1])
            left = np.clip(np.searchsorted(t, ends, side="right") - 1, 0, len(t) - 2)
            part, slope = ends - t[left], (v[left + 1] - v[left]) / (t[left + 1] - t[left])
            area_at = area[left] + part * (v[left] + 0.5 * part * slope)
            found.append((first, starts[1:], np.diff(area_at) / np.diff(starts)))
        self._t, self._v = t[left[-1]:].copy(), v[left[-1]:].copy()
        return found


def joined_means(found: list[tuple[int, Floats, Floats]]) -> tuple[NDArray[np.int64], Floats]:
    """Return ends (ns) and means of the cycles of `CycleMeans.feed`, one after the other."""
    ends = np.concatenate([ends for _, ends, _ in found]) if found else np.empty(0)
    return np.rint(ends * 1e9).astype(np.int64), np.concatenate([m for *_, m in found]) if found else np.empty(0)


class MeansOfCycles:
    """Cycle means from the first cycle to the last, NaN in a gap."""

    def __init__(self, clock: EngineClock) -> None:
        self._running = CycleMeans(clock)
        self._parts: list[Floats] = []
        self._next: int | None = None

    def interrupt(self) -> None:
        """Begin after a gap."""
        self._running.restart()

    def feed(self, t: Floats, v: Floats, run: int = 0) -> None:
        """Take the next samples of a run, (n,) arrays: time, s, and the signal."""
        for first, _, means in self._running.feed(t, v, run):
            if self._next is not None and first > self._next:
                self._parts.append(np.full(min(first - self._next, len(t)), math.nan))
            self._parts.append(means)
            self._next = first + len(means)

    def means(self) -> Floats:
        """Return the cycle means, (n,)."""
        return np.concatenate(self._parts) if self._parts else np.empty(0)
