"""The stability report: every engine on the extreme scenes, error charts of the fixed-step methods, and the page.

The charts are over (step, sigma), (step, mu_s/mu_k) and (step, pressure), with the theoretical limits, for three
methods: `fixed_step` with its own sub-steps inside a tick, its SDIRK3 scheme with one step per tick, which shows where
sub-steps are needed, and classical Runge-Kutta for contrast. Further charts for both engines are over the same keys
and the tolerance, for `event_driven` without sigma.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, field
from typing import Any

import numpy as np

from tcc_sim.errors import OutOfRange, counted
from tcc_sim.model.friction import smoothed_and_slope
from tcc_sim.model.parameters import DEFAULTS, System, replace
from tcc_sim.output.tables import markdown_table
from tcc_sim.result import reported
from tcc_sim.solvers import SOLVERS, Status, solve
from tcc_sim.solvers.comparison.runge_kutta import rk4_limit
from tcc_sim.solvers.fixed_step import advance
from tcc_sim.solvers.terms import peak_load, terms_of
from tcc_sim.study.benchmarks.extremes import ENGINES, MANY, SHARPEST, Examined, Truth, examine, extreme_cases
from tcc_sim.study.benchmarks.references import Reference, Unfinished, errors, reference
from tcc_sim.trajectory import State

COUNT, QUICK_COUNT = 420, 36
CYCLES = 2
SCENE: dict[str, Any] = {"friction.kinetic_coefficient": 0.24, "engine.mean_torque": 100.0,
                         "engine.torque_amplitude": 400.0, "initial.slip_speed": 5.0}
"""Initial values of the charts that differ from the defaults: they give stick-slip at every value of the keys."""
OVER = {"friction.smoothing": np.geomspace(50.0, 1e9, 12),
        "friction.kinetic_coefficient": 0.3 / np.linspace(1.0, 4.0, 13),
        "pressure.mean": np.geomspace(1e4, 1e7, 13)}
METHODS = {"fixed_step": np.geomspace(1e-5, 1e-2, 13), "SDIRK3, one step": np.geomspace(1e-6, 1e-2, 13),
           "rk4": np.geomspace(1e-7, 1e-3, 13), "smoothed": np.geomspace(1e-9, 1e-3, 7),
           "event_driven": np.geomspace(1e-9, 1e-3, 7)}
"""Steps of each method, s, or tolerances of an adaptive engine."""


@dataclass(frozen=True)
class Quantiles:
    """Median, 90th and 99th percentile and largest value; None without values."""

    median: float | None = field(metadata=reported("median; null without values"))
    p90: float | None = field(metadata=reported("90th percentile"))
    p99: float | None = field(metadata=reported("99th percentile"))
    max: float | None = field(metadata=reported("largest value"))


@dataclass(frozen=True)
class EngineSummary:
    """Statuses of one engine's cases, violations of the criteria, quantiles of error and power residual."""

    cases: int = field(metadata=reported("number of cases"))
    statuses: Mapping[str, int] = field(metadata=reported("number of cases by status"))
    not_finite: int = field(metadata=reported("number of runs that are not finite"))
    not_bounded: int = field(metadata=reported("number of runs above the energy bound"))
    iterations_max: int = field(metadata=reported("most iterations in a stage"))
    iterations_bound: int = field(metadata=reported("largest bound of iterations"))
    past_iteration_bound: int = field(metadata=reported("number of runs above the bound of iterations"))
    without_reference: int = field(metadata=reported("number of runs without a reference"))
    error: Quantiles = field(metadata=reported("error of the final state, relative to each signal's maximum"))
    power_residual: Quantiles = field(metadata=reported("residual of the power balance"))
    longest_seconds: float = field(metadata=reported("longest run time", "s"))


@dataclass(frozen=True)
class ErrorChart:
    """Errors of one method over one key and its steps, s: rows are values, None where not finite."""

    over: str = field(metadata=reported("scene key"))
    values: Sequence[float] = field(metadata=reported("its values", "{over}"))
    method: str = field(metadata=reported("name of the method"))
    steps: Sequence[float] = field(metadata=reported("steps", "s"))
    errors: Sequence[Sequence[float | None]] = field(metadata=reported(
        "errors: rows are values; null where not finite"))
    limits: Mapping[str, Sequence[float | None]] = field(metadata=reported(
        "theoretical limits of the step at every value, by name", "s"))


