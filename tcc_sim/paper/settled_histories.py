"""The numbers of the paper's time histories: Figs. 2, 7, 9 and 12, each solved until its motion has settled."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from tcc_sim.analysis.summary import summarise
from tcc_sim.model.parameters import System, replace
from tcc_sim.model.quantity import Value
from tcc_sim.paper.catalogue import PaperFigure, paper_system
from tcc_sim.paper.figure_branches import orbit_behind
from tcc_sim.paper.figure_options import QUICK_SHARE, FigureOptions, system_of
from tcc_sim.solvers import solve
from tcc_sim.sweeps.exponents import largest_lyapunov_exponent
from tcc_sim.trajectory import State, Trajectory

SAMPLES = 1000
"""Samples per cycle in a time history."""
RUN_IN = 150
"""Cycles before a time history."""
SECTION_CYCLES = 2000
"""Section points of a motion without period in Fig. 7."""


def _run_in(system: System, options: FigureOptions, cycles: int,
            samples: int = SAMPLES) -> tuple[Trajectory, Trajectory]:
    """The motion over the transient and the 100 cycles after it, and then over some more with samples."""
    before = solve(system, cycles=RUN_IN).raise_for_status()
    after = solve(system, cycles=cycles, samples_per_cycle=samples, start_cycle=RUN_IN,
                  state=before.final).raise_for_status()
    return before, after


def _samples(run: Trajectory, *names: str) -> dict[str, Any]:
    """Time in engine cycles from the first sample on, and some signals."""
    return {"t": ((run.t - run.t[0]) / run.cycle).tolist(), **{name: getattr(run, name).tolist() for name in names}}


def histories(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Fig. 7."""
    panels = []
    for series in row.series:
        system = system_of(series, options)
        before, after = _run_in(system, options, 12)
        summary = summarise(before)
        section, exponent = summary.section, None
        if not summary.period:
            many = SECTION_CYCLES // (QUICK_SHARE if options.quick else 1)
            further = solve(system, cycles=many, start_cycle=RUN_IN, state=before.final).raise_for_status()
            section = summarise(further, 0).section
            if options.law == "smoothed":
                exponent = largest_lyapunov_exponent(system, before.final, cycles=many, start_cycle=RUN_IN).as_json()
        panels.append({"label": series.label, "values": dict(series.values), "period": summary.period,
                       "section": [list(p) for p in section], "lyapunov": exponent,
                       **_samples(after, "slip_speed", "plate_angle")})
    return {"panels": panels}


def delay(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Fig. 9: torque and slip over two cycles, and the part of positive slip in the first half cycle."""
    panels = []
    for series in row.series:
        _, after = _run_in(system_of(series, options), options, 2)
        panels.append({"label": series.label, "values": dict(series.values), "first_half": first_half(after),
                       **_samples(after, "slip_speed", "engine_torque", "state")})
    return {"panels": panels}


def first_half(run: Trajectory) -> float:
    """The part of the way slipped in positive direction that falls into the first half of the engine cycle."""
    phase = np.mod(run.t / run.cycle + 1e-12, 1.0)
    slip = np.where(run.state == 1, np.maximum(run.slip_speed, 0.0), 0.0)
    total = float(slip.sum())
    return float(slip[phase < 0.5].sum()) / total if total > 0.0 else math.nan


def actuation(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Fig. 12."""
    panels = []
    for series in row.series:
        before, after = _run_in(system_of(series, options), options, 9)
        found = summarise(before)
        panels.append({"label": series.label, "values": dict(series.values), "period": found.period,
                       **_samples(after, "slip_speed", "saturation_torque", "engine_torque")})
        if options.branches:
            panels[-1]["orbit"] = orbit_behind(system_of(series, options), before.final, RUN_IN, found.period,
                                               found.max_slip_speed)
    return {"panels": panels}


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


def solvers(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Fig. 2: a cycle or two by each solver from law (7)'s steady motion, and the one of each law from (13)."""
    system = paper_system(row.series[0].values)
    begin = QUICK_STEADY_CYCLES if options.quick else STEADY_CYCLES
    steady = []
    for label, values in STEADY_LAWS:
        before = solve(replace(system, values), cycles=begin).raise_for_status()
        after = solve(replace(system, values), cycles=4, samples_per_cycle=SAMPLES // 2, start_cycle=begin,
                      state=before.final).raise_for_status()
        found = summarise(before, begin - 100)
        steady.append({"label": label, "values": dict(values), "period": found.period, "settled": found.settled,
                       "max_slip_speed": found.max_slip_speed, "final": list(before.final.numbers),
                       **_samples(after, "slip_speed")})
    start = State(*steady[0]["final"])
    curves = []
    for solver, (label, law, setting) in SOLVER_CURVES.items():
        begun = time.perf_counter()
        run = solve(replace(system, {"friction.law": law}), cycles=1 if options.quick else 2, samples_per_cycle=SAMPLES,
                    start_cycle=begin, state=start, solver=solver, rtol=setting.get("rtol"), step=setting.get("step"))
        curves.append({"solver": solver, "label": label, "status": run.status.value,
                       "seconds": time.perf_counter() - begun,
                       **_samples(run, "slip_speed", "friction_torque")})
    reference = np.array(curves[0]["slip_speed"])
    for curve in curves:
        v = np.array(curve["slip_speed"])
        same = len(v) == len(reference)
        curve["rms_difference"] = float(np.sqrt(np.mean((v - reference) ** 2))
                                        / np.abs(reference).max()) if same else None
    return {"cycle": system.cycle, "curves": curves, "steady": steady, "steady_cycles": begin}
