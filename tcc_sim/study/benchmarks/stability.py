"""Every engine on stiff and extreme scenes: rows of stability.json, and their tables.

A run must be bounded: with E = I1 theta1'^2/2 + I2 theta2'^2/2 + K23 theta2^2/2, friction and damper only take energy,
so d sqrt(E)/dt <= max|Te|/sqrt(2 I1) and sqrt(E(t)) <= sqrt(E(0)) + t max|Te|/sqrt(2 I1) for any friction
law.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.errors import NumericalFailure
from tcc_sim.model.parameters import DEFAULTS, System, replace
from tcc_sim.output.tables import markdown_table
from tcc_sim.solvers import Status, solve
from tcc_sim.solvers.terms import substeps, terms_of
from tcc_sim.study.benchmarks.references import final_state
from tcc_sim.trajectory import Floats, Trajectory, integral

Keys = dict[str, Any]
FIELDS = {
    "cases": ("every case with every engine: scene keys that differ from `scene`, periods of excitation (`cycles`) and "
              "friction law, and the fields from `solver` on", ""),
    "quick": ("whether there were fewer scenes", ""), "complete": ("false where it was interrupted", ""),
    "summary": ("by engine the fields of SUMMARY", ""), "solver": ("name of the solver", ""),
    "step": ("null for an engine that chooses its own", "s"), "status": ("how the solver ended", ""),
    "why": ("reason of a refusal, stop or missing reference", ""), "finite": ("whether the states are finite", ""),
    "bounded": ("whether they stay below the energy bound", ""),
    "error": ("of the final state, relative to each signal's maximum", ""),
    "iterations_max": ("most iterations in a stage", ""), "iterations_bound": ("its bound", ""),
    "power_residual": ("residual of the power balance", ""), "seconds": ("computing time", "s")}
"""Meaning and unit of every field of stability.json; a refused or stopped run has null where it has no result."""
SUMMARY = {
    "cases": "number of cases", "statuses": "number of cases by status",
    "not_finite": "number of runs that are not finite", "not_bounded": "number of runs above the energy bound",
    "iterations_max": "most iterations in a stage", "iterations_bound": "largest bound of iterations",
    "without_reference": "number of runs without a reference",
    "error": "error of the final state, relative to each signal's maximum: median, 90th and 99th percentile, largest",
    "power_residual": "residual of the power balance: the same", "longest_seconds": "longest run time"}
"""Fields of the summary of an engine."""
ENGINES = {"smoothed": ("smoothed", None), "event_driven": ("set_valued", None), "fixed_step": ("smoothed", 1e-3)}
"""Friction law and step, s, of each engine."""
MANY = 300
"""Number of engine cycles of the long cases."""
BASE: Keys = {"initial.slip_speed": 5.0}
"""Initial values of every case that differ from the defaults, so that stick begins within the horizon."""
CYCLES, RADIANS = 2, 30.0
"""Least horizon of a case: engine cycles, and phase of the natural frequency."""
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
COUNT, QUICK_COUNT = 420, 16


def extreme_cases(count: int) -> list[Keys]:
    """Return `count` different cases as changes of the defaults: every value alone, near-grazing motions, steps of the
    commands, many cycles, coarse ticks, pairs, then random draws.
    """
    cases: list[Keys] = [{}, *({key: value} for key, values in RANGES.items() for value in values), *grazing(),
                         *steps_and_ticks(), *({one: a, two: b} for one, two in PAIRS for a in RANGES[one]
                                               for b in RANGES[two])]
    draw = np.random.default_rng(1)
    if count < len(cases):
        cases = [cases[i] for i in sorted(draw.permutation(len(cases))[:count].tolist())]
    out = list[Keys]()
    while len(out) < count:
        keys = cases.pop(0) if cases else {k: v[int(draw.integers(len(v)))] for k,
                                           v in RANGES.items() if draw.random() < 0.5}
        merged = case_of(keys)
        system = replace(System(), scene_keys(merged))
        if system.natural_frequency * system.cycle <= LONGEST and merged not in out:
            out.append(merged)
    return out


def scene_keys(keys: Keys) -> Keys:
    """Return the scene keys of a case."""
    return {key: value for key, value in keys.items() if key not in RUN}


def steps_and_ticks() -> list[Keys]:
    """Return motions after a step of pressure or engine torque, from stick and from slip at the static twist, cases
    with many cycles, and with ticks of a tenth of a cycle to a whole cycle.
    """
    states = [{"initial.slip_speed": 0.0, "initial.plate_angle": 300.0 / 3000.0},
              {"initial.slip_speed": 80.0, "initial.plate_angle": 500.0 / 3000.0}]
    commands: list[Keys] = [
        {"pressure.mean": 0.0}, {"pressure.mean": 1e4}, {"pressure.mean": 1e7}, {"engine.mean_torque": -1000.0},
        {"engine.mean_torque": 5000.0}, {"engine.mean_torque": 0.0, "engine.torque_amplitude": 0.0}]
    many: list[Keys] = [{}, {"friction.kinetic_coefficient": 0.15}, {"friction.kinetic_coefficient": 0.3, "share": 0.0},
                        {"share": 1.5}, {"friction.smoothing": 1e6}, {"pressure.frequency_ratio": GOLDEN}]
    coarse: list[Keys] = [{"tick": 5e-3}, {"tick": 1e-2}, {"tick": 1e-2, "friction.kinetic_coefficient": 0.15},
                          {"tick": 5e-2, "engine.frequency": 20.0}, {"tick": 0.1, "engine.frequency": 1.0},
                          {"tick": 1.0, "engine.frequency": 1.0, "pressure.mean": 1e3}]
    return [*({**state, **command} for state in states for command in commands),
            *({**keys, "cycles": MANY} for keys in many), *coarse]


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


def failed(row: Keys) -> bool:
    """Return whether a run was stopped, is not finite, or exceeded its energy or iteration bound."""
    return row["status"] not in ("DONE", "REFUSED") or row["finite"] is False or row["bounded"] is False or (
        row["iterations_max"] or 0) > (row["iterations_bound"] or math.inf)


def report_of(cases: Sequence[Keys], quick: bool, complete: bool) -> Keys:
    """Return the contents of stability.json, with the summary of every engine."""
    summary = {}
    for engine in ENGINES:
        rows = [row for row in cases if row["solver"] == engine]
        ran = [row for row in rows if row["status"] != "REFUSED"]
        error, residual = (np.quantile([row[name] for row in ran if row[name] is not None] or [math.nan],
                                       (0.5, 0.9, 0.99, 1.0)).tolist() for name in ("error", "power_residual"))
        most, bound, longest = (max((row[name] or 0 for row in ran), default=0)
                                for name in ("iterations_max", "iterations_bound", "seconds"))
        summary[engine] = dict(zip(SUMMARY, (
            len(rows), Counter(row["status"] for row in rows), *(sum(row[name] is False for row in ran)
                                                                 for name in ("finite", "bounded")),
            most, bound, sum(row["error"] is None for row in ran), error, residual, float(longest))))
    return {"cases": cases, "quick": quick, "complete": complete, "summary": summary}


def grid(quick: bool, done: Callable[[int, int, str], None]) -> Iterator[Keys]:
    """Yield the row of every extreme case with every engine; `done` takes the numbers of finished and of all cases,
    and the next step.
    """
    chosen = extreme_cases(QUICK_COUNT if quick else COUNT)
    for count, keys in enumerate(chosen):
        done(count, len(chosen), "extreme scenes")
        truths = {law: truth_of(keys, law) for law in ("smoothed", "set_valued")}
        for engine, (law, _) in ENGINES.items():
            yield examine(keys, engine, truths[law])


class Truth(NamedTuple):
    """Final state of a reference over a short horizon, s, and each signal's size; `why` it is missing."""

    duration: float = 0.0
    state: Floats = np.zeros(3)
    scale: Floats = np.ones(3)
    why: str = ""


