"""Solve and judge one motion: its summary and, on request, equivalent damping, Lyapunov exponent and samples; settle a
motion, which is to solve it until its section repeats.

A simulation is a sweep of one point: the command `simulate`, every point of a sweep and Python users call `simulate`.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from numbers import Integral
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from tcc_sim.analysis.measured import orders as measured
from tcc_sim.analysis.measured.orders import Orders, OrdersAtSpeeds, Spectrum
from tcc_sim.analysis.measured.signals import run_signals
from tcc_sim.analysis.repetition import LONGEST
from tcc_sim.analysis.steady import summary as steady
from tcc_sim.analysis.steady.damping import Damping, damping_of_cycles
from tcc_sim.analysis.steady.exponents import Lyapunov, largest_lyapunov_exponent
from tcc_sim.analysis.steady.summary import Summary
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.model.quantity import sequence_of_numbers
from tcc_sim.result import Result, reported, reporting, result_class
from tcc_sim.scene import Scene, system_of
from tcc_sim.solvers import check_duration, check_setting, choose, solve
from tcc_sim.trajectory import Cycles, Floats, State, Status, Trajectory, concatenated

SPECTRUM_CYCLES = 1024  # Length that a motion without a period is solved on for, cycles of the excitation.

SETTLED = 1e-6
"""Repetition of a settled section, relative to the size of the motion."""
WINDOW, BLOCK = 50, 25
"""Engine cycles over which a section repeats, three longest periods, and those that are solved at a time."""


class Start(NamedTuple):
    """Start of a run: a state on the section, and the number of the engine cycle, which sets the phase of the load."""

    state: State
    cycle: int


class SettledRun(NamedTuple):
    """A motion solved until it settled.

    run : the last block, with the status and the time of all blocks
    cycles : cycles of all blocks; None if the solver stopped early
    after : cycles after which the section repeats to the end; None if it does not
    """

    run: Trajectory
    cycles: Cycles | None
    after: int | None


def solve_to_steady_state(system: System, start: Start, most: int, **how: Any) -> SettledRun:
    """Solve a motion from a start until it settles, or for `most` engine cycles.

    Fig. 2 with the set-valued law takes about 700. `how` are options of `solvers.solve`, such as rtol.
    """
    parts: list[Cycles] = []
    done, seconds, after = 0, 0.0, None
    while after is None and done < most:
        count = min(BLOCK, most - done)
        run = solve(system, cycles=count, state=start.state, start_cycle=start.cycle, **how)
        seconds += run.statistics.seconds
        run = replace(run, statistics=replace(run.statistics, seconds=seconds))
        if run.status is not Status.DONE or run.cycles is None:
            return SettledRun(run, None, None)
        parts.append(run.cycles)
        done, start = done + count, Start(run.final, start.cycle + count)
        cycles = concatenated(parts)
        after = repeats_after(cycles) if done >= WINDOW else None
    return SettledRun(run, cycles, after)


def settled_from_start(system: System, most: int, **how: Any) -> tuple[Cycles, int]:
    """Return the cycles from a scene's initial state, and the period (0: none); raise NumericalFailure."""
    settled = solve_to_steady_state(system, Start(State.at_start(system), 0), most, **how)
    settled.run.raise_for_status()
    cycles = settled.cycles
    assert cycles is not None  # Whole cycles were asked for.
    return cycles, steady.periodicity(cycles[len(cycles) // 2 if settled.after is None else settled.after:]).period


def steady_spectrum(system: System, start: Start, period: int, **how: Any) -> Spectrum:
    """Return the spectrum of a settled motion, solved from `start`; `how` are options of `solvers.solve`.

    period : in engine cycles; 0 for none

    Raises InputError: the excitation does not repeat. Raises NumericalFailure: the solver stopped early.
    """
    system.check_repeats("a spectrum")
    run = solve(system, cycles=period or SPECTRUM_CYCLES, state=start.state, start_cycle=start.cycle,
                samples_per_cycle=measured.SPECTRUM_POINTS, **how).raise_for_status()
    count = len(run.t) - 1
    turns = start.cycle + np.arange(count + 1) / measured.SPECTRUM_POINTS
    return measured.spectrum_of(run_signals(run, (turns, lambda at: at * system.cycle)), period)


def repeats_after(cycles: Cycles) -> int | None:
    """Return the number of cycles after which the section repeats with a period up to 16 to the end; None for none.

    All points that are a period apart are within the tolerance of the last ones, relative to the size of the motion,
    over at least the last `WINDOW` cycles less one period.
    """
    points: Floats = cycles.section
    near = SETTLED * steady.sizes_of(points[-WINDOW:], cycles.highest[-WINDOW:])
    away = (np.abs(points[-2:-2 - LONGEST:-1] - points[-1]) > near).any(axis=1)
    for period in (np.flatnonzero(~away) + 1).tolist():
        number = np.arange(len(points))
        image = len(points) - period + (number - len(points)) % period
        far = (np.abs(points - points[image]) > near).any(axis=1)
        after = int(np.flatnonzero(far)[-1]) + 1 if far.any() else 0
        if len(points) - 1 - after >= max(WINDOW // 2, 2 * period):
            return after
    return None


DIRECTIONS = ("cold", "up", "down")
CYCLES, LYAPUNOV_CYCLES = 150, 2000
"""Default numbers of engine cycles of a run and of a mean growth."""
ORDER_SAMPLES = 64
"""Samples of a run whose judder or orders are computed, per period of excitation."""
CONFIRMED = "whether the section has settled and further cycles stay on it"
Called = TypeVar("Called", bound=Callable[..., Any])


@dataclass(frozen=True)
class Plan:
    """How a motion is solved, and which results are computed.

    cycles : periods of excitation solved (default 150); with discard auto the largest number
    duration : seconds solved instead (default for a scene with profiles: up to their last point)
    discard : cycles dropped from the summary at the start (default 50, but at most half of the cycles, at most a third
        of the whole cycles in a duration, and 0 for a scene with profiles); auto stops as soon as the section has
        settled, and drops the cycles before, at least half of them if it has not
    direction : start of each value of the first key of a sweep: cold from the scene's initial state, up or down from
        the last state of the neighbour below or above, with the phases of torque and load
    solver : name of a solver; auto takes smoothed or event_driven, by friction law
    rtol : relative tolerance of an adaptive solver (default: that of the solver; 1e-6 in a sweep)
    step : step of a fixed-step solver, s
    section_points : stored points of the section besides those of one period; 0 for none
    damping : add the equivalent damping (21)
    lyapunov : add the largest Lyapunov exponent
    lyapunov_cycles : cycles over which it is averaged if there is no period
    orders : add judder, and amplitudes of the first four orders of slip speed and shaft torque at these frequencies of
        the excitation, rad/s or hz, or speeds of the crankshaft, rpm (empty: five within the range of each run, or its
        constant one)

    Raises
    ------
    InputError
        A value out of its range.
    """

    cycles: int | None = None
    duration: float | None = None
    discard: int | str | None = None
    direction: str = "cold"
    solver: str = "auto"
    rtol: float | None = None
    step: float | None = None
    section_points: int = 0
    damping: bool = False
    lyapunov: bool = False
    lyapunov_cycles: int = LYAPUNOV_CYCLES
    orders: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.direction not in DIRECTIONS:
            raise InputError(f"direction is {self.direction!r}; it must be {' or '.join(DIRECTIONS)}")
        for name in ("cycles", "discard"):
            if isinstance(getattr(self, name), Integral):
                object.__setattr__(self, name, int(getattr(self, name)))  # NumPy's are none for JSON.
        if self.cycles is not None and not (isinstance(self.cycles, int) and 1 <= self.cycles <= 10_000_000):
            raise InputError(f"cycles is {self.cycles}; it must be a whole number, 1 to 10000000")
        if self.duration is not None and (self.cycles is not None or self.discard == "auto"):
            alternative = "discard auto" if self.cycles is None else "cycles"
            raise InputError(f"duration is {self.duration:g} s beside {alternative}; give one of the two")
        if self.discard != "auto" and not (self.discard is None or isinstance(self.discard, int)):
            raise InputError(f"discard is {self.discard!r}; it must be a number of cycles or auto")
        if isinstance(self.discard, int) and self.discard < 0:
            raise InputError(f"discard is {self.discard}; it must be 0 or more cycles, or auto")
        if self.orders is not None:
            object.__setattr__(self, "orders", sequence_of_numbers("orders", self.orders))
            if not all(0.0 < speed < math.inf for speed in self.orders):
                raise InputError(f"orders has the speeds {', '.join(f'{x:g}' for x in self.orders)} rad/s; they must "
                                 "be above 0")
        if not 0 <= self.section_points <= 10_000_000:
            raise InputError(f"section_points is {self.section_points}; it must be 0 to 10000000")

    @staticmethod
    def of(plan: Plan | None, settings: dict[str, Any]) -> Plan:
        """Return a plan given whole, or by its fields; raise InputError for both, or for a wrong field."""
        if plan is not None:
            if settings:
                raise InputError(f"{next(iter(settings))} is given beside a plan; change the plan instead")
            return plan
        unknown = [name for name in settings if name not in Plan.__dataclass_fields__]
        if unknown:
            raise InputError(f"{unknown[0]} is not a setting; the settings are {', '.join(Plan.__dataclass_fields__)}")
        return Plan(**settings)

    @property
    def most(self) -> int:
        """Engine cycles solved if there is no duration."""
        return CYCLES if self.cycles is None else self.cycles

    def seconds(self, system: System) -> float | None:
        """Return the duration that is solved, s; None for whole cycles."""
        if self.duration is None and self.cycles is None:
            return system.span or None
        return self.duration

    def dropped(self, cycles: int, default: int) -> int:
        """Return the number of cycles to drop: as given, or `default`; raise InputError if none would be left."""
        dropped = self.discard if isinstance(self.discard, int) else default
        if dropped >= max(cycles, 1):
            raise InputError(f"discard is {dropped}; it must be 0 to {max(cycles - 1, 0)}, since {cycles} whole cycles "
                             "are solved")
        return dropped

    def check(self, system: System) -> None:
        """Raise InputError if the solver or a requested result cannot handle this system, before anything is solved."""
        check_setting(choose(system, self.solver), self.rtol, self.step)
        for wanted, what in ((self.lyapunov, "the Lyapunov exponent"), (self.damping, "the equivalent damping"), (
                self.direction != "cold", f"direction {self.direction}"), (self.discard == "auto", "discard auto")):
            if wanted:
                system.check_repeats(what)


PAPER = Plan()
"""150 cycles, of which 50 are dropped, from the initial state."""


@result_class(repr=False)
class Simulation(Result):
    """A motion solved and judged.

    trajectory : result of the solver; with discard "auto" its last block
    summary : None if the solver failed
    angles : plate angle on the section over the last `Plan.section_points` cycles, oldest first, rad, (n,)
    end : state from which a run may continue; the start if the solver failed
    notes : sentences on how the table of inputs was read, and on what was converted, mended or left out

    Examples
    --------
    >>> simulate("slip", cycles=60)
    <Simulation by smoothed: 60 cycles, period 1, settled, slip; largest |slip speed| 166.667 rad/s>
    """

    trajectory: Trajectory
    summary: Summary | None = reported("figures of the steady state", spread=True, optional=True)
    confirmed: bool = reported(CONFIRMED)
    angles: Floats
    damping: Damping | None = reported("equivalent damping", spread=True, optional=True)
    lyapunov: Lyapunov | None = reported("largest Lyapunov exponent", optional=True)
    end: Start
    plan: Plan | None = reported("how it was solved", optional=True, default=None)
    orders: Orders | None = reported("orders, transmissibility and judder", optional=True, default=None)
    measured_orders: Orders | None = reported("those of the measurement in --inputs", optional=True, default=None)
    orders_at_speeds: OrdersAtSpeeds | None = reported("orders at given engine speeds", optional=True, default=None)
    spectrum: Spectrum | None = reported("amplitudes over frequency and order", optional=True, default=None)
    notes: tuple[str, ...] = ()

    def _text(self) -> str:
        if self.summary is None:
            return f"Simulation by {self.trajectory.solver}: {self.status}"
        return self.summary._text().replace("Summary", "Simulation", 1)

    def columns(self) -> dict[str, list[Any]]:
        """Return the summary's columns; `status` alone without a summary."""
        return self.summary.columns() if self.summary is not None else {"status": [self.status]}

    @property
    def status(self) -> str:
        """How the solver ended, in a sentence."""
        run = self.trajectory
        return f"{run.status.value}; {run.detail}" if run.detail else run.status.value

    @reporting("sentences on the scene and the solver, if any", optional=True)
    def warnings(self) -> list[str] | None:
        run = self.trajectory
        doubts = [f"{run.solver}: {run.detail}"] if run.status is Status.DONE and run.detail else []
        return [*doubts, *self.notes] or None

    def raise_for_status(self) -> Simulation:
        """Return this simulation; raise InputError for a refused case, NumericalFailure for an early stop."""
        if self.trajectory.status is Status.REFUSED:
            raise InputError(f"{self.trajectory.solver}: {self.trajectory.detail or self.trajectory.status.value}")
        self.trajectory.raise_for_status()
        return self


def with_plan_fields(function: Called) -> Called:
    """Return the function with the fields of `Plan` in its signature in place of ``**settings``."""
    signature = inspect.signature(function)
    named = [p for p in signature.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
    names = {p.name for p in named}
    settings = [inspect.Parameter(item.name, inspect.Parameter.KEYWORD_ONLY, default=item.default, annotation=item.type)
                for item in fields(Plan) if item.name not in names]
    function.__signature__ = signature.replace(parameters=[*named, *settings])  # type: ignore[attr-defined]
    return function


@with_plan_fields
def simulate(scene: Scene | System | str | Path, plan: Plan | None = None, *, samples_per_cycle: int = 0,
             flywheel_angle: bool = False, start: Start | None = None, **settings: Any) -> Simulation:
    """Solve a motion and compute its summary and the further results of the plan.

    scene : a scene, its name or file, or a system
    plan : how; alternatively the fields of `Plan` one by one, such as ``simulate("fig02", damping=True)``
    samples_per_cycle, flywheel_angle : as for `solvers.solve`; a duration below one cycle needs samples
    start : start of the run; by default the system's initial state at cycle 0

    Returns Simulation; a numerical failure is its status, without a summary

    Raises InputError: an unknown scene or setting, or a value out of its range.
    """
    system = system_of(scene)
    plan = Plan.of(plan, settings)
    plan.check(system)
    start = start or Start(replace(State.at_start(system), flywheel_angle=system.initial.plate_angle), 0)
    if plan.orders is not None:
        samples_per_cycle = samples_per_cycle or ORDER_SAMPLES
    run, cycles, discarded = _run(system, plan, start, {
        "samples_per_cycle": samples_per_cycle, "flywheel_angle": flywheel_angle})
    result = _judged(system, plan, start, run, cycles, discarded)
    if plan.orders is None or result.summary is None:
        return result
    return replace(result, orders_at_speeds=measured.orders_at_speeds(run, plan.orders, result.summary.covers[0]))


def _run(system: System, plan: Plan, start: Start, kept: dict[str, Any]) -> tuple[Trajectory, Cycles | None, int]:
    """Solve by the plan: the run, its cycles, and how many of them to drop."""
    if (duration := plan.seconds(system)) is not None:
        check_duration(system, duration, start.cycle)
        whole = system.whole_cycles(start.cycle, duration)
        span, default = {"duration": duration}, min(steady.DISCARD, whole // 3)
    elif plan.discard == "auto":
        return _settled_run(system, plan, start, kept)
    else:
        whole = plan.most
        span, default = {"cycles": whole}, steady.default_discard(whole)
    discarded = plan.dropped(whole, default if system.profile is None else 0)
    run = _solve(system, plan, start, loads_from=discarded, **span, **kept)
    return run, run.cycles, discarded


def _solve(system: System, plan: Plan, start: Start, **span: Any) -> Trajectory:
    return solve(system, solver=plan.solver, rtol=plan.rtol, step=plan.step, start_cycle=start.cycle, state=start.state,
                 **span)


def _settled_run(system: System, plan: Plan, start: Start,
                 kept: dict[str, Any]) -> tuple[Trajectory, Cycles | None, int]:
    """Solve until the section repeats; drop the cycles before, or at least half if it never does."""
    settled = solve_to_steady_state(system, start, plan.most, solver=plan.solver, rtol=plan.rtol, step=plan.step,
                                    loads_from=0)
    if settled.cycles is None:
        return settled.run, None, 0
    count = len(settled.cycles)
    after = min(max(steady.DISCARD, (count + 1) // 2), count - 1) if settled.after is None else settled.after
    run = _solve(system, plan, start, cycles=count, loads_from=after, **kept) if any(kept.values()) else settled.run
    return run, settled.cycles, after


def _judged(system: System, plan: Plan, start: Start, run: Trajectory, cycles: Cycles | None,
            discarded: int) -> Simulation:
    failed = Simulation(run, None, False, np.empty(0), None, None, start, plan)
    if run.status is not Status.DONE:
        return failed
    final = run.final
    if not all(map(math.isfinite, (final.slip_speed, final.plate_angle, final.plate_speed))):
        return replace(failed, trajectory=replace(run, status=Status.NOT_FINITE))
    cycles = cycles if cycles is not None else steady.cycles_of(run)
    kept = cycles[discarded:]
    end = Start(State(*cycles.section[-1].tolist()), start.cycle + len(cycles)) if len(cycles) else start
    summary = steady.summarise_cycles(
        kept, steady.cycle_times_of(system, 0.0, start.cycle + discarded, len(kept)), dropped=discarded, by=run,
        partial=[run.rest] if run.rest is not None else [])
    if plan.discard == "auto" and not (summary.settled or summary.runaway):
        summary = replace(summary, transient=True)
    return Simulation(run, summary, _confirmed(system, plan, kept, summary, end), angles_of(plan, kept),
                      *requested(system, plan, kept, start.cycle + discarded, summary.period, end), end, plan)


def angles_of(plan: Plan, kept: Cycles) -> Floats:
    """Return the plate angle on the section over the last cycles, as many as the plan stores, rad, (n,)."""
    if not plan.section_points:
        return np.empty(0)
    angles: Floats = kept.section[max(len(kept) + 1 - plan.section_points, 1):, 1].copy()
    return angles


def requested(system: System, plan: Plan, kept: Cycles, first: int, period: int,
              end: Start) -> tuple[Damping | None, Lyapunov | None]:
    """Return equivalent damping and Lyapunov exponent of a motion, if the plan has them; `first` is the number of the
    first kept cycle.
    """
    return (damping_of_cycles(system, kept, first, period) if plan.damping else None,
            largest_lyapunov_exponent(system, end.state, cycles=plan.lyapunov_cycles, start_cycle=end.cycle,
                                      period=period) if plan.lyapunov else None)


def confirming_cycles(period: int) -> int:
    """Return the number of further cycles that must keep a period."""
    return max(10, 2 * period)


def _confirmed(system: System, plan: Plan, kept: Cycles, summary: Summary, end: Start) -> bool:
    """Return whether the section has settled and further cycles keep its period."""
    if not (summary.period and summary.settled):
        return False
    count = confirming_cycles(summary.period)
    if steady.repeats_finely(kept, summary.period, 5 * count // 2):
        return True
    further = _solve(system, plan, end, cycles=count)
    if further.status is not Status.DONE or further.cycles is None:
        return False
    return steady.stays(kept, further.cycles, summary.period)
