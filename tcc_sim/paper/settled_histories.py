"""The numbers of the paper's time histories: Figs. 2, 7, 9 and 12, each solved until its motion has settled."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

import numpy as np

from tcc_sim.analysis.summary import summarise
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.quantity import Value
from tcc_sim.paper import figure_results as results
from tcc_sim.paper.catalogue import PaperFigure, paper_system
from tcc_sim.paper.figure_options import QUICK_SHARE, FigureOptions, system_of
from tcc_sim.paper.seen_motions import orbit_behind
from tcc_sim.solvers import solve
from tcc_sim.sweeps.exponents import largest_lyapunov_exponent
from tcc_sim.trajectory import Floats, State, Trajectory

SAMPLES = 1000
"""Samples per cycle in a time history."""
RUN_IN = 150
"""Cycles before a time history."""
SECTION_CYCLES = 2000
"""Section points of a motion without period in Fig. 7."""


def _run_in(system: System, more: int, cycles: int = RUN_IN, samples: int = SAMPLES) -> tuple[Trajectory, Trajectory]:
    """The motion over some cycles, the transient among them, and then over some more with samples."""
    before = solve(system, cycles=cycles).raise_for_status()
    return before, solve(system, cycles=more, samples_per_cycle=samples, start_cycle=cycles,
                         state=before.final).raise_for_status()


def _time(run: Trajectory) -> Floats:
    """Time in engine cycles from the first sample on."""
    found: Floats = (run.t - run.t[0]) / run.cycle
    return found


def histories(row: PaperFigure, options: FigureOptions) -> results.Panels[results.History]:
    """Fig. 7."""
    panels = []
    for series in row.series:
        system = system_of(series, options)
        before, after = _run_in(system, 12)
        summary = summarise(before)
        section, exponent = summary.section, None
        if not summary.period:
            many = SECTION_CYCLES // (QUICK_SHARE if options.quick else 1)
            further = solve(system, cycles=many, start_cycle=RUN_IN, state=before.final).raise_for_status()
            section = summarise(further, 0).section
            if options.law == "smoothed":
                exponent = largest_lyapunov_exponent(system, before.final, cycles=many, start_cycle=RUN_IN)
        panels.append(results.History(series.label, series.values, summary.period, section, exponent, _time(after),
                                      after.slip_speed, after.plate_angle))
    return results.Panels(panels)


def delay(row: PaperFigure, options: FigureOptions) -> results.Panels[results.Delay]:
    """Fig. 9: torque and slip over two cycles, and the part of positive slip in the first half cycle."""
    panels = []
    for series in row.series:
        _, after = _run_in(system_of(series, options), 2)
        panels.append(results.Delay(series.label, series.values, first_half(after), _time(after), after.slip_speed,
                                    after.engine_torque, after.state))
    return results.Panels(panels)


def first_half(run: Trajectory) -> float:
    """The part of the way slipped in positive direction that falls into the first half of the engine cycle."""
    phase = np.mod(run.t / run.cycle + 1e-12, 1.0)
    slip = np.where(run.state == 1, np.maximum(run.slip_speed, 0.0), 0.0)
    total = float(slip.sum())
    return float(slip[phase < 0.5].sum()) / total if total > 0.0 else math.nan


def actuation(row: PaperFigure, options: FigureOptions) -> results.Panels[results.Actuation]:
    """Fig. 12."""
    panels: list[results.Actuation] = []
    for series in row.series:
        before, after = _run_in(system_of(series, options), 9)
        found = summarise(before)
        shown = (series.label, series.values, found.period, _time(after), after.slip_speed, after.saturation_torque,
                 after.engine_torque)
        panels.append(results.ActuationOnBranch(*shown, orbit_behind(
            system_of(series, options), before.final, RUN_IN, found.period, found.max_slip_speed))
            if options.branches else results.Actuation(*shown))
    return results.Panels(panels)


SOLVER_CURVES: dict[str, tuple[str, str, Mapping[str, float]]] = {
    "smoothed": ("smoothed law, this package", "smoothed", {}),
    "rk45": ("RK45", "smoothed", {"rtol": 1e-6}),
    "bdf": ("Gear (BDF)", "smoothed", {"rtol": 1e-6}),
    "event_driven": ("discontinuous solution", "set_valued", {}),
    "rk4": ("RK4, step 50 us", "smoothed", {"step": 5e-5}),
}
STEADY_LAWS: tuple[tuple[str, Mapping[str, Value]], ...] = (
    (r"(7), $\sigma = 50$", {}), (r"(7), $\sigma = 1000$", {"friction.smoothing": 1000.0}),
    ("(6)", {"friction.law": "set_valued"}))
STEADY_CYCLES, QUICK_STEADY_CYCLES = 3000, 1000
"""Cycles from (13) after which a motion of Fig. 2 is its steady state: the set-valued one takes some 700."""


def solvers(row: PaperFigure, options: FigureOptions) -> results.Solvers:
    """Fig. 2: a cycle or two by each solver from law (7)'s steady motion, and the one of each law from (13)."""
    system = paper_system(row.series[0].values)
    begin = QUICK_STEADY_CYCLES if options.quick else STEADY_CYCLES
    steady = []
    for label, values in STEADY_LAWS:
        before, after = _run_in(replace(system, values), 4, begin, SAMPLES // 2)
        found = summarise(before, begin - 100)
        steady.append(results.Steady(label, values, found.period, found.settled, found.max_slip_speed,
                                     before.final.numbers, _time(after), after.slip_speed))
    start = State(*steady[0].final)
    curves: list[results.SolverCurve] = []
    for solver, (label, law, setting) in SOLVER_CURVES.items():
        begun = time.perf_counter()
        run = solve(replace(system, {"friction.law": law}), cycles=1 if options.quick else 2, samples_per_cycle=SAMPLES,
                    start_cycle=begin, state=start, solver=solver, rtol=setting.get("rtol"), step=setting.get("step"))
        seconds, reference = time.perf_counter() - begun, curves[0].slip_speed if curves else run.slip_speed
        apart = None if len(run.t) != len(reference) else float(
            np.sqrt(np.mean((run.slip_speed - reference) ** 2)) / np.abs(reference).max())
        curves.append(results.SolverCurve(solver, label, run.status.value, seconds, _time(run), run.slip_speed,
                                          run.friction_torque, apart))
    return results.Solvers(system.cycle, curves, steady, begin)