def truth_of(keys: Keys, law: str) -> Truth:
    """Solve a case with SciPy; with the set-valued law also where the smoothing is above SHARPEST."""
    sharp = law == "smoothed" and keys.get("friction.smoothing", 50.0) > SHARPEST
    system = replace(System(), {**scene_keys(keys), "friction.law": "set_valued" if sharp else law})
    duration = min(CYCLES * system.cycle, REFERENCE_RADIANS / system.natural_frequency)
    method, rtol = ("LSODA", 1e-11) if system.friction.law == "smoothed" else ("DOP853", 1e-12)
    try:
        state, largest = final_state(system, duration, method, rtol)
    except NumericalFailure as error:
        return Truth(why=f"no reference: {error}")
    return Truth(duration, state, np.maximum(largest, [1e-6 * max(float(largest[2]), 1e-6), 1e-12, 1e-9]))


def examine(keys: Keys, engine: str, truth: Truth) -> Keys:
    """Solve one case, of scene keys and keys of RUN, with one engine; `truth` is the reference for its law."""
    law, step = ENGINES[engine]
    step = keys.get("tick", step) if step is not None else None
    system = replace(System(), {**scene_keys(keys), "friction.law": law})
    if step is not None:
        step = system.cycle / math.ceil(system.cycle / step)
    radians, slip = system.natural_frequency * system.cycle, abs(system.initial.slip_speed)
    cycles = max(keys.get("cycles", CYCLES), math.ceil(RADIANS / radians))
    samples = max(radians / PHASE, 64.0)
    if slip > 0.1:  # Slip stops after |v|/(beta r Ts) at the earliest.
        load = system.saturation_mean + system.saturation_amplitude
        stops = max(system.inverse_inertia * system.friction_ratio * load, 1e-12) / slip
        samples = max(samples, SAMPLES_PER_STOP * system.cycle * stops)
    run = solve(system, cycles=cycles, solver=engine, step=step, samples_per_cycle=int(min(samples, 200_000.0)))
    row = {**scene_keys(keys), "cycles": cycles, "friction.law": law, "solver": engine, "step": step,
           "status": run.status.name, "why": run.detail, **dict.fromkeys(
               ("finite", "bounded", "error", "iterations_max", "iterations_bound", "power_residual")), "seconds": 0.0}
    if run.status is Status.REFUSED:
        return row
    off, fine = None, run
    if not truth.why:
        short = solve(system, duration=truth.duration, solver=engine, step=step)
        if short.status is Status.DONE:
            off = float((np.abs(np.array(short.final.numbers) - truth.state) / truth.scale).max())
    if step is not None:  # Every sub-step of fixed_step; samples between sub-steps would be interpolated.
        fine = solve(system, cycles=CYCLES, solver=engine, step=step, samples_per_cycle=min(
            round(system.cycle / step) * substeps(terms_of(system), step), 1_000_000))
    whole, did = finite(run) and finite(fine), run.statistics
    return row | {
        "why": (run.detail if run.status is not Status.DONE else "") or truth.why, "finite": whole, "error": off,
        "bounded": energy_excess(system, fine) <= SLACK if whole else None, "iterations_max": did.iterations_max,
        "iterations_bound": did.iterations_bound, "seconds": did.seconds,
        "power_residual": power_residual(system, run) if whole else None}


