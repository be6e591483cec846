"""The problem that a solver solves, its terms as arguments of the kernels, and the Trajectory of its results.

The terms are the numbers of a scene, with None for every term that the scene does not have. The types of the fields
select the compiled code: a kernel is one source text, and Numba leaves out the branches of a term that is None (pass
such a field on as an argument of its own: the pruning looks at arguments). `per_system` caches what follows from a
system alone, which takes longer than a short solve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from threading import Lock
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import OutOfRange
from tcc_sim.model import equations, friction
from tcc_sim.model import profile as of
from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.friction_curve import MOST_TERMS
from tcc_sim.model.groups import Engine
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import START, TIME, Floats, Origin, far_end_at
from tcc_sim.trajectory import FREE, STICK, Cycles, FarEnd, State, Statistics, Status, Trajectory, Transitions, modes_of

Function = TypeVar("Function", bound=Callable[..., Any])
SWINGS = 40.0
"""Natural periods in an engine cycle beyond which a cycle is allowed more steps."""
RESOLUTION = 0.04
"""Largest phase of the fastest oscillation in one sub-step, rad."""
SUBSTEP_LIMIT = 20_000
"""A tick that needs more sub-steps is refused."""
RESULTS_KEPT = 64
"""Results in each cache: a sweep needs a system a few times in a row, and never again."""


class Terms(NamedTuple):
    """The terms of equations (1) to (7) that one scene needs; see the functions of `model` for each field.

    With a profile (`model.profile`; its loads are saturation torques, N m) the angles of the sines go with the phase
    phi instead of the time, so that their rates are in rad per rad, and the means are those of the profile.

    The real-time solver alone takes `approach`, the (1, 4) course of the load in a tick of an actuator, and `far`, the
    (m, 4) motion of the shaft's far end, a row for each piece of the profile: `fixed_step` and `model.profile` have
    their columns. A Stepper fills their arrays anew for each tick.
    """

    linear: Linear
    mean_torque: float
    torque: tuple[float, float] | None
    harmonics: NDArray[np.float64] | None
    mean_load: float
    pulsation: tuple[float, float, float] | None
    smoothing: float | None
    stribeck: Stribeck
    profile: Floats | None = None
    approach: Floats | None = None
    far: Floats | None = None

    def same_but_means(self, other: Terms) -> bool:
        """Return whether these terms differ from others in the mean torque and the mean load only."""
        return (self.harmonics is other.harmonics and self.profile is other.profile
                and self.approach is other.approach and self.far is other.far
                and (self.linear, self.torque, self.pulsation, self.smoothing, self.stribeck)
                == (other.linear, other.torque, other.pulsation, other.smoothing, other.stribeck))


def per_system(function: Function) -> Function:
    """Cache the results, which callers must not change, of a function of a system, by identity, and of numbers.

    Systems are frozen, and to compare two of them field by field would cost more than most of the results.
    """
    cache: dict[tuple[Any, ...], tuple[System, Any]] = {}
    changing = Lock()

    @wraps(function)
    def cached(system: System, *numbers: Any) -> Any:
        key = id(system), *numbers
        entry = cache.get(key)
        if entry is not None:
            return entry[1]
        result = function(system, *numbers)
        with changing:
            while len(cache) >= RESULTS_KEPT:
                del cache[next(iter(cache))]
            cache[key] = system, result  # With a reference to the system, no other one gets its address.
        return result

    return cast(Function, cached)


@per_system
def terms_of(system: System) -> Terms:
    """Return the terms of `system`; an input from a topic has its fallback value."""
    return terms_from(system, START)


def terms_from(system: System, origin: Origin) -> Terms:
    """Return the terms of `system` with the phase counted from `origin`."""
    if origin == START:
        return _terms(system, system.profile, 0.0)
    return _terms(system, of.profile_of(system.engine, system.pressure, system.inputs, origin), origin.lead)


def _terms(system: System, profile: Floats | None, lead: float) -> Terms:
    """Return the terms with this profile, whose loads are pressures, and the load ahead by `lead` rad."""
    e, p, f, inputs = system.engine, system.pressure, system.friction, system.inputs
    omega = e.frequency if profile is None else 1.0
    torque_of_scene = e.harmonic and (inputs is None or inputs.torque is None)
    pressure_of_scene = p.harmonic and (inputs is None or inputs.pressure is None)
    torque = (e.torque_amplitude, omega) if (torque_of_scene and e.torque_amplitude > 0.0
                                             and not e.torque_amplitude_times) else None
    harmonics = _harmonics(e, omega) if (torque_of_scene and e.harmonic_amplitudes
                                         and not e.harmonic_amplitudes_times) else None
    pulsation = (system.saturation_amplitude, p.frequency_ratio * omega, p.phase + lead) if (
        pressure_of_scene and p.amplitude > 0.0) else None
    moved = None if inputs is None or profile is None else inputs.output_speed
    return Terms(
        linear=equations.linear_of(system),
        mean_torque=e.mean_torque,
        torque=torque,
        harmonics=harmonics,
        mean_load=system.saturation_mean,
        pulsation=pulsation,
        smoothing=f.smoothing if f.law == "smoothed" else None,
        stribeck=f.stribeck,
        profile=None if profile is None else with_loads(profile, system.torque_per_pressure),
        far=None if moved is None or profile is None else of.motion_of_far_end(moved, profile[:, of.TIME]),
    )


def _harmonics(engine: Engine, omega: float) -> Floats | None:
    """Return the harmonics 2, 3, ... of a constant amplitude above 0, or None: rows as in `Terms`."""
    rows, count = np.zeros((len(engine.harmonic_amplitudes), 3)), 0
    for k in range(len(engine.harmonic_amplitudes)):
        if engine.harmonic_amplitudes[k] > 0.0:
            rows[count, 0], rows[count, 1] = (k + 2) * omega, engine.harmonic_amplitudes[k]
            rows[count, 2] = engine.harmonic_phases[k]
            count += 1
    return rows[:count] if count > 0 else None


def with_loads(profile: Floats, torque_per_pressure: float) -> Floats:
    """Return a profile with saturation torques, N m, in place of its pressures."""
    out: Floats = profile.copy()
    out[:, of.LOAD] *= torque_per_pressure
    out[:, of.LOAD_RATE] *= torque_per_pressure
    return out


def holding(terms: Terms, torque: float | None, load: float | None) -> Terms:
    """Return `terms` with a commanded engine torque and saturation torque (N m) held; None keeps the scene's input.

    The harmonics of an input that is held stay as terms of zero amplitude, so that the kernel is the same.
    """
    if torque is not None:
        terms = terms._replace(
            mean_torque=torque, torque=None if terms.torque is None else (0.0, terms.torque[1]),
            harmonics=None if terms.harmonics is None else _silent(terms.harmonics),
            profile=None if terms.profile is None else _held_in(terms.profile, of.TORQUE, torque))
    if load is not None:
        terms = terms._replace(
            mean_load=load,
            pulsation=None if terms.pulsation is None else (0.0, terms.pulsation[1], terms.pulsation[2]),
            profile=None if terms.profile is None else _held_in(terms.profile, of.LOAD, load))
    return terms


def _silent(harmonics: Floats) -> Floats:
    """Return harmonics with amplitudes of zero."""
    out: Floats = harmonics.copy()
    out[:, 1] = 0.0
    return out


def _held_in(profile: Floats, column: int, value: float) -> Floats:
    """Return a profile with a constant in this column."""
    out: Floats = profile.copy()
    out[:, column], out[:, column + 1] = value, 0.0
    if column == of.TORQUE:
        for k in range(of.SWELLS, out.shape[1], of.SWELL):
            out[:, k + 2], out[:, k + 3] = 0.0, 0.0
    return out


SILENT, STILL = np.zeros((1, 3)), np.zeros((1, 4))
"""Harmonics of a scene without any, and the motion of a far end that stands still."""


def for_ticks(terms: Terms) -> Terms:
    """Return terms for the kernels of the real-time solver: the linear part, the sines, the moving far end, and the
    third exponential of a law with two are always there, with 0 where the scene lacks them.

    They take at most a tenth of a tick and change no bit of it. Profile, actuator, and no, one or more exponentials are
    kinds of kernel.
    """
    stribeck = terms.stribeck
    return terms._replace(
        linear=equations.completed(terms.linear), torque=terms.torque or (0.0, 0.0),
        harmonics=SILENT if terms.harmonics is None else terms.harmonics, pulsation=terms.pulsation or (0.0, 0.0, 0.0),
        far=STILL if terms.far is None else terms.far,
        stribeck=padded(stribeck) if stribeck is not None and len(stribeck) > 2 else stribeck)


def padded(stribeck: Stribeck) -> Stribeck:
    """Return the most exponentials that a friction table may have, those that it lacks with an amplitude of zero."""
    pairs = stribeck or ()
    return (*pairs, *((0.0, 1.0) * (MOST_TERMS - len(pairs) // 2)))


def torques_at(terms: Terms, t: Floats) -> tuple[Floats, Floats]:
    """Return Te and Ts, N m, at the times t, an array of any shape, s."""
    angle, mean_torque, mean_load, profile = t, terms.mean_torque, terms.mean_load, terms.profile
    if profile is not None:
        angle, mean_torque, mean_load = of.along(profile, t)
        mean_torque = mean_torque + of.swelling(t, angle, np.moveaxis(profile[of.pieces(profile, t)], -1, 0))
    return (np.asarray(equations.engine_torque(angle, mean_torque, terms.torque, terms.harmonics)),
            np.asarray(equations.saturation_torque(angle, mean_load, terms.pulsation)))


def piece_of(terms: Terms, begin: float, end: float) -> Terms:
    """Return `terms` with the one piece of the profile that holds from `begin` to `end`."""
    if terms.profile is None:
        return terms
    k = of.pieces(terms.profile, 0.5 * (begin + end))
    return terms._replace(profile=terms.profile[k:k + 1], far=None if terms.far is None else terms.far[k:k + 1])


def _range(terms: Terms, column: int, mean: float) -> tuple[float, float]:
    """Return the smallest and the largest value of a column of the profile; both are the mean without a profile."""
    if terms.profile is None:
        return mean, mean
    return float(terms.profile[:, column].min()), float(terms.profile[:, column].max())


def peak_load(terms: Terms) -> float:
    """Return the largest saturation torque, N m."""
    swing = 0.0 if terms.pulsation is None else abs(terms.pulsation[0])
    return _range(terms, of.LOAD, terms.mean_load)[1] + swing


def least_mean_load(terms: Terms) -> float:
    """Return the smallest saturation torque without its sine, N m."""
    return _range(terms, of.LOAD, terms.mean_load)[0]


def held_and_left_out(terms: Terms) -> tuple[list[str], list[str]]:
    """Return the names of the terms that a kernel has, and of those that it leaves out."""
    present = {
        "engine torque sine": terms.torque is not None,
        "engine torque harmonics 2, 3, ...": terms.harmonics is not None,
        "pressure sine": terms.pulsation is not None,
        "smoothing tanh": terms.smoothing is not None,
        "Stribeck exponential": terms.stribeck is not None,
        "pressure clamp": terms.pulsation is not None and terms.pulsation[0] > least_mean_load(terms),
        "profiles in time": terms.profile is not None,
        "fluid coupling": terms.linear.plate_by_slip is not None,
    }
    return [n for n, on in present.items() if on], [n for n, on in present.items() if not on]


def excitation_frequency(terms: Terms) -> float:
    """Return the largest angular frequency in the excitation, rad/s (0 for constant inputs)."""
    fastest = 0.0
    if terms.torque is not None:
        fastest = terms.torque[1]
    if terms.pulsation is not None:
        fastest = max(fastest, terms.pulsation[1])
    if terms.harmonics is not None:
        fastest = max(fastest, float(terms.harmonics[:, 0].max()))
    if terms.profile is not None:
        for k in range(of.SWELLS, terms.profile.shape[1], of.SWELL):
            fastest = max(fastest, float(terms.profile[0, k]))
    return fastest * _range(terms, of.FREQUENCY, 1.0)[1]


def load_frequency(terms: Terms) -> float:
    """Return the largest angular frequency of the load, rad/s; 0 where it is constant."""
    return (0.0 if terms.pulsation is None else terms.pulsation[1]) * _range(terms, of.FREQUENCY, 1.0)[1]


def largest_torque(terms: Terms, ratio: float = 1.0) -> float:
    """Return the largest sum of the sizes of the engine torque and of `ratio` times the saturation torque, N m."""
    mean = max(map(abs, _range(terms, of.TORQUE, terms.mean_torque)))
    return mean + torque_swing(terms) + ratio * peak_load(terms)


def torque_swing(terms: Terms) -> float:
    """Return the sum of the amplitudes of the engine torque, N m."""
    swing = terms.torque[0] if terms.torque is not None else 0.0
    if terms.harmonics is not None:
        swing += float(terms.harmonics[:, 1].sum())
    if terms.profile is not None:  # An amplitude is linear within a piece and constant in the last.
        swing += float(terms.profile[:, of.SWELLS + 2::of.SWELL].max(axis=0).sum())
    return swing


def natural_frequency(terms: Terms) -> float:
    """Return omega_n = sqrt(K23/I2), rad/s."""
    return math.sqrt(terms.linear.stiffness / terms.linear.plate)


def steps_allowed(terms: Terms, period: float) -> int:
    """Return the most steps of one engine cycle: a long cycle needs more for the driveline's own oscillation."""
    return 2_000 * max(1, math.ceil(natural_frequency(terms) * period / (2.0 * math.pi * SWINGS)))


