"""The exact engine of the set-valued law (6): arcs of one mode each, joined at located events.

Modes: stick, positive slip, negative slip, and free while the pressure is clamped at 0. A step of an arc is a Taylor
polynomial, to rounding where the motion is linear and to the tolerance where the friction coefficient varies; events
are certified on it. Which mode follows is decided from the torques, never from the sign of a rounded slip speed; in
stick v = 0 exactly.
"""

from __future__ import annotations

from tcc_sim.errors import InputError
from tcc_sim.model.friction import exponentials
from tcc_sim.model.parameters import System
from tcc_sim.solvers import collocation
from tcc_sim.solvers.engine import EngineShell, Memory, Setup
from tcc_sim.solvers.event_driven.integrate import integrate
from tcc_sim.solvers.event_driven.sensitivity import SHARED
from tcc_sim.solvers.event_driven.setup import COUNTERS, EVENTS, STATE, Bounds, bounds_of
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.kept import DEGENERATE, EVENT_LIMIT, NOT_FINITE, OUTPUT, STEP_LIMIT
from tcc_sim.solvers.key_derivatives import DECAYS, EXCESSES
from tcc_sim.solvers.stages import WORK
from tcc_sim.solvers.terms import Terms, load_frequency, per_system, terms_of
from tcc_sim.trajectory import Floats

STEP_MAXIMUM = 1_000_000
"""Most steps of one engine cycle."""
FINER = 1e-2
"""Tolerance of a step per that of a solve: derivatives want more digits than states."""
REACH = 10.0
"""Most that a step with derivatives is long, per time in which the fastest part dies down."""
SLOWEST = 1e-30
"""Decay of the friction coefficient with slip speed, s/rad, that stands for 0."""


@per_system
def setup_of(system: System, rtol: float) -> Setup:
    """What a solve of a system needs to know beforehand; `waves` is to be copied for every solve."""
    terms = constant_law(terms_of(system))
    bounds, waves, tables = bounds_of(terms, system.cycle, rtol), waves_of(terms), None
    waves.setflags(write=False)
    if bounds.stiff_slip or bounds.stiff_stick:
        tables = collocation.tables(terms.linear, tuple(waves["rate"].tolist()), load_frequency(terms),
                                    *collocation.ladder_of(bounds.slip_rate, bounds.period))
    return Setup(bounds, without_torque(terms), system.pressure.frequency_ratio, waves, tables)


def without_torque(terms: Terms) -> Terms:
    """The terms without those of the engine torque, which are the waves, and without smoothing."""
    return terms._replace(torque=None, harmonics=None, smoothing=None)


def constant_law(terms: Terms) -> Terms:
    """The terms, with the static coefficient as the only one where the coefficient does not decay with slip speed."""
    if terms.stribeck is None or terms.stribeck[1] > 0.0:
        return terms
    ratio, load = 1.0 + terms.stribeck[0], terms.pulsation
    return terms._replace(stribeck=None, mean_load=ratio * terms.mean_load,
                          pulsation=None if load is None else (ratio * load[0], *load[1:]))


def exact_bounds(terms: Terms, system: System, rtol: float, numbers: Floats) -> Bounds:
    """The bounds of a run in which mubar and its derivatives by the keys are constant from `far` on."""
    if terms.stribeck is None or not numbers[EXCESSES + DECAYS].any():
        return bounds_of(terms, system.cycle, rtol)
    pairs = exponentials(terms.stribeck)
    wide = tuple(number for share, rate in pairs for number in (max(abs(share), 1.0), rate))
    return bounds_of(terms._replace(stribeck=wide), system.cycle, rtol)._replace(
        ratio=1.0 + sum(share for share, _ in pairs))


def setup_of_changes(system: System, terms: Terms, changes: Floats, rtol: float) -> Setup:
    """What motions with derivatives need to know beforehand.

    Raises
    ------
    InputError
        A damper whose decay takes too many steps.
    """
    if terms.stribeck is not None:
        terms = terms._replace(stribeck=(terms.stribeck[0], max(terms.stribeck[1], SLOWEST), *terms.stribeck[2:]))
    bounds, waves = exact_bounds(terms, system, FINER * rtol, changes), waves_of(terms)
    if bounds.stiff_slip and bounds.slip_rate * bounds.period > REACH * bounds.steps:
        raise InputError(f"driveline.damping is {system.driveline.damping:g} N m s/rad; over driveline.plate_inertia "
                         f"it decays at {bounds.slip_rate:.3g} 1/s, and the derivatives of the set-valued motion, "
                         f"which follow that decay, take more than {bounds.steps} steps a cycle; those of "
                         "friction.law smoothed step over it")
    pressure = system.pressure
    if terms.pulsation is None:  # One compiled kernel serves with and without a pulsating load.
        terms = terms._replace(pulsation=(0.0, pressure.frequency_ratio * system.engine.frequency, pressure.phase))
    return Setup(bounds._replace(events=EVENTS), without_torque(terms), pressure.frequency_ratio, waves, None)


def why(ended: int, steps: int, setup: Setup) -> str:
    """A sentence on a failure."""
    return {EVENT_LIMIT: f"{setup.limits.events} events in one period of excitation",
            NOT_FINITE: "the state is not finite",
            STEP_LIMIT: f"{steps} steps in one period of excitation", DEGENERATE: "slip ends where its rate is 0 too"
            }.get(ended, "")


ENGINE = EngineShell("event_driven", integrate, Memory(STATE, None, DRIVE, WORK, COUNTERS, OUTPUT), SHARED, setup_of,
                setup_of_changes, lambda _, cycles: STEP_MAXIMUM, lambda setup, cycles: setup.limits.steps, why,
                moves=EVENTS, more_moves=lambda setup: setup.limits.events, columns=5, stride=2)
solve = ENGINE.solve
