"""The numbers of the paper's figures: a row of `paper.FIGURES` -> JSON values, which `views.paper_figures` draws."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tcc_sim.analysis.summary import summarise
from tcc_sim.errors import InputError
from tcc_sim.model import friction
from tcc_sim.model.parameters import System, Value, replace, values_of
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, STATIC, PaperFigure, Series, paper_system
from tcc_sim.paper.coexistence import coexisting
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import terms_of
from tcc_sim.studies.lyapunov import largest_lyapunov_exponent
from tcc_sim.studies.sweep import Curve, Plan, Sweep, sweep_curves
from tcc_sim.trajectory import State, Trajectory

SECTION_POINTS = 40
"""Points of the section in an orbit diagram at every value."""
QUICK_SHARE = 4
"""`--quick` takes one value of so many."""
SAMPLES = 1000
"""Samples per cycle in a time history."""
RUN_IN = 150
"""Cycles before a time history."""
SECTION_CYCLES = 2000
"""Section points of a motion without period in Fig. 7."""

SWEPT = ("map", "damping", "orbit")
"""Kinds of figures with a sweep, which has a direction."""
BOTH_LAWS = ("law", "solvers")
"""Kinds of figures that show the smoothed and the set-valued law."""


@dataclass(frozen=True)
class Manner:
    """How the figures are made.

    quick : a quarter of the values and half of the cycles
    direction : of the sweeps; None takes what the figure has
    law : smoothed, as in the paper, or set_valued
    jobs : threads; None takes all cores
    progress : show a bar on a terminal
    kept : curves that were swept already; figures share some of them
    """

    quick: bool = False
    direction: str | None = None
    law: str = "smoothed"
    jobs: int | None = None
    progress: bool = False
    kept: dict[tuple[Curve, Plan], Sweep] = field(default_factory=dict, compare=False, repr=False)


def check_manner(number: int, manner: Manner) -> None:
    """Raise InputError where a figure has nothing that a direction or the set-valued law would change."""
    kind = FIGURES[number].kind
    if manner.direction is not None and kind not in SWEPT:
        raise InputError(f"direction is {manner.direction}; Fig. {number} has no sweep")
    if manner.law != "smoothed" and kind in BOTH_LAWS:
        raise InputError(f"law is {manner.law}; Fig. {number} shows both laws")


def figure_data(number: int, manner: Manner) -> dict[str, Any]:
    """The numbers of one figure as JSON values.

    Raises
    ------
    InputError
        A figure that the paper does not have, or one without numbers.
    NumericalFailure
        A time history that could not be solved; a failed point of a sweep is a status in the data instead.
    """
    if number not in FIGURES:
        raise InputError(f"figure {number} has no numbers; the figures are {min(FIGURES)} to {max(FIGURES)}")
    row = FIGURES[number]
    began = time.perf_counter()
    out: dict[str, Any] = {
        "figure": number, "kind": row.kind, "title": row.title, "caption": row.caption, "law": manner.law,
        "quick": manner.quick,
        "parameters": {key: value for key, value in values_of(figure_system(number, manner))
                       if key not in _varied(row)},
        "marks": list(row.marks), **KINDS[row.kind](row, manner)}
    out["seconds"] = time.perf_counter() - began
    return out


def figure_system(number: int, manner: Manner) -> System:
    """The system of a figure's first curve; the others and its axis are changes of it."""
    return _system(FIGURES[number].series[0], manner)


def _varied(row: PaperFigure) -> set[str]:
    """Keys that differ between the curves or along them."""
    keys = {key for series in row.series for key in series.values} if len(row.series) > 1 else set()
    return keys | ({row.over} if row.kind in ("map", "damping", "orbit") else set())


def _system(series: Series, manner: Manner, **values: Value) -> System:
    """The system of one curve."""
    return replace(paper_system(series.values), {"friction.law": manner.law, **values})


def _axis(row: PaperFigure, manner: Manner) -> tuple[str, np.ndarray, float]:
    """Name and values of the normalised axis, and the value of the key at 1."""
    count = (row.count - 1) // QUICK_SHARE + 1 if manner.quick else row.count
    ratios = np.linspace(*row.span, count)
    if row.over == "engine.frequency":
        return "omega/omega_n", ratios, OMEGA_N
    return "mu_k/mu_s", ratios, STATIC