@dataclass(frozen=True)
class StabilityReport:
    """Contents of stability.json."""

    cases: Sequence[Examined] = field(metadata=reported("every case with every engine"))
    summary: Mapping[str, EngineSummary] = field(metadata=reported("by engine"))
    charts: Sequence[ErrorChart] = field(metadata=reported("errors over step and a key"))
    quick: bool = field(metadata=reported("whether there were fewer scenes and coarser charts"))
    complete: bool = field(metadata=reported("false where it was interrupted"))
    reasons: Sequence[str] = field(default=(), metadata=reported("sentences on the largest errors"))


def grid(quick: bool, done: Callable[[int, int, str], None]) -> Iterator[Examined]:
    """Yield the record of every extreme case with every engine for stability.json.

    Parameters
    ----------
    done : function called with the numbers of finished and of all cases, and the next step
    """
    chosen = extreme_cases(QUICK_COUNT if quick else COUNT)
    for count, keys in enumerate(chosen):
        done(count, len(chosen), "extreme scenes")
        truths = {law: Truth(keys, law) for law in dict.fromkeys(law for law, _ in ENGINES.values())}
        for engine, (law, _) in ENGINES.items():
            yield examine(keys, engine, truths[law])


def engine_summaries(records: Sequence[Examined]) -> dict[str, EngineSummary]:
    """Return the summary of the cases of each engine."""
    out = {}
    for engine in ENGINES:
        rows = [r for r in records if r.solver == engine]
        ran = [r for r in rows if r.status != "REFUSED"]
        iterations = [(r.iterations_max or 0, r.iterations_bound or 0) for r in ran]
        out[engine] = EngineSummary(
            len(rows), Counter(r.status for r in rows), sum(r.finite is False for r in ran),
            sum(r.bounded is False for r in ran), max((most for most, _ in iterations), default=0),
            max((bound for _, bound in iterations), default=0), sum(most > bound > 0 for most, bound in iterations),
            sum(r.error is None for r in ran), _quantiles([r.error for r in ran]),
            _quantiles([r.power_residual for r in ran]), max((r.seconds for r in ran), default=0.0))
    return out


def error_charts(quick: bool, done: Callable[[str], None]) -> list[ErrorChart]:
    """Return an error chart for each key and method."""
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
            pairs = list(zip(systems, truths))
            if method == "event_driven":
                if key == "friction.smoothing":
                    continue
                exact = [replace(s, {"friction.law": "set_valued"}) for s in systems]
                pairs = [(s, _truth(s)) for s in exact]
            rows = [[_error(system, method, float(h), truth) for h in steps] for system, truth in pairs]
            out.append(ErrorChart(key, chosen.tolist(), method, steps.tolist(), rows, {
                "rk4": [rk4_limit(s) for s in systems], "uniqueness": [uniqueness_limit(s) for s in systems]}))
    return out


def uniqueness_limit(system: System) -> float | None:
    """Return the step, s, below which v + a mubar(v) = w has one root: 1/(beta Ts |min d(mubar)/dv|); None for any.

    A stage of SDIRK3 has a = gamma h beta Ts, so its limit is 1/gamma = 2.29 times as large.
    """
    terms = terms_of(system)
    if terms.stribeck is None:
        return None
    v = np.geomspace(1e-3, 1e4, 20001) / system.friction.smoothing
    v = np.union1d(v, np.linspace(0.0, 5.0 / system.friction.decay, 20001))
    _, slope = smoothed_and_slope(v, system.friction.smoothing, terms.stribeck)
    return float(1.0 / (system.inverse_inertia * peak_load(terms) * -slope.min()))


