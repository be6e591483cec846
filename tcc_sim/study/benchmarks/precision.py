"""Error against run time of every solver and of other programs: rows of precision.json, and their tables.

Every solver runs over a ladder of tolerances or steps on each scene. Errors are relative to SciPy references of
`references.py`. The time is the least CPU time of repeated runs, after a first run that compiles. Failures are rows
with their reasons.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from tcc_sim.errors import InputError, NumericalFailure, TccError
from tcc_sim.model.parameters import System
from tcc_sim.output.provenance import environment
from tcc_sim.output.tables import markdown_table
from tcc_sim.scene import Scene, load_scene
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.solvers.comparison import REACH, stick_rate
from tcc_sim.study.benchmarks import peers
from tcc_sim.study.benchmarks.peers import repeated
from tcc_sim.study.benchmarks.references import Reference, errors, reference
from tcc_sim.trajectory import State

Row = dict[str, Any]
FIELDS = {
    "scenes": ("measurements on each scene; the fields of the first are also at the top", ""),
    "quick": ("whether fewer settings were measured", ""), "complete": ("false where it was interrupted", ""),
    "scene": ("name of the scene", ""), "description": ("of the scene", ""), "law": ("friction law", ""),
    "cycles": ("cycles solved, or those of a long run", ""),
    "reference": ("the two references: their names, `solvers`, and `floor`, their relative difference, below which "
                  "errors are not resolved", ""),
    "results": ("errors and run times", ""), "omitted": ("solvers without a result", ""),
    "warm_up": ("time of each solver's first call, which compiles", "s"),
    "long_run": ("run times of runs so long that a call costs nothing", ""),
    "solver": ("name of the solver", ""), "setting": ("relative tolerance, or step in s", ""),
    "error_final": ("of the final state, relative to each signal's maximum", ""),
    "error_section": ("largest error on the section, relative to each signal's maximum", ""),
    "error_max_slip": ("relative error of the largest |slip speed| of a cycle", ""),
    "seconds": ("run time, minimum of several runs", "s"), "slowest": ("run time, maximum of several runs", "s"),
    "steps": ("number of steps; null if unknown", ""), "why": ("reason of the missing result", ""),
    "seconds_per_100_cycles": ("run time of 100 cycles in a long run", "s")}
"""Meaning and unit of every field of precision.json."""
ERRORS = "error_final", "error_section", "error_max_slip"
TARGETS = (1e-6, 1e-3, 1e-9)
"""Errors for which the fastest setting of every solver is listed."""
TARGET = TARGETS[0]
"""Error up to which ladders go on, and at which long runs are timed."""
TIGHTEST_TOLERANCE = 1e-14
"""Least tolerance; below it, rounding errors are larger."""
WRONG = 1.0
"""Relative error above which a result is a failure, since no digit is right."""
SECONDS_PER_STEP = {"rk4": 3e-7, "rk45": 6e-7, "dop853": 1.6e-4}
"""Estimated cost of a step, to omit settings that would take too long."""
LONG_RUN = {"smoothed": 1, "event_driven": 1, "numbalsoda": 5, "solve_ivp LSODA": 20, "CVODE": 5, "XPPAUT cvode": 5}
"""Solvers of long runs on the scenes fig02 and minimal, and the divisor of the cycles of each."""
SETTLING = 1000
"""Cycles from the initial state to the start of a settled horizon."""
FROM_START = " from its initial state"
TIGHTEST = {"smoothed": ("smoothed", 1e-11), "set_valued": ("event_driven", 1e-12)}
"""Engine and tolerance that settle a scene."""


@dataclass(frozen=True)
class Effort:
    """Extent of a study."""

    cycles: int
    patience: float
    """Time for repeats of one setting, s."""
    longest: float
    """Longest run of an explicit method, s; longer ones are omitted."""
    references: dict[str, tuple[tuple[str, float], tuple[str, float]]]
    ladders: dict[str, tuple[float, ...]]
    """Tolerances or steps, s, of every solver and other program; steps of rk4 are fractions of its stability limit."""
    long_cycles: int
    further: int = 12
    """Largest number of settings beyond a ladder."""
    scenes: tuple[str, ...] = ()
    """Names of the scenes; empty for all."""


FULL = Effort(
    12, 0.3, 45.0,
    {"smoothed": (("Radau", 1e-12), ("LSODA", 1e-13)), "set_valued": (("DOP853", 1e-13), ("Radau", 1e-12))},
    {"fixed_step": (1e-3, 1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6),
     "smoothed": (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12),
     "event_driven": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
     "rk45": (1e-4, 1e-7, 1e-9), "dop853": (1e-4, 1e-6, 1e-8), "radau": (1e-3, 1e-5, 1e-7, 1e-9),
     "bdf": (1e-3, 1e-5, 1e-7, 1e-9, 1e-10),
     "lsoda": (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9), "rk4": (1.5, 0.9, 0.45, 0.225),
     "numbalsoda": (1e-4, 1e-6, 1e-7, 1e-8, 1e-10, 1e-12), "solve_ivp LSODA": (1e-4, 1e-6, 1e-7, 1e-8, 1e-9),
     "CVODE": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
     "XPPAUT cvode": (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11),
     "XPPAUT stiff": (1e-5, 1e-8), "XPPAUT gear": (1e-6,), "XPPAUT 2rb": (1e-5, 1e-8, 1e-10, 1e-12)}, 2000)
"""All settings. At 1e-10 SciPy's LSODA steps through the stick of the scene stiff for minutes, so it ends at 1e-9."""
QUICK = replace(
    FULL, cycles=4, patience=0.08, longest=2.8, long_cycles=500, further=0,
    references={"smoothed": (("Radau", 1e-9), ("LSODA", 1e-13)), "set_valued": (("DOP853", 1e-13), ("LSODA", 1e-12))},
    ladders={
        "fixed_step": (1e-3, 5e-5, 1e-5), "smoothed": (1e-4, 1e-6, 1e-8, 1e-10), "event_driven": (1e-6, 1e-10),
        "rk45": (1e-5,), "dop853": (1e-6,), "radau": (1e-4,), "bdf": (1e-4,), "lsoda": (1e-4, 1e-6, 1e-8),
        "rk4": (0.9,), "numbalsoda": (1e-8, 1e-10), "solve_ivp LSODA": (1e-6, 1e-8), "CVODE": (1e-8, 1e-10),
        "XPPAUT cvode": (1e-6, 1e-8, 1e-9, 1e-10)})


