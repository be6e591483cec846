"""Trajectory: the type that every solver and every replayed recording returns, and that every analysis takes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import NumericalFailure, counted
from tcc_sim.model.groups import Initial
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import latest
from tcc_sim.result import Result, reported, result_class, units_of

Floats = NDArray[np.float64]
Modes = NDArray[np.int8]


class FarEnd(NamedTuple):
    """Angle (rad), speed (rad/s) and acceleration (rad/s^2) of the shaft's far end, numbers or (n,) arrays."""

    angle: Floats | float = 0.0
    speed: Floats | float = 0.0
    acceleration: Floats | float = 0.0


STILL = FarEnd()
"""A far end that does not move."""


class Status(Enum):
    """End of a solve; the value is the printed sentence."""

    DONE = "reached the end"
    STEP_LIMIT = "stopped: the number of steps passed its limit before the end time"
    STEP_TOO_SMALL = "stopped: the step fell below the resolution of time"
    NOT_FINITE = "stopped: the state is no longer finite"
    EVENT_LIMIT = "stopped: stick and slip alternate faster than the event limit (chattering)"
    REFUSED = "not started: the solver cannot do this case"


@dataclass(frozen=True)
class State:
    """A state of the driveline: slip speed (rad/s), plate angle (rad), plate speed (rad/s), flywheel angle (rad)."""

    slip_speed: float
    plate_angle: float
    plate_speed: float
    flywheel_angle: float = 0.0

    @staticmethod
    def of(numbers: Iterable[float]) -> State:
        """Return the state of slip speed, plate angle and plate speed."""
        return State(*map(float, numbers))

    @staticmethod
    def at_start(system: System) -> State:
        """Return the initial state of a system."""
        start = system.initial
        return State(start.slip_speed, start.plate_angle, start.plate_speed)

    def starting(self, system: System) -> System:
        """Return a system with this initial state."""
        return replace(system, initial=Initial(*self.numbers))

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Slip speed, plate angle and plate speed."""
        return self.slip_speed, self.plate_angle, self.plate_speed


@dataclass(frozen=True)
class Loads:
    """Clutch heat and shaft torque within each of N engine cycles; (N,) arrays, NaN for values not computed.

    energy : work of the friction torque, integral of Tf v, J
    peak_power : largest Tf v, W
    highest_shaft_torque, lowest_shaft_torque : largest and smallest C23 theta2' + K23 theta2, N m
    breakaways : number of changes from stick to slip
    coupling_energy : heat of the torque that passes between the inertias beside friction, integral of b v^2, J
    """

    energy: Floats
    peak_power: Floats
    highest_shaft_torque: Floats
    lowest_shaft_torque: Floats
    breakaways: Floats
    coupling_energy: Floats

    def columns(self) -> list[Floats]:
        """Return the arrays in the order of the fields."""
        return list(vars(self).values())


@dataclass(frozen=True)
class Cycles:
    """Section states, extremes and stick time of N whole engine cycles, with the accuracy of the solver.

    section : (N + 1, 3) array, states (slip speed, plate angle, plate speed) at t = 2 pi n/omega, both ends included
    highest, lowest : (N,) arrays, largest and smallest (signed) slip speed within each cycle, rad/s
    stick_time : (N,) array, time in stick within each cycle, s
    loads : loads of clutch and shaft within each cycle; None if not requested
    starts : (N + 1,) array, start of each cycle and end of the last, s; None if cycle n starts at t = 2 pi n/omega
    """

    section: Floats
    highest: Floats
    lowest: Floats
    stick_time: Floats
    loads: Loads | None = None
    starts: Floats | None = None

    def __len__(self) -> int:
        return len(self.highest)

    @property
    def largest(self) -> Floats:
        """(N,) largest |slip speed| within each cycle, rad/s."""
        largest: Floats = np.maximum(np.abs(self.highest), np.abs(self.lowest))
        return largest

    def __getitem__(self, kept: slice) -> Cycles:
        """Return a range of consecutive cycles."""
        first, last, stride = kept.indices(len(self))
        if stride != 1:
            raise ValueError("cycles must be consecutive; the stride must be 1")
        ends = slice(first, max(first, last) + 1)
        loads = None if self.loads is None else Loads(*(column[first:last] for column in self.loads.columns()))
        return Cycles(self.section[ends], self.highest[first:last], self.lowest[first:last],
                      self.stick_time[first:last], loads, None if self.starts is None else self.starts[ends])


@dataclass(frozen=True)
class Runs:
    """Engine cycles of m runs with N cycles each, in the units of `Cycles`.

    solver : the solver of all of them
    section : (m, N + 1, 3)
    values : (m, 9, N) largest and smallest slip speed, time in stick, and the loads in the order of `Loads`
    seconds : (m,) computing time, s: a run's share by steps in that of the call that solved several
    done : (m,) whether a run reached its end with finite numbers; the numbers of others are of no use
    """

    solver: str
    section: Floats
    values: Floats
    seconds: Floats
    done: NDArray[np.bool_]

    def cycles(self, k: int) -> Cycles:
        """Return the cycles of one run."""
        highest, lowest, stick_time, *loads = self.values[k]
        return Cycles(self.section[k], highest, lowest, stick_time, Loads(*loads))

    def chosen(self, runs: Sequence[int], first: int = 0) -> Runs:
        """Return some of the runs, from their cycle `first` on."""
        at: Any = slice(None) if list(runs) == list(range(len(self.done))) else list(runs)
        return Runs(self.solver, self.section[at, first:], self.values[at, :, first:], self.seconds[at], self.done[at])


def joined_runs(parts: Sequence[Runs]) -> Runs:
    """Join successive cycles of the same runs."""
    if len(parts) == 1:
        return parts[0]
    section = [part.section[:, :-1] for part in parts[:-1]] + [parts[-1].section]
    values = np.concatenate([part.values for part in parts], axis=-1)
    return replace(parts[-1], section=np.concatenate(section, axis=1), values=values,
                   seconds=np.sum([part.seconds for part in parts], axis=0))


def split_cycles(cycles: Cycles, whole: int) -> tuple[Cycles, Cycles | None]:
    """Return the first `whole` cycles, and the partial cycle after them or None."""
    return cycles[:whole], cycles[whole:] if len(cycles) > whole else None


def no_cycles() -> Cycles:
    """Return zero cycles, for a run whose engine cycles are unknown."""
    nothing = np.empty(0)
    return Cycles(np.empty((0, 3)), nothing, nothing, nothing, starts=nothing)


def concatenated(parts: Sequence[Cycles]) -> Cycles:
    """Join successive ranges of cycles."""
    sections = [p.section[:-1] for p in parts[:-1]] + [parts[-1].section]
    loads = [p.loads for p in parts if p.loads is not None]
    joined = Loads(*map(np.concatenate, zip(*(x.columns() for x in loads)))) if len(loads) == len(parts) else None
    starts = [p.starts for p in parts if p.starts is not None]
    return Cycles(np.concatenate(sections), np.concatenate([p.highest for p in parts]),
                  np.concatenate([p.lowest for p in parts]), np.concatenate([p.stick_time for p in parts]), joined,
                  np.concatenate([s[:-1] for s in starts[:-1]] + starts[-1:]) if len(starts) == len(parts) else None)


class Orbits(NamedTuple):
    """Section points of periodic motions, concatenated.

    points : (k, n), states divided by their natural scales
    reach : (k,) squared distance within which a motion counts as at the point
    cycle : (k,) number of the cycle, modulo `forcing`, at whose start the motion is at the point
    following : (k,) index of the next point of the motion
    forcing : period of the excitation, cycles
    """

    points: Floats
    reach: Floats
    cycle: NDArray[np.int64]
    following: NDArray[np.int64]
    forcing: int


NO_ORBITS = Orbits(np.empty((0, 3)), np.empty(0), np.empty(0, np.int64), np.empty(0, np.int64), 1)

NEGATIVE, STICK, POSITIVE, FREE = -1, 0, 1, 2
"""Modes: negative slip, stick, positive slip, and free, without load because the pressure is clamped at 0."""


@dataclass(frozen=True)
class Transitions:
    """Changes of mode: time (s), mode before and after (-1 negative slip, 0 stick, 1 positive slip, 2 free)."""

    time: Floats
    before: Modes
    after: Modes

    @staticmethod
    def none() -> Transitions:
        """Return zero transitions."""
        return Transitions(np.empty(0), np.empty(0, np.int8), np.empty(0, np.int8))


@dataclass(frozen=True)
class Statistics:
    """Cost of a solve: accepted, rejected steps; iterations in total, in the worst step, their bound; run time, s."""

    steps: int = 0
    rejected: int = 0
    iterations: int = 0
    iterations_max: int = 0
    iterations_bound: int = 0
    seconds: float = 0.0


@result_class(repr=False)
class Trajectory(Result):
    """A solved or recorded run.

    The columns are (n,) arrays. So are `flywheel_angle` (rad), if requested, and `output_angle` (rad) and
    `output_speed` (rad/s), if the shaft's far end moves. `cycles` comes from solvers that compute cycles, and `rest`,
    one partial cycle at the end, from solvers that can stop within a cycle; otherwise
    `analysis.steady.summary.cycle_parts_of` derives both from samples. Where two samples are more than `largest_step`
    apart, messages between them were lost; a solved run has no such place. `systems` has the time from which each
    system held, s, if keys of the scene changed during the run.

    Examples
    --------
    >>> import tcc_sim
    >>> run = tcc_sim.solve(tcc_sim.load_scene("minimal"), cycles=60, samples_per_cycle=4)
    >>> sorted(run.columns())[:3]
    ['engine_torque', 'friction_torque', 'plate_angle']
    """

    t: Floats = reported("time", "s")
    slip_speed: Floats = reported("flywheel speed minus plate speed", "rad/s")
    plate_angle: Floats = reported("angle of the clutch plate", "rad")
    plate_speed: Floats = reported("speed of the clutch plate", "rad/s")
    engine_torque: Floats = reported("torque of the engine on the flywheel", "N m")
    saturation_torque: Floats = reported("mu_k N R", "N m")
    friction_torque: Floats = reported("torque of the clutch on the plate", "N m")
    state: Modes = reported("-1 negative slip, 0 stick, 1 positive slip")
    cycle: float
    solver: str
    system: System | None = None
    flywheel_angle: Floats | None = None
    cycles: Cycles | None = None
    rest: Cycles | None = None
    largest_step: float = math.inf
    transitions: Transitions = field(default_factory=Transitions.none)
    status: Status = Status.DONE
    detail: str = ""
    statistics: Statistics = Statistics()
    output_angle: Floats | None = reported("angle of the shaft's far end", "rad", optional=True, default=None)
    output_speed: Floats | None = reported("speed of the shaft's far end", "rad/s", optional=True, default=None)
    systems: tuple[tuple[float, System], ...] = ()

    def _text(self) -> str:
        long = f"{float(self.t[-1] - self.t[0]):.6g} s" if len(self.t) else "no time"
        cycles = f", {counted(len(self.cycles), 'period')} of excitation" if self.cycles is not None else ""
        samples = counted(len(self.t), "sample")
        return f"{type(self).__name__} by {self.solver}: {samples} over {long}{cycles}; {self.status.value}"

    def columns(self) -> dict[str, Floats | Modes]:
        """Return the samples by name, (n,) arrays, as ``pandas.DataFrame`` and ``polars.DataFrame`` take them."""
        return {name: column for name in UNITS if (column := getattr(self, name)) is not None}

    @property
    def coupling_torque(self) -> Floats | None:
        """Torque of the converter's fluid on the plate beside friction, (n,), N m; None where there is none."""
        if self.system is None:
            return None
        coupling = self.along(lambda system: system.converter.coupling)
        return coupling * self.slip_speed if coupling.any() else None

    def along(self, quantity: Callable[[System], float]) -> Floats:
        """Return a quantity of the system at each sample, (n,); NaN without a system."""
        if not self.systems:
            return np.full(len(self.t), math.nan if self.system is None else quantity(self.system))
        times, systems = zip(*self.systems)
        held: Floats = np.array([quantity(system) for system in systems])[latest(times, self.t)]
        return held

    def system_at(self, t: float) -> System | None:
        """Return the system that held at a time, s; None without a system."""
        return self.systems[int(latest([since for since, _ in self.systems], t))][1] if self.systems else self.system

    @property
    def far_end(self) -> FarEnd:
        """Sampled motion of the shaft's far end; its speed is held between samples."""
        if self.output_angle is None or self.output_speed is None:
            return STILL
        return FarEnd(self.output_angle, self.output_speed)

    @property
    def shaft_twist(self) -> tuple[Floats, Floats]:
        """Angle (rad) and speed (rad/s) of the plate relative to the shaft's far end, (n,) arrays."""
        angle, speed, _ = self.far_end
        return self.plate_angle - angle, self.plate_speed - speed

    @property
    def final(self) -> State:
        """Last state."""
        angle = float(self.flywheel_angle[-1]) if self.flywheel_angle is not None else 0.0
        return State(float(self.slip_speed[-1]), float(self.plate_angle[-1]), float(self.plate_speed[-1]), angle)

    @property
    def solved_cycles(self) -> Cycles:
        """Cycles that the solver computed.

        Raises
        ------
        ValueError
            The solver computes no cycles.
        NumericalFailure
            The solve did not reach the end, see `raise_for_status`.
        """
        cycles = self.raise_for_status().cycles
        if cycles is None:
            raise ValueError(f"{self.solver} computes no cycles")
        return cycles

    def raise_for_status(self) -> Trajectory:
        """Return this trajectory, or raise NumericalFailure with the sentence of its status."""
        if self.status is not Status.DONE:
            reached = f" at t = {self.t[-1]:.6g} s" if len(self.t) else ""
            raise NumericalFailure(f"{self.solver}: "
                                   f"{self.status.value}{reached}{'; ' + self.detail if self.detail else ''}")
        return self


SAMPLED = units_of(Trajectory)
"""Fields of a trajectory that are columns, with their units."""
UNITS = {**SAMPLED, "coupling_torque": "N m"}
"""Columns of a trajectory, with their units."""


def integral(values: Floats, t: Floats) -> Floats:
    """Return the integral of samples over time from the first to each sample, (n,), by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t))])


def modes_of(slip_speed: Floats, stick_speed: float | Floats) -> Modes:
    """Return -1, 0, 1 for negative slip, stick and positive slip."""
    return np.subtract(slip_speed > stick_speed, slip_speed < -stick_speed, dtype=np.int8)


def event_sequence(modes: Iterable[int]) -> str:
    """Return the sequence of modes as letters: S stick, + and - slip, F free."""
    return "".join(["S+F-"[mode] for mode in modes])