def _truth(system: System) -> Reference | None:
    """Solve with SciPy's LSODA, or the set-valued law if the smoothing is too sharp; None if SciPy fails."""
    sharp = system.friction.smoothing > SHARPEST or system.friction.law == "set_valued"
    try:
        if sharp:
            return reference(replace(system, {"friction.law": "set_valued"}), CYCLES, "DOP853", 1e-11)
        return reference(system, CYCLES, "LSODA", 1e-10)
    except Unfinished:
        return None


def _error(system: System, method: str, step: float, truth: Reference | None) -> float | None:
    """Return the section error relative to each signal's maximum; None after a failure or without a reference."""
    if truth is None:
        return None
    if method == "SDIRK3, one step":
        section = one_step(system, step)
    else:
        try:
            run = solve(system, cycles=CYCLES, solver=method, **{SOLVERS[method].setting: step})  # type: ignore[arg-type]
        except OutOfRange:
            return None
        if run.cycles is None or run.status is not Status.DONE:
            return None
        section = run.cycles.section
    with np.errstate(all="ignore"):
        error = errors(section, truth.largest, truth)[1]
    return error if math.isfinite(error) else None


def one_step(system: System, step: float) -> Any:
    """Return sections of SDIRK3 with equal steps of at most `step` and no sub-steps."""
    terms, cycle = terms_of(system), system.cycle
    count = max(math.ceil(cycle / step - 1e-9), 1)
    state = np.array(State.at_start(system).numbers)
    section = [state.copy()]
    for n in range(CYCLES):
        advance(state, n * cycle, cycle / count, count, terms, None, None)
        section.append(state.copy())
    return np.array(section)


def changes(record: Examined) -> dict[str, Any]:
    """Return the differences of a case from the defaults: scene keys, more cycles than usual, a coarser tick."""
    out = {k: v for k, v in record.keys.items() if k in DEFAULTS and k != "friction.law" and DEFAULTS[k] != v}
    if record.keys["cycles"] == MANY:
        out["cycles"] = MANY
    if (record.step or 0.0) > (ENGINES[record.solver][1] or math.inf):
        out["tick"] = record.step
    return out


def ended_badly(record: Examined) -> bool:
    """Return whether a run was stopped, is not finite, or exceeded its energy or iteration bound."""
    stopped = record.status not in ("DONE", "REFUSED")
    return bool(stopped or record.finite is False or record.bounded is False
                or (record.iterations_max or 0) > (record.iterations_bound or math.inf))


def stability_page(report: StabilityReport, picture: str) -> str:
    """Return the page: results, criteria, summary, failed and refused runs, and the largest errors."""
    cases, total = report.cases, report.summary
    lines = [
        "# Stiff and extreme cases", "", *_head(report), "", f"![error charts and extreme cases]({picture})", "",
        f"{len(cases)} runs: {len(cases) // len(ENGINES)} cases with each of "
        f"{', '.join(map(_code, ENGINES))} (1 ms ticks). mu_s/mu_k 1 to 4, alpha 0 to 1000 s/rad, sigma 1 to 1e9 s/rad,"
        " Tsp/Tsm 0 to 1.5 (the pressure clamped at 0), omega 1 to 5000 rad/s, omega_f/omega 1e-3 to 100 and "
        "incommensurable, mean pressure 0 to 10 MPa, C23 0 to 65 times critical, K23 1 to 1e8 N m/rad, I1 1e-4 to 1000 "
        "and I2 1e-6 to 100 kg m^2, initial slip 0 to 1e4 rad/s, near-grazing undamped stick, steps of pressure and "
        f"torque commands in stick and in slip, {MANY} cycles, ticks of 5 ms to 1 s, and combinations.", "",
        "Bounded: sqrt(E(t)) <= sqrt(E(0)) + t max|Te|/sqrt(2 I1), since friction and damper only take energy. Power: "
        "engine work less losses and stored energy in each cycle, relative to the largest of work and energy; its "
        "quadrature is good to about 1e-5; `fixed_step` is interpolated between its sub-steps, which shows where slip "
        "stops within one. Error: state after at most 60 rad of the natural "
        "frequency, relative to each signal's maximum, against SciPy (LSODA for the smoothed law, DOP853 from event to "
        "event for the set-valued one). Above sigma = 1e5 s/rad the smoothed law is held against the set-valued one, "
        "from which it differs by about 1/sigma.", "",
        *markdown_table(["", *map(_code, ENGINES)], [[name, *(show(total[engine]) for engine in ENGINES)]
                                                     for name, show in _ROWS], "---:", "---")]
    lines += ["", "## Failed runs", "", *listed(r for r in cases if ended_badly(r)), "", "## Refused", ""]
    refused = [r for r in cases if r.status == "REFUSED"]
    lines += [f"- `{engine}`: {len(whys)}, such as: {whys[0]}" for engine in ENGINES
              if (whys := [r.why for r in refused if r.solver == engine])] or ["None."]
    worst = [row for engine in ENGINES
             for row in sorted(((r.error, r) for r in cases if r.solver == engine and r.error is not None),
                               key=lambda row: -row[0])[:5]]
    lines += ["", "## Largest errors", "", *markdown_table(
        ["solver", "error", "scene"], [[_code(r.solver), f"{error:.1e}", _scene(r)] for error, r in worst])]
    if report.reasons:
        lines += ["", "## Why the largest are so large", "", *(f"- {reason}" for reason in report.reasons)]
    if not report.complete:
        lines += ["", "**Interrupted: this report is not complete.**"]
    return "\n".join(lines) + "\n"


