"""What a kernel is given: the numbers of a scene, with None for every term that the scene does not have.

The types of the fields select the compiled code: a kernel is one source text, and Numba leaves out the branches of a
term that is None (pass the field on as an argument of its own: the pruning looks at arguments). What follows from
a system alone is kept for the systems that were asked for last (`per_system`): a short solve costs less than to work it
out again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.model import equations, friction
from tcc_sim.model.equations import Linear
from tcc_sim.model.friction import Stribeck
from tcc_sim.model.friction_curve import MOST_TERMS
from tcc_sim.model.groups import Friction
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import (
    FREQUENCY,
    LOAD,
    LOAD_RATE,
    START,
    SWELL,
    SWELLS,
    TIME,
    TORQUE,
    Floats,
    Origin,
    along,
    motion_of_far_end,
    pieces,
    profile_of,
    swelling,
)

Function = TypeVar("Function", bound=Callable[..., Any])
SWINGS = 40.0
"""Natural periods in an engine cycle beyond which a cycle is allowed more steps."""
RESOLUTION = 0.04
"""Largest phase of the fastest oscillation in one sub-step, rad."""
SUBSTEP_LIMIT = 20_000
"""A tick that needs more sub-steps is refused."""
RESULTS_KEPT = 64
"""Results kept; a sweep asks for a system a few times in a row, and never again."""


class Terms(NamedTuple):
    """The terms of equations (1) to (7) that one scene needs; see the functions of `model` for each field.

    With a profile (`model.profile`; its loads are saturation torques, N m) the angles of the sines go with the phase
    phi instead of the time, so that their rates are in rad per rad, and the means are those of the profile.

    The real-time solver alone takes `approach`, the (1, 4) course of the load in a tick of an actuator, and `far`, the
    (m, 4) motion of the shaft's far end, a row for each piece of the profile: `torques` and `model.profile` have their
    columns. A Stepper fills their arrays anew for each tick.
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


def per_system(function: Function) -> Function:
    """Keep what a function of a system, and of numbers, gave for the very same object; whoever asks must not change it.

    Systems are frozen, and to compare two of them field by field would cost more than most of what is kept.
    """
    kept: dict[tuple[Any, ...], tuple[System, Any]] = {}
    changing = Lock()

    @wraps(function)
    def found(system: System, *numbers: Any) -> Any:
        key = id(system), *numbers
        known = kept.get(key)
        if known is not None:
            return known[1]
        result = function(system, *numbers)
        with changing:
            while len(kept) >= RESULTS_KEPT:
                del kept[next(iter(kept))]
            kept[key] = system, result  # The system is kept too, so that no other one gets its address.
        return result

    return cast(Function, found)


@per_system
def terms_of(system: System) -> Terms:
    """The terms of `system`. An input that comes from a topic is its fallback: what applies where nobody commands
    it.
    """
    return terms_from(system, START)


def terms_from(system: System, origin: Origin) -> Terms:
    """`terms_of` with the phase counted from `origin`."""
    if origin == START:
        return _terms(system, system.profile, 0.0)
    return _terms(system, profile_of(system.engine, system.pressure, system.inputs, origin), origin.lead)


def _terms(system: System, profile: Floats | None, lead: float) -> Terms:
    """The terms with this profile, whose loads are pressures, and the load ahead by `lead` rad."""
    d, e, p, f, inputs = system.driveline, system.engine, system.pressure, system.friction, system.inputs
    omega = e.frequency if profile is None else 1.0
    own_torque = e.harmonic and (inputs is None or inputs.torque is None)
    own_pressure = p.harmonic and (inputs is None or inputs.pressure is None)
    torque = (e.torque_amplitude, omega) if (own_torque and e.torque_amplitude > 0.0
                                             and not e.torque_amplitude_times) else None
    harmonics = None
    if own_torque and any(a > 0.0 for a in e.harmonic_amplitudes) and not e.harmonic_amplitudes_times:
        rows = [(n * omega, a, phase) for n, (a, phase) in enumerate(zip(e.harmonic_amplitudes, e.harmonic_phases), 2)
                if a > 0.0]
        harmonics = np.array(rows, dtype=np.float64)
    pulsation = None
    if own_pressure and p.amplitude > 0.0:
        pulsation = (system.saturation_amplitude, p.frequency_ratio * omega, p.phase + lead)
    moved = None if inputs is None or profile is None else inputs.output_speed
    return Terms(
        linear=(d.flywheel_inertia, d.plate_inertia, d.damping, d.stiffness),
        mean_torque=e.mean_torque,
        torque=torque,
        harmonics=harmonics,
        mean_load=system.saturation_mean,
        pulsation=pulsation,
        smoothing=f.smoothing if f.law == "smoothed" else None,
        stribeck=f.stribeck,
        profile=None if profile is None else with_loads(profile, system.torque_per_pressure),
        far=None if moved is None or profile is None else motion_of_far_end(moved, profile[:, TIME]),
    )