def finite(run: Trajectory) -> bool:
    """Return whether all arrays of a run are finite."""
    arrays = [run.slip_speed, run.plate_angle, run.plate_speed, run.friction_torque]
    if run.cycles is not None:
        arrays += [run.cycles.section, run.cycles.highest, run.cycles.lowest, run.cycles.stick_time]
    return all(bool(np.isfinite(a).all()) for a in arrays)


def energy(system: System, run: Trajectory) -> Floats:
    """Return kinetic and spring energy at every sample, J."""
    d, flywheel = system.driveline, run.slip_speed + run.plate_speed
    stored: Floats = 0.5 * (d.flywheel_inertia * flywheel**2 + d.plate_inertia * run.plate_speed**2
                            + d.stiffness * run.plate_angle**2)
    return stored


def energy_excess(system: System, run: Trajectory) -> float:
    """Return the excess of sqrt(E) over its bound, relative to the bound; at most 0 for an exact solution."""
    torque = abs(system.engine.mean_torque) + system.engine.torque_amplitude + sum(system.engine.harmonic_amplitudes)
    root = np.sqrt(energy(system, run))
    bound = root[0] + torque * (run.t - run.t[0]) / math.sqrt(2.0 * system.driveline.flywheel_inertia)
    return float((root / np.maximum(bound, 1e-300)).max()) - 1.0 if bound[-1] > 0.0 else float(root.max())