SCENES: list[tuple[str, str, str, dict[str, Any]]] = [
    ("fig02", "fig02", "stick-slip of Fig. 2, mu_s/mu_k = 1.25", {}),
    ("minimal", "minimal", "mu_k = mu_s, constant pressure", {}),
    ("steep", "fig02", "mu_s/mu_k = 2, Tm = 100 N m, Tp = 400 N m, else fig02", {
        "friction.kinetic_coefficient": 0.15, "engine.mean_torque": 100.0, "engine.torque_amplitude": 400.0}),
    ("stiff", "fig02", "sigma = 1e4 s/rad, else fig02", {"friction.smoothing": 1e4})]
SCENES += [(f"{name}, set-valued", of, f"{text}; friction law (6)", {**values, "friction.law": "set_valued"})
           for name, of, text, values in SCENES[:3]]
"""Name of every case, the scene behind it, its description, and changed values."""


def cases(effort: Effort) -> list[Scene]:
    """Return the scenes, with a short horizon, since some motions are chaotic and any error grows. It begins after
    SETTLING cycles; that of one more case begins in the initial state of fig02, with three cycles of slip.
    """
    scenes = {name: replace(load_scene(of).with_values(values), name=name, description=text)
              for name, of, text, values in SCENES}
    if unknown := set(effort.scenes) - set(scenes):
        raise InputError(f"scenes has {sorted(unknown)[0]!r}; the scenes of the report are: {'; '.join(scenes)}")
    out = []
    for name in effort.scenes or scenes:
        system = scenes[name].system
        engine, rtol = TIGHTEST[system.friction.law]
        end = solve(system, cycles=SETTLING, solver=engine, rtol=rtol).solved_cycles.section[-1]
        out.append(replace(scenes[name], system=State.of(end).starting(system)))
    return out if effort.scenes else [*out, replace(scenes["fig02"], name=f"fig02{FROM_START}")]