def with_loads(profile: Floats, torque_per_pressure: float) -> Floats:
    """A profile with saturation torques, N m, in the place of its pressures."""
    out: Floats = profile.copy()
    out[:, LOAD:LOAD_RATE + 1] *= torque_per_pressure
    return out


def holding(terms: Terms, torque: float | None, load: float | None) -> Terms:
    """`terms` with a commanded engine torque and saturation torque (N m) held; None leaves the scene's own.

    The harmonics of an input that is held stay as terms of zero amplitude, so that the kernel is the same.
    """
    if torque is None and load is None:
        return terms
    linear, mean_torque, sine, harmonics, mean_load, pulsation, smoothing, stribeck, profile, approach, far = terms
    if torque is not None:
        mean_torque, sine, profile = torque, sine and (0.0, sine[1]), _held_in(profile, TORQUE, torque)
        harmonics = None if harmonics is None else harmonics * (1.0, 0.0, 1.0)
    if load is not None:
        mean_load, pulsation, profile = load, pulsation and (0.0, *pulsation[1:]), _held_in(profile, LOAD, load)
    return Terms(linear, mean_torque, sine, harmonics, mean_load, pulsation, smoothing, stribeck, profile, approach,
                 far)


def same_but_means(one: Terms, other: Terms) -> bool:
    """Whether terms are the same but for the mean torque and the mean load."""
    return (one.harmonics is other.harmonics and one.profile is other.profile
            and one.approach is other.approach and one.far is other.far
            and (one.linear, one.torque, one.pulsation, one.smoothing, one.stribeck)
            == (other.linear, other.torque, other.pulsation, other.smoothing, other.stribeck))


def _held_in(profile: Floats | None, column: int, value: float) -> Floats | None:
    """A profile with a constant in this column."""
    if profile is None:
        return None
    out: Floats = profile.copy()
    out[:, column], out[:, column + 1] = value, 0.0
    if column == TORQUE:
        out[:, SWELLS + 2::SWELL] = out[:, SWELLS + 3::SWELL] = 0.0
    return out


def general_terms(system: System, origin: Origin = START) -> Terms:
    """The same physics with every term present, absent ones at zero amplitude: for comparison, and for live changes."""
    own = _terms(system, profile_of(system.engine, system.pressure, system.inputs, origin), origin.lead)
    return own._replace(
        torque=own.torque or (0.0, 1.0),
        harmonics=np.array([[2.0, 0.0, 0.0]]) if own.harmonics is None else own.harmonics,
        pulsation=own.pulsation or (0.0, 1.0, 0.0),
        stribeck=_all_exponentials(system.friction, own.stribeck),
    )


