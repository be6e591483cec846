"""Every engine on stiff and extreme scenes, error charts of the fixed-step methods, and the tables of their report.

A run must be bounded: with E = I1 theta1'^2/2 + I2 theta2'^2/2 + K23 theta2^2/2, friction and damper only take energy,
so d sqrt(E)/dt <= max|Te|/sqrt(2 I1) and sqrt(E(t)) <= sqrt(E(0)) + t max|Te|/sqrt(2 I1) for any friction
law.

The charts are over (step, sigma), (step, mu_s/mu_k) and (step, pressure), with the theoretical limits, for three
methods: `fixed_step` with its own sub-steps inside a tick, its SDIRK3 scheme with one step per tick, which shows where
sub-steps are needed, and classical Runge-Kutta for contrast. Further charts for both engines are over the same keys
and the tolerance, for `event_driven` without sigma.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tcc_sim.errors import InputError, OutOfRange, counted
from tcc_sim.model.friction import smoothed_and_slope
from tcc_sim.model.parameters import DEFAULTS, System, replace
from tcc_sim.output.tables import markdown_table
from tcc_sim.result import reported
from tcc_sim.solvers import SOLVERS, Status, solve
from tcc_sim.solvers.explicit import rk4_limit
from tcc_sim.solvers.fixed_step import advance
from tcc_sim.solvers.terms import peak_load, substeps, terms_of
from tcc_sim.study.benchmarks.references import Floats, Reference, Unfinished, errors, final_state, reference
from tcc_sim.trajectory import State, Trajectory, integral

Keys = dict[str, Any]
ENGINES = {"smoothed": ("smoothed", None), "event_driven": ("set_valued", None), "fixed_step": ("smoothed", 1e-3)}
"""Friction law and step, s, of each engine."""
MANY = 300
"""Number of engine cycles of the long cases."""
BASE: Keys = {"initial.slip_speed": 5.0}
"""Initial values of every case that differ from the defaults, so that stick begins within the horizon."""
CYCLES, RADIANS = 2, 30.0
"""Least horizon of a case, and horizon of the charts: engine cycles, and phase of the natural frequency."""
REFERENCE_RADIANS = 60.0
"""Longest horizon of the comparison with a reference, in phase of the natural frequency."""
PHASE = 0.008
"""Phase of the natural frequency between two samples of the power balance, rad."""
SAMPLES_PER_STOP = 20.0
"""Number of samples of the power balance before the first slip stops, as far as memory allows."""
SHARPEST = 1e5
"""Smoothing, s/rad, above which the reference solves the set-valued law; the laws differ by about 1/sigma."""
SLACK = 1e-3
"""Allowed relative excess over the energy bound, for the error of the method."""

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
CRITICAL = 2.0 * math.sqrt(3000.0 * 0.02)
"""C23 of an aperiodic plate, N m s/rad."""
RANGES: dict[str, tuple[Any, ...]] = {
    "friction.kinetic_coefficient": (0.3, 0.285, 0.24, 0.2, 0.15, 0.1, 0.075),
    "friction.decay": (2.0, 0.0, 50.0, 1000.0),
    "friction.smoothing": (50.0, 1.0, 10.0, 1e3, 1e4, 1e5, 1e6, 1e9),
    "pressure.mean": (0.0, 1e2, 1e4, 225e3, 1e6, 1e7),
    "share": (0.0, 0.2, 0.9, 0.999, 1.0, 1.5),
    "engine.frequency": (1.0, 20.0, 116.77, 150.0, 387.3, 1000.0, 5000.0),
    "driveline.damping": (0.0, 0.6, CRITICAL, 50.0, 1e3),
    "driveline.flywheel_inertia": (0.2, 1e-4, 1e-2, 10.0, 1e3),
    "driveline.stiffness": (3000.0, 1.0, 1e5, 1e8),
    "driveline.plate_inertia": (0.02, 1e-3, 1e-4, 1e-6, 1.0, 100.0),
    "initial.slip_speed": (0.0, 1e-9, 5.0, -5.0, 1e4),
    "engine.mean_torque": (300.0, 0.0, -300.0),
    "engine.torque_amplitude": (250.0, 0.0, 1000.0),
    "pressure.frequency_ratio": (1.0, 0.5, 2.0 / 3.0, 2.0, GOLDEN, math.sqrt(2.0), 1e-3, 0.01, 100.0),
    "pressure.phase": (0.0, math.pi / 2.0, math.pi)}
"""Values of each key, used alone and in combinations; `share` is Tsp/Tsm."""
PAIRS = (("friction.kinetic_coefficient", "friction.smoothing"), ("friction.kinetic_coefficient", "share"),
         ("friction.kinetic_coefficient", "pressure.mean"), ("friction.smoothing", "initial.slip_speed"))
LONGEST = 3000.0
"""Phase of the natural frequency in a cycle, rad, above which values are not combined: a cycle would take too long."""
RUN = ("cycles", "tick")
"""Keys of a case that are not scene keys: number of engine cycles, and step of fixed_step, s."""


COUNT, QUICK_COUNT = 420, 36
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


def extreme_cases(count: int, seed: int = 1) -> list[Keys]:
    """Return `count` different cases as changes of the defaults: every value alone, near-grazing motions, steps of the
    commands, many cycles, coarse ticks, pairs, then random draws.
    """
    cases: list[Keys] = [{}]
    cases += [{key: value} for key, values in RANGES.items() for value in values]
    cases += [*grazing(), *command_steps(), *long_and_coarse()]
    cases += [{one: a, two: b} for one, two in PAIRS for a in RANGES[one] for b in RANGES[two]]
    draw = np.random.default_rng(seed)
    if count < len(cases):
        cases = [cases[i] for i in sorted(draw.permutation(len(cases))[:count].tolist())]
    out: dict[str, Keys] = {}
    while len(out) < count:
        keys = cases.pop(0) if cases else {k: v[int(draw.integers(len(v)))] for k,
                                           v in RANGES.items() if draw.random() < 0.5}
        merged = case_of(keys)
        system = replace(System(), scene_keys(merged))
        if system.natural_frequency * system.cycle > LONGEST:
            continue
        out.setdefault(repr(sorted(merged.items())), merged)
    return list(out.values())


def scene_keys(keys: Keys) -> Keys:
    """Return the scene keys of a case."""
    return {key: value for key, value in keys.items() if key not in RUN}


def command_steps() -> list[Keys]:
    """Return motions after a step of pressure or engine torque, from stick and from slip at the static twist."""
    twist = {"stick": 300.0 / 3000.0, "slip": 500.0 / 3000.0}
    states = [{"initial.slip_speed": 0.0, "initial.plate_angle": twist["stick"]},
              {"initial.slip_speed": 80.0, "initial.plate_angle": twist["slip"]}]
    commands: list[Keys] = [
        {"pressure.mean": 0.0}, {"pressure.mean": 1e4}, {"pressure.mean": 1e7}, {"engine.mean_torque": -1000.0},
        {"engine.mean_torque": 5000.0}, {"engine.mean_torque": 0.0, "engine.torque_amplitude": 0.0}]
    return [{**state, **command} for state in states for command in commands]


def long_and_coarse() -> list[Keys]:
    """Return cases with many cycles, and with ticks of a tenth of a cycle to a whole cycle."""
    many = [{}, {"friction.kinetic_coefficient": 0.15}, {"friction.kinetic_coefficient": 0.3, "share": 0.0},
            {"share": 1.5}, {"friction.smoothing": 1e6}, {"pressure.frequency_ratio": GOLDEN}]
    coarse = [{"tick": 5e-3}, {"tick": 1e-2}, {"tick": 1e-2, "friction.kinetic_coefficient": 0.15},
              {"tick": 5e-2, "engine.frequency": 20.0}, {"tick": 0.1, "engine.frequency": 1.0},
              {"tick": 1.0, "engine.frequency": 1.0, "pressure.mean": 1e3}]
    return [*({**keys, "cycles": MANY} for keys in many), *coarse]


def case_of(keys: Keys) -> Keys:
    """Return the scene keys, with a pressure amplitude in place of `share`."""
    out = {**BASE, **keys}
    share = out.pop("share", 0.2)
    out["pressure.amplitude"] = min(share * out.get("pressure.mean", System().pressure.mean), 1e7)
    return out


def grazing() -> list[Keys]:
    """Return undamped stuck motions whose largest interface torque is close to the breakaway torque."""
    gain = 3000.0 - 0.02 * 60.0**2, 3000.0 - 0.22 * 60.0**2
    reach = 300.0 + 100.0 * gain[0] / gain[1]
    start = {"initial.slip_speed": 0.0, "initial.plate_angle": 0.1, "initial.plate_speed": 6000.0 / gain[1],
             "share": 0.0, "driveline.damping": 0.0, "engine.torque_amplitude": 100.0, "engine.frequency": 60.0}
    return [{**start, "friction.kinetic_coefficient": 0.3 / ratio, "pressure.mean": reach * (1.0 - share) / 0.0024}
            for ratio in (1.0, 1.25) for share in (-1e-3, -1e-6, 1e-9, 1e-6, 1e-3, 1e-2)]


@dataclass(frozen=True)
class Examined:
    """Results of one engine on one case in stability.json; None if a refused or stopped run has none."""

    keys: Mapping[str, Any] = field(metadata=reported(
        "scene keys that differ from `scene`, periods of excitation and friction law", "{*}", spread=True))
    solver: str = field(metadata=reported("name of the solver"))
    step: float | None = field(metadata=reported("step; null for an engine that chooses its own", "s"))
    status: str = field(default="REFUSED", metadata=reported("how the solver ended"))
    why: str = field(default="", metadata=reported("reason of a refusal or stop, or of a missing reference"))
    finite: bool | None = field(default=None, metadata=reported("whether the states are finite"))
    bounded: bool | None = field(default=None, metadata=reported("whether they stay below the energy bound"))
    error: float | None = field(default=None, metadata=reported(
        "error of the final state, relative to each signal's maximum"))
    iterations_max: int | None = field(default=None, metadata=reported("most iterations in a stage"))
    iterations_bound: int | None = field(default=None, metadata=reported("its bound"))
    power_residual: float | None = field(default=None, metadata=reported("residual of the power balance"))
    seconds: float = field(default=0.0, metadata=reported("computing time", "s"))


def examine(keys: Keys, engine: str, truth: Truth) -> Examined:
    """Solve one case with one engine.

    Parameters
    ----------
    keys : scene keys that differ from the defaults, and keys of RUN
    truth : the reference for these keys and the law of the engine
    """
    law, step = ENGINES[engine]
    step = keys.get("tick", step) if step is not None else None
    keys, cycles = scene_keys(keys), keys.get("cycles", CYCLES)

    def refused(why: str) -> Examined:
        return Examined({**keys, "cycles": cycles, "friction.law": law}, engine, step, why=why)

    try:
        system = replace(System(), {**keys, "friction.law": law})
        radians = system.natural_frequency * system.cycle
        samples = max(radians / PHASE, SAMPLES_PER_STOP * system.cycle / _stopping_time(system), 64.0)
        if step is not None:
            step = system.cycle / math.ceil(system.cycle / step)
        cycles = max(cycles, math.ceil(RADIANS / radians))
        run = solve(system, cycles=cycles, solver=engine, step=step, samples_per_cycle=int(min(samples, 200_000.0)))
        if truth.why == "":
            short = solve(system, duration=truth.duration, solver=engine, step=step)
    except InputError as error:
        return refused(str(error))
    if run.status is Status.REFUSED:
        return refused(run.detail)
    solution = run
    if step is not None:  # Every sub-step of fixed_step; samples between sub-steps would be interpolated.
        solution = solve(system, cycles=CYCLES, solver=engine, step=step, samples_per_cycle=min(
            round(system.cycle / step) * substeps(terms_of(system), step), 1_000_000))
    whole, off = finite(run) and finite(solution), None
    if truth.why == "" and short.status is Status.DONE:
        state = np.array([short.slip_speed[-1], short.plate_angle[-1], short.plate_speed[-1]])
        off = float((np.abs(state - truth.state) / truth.scale).max())
    return Examined({**keys, "cycles": cycles, "friction.law": law}, engine, step, run.status.name,
                    (run.detail if run.status is not Status.DONE else "") or truth.why, whole,
                    energy_excess(solution) <= SLACK if whole else None, off, run.statistics.iterations_max,
                    run.statistics.iterations_bound, power_residual(run) if whole else None, run.statistics.seconds)


def finite(run: Trajectory) -> bool:
    """Return whether all arrays of a run are finite."""
    arrays = [run.slip_speed, run.plate_angle, run.plate_speed, run.friction_torque]
    if run.cycles is not None:
        arrays += [run.cycles.section, run.cycles.highest, run.cycles.lowest, run.cycles.stick_time]
    return all(bool(np.isfinite(a).all()) for a in arrays)


def energy(run: Trajectory) -> Floats:
    """Return kinetic and spring energy at every sample, J."""
    d = _system(run).driveline
    flywheel = run.slip_speed + run.plate_speed
    stored: Floats = 0.5 * (d.flywheel_inertia * flywheel**2 + d.plate_inertia * run.plate_speed**2
                            + d.stiffness * run.plate_angle**2)
    return stored


def energy_excess(run: Trajectory) -> float:
    """Return the excess of sqrt(E) over its bound, relative to the bound; at most 0 for an exact solution."""
    system = _system(run)
    torque = abs(system.engine.mean_torque) + system.engine.torque_amplitude + sum(system.engine.harmonic_amplitudes)
    root = np.sqrt(energy(run))
    bound = root[0] + torque * (run.t - run.t[0]) / math.sqrt(2.0 * system.driveline.flywheel_inertia)
    return float((root / np.maximum(bound, 1e-300)).max()) - 1.0 if bound[-1] > 0.0 else float(root.max())


def power_residual(run: Trajectory) -> float | None:
    """Return the residual of the power balance: engine work minus losses and stored energy per cycle, relative.

    The trapezoidal rule over samples at most PHASE apart has an error of about 1e-5. Samples of fixed_step are
    interpolated between its sub-steps, which increases the residual if slip stops within a sub-step.
    Returns None if the run has no whole cycle.
    """
    system = _system(run)
    flywheel = run.slip_speed + run.plate_speed
    supply = run.engine_torque * flywheel
    losses = run.friction_torque * run.slip_speed + system.driveline.damping * run.plate_speed**2
    stored = energy(run)
    per_cycle = max(round(system.cycle / float(run.t[1] - run.t[0])), 1)
    marks = np.arange(0, len(run.t), per_cycle)
    if len(marks) < 2:
        return None

    def work(power: Floats) -> Floats:
        return np.diff(integral(power, run.t)[marks])

    residual = np.abs(work(supply - losses) - np.diff(stored[marks]))
    scale = max(float(stored.max()), float(work(np.abs(supply)).max()), 1e-300)
    return float(residual.max()) / scale


class Truth:
    """Final state of a reference over a short horizon, and each signal's size; `why` explains a missing reference."""

    def __init__(self, keys: Keys, law: str) -> None:
        sharp = law == "smoothed" and keys.get("friction.smoothing", 50.0) > SHARPEST
        self.why, self.state, self.scale, self.duration = "", np.zeros(3), np.ones(3), 0.0
        try:
            system = replace(System(), {**scene_keys(keys), "friction.law": "set_valued" if sharp else law})
            self.duration = min(CYCLES * system.cycle, REFERENCE_RADIANS / system.natural_frequency)
            method, rtol = ("LSODA", 1e-11) if system.friction.law == "smoothed" else ("DOP853", 1e-12)
            self.state, largest = final_state(system, self.duration, method, rtol)
        except Unfinished as error:
            self.why = f"no reference: {error}"
            return
        floor = np.array([1e-6 * max(float(largest[2]), 1e-6), 1e-12, 1e-9])
        self.scale = np.maximum(largest, floor)


