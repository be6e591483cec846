"""Engine cycles of a trajectory, and the results of its steady state, as in `simulate` and `analyse`.

Each cycle has extremes, section points and time in stick, from the solver or from samples; the summary of the kept ones
has maxima, section, period, stick and regime.

A period, in engine cycles, is stated if the stroboscopic section repeats with it and with no divisor of it, now or,
while it still settles, in the limit of its decay. Otherwise there is none yet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.repetition import LONGEST, repetitions
from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.model import equations
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import TIME, along
from tcc_sim.result import Result, reported, result_class
from tcc_sim.solvers.per_cycle import STAMP, cycles_from_samples, starts_of
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.trajectory import Cycles, FarEnd, Floats, Loads, Trajectory, concatenated, split_cycles

TOLERANCE = 1e-4  # Repetition, relative to the size of the motion, that counts as settled.
FINE = 1e-8
"""Repetition of each coordinate, relative to its largest value, over cycles after which fewer need not be seen."""
DRIFT = 4.0  # Change of the largest slip speeds over a run without a period that marks a transient, in standard errors.
AFTER_A_GAP = 16
"""Least length without a gap before a period is stated after one: that of the longest, periods of excitation."""


@dataclass(frozen=True)
class Periodicity:
    """Repetition of a section.

    period : in engine cycles, 0 if none up to 16 can be stated yet
    settled : whether the section repeats within the tolerance; False for a period of the limit of a decay
    change : largest difference between the last two periods (of one cycle without a period), relative to the size of
        the motion; NaN for too few cycles
    longest : longest period that was looked for; 0 for too few cycles
    """

    period: int
    settled: bool
    change: float
    longest: int = 0


def longest_tried(points: int, maximum: int = LONGEST) -> int:
    """Return the longest period that so many section points can show, periods of excitation."""
    return min(maximum, points // 3)


def periodicity(cycles: Cycles, tolerance: float = TOLERANCE, maximum: int = LONGEST) -> Periodicity:
    """Return the smallest number of engine cycles after which the section repeats.

    Settled: over the last quarter of the cycles, and at least three periods, points p cycles apart stay within
    `tolerance` of one another. All of them are compared, not only neighbours, so that a slow drift does not pass.
    Settling: the differences of points p cycles apart decay like a linear map of up to three modes, and its limit is
    near and repeats after p cycles. In both cases there is no period yet if the differences of points a divisor of p
    apart may be decaying to zero, or if those p apart still grow. The size of speeds is the largest speed of the
    motion, that of angles the largest angle on the section.

    cycles : consecutive engine cycles without the transient; NaN marks cycles that were not observed. Only those after
        the last gap are used, if there are at least `AFTER_A_GAP`
    tolerance : relative to the size of the motion
    maximum : longest period, engine cycles
    """
    first = _after_gap(cycles)
    points = cycles.section[first:]
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        points = points[int(np.flatnonzero(~finite)[-1]) + 1:]
    if len(points):
        points = points / sizes_of(points, cycles.highest[first:], cycles.lowest[first:])
    return of_points(points, longest_tried(len(points), maximum) if not first or enough_after_a_gap(cycles) else 0,
                     tolerance)


def of_points(points: Floats, most: int, tolerance: float) -> Periodicity:
    """Return the repetition of section points, (n, 3), in units of the motion's size, with a period of at most `most`.
    """
    if len(points) < 2 or most < 1:
        return Periodicity(0, False, _largest(points[-1] - points[-2]) if len(points) > 1 else math.nan)
    return Periodicity(*repetitions(points[None], most, tolerance)[0], most)


def cycles_drift(cycles: Cycles) -> bool:
    """Return whether the largest slip speeds of cycles without a period still grow or decay.

    The means over their quarters change in one direction, in all by more than `DRIFT` standard errors, which
    is rare for a torus or chaos, and by more than the tolerance. Too few cycles for quarters count as a drift.
    """
    largest = cycles.largest[np.isfinite(cycles.largest)]
    width = len(largest) // 4
    if width < 2:
        return True
    quarters = largest[len(largest) - 4 * width:].reshape(4, width)
    error = np.sqrt(quarters.var(axis=1).mean() * 2.0 / width)
    change: Any = np.diff(quarters.mean(axis=1))
    return bool(abs(change.sum()) > max(DRIFT * error, TOLERANCE * largest.max())
                and ((change > 0.0).all() or (change < 0.0).all()))


def enough_after_a_gap(cycles: Cycles) -> bool:
    """Return whether enough cycles follow the last gap; fewer may repeat by chance."""
    first = _after_gap(cycles)
    return first == 0 or len(cycles) - first >= AFTER_A_GAP


def _after_gap(cycles: Cycles) -> int:
    """Return the number of the first cycle after the last gap; 0 without a gap."""
    observed = np.isfinite(cycles.highest) & np.isfinite(cycles.lowest)
    return 0 if observed.all() else int(np.flatnonzero(~observed)[-1]) + 1


def stays(cycles: Cycles, further: Cycles, period: int, tolerance: float = TOLERANCE) -> bool:
    """Return whether the section of further cycles stays within `tolerance` of the last period before."""
    last = cycles.section[len(cycles.section) - period:]
    apart = further.section - last[(np.arange(len(further.section)) - 1) % period]
    apart /= sizes_of(cycles.section, cycles.highest, cycles.lowest)
    return bool(np.abs(apart).max() <= tolerance)


def repeats_finely(cycles: Cycles, period: int, count: int) -> bool:
    """Return whether the last `count` cycles repeat so closely that 0.4 `count` further ones stay within the tolerance.

    A difference that grew from rounding to `fine` in so many cycles needs more cycles to leave.
    """
    points = cycles.section[-count - period:]
    if len(points) < count + period:
        return False
    apart = np.abs(points[period:] - points[:-period]).max(axis=0)
    return bool((apart <= FINE * np.abs(points).max(axis=0)).all())


def sizes_of(points: Floats, *speeds: Floats) -> Floats:
    """Return the size of a motion: of slip and plate speed the largest speed, of angles the largest on the section.

    Neither is below 1e-6, in s or 1/s, of the other: at rest the speeds are rounding errors.
    """
    v, angle, w = np.abs(points).max(axis=0).tolist() if len(points) else (0.0, 0.0, 0.0)
    speed = max(v, w, *map(_largest, speeds))
    fast, far = max(speed, 1e-6 * angle) or 1.0, max(angle, 1e-6 * speed) or 1.0
    return np.array([fast, far, fast])


def _largest(x: Floats) -> float:
    """Return the largest magnitude, 0 for an empty array."""
    return float(np.abs(x).max()) if x.size else 0.0


DISCARD = 50  # Length dropped as transient: the paper's rule, periods of excitation.
ROUNDING = 1e-12  # Largest share of time in stick that counts as 0, and in slip as 1.
GROWTH_ERRORS = 4.0  # Standard errors by which the slip speed must rise over a run that grows.
HALVING_ERRORS = 2.0  # Standard errors by which the second step of the rise must exceed half of the first.
PASSING = 5e-3
"""Largest stick fraction that counts as slip through v = 0: the smoothed law counts the passage through its layer."""


def cycles_of(trajectory: Trajectory) -> Cycles:
    """Return the whole engine cycles of a trajectory, from its solver or from its samples."""
    return cycle_parts_of(trajectory)[1]


def cycle_parts_of(trajectory: Trajectory) -> tuple[Cycles | None, Cycles, Cycles | None]:
    """Return the whole engine cycles of a trajectory between the parts of cycles before and after; None for no part.

    They come from its solver or from its samples. Between samples, slip speed and plate angle are interpolated with the
    accelerations by (2a) and (2b) for the sampled torques.

    Raises InputError: samples without their system, or too few of them.
    """
    if trajectory.cycles is not None:
        return None, trajectory.cycles, trajectory.rest
    if trajectory.system is None:
        raise InputError("the trajectory has neither per-cycle results nor the system to work them out with")
    if len(trajectory.t) < 2:
        raise InputError("the trajectory has fewer than two samples")
    begin, end = float(trajectory.t[0]), float(trajectory.t[-1])
    starts = starts_of(varying(trajectory), first_cycle_of(trajectory), end, trajectory.cycle)
    near = STAMP + 1e-8 * trajectory.cycle
    if starts[0] > end - near:
        starts = starts[:0]
    early = int(not len(starts) or starts[0] > begin + near)
    late = int(not len(starts) or starts[-1] < end - near)
    cuts = np.concatenate([[begin] * early, starts, [end] * late])
    laws = Laws()
    run, far = trajectory, trajectory.far_end
    whole = laws.cycles(np.stack(np.broadcast_arrays(
        run.t, run.slip_speed, run.plate_angle, run.plate_speed, run.engine_torque, run.friction_torque, far.angle,
        far.speed, run.along(laws.number_of), 0.0)), cuts)
    if not len(starts):
        return None, whole[:0], whole
    return whole[:1] if early else None, *split_cycles(whole[early:], len(starts) - 1)


class Laws:
    """Stick speeds and linear parts that held in a run whose keys changed, for the cycles of its samples."""

    def __init__(self) -> None:
        self._laws: list[tuple[float, equations.Linear]] = []

    def number_of(self, system: System) -> int:
        """Return the number of a system's stick speed and linear part; systems that share both have one number."""
        terms = terms_of(system)
        law = stick_speed_of(terms), terms.linear
        if law not in self._laws:
            self._laws.append(law)
        return self._laws.index(law)

    def cycles(self, rows: Floats, cuts: Floats) -> Cycles:
        """Return the cycles of samples between `cuts`, (m + 1,) s, with the law that held in each interval.

        rows : (10, n) time, slip speed, plate angle, plate speed, engine torque, friction torque (s, rad/s, rad, rad/s,
            N m, N m), angle and speed of the far end (rad, rad/s), number of the law at each sample and in the interval
            before it, and 1 where a sample before is missing
        """
        t, held, lost = rows[0], rows[-2].astype(np.int64), rows[-1, 1:] > 0.0

        def between(a: int, b: int, starts: Floats) -> Cycles:
            """Return those of the samples from a to b, both included."""
            stick_speed, linear = self._laws[held[min(a + 1, b)]]
            at, slip_speed, plate_angle, plate_speed, engine, friction, *far = rows[:-2, a:b + 1]
            slip, plate = equations.accelerations(slip_speed, plate_angle, plate_speed, engine, friction, linear, *far)
            return cycles_from_samples(at, slip_speed, slip, plate_angle, plate_speed, plate, starts=starts,
                                       stick_speed=stick_speed, linear=linear, far=FarEnd(*far), bridged=lost[a:b])

        changes = np.flatnonzero(np.diff(held))
        changes = changes[(t[changes] > cuts[0]) & (t[changes] < cuts[-1])]
        if not len(changes):
            return between(0, len(t) - 1, cuts)
        places = np.searchsorted(cuts, t[changes])
        ends, whole = np.insert(cuts, places, t[changes]), np.insert(np.ones(len(cuts), np.bool_), places, False)
        edges = [0, *(places + np.arange(len(places))).tolist(), len(ends) - 1]
        parts = concatenated([between(a, b, ends[first:last + 1]) for (a, b), (first, last) in zip(
            pairwise([0, *changes.tolist(), len(t) - 1]), pairwise(edges))])
        assert parts.loads is not None
        first, interval = np.flatnonzero(whole)[:-1], np.searchsorted(t, ends[:-1], side="right")
        energy, power, high, low, breakaways, fluid = parts.loads.columns()
        breakaways = np.where(np.diff(interval, append=-1) == 0, 0.0, breakaways)  # They belong to the later part.
        add, most, least = np.add.reduceat, np.fmax.reduceat, np.fmin.reduceat
        return Cycles(parts.section[whole], most(parts.highest, first), least(parts.lowest, first),
                      add(parts.stick_time, first), Loads(
                          add(energy, first), most(power, first), most(high, first), least(low, first),
                          add(breakaways, first), add(fluid, first)), cuts)


