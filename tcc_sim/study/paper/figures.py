"""Numbers of the paper's figures: from a row of `catalogue.FIGURES` to a frozen result, with the fields of `figure`'s
JSON, for `paper.drawings`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace as renewed
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.analysis.steady.damping import Damping
from tcc_sim.analysis.steady.exponents import Lyapunov, largest_lyapunov_exponent
from tcc_sim.analysis.steady.summary import Summary, summarise
from tcc_sim.model import friction
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.model.quantity import Value
from tcc_sim.result import Described, as_in, reported, result_class
from tcc_sim.solvers import solve
from tcc_sim.study.continuation.orbits import OrbitFigures
from tcc_sim.study.paper import catalogue
from tcc_sim.study.paper.branches_behind import JUMP, MotionsBehind, motions_behind, motions_behind_each, orbit_behind
from tcc_sim.study.paper.catalogue import SWEPT, FigureOptions, PaperFigure, paper_system, series_system
from tcc_sim.study.paper.evidence import CYCLES, DISCARD, first_half, rms_apart, steep, swept
from tcc_sim.sweeps.executors import workers
from tcc_sim.sweeps.results import Point
from tcc_sim.sweeps.simulation import DIRECTIONS
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep, handed_over, solve_point
from tcc_sim.trajectory import State, Trajectory

SECTION_POINTS = 40
"""Number of section points at every value of an orbit diagram."""
SAMPLES = 1000
"""Samples per cycle in a time history."""
SOLVER_CURVES: dict[str, tuple[str, str, Mapping[str, Any]]] = {
    "smoothed": ("smoothed law, this package", "smoothed", {}),
    "rk45": ("RK45", "smoothed", {"rtol": 1e-6}), "bdf": ("Gear (BDF)", "smoothed", {"rtol": 1e-6}),
    "event_driven": ("discontinuous solution", "set_valued", {}),
    "rk4": ("RK4, step 50 us", "smoothed", {"step": 5e-5})}
"""Label, law and settings of the solvers of Fig. 2."""
COLUMNS = ("max_slip_speed", "min_slip_speed", "period", "confirmed", "settled", "runaway", "stick_fraction", "regime",
           "theta2", "equivalent_damping", "negative_slope_mean", "status")
"""Columns of a sweep in the curve of a map."""
SHOWN: dict[str, tuple[int, tuple[str, ...]]] = {
    "histories": (12, ("slip_speed", "plate_angle")), "delay": (2, ("slip_speed", "engine_torque", "state")),
    "actuation": (9, ("slip_speed", "saturation_torque", "engine_torque"))}
"""Number of cycles and columns of each kind of time history."""
STEADY_LAWS: tuple[tuple[str, Mapping[str, Value]], ...] = (
    (r"(7), $\sigma = 50$", {}), (r"(7), $\sigma = 1000$", {"friction.smoothing": 1000.0}),
    ("(6)", {"friction.law": "set_valued"}))
STEADY_CYCLES, QUICK_STEADY_CYCLES = 3000, 1000
"""Number of cycles from (13) to a steady state of Fig. 2; the set-valued law needs about 700."""
optional, same = partial(reported, optional=True, default=None), partial(as_in, optional=True, default=None)


@result_class
class Reached:
    """Motion that a neighbour's last state leads to."""

    max_slip_speed: float = reported("largest |slip speed|", "rad/s")
    period: int = reported("period of the motion", "periods of excitation")


@result_class
class Coexisting:
    """Value at which a neighbour's last state leads to another motion than the cold start."""

    index: int = reported("number of the value along the curve")
    value: float = reported("value of the key", "{over}")
    max_slip_speed: float = reported("that of the cold start", "rad/s")
    period: int = reported("that of the cold start", "periods of excitation")
    other: Reached = reported("the other motion")
    spike: bool = reported("whether the cold start stands out from both of its neighbours")