def _stopping_time(system: System) -> float:
    """Return the least time to stop the initial slip, s: |v|/(beta r Ts); inf for negligible slip."""
    load = system.saturation_mean + system.saturation_amplitude
    slip = abs(system.initial.slip_speed)
    return slip / max(system.inverse_inertia * system.friction_ratio * load, 1e-12) if slip > 0.1 else math.inf


def _system(run: Trajectory) -> System:
    """Return the system that a run solved."""
    if run.system is None:
        raise ValueError("the run has no system")
    return run.system


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


def stability_tables(report: StabilityReport) -> str:
    """Return the tables of a report: a summary by engine, refused and failed runs, and the largest errors."""
    def four(values: Quantiles) -> str:
        return " / ".join("-" if x is None else f"{x:.0e}" for x in vars(values).values())

    shown: tuple[tuple[str, Callable[[EngineSummary], Any]], ...] = (
        ("runs", lambda s: s.cases), ("ended", lambda s: ", ".join(f"{k} {v}" for k, v in s.statuses.items())),
        ("not finite", lambda s: s.not_finite), ("above the energy bound", lambda s: s.not_bounded),
        ("most iterations of one solve", lambda s: s.iterations_max), ("their bound", lambda s: s.iterations_bound),
        ("error: median / 90 % / 99 % / largest", lambda s: four(s.error)),
        ("power residual: the same", lambda s: four(s.power_residual)),
        ("without a reference", lambda s: s.without_reference),
        ("longest solve (s)", lambda s: f"{s.longest_seconds:.2g}"))
    rows = [[name, *(str(show(report.summary[engine])) for engine in ENGINES)] for name, show in shown]
    lines = [*["**Interrupted: this report is not complete.**", ""] * (not report.complete),
             *markdown_table(["", *(f"`{engine}`" for engine in ENGINES)], rows, "---:", "---"), ""]
    failed = [r for r in report.cases if ended_badly(r)]
    for engine in ENGINES:
        if refused := [r.why for r in report.cases if r.solver == engine and r.status == "REFUSED"]:
            lines += [f"`{engine}` refused {counted(len(refused), 'run')}, for example: {refused[0]}.", ""]
    worst = [r for engine in ENGINES for r in sorted((r for r in report.cases if r.solver == engine and r.error),
                                                     key=lambda r: -(r.error or 0.0))[:5]]
    for head, chosen in (("failed", failed), ("error", worst)):
        lines += [*markdown_table(["solver", head, "scene"], [
            [f"`{r.solver}`", f"{r.error:.1e}" if head == "error" else f"{r.status} {r.why}".strip(),
             ", ".join(f"{k} {v!r}" for k, v in changes(r).items())] for r in chosen]), ""]
    return "\n".join(lines)


def _quantiles(values: Iterable[float | None]) -> Quantiles:
    """Return the quantiles of the values that are not None."""
    known = [v for v in values if v is not None]
    return Quantiles(*(float(np.quantile(known, q)) if known else None for q in (0.5, 0.9, 0.99, 1.0)))
