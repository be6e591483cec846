"""One point of a sweep: what a motion comes to at one value of a scene key, and the state from which a neighbour goes
on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from tcc_sim.analysis.cycles import DISCARD, default_discard
from tcc_sim.analysis.damping import Damping, damping_as_json, damping_of_cycles
from tcc_sim.analysis.periodicity import MAXIMUM_PERIOD, TOLERANCE, periodicity
from tcc_sim.analysis.summary import Summary, summarise_cycles
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.solvers import solve
from tcc_sim.studies.lyapunov import Lyapunov, largest_lyapunov_exponent
from tcc_sim.trajectory import Cycles, Floats, State, Status, Trajectory, concatenated

DIRECTIONS = ("cold", "up", "down")
SETTLING_BLOCK = 25
"""Cycles solved at a time while `auto` waits for the section to settle."""
SETTLING_WINDOW = 50
"""Cycles over which a settled section must repeat; three periods of the longest that is looked for."""
SETTLING_TOLERANCE = 1e-6
"""Repetition, relative to the size of the motion, at which `auto` stops."""
LYAPUNOV_CYCLES = 2000


@dataclass(frozen=True)
class Plan:
    """What a sweep does at every value.

    cycles : engine cycles solved; with discard "auto" the most that are
    discard : cycles dropped; None drops 50, or half of them where there are fewer than 100; "auto" drops those before
        the
        section has settled
    direction : cold starts every point from the scene's initial state; up and down go on from the neighbour's last
        state
        (at phase 0), from the lowest value or from the highest
    solver, rtol, step : as `solvers.solve` takes them
    section_points : points of the section kept besides those of one period; 0 keeps none
    damping : whether (21) is worked out, on the last cycles with dense samples
    lyapunov : whether the largest Lyapunov exponent is worked out
    lyapunov_cycles : cycles over which it is averaged
    """

    cycles: int = 150
    discard: int | str | None = None
    direction: str = "cold"
    solver: str = "auto"
    rtol: float | None = None
    step: float | None = None
    section_points: int = 0
    damping: bool = False
    lyapunov: bool = False
    lyapunov_cycles: int = LYAPUNOV_CYCLES

    def __post_init__(self) -> None:
        if self.direction not in DIRECTIONS:
            raise InputError(f"direction is {self.direction!r}; it must be {' or '.join(DIRECTIONS)}")
        if not 1 <= self.cycles <= 10_000_000:
            raise InputError(f"cycles is {self.cycles}; it must be 1 to 10000000")
        if self.discard != "auto" and not (self.discard is None or isinstance(self.discard, int)):
            raise InputError(f"discard is {self.discard!r}; it must be a number of cycles or auto")
        if isinstance(self.discard, int) and not 0 <= self.discard < self.cycles:
            raise InputError(f"discard is {self.discard}; it must be 0 to {self.cycles - 1}, below the number of cycles")


@dataclass(frozen=True)
class Point:
    """The result at one value.

    value : of the key
    summary : maxima, section, period, regime; None where the solver failed
    confirmed : whether the period is found again with further cycles; False where there is none
    status : sentence of the solver
    theta2 : (n,) plate angle on the section over the last cycles, oldest first; rad
    damping, lyapunov : where asked for
    final : slip speed, plate angle, plate speed at the end
    """

    value: float
    summary: Summary | None
    confirmed: bool
    status: str
    theta2: tuple[float, ...]
    damping: Damping | None
    lyapunov: Lyapunov | None
    final: tuple[float, float, float]

    def as_json(self) -> dict[str, Any]:
        """The point as JSON values; a failed one has null in every result."""
        out: dict[str, Any] = {"value": self.value}
        if self.summary is None:
            out.update(dict.fromkeys(SUMMARY_KEYS))
            out["section"] = []
        else:
            out.update({k: v for k, v in self.summary.as_json().items() if k in SUMMARY_KEYS})
            out["section"] = [list(p) for p in self.summary.section]
        out["confirmed"], out["status"] = self.confirmed, self.status
        if self.theta2:
            out["theta2"] = list(self.theta2)
        if self.damping is not None:
            out.update(damping_as_json(self.damping))
        if self.lyapunov is not None:
            out["lyapunov"] = self.lyapunov.as_json()
        return out


SUMMARY_KEYS = ("max_slip_speed", "min_slip_speed", "section", "period", "stick_fraction", "regime", "cycles",
                "discarded",
                "settled", "section_change", "solver", "elapsed_s")
"""Keys of `simulate --json` that a sweep has per value."""


def solve_point(system: System, value: float, plan: Plan, state: State | None = None) -> Point:
    """Solve one point of a sweep from `state`, or from the system's own initial state.

    A numerical failure is the status of the point, with no summary; the state at which it stopped is not passed on.
    """
    run = _settled_run(system, plan, state) if plan.discard == "auto" else _plain_run(system, plan, state)
    trajectory, cycles, discarded = run
    failed = Point(value, None, False,
                   f"{trajectory.status.value}{'; ' if trajectory.detail else ''}{trajectory.detail}", (),
                   None, None, _initial(system, state))
    if trajectory.status is not Status.DONE or cycles is None or len(cycles) <= discarded:
        return failed
    end = _state(trajectory)
    if not all(map(math.isfinite, end)):
        return replace(failed, status=Status.NOT_FINITE.value)
    kept = cycles[discarded:]
    summary = replace(summarise_cycles(kept, system.cycle, first=discarded), cycles=len(cycles), discarded=discarded,
                      solver=trajectory.solver, elapsed_s=trajectory.statistics.seconds)
    final = State(*end)
    theta2 = tuple(float(x) for x in kept.section[max(len(kept) + 1 - plan.section_points, 1):,
                                                  1]) if plan.section_points else ()
    return Point(value, summary, _confirmed(system, plan, kept, summary, len(cycles), final), trajectory.status.value,
                 theta2,
                 damping_of_cycles(system, kept, discarded, summary.period, solver=plan.solver, rtol=plan.rtol,
                                   step=plan.step) if plan.damping else None,
                 _lyapunov(system, plan, summary, len(cycles), final) if plan.lyapunov else None, end)


def solve_points(systems: Sequence[System], values: Sequence[float], plan: Plan, state: State | None) -> list[Point]:
    """Points one after the other; up and down go on from the state at the end of the one before."""
    points = []
    for system, value in zip(systems, values):
        points.append(solve_point(system, value, plan, state))
        if plan.direction != "cold":
            state = State(*points[-1].final)
    return points


def _plain_run(system: System, plan: Plan, state: State | None) -> tuple[Trajectory, Cycles | None, int]:
    """All the cycles in one solve, and how many of them are dropped."""
    trajectory = solve(system, cycles=plan.cycles, solver=plan.solver, rtol=plan.rtol, step=plan.step, state=state)
    discarded = plan.discard if isinstance(plan.discard, int) else default_discard(plan.cycles)
    return trajectory, trajectory.cycles, discarded


def _settled_run(system: System, plan: Plan, state: State | None) -> tuple[Trajectory, Cycles | None, int]:
    """Blocks of cycles until the section repeats, and after how many it does; the paper's 50 where it never does."""
    parts: list[Cycles] = []
    done, seconds = 0, 0.0
    while True:
        count = min(SETTLING_BLOCK, plan.cycles - done)
        trajectory = solve(system, cycles=count, solver=plan.solver, rtol=plan.rtol, step=plan.step, start_cycle=done,
                           state=state)
        seconds += trajectory.statistics.seconds
        trajectory = replace(trajectory, statistics=replace(trajectory.statistics, seconds=seconds))
        if trajectory.status is not Status.DONE or trajectory.cycles is None:
            return trajectory, None, 0
        parts.append(trajectory.cycles)
        done, state = done + count, trajectory.final
        cycles = concatenated(parts)
        if done >= SETTLING_WINDOW:
            after = settling(cycles)
            if after is not None:
                return trajectory, cycles, after
        if done >= plan.cycles:
            return trajectory, cycles, min(DISCARD, done // 2)


def settling(cycles: Cycles, tolerance: float = SETTLING_TOLERANCE) -> int | None:
    """After how many cycles the section repeats with some period up to 16 until the end; None where it does not.

    All points that are a period apart lie within `tolerance` of the last ones, relative to the size of the motion, over
    at least the last SETTLING_WINDOW cycles less one period.
    """
    points: Floats = cycles.section
    size = np.abs(points[-SETTLING_WINDOW:]).max(axis=0)
    speed = max(float(size[0]), float(size[2]), float(np.abs(cycles.highest[-SETTLING_WINDOW:]).max()))
    scale = np.array([speed or 1.0, max(float(size[1]), 1e-6 * speed) or 1.0, speed or 1.0])
    for period in range(1, MAXIMUM_PERIOD + 1):
        if len(points) <= 2 * period:
            return None
        number = np.arange(len(points))
        image = len(points) - period + (number - len(points)) % period
        far = (np.abs(points - points[image]) > tolerance * scale).any(axis=1)
        after = int(np.flatnonzero(far)[-1]) + 1 if far.any() else 0
        if len(points) - 1 - after >= max(SETTLING_WINDOW // 2, 2 * period):
            return after
    return None


def _confirmed(system: System, plan: Plan, kept: Cycles, summary: Summary, done: int, state: State) -> bool:
    """Whether further cycles leave the period as it was found."""
    if not summary.period:
        return False
    further = solve(system, cycles=max(10, 2 * summary.period), solver=plan.solver, rtol=plan.rtol, step=plan.step,
                    start_cycle=done, state=state)
    if further.status is not Status.DONE or further.cycles is None:
        return False
    return periodicity(concatenated([kept, further.cycles]), TOLERANCE).period == summary.period


def _lyapunov(system: System, plan: Plan, summary: Summary, done: int, state: State) -> Lyapunov:
    """The largest exponent from the end of the run on."""
    return largest_lyapunov_exponent(system, state, cycles=plan.lyapunov_cycles, start_cycle=done,
                                     period=summary.period)


def _state(trajectory: Trajectory) -> tuple[float, float, float]:
    """Slip speed, plate angle and plate speed at the end."""
    last = trajectory.final
    return last.slip_speed, last.plate_angle, last.plate_speed


def _initial(system: System, state: State | None) -> tuple[float, float, float]:
    """Where the point started."""
    start = system.initial if state is None else state
    return start.slip_speed, start.plate_angle, start.plate_speed


def plan_as_json(plan: Plan) -> dict[str, Any]:
    """The fields of a plan, to tell one sweep from another."""
    return asdict(plan)
