"""The stroboscopic map of a scene with its derivatives, by the engine of its friction law."""

from __future__ import annotations

from tcc_sim.model.parameters import System
from tcc_sim.solvers.event_driven import stroboscopic as event_driven
from tcc_sim.solvers.smoothed import stroboscopic as smoothed

Prepared = smoothed.Prepared | event_driven.Prepared


def prepared(system: System, keys: tuple[str, ...], rtol: float) -> Prepared:
    """A system ready to be evaluated at many states, with derivatives by the state and by scene keys."""
    of = event_driven.Prepared if system.friction.law == "set_valued" else smoothed.Prepared
    return of(system, keys, rtol)
