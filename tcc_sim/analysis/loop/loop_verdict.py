"""Verdict on the end of a controlled run, from the errors of its cycle means: settled or not, and why; and its judder.

An error is followed as swings between turning points. After a step, the swing from the start to the first turning point
is the approach to the target and does not count as an oscillation.

Judder is an oscillation of the slip speed that is too fast for the cycle means to show it: they sample once per engine
cycle, so they show an oscillation that is faster than a third of their rate with another amplitude, and one beyond half
of it with another frequency. Its frequency and amplitude are therefore those of a sine fitted to the slip speed itself,
after the part that repeats in each engine cycle is taken away. An average over one period of this sine is free of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import Enum
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.measured.signals import BRIDGED_TICKS, LEAST_SAMPLES
from tcc_sim.errors import counted
from tcc_sim.shown_units import speed
from tcc_sim.trajectory import Floats, integral

JUDDER = 1.0 / 3.0  # Least frequency, relative to that of the excitation: cycle means show slower ones.
JUDDER_CYCLES = 12  # Shortest stretch that shows it, periods of excitation.
JUDDER_POINTS = 64  # Points in a period of excitation after resampling, at most.
JUDDER_LEAST = 0.05  # Least amplitude, relative to the range of the cycle means.
JUDDER_SHARE = 0.5  # Least part of what is fast and does not repeat in each period that its line must hold.
HARMONICS = 12  # Highest harmonic of a swing that may be as fast as judder.
LARGEST_HARMONIC = 2.0  # Largest n-th harmonic of a swing times n, relative to the swing; of a sawtooth it is 1.
REVERSALS = 0.125, 0.34  # Reversals that end a swing, parts of the range of the second half of the run.
FINE_REVERSALS = (0.03,)  # The same where an oscillation grows so fast that the first swings are small.
STEADY = 0.6  # Least growth from such a swing to the next, relative to the largest, in natural logarithm.
IRREGULAR = 0.35  # Standard deviation of the durations of swings, relative to their mean, that marks them as irregular.
SWINGS = 6  # Most of the last swings that are judged.
FEWEST_SWINGS = 3  # Fewest swings that make an oscillation.
NEARLY = 0.8  # Part of the size of the other swings that makes one at either end complete.
QUIET_PERIODS = 3.0  # Periods of the slowest oscillation left that a settled mean must last.
ALIVE = 2.0  # Periods after the last swing within which another one may follow.
GROWTH_OF_SWINGS = 0.22  # Least growth of the swings, in natural logarithm.
DECAY_OF_SWINGS = 0.1  # Least decay of them, likewise.
SWING_SCATTER = 2.0  # The same in standard deviations of the swings about it.
NOISE_OF_SIZES = 0.3  # Standard deviation of a swing's size by noise, relative to `Errors.noise`.
DECAYS_ON = 0.34  # Part of the rate of a decay that the last swings must show.
COHERENT = 0.5  # Part of the variance that an oscillation within the band must hold.
SLOWING = 0.8  # Part of the growth of the third before that the last third of a growth has at least.
BLOCKS = 32  # Parts of a run whose means show a growth without oscillation.
BLOCKS_OF_RIPPLE = 10  # The same of a ripple.
CHANCE = 1e-4  # Least probability that noise swings as regularly.
GROWING_CYCLES = 10  # Least length of a growth without oscillation, periods of excitation.
WHITE = -0.4  # Largest correlation of neighbouring second differences of a noise; that of white noise is -2/3.
USUAL = 0.4  # Least square of a usual second difference of a noise, relative to the mean square.
RANDOM_SHARE = 1.2
"""Mean square of a signal's differences, relative to that of the signal, from which on it does not swing; that of white
noise is 2.
"""
RIPPLE = 1.5  # Growth of the ripple within the cycles that counts, as a factor.
APPROACHES = 0.8
"""An error from a moving target whose last third is at most this part of the one before has not ended its approach."""
UNEXPLAINED = 0.2  # Part of the variance of the error that a moving target may leave unexplained.
STANDING = 0.05  # Change of the error within the last third of the run, relative to it, that counts as none.
SETTLED_CYCLES = 5  # Least number of cycles to the end of a run that show that the mean stays, periods of excitation.


class LoopVerdict(Enum):
    """Verdicts on a controlled run, in the order in which they are examined."""

    TOO_LITTLE = "too little observed"
    SATURATED = "saturated"
    STICKING = "sticking"
    GROWING = "growing"
    FOLLOWS = "follows"
    HUNTING = "hunting"
    SETTLED = "settled"
    OFF_TARGET = "off target"
    TOO_SHORT = "too short"


class Judged(NamedTuple):
    """A verdict with its reason in a sentence, and the figures that belong to it (NaN: they do not).

    since : index of the first cycle that counts as settled
    amplitude, period : of an oscillation, rad/s and s
    """

    verdict: LoopVerdict
    why: str
    since: int = -1
    amplitude: float = math.nan
    period: float = math.nan


@dataclass(frozen=True)
class LoopCycles:
    """Observed engine cycles of a run, (n,) arrays.

    starts, ends : s
    mean, square : mean slip speed, rad/s, and mean of its square, (rad/s)^2
    highest, lowest, stick_time : extremes of the slip speed, rad/s, and time in stick, s
    """

    starts: Floats
    ends: Floats
    mean: Floats
    square: Floats
    highest: Floats
    lowest: Floats
    stick_time: Floats

    @property
    def ripple(self) -> Floats:
        """Rms of the slip speed about its mean in each cycle, (n,), rad/s."""
        return np.asarray(np.sqrt(np.maximum(self.square - self.mean**2, 0.0)))

    def within(self, begin: float, end: float) -> LoopCycles:
        """Return the cycles that end after `begin` and up to `end`, s."""
        near = 1e-9 + 1e-6 * (end - begin)
        rows = slice(*np.searchsorted(self.ends, [begin + min(near, 1e-7), end + near]).tolist())
        return LoopCycles(*(getattr(self, column.name)[rows] for column in fields(LoopCycles)))

    def means_of(self, t: Floats, values: NDArray[Any]) -> Floats:
        """Return the means over cycles, (n,), of the values before the times t, (m,) s; NaN without any."""
        cycle = np.searchsorted(self.starts, t - 1e-9, side="right") - 1
        known = cycle >= 0
        known[known] = t[known] <= self.ends[cycle[known]] + 1e-9
        count, total = (np.bincount(cycle[known], weights, len(self.ends)) for weights in (None, values[known]))
        return np.where(count > 0, total / np.maximum(count, 1), math.nan)


@dataclass(frozen=True, kw_only=True)
class Errors(LoopCycles):
    """The cycles of a segment with the errors of their means.

    error : (n,) mean slip speed minus target in each cycle, rad/s
    reference : (n,) target in each cycle, rad/s
    step : step of the reference from the last value before the segment, rad/s; 0 without
    band : size of the error that counts as settled, rad/s
    floor : the same for a step of any size, rad/s: smaller oscillations do not count
    moving : whether the target moves to the end
    until : end of the step, s, after which its target may be reached
    noise : deviation that noise of the cycle means explains, rad/s
    apart : distance of independent cycle means, which may be averages over several cycles
    late : (n,) target in each cycle with the loop's own delay, rad/s; None if it has none
    """

    error: Floats
    reference: Floats
    step: float
    band: float
    floor: float
    moving: bool
    until: float
    noise: float
    apart: int
    late: Floats | None = None

    @property
    def t(self) -> Floats:
        """Middle of each cycle, (n,), s."""
        return np.asarray(0.5 * (self.starts + self.ends))

    @property
    def arrived(self) -> int:
        """Index of the first cycle after a step whose mean has reached the target; the number of cycles if none has."""
        if abs(self.step) <= self.floor:
            return 0
        arrivals = np.flatnonzero(((np.abs(self.error) <= self.band) | (self.error * self.step > 0.0))
                                  & (self.ends > self.until))
        return int(arrivals[0]) if len(arrivals) else len(self.error)

    @property
    def inside_from(self) -> int:
        """Index of the first cycle from which on all errors are within the band."""
        outside = np.flatnonzero(np.abs(self.error) > self.band)
        return int(outside[-1]) + 1 if len(outside) else 0


class Swings(NamedTuple):
    """Complete swings of a signal: their sizes, rad/s, durations, s, and the time from the last one to the end, s.

    cut : whether the end cuts the last one
    flat : whether they are events with rest between them: few swings, with the signal near its median for most of the
        time
    """

    sizes: Floats
    durations: Floats
    quiet: float
    cut: bool = False
    flat: bool = False

    @property
    def period(self) -> float:
        """Period of the last swings, s: the upper median of two in succession."""
        last = self.durations[-SWINGS:]
        pairs = np.sort(last[1:] + last[:-1]) if len(last) > 1 else 2.0 * last
        return float(pairs[len(pairs) // 2])

    @property
    def alive(self) -> bool:
        """Whether the end comes so soon after the last swing that another one may follow."""
        return len(self.sizes) > 0 and self.quiet < ALIVE * self.period and not self.flat

    @property
    def regular(self) -> bool:
        """Whether the last periods, of two swings each, last equally long."""
        last = self.durations[-SWINGS:]
        last = last[1:] + last[:-1]
        return len(last) < 2 or float(last.std()) <= IRREGULAR * float(last.mean())


def turning_points(signal: Floats, reversal: float) -> NDArray[np.int64]:
    """Return the indices of alternating maxima and minima that a reversal larger than `reversal` confirms."""
    places: list[int] = []
    values = signal.tolist()
    low = high = 0
    rising = 0
    for k, value in enumerate(values):
        if value > values[high]:
            high = k
        if value < values[low]:
            low = k
        if rising >= 0 and values[high] - value > reversal:
            places.append(high)
            rising, low = -1, k
        elif rising <= 0 and value - values[low] > reversal:
            places.append(low)
            rising, high = 1, k
    return np.array(places, dtype=np.int64)


def swings_of(t: Floats, signal: Floats, floor: float, noise: float, from_start: bool = False,
              reversals: tuple[float, ...] = REVERSALS) -> Swings:
    """Return the complete swings of a signal, (n,) arrays.

    A swing that the end cuts counts if it is nearly as large as the others. Noise on a slow swing would cut it into
    pieces: of `reversals`, parts of the range of the second half, the first whose swings are regular counts.

    floor, noise : least reversals that end a swing; a signal is at rest within the former
    from_start : whether the same holds for the swing from the start, as no step leads to it
    """
    second = signal[len(signal) // 2:]
    swings = Swings(np.empty(0), np.empty(0), math.inf)
    for part in reversals:
        reversal = max(floor, noise, part * float(np.ptp(second)) if len(second) else 0.0)
        points = turning_points(signal, reversal)
        if len(points) and abs(signal[points[0]] - signal[0]) < reversal:
            points = points[1:]  # No swing leads to it.
        if len(points) < 2:
            break
        whole = NEARLY * float(np.median(np.abs(np.diff(signal[points]))))
        if from_start and abs(signal[points[0]] - signal[0]) >= whole:
            points = np.append(0, points)
        cut = bool(abs(signal[-1] - signal[points[-1]]) >= whole)
        if cut:
            points = np.append(points, len(signal) - 1)
        sizes = np.abs(np.diff(signal[points]))
        between = signal[points[0]:points[-1] + 1]
        away = np.abs(between - np.median(between))
        near = np.count_nonzero(away <= max(floor, float(np.median(sizes)) / 6.0)) > 0.5 * len(away)
        swings = Swings(sizes, np.diff(t[points]), float(t[-1] - t[points[-1]]), cut,
                        bool(near) and len(sizes) < SWINGS)
        if swings.regular:
            break
    return swings


def loop_verdict(errors: Errors, whole: float) -> Judged:
    """Return the verdict on the errors of a segment that neither a limit of the pressure nor stick explains.

    whole : length of the segment, s
    """
    n = len(errors.error)
    if n < SETTLED_CYCLES:
        return Judged(LoopVerdict.TOO_SHORT, f"{counted(n, 'whole period')} of excitation; a verdict needs "
                                         f"{SETTLED_CYCLES}")
    first = errors.arrived if errors.arrived < n else 0
    free, forced = _without_forced(errors, first) if errors.moving else (errors.error, False)
    part = errors.t[first:], free[first:], errors.floor, 1.25 * errors.noise, errors.step == 0.0
    swings = swings_of(*part)
    swinging = _oscillating(swings, errors, free)
    if len(swings.sizes) < FEWEST_SWINGS:
        fine = swings_of(*part, reversals=FINE_REVERSALS)
        growth = np.diff(np.log(fine.sizes[:-1 if fine.cut else None]))
        if len(growth) >= FEWEST_SWINGS and growth.min() > STEADY * growth.max():
            swinging = _oscillating(fine, errors, free)
    growing = _running_away(errors, errors.error, errors.band, whole, errors.noise) if not forced else None
    if swinging is not None and (swinging.verdict is LoopVerdict.GROWING or not errors.moving):
        return swinging
    if growing is not None:
        return Judged(LoopVerdict.GROWING, f"the error grows to the end, last by {speed(growing[0], 3)} per second")
    if errors.moving:
        return _following(errors, first)
    return _ripple_grows(errors, whole) or _at_the_end(errors, swings)


def noise_of_means(error: Floats, apart: int = 1) -> float:
    """Return the standard deviation of white noise in the second half of a signal, (n,), or in its last
    quarter; 0 without.

    Second differences take away what changes slowly. Those of white noise have six times its variance, and a
    correlation of -2/3 from one to the next. Those of an oscillation may have it too if only values that are `apart`
    are independent, but then not at two and three times this distance.
    """
    for part in (2, 4):
        tail, distances = error[len(error) - len(error) // part:], [apart, 2 * apart, 3 * apart][:3 if apart > 1 else 1]
        if len(tail) < (GROWING_CYCLES + 2) * apart:
            break
        seconds = [tail[2 * d:] - 2.0 * tail[d:-d] + tail[:-2 * d] for d in distances]
        square, usual = float(np.mean(seconds[0]**2)), 1.4826 * float(np.median(np.abs(seconds[0])))
        # A single jump has a correlation of -1/2, but is no usual difference.
        if usual**2 > USUAL * square and all(float(np.mean(second[d:] * second[:-d])) < WHITE * float(
                np.mean(second**2)) for second, d in zip(seconds, distances)):
            return usual / math.sqrt(6.0)
    return 0.0


def _ripple_grows(errors: Errors, whole: float) -> Judged | None:
    """Return the verdict on a ripple within the cycles that grows to the end."""
    grown = _running_away(errors, errors.ripple, errors.floor, whole, 0.0, BLOCKS_OF_RIPPLE)
    if grown is None or grown[2] < RIPPLE * grown[1]:
        return None
    return Judged(LoopVerdict.GROWING, f"the ripple of the slip speed grows to the end, to {speed(grown[2], 3)} rms")


def _following(errors: Errors, first: int) -> Judged:
    """Return the verdict on the error from a moving target: follows, off target, or still approaching."""
    n, since, size = len(errors.error), errors.inside_from, np.abs(errors.error)
    last = float(errors.ends[-1] - errors.starts[min(since, n - 1)])
    if n - since >= max(SETTLED_CYCLES, (n - first) // 2):
        return Judged(LoopVerdict.FOLLOWS, f"within {speed(errors.band, 3)} of the moving target for the last "
                      f"{last:.3g} s", since)
    third = max((n - first) // 3, 1)
    before, at_end = (float(part.max()) for part in (size[-2 * third:-third], size[-third:]))
    if at_end <= APPROACHES * before:
        return Judged(LoopVerdict.TOO_SHORT, f"still approaching the moving target at the end, by up to "
                      f"{speed(at_end, 3)} in the last {errors.ends[-1] - errors.starts[-third]:.3g} s")
    return Judged(LoopVerdict.OFF_TARGET, "the error follows the moving target, by up to "
                  f"{speed(float(size[n // 2:].max()), 3)}")


def _oscillating(swings: Swings, errors: Errors, free: Floats) -> Judged | None:
    """Return the verdict on an oscillation that is still there at the end, if it neither decays nor is too small.

    Within the band only a regular oscillation counts: the rest is noise.
    """
    if len(swings.sizes) < FEWEST_SWINGS or not swings.alive:
        return None
    whole = slice(None, -1 if swings.cut and len(swings.sizes) > FEWEST_SWINGS else None)
    sizes, durations = swings.sizes[whole], swings.durations[whole]
    last = slice(-max(SWINGS, len(sizes) // 2), None)
    middle = (np.cumsum(durations) - 0.5 * durations)[last]
    sizes, durations = sizes[last], durations[last]
    rate, start = map(float, np.polyfit(middle - middle[0], np.log(sizes), 1))
    span = float(middle[-1] - middle[0])
    scatter = float(np.std(np.log(sizes) - start - rate * (middle - middle[0])))
    least = SWING_SCATTER * max(scatter, NOISE_OF_SIZES * errors.noise / float(np.median(sizes)))
    cycle = float(np.median(errors.ends - errors.starts))
    amplitude = 0.5 * float(np.median(sizes)) / max(float(np.sinc(cycle / swings.period)), 0.5)
    if amplitude <= errors.floor:
        return None
    lasts = float(durations.sum())
    part = errors.t >= errors.t[-1] - swings.quiet - lasts
    half = swings.period * max(round(0.4 * lasts / swings.period), 1)
    early, late = (max(float(free[part][rows].std()), 1e-300)
                   for rows in (slice(round(half / cycle)), slice(-round(half / cycle), None)))
    if len(sizes) >= SWINGS and math.log(late / early) / rate < DECAYS_ON * (lasts - half):
        rate = 0.0   # The means of a few cycles in a period beat with the peaks between them.
    if rate * span < -max(DECAY_OF_SWINGS, 2.0 * least) and _decays_on(swings, rate):
        return None
    if len(sizes) < SWINGS and not (swings.regular and scatter <= IRREGULAR):
        return None
    share, period = _best_sine(errors.t[part], free[part], swings.period)
    by_chance = 1.0 - CHANCE ** (2.0 / max(np.count_nonzero(part) - 3, 1))
    regular = max(share, _repeats(errors.t[part], free[part], swings.period)) >= max(COHERENT, by_chance)
    if errors.noise > 0.0:   # The extremes of a noisy swing exceed it.
        amplitude = _folded(errors.t[part], free[part], period)
    period = period if share >= COHERENT else swings.period
    about = free[part] - free[part].mean()
    random = float(np.mean(np.diff(about[::errors.apart]) ** 2)) >= RANDOM_SHARE * float(np.mean(about**2))
    if not regular and (random or amplitude <= errors.noise or float(np.abs(errors.error[part]).max()) <= errors.band):
        return None
    grows_on = math.log(float(sizes[-1] / sizes[-2])) > DECAYS_ON * rate * float(middle[-1] - middle[-2])
    if rate * span > max(GROWTH_OF_SWINGS, least) and grows_on:
        return Judged(LoopVerdict.GROWING, f"an oscillation with a period of {period:.3g} s grows by a factor of "
                      f"{math.exp(rate):.3g} per second, to +-{speed(0.5 * sizes[-1], 3)}", -1, 0.5 * float(sizes[-1]),
                      period)
    how = "with a period of" if regular or swings.regular else "irregularly, about every"
    return Judged(LoopVerdict.HUNTING, f"the mean oscillates by +-{speed(amplitude, 3)} {how} {period:.3g} s", -1,
                  amplitude, period)


def _decays_on(swings: Swings, rate: float) -> bool:
    """Return whether the last two swings are smaller than those before as the rate (1/s) of a decay lets expect.

    A decay towards an oscillation of lasting size ends.
    """
    sizes = swings.sizes
    if len(sizes) < 4:
        return True
    apart = 0.5 * float(swings.durations[-4:].sum())
    return math.log(float(sizes[-2:].mean()) / float(sizes[-4:-2].mean())) < DECAYS_ON * rate * apart


def _best_sine(t: Floats, signal: Floats, period: float) -> tuple[float, float]:
    """Return the part of a signal's variance that a sine of about this period, s, holds, and its best period."""
    about, best = signal - signal.mean(), (0.0, period)
    for near in (np.linspace(0.8, 1.25, 19), np.linspace(0.98, 1.02, 9)):
        for each in best[1] * near:
            part = _sine(2.0 * math.pi / each * t, about)[1]
            best = max(best, (float(part @ part), float(each)))
    return best[0] / max(float(about @ about), 1e-300), best[1]