def first_cycle_of(trajectory: Trajectory) -> int:
    """Return the number of the first engine cycle that starts within the trajectory."""
    start, system = float(trajectory.t[0]), varying(trajectory)
    return math.ceil((start / trajectory.cycle if system is None else system.cycles_until(start)) - 1e-9)


def varying(trajectory: Trajectory) -> System | None:
    """Return the system of a trajectory whose engine cycles vary in length or do not start at t = n cycle."""
    return trajectory.system if trajectory.system is not None and trajectory.system.profile is not None else None


class CycleTimes(NamedTuple):
    """Times of consecutive engine cycles, and how the excitation varies over them.

    cycle : length of a cycle, s; an array if they differ
    first : number of the first of them, which sets the start of the section of a period
    since : their start, s
    varied : number of first cycles in which the excitation still changes; only later ones can have a period
    carried : whether friction in fast slip carries the torque at the end of a varying excitation, so that slip that
        grows with it is no runaway
    """

    cycle: float | Floats
    first: int = 0
    since: float = 0.0
    varied: int = 0
    carried: bool = False


def cycle_times_of(system: System | None, cycle: float, first: int, count: int) -> CycleTimes:
    """Return the times of `count` engine cycles from number `first` on; without a system of the length `cycle`, s."""
    if system is None or system.profile is None:
        cycle = cycle if system is None else system.cycle
        return CycleTimes(cycle, first, first * cycle)
    starts = system.cycle_start(first + np.arange(count + 1))
    _, torque, pressure = along(system.profile, float(starts[-1]))
    varied = max(math.ceil(system.cycles_until(float(system.profile[-1, TIME])) - 1e-9) - first, 0)
    return CycleTimes(np.diff(starts), first, float(starts[0]), varied,
                  bool(abs(torque) < system.torque_per_pressure * pressure))


