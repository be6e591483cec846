"""The problem that a solver solves, and the Trajectory of its results."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tcc_sim.model import equations, friction
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import TIME, far_end_at
from tcc_sim.solvers.terms import Terms, stick_speed_of, terms_of, torques_at
from tcc_sim.trajectory import (
    FREE,
    STICK,
    Cycles,
    FarEnd,
    Floats,
    Modes,
    State,
    Statistics,
    Status,
    Trajectory,
    Transitions,
    modes_of,
)

NOTHING_SPENT = Statistics()
LEAST_REST = 1e-9
"""Least part of a cycle, in cycles, that counts behind the whole cycles of a run; less is rounding."""


@dataclass(frozen=True)
class Problem:
    """A system to solve from a start to an end, and the results to store; `solvers.solve` describes the fields.

    Time 0 is where the engine sine starts; a solve starts at a whole engine cycle, so section points fall on
    t = 2 pi n/omega exactly.
    """

    system: System
    state: State
    start_cycle: int = 0
    cycles: int | None = None
    duration: float | None = None
    samples_per_cycle: int = 0
    rtol: float | None = None
    step: float | None = None
    flywheel_angle: bool = False
    loads_from: int | None = None

    @property
    def first(self) -> tuple[float, ...]:
        """Initial slip speed, plate angle and plate speed, and theta1 if it is integrated too."""
        angle = (self.state.flywheel_angle,) if self.flywheel_angle else ()
        return *self.state.numbers, *angle

    @property
    def start(self) -> float:
        """Start time, s."""
        return float(self.system.cycle_start(self.start_cycle))

    @property
    def end(self) -> float:
        """End time, s, exact to rounding for a number of cycles."""
        if self.cycles is not None:
            return float(self.system.cycle_start(self.start_cycle + self.cycles))
        assert self.duration is not None
        return self.start + self.duration

    @property
    def whole_cycles(self) -> int:
        """Complete engine cycles between start and end."""
        if self.cycles is not None:
            return self.cycles
        assert self.duration is not None
        return self.system.whole_cycles(self.start_cycle, self.duration)

    @property
    def rest(self) -> float:
        """Seconds behind the whole cycles, for cycles of one length; 0 if only rounding is left."""
        if self.duration is None:
            return 0.0
        rest = self.duration - self.whole_cycles * self.system.cycle
        return rest if rest >= 1e-12 * self.system.cycle else 0.0

    def cycle_starts(self) -> Floats:
        """Return the starts of the whole cycles, the end of the last one and, if the run goes on, its end, s."""
        starts: Floats = self.system.cycle_start(self.start_cycle + np.arange(self.whole_cycles + 2))
        begun = self.end - starts[-2] > LEAST_REST * (starts[-1] - starts[-2])
        return np.append(starts[:-1], self.end) if begun else starts[:-1]

    def breaks(self) -> Floats:
        """Return start, corners and jumps of the excitation's profile, and end, s."""
        if self.system.profile is None:
            return np.array([self.start, self.end])
        inner = self.system.profile[:, TIME]
        return np.concatenate([[self.start], inner[(inner > self.start) & (inner < self.end)], [self.end]])

    def sample_times(self) -> Floats:
        """Return the times, s, that divide every cycle into `samples_per_cycle`, from start to end, both included."""
        if self.samples_per_cycle < 1:
            return np.array([self.start, self.end])
        if self.system.profile is not None:
            whole = self.whole_cycles
            ends = self.system.cycle_start(self.start_cycle + np.arange(whole + 2))
            share = np.arange(self.samples_per_cycle) / self.samples_per_cycle
            times: Floats = (ends[:-1, None] + share * np.diff(ends)[:, None]).ravel()
            past = self.end - 1e-12 * (ends[-1] - ends[-2])
            return np.append(times[:np.searchsorted(times, past)], self.end)
        first = self.start_cycle * self.samples_per_cycle
        period = self.system.cycle
        last = int(np.ceil(self.end / period * self.samples_per_cycle * (1.0 - 1e-12)))
        times = np.arange(first, last + 1, dtype=np.float64) * (period / self.samples_per_cycle)
        times[-1] = self.end
        return times


def rates_along(t: Floats, states: Floats, terms: Terms) -> Floats:
    """Return the time derivatives of states (n, 3 or 4) of the smoothed law at the times t, (n,)."""
    assert terms.smoothing is not None
    v, angle, speed = states[:, 0], states[:, 1], states[:, 2]
    engine, load = torques_at(terms, t)
    torque = load * friction.smoothed_coefficient(v, terms.smoothing, terms.stribeck)
    moved, moving = far_end_along(t, terms)[:2]
    slip, plate = equations.accelerations(v, angle, speed, engine, torque, terms.linear, moved, moving)
    return np.stack([slip, speed, plate, v + speed][:states.shape[1]], axis=1)


def far_end_along(t: Floats, terms: Terms) -> FarEnd:
    """Return the motion of the shaft's far end at the times t, (n,), s."""
    return FarEnd() if terms.far is None else FarEnd(*far_end_at(terms.far, t))


def assemble(problem: Problem, solver: str, t: Floats, states: Floats, *, modes: Modes | None = None,
             cycles: Cycles | None = None, rest: Cycles | None = None, transitions: Transitions | None = None,
             status: Status = Status.DONE, detail: str = "", statistics: Statistics = NOTHING_SPENT) -> Trajectory:
    """Return the Trajectory of times (n,) and states (n, 3 or 4): slip speed, plate angle, plate speed, maybe theta1.

    The smoothed law gives the friction torque from the state, the set-valued one from `modes` (n,) too: (6) in slip,
    lambda in stick, 0 when free.
    """
    terms = terms_of(problem.system)
    v = states[:, 0]
    engine, load = torques_at(terms, t)
    far = (None, None) if terms.far is None else far_end_at(terms.far, t)
    if modes is None:
        assert terms.smoothing is not None
        state = modes_of(v, stick_speed_of(terms))
        torque = load * friction.smoothed_coefficient(v, terms.smoothing, terms.stribeck)
    else:
        free, held = modes == FREE, equations.interface_torque(states[:, 1], states[:, 2], engine, terms.linear)
        state = np.where(free, np.sign(v), modes).astype(np.int8)
        torque = np.where(modes == STICK, held, np.where(free, 0.0, load * friction.sliding(v, state, terms.stribeck)))
    return Trajectory(
        t=t, slip_speed=v, plate_angle=states[:, 1], plate_speed=states[:, 2], engine_torque=engine,
        saturation_torque=load, friction_torque=np.asarray(torque), state=state,
        cycle=problem.system.cycle, solver=solver, system=problem.system,
        flywheel_angle=states[:, 3] if states.shape[1] > 3 else None, cycles=cycles, rest=rest,
        transitions=transitions or Transitions.none(), status=status, detail=detail, statistics=statistics,
        output_angle=far[0], output_speed=far[1])