def plan_of(manner: Manner, direction: str = "cold", *, damping: bool = False) -> Plan:
    """The paper's rule: 50 cycles dropped; 100 kept, 50 where it has to be quick."""
    return Plan(cycles=100 if manner.quick else 150, discard=50, direction=manner.direction or direction,
                section_points=SECTION_POINTS, damping=damping)


def _curves(row: PaperFigure, manner: Manner, plan: Plan) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Every series swept, as JSON values, and what the figure says of the axis."""
    name, ratios, unit = _axis(row, manner)
    scaled = np.minimum(ratios * unit, STATIC) if unit == STATIC else ratios * unit
    key_values = tuple(float(x) for x in scaled)
    wanted = [Curve(_system(s, manner), row.over, key_values) for s in row.series]
    missing = [curve for curve in wanted if (curve, plan) not in manner.kept]
    if missing:
        for sweep in sweep_curves(missing, plan, jobs=manner.jobs, progress=manner.progress):
            manner.kept[sweep.curve, plan] = sweep
    found = [manner.kept[curve, plan] for curve in wanted]
    curves = [curve_json(series, sweep) for series, sweep in zip(row.series, found)]
    if row.kind == "map" and plan.direction == "cold":
        for curve, sweep in zip(curves, found):
            curve["coexisting"] = coexisting(sweep, manner.jobs)
    return curves, {"axis": name, "x": ratios.tolist(), "cycles": plan.cycles, "discarded": 50}


def curve_json(series: Series, sweep: Sweep) -> dict[str, Any]:
    """One curve as JSON values."""
    data = sweep.as_json()
    names = ["max_slip_speed", "min_slip_speed", "period", "confirmed", "settled", "stick_fraction", "regime", "theta2",
             "equivalent_damping", "negative_slope_mean", "status"]
    return {"label": series.label, "values": dict(series.values), "direction": data["direction"],
            **{name: data[name] for name in names if name in data}}


def _map(row: PaperFigure, manner: Manner) -> dict[str, Any]:
    """Figs. 4, 8, 10, 11, 13 to 18."""
    curves, axis = _curves(row, manner, plan_of(manner))
    return {**axis, "curves": curves}


def _damping(row: PaperFigure, manner: Manner) -> dict[str, Any]:
    """Fig. 5."""
    curves, axis = _curves(row, manner, plan_of(manner, damping=True))
    return {**axis, "threshold": -paper_system().driveline.damping, "curves": curves}


def _orbit(row: PaperFigure, manner: Manner) -> dict[str, Any]:
    """Fig. 6: from the initial state, and continued up and down (only one of these where the manner says which)."""
    curves: list[dict[str, Any]] = []
    axis: dict[str, Any] = {}
    for direction in (manner.direction,) if manner.direction else ("cold", "up", "down"):
        found, axis = _curves(row, manner, plan_of(manner, direction))
        curves += found
    return {**axis, "curves": curves}


def _run_in(system: System, manner: Manner, cycles: int, samples: int = SAMPLES) -> tuple[Trajectory, Trajectory]:
    """The motion over the transient and the 100 cycles after it, and then over some more with samples."""
    before = solve(system, cycles=RUN_IN).raise_for_status()
    after = solve(system, cycles=cycles, samples_per_cycle=samples, start_cycle=RUN_IN,
                  state=before.final).raise_for_status()
    return before, after


def _state(run: Trajectory) -> list[float]:
    """Slip speed, plate angle and plate speed at the end."""
    last = run.final
    return [last.slip_speed, last.plate_angle, last.plate_speed]


def _samples(run: Trajectory, *names: str) -> dict[str, Any]:
    """Time in engine cycles from the first sample on, and some signals."""
    return {"t": ((run.t - run.t[0]) / run.cycle).tolist(), **{name: getattr(run, name).tolist() for name in names}}


def _histories(row: PaperFigure, manner: Manner) -> dict[str, Any]:
    """Fig. 7."""
    panels = []
    for series in row.series:
        system = _system(series, manner)
        before, after = _run_in(system, manner, 12)
        summary = summarise(before)
        section, exponent = summary.section, None
        if not summary.period:
            many = SECTION_CYCLES // (QUICK_SHARE if manner.quick else 1)
            further = solve(system, cycles=many, start_cycle=RUN_IN, state=before.final).raise_for_status()
            section = summarise(further, 0).section
            if manner.law == "smoothed":
                exponent = largest_lyapunov_exponent(system, before.final, cycles=many, start_cycle=RUN_IN).as_json()
        panels.append({"label": series.label, "values": dict(series.values), "period": summary.period,
                       "section": [list(p) for p in section], "lyapunov": exponent,
                       **_samples(after, "slip_speed", "plate_angle")})
    return {"panels": panels}


def _delay(row: PaperFigure, manner: Manner) -> dict[str, Any]:
    """Fig. 9: torque and slip over two cycles, and the part of positive slip in the first half cycle."""
    panels = []
    for series in row.series:
        _, after = _run_in(_system(series, manner), manner, 2)
        panels.append({"label": series.label, "values": dict(series.values), "first_half": first_half(after),
                       **_samples(after, "slip_speed", "engine_torque", "state")})
    return {"panels": panels}


def first_half(run: Trajectory) -> float:
    """The part of the way slipped in positive direction that falls into the first half of the engine cycle."""
    phase = np.mod(run.t / run.cycle + 1e-12, 1.0)
    slip = np.where(run.state == 1, np.maximum(run.slip_speed, 0.0), 0.0)
    total = float(slip.sum())
    return float(slip[phase < 0.5].sum()) / total if total > 0.0 else math.nan


def _actuation(row: PaperFigure, manner: Manner) -> dict[str, Any]:
    """Fig. 12."""
    panels = []
    for series in row.series:
        before, after = _run_in(_system(series, manner), manner, 9)
        panels.append({"label": series.label, "values": dict(series.values), "period": summarise(before).period,
                       **_samples(after, "slip_speed", "saturation_torque", "engine_torque")})
    return {"panels": panels}


def _law(row: PaperFigure, manner: Manner) -> dict[str, Any]:
    """Fig. 3: the smoothed law, near 0, and its slope; with the set-valued law beside it."""
    curves = []
    v = np.linspace(-2.0, 2.0, 2001)
    near = np.linspace(0.0, 0.2, 801)
    for series in row.series:
        terms = terms_of(paper_system(series.values))
        assert terms.smoothing is not None
        wide, close = (friction.smoothed_and_slope(x, terms.smoothing, terms.stribeck) for x in (v, near))
        peak, height = friction.peak(terms.smoothing, terms.stribeck)
        sliding = friction.sliding(near, 1.0, terms.stribeck) + 0.0 * near
        curves.append({"label": series.label, "values": dict(series.values), "coefficient": wide[0].tolist(),
                       "slope": wide[1].tolist(), "near_coefficient": close[0].tolist(),
                       "near_slope": close[1].tolist(),
                       "near_set_valued": sliding.tolist(), "peak_slip_speed": peak if math.isfinite(peak) else None,
                       "peak": height, "static": 1.0 + (terms.stribeck[0] if terms.stribeck else 0.0)})
    return {"slip_speed": v.tolist(), "near_slip_speed": near.tolist(), "curves": curves}


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


def _solvers(row: PaperFigure, manner: Manner) -> dict[str, Any]:
    """Fig. 2: a cycle or two by each solver from law (7)'s steady motion, and the one of each law from (13)."""
    system = paper_system(row.series[0].values)
    begin = QUICK_STEADY_CYCLES if manner.quick else STEADY_CYCLES
    steady = []
    for label, values in STEADY_LAWS:
        before = solve(replace(system, values), cycles=begin).raise_for_status()
        after = solve(replace(system, values), cycles=4, samples_per_cycle=SAMPLES // 2, start_cycle=begin,
                      state=before.final).raise_for_status()
        found = summarise(before, begin - 100)
        steady.append({"label": label, "values": dict(values), "period": found.period, "settled": found.settled,
                       "max_slip_speed": found.max_slip_speed, "final": _state(before),
                       **_samples(after, "slip_speed")})
    start = State(*steady[0]["final"])
    curves = []
    for solver, (label, law, setting) in SOLVER_CURVES.items():
        begun = time.perf_counter()
        run = solve(replace(system, {"friction.law": law}), cycles=1 if manner.quick else 2, samples_per_cycle=SAMPLES,
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


KINDS: dict[str, Callable[[PaperFigure, Manner], dict[str, Any]]] = {
    "map": _map, "damping": _damping, "orbit": _orbit, "histories": _histories, "delay": _delay,
    "actuation": _actuation,
    "law": _law, "solvers": _solvers}