def ladders_of(case: Scene, effort: Effort) -> dict[str, list[float]]:
    """Return the settings of every solver for the law of a case; other programs solve the smoothed law."""
    law = case.system.friction.law
    out = {solver: list(values) for solver, values in effort.ladders.items()
           if law in (SOLVERS[solver].laws if solver in SOLVERS else ("smoothed",))}
    if "rk4" in out:
        out["rk4"] = [float(f"{x * REACH['rk4'] / stick_rate(case.system):.2g}") for x in out["rk4"]]
    return out


def precision_study(effort: Effort, done: Callable[[int, int, str], None]) -> Iterator[Row]:
    """Yield the row of every scene; `done` takes the numbers of finished and of all runs, and the next run."""
    chosen = cases(effort)
    total, count = sum(1 + len(values) for case in chosen for values in ladders_of(case, effort).values()), 0
    for case in chosen:
        done(count, total, f"{case.name}: references")
        law = case.system.friction.law
        truths = [reference(case.system, effort.cycles, method, rtol) for method, rtol in effort.references[law]]
        rows, warm_up = list[Row](), dict[str, float]()
        for solver, ladder in ladders_of(case, effort).items():
            if solver in SOLVERS:
                (warm_up[solver],), _ = repeated(
                    partial(solve, case.system, duration=1e-3 * case.system.cycle, solver=solver), 1)
            for _ in range(len(ladder) + effort.further):
                setting = ladder.pop(0) if ladder else next_setting([row for row in rows if row["solver"] == solver])
                if setting is None:
                    break
                done(count, total, f"{case.name}: {solver} {setting:g}")
                rows.append(measured_row(case, solver, setting, truths[0], effort))
                count = min(count + 1, total - 1)
        results = [row for row in rows if "why" not in row]
        yield {"scene": case.name, "description": case.description, "law": law, "cycles": effort.cycles,
               "reference": {"solvers": [t.name for t in truths], "floor": max(errors(truths[1], truths[0]))},
               "results": results, "omitted": [row for row in rows if "why" in row], "warm_up": warm_up,
               "long_run": list(long_runs(case, fastest(results, TARGET), effort))}
    done(total, total, "")


def report_of(scenes: Sequence[Row], quick: bool, complete: bool) -> Row:
    """Return the contents of precision.json."""
    return {"scenes": scenes, "quick": quick, "complete": complete, **scenes[0]}


def largest_error(row: Mapping[str, Any]) -> float:
    """Return the largest of the errors of a result."""
    return max(float(row[name]) for name in ERRORS)


def fastest(results: Sequence[Row], target: float) -> dict[str, Row]:
    """Return for each solver the fastest result with all errors at most `target`."""
    good = sorted((row for row in results if largest_error(row) <= target), key=lambda row: -row["seconds"])
    return {row["solver"]: row for row in good}


def next_setting(rows: Sequence[Row]) -> float | None:
    """Return the setting after those of one solver: half of the step or a tenth of the tolerance; None where one has
    reached TARGET, the tightest one failed, or the tolerance would be too tight.
    """
    last = min(rows, key=lambda row: float(row["setting"]))
    if "why" in last or any("why" not in row and largest_error(row) <= TARGET for row in rows):
        return None
    halved = last["solver"] in ("fixed_step", "rk4")
    setting = float(f"{(0.5 if halved else 0.1) * last['setting']:.3g}")
    return setting if halved or setting >= TIGHTEST_TOLERANCE else None


def measured_row(case: Scene, solver: str, setting: float, truth: Reference, effort: Effort) -> Row:
    """Run one setting and return its errors and times, or why there are none."""
    row: Row = {"solver": solver, "setting": setting}
    try:
        run = run_of(case.system, effort.cycles, solver, setting, effort)
        deviation = errors(run, truth)
        if not max(deviation) <= WRONG:
            raise NumericalFailure(f"wrong: its largest relative error is {max(deviation):.2g}")
    except TccError as error:
        return {**row, "why": str(error)}
    return {**row, **dict(zip(ERRORS, deviation)), "seconds": run.seconds, "slowest": run.slowest, "steps": run.steps}