def _all_exponentials(friction: Friction, own: Stribeck) -> Stribeck:
    """As many exponentials as the law may have: those of a table are as many as its fit needs."""
    if friction.curve is None:
        return own or (0.0, friction.decay)
    return (*(own or ()), *((0.0, 1.0) * (MOST_TERMS - len(own or ()) // 2)))


def torques_at(terms: Terms, t: Floats) -> tuple[Floats, Floats]:
    """Te and Ts, N m, at the times t, an array of any shape, s."""
    angle, mean_torque, mean_load = t, terms.mean_torque, terms.mean_load
    if terms.profile is not None:
        angle, mean_torque, mean_load = along(terms.profile, t)
        mean_torque = mean_torque + swelling(t, angle, np.moveaxis(terms.profile[pieces(terms.profile, t)], -1, 0))
    return (np.asarray(equations.engine_torque(angle, mean_torque, terms.torque, terms.harmonics)),
            np.asarray(equations.saturation_torque(angle, mean_load, terms.pulsation)))


def piece_of(terms: Terms, begin: float, end: float) -> Terms:
    """`terms` with the one piece of the profile that holds from `begin` to `end`."""
    if terms.profile is None:
        return terms
    k = pieces(terms.profile, 0.5 * (begin + end))
    return terms._replace(profile=terms.profile[k:k + 1], far=None if terms.far is None else terms.far[k:k + 1])


def peak_load(terms: Terms) -> float:
    """The largest saturation torque, N m."""
    mean = terms.mean_load if terms.profile is None else float(terms.profile[:, LOAD].max())
    return mean + (abs(terms.pulsation[0]) if terms.pulsation is not None else 0.0)


def least_mean_load(terms: Terms) -> float:
    """The smallest saturation torque less its sine, N m."""
    return terms.mean_load if terms.profile is None else float(terms.profile[:, LOAD].min())


def held_and_left_out(terms: Terms) -> tuple[list[str], list[str]]:
    """The names of the terms a kernel holds, and of those it leaves out."""
    present = {
        "engine torque sine": terms.torque is not None,
        "engine torque harmonics 2, 3, ...": terms.harmonics is not None,
        "pressure sine": terms.pulsation is not None,
        "smoothing tanh": terms.smoothing is not None,
        "Stribeck exponential": terms.stribeck is not None,
        "pressure clamp": terms.pulsation is not None and terms.pulsation[0] > least_mean_load(terms),
        "profiles in time": terms.profile is not None,
    }
    return [n for n, on in present.items() if on], [n for n, on in present.items() if not on]


def excitation_frequency(terms: Terms) -> float:
    """The largest angular frequency in the excitation, rad/s (0 for constant inputs)."""
    found = [0.0]
    if terms.torque is not None:
        found.append(terms.torque[1])
    if terms.pulsation is not None:
        found.append(terms.pulsation[1])
    if terms.harmonics is not None:
        found.append(float(terms.harmonics[:, 0].max()))
    if terms.profile is not None:
        found += terms.profile[0, SWELLS::SWELL].tolist()
    return max(found) * (1.0 if terms.profile is None else float(terms.profile[:, FREQUENCY].max()))


def load_frequency(terms: Terms) -> float:
    """The largest angular frequency of the load, rad/s; 0 where it is constant."""
    rate = 0.0 if terms.pulsation is None else terms.pulsation[1]
    return rate * (1.0 if terms.profile is None else float(terms.profile[:, FREQUENCY].max()))


def largest_mean_torque(terms: Terms) -> float:
    """The largest size of the mean engine torque, N m."""
    return abs(terms.mean_torque) if terms.profile is None else float(np.abs(terms.profile[:, TORQUE]).max())


def torque_swing(terms: Terms) -> float:
    """The sum of the amplitudes of the engine torque, N m."""
    found = terms.torque[0] if terms.torque is not None else 0.0
    if terms.harmonics is not None:
        found += float(terms.harmonics[:, 1].sum())
    if terms.profile is not None:  # An amplitude is linear within a piece and constant in the last.
        found += float(terms.profile[:, SWELLS + 2::SWELL].max(axis=0).sum())
    return found


def natural_frequency(terms: Terms) -> float:
    """omega_n = sqrt(K23/I2), rad/s."""
    return math.sqrt(terms.linear[3] / terms.linear[1])


def steps_allowed(terms: Terms, period: float) -> int:
    """Most steps of one engine cycle of a solve that gets on: a long one needs some for what swings by itself."""
    return 2_000 * max(1, math.ceil(natural_frequency(terms) * period / (2.0 * math.pi * SWINGS)))


def stick_speed_of(terms: Terms) -> float:
    """The slip speed at or below which this package says stick; 0 for the set-valued law."""
    return friction.stick_speed(terms.smoothing, terms.stribeck) if terms.smoothing is not None else 0.0


def substeps(terms: Terms, step: float, held: float = 0.0) -> int:
    """How many sub-steps a tick of `step` seconds needs; `held` is saturation torque beside that of `terms`, N m.

    Raises
    ------
    InputError
        More than SUBSTEP_LIMIT.
    """
    fastest = max(natural_frequency(terms), excitation_frequency(terms))
    needed = step * fastest / RESOLUTION
    if terms.stribeck is not None:
        beta = 1.0 / terms.linear[0] + 1.0 / terms.linear[1]
        needed = max(needed, 2.0 * step * beta * (peak_load(terms) + held) * friction.steepest_fall(terms.stribeck))
    if not needed <= SUBSTEP_LIMIT:
        raise InputError(f"a step of {step:g} s needs {needed:.0f} sub-steps; "
                         f"fixed_step allows at most {SUBSTEP_LIMIT}")
    return max(1, math.ceil(needed - 1e-9))
