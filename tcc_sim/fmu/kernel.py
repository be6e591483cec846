"""The functions of the real-time tick that an FMU needs, printed in C."""

from __future__ import annotations

from tcc_sim.fmu.c_types import DOUBLE, INT, Kind, Row, Static, record_of
from tcc_sim.fmu.printer import Library
from tcc_sim.model import friction
from tcc_sim.solvers import fixed_step, torques
from tcc_sim.solvers.terms import Terms


def kernel() -> str:
    """C99 text of the structure Terms and of the functions `advance`, `torques_now`, `piece_at`, `smoothed` and what
    they call, all static. The macros TCC_MOST_HARMONICS and TCC_MOST_PIECES say how large its arrays may be.

    Raises
    ------
    Refused
        The kernel's source holds what has no printed form.
    """
    terms = record_of(Terms, {"harmonics": (3, "TCC_MOST_HARMONICS"), "course": (8, "TCC_MOST_PIECES")})
    of = dict(terms.fields)
    library = Library()
    library.declared(terms)
    roots: list[tuple[object, tuple[Kind, ...]]] = [
        (fixed_step.advance, (Row(writable=True), DOUBLE, DOUBLE, INT, terms, Static(True), Static(None))),
        (torques.piece_at, (of["course"], DOUBLE)),
        (torques.torques_now, (DOUBLE, INT, of["course"], terms)),
        (friction.smoothed, (DOUBLE, DOUBLE, of["stribeck"]))]
    for function, kinds in roots:
        library.function(function, kinds)
    return library.text()