def _sine(phase: Floats, signal: Floats) -> tuple[float, Floats]:
    """Return the amplitude and the values, (n,), of the sine of these phases, (n,), that fits a signal best."""
    columns = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    factors = np.linalg.lstsq(columns, signal, rcond=None)[0]
    return float(np.hypot(*factors)), columns @ factors


def _folded(t: Floats, signal: Floats, period: float) -> float:
    """Return half the range of a signal's mean at a period's phases, as many as half of its samples allow, 8 at least.
    """
    count = max(min(int(period / float(np.median(np.diff(t)))), 24) // 2, 3)
    place = (t / period % 1.0 * count).astype(int)
    means = [float(signal[place == k].mean()) for k in range(count) if (place == k).any()]
    return 0.5 * (max(means) - min(means)) / float(np.sinc(1.0 / count))


def _repeats(t: Floats, signal: Floats, period: float) -> float:
    """Return the correlation of a signal with itself a period, s, before, the largest near it."""
    best = -1.0
    for each in period * np.linspace(0.85, 1.15, 31):
        later = t >= t[0] + each
        if np.count_nonzero(later) > 2:
            pair = signal[later], np.interp(t[later] - each, t, signal)
            if min(np.ptp(pair[0]), np.ptp(pair[1])) > 0.0:
                best = max(best, float(np.corrcoef(*pair)[0, 1]))
    return best


def _running_away(errors: Errors, signal: Floats, band: float, whole: float, noise: float,
                  blocks: int = BLOCKS) -> tuple[float, float, float] | None:
    """Return the last rate, 1/s, of a signal's growth to the end beyond a band without oscillation, for a fifth of the
    segment, and its first and last value; None if it does not grow.
    """
    each = max(len(signal) // blocks, 1)
    count = len(signal) // each
    tail = slice(len(signal) - count * each, None)
    error, t = (column[tail].reshape(count, each).mean(axis=1) for column in (signal, errors.t))
    sign = math.copysign(1.0, error[-1])
    noise /= math.sqrt(each)
    back = np.flatnonzero((np.diff(error) * sign <= -noise) | (error[1:] * sign <= band))
    begin = int(back[-1]) + 1 if len(back) else 0
    if (count - begin) * each < GROWING_CYCLES or t[-1] - t[begin] < 0.2 * whole:
        return None
    third = (count - begin) // 3
    early, middle, late = (sign * float(error[k]) for k in (-1 - 2 * third, -1 - third, -1))
    if late - middle <= SLOWING * (middle - early) or late - early <= 2.0 * noise:
        return None
    return (late - middle) / float(t[-1] - t[-1 - third]), float(error[begin]), float(error[-1])


def _at_the_end(errors: Errors, swings: Swings) -> Judged:
    """Return the verdict on an error without lasting oscillation: settled, off target, or still moving."""
    n, since = len(errors.error), errors.inside_from
    if n - since >= SETTLED_CYCLES:
        rest = float(errors.ends[-1] - errors.starts[since])
        left = swings_of(errors.t[since:], errors.error[since:], errors.floor, 2.0 * errors.noise)
        # An oscillation that has ended stays away for a period of its own, unless its last turning point is inside.
        outside = swings.alive and float(errors.t[-1]) - swings.quiet < errors.starts[since]
        many, period = 1.0, swings.period if outside else 0.0
        if len(left.sizes) and not left.flat:
            many, period = QUIET_PERIODS, 2.0 * float(left.durations.max())
        if rest < many * period:
            return Judged(LoopVerdict.TOO_SHORT, f"within {speed(errors.band, 3)} for the last {rest:.3g} s, less than "
                          f"{counted(round(many), 'period')} of an oscillation of {period:.3g} s")
        if _leaves(errors, since):
            return Judged(LoopVerdict.TOO_SHORT, f"within {speed(errors.band, 3)} for the last {rest:.3g} s, but still "
                          "moving through this band")
        return Judged(LoopVerdict.SETTLED, f"within {speed(errors.band, 3)} for the last {rest:.3g} s", since)
    last = errors.error[-(n // 3 + 1):]
    mean, spread = float(last.mean()), float(np.abs(last - last.mean()).max())
    early, late = (float(part.mean()) for part in np.array_split(last, 2))
    moved = abs(late - early)
    if moved <= STANDING * abs(mean) and spread <= max(2.0 * errors.floor, 0.5 * abs(mean)):
        side = "above" if mean > 0.0 else "below"
        return Judged(LoopVerdict.OFF_TARGET, f"the mean stays {speed(abs(mean), 3)} {side} the target")
    if swings.alive:
        return Judged(LoopVerdict.TOO_SHORT, f"an oscillation with a period of {swings.period:.3g} s has not decayed")
    return Judged(LoopVerdict.TOO_SHORT, f"still moving at the end, {speed(abs(float(errors.error[-1])), 3)} "
                                     f"{'above' if errors.error[-1] > 0.0 else 'below'} the target")


def _leaves(errors: Errors, since: int) -> bool:
    """Return whether the error, extrapolated from the thirds of the rest, leaves the band again.

    An approach slows down from third to third; d3^2/(d2 - d3) is what is left of a geometric one. An oscillation that
    passes the target does not slow down and goes on for as long as the rest. One that turns within the band does not
    leave it.
    """
    rest = errors.error[since:]
    points = turning_points(rest, 0.25 * errors.band)
    if (np.abs(rest[points] - rest[0]) >= 0.25 * errors.band).any():
        return False
    a, b, c = (float(part.mean()) for part in np.array_split(rest, 3))
    early, late = b - a, c - b
    if early * late <= 0.0:
        return False
    left = late * late / (abs(early) - abs(late)) if abs(late) < abs(early) else math.inf
    return abs(c + math.copysign(min(left, 3.0 * abs(late)), late)) > errors.band


def _without_forced(errors: Errors, first: int) -> tuple[Floats, bool]:
    """Return the errors without the part that a moving reference, with the loop's delay too, and its rate explain, and
    whether they explain most.

    A loop that lags behind a moving target does not hunt.
    """
    error, reference = errors.error, errors.reference
    first = max(first, 1)  # The target may jump within the first cycle.
    if len(error) - first < GROWING_CYCLES or float(np.ptp(reference[first:])) <= errors.floor:
        return error, False
    rate = np.gradient(reference, errors.t)
    late = reference if errors.late is None else errors.late
    columns = np.stack([np.ones(len(error)), reference, rate, late], axis=1)
    part = slice(first, None)
    factors = np.linalg.lstsq(columns[part], error[part], rcond=None)[0]
    left = error - columns @ factors
    about = error[part] - error[part].mean()
    explains = float(np.sum(left[part] ** 2)) < UNEXPLAINED * float(np.sum(about ** 2))
    return (left, True) if explains else (error, False)


class Signal(NamedTuple):
    """Samples of a signal: times, s, and values, (n,) arrays."""

    t: Floats
    values: Floats

    def within(self, begin: float, end: float) -> Signal:
        """Return the finite samples after `begin` and up to `end`, s."""
        t, values = (column[slice(*np.searchsorted(self.t, [begin + 1e-9, end + 1e-9]))] for column in self)
        return Signal(t[np.isfinite(values)], values[np.isfinite(values)])

    def stretches(self) -> list[Signal]:
        """Return the parts between gaps (`BRIDGED_TICKS`)."""
        if len(self.t) < 2:
            return []
        steps = np.diff(self.t)
        edges = [0, *(np.flatnonzero(steps > BRIDGED_TICKS * float(np.median(steps))) + 1).tolist(), len(self.t)]
        return [Signal(self.t[a:b], self.values[a:b]) for a, b in pairwise(edges) if b - a > 1]


NO_SIGNAL = Signal(np.empty(0), np.empty(0))


def judder_line(slip: Signal, starts: Floats, ends: Floats, floor: float) -> tuple[float, float]:
    """Return amplitude, rad/s, and frequency, Hz, of the judder in engine cycles, (n,) arrays of their starts and ends,
    s; NaN without any.

    slip : slip speed, rad/s
    floor : least amplitude that counts, rad/s
    """
    none = math.nan, math.nan
    breaks = np.flatnonzero(starts[1:] > ends[:-1] + 1e-6 * np.diff(starts)) + 1
    starts, ends = (max(np.split(edges, breaks), key=len) for edges in (starts, ends))  # The longest without a gap.
    n = len(starts)
    inside = (slip.t >= starts[0] - 1e-9) & (slip.t <= ends[-1] + 1e-9) if n else np.zeros(len(slip.t), dtype=np.bool_)
    points = min(int(np.count_nonzero(inside)) // max(n, 1), JUDDER_POINTS)
    if n < JUDDER_CYCLES or points < LEAST_SAMPLES:
        return none
    phases = (np.arange(points) + 0.5) / points
    t = starts[:, None] + (ends - starts)[:, None] * phases
    from scipy.interpolate import CubicSpline

    x = CubicSpline(slip.t[inside], slip.values[inside])(t)  # Lines between few samples would beat with the cycles.
    floor = max(floor, JUDDER_LEAST * float(np.ptp(x.mean(axis=1))))   # Sidelobes of a slow change.
    turns = np.arange(n) - 0.5 * (n - 1)
    columns = np.stack([np.ones(n), turns, turns**2], axis=1)
    usual = columns @ np.linalg.lstsq(columns, x, rcond=None)[0]   # Excitation, and its slow change.
    x -= usual
    spectrum = np.fft.rfft(x.ravel() * np.hanning(x.size))
    power = np.abs(spectrum) ** 2
    orders = np.arange(len(power)) / n
    slow = orders < JUDDER
    peak = max(int(power[slow].argmax()), 1)
    left, middle, right = np.log(np.maximum(power[peak - 1:peak + 2], 1e-300))
    swing = (peak + 0.5 * (left - right) / min(left - 2.0 * middle + right, -1e-300)) / n
    # Hann's window spreads a line over two bins; a slow swing modulates what repeats in each cycle.
    near = 2.5 / n + (1.5 * swing if power[slow].max() > 0.1 * power[~slow].max() else 0.0)
    apart = np.abs(orders - np.rint(orders))
    fast = ~slow & (apart > near)
    if (most := power[slow].max()) > power[fast].max(initial=0.0):  # Harmonics of a swing are no judder.
        multiple = np.maximum(np.rint(orders / max(swing, 1.0 / n)), 1.0)
        fast &= ((np.abs(orders - multiple * swing) > (2.5 + 0.2 * multiple) / n) | (multiple > HARMONICS)
                 | (power > most * (LARGEST_HARMONIC / multiple) ** 2))
    judder = np.where(fast & (orders <= 0.5 * points), power, 0.0)
    total, best = float(judder.sum()), int(judder.argmax())
    line = slice(max(best - 2, 0), best + 3)
    if total == 0.0 or float(judder[line].sum()) < JUDDER_SHARE * total or power[line].max() > power[best]:
        return none  # Too little of it is one line, or the line is a flank of another one.
    # A sample between two others would be too small.
    at = np.interp(slip.t[inside], np.append(starts, ends[-1]), np.arange(n + 1))
    y = slip.values[inside] - CubicSpline(t.ravel(), usual.ravel())(slip.t[inside])
    order, amplitude = float(orders[best]), 0.0
    for width in (1.0, 0.2, 0.04):
        tried = order + width / n * np.linspace(-1.0, 1.0, 11)
        sizes = [_sine(2.0 * math.pi * each * at, y)[0] for each in tried]
        amplitude, order = max(zip(sizes, tried.tolist()))
    return (amplitude, order * n / float(ends[-1] - starts[0])) if amplitude > floor else none


def _filled(t: Floats, values: Floats, period: float, cycle: float) -> tuple[Floats, Floats]:
    """Return samples, (n,), with the single lost ones among them: a line between their neighbours would cut the judder.

    Each has the value of a sine of the judder's period, s, and of one of the engine cycle, s, that fit the samples of a
    cycle before and after it.
    """
    lost = np.flatnonzero(np.diff(t) > 1.5 * float(np.median(np.diff(t))))
    at, found = 0.5 * (t[lost] + t[lost + 1]), np.empty(len(lost))
    for k, time in enumerate(at):
        near = slice(*np.searchsorted(t, [time - cycle, time + cycle]))
        shifted = np.append(t[near] - time, 0.0)
        phases = 2.0 * math.pi * shifted / np.array([[period], [cycle]])
        columns = np.stack([np.ones(len(shifted)), shifted, *np.cos(phases), *np.sin(phases)], axis=1)
        found[k] = columns[-1] @ np.linalg.lstsq(columns[:-1], values[near], rcond=None)[0]
    return np.insert(t, lost + 1, at), np.insert(values, lost + 1, found)


def means_without(slip: Signal, starts: Floats, ends: Floats, period: float) -> Floats:
    """Return the means over cycles, (n,), of the slip speed's average over one period of a judder, s; NaN where a
    stretch without a gap is shorter than that.
    """
    out = np.full(len(starts), math.nan)
    for t, values in slip.stretches():
        t, values = _filled(t, values, period, float(np.median(ends - starts)))
        inside = (starts >= t[0] - 1e-9) & (ends <= t[-1] + 1e-9) & (t[-1] - t[0] > period + ends - starts)
        # The mean over a cycle of which the start runs through a period of the judder, centred unless the stretch ends.
        length = (ends - starts)[inside]
        first = np.clip(starts[inside] - 0.5 * period, t[0], t[-1] - period - length)
        area = integral(integral(values, t), t)
        corners = [np.interp(first + shift, t, area) for shift in (0.0, length, period, period + length)]
        out[inside] = (corners[3] - corners[2] - corners[1] + corners[0]) / (period * length)
    return out
