"""Reasons of the largest errors in the stability report, from solving its worst cases with other settings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tcc_sim.model.friction import peak
from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import terms_of
from tcc_sim.study.benchmarks.extremes import ENGINES, SHARPEST, Examined, Truth
from tcc_sim.study.benchmarks.references import Floats, Law
from tcc_sim.trajectory import Trajectory

SAMPLES = 8192
"""Samples per cycle in the search for the time at which two solutions diverge."""
STEPS = (1e-3, 2e-4, 1e-4, 2e-5, 1e-5)
"""Steps of `fixed_step` for its worst case, s."""
PARTED = 0.01
"""Difference of the plate speeds, relative to their maximum, at which two solutions have diverged."""


def reasons(cases: Sequence[Examined]) -> list[str]:
    """Return sentences that explain the largest errors of `smoothed` and `fixed_step`; none without errors."""
    said = []
    for engine, explain in (("smoothed", _of_smoothing), ("fixed_step", _of_steps)):
        rows = [r for r in cases if r.solver == engine and r.error]
        if rows:
            said += explain(max(rows, key=lambda r: r.error or 0.0))
    return said


def final_error(keys: Mapping[str, Any], engine: str, truth: Truth, **setting: float) -> float:
    """Return the error of a case, defined as in the report, at another step or tolerance."""
    run = _solved(keys, engine, truth.duration, **setting)
    return float((np.abs(_state(run) - truth.state) / truth.scale).max())


def _solved(keys: Mapping[str, Any], engine: str, duration: float, **setting: Any) -> Trajectory:
    """Solve a case for a duration; reduce a step to one that divides the cycle."""
    system = replace(System(), {**keys, "friction.law": ENGINES[engine][0]})
    if "step" in setting:
        setting["step"] = system.cycle / math.ceil(system.cycle / setting["step"])
    return solve(system, duration=duration, solver=engine, **setting).raise_for_status()


def _state(run: Trajectory) -> Floats:
    """Return the last state."""
    return np.array([run.slip_speed[-1], run.plate_angle[-1], run.plate_speed[-1]])


def _scene_keys(record: Examined) -> dict[str, Any]:
    """Return the scene keys of a case."""
    return {k: v for k, v in record.keys.items() if k not in ("cycles", "friction.law")}


def _of_smoothing(worst: Examined) -> list[str]:
    """Explain the largest error of `smoothed`, from larger smoothing and a tighter tolerance."""
    keys = _scene_keys(worst)
    sigma = float(keys.get("friction.smoothing", 50.0))
    if sigma <= SHARPEST:
        return []
    truth = Truth(keys, "smoothed")
    tighter = final_error(keys, "smoothed", truth, rtol=1e-11)
    sharper = [final_error(changed, "smoothed", Truth(changed, "smoothed")) for factor in (10.0, 100.0)
               if (changed := {**keys, "friction.smoothing": factor * sigma})]
    return [f"`smoothed`, {worst.error:.0e}: the distance of two friction laws, not an error of the engine. Above "
            f"sigma = {SHARPEST:g} the reference solves the set-valued law. At 10 and 100 times sigma it is "
            f"{sharper[0]:.0e} and {sharper[1]:.0e}; with a tolerance of 1e-11 it is {tighter:.0e}."]


def _of_steps(worst: Examined) -> list[str]:
    """Explain the largest error of `fixed_step`, from other steps and the time of divergence."""
    keys = _scene_keys(worst)
    truth, step = Truth(keys, "smoothed"), float(worst.step or ENGINES["fixed_step"][1] or 0.0)
    errors = ", ".join(f"{final_error(keys, 'fixed_step', truth, step=h):.0e}" for h in STEPS)
    said = (f"`fixed_step`, {worst.error:.0e}: with steps of {', '.join(f'{h:g}' for h in STEPS)} s the error is "
            f"{errors}, so it does not shrink with the step.")
    finer = _solved(keys, "fixed_step", truth.duration, samples_per_cycle=SAMPLES, step=step)
    other = _solved(keys, "smoothed", truth.duration, samples_per_cycle=SAMPLES, rtol=1e-11)
    apart = np.flatnonzero(np.abs(finer.plate_speed - other.plate_speed) > PARTED * np.abs(other.plate_speed).max())
    if not len(apart) or other.system is None:
        return [said]
    crossed = np.flatnonzero(np.diff(np.sign(finer.slip_speed[:apart[0]])))
    k = int(crossed[-1]) + 1 if len(crossed) else int(apart[0])
    law, t = Law(other.system), float(other.t[k])
    need = abs(law.need(t, [other.slip_speed[k], other.plate_angle[k], other.plate_speed[k]]))
    share = need / max(other.system.friction_ratio * law.load(t), 1e-300)
    terms = terms_of(other.system)
    top = peak(terms.smoothing, terms.stribeck)[0] if terms.smoothing is not None else math.nan
    beyond = np.flatnonzero(np.abs(finer.slip_speed[k:]) > top)
    if not len(beyond):
        return [said]
    return [said + f" At t = {t:.4g} s slip stops, and stick needs {100.0 * share:.0f} % of the breakaway torque. Past "
            f"v = 0 a sub-step of the fixed step ends at {finer.slip_speed[k + beyond[0]]:.2g} rad/s, beyond the "
            f"{top:.2g} rad/s at which friction (7) is largest: the clutch slips on instead of sticking. Where a "
            "sub-step ends decides which, at any step."]
