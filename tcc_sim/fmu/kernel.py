"""The functions of the real-time tick that an FMU needs, printed in C."""

from __future__ import annotations

from tcc_sim.fmu.c_types import DOUBLE, INT, Kind, Row, Static, record_of
from tcc_sim.fmu.printer import Library
from tcc_sim.model import equations, friction
from tcc_sim.solvers import fixed_step
from tcc_sim.solvers.terms import Terms

MOST_HARMONICS = 32


def kernel() -> str:
    """C99 text of the structure Terms and of the functions `advance`, `engine_torque`, `saturation_torque` and
    `smoothed`, all static.

    Raises
    ------
    Refused
        The kernel's source holds what has no printed form.
    """
    terms = record_of(Terms, {"harmonics": (3, MOST_HARMONICS)}, absent=("course",))
    of = dict(terms.fields)
    library = Library()
    library.declared(terms)
    roots: list[tuple[object, tuple[Kind, ...]]] = [
        (fixed_step.advance, (Row(writable=True), DOUBLE, DOUBLE, INT, terms, Static(True), Static(None))),
        (equations.engine_torque, (DOUBLE, DOUBLE, of["torque"], of["harmonics"])),
        (equations.saturation_torque, (DOUBLE, DOUBLE, of["pulsation"])),
        (friction.smoothed, (DOUBLE, DOUBLE, of["stribeck"])),
        (friction.smoothed_and_slope, (DOUBLE, DOUBLE, of["stribeck"], DOUBLE))]
    for function, kinds in roots:
        library.function(function, kinds)
    return library.text()
