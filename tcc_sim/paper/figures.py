"""Numbers of the paper's figures: from a row of `catalogue.FIGURES` to a frozen result for `paper.drawings`."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tcc_sim.analysis.summary import summarise
from tcc_sim.errors import InputError
from tcc_sim.model import friction
from tcc_sim.model.parameters import System, replace, values_of
from tcc_sim.model.quantity import Value
from tcc_sim.paper import figure_results as results
from tcc_sim.paper.branches_behind import motions_behind, motions_behind_each, orbit_behind
from tcc_sim.paper.catalogue import (
    FIGURES,
    NORMALISED,
    QUICK_SHARE,
    SECTION_CYCLES,
    STATIC,
    FigureOptions,
    PaperFigure,
    Series,
    paper_system,
    series_system,
)
from tcc_sim.paper.evidence import JUMP, first_half, steep, swept
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import terms_of
from tcc_sim.sweeps.executors import workers
from tcc_sim.sweeps.exponents import largest_lyapunov_exponent
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep, handed_over, solve_point
from tcc_sim.trajectory import Floats, State, Trajectory

SECTION_POINTS = 40
"""Number of section points at every value of an orbit diagram."""
SAMPLES = 1000
"""Samples per cycle in a time history."""
RUN_IN = 150
"""Number of cycles before a time history."""
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
"""Number of cycles from (13) to a steady state of Fig. 2; the set-valued law needs about 700."""


def figure_data(number: int, options: FigureOptions) -> results.Figure:
    """Compute the numbers of one figure.

    Raises
    ------
    InputError
        The paper has no such figure, or the figure has no numbers.
    NumericalFailure
        A time history could not be solved; a failed point of a sweep is a status in the data instead.
    """
    if number not in FIGURES:
        raise InputError(f"figure {number} has no numbers; the figures are {min(FIGURES)} to {max(FIGURES)}")
    row = FIGURES[number]
    began = time.perf_counter()
    common = {key: value for key, value in values_of(figure_system(number, options)) if key not in _varied(row)}
    numbers = KINDS[row.kind](row, options)
    return results.Figure(number, row.kind, row.title, row.caption, options.law, options.quick, common, row.marks,
                          numbers, time.perf_counter() - began)


def figure_system(number: int, options: FigureOptions) -> System:
    """Return the system of a figure's first curve, of which the other systems are changes."""
    return series_system(FIGURES[number].series[0], options)


def _varied(row: PaperFigure) -> set[str]:
    """Return the keys that differ between the curves or along them."""
    keys = {key for series in row.series for key in series.values} if len(row.series) > 1 else set()
    return keys | ({row.over} if row.kind in ("map", "damping", "orbit") else set())


def _axis(row: PaperFigure, options: FigureOptions) -> tuple[str, np.ndarray, float]:
    """Return name and values of the normalised axis, and the value of the key at 1."""
    count = (row.count - 1) // QUICK_SHARE + 1 if options.quick else row.count
    name, unit = NORMALISED[row.over]
    return name, np.linspace(*row.span, count), unit


def _plan(options: FigureOptions, direction: str = "cold", *, damping: bool = False) -> Plan:
    """Return the paper's rule: 50 dropped cycles and 100 more, or 50 more with `quick`."""
    return Plan(cycles=100 if options.quick else 150, discard=50, direction=options.direction or direction,
                section_points=SECTION_POINTS, damping=damping)


def _swept(row: PaperFigure, options: FigureOptions, plan: Plan) -> list[Sweep]:
    """Return the sweep of every series."""
    _, ratios, unit = _axis(row, options)
    scaled = np.minimum(ratios * unit, STATIC) if unit == STATIC else ratios * unit
    wanted = [Curve(series_system(s, options), row.over, tuple(float(x) for x in scaled)) for s in row.series]
    return swept(wanted, plan, options.kept, options.jobs, options.progress)


def _curves(row: PaperFigure, options: FigureOptions, curves: Sequence[results.Labelled],
            threshold: float | None = None) -> results.Numbers:
    """Return the numbers of curves over the figure's axis."""
    name, ratios, unit = _axis(row, options)
    return results.Numbers(over=row.over, axis=name, x=ratios.tolist(), unit=unit, cycles=_plan(options).most,
                           discarded=50, threshold=threshold, curves=curves)


COLUMNS = ("max_slip_speed", "min_slip_speed", "period", "confirmed", "settled", "runaway", "stick_fraction", "regime",
           "theta2", "equivalent_damping", "negative_slope_mean", "status")
"""Columns of a sweep in the curve of a map."""


def _curve(series: Series, sweep: Sweep, others: Sequence[results.Coexisting] | None = None,
           behind: results.MotionsBehind | None = None) -> results.Labelled:
    """Return one sweep as a curve."""
    return results.Labelled(label=series.label, values=series.values, direction=sweep.plan.direction, coexisting=others,
                            behind=behind,
                            **{name: column for name, column in sweep.lists.items() if name in COLUMNS})


