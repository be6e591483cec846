"""Engine cycles per second on scenes of Fig. 4: the smoothed engine beside XPPAUT's CVODE at the same error, and a
whole sweep.

Each program runs at its loosest tolerance whose errors stay below ERROR over a few cycles from the initial state,
against a SciPy reference; its time is that of many cycles, so that the cost of a call or of a start does not count.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tcc_sim.benchmarks import peers
from tcc_sim.benchmarks.references import Reference, errors, reference
from tcc_sim.model.parameters import System
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, paper_system
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.studies.sweep import Curve, Plan, cores, sweep_curves

Record = dict[str, Any]
ERROR = 1e-6
"""The largest error, relative to each signal's maximum, that a tolerance may leave."""
HORIZON = 6
"""Engine cycles over which errors are taken: some motions of Fig. 4 are chaotic, and any error grows."""
CYCLES = 150
"""Engine cycles that are timed, those of one point of a sweep."""
REPEATS = 5
LADDER = (1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8, 3e-9, 1e-9, 1e-10)
ENGINE, PEER = "smoothed", "XPPAUT cvode"
FREQUENCIES = (0.12, 0.2, 0.36)
"""omega/omega_n of the scenes, for each mu_k/mu_s of Fig. 4."""


def sweep_speed(quick: bool, done: Callable[[int, int, str], None]) -> Record:
    """Measure.

    Parameters
    ----------
    quick : one frequency, and a coarser sweep
    done : called with points done, points in all, and what comes next

    Returns
    -------
    dict : `error` (the largest that was allowed), `horizon` and `cycles`, `rows` (a list of `kinetic_ratio`,
        `frequency_ratio`,
    `solver`, `setting`, `error`, `cycles_per_second`, for the engine at its default tolerance too), `omitted` (the same
    with `why`), and `sweep`: `points`, `cycles`, `cores`, `seconds`, `busy` (CPU time over that of all cores) and
    `cycles_per_second_and_core` of a sweep over Fig. 4 at the default tolerance
    """
    points = [(series, ratio) for series in FIGURES[4].series for ratio in (FREQUENCIES[-1:] if quick else FREQUENCIES)]
    out: Record = {"error": ERROR, "horizon": HORIZON, "cycles": CYCLES, "rows": [], "omitted": []}
    for count, (series, ratio) in enumerate(points):
        done(count, len(points) + 1, f"Fig. 4 at {ratio:g}")
        system = paper_system({**series.values, "engine.frequency": ratio * OMEGA_N})
        point = {"kinetic_ratio": 1.0 / system.friction_ratio, "frequency_ratio": ratio}
        truth = reference(system, HORIZON, "LSODA", 1e-12)
        default = SOLVERS[ENGINE].default
        for solver, ladder in ((ENGINE, LADDER), (ENGINE, (default,)), (PEER, LADDER)):
            try:
                setting, error = loosest(system, solver, ladder, truth)
                out["rows"].append({**point, "solver": solver, "setting": setting, "error": error,
                                    "cycles_per_second": CYCLES / timed(system, solver, setting)})
            except peers.Failed as failed:
                out["omitted"].append({**point, "solver": solver, "why": str(failed)})
    done(len(points), len(points) + 1, "Fig. 4, whole sweep")
    out["sweep"] = whole_sweep(40 if quick else 200)
    done(len(points) + 1, len(points) + 1, "")
    return out


def loosest(system: System, solver: str, ladder: tuple[float, ...], truth: Reference) -> tuple[float, float]:
    """The first tolerance of the ladder whose errors stay below ERROR, and the largest of its errors.

    Raises
    ------
    Failed
        There is none.
    """
    least = math.inf
    for setting in ladder:
        found = max(errors(*_run(system, solver, setting), truth))
        if found <= ERROR:
            return setting, found
        least = min(least, found)
    raise peers.Failed(f"its error is at least {least:.1e}")