def power_residual(system: System, run: Trajectory) -> float | None:
    """Return the residual of the power balance: engine work minus losses and stored energy per cycle, relative; None
    if the run has no whole cycle. The trapezoidal rule has an error of about 1e-5.
    """
    supply = run.engine_torque * (run.slip_speed + run.plate_speed)
    losses = run.friction_torque * run.slip_speed + system.driveline.damping * run.plate_speed**2
    stored = energy(system, run)
    marks = np.arange(0, len(run.t), max(round(system.cycle / float(run.t[1] - run.t[0])), 1))
    if len(marks) < 2:
        return None

    def work(power: Floats) -> Floats:
        return np.diff(integral(power, run.t)[marks])

    residual = np.abs(work(supply - losses) - np.diff(stored[marks]))
    return float(residual.max()) / max(float(stored.max()), float(work(np.abs(supply)).max()), 1e-300)


def changes(row: Keys) -> str:
    """Return the differences of a case from the defaults: scene keys, more cycles than usual, a coarser tick."""
    out = {k: v for k, v in row.items() if k in DEFAULTS and k != "friction.law" and DEFAULTS[k] != v}
    out |= {"cycles": MANY} if row["cycles"] == MANY else {}
    out |= {"tick": row["step"]} if (row["step"] or 0.0) > (ENGINES[row["solver"]][1] or math.inf) else {}
    return ", ".join(f"{key} {value:.6g}" if isinstance(value, float) else f"{key} {value}"
                     for key, value in out.items())


def stability_tables(report: Keys) -> str:
    """Return the tables of a report: a summary by engine, runs that failed, refusals, and the largest errors."""
    summary, cases = report["summary"], report["cases"]
    lines = ["**Interrupted: this report is not complete.**", ""] * (not report["complete"])
    lines += markdown_table(["", *(f"`{engine}`" for engine in summary)], [
        [meaning, *(text_of_cell(of[name]) for of in summary.values())] for name, meaning in SUMMARY.items()],
        "---:", "---")
    for head, chosen in (
            ("failed", [r for r in cases if failed(r)]), ("without a reference", [
                r for r in cases if r["status"] == "DONE" and r["error"] is None]),
            ("refused", [r for r in cases if r["status"] == "REFUSED"])):
        lines += ["", *markdown_table(["solver", head, "scene"], [
            [f"`{r['solver']}`", f"{r['status']} {r['why']}".strip(), changes(r)] for r in chosen])] if chosen else []
    worst = [r for engine in ENGINES for r in sorted((r for r in cases if r["solver"] == engine and r["error"]),
                                                     key=lambda r: -float(r["error"]))[:5]]
    lines += ["", *markdown_table(["solver", "error", "scene"],
                                  [[f"`{r['solver']}`", f"{r['error']:.1e}", changes(r)] for r in worst])]
    return "\n".join(lines) + "\n"


def text_of_cell(value: Any) -> str:
    """Return a number, numbers, or counts by name as text."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {count}" for name, count in value.items())
    if isinstance(value, list):
        return " / ".join("-" if math.isnan(x) else f"{x:.0e}" for x in value)
    return f"{value:.2g}" if isinstance(value, float) else str(value)