def coexisting(sweep: Sweep, jobs: int | None = None) -> list[results.Coexisting]:
    """Return the motions from a neighbour's last state that differ from those of the cold start.

    The search covers both sides of every change of more than JUMP of the curve's largest value between neighbours with
    a period; the maximum of an aperiodic motion scatters without another motion.
    """
    largest = sweep.column("max_slip_speed")
    periods = [0 if p is None or p.summary is None else p.summary.period for p in sweep.points]
    size = float(np.nanmax(largest))
    pairs = [(here, there) for k in steep(largest) for here, there in ((int(k), int(k) + 1), (int(k) + 1, int(k)))
             if periods[here] and periods[there]]

    def follow(pair: tuple[int, int]) -> results.Coexisting | None:
        here, there = pair
        neighbour = sweep.points[there]
        assert neighbour is not None
        plan = dataclasses.replace(sweep.plan, section_points=0, damping=False, lyapunov=False)
        system = sweep.curve.at(here)
        start = handed_over(sweep.curve.at(there), neighbour.end, system)
        point = solve_point(system, sweep.curve.values[here], plan, start)
        found = point.summary
        if found is None or not found.period or abs(found.max_slip_speed - largest[here]) <= JUMP * size:
            return None
        return results.Coexisting(here, sweep.curve.values[here], float(largest[here]), periods[here],
                                  results.Reached(found.max_slip_speed, found.period),
                                  stands_out(largest, here, JUMP * size))

    with workers(jobs, None) as (threads, _):
        rows = [row for row in threads.map(follow, pairs) if row is not None]
    return sorted(rows, key=lambda row: row.index)


def stands_out(values: np.ndarray, k: int, least: float) -> bool:
    """Return whether a value lies above, or below, both of its neighbours by more than `least`."""
    if not 0 < k < len(values) - 1:
        return False
    left, right = values[k] - values[k - 1], values[k] - values[k + 1]
    return bool(left * right > 0.0 and min(abs(left), abs(right)) > least)


def _map(row: PaperFigure, options: FigureOptions) -> results.Numbers:
    """Compute a map: Figs. 4, 8, 10, 11, 13 to 18."""
    sweeps = _swept(row, options, _plan(options))
    cold = sweeps[0].plan.direction == "cold"
    others = [coexisting(sweep, options.jobs) if cold else None for sweep in sweeps]
    behind = motions_behind_each(sweeps, options.jobs, options.progress) if options.branches else [None] * len(sweeps)
    return _curves(row, options, [_curve(*of) for of in zip(row.series, sweeps, others, behind)])


def _damping(row: PaperFigure, options: FigureOptions) -> results.Numbers:
    """Compute Fig. 5."""
    sweeps = _swept(row, options, _plan(options, damping=True))
    return _curves(row, options, [_curve(*of) for of in zip(row.series, sweeps)], -paper_system().driveline.damping)


def _orbit(row: PaperFigure, options: FigureOptions) -> results.Numbers:
    """Compute Fig. 6 from the initial state, and continued up and down, or in the direction of the options only."""
    directions = (options.direction,) if options.direction else ("cold", "up", "down")
    sweeps = [sweep for direction in directions for sweep in _swept(row, options, _plan(options, direction))]
    behind = motions_behind(sweeps, options.progress) if options.branches else [None] * len(sweeps)
    return _curves(row, options, [_curve(row.series[0], sweep, None, found) for sweep, found in zip(sweeps, behind)])


def _law(row: PaperFigure, options: FigureOptions) -> results.Numbers:
    """Compute Fig. 3: the smoothed law, also near 0, its slope, and the set-valued law."""
    curves = []
    v = np.linspace(-2.0, 2.0, 2001)
    near = np.linspace(0.0, 0.2, 801)
    for series in row.series:
        terms = terms_of(paper_system(series.values))
        assert terms.smoothing is not None
        wide, close = (friction.smoothed_and_slope(x, terms.smoothing, terms.stribeck) for x in (v, near))
        peak, height = friction.peak(terms.smoothing, terms.stribeck)
        sliding = friction.sliding(near, 1.0, terms.stribeck) + 0.0 * near
        curves.append(results.Labelled(
            label=series.label, values=series.values, coefficient=wide[0], slope=wide[1], near_coefficient=close[0],
            near_slope=close[1], near_set_valued=sliding, peak_slip_speed=peak, peak=height,
            static=1.0 + (terms.stribeck[0] if terms.stribeck else 0.0)))
    return results.Numbers(slip_speed=v, near_slip_speed=near, curves=curves)