@result_class(kw_only=True)
class Labelled:
    """Curve or panel of a figure: label and series; series that it lacks are None."""

    label: str = reported("of the curve or panel")
    values: Any = optional("scene keys that set it apart", "{*}")
    direction: Any = optional("direction of the sweep")
    max_slip_speed: Any = same(Summary, "max_slip_speed")
    min_slip_speed: Any = same(Summary, "min_slip_speed")
    period: Any = same(Summary, "period")
    confirmed: Any = same(Point, "confirmed")
    settled: Any = same(Summary, "settled")
    runaway: Any = same(Summary, "runaway")
    stick_fraction: Any = same(Summary, "stick_fraction")
    regime: Any = same(Summary, "regime")
    theta2: Any = same(Point, "theta2")
    equivalent_damping: Any = same(Damping, "weighted")
    negative_slope_mean: Any = same(Damping, "negative_mean")
    status: Any = same(Point, "status")
    coexisting: Sequence[Coexisting] | None = optional("other motions, from a neighbour's last state")
    behind: MotionsBehind | None = optional("motions behind the curve", spread=True)
    coefficient: Any = optional("friction coefficient over mu_k at slip_speed")
    slope: Any = optional("its slope", "s/rad")
    near_coefficient: Any = optional("the same at near_slip_speed")
    near_slope: Any = optional("slope at near_slip_speed", "s/rad")
    near_set_valued: Any = optional("that of the set-valued law at near_slip_speed")
    peak_slip_speed: Any = optional("slip speed of the largest coefficient; null without one", "rad/s")
    peak: Any = optional("largest coefficient over mu_k")
    static: Any = optional("mu_s over mu_k")
    solver: Any = optional("name of the solver")
    seconds: Any = optional("computing time", "s")
    rms_difference: Any = optional(
        "rms difference from the first curve, relative to its largest |slip speed|; null if the solver stopped")
    final: Any = optional("slip speed, plate angle and plate speed at the end", "rad/s, rad, rad/s")
    t: Any = optional("time from the first sample on", "periods of excitation")
    slip_speed: Any = optional("slip speed", "rad/s")
    plate_angle: Any = optional("angle of the clutch plate", "rad")
    friction_torque: Any = optional("friction torque", "N m")
    engine_torque: Any = optional("torque of the engine", "N m")
    saturation_torque: Any = optional("mu_k N R", "N m")
    state: Any = optional("-1 negative slip, 0 stick, 1 positive slip")
    first_half: Any = optional("part of positive slip in the first half cycle; null without any")
    section: Any = optional("plate angle and speed at t = 2 pi n/omega", "rad, rad/s")
    lyapunov: Any = optional("largest exponent, without a period", of=(Lyapunov,))
    orbit: Any = optional("as an entry of `at` in `continue --json`", of=(OrbitFigures,))


@result_class(kw_only=True)
class Figure(Described):
    """Numbers of one figure with its title and caption; numbers that its kind lacks are None."""

    figure: int = reported("number in the paper")
    kind: str = reported("kind of the figure; other fields depend on it")
    title: str = reported("in our words")
    caption: str = reported("in our words")
    law: str = reported("friction law")
    quick: bool = reported("whether it has a quarter of the values")
    parameters: Mapping[str, Any] = reported("scene keys that all of its curves share", "{*}")
    marks: Sequence[float] = reported("places on the axis that the text names")
    over: Any = optional("scene key of the axis")
    axis: Any = optional("name of the axis")
    x: Any = optional("values on the axis")
    unit: Any = optional("value of the key at 1 on the axis")
    cycles: Any = optional("cycles solved at every value")
    discarded: Any = optional("cycles dropped")
    threshold: Any = optional("-C23 of (23)", "N m s/rad")
    slip_speed: Any = optional("slip speeds of the curves of Fig. 3", "rad/s")
    near_slip_speed: Any = optional("slip speeds near 0, Fig. 3", "rad/s")
    cycle: Any = optional("period of excitation", "s")
    curves: Any = optional("one for each series", of=(Labelled,))
    panels: Any = optional("time histories", of=(Labelled,))
    steady: Any = optional("steady state of each law from (13)", of=(Labelled,))
    steady_cycles: Any = optional("cycles before a steady state")
    seconds: float = reported("computing time", "s")


def figure_data(row: PaperFigure, options: FigureOptions) -> Figure:
    """Compute the numbers of one figure; raise NumericalFailure if a time history could not be solved. A failed point
    of a sweep is a status in the data.
    """
    began = time.perf_counter()
    varied = {key for series in row.series for key in series.values} if len(row.series) > 1 else set()
    varied |= {row.over} if row.kind in SWEPT else set()
    common = {key: value for key, value in values_of(series_system(row.series[0], options)) if key not in varied}
    return Figure(figure=row.number, kind=row.kind, title=row.title, caption=row.caption, law=options.law,
                  quick=options.quick, parameters=common, marks=row.marks, **KINDS[row.kind](row, options),
                  seconds=time.perf_counter() - began)


