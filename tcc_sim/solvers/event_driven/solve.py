"""The exact engine of the set-valued law (6): arcs of one mode each, joined at located events.

Modes: stick, positive slip, negative slip, and free while the pressure is clamped at 0. A step of an arc is a Taylor
polynomial, to rounding where the motion is linear and to the tolerance where the friction coefficient varies; events
are certified on it. The torques, never the sign of a rounded slip speed, decide on the next mode; in stick v = 0
exactly.
"""

from __future__ import annotations

from tcc_sim.errors import OutOfRange
from tcc_sim.model.equations import completed
from tcc_sim.model.friction import exponentials
from tcc_sim.model.parameters import System
from tcc_sim.solvers.engine import COUNTERS, EngineShell, Memory, Setup
from tcc_sim.solvers.event_driven.integrate import integrate
from tcc_sim.solvers.event_driven.sensitivity import SHARED
from tcc_sim.solvers.event_driven.setup import EVENTS, STATE, Bounds, bounds_of
from tcc_sim.solvers.excitation import DRIVE, waves_of
from tcc_sim.solvers.key_derivatives import DECAYS, EXCESSES
from tcc_sim.solvers.run_output import DEGENERATE, EVENT_LIMIT, NOT_FINITE, OUTPUT, STEP_LIMIT
from tcc_sim.solvers.stages import WORK
from tcc_sim.solvers.terms import Terms, per_system, terms_of
from tcc_sim.trajectory import Floats

STEP_MAXIMUM = 1_000_000
"""Most steps of one engine cycle."""
FINER = 1e-2
"""Tolerance of a step with derivatives, which need more digits, per that of a solve."""
REACH = 10.0
"""Longest step with derivatives, per time in which the fastest part decays."""
SLOWEST = 1e-30
"""Decay of the friction coefficient with slip speed, s/rad, in place of 0."""


@per_system
def setup_of(system: System, rtol: float) -> Setup:
    """Return the setup of a system; a solve copies `waves`."""
    terms = terms_of(system)
    if terms.stribeck is not None and not terms.stribeck[1] > 0.0:  # mu does not depend on the slip speed.
        ratio, load = 1.0 + terms.stribeck[0], terms.pulsation
        terms = terms._replace(stribeck=None, mean_load=ratio * terms.mean_load,
                               pulsation=None if load is None else (ratio * load[0], *load[1:]))
    waves = waves_of(terms)
    waves.setflags(write=False)
    return Setup(bounds_of(terms, system.cycle, rtol), without_torque(terms), system.pressure.frequency_ratio, waves,
                 None)


def without_torque(terms: Terms) -> Terms:
    """Return the terms without those of the engine torque, which are the waves, and without smoothing; with every
    linear coefficient.
    """
    return terms._replace(linear=completed(terms.linear), torque=None, harmonics=None, smoothing=None)


def exact_bounds(terms: Terms, system: System, rtol: float, numbers: Floats) -> Bounds:
    """Return the bounds of a run in which mubar and its derivatives by the keys are constant from `far` on."""
    if terms.stribeck is None or not numbers[EXCESSES + DECAYS].any():
        return bounds_of(terms, system.cycle, rtol)
    pairs = exponentials(terms.stribeck)
    wide = tuple(number for share, rate in pairs for number in (max(abs(share), 1.0), rate))
    return bounds_of(terms._replace(stribeck=wide), system.cycle, rtol)._replace(
        ratio=1.0 + sum(share for share, _ in pairs))


def setup_of_changes(system: System, terms: Terms, changes: Floats, rtol: float) -> Setup:
    """Return the setup of motions with derivatives; raise OutOfRange if a damper's decay takes too many steps."""
    if terms.stribeck is not None:
        terms = terms._replace(stribeck=(terms.stribeck[0], max(terms.stribeck[1], SLOWEST), *terms.stribeck[2:]))
    bounds, waves = exact_bounds(terms, system, FINER * rtol, changes), waves_of(terms)
    if decay_of_plate(terms) * bounds.period > REACH * bounds.steps:
        raise OutOfRange(f"driveline.damping is {system.driveline.damping:g} N m s/rad; over driveline.plate_inertia "
                         f"it decays at {decay_of_plate(terms):.3g} 1/s, and the derivatives of the set-valued motion, "
                         f"which follow that decay, take more than {bounds.steps} steps a cycle; those of "
                         "friction.law smoothed step over it")
    pressure = system.pressure
    if terms.pulsation is None:  # One compiled kernel serves with and without a pulsating load.
        terms = terms._replace(pulsation=(0.0, pressure.frequency_ratio * system.engine.frequency, pressure.phase))
    return Setup(bounds._replace(events=EVENTS), without_torque(terms), pressure.frequency_ratio, waves, None)


def decay_of_plate(terms: Terms) -> float:
    """Return C23/I2, 1/s, the decay that the steps of a heavy damper follow."""
    return terms.linear.damping / terms.linear.plate


def why(ended: int, steps: int, setup: Setup) -> str:
    """Return a sentence on a failure."""
    decay = decay_of_plate(setup.terms)
    heavy = (f"; driveline.damping over driveline.plate_inertia decays at {decay:.3g} 1/s, which friction.law smoothed "
             "steps over" if decay * setup.limits.period > REACH * steps else "")
    return {EVENT_LIMIT: f"{setup.limits.events} events in one period of excitation",
            NOT_FINITE: "the state is not finite",
            STEP_LIMIT: f"{steps} steps in one period of excitation{heavy}",
            DEGENERATE: "slip ends where its rate is 0 too"
            }.get(ended, "")


ENGINE = EngineShell("event_driven", integrate, Memory(STATE, None, DRIVE, WORK, COUNTERS, OUTPUT), SHARED, setup_of,
                     setup_of_changes, lambda _, cycles: STEP_MAXIMUM, lambda setup, cycles: setup.limits.steps, why,
                     transitions_per_cycle=EVENTS, columns=5, stride=2)
solve = ENGINE.solve