def _head(report: StabilityReport) -> list[str]:
    """Return the results in sentences."""
    cases = report.cases
    said = ["This page is generated: `tcc-sim stability" + (" --quick" if report.quick else "") + "` writes it.", ""]
    for engine in ENGINES:
        rows = [r for r in cases if r.solver == engine]
        bad, refused = sum(map(ended_badly, rows)), sum(r.status == "REFUSED" for r in rows)
        error, power = report.summary[engine].error, report.summary[engine].power_residual
        said.append(f"- `{engine}`: of {counted(len(rows), 'case')} {bad or 'none'} failed and {refused or 'none'} "
                    f"{'was' if refused == 1 else 'were'} refused; in 99 % of the others the error is at most "
                    f"{_number(error.p99)}, the largest {_number(error.max)}, and the power balance closes to "
                    f"{_number(power.p99)}.")
    return said


def listed(records: Iterable[Examined]) -> list[str]:
    """Return a line for each record: solver, status, reason and exact scene."""
    return [f"- `{r.solver}`, {r.status}{': ' + r.why if r.why else ''}: {_scene(r)}"
            for r in records] or ["None."]


def _scene(record: Examined) -> str:
    """Return the differences from the defaults with all digits."""
    return ", ".join(f"{k} {v!r}" for k, v in changes(record).items())


def _number(value: float | None) -> str:
    """Return a number with one digit."""
    return "-" if value is None else f"{value:.0e}"


def _quantiles(values: Sequence[float | None]) -> Quantiles:
    """Return the quantiles of the values that are not None."""
    known = [v for v in values if v is not None]
    return Quantiles(*(float(np.quantile(known, q)) if known else None for q in (0.5, 0.9, 0.99, 1.0)))


def _code(name: str) -> str:
    """Return a name as code."""
    return f"`{name}`"


def _four(quantiles: Quantiles) -> str:
    """Return median, percentiles and largest value in one cell."""
    return " / ".join(map(_number, astuple(quantiles)))


_ROWS: tuple[tuple[str, Callable[[EngineSummary], str]], ...] = (
    ("runs", lambda s: str(s.cases)),
    ("ended", lambda s: ", ".join(f"{k} {v}" for k, v in s.statuses.items())),
    ("not finite", lambda s: str(s.not_finite)),
    ("above the energy bound", lambda s: str(s.not_bounded)),
    ("most iterations of one solve (bound)",
     lambda s: f"{s.iterations_max} ({s.iterations_bound})" if s.iterations_bound else "none"),
    ("error: median / 90 % / 99 % / largest", lambda s: _four(s.error)),
    ("power residual: the same", lambda s: _four(s.power_residual)),
    ("without a reference", lambda s: str(s.without_reference)),
    ("longest solve (s)", lambda s: f"{s.longest_seconds:.2g}"))
