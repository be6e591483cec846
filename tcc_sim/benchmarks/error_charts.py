"""Error charts of the fixed-step methods over (step, sigma), (step, mu_s/mu_k) and (step, pressure), with the
theoretical limits.

Three methods: `fixed_step` with the sub-steps that it chooses inside a tick, its SDIRK3 scheme with one step per tick,
which shows where those sub-steps are needed, and classical Runge-Kutta for contrast.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from tcc_sim.benchmarks.extremes import SHARPEST
from tcc_sim.benchmarks.references import Reference, Unfinished, errors, reference
from tcc_sim.errors import InputError
from tcc_sim.model.friction import smoothed_and_slope
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.solvers.fixed_step import advance
from tcc_sim.solvers.terms import peak_load, terms_of
from tcc_sim.trajectory import State

Record = dict[str, Any]
CYCLES = 2
RK4_REACH = 2.785
"""The real-axis stability limit of classical Runge-Kutta."""
SCENE: dict[str, Any] = {"friction.kinetic_coefficient": 0.24, "engine.mean_torque": 100.0,
                         "engine.torque_amplitude": 400.0, "initial.slip_speed": 5.0}
"""What the charts start from beside the defaults: stick-slip at every value of the keys that they go over."""
OVER = {"friction.smoothing": np.geomspace(50.0, 1e9, 12),
        "friction.kinetic_coefficient": 0.3 / np.linspace(1.0, 4.0, 13),
        "pressure.mean": np.geomspace(1e4, 1e7, 13)}
METHODS = {"fixed_step": np.geomspace(1e-5, 1e-2, 13), "SDIRK3, one step": np.geomspace(1e-6, 1e-2, 13),
           "rk4": np.geomspace(1e-7, 1e-3, 13)}
"""The steps of each method, s."""


def charts(quick: bool, done: Callable[[str], None]) -> list[Record]:
    """One record per key and method: `over`, `values`, `method`, `steps`, `errors` (rows are values, None where not
    finite) and `limits` (rk4 and uniqueness, s).
    """
    out = []
    for key, values in OVER.items():
        chosen = values[::3] if quick else values
        systems = [replace(System(), {**SCENE, key: float(x)} | (
            {"pressure.amplitude": 0.2 * float(x)} if key == "pressure.mean" else {})) for x in chosen]
        truths: list[Reference | None] = []
        for system in systems:
            done(f"reference at {key} {len(truths) + 1}/{len(systems)}")
            truths.append(_truth(system))
        for method, ladder in METHODS.items():
            done(f"{method} over {key}")
            steps = ladder[::3] if quick else ladder
            rows = [[_error(system, method, float(h), truth) for h in steps] for system, truth in zip(systems, truths)]
            out.append({"over": key, "values": [float(x) for x in chosen], "method": method,
                        "steps": [float(h) for h in steps],
                        "errors": rows, "limits": {"rk4": [rk4_limit(s) for s in systems],
                                                   "uniqueness": [uniqueness_limit(s) for s in systems]}})
    return out


def stick_rate(system: System) -> float:
    """The fastest rate beta Ts r sigma of the smoothed law, 1/s: that of stick under the largest load."""
    return system.inverse_inertia * peak_load(terms_of(system)) * system.friction_ratio * system.friction.smoothing


def rk4_limit(system: System) -> float:
    """The largest step, s, at which classical Runge-Kutta is stable in stick: 2.785/(beta Ts r sigma)."""
    return RK4_REACH / stick_rate(system)


def uniqueness_limit(system: System) -> float | None:
    """The step, s, below which v + a mubar(v) = w has one root: 1/(beta Ts |min d(mubar)/dv|); None where it always
    has.

    A stage of SDIRK3 has a = gamma h beta Ts, so its own limit is 1/gamma = 2.29 times as large.
    """
    terms = terms_of(system)
    if terms.stribeck is None:
        return None
    v = np.geomspace(1e-3, 1e4, 20001) / system.friction.smoothing
    v = np.union1d(v, np.linspace(0.0, 5.0 / system.friction.decay, 20001))
    _, slope = smoothed_and_slope(v, system.friction.smoothing, terms.stribeck)
    return float(1.0 / (system.inverse_inertia * peak_load(terms) * -slope.min()))


def _truth(system: System) -> Reference | None:
    """SciPy's LSODA, or the set-valued limit where the smoothing is too sharp for it; None where SciPy gives up."""
    sharp = system.friction.smoothing > SHARPEST
    try:
        if sharp:
            return reference(replace(system, {"friction.law": "set_valued"}), CYCLES, "DOP853", 1e-11)
        return reference(system, CYCLES, "LSODA", 1e-10)
    except Unfinished:
        return None


def _error(system: System, method: str, step: float, truth: Reference | None) -> float | None:
    """Section error relative to each signal's maximum; None where the method blew up, refused or had nothing to be held
    to.
    """
    if truth is None:
        return None
    if method == "SDIRK3, one step":
        section = one_step(system, step)
    else:
        try:
            run = solve(system, cycles=CYCLES, solver=method, step=step)
        except InputError:
            return None
        if run.cycles is None or len(run.cycles) < CYCLES:
            return None
        section = run.cycles.section
    with np.errstate(all="ignore"):
        found = errors(section, truth.largest, truth)[1]
    return found if math.isfinite(found) else None


def one_step(system: System, step: float) -> Any:
    """Sections of SDIRK3 with whole steps of at most `step` in a cycle, no sub-steps."""
    terms, cycle = terms_of(system), system.cycle
    count = max(math.ceil(cycle / step - 1e-9), 1)
    state = np.array(State.at_start(system).numbers)
    section = [state.copy()]
    for n in range(CYCLES):
        advance(state, n * cycle, cycle / count, count, terms, None, None)
        section.append(state.copy())
    return np.array(section)