def _run_in(system: System, more: int, cycles: int = RUN_IN, samples: int = SAMPLES) -> tuple[Trajectory, Trajectory]:
    """Solve some cycles with the transient, and then more cycles with samples."""
    before = solve(system, cycles=cycles).raise_for_status()
    return before, solve(system, cycles=more, samples_per_cycle=samples, start_cycle=cycles,
                         state=before.final).raise_for_status()


def _time(run: Trajectory) -> Floats:
    """Return the time in engine cycles from the first sample on."""
    found: Floats = (run.t - run.t[0]) / run.cycle
    return found


def _histories(row: PaperFigure, options: FigureOptions) -> results.Numbers:
    """Compute Fig. 7."""
    panels = []
    for series in row.series:
        system = series_system(series, options)
        before, after = _run_in(system, 12)
        summary, exponent = summarise(before), None
        points = before.solved_cycles.section[-max(summary.period, 1):]
        if not summary.period:
            many = SECTION_CYCLES // (QUICK_SHARE if options.quick else 1)
            further = solve(system, cycles=many, start_cycle=RUN_IN, state=before.final).raise_for_status()
            points = further.solved_cycles.section[1:]
            if options.law == "smoothed":
                exponent = largest_lyapunov_exponent(system, before.final, cycles=many, start_cycle=RUN_IN)
        panels.append(results.Labelled(
            label=series.label, values=series.values, period=summary.period, section=points[:, 1:], lyapunov=exponent,
            t=_time(after), slip_speed=after.slip_speed, plate_angle=after.plate_angle))
    return results.Numbers(panels=panels)


def _delay(row: PaperFigure, options: FigureOptions) -> results.Numbers:
    """Compute Fig. 9: torque and slip over two cycles, and the part of positive slip in the first half cycle."""
    panels = []
    for series in row.series:
        _, after = _run_in(series_system(series, options), 2)
        panels.append(results.Labelled(
            label=series.label, values=series.values, first_half=first_half(after), t=_time(after),
            slip_speed=after.slip_speed, engine_torque=after.engine_torque, state=after.state))
    return results.Numbers(panels=panels)


def _actuation(row: PaperFigure, options: FigureOptions) -> results.Numbers:
    """Compute Fig. 12."""
    panels = []
    for series in row.series:
        before, after = _run_in(series_system(series, options), 9)
        found = summarise(before)
        orbit = orbit_behind(series_system(series, options), before.final, RUN_IN, found.period,
                             found.max_slip_speed) if options.branches else None
        panels.append(results.Labelled(
            label=series.label, values=series.values, period=found.period, t=_time(after), orbit=orbit,
            slip_speed=after.slip_speed, saturation_torque=after.saturation_torque, engine_torque=after.engine_torque))
    return results.Numbers(panels=panels)


def _solvers(row: PaperFigure, options: FigureOptions) -> results.Numbers:
    """Compute Fig. 2: cycles by each solver from the steady motion of law (7), and steady motions from (13)."""
    system = paper_system(row.series[0].values)
    begin = QUICK_STEADY_CYCLES if options.quick else STEADY_CYCLES
    steady = []
    for label, values in STEADY_LAWS:
        before, after = _run_in(replace(system, values), 4, begin, SAMPLES // 2)
        found = summarise(before, begin - 100)
        steady.append(results.Labelled(
            label=label, values=values, period=found.period, settled=found.settled, final=before.final.numbers,
            max_slip_speed=found.max_slip_speed, t=_time(after), slip_speed=after.slip_speed))
    start = State(*steady[0].final)
    curves: list[results.Labelled] = []
    for solver, (label, law, setting) in SOLVER_CURVES.items():
        begun = time.perf_counter()
        run = solve(replace(system, {"friction.law": law}), cycles=1 if options.quick else 2, samples_per_cycle=SAMPLES,
                    start_cycle=begin, state=start, solver=solver, rtol=setting.get("rtol"), step=setting.get("step"))
        seconds, reference = time.perf_counter() - begun, curves[0].slip_speed if curves else run.slip_speed
        apart = np.nan if len(run.t) != len(reference) else float(
            np.sqrt(np.mean((run.slip_speed - reference) ** 2)) / np.abs(reference).max())
        curves.append(results.Labelled(
            solver=solver, label=label, status=run.status.value, seconds=seconds, t=_time(run),
            slip_speed=run.slip_speed, friction_torque=run.friction_torque, rms_difference=apart))
    return results.Numbers(cycle=system.cycle, curves=curves, steady=steady, steady_cycles=begin)


KINDS: dict[str, Callable[[PaperFigure, FigureOptions], Any]] = {
    "map": _map, "damping": _damping, "orbit": _orbit, "histories": _histories,
    "delay": _delay, "actuation": _actuation, "law": _law,
    "solvers": _solvers}