def run_of(system: System, cycles: int, solver: str, setting: float, effort: Effort) -> peers.PeerRun:
    """Run a registered solver or another program repeatedly; raise TccError where the program gives no result, or
    where stability of an explicit method would hold its steps too short.
    """
    if solver not in SOLVERS:
        name, _, method = solver.partition(" ")
        if name == "XPPAUT":
            return peers.xppaut(system, method, setting, cycles, 5)
        of = {"CVODE": peers.cvode, "numbalsoda": peers.numbalsoda, "solve_ivp": peers.bare_lsoda}[name]
        return of(system, cycles, setting, 5)
    if solver in REACH:
        step = setting if solver == "rk4" else REACH[solver] / stick_rate(system)
        steps = cycles * system.cycle / step
        if steps * SECONDS_PER_STEP[solver] > effort.longest:
            raise NumericalFailure(
                f"explicit: stability holds its step below {step:.2g} s, {steps:.2g} steps in stick, "
                f"which takes about {steps * SECONDS_PER_STEP[solver]:.2g} s")
    options: dict[str, Any] = {SOLVERS[solver].setting: setting}
    used, run = repeated(lambda: solve(system, cycles=cycles, solver=solver, **options).raise_for_status(), 9,
                         effort.patience)
    return peers.PeerRun(run.solved_cycles.section, run.solved_cycles.largest, min(used), max(used),
                         run.statistics.steps)


def long_runs(case: Scene, best: Mapping[str, Row], effort: Effort) -> Iterator[Row]:
    """Time long runs, in which the cost of a call is negligible, at the fastest settings with errors up to TARGET."""
    for solver, part in LONG_RUN.items() if case.name.split(",")[0] in ("fig02", "minimal") else ():
        if solver not in best:
            continue
        setting, cycles = best[solver]["setting"], effort.long_cycles // part
        try:
            run = run_of(case.system, cycles, solver, setting, effort)
        except TccError:
            continue
        yield {"solver": solver, "setting": setting, "cycles": cycles,
               "seconds_per_100_cycles": 100.0 * run.seconds / cycles}


def precision_tables(report: Row) -> str:
    """Return the tables of a report: run times of solvers by scene for each error, scenes, and failures."""
    versions, scenes = environment(), report["scenes"]
    packages = ", ".join(f"{name} {versions[name]}" for name in ("python", "numpy", "scipy", "numba"))
    lines = [f"Measured on {versions['processor']} ({packages})."]
    lines += ["", "**Interrupted: this report is not complete.**"] * (not report["complete"])
    times = {f"us a cycle, error up to {target:g}": [
        {name: 1e6 * row["seconds"] / scene["cycles"] for name, row in fastest(scene["results"], target).items()}
        for scene in scenes] for target in TARGETS}
    times[f"us a cycle, long run, error up to {TARGET:g}"] = [
        {row["solver"]: 1e4 * row["seconds_per_100_cycles"] for row in scene["long_run"]} for scene in scenes]
    for head, by_scene in times.items():
        names = dict.fromkeys(row["solver"] for scene in scenes for row in scene["results"])
        rows = [(name, _relative(name, by_scene), *(_digits(of.get(name)) for of in by_scene)) for name in names
                if any(name in of for of in by_scene)]
        heads = (head, "over `smoothed`", *(scene["scene"] for scene in scenes))
        lines += ["", *markdown_table(heads, rows, "---:", "---")]
    lines += ["", *markdown_table(("scene", "", "references", "floor"), [
        (s["scene"], s["description"], "; ".join(s["reference"]["solvers"]), f"{s['reference']['floor']:.1e}")
        for s in scenes])]
    if failed := [(scene["scene"], row["solver"], f"{row['setting']:.3g}", row["why"]) for scene in scenes
                  for row in scene["omitted"]]:
        lines += ["", *markdown_table(("scene", "without a result", "at", "why"), failed)]
    return "\n".join(lines) + "\n"


def _relative(name: str, by_scene: Sequence[Mapping[str, float]]) -> str:
    """Return least and largest run time of a solver relative to `smoothed`, over the scenes that both solved."""
    ratios = [of[name] / of["smoothed"] for of in by_scene if name in of and "smoothed" in of]
    return " to ".join(dict.fromkeys(_digits(of(ratios), 2) for of in (min, max))) if ratios else "-"


def _digits(value: float | None, count: int = 3) -> str:
    """Return a number with some digits and without an exponent; a dash for None."""
    return "-" if value is None or math.isnan(value) else f"{float(f'{value:.{count}g}'):.12g}"