def default_discard(cycles: int) -> int:
    """Return the default number of dropped cycles: 50, or half of fewer than 100 cycles."""
    return min(DISCARD, cycles // 2)


def dropped_of(cycles: int, discard: int | None) -> int:
    """Return the number of cycles to drop: `discard` or the default; raise InputError if it is negative or leaves none.
    """
    dropped = default_discard(cycles) if discard is None else discard
    if dropped < 0:
        raise InputError(f"--discard is {dropped}; it must be 0 or more cycles")
    if dropped >= cycles:
        whole = f"the {cycles} cycles" if cycles != 1 else "the only cycle"
        raise OutOfRange(f"--discard {dropped} leaves none of {whole}" if cycles else
                         "there is no whole period of excitation to summarise")
    return dropped


@result_class(repr=False, slots=True)
class Summary(Result):
    """Results of a run after the dropped cycles; the fields are the JSON keys of `simulate` and `analyse`.

    Examples
    --------
    >>> result = Summary(62.1, -0.01, 2, [(0.1, 0.5), (0.12, 0.4)], 0.73, "stick-slip", 150, 50, True, 1e-9, "smoothed",
    ...                 0.1)
    >>> result
    <Summary by smoothed: 150 cycles, period 2, settled, stick-slip; largest |slip speed| 62.1 rad/s>
    >>> result.columns()["stick_fraction"]
    [0.73]
    """

    max_slip_speed: float = reported("largest |slip speed|", "rad/s", scatters=True)
    min_slip_speed: float = reported("smallest slip speed, signed", "rad/s", scatters=True)
    period: int = reported(
        "period of the motion; 0 if none up to `longest_period`", "periods of excitation", scatters=True)
    section: list[tuple[float, float]] = reported(
        "plate angle and slip speed at t = 2 pi n/omega over the last period; over all kept cycles if it is 0",
        "rad, rad/s")
    stick_fraction: float = reported("time in stick over time", scatters=True)
    regime: str = reported("stick, slip or stick-slip; stick fractions within 0.005 of 0 or 1 count as slip or stick")
    cycles: int = reported("cycles solved or observed")
    discarded: int = reported("cycles dropped at the start")
    settled: bool = reported(
        "whether the section repeats within the tolerance; if not, the period is that of its limit")
    section_change: float = reported("largest change of the section over the last period, relative to the motion")
    solver: str = reported("name of the solver")
    elapsed_s: float = reported("computing time; of a point of a sweep its share by steps", "s")
    section_states: list[tuple[float, float, float]] | None = reported(
        "`section` with the plate speed", "rad, rad/s, rad/s", optional=True, default=None)
    runaway: bool = reported("whether slip grows and never sticks", scatters=True, default=False)
    transient: bool = reported(
        "whether its period is that of a limit, or its cycles still grow or decay", default=False)
    covers: tuple[float, float] = reported(
        "start and end of the time of these figures; period and section are of its whole cycles", "s",
        default=(math.nan, math.nan))
    seconds: float = reported("time within `covers` that was solved or recorded", "s", default=math.nan)
    lost_seconds: float = reported("time within `covers` hidden by lost messages", "s", default=math.nan)
    broken: int = reported("kept cycles that lost messages interrupt; a single lost state is bridged", default=0)
    longest_period: int = reported(
        "longest period looked for: 16, or a third of the kept cycles", "periods of excitation", default=0)
    clutch_energy: float = reported(
        "work of friction, integral of Tf v; null if not computed", "J", scatters=True, default=math.nan)
    mean_power: float = reported("clutch energy over its time", "W", scatters=True, default=math.nan)
    peak_power: float = reported("largest power of friction, Tf v", "W", scatters=True, default=math.nan)
    max_shaft_torque: float = reported(
        "largest torque in the shaft, C23 (theta2' - theta3') + K23 (theta2 - theta3)", "N m", scatters=True,
        default=math.nan)
    min_shaft_torque: float = reported("smallest torque in the shaft", "N m", scatters=True, default=math.nan)
    breakaways: int | None = reported("changes from stick to slip", scatters=True, default=None)
    coupling_energy: float = reported(
        "heat of the converter's fluid, integral of b v^2; null if not computed", "J", scatters=True, default=math.nan)

    def _text(self) -> str:
        period = f"period {self.period}, {'settled' if self.settled else 'settling'}" if self.period else "no period"
        period = "runaway" if self.runaway else period
        return (f"Summary by {self.solver}: {self.cycles} cycles, {period}, {self.regime}; "
                f"largest |slip speed| {self.max_slip_speed:.6g} rad/s")

    def columns(self) -> dict[str, list[Any]]:
        """Return the fields that are not lists, as a row."""
        listed = "section", "section_states", "covers"
        return {item.name: [getattr(self, item.name)] for item in fields(self) if item.name not in listed}


def summarise(trajectory: Trajectory, discard: int | None = None) -> Summary:
    """Summarise a trajectory after its first `discard` cycles.

    trajectory : solved or recorded; its status is ignored
    discard : dropped cycles; None drops 50, or half of fewer than 100 cycles

    Raises InputError: a discard that leaves no cycle, or a trajectory without cycles.
    """
    before, cycles, behind = cycle_parts_of(trajectory)
    dropped = dropped_of(len(cycles), discard) if len(cycles) or behind is None or discard else 0
    first = first_cycle_of(trajectory) + dropped
    times = cycle_times_of(varying(trajectory), trajectory.cycle, first, len(cycles) - dropped)
    return summarise_cycles(cycles[dropped:], times, dropped=dropped, by=trajectory,
                            partial=[part for part in (before if not dropped else None, behind) if part is not None])


def summarise_cycles(cycles: Cycles, times: CycleTimes, *, tolerance: float = TOLERANCE, dropped: int = 0,
                     broken: int = 0, partial: Sequence[Cycles] = (), span: Span | None = None,
                     by: Trajectory | None = None) -> Summary:
    """Summarise consecutive cycles; NaN marks those that were not observed.

    cycles : the whole cycles that were kept
    tolerance : of the period, relative to the size of the motion
    dropped : number of observed cycles before them
    broken : number of cycles among them that a gap interrupts or hides, where NaN marks the gap
    partial : parts of cycles before, between and after them, which period and section leave out
    span : time that cycles and parts cover; None for that of `times` and the `starts` of the parts
    by : trajectory with the solver and time that the summary names

    Raises InputError: nothing was observed.
    """
    observed = np.isfinite(cycles.highest) & np.isfinite(cycles.lowest) & np.isfinite(cycles.stick_time)
    count = int(observed.sum())
    if not (count or partial):
        raise OutOfRange("there is no whole period of excitation to summarise")
    steady = cycles[min(times.varied, len(cycles)):] if times.varied else cycles
    runaway = not times.carried and runs_away(cycles, times.varied, tolerance)
    repetition = periodicity(steady, tolerance)
    span = span or _span_of(observed, times, partial)
    summary = without_section(
        repetition, runaway, not repetition.period and not runaway and cycles_drift(steady), span,
        sums_of(concatenated([cycles, *partial]) if partial else cycles, span.seconds), cycles=count + broken + dropped,
        dropped=dropped, broken=broken, solver=by.solver if by is not None else "",
        elapsed=by.statistics.seconds if by is not None else 0.0)
    points = section_of(cycles.section[1:], times.first, summary.period)
    points = points[np.isfinite(points).all(axis=1)]
    return replace(summary, section=[(angle, v) for v, angle, _ in points.tolist()],
                   section_states=[(angle, v, speed) for v, angle, speed in points.tolist()])


def section_of(points: Floats, first: int, period: int) -> Floats:
    """Return the section of a summary, (n, 3), from the points at the ends of the cycles from number `first` on."""
    past = (first + len(points) + 1) % period if period else 0
    return points[len(points) - past - period:len(points) - past] if period else points


def without_section(repetition: Periodicity, runaway: bool, drifts: bool, span: Span, sums: dict[str, Any], *,
                    cycles: int, dropped: int, broken: int = 0, solver: str = "", elapsed: float = 0.0) -> Summary:
    """Return a summary without its section, from the verdicts on its cycles and `sums_of` them.

    drifts : whether cycles without a period still grow or decay
    elapsed : computing time, s
    """
    period, settled = (0, False) if runaway else (repetition.period, repetition.settled)
    return Summary(
        period=period, section=[], cycles=cycles, discarded=dropped, broken=broken, settled=settled,
        section_change=repetition.change, longest_period=repetition.longest, solver=solver, elapsed_s=elapsed,
        runaway=runaway,
        transient=not runaway and not settled and (bool(period) or drifts), covers=(span.begin, span.end),
        seconds=span.seconds, lost_seconds=span.lost, **sums)


class Span(NamedTuple):
    """Start and end of the time that figures cover, s, and the part of it that was not observed, s."""

    begin: float
    end: float
    lost: float = 0.0

    @property
    def seconds(self) -> float:
        """Observed time, s."""
        return self.end - self.begin - self.lost


def _span_of(observed: NDArray[np.bool_], times: CycleTimes, partial: Sequence[Cycles]) -> Span:
    """Return the time of consecutive cycles, and of parts before and after."""
    cycle, since = times.cycle, times.since
    if isinstance(cycle, np.ndarray):
        lasts, lost = float(cycle.sum()), float(cycle[~observed].sum())
    else:
        lasts, lost = len(observed) * cycle, int((~observed).sum()) * cycle
    ends = [part.starts[[0, -1]].tolist() for part in partial if part.starts is not None]
    return Span(min([since, *(begin for begin, _ in ends)]), max([since + lasts, *(end for _, end in ends)]), lost)


def sums_of(cycles: Cycles, seconds: float) -> dict[str, Any]:
    """Return the extremes and sums of `Summary` over cycles and parts of cycles that lie `seconds` long in time; NaN
    marks those that were not observed, and breakaways that were not counted.
    """
    seen = np.isfinite(cycles.highest) & np.isfinite(cycles.lowest) & np.isfinite(cycles.stick_time)
    part: Any = slice(None) if seen.all() else seen
    highest, lowest = float(cycles.highest[part].max()), float(cycles.lowest[part].min())
    fraction = min(max(float(cycles.stick_time[part].sum()) / seconds, 0.0), 1.0) if seconds > 0.0 else 0.0
    fraction = float(round(fraction)) if min(fraction, 1.0 - fraction) < ROUNDING else fraction
    sums: dict[str, Any] = {"max_slip_speed": max(abs(highest), abs(lowest)), "min_slip_speed": lowest,
                            "stick_fraction": fraction, "regime": regime_of(fraction)}
    if cycles.loads is None:
        return sums
    energy, power, high, low, breakaways, fluid = (column[part] for column in cycles.loads.columns())
    work, changes = float(energy.sum()), float(breakaways.sum())
    return {**sums, "clutch_energy": work, "mean_power": work / seconds if seconds > 0.0 else math.nan,
            "peak_power": float(power.max()), "max_shaft_torque": float(high.max()),
            "min_shaft_torque": float(low.min()), "breakaways": int(changes) if math.isfinite(changes) else None,
            "coupling_energy": float(fluid.sum())}


def runs_away(cycles: Cycles, varied: int = 0, tolerance: float = TOLERANCE) -> bool:
    """Return whether slip grows (`slip_grows`) to the last cycle.

    The cycles after the first `varied` ones, in which the excitation changes, are judged if they are enough. Otherwise
    slip must grow over all cycles and over the last third of them.
    """
    after = cycles[min(varied, len(cycles)):]
    if not varied or len(after) >= AFTER_A_GAP:
        return slip_grows(after, tolerance)
    return slip_grows(cycles, tolerance) and slip_grows(cycles[-(len(cycles) // 3):], tolerance)


def slip_grows(cycles: Cycles, tolerance: float = TOLERANCE) -> bool:
    """Return whether the slip of the last cycles grows like that of a runaway, without stick or reversal.

    In lasting slip, (1a) accelerates the flywheel by (Te - Tf)/I1, and |Tf| falls with |v|, so that growth continues,
    while every other motion in slip tends to one of constant size. The last cycles in slip of one sign must therefore
    be at least a third of all. In them the flywheel speed on the section, which is independent of plate vibration, must
    rise from third to third by steps that do not halve and exceed the tolerance of a repeating section, which is
    relative to the size of the motion. All of the rise must exceed `growth_errors` standard errors of the thirds' means
    by the data's own scatter (`error_of_thirds`), and so must what the second step has more than half of the first,
    `halving_errors`. After a gap in a recording, 16 cycles are needed: the cycles before may have stuck.

    cycles : consecutive, without the transient; NaN marks those that were not observed
    tolerance : of a repeating section, relative to the size of the motion
    """
    high, low = cycles.highest, cycles.lowest
    slips = (high * low > 0.0) & (cycles.stick_time == 0.0)
    stops = np.flatnonzero(~slips)
    width = (len(slips) - (int(stops[-1]) + 1 if len(stops) else 0)) // 3
    if width < max(len(slips) // 9, 1) or not enough_after_a_gap(cycles):
        return False
    speed = (cycles.section[1:, 0] + cycles.section[1:, 2])[len(slips) - 3 * width:]
    thirds = math.copysign(1.0, low[-1]) * speed.reshape(3, width)
    early, middle, late = thirds.mean(axis=1).tolist()
    size = sizes_of(cycles.section[len(slips) - 3 * width:], high[-3 * width:], low[-3 * width:])[0]
    rise, beyond_half = middle - early, late - middle - 0.5 * (middle - early)
    if not (rise > tolerance * size and beyond_half > 0.0):
        return False
    error = error_of_thirds(thirds)  # The variances of sum and difference are 2 and 3.5 times that of a mean.
    return bool(late - early > GROWTH_ERRORS * math.sqrt(2.0) * error
                and beyond_half > HALVING_ERRORS * math.sqrt(3.5) * error)


def error_of_thirds(thirds: Floats) -> float:
    """Return the standard error of the mean of a third of a run, from its (3, n) values.

    It is that of batch means, up to four in a third, about a parabola through all of them (a line for one in a third).
    A swing that repeats within a batch therefore counts as no scatter, and noise with a short memory as what it is.
    """
    width = thirds.shape[1]
    count = min(BATCHES, width)
    means = thirds[:, width - width // count * count:].reshape(3 * count, -1).mean(axis=1)
    x = np.linspace(-1.0, 1.0, 3 * count)
    rest = means - np.polyval(np.polyfit(x, means, min(count, 2)), x)
    return math.sqrt(float(rest @ rest) / (3 * count - min(count + 1, 3)) / count)


BATCHES = 4  # Most batches of a third of a run, whose means show its scatter.


def runaway_cause(system: System) -> str:
    """Return the reason for growing slip in terms of torques; it reveals wrong units, such as a pressure of 2.6."""
    torque, carried = system.engine.mean_torque, system.saturation_mean
    if abs(torque) <= carried:
        return f"the clutch carries {carried:.6g} N m in slip, but not at the instants at which the engine asks for it"
    return (f"mean torque {torque:.6g} N m exceeds what the clutch carries in slip, {carried:.6g} N m at a mean "
            f"pressure of {system.pressure.mean:.6g} Pa")


def regime_of(stick_fraction: float) -> str:
    """Return stick, slip or stick-slip."""
    if stick_fraction >= 1.0 - PASSING:
        return "stick"
    return "slip" if stick_fraction <= PASSING else "stick-slip"
