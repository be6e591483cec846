"""The steady state from the initial state as an error measure: a short horizon cannot see which motion is reached.

The motion that the package's engine at its tightest setting reaches is solved again over one period by SciPy
(`references`), from its own section: what it fails to close by, and its largest slip speed, are then those of an
independent solution. Every solver that is fast enough goes as far from the initial state, and the largest slip speed of
its last cycles is compared.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tcc_sim.analysis.periodicity import periodicity
from tcc_sim.benchmarks.references import Unfinished, reference
from tcc_sim.model.parameters import System
from tcc_sim.solvers import Status, solve
from tcc_sim.trajectory import Cycles, Floats, State

CYCLES, QUICK_CYCLES = 3000, 1000
"""Engine cycles from the initial state: Fig. 2 with the set-valued law takes some 700 to settle."""
LAST = 96
"""Cycles at the end that are looked at: a multiple of most periods."""
APART = 0.05
"""Relative difference of two largest slip speeds that makes them those of two motions."""
TIGHTEST = {"smoothed": ("smoothed", 1e-11), "set_valued": ("event_driven", 1e-12)}
"""The engine and tolerance that say which motion is reached."""
SOLVERS = ("smoothed", "event_driven", "fixed_step", "solve_ivp LSODA", "XPPAUT cvode")
"""Those that are run as far."""


def steady_of(section: Floats, largest: Floats) -> tuple[int, float]:
    """Period (0 for none up to 16) and largest slip speed, rad/s, at the end of a run: sections (n + 1, 3) and each
    cycle's largest slip speed (n,).
    """
    count = min(LAST, len(largest))
    last = Cycles(section[-count - 1:], largest[-count:], np.zeros(count), np.zeros(count))
    return periodicity(last).period, float(largest[-count:].max())


def steady_reference(system: System, cycles: int, method: str, rtol: float) -> dict[str, Any]:
    """`cycles`, `period`, `max_slip_speed` (rad/s), `closure`, `solvers` of the motion reached from the initial state.

    `closure` is by how much SciPy's solution misses its start after one period, relative to each signal's maximum.
    There is no largest slip speed to compare with (None) where the motion has no period, or SciPy did not end.
    """
    engine, tightest = TIGHTEST[system.friction.law]
    run = solve(system, cycles=cycles, solver=engine, rtol=tightest)
    out: dict[str, Any] = {"cycles": cycles, "period": 0, "max_slip_speed": None, "closure": None,
                           "solvers": [f"{engine}, rtol {tightest:g}", f"SciPy {method}, rtol {rtol:g}"]}
    if run.status is not Status.DONE or run.cycles is None:
        return out
    out["period"] = period = steady_of(run.cycles.section, run.cycles.largest)[0]
    if not period:
        return out
    begun = run.cycles.section[cycles // period * period]
    try:
        truth = reference(State.of(begun).starting(system), period, method, rtol)
    except Unfinished:
        return out
    out["max_slip_speed"] = float(truth.largest.max())
    size = np.maximum(truth.size, np.abs(truth.section).max(axis=0))
    out["closure"] = float((np.abs(truth.section[-1] - truth.section[0]) / np.maximum(size, 1e-300)).max())
    return out


def steady_error(section: Floats, largest: Floats, truth: dict[str, Any]) -> float:
    """Error of the largest slip speed over the last cycles, relative to the reference's."""
    expected: float = truth["max_slip_speed"]
    return abs(steady_of(section, largest)[1] / expected - 1.0)


def comparison(record: dict[str, Any], others: list[dict[str, Any]]) -> str:
    """A sentence on the steady state of a scene, and on that of the same scene with the other friction law."""
    own = record["steady"]
    if own["max_slip_speed"] is None:
        return f"From the initial state the motion has no period up to 16 after {own['cycles']} cycles."
    said = (f"From the initial state it settles in period {own['period']} with {own['max_slip_speed']:.5g} rad/s "
            f"({own['cycles']} cycles; SciPy closes it to {own['closure']:.1e}).")
    base = record["scene"].removesuffix(", set-valued")
    for other in others:
        found = other["steady"]
        if other is record or other["scene"].removesuffix(", set-valued") != base or found["max_slip_speed"] is None:
            continue
        apart = abs(found["max_slip_speed"] / own["max_slip_speed"] - 1.0) > APART or found["period"] != own["period"]
        law = "(6)" if record["law"] == "smoothed" else "(7)"
        said += f" With law {law} it is period {found['period']} with {found['max_slip_speed']:.5g} rad/s"
        said += ": the smoothing decides which motion is reached." if apart else "."
    return said
