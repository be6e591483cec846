"""Terms of the equations that a system has, and the table of who supports each: the gate of everything that solves,
differentiates, exports or maps.

A term that a row of SUPPORTED does not name is refused there. So a term that is added to the model is refused by
everybody until its name is added to the rows of those that support it; nothing leaves it out in silence.
"""

from __future__ import annotations

from tcc_sim.errors import InputError
from tcc_sim.model.equations import COEFFICIENTS, OPTIONAL, linear_of
from tcc_sim.model.parameters import System

SMOOTHED, SET_VALUED = "smoothed", "set_valued"
LAWS = SMOOTHED, SET_VALUED
EXCITATION = frozenset({"torque", "harmonics", "pulsation"})
BOTH_ENGINES = EXCITATION | {"stribeck", "curve", "approach"} | set(OPTIONAL)
"""Terms that the equations of both laws have. A held pressure passes an actuator (`approach`) as it is."""
SAMPLED = BOTH_ENGINES | {SMOOTHED, "profile", "inputs"}
AT_REST = frozenset({"flywheel_by_slip", "plate_by_slip"})
"""Coefficients that do nothing where v = 0."""

SUPPORTED: dict[str, frozenset[str]] = {
    "fixed_step": SAMPLED | {"far"}, "smoothed": SAMPLED, "event_driven": BOTH_ENGINES | {SET_VALUED},
    **dict.fromkeys(("rk45", "dop853", "radau", "bdf", "lsoda", "rk4"), SAMPLED),
    "section map": BOTH_ENGINES | {SMOOTHED, SET_VALUED},
    "tick derivatives": SAMPLED,
    "node": SAMPLED | {"far"},
    "FMU": SAMPLED - {"inputs"},
    "pure slip": EXCITATION | AT_REST | {SMOOTHED, SET_VALUED, "approach", "stribeck", "curve"},
    "pure stick": EXCITATION | AT_REST | {SMOOTHED, SET_VALUED, "approach", "stribeck", "curve"},
    "harmonic balance": EXCITATION | {SMOOTHED, "approach", "stribeck", "curve"},
    "reference": EXCITATION | AT_REST | {SMOOTHED, SET_VALUED, "approach", "stribeck", "curve"},
    "peer": frozenset({"torque", "pulsation", SMOOTHED, "approach", "stribeck"}),
}
"""Terms that solvers (by their names) and everything else support. `stribeck` is refused by pure slip itself.

section map : derivatives, basins, exponents, continuation, periodic linear models and the equivalent damping
tick derivatives : identification
reference, peer : independent solutions, and other programs, of the measurements of precision
"""


def terms_in(system: System) -> dict[str, str]:
    """Return the terms that a system has, by the names of the fields of `solvers.terms.Terms` and of Linear, each with
    the scene keys or inputs that bring it.
    """
    e, p, inputs, terms = system.engine, system.pressure, system.inputs, {}
    terms[system.friction.law] = f"friction.law {system.friction.law}"
    if e.harmonic and e.torque_amplitude > 0.0:
        terms["torque"] = "engine.torque_amplitude"
    if e.harmonic and any(e.harmonic_amplitudes):
        terms["harmonics"] = "engine.harmonic_amplitudes"
    if p.harmonic and p.amplitude > 0.0:
        terms["pulsation"] = "pressure.amplitude"
    if system.friction.stribeck is not None:
        terms["stribeck"] = "friction that varies with slip speed"
    if system.friction.curve is not None:
        terms["curve"] = "friction.coefficients"
    if p.actuated:
        terms["approach"] = "an actuator of the pressure"
    if inputs is not None and inputs.output_speed is not None:
        terms["far"] = "inputs with output_speed"
    if system.profile is not None:
        terms["profile"] = ", ".join(key for key in system.varying if key != "inputs") or "inputs"
    if inputs is not None:
        terms["inputs"] = "inputs"
    linear = linear_of(system)
    for name in OPTIONAL:
        if getattr(linear, name) is not None:
            terms[name] = " and ".join(key for key, shares in COEFFICIENTS.items()
                                       if name in shares and system.value(key) != 0.0)
    return terms


def unsupported(who: str, system: System) -> dict[str, str]:
    """Return the terms of a system that a row of SUPPORTED leaves out, as `terms_in`."""
    return {name: text for name, text in terms_in(system).items() if name not in SUPPORTED[who]}


def check_supported(who: str, system: System, verb: str) -> None:
    """Raise InputError if a system has a term that a row of SUPPORTED leaves out; `verb` begins the sentence."""
    absent = unsupported(who, system)
    if absent:
        able = [name for name, terms in SUPPORTED.items() if absent.keys() <= terms]
        raise InputError(f"{verb} does not know {', '.join(dict.fromkeys(absent.values()))}; "
                         f"{'those that do are ' + ', '.join(able) if able else 'nothing does'}")