def stick_speed_of(terms: Terms) -> float:
    """Return the slip speed, rad/s, up to which the mode is stick; 0 for the set-valued law."""
    return friction.stick_speed(terms.smoothing, terms.stribeck) if terms.smoothing is not None else 0.0


def substeps(terms: Terms, step: float, held: float = 0.0) -> int:
    """Return the sub-steps of a tick of `step` seconds; `held` is saturation torque beside that of `terms`, N m.

    Raises OutOfRange: more than SUBSTEP_LIMIT.
    """
    needed = substeps_needed(terms, step, held)
    if not needed <= SUBSTEP_LIMIT:
        raise OutOfRange(f"a step of {step:g} s needs {needed:.0f} sub-steps; "
                         f"fixed_step allows at most {SUBSTEP_LIMIT}")
    return int(needed)


def substeps_needed(terms: Terms, step: float, held: float = 0.0) -> float:
    """Return the sub-steps that a tick needs, as `substeps`; a number, since it may be beyond every limit."""
    needed = step * max(natural_frequency(terms), excitation_frequency(terms)) / RESOLUTION
    if terms.stribeck is not None:
        beta = 1.0 / terms.linear.flywheel + 1.0 / terms.linear.plate
        needed = max(needed, 2.0 * step * beta * (peak_load(terms) + held) * friction.steepest_fall(terms.stribeck))
    if not math.isfinite(needed):
        return needed
    return max(1.0, float(math.ceil(needed - 1e-9)))


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


def assemble(problem: Problem, solver: str, t: Floats, states: Floats, *, modes: NDArray[np.int8] | None = None,
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