def _over_axis(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Compute a map, Fig. 5, or Fig. 6, which is also continued up and down if the options have no direction."""
    count = (row.count - 1) // catalogue.QUICK_SHARE + 1 if options.quick else row.count
    (name, unit), ratios = catalogue.NORMALISED[row.over], np.linspace(*row.span, count)
    wanted = [Curve(series_system(s, options), row.over, catalogue.values_at(row.over, ratios)) for s in row.series]
    directions = (options.direction,) if options.direction else DIRECTIONS if row.kind == "orbit" else ("cold",)
    plans = [Plan(cycles=100 if options.quick else CYCLES, discard=DISCARD, direction=direction,
                  section_points=SECTION_POINTS, damping=row.kind == "damping") for direction in directions]
    sweeps = [s for plan in plans for s in swept(wanted, plan, options.kept, options.jobs, options.progress)]
    others = [coexisting(sweep, options.jobs) if row.kind == "map" and sweep.plan.direction == "cold" else None
              for sweep in sweeps]
    behind: Sequence[MotionsBehind | None] = [None] * len(sweeps)
    if options.branches and row.kind in catalogue.BRANCHED:
        behind = motions_behind(sweeps, options.progress) if row.kind == "orbit" else motions_behind_each(
            sweeps, options.jobs, options.progress)
    curves = [Labelled(label=series.label, values=series.values, direction=sweep.plan.direction,
                       coexisting=other, behind=motions,
                       **{name: column for name, column in sweep.lists.items() if name in COLUMNS})
              for series, sweep, other, motions in zip(row.series * len(plans), sweeps, others, behind)]
    return {"over": row.over, "axis": name, "x": ratios.tolist(), "unit": unit, "cycles": plans[0].most,
            "discarded": DISCARD, "threshold": -paper_system().driveline.damping if row.kind == "damping" else None,
            "curves": curves}


def coexisting(sweep: Sweep, jobs: int | None = None) -> list[Coexisting]:
    """Return the motions from a neighbour's last state that differ from those of the cold start.

    The search covers both sides of every change of more than JUMP of the curve's largest value between neighbours with
    a period; the maximum of an aperiodic motion scatters without another motion.
    """
    largest = sweep.column("max_slip_speed")
    periods = [0 if p is None or p.summary is None else p.summary.period for p in sweep.points]
    size = float(np.nanmax(largest))
    plan = renewed(sweep.plan, section_points=0, damping=False, lyapunov=False)

    def follow(here: int, neighbour: Point | None, place: int) -> Coexisting | None:
        if neighbour is None or not (periods[here] and periods[place]):
            return None
        system, value = sweep.curve.at(here), sweep.curve.values[here]
        summary = solve_point(system, value, plan, handed_over(sweep.curve.at(place), neighbour.end, system)).summary
        if summary is None or not summary.period or abs(summary.max_slip_speed - largest[here]) <= JUMP * size:
            return None
        beside = largest[here] - largest[[here - 1, here + 1]] if 0 < here < len(largest) - 1 else np.zeros(2)
        spike = bool(beside[0] * beside[1] > 0.0 and np.abs(beside).min() > JUMP * size)
        return Coexisting(here, value, float(largest[here]), periods[here], Reached(
            summary.max_slip_speed, summary.period), spike)

    pairs = [(here, sweep.points[neighbour_place], neighbour_place) for k in steep(largest).tolist()
             for here, neighbour_place in ((k, k + 1), (k + 1, k))]
    with workers(jobs, None) as (threads, _):
        rows = [row for row in threads.map(follow, *zip(*pairs)) if row is not None] if pairs else []
    return sorted(rows, key=lambda row: row.index)


def _law(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Compute Fig. 3: the smoothed law, also near 0, its slope, and the set-valued law."""
    curves = []
    v = np.linspace(-2.0, 2.0, 2001)
    near = np.linspace(0.0, 0.2, 801)
    for series in row.series:
        system = paper_system(series.values)
        law = system.friction.smoothing, system.friction.stribeck
        wide, close = (friction.smoothed_and_slope(x, *law) for x in (v, near))
        peak, height = friction.peak(*law)
        curves.append(Labelled(
            label=series.label, values=series.values, coefficient=wide[0], slope=wide[1], near_coefficient=close[0],
            near_slope=close[1], near_set_valued=friction.sliding(near, 1.0, law[1]) + 0.0 * near,
            peak_slip_speed=peak, peak=height, static=1.0 + (law[1][0] if law[1] else 0.0)))
    return {"slip_speed": v, "near_slip_speed": near, "curves": curves}


def _run_in(system: System, more: int, cycles: int = CYCLES, samples: int = SAMPLES) -> tuple[Trajectory, Trajectory]:
    """Solve some cycles with the transient, and then more cycles with samples."""
    before = solve(system, cycles=cycles).raise_for_status()
    return before, solve(system, cycles=more, samples_per_cycle=samples, start_cycle=cycles,
                         state=before.final).raise_for_status()


def _panels(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Compute the time histories of Figs. 7, 9 and 12, with the sections of Fig. 7 and the orbits of Fig. 12."""
    cycles, columns = SHOWN[row.kind]
    panels = []
    for series in row.series:
        system = series_system(series, options)
        before, after = _run_in(system, cycles)
        summary, more = summarise(before), dict[str, Any]()
        if row.kind == "delay":
            more = {"first_half": first_half(after)}
        elif row.kind == "histories":
            more = {"period": summary.period, **_section(system, before, summary.period, options)}
        else:
            more = {"period": summary.period, "orbit": orbit_behind(
                system, before.final, CYCLES, summary.period, summary.max_slip_speed) if options.branches else None}
        shown = {name: getattr(after, name) for name in columns}
        panels.append(Labelled(label=series.label, values=series.values,
                               t=(after.t - after.t[0]) / after.cycle, **shown, **more))
    return {"panels": panels}


def _section(system: System, before: Trajectory, period: int, options: FigureOptions) -> dict[str, Any]:
    """Return the points of the section and, for a motion without period under law (7), the largest exponent."""
    if period:
        return {"section": before.solved_cycles.section[-period:, 1:]}
    many = catalogue.SECTION_CYCLES // (catalogue.QUICK_SHARE if options.quick else 1)
    further = solve(system, cycles=many, start_cycle=CYCLES, state=before.final).raise_for_status()
    return {"section": further.solved_cycles.section[1:, 1:],
            "lyapunov": largest_lyapunov_exponent(system, before.final, cycles=many, start_cycle=CYCLES)
            if options.law == "smoothed" else None}


def _solvers(row: PaperFigure, options: FigureOptions) -> dict[str, Any]:
    """Compute Fig. 2: cycles by each solver from the steady motion of law (7), and steady motions from (13)."""
    system = paper_system(row.series[0].values)
    begin = QUICK_STEADY_CYCLES if options.quick else STEADY_CYCLES
    steady = []
    for label, values in STEADY_LAWS:
        before, after = _run_in(replace(system, values), 4, begin, SAMPLES // 2)
        summary = summarise(before, begin - 100)
        steady.append(Labelled(
            label=label, values=values, period=summary.period, settled=summary.settled, final=before.final.numbers,
            max_slip_speed=summary.max_slip_speed, t=(after.t - after.t[0]) / after.cycle, slip_speed=after.slip_speed))
    start = State(*steady[0].final)
    curves: list[Labelled] = []
    for solver, (label, law, how) in SOLVER_CURVES.items():
        begun = time.perf_counter()
        run = solve(replace(system, {"friction.law": law}), cycles=1 if options.quick else 2, samples_per_cycle=SAMPLES,
                    start_cycle=begin, state=start, solver=solver, **how)
        seconds, reference = time.perf_counter() - begun, curves[0].slip_speed if curves else run.slip_speed
        apart = np.nan if len(run.t) != len(reference) else rms_apart(run.slip_speed, reference)
        curves.append(Labelled(
            solver=solver, label=label, status=run.status.value, seconds=seconds, t=(run.t - run.t[0]) / run.cycle,
            slip_speed=run.slip_speed, friction_torque=run.friction_torque, rms_difference=apart))
    return {"cycle": system.cycle, "curves": curves, "steady": steady, "steady_cycles": begin}


KINDS: dict[str, Callable[[PaperFigure, FigureOptions], dict[str, Any]]] = {
    **dict.fromkeys(SWEPT, _over_axis), **dict.fromkeys(SHOWN, _panels), "law": _law, "solvers": _solvers}
"""Function that computes each kind of figure."""