def _run(system: System, solver: str, setting: float) -> tuple[Any, Any]:
    """Section and largest slip speeds over the horizon."""
    if solver == PEER:
        peer = peers.xppaut(system, "cvode", setting, HORIZON, 1)
        return peer.section, peer.largest
    cycles = solve(system, cycles=HORIZON, solver=solver, rtol=setting).raise_for_status().cycles
    assert cycles is not None
    return cycles.section, np.maximum(np.abs(cycles.highest), np.abs(cycles.lowest))


def timed(system: System, solver: str, setting: float) -> float:
    """Least CPU seconds of CYCLES engine cycles."""
    if solver == PEER:
        return peers.xppaut(system, "cvode", setting, CYCLES, 2).seconds
    best = math.inf
    for _ in range(REPEATS):
        began = time.process_time()
        solve(system, cycles=CYCLES, solver=solver, rtol=setting)
        best = min(best, time.process_time() - began)
    return best


def whole_sweep(count: int) -> Record:
    """A sweep over the four curves of Fig. 4, `count` frequencies each, on all cores."""
    values = tuple(float(x) for x in np.linspace(*FIGURES[4].span, count) * OMEGA_N)
    curves = [Curve(paper_system(series.values), "engine.frequency", values) for series in FIGURES[4].series]
    for curve in curves:
        solve(curve.at(0), cycles=1)
    wall, cpu, width = time.perf_counter(), time.process_time(), cores()
    sweeps = sweep_curves(curves, Plan(cycles=CYCLES), jobs=width)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    cycles = int(sum(sweep.column("cycles").sum() for sweep in sweeps))
    return {"points": count * len(curves), "cycles": cycles, "cores": width, "seconds": wall,
            "busy": cpu / (wall * width),
            "cycles_per_second_and_core": cycles / cpu}


def speed_rows(found: Record) -> list[tuple[float, float, Record | None, Record | None, Record | None]]:
    """Per scene mu_k/mu_s, omega/omega_n, and the engine at the loosest and at its default tolerance, and the peer."""
    rows: dict[tuple[float, float], list[Record]] = {}
    for row in found["rows"]:
        rows.setdefault((row["kinetic_ratio"], row["frequency_ratio"]), []).append(row)
    out = []
    for (kinetic, frequency), group in rows.items():
        engine = [row for row in group if row["solver"] == ENGINE]
        peer = [row for row in group if row["solver"] == PEER]
        out.append((kinetic, frequency, engine[0] if engine else None, engine[-1] if engine else None,
                    peer[0] if peer else None))
    return out


def speed_summary(found: Record) -> list[str]:
    """The figures in two sentences or three."""
    table = speed_rows(found)
    loose = [a["cycles_per_second"] for _, _, a, _, _ in table if a]
    default = [b["cycles_per_second"] for _, _, _, b, _ in table if b]
    ratios = [a["cycles_per_second"] / c["cycles_per_second"] for _, _, a, _, c in table if a and c]
    sweep = found["sweep"]
    out = [f"{_range(loose)} engine cycles a second and core at an error of at most {found['error']:g} on {len(table)} "
           f"scenes of Fig. 4, {_range(default)} at the default tolerance"]
    if ratios:
        peer = [c["cycles_per_second"] for *_, c in table if c]
        out.append(f"XPPAUT's CVODE {_range(peer)} at the same error; the ratio is {min(ratios):.2g} to "
                   f"{max(ratios):.2g}")
    else:
        out.append(f"XPPAUT's CVODE did not take part: {next((row['why'] for row in found['omitted']), 'not run')}")
    out.append(f"a sweep over Fig. 4, {sweep['points']} points and {sweep['cycles']} cycles: {sweep['seconds']:.3g} s "
               f"on {sweep['cores']} cores, {100.0 * sweep['busy']:.0f} % busy, "
               f"{_round(sweep['cycles_per_second_and_core'])} cycles a second and core with everything")
    return out


def _range(values: list[float]) -> str:
    """Least and largest."""
    return f"{_round(min(values))} to {_round(max(values))}" if values else "none"


def _round(value: float) -> str:
    """Two digits of a large number."""
    return f"{float(f'{value:.2g}'):.0f}"
