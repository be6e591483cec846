"""Error against run time of every solver and of other programs: rows of precision.json, and their tables.

Every solver runs over a ladder of tolerances or steps on each scene. Errors of the final state, of the stroboscopic
section and of each cycle's largest slip speed are relative to SciPy references of `references.py`; a fourth error is
that of the steady state after a long run. The time is the least CPU time of repeated runs, after a first run that
compiles. Failures are rows with their reasons.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from tcc_sim.analysis.steady.periodicity import periodicity
from tcc_sim.errors import InputError, TccError
from tcc_sim.model import parameters
from tcc_sim.model.parameters import System
from tcc_sim.output.provenance import environment
from tcc_sim.output.tables import markdown_table
from tcc_sim.result import Described, reported, reporting
from tcc_sim.scene import load_scene
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.solvers.comparison import REACH, stick_rate
from tcc_sim.study.benchmarks import peers
from tcc_sim.study.benchmarks.peers import repeated
from tcc_sim.study.benchmarks.references import Reference, Unfinished, disagreement, errors, reference
from tcc_sim.trajectory import Cycles, Floats, State

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
LONGEST_STEADY = 0.05
"""Largest run time of a steady state, relative to an effort's longest run; every setting has one."""
SETTLING = 1000
"""Cycles from the initial state to the start of a settled horizon."""
FROM_START = " from its initial state"
LAST = 96
"""Number of last cycles that are evaluated, a multiple of most periods."""
TIGHTEST = {"smoothed": ("smoothed", 1e-11), "set_valued": ("event_driven", 1e-12)}
"""Engine and tolerance that settle a scene and determine its steady state."""


@dataclass(frozen=True)
class References:
    """Names of two references, and their difference, below which an error is not resolved."""

    solvers: Sequence[str] = field(metadata=reported("names of the two references"))
    floor: float = field(metadata=reported("their relative difference; errors below it are not resolved"))


@dataclass(frozen=True)
class SteadyState:
    """Steady motion from the initial state."""

    cycles: int = field(metadata=reported("cycles from the initial state"))
    period: int = field(metadata=reported("period of the motion; 0 for none up to 16", "periods of excitation"))
    max_slip_speed: float | None = field(default=None, metadata=reported(
        "that of SciPy's solution; null without a period, or if SciPy failed", "rad/s"))
    closure: float | None = field(default=None, metadata=reported(
        "distance of that solution from its start after one period, relative to each signal's maximum"))


@dataclass(frozen=True)
class SolverSetting:
    """A solver at one of its tolerances or steps."""

    solver: str = field(metadata=reported("name of the solver"))
    setting: float = field(metadata=reported("relative tolerance, or step in s"))


@dataclass(frozen=True)
class PrecisionResult(SolverSetting):
    """Errors, fastest and slowest run time, s, and number of steps of a solver at a setting; None if not measured."""

    error_final: float = field(metadata=reported("of the final state, relative to each signal's maximum"))
    error_section: float = field(metadata=reported("largest error on the section, relative to each signal's maximum"))
    error_max_slip: float = field(metadata=reported("relative error of the largest |slip speed|"))
    error_steady: float | None = field(metadata=reported(
        "the same of the steady state; null if not measured"))
    seconds: float = field(metadata=reported("run time, minimum of several runs", "s"))
    slowest: float = field(metadata=reported("run time, maximum of several runs", "s"))
    steps: int | None = field(metadata=reported("number of steps; null if unknown"))

    @property
    def largest_error(self) -> float:
        """Largest of the three errors that every result has."""
        return max(self.error_final, self.error_section, self.error_max_slip)


@dataclass(frozen=True)
class Omitted(SolverSetting):
    """Solver at a setting without a result."""

    why: str = field(metadata=reported("reason of the missing result"))


@dataclass(frozen=True)
class LongRun(SolverSetting):
    """Run time of a solver over so many cycles that the cost of a call is negligible."""

    cycles: int = field(metadata=reported("cycles"))
    seconds_per_100_cycles: float = field(metadata=reported(
        "run time of 100 cycles in a long run", "s"))


@dataclass(frozen=True)
class StudiedScene:
    """Measurements on one scene."""

    scene: str = field(metadata=reported("name of the scene"))
    description: str = field(metadata=reported("of the scene"))
    law: str = field(metadata=reported("friction law"))
    cycles: int = field(metadata=reported("cycles solved"))
    reference: References = field(metadata=reported("the two references"))
    steady: SteadyState = field(metadata=reported("steady motion from the initial state"))
    results: Sequence[PrecisionResult] = field(metadata=reported("errors and run times"))
    omitted: Sequence[Omitted] = field(metadata=reported("solvers without a result"))
    warm_up: Mapping[str, float] = field(metadata=reported("time of each solver's first call, which compiles", "s"))
    long_run: Sequence[LongRun] = field(metadata=reported(
        "run times of runs so long that a call costs nothing"))

    def fastest(self, target: float) -> dict[str, PrecisionResult]:
        """Return for each solver the fastest result with all three errors at most `target`."""
        rows = sorted((row for row in self.results if row.largest_error <= target), key=lambda row: -row.seconds)
        return {row.solver: row for row in rows}


@dataclass(frozen=True)
class PrecisionReport(Described):
    """Contents of precision.json."""

    scenes: Sequence[StudiedScene] = field(metadata=reported(
        "measurements on each scene; the fields of the first are also at the top"))
    quick: bool = field(metadata=reported("whether fewer settings were measured"))
    complete: bool = field(metadata=reported("false where it was interrupted"))

    @property
    @reporting("the first scene", spread=True)
    def first(self) -> StudiedScene:
        """First scene, whose fields are also at the top of the file."""
        return self.scenes[0]


@dataclass(frozen=True)
class Case:
    """A scene of the study.

    system : the scene from the state in which the horizon begins
    scene : the scene from its own initial state, from which the steady state is reached
    """

    name: str
    description: str
    system: System
    scene: System
    cycles: int


@dataclass(frozen=True)
class Effort:
    """Extent of a study."""

    cycles: int
    patience: float
    """Time for repeats of one setting, s."""
    longest: float
    """Longest run, s: longer runs of an explicit method, and of a steady state times LONGEST_STEADY, are omitted."""
    references: dict[str, tuple[tuple[str, float], tuple[str, float]]]
    ladders: dict[str, tuple[float, ...]]
    """Tolerances or steps, s, of every solver and other program; steps of rk4 are fractions of its stability limit."""
    long_cycles: int
    steady_cycles: int = 3000
    """Engine cycles to a steady state: Fig. 2 with the set-valued law takes some 700 to settle."""
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
    FULL, cycles=4, patience=0.08, longest=2.8, long_cycles=500, steady_cycles=1000, further=0,
    references={"smoothed": (("Radau", 1e-9), ("LSODA", 1e-13)), "set_valued": (("DOP853", 1e-13), ("LSODA", 1e-12))},
    ladders={
        "fixed_step": (1e-3, 5e-5, 1e-5), "smoothed": (1e-4, 1e-6, 1e-8, 1e-10), "event_driven": (1e-6, 1e-10),
        "rk45": (1e-5,), "dop853": (1e-6,), "radau": (1e-4,), "bdf": (1e-4,), "lsoda": (1e-4, 1e-6, 1e-8),
        "rk4": (0.9,), "numbalsoda": (1e-8, 1e-10), "solve_ivp LSODA": (1e-6, 1e-8), "CVODE": (1e-8, 1e-10),
        "XPPAUT cvode": (1e-6, 1e-8, 1e-9, 1e-10)})


def cases(effort: Effort) -> list[Case]:
    """Return the scenes, with a short horizon, since some motions are chaotic and any error grows. It begins after
    SETTLING cycles; that of one more case begins in the initial state of fig02, with three cycles of slip.
    """
    base, fewest = load_scene("fig02").system, load_scene("minimal").system
    steep = parameters.replace(base, {"friction.kinetic_coefficient": 0.15, "engine.mean_torque": 100.0,
                                      "engine.torque_amplitude": 400.0})
    scenes = {"fig02": ("stick-slip of Fig. 2, mu_s/mu_k = 1.25", base),
              "minimal": ("mu_k = mu_s, constant pressure", fewest),
              "steep": ("mu_s/mu_k = 2, Tm = 100 N m, Tp = 400 N m, else fig02", steep),
              "stiff": ("sigma = 1e4 s/rad, else fig02", parameters.replace(base, {"friction.smoothing": 1e4}))}
    scenes |= {f"{name}, set-valued": (f"{text}; friction law (6)",
                                       parameters.replace(system, {"friction.law": "set_valued"}))
               for name, (text, system) in list(scenes.items())[:3]}
    if unknown := set(effort.scenes) - set(scenes):
        raise InputError(f"scenes has {sorted(unknown)[0]!r}; the scenes of the report are: {'; '.join(scenes)}")
    out = []
    for name in effort.scenes or scenes:
        text, system = scenes[name]
        engine, rtol = TIGHTEST[system.friction.law]
        end = solve(system, cycles=SETTLING, solver=engine, rtol=rtol).solved_cycles.section[-1]
        out.append(Case(name, text, State.of(end).starting(system), system, effort.cycles))
    return out if effort.scenes else [*out, Case(f"fig02{FROM_START}", scenes["fig02"][0], base, base, effort.cycles)]


def ladders_of(case: Case, effort: Effort) -> dict[str, list[float]]:
    """Return the settings of every solver for the law of a case; other programs solve the smoothed law."""
    law = case.system.friction.law
    out = {solver: list(values) for solver, values in effort.ladders.items()
           if law in (SOLVERS[solver].laws if solver in SOLVERS else ("smoothed",))}
    if "rk4" in out:
        out["rk4"] = [float(f"{x * REACH['rk4'] / stick_rate(case.system):.2g}") for x in out["rk4"]]
    return out


def precision_study(effort: Effort, done: Callable[[int, int, str], None]) -> Iterator[StudiedScene]:
    """Yield one complete record per scene.

    Parameters
    ----------
    effort : extent of the study
    done : function called with the numbers of finished and of all runs, and the next run
    """
    chosen = cases(effort)
    total, count = sum(1 + len(values) for case in chosen for values in ladders_of(case, effort).values()), 0
    for case in chosen:
        done(count, total, f"{case.name}: references")
        methods = effort.references[case.system.friction.law]
        truths = [reference(case.system, case.cycles, method, rtol) for method, rtol in methods]
        steady = steady_reference(case.scene, effort.steady_cycles, *methods[0])
        rows, warm_up = list[PrecisionResult | Omitted](), dict[str, float]()
        for solver, ladder in ladders_of(case, effort).items():
            if solver in SOLVERS:
                (warm_up[solver],), _ = repeated(
                    partial(solve, case.system, duration=1e-3 * case.system.cycle, solver=solver), 1)
            for _ in range(len(ladder) + effort.further):
                setting = ladder.pop(0) if ladder else next_setting([row for row in rows if row.solver == solver])
                if setting is None:
                    break
                done(count, total, f"{case.name}: {solver} {setting:g}")
                rows.append(measured_row(case, solver, setting, truths[0], steady, effort))
                count = min(count + 1, total - 1)
        results = [row for row in rows if isinstance(row, PrecisionResult)]
        record = StudiedScene(case.name, case.description, case.system.friction.law, case.cycles,
                              References([t.name for t in truths], disagreement(*truths)), steady, results,
                              [row for row in rows if isinstance(row, Omitted)], warm_up, [])
        yield replace(record, long_run=list(long_runs(record, case, effort)))
    done(total, total, "")


def next_setting(rows: Sequence[PrecisionResult | Omitted]) -> float | None:
    """Return the setting after those of one solver: half of the step or a tenth of the tolerance; None where one has
    reached TARGET, the tightest one failed, or the tolerance would be too tight.
    """
    last = min(rows, key=lambda row: row.setting)
    if isinstance(last, Omitted) or any(isinstance(row, PrecisionResult) and row.largest_error <= TARGET
                                        for row in rows):
        return None
    halved = last.solver in ("fixed_step", "rk4")
    setting = float(f"{(0.5 if halved else 0.1) * last.setting:.3g}")
    return setting if halved or setting >= TIGHTEST_TOLERANCE else None


def steady_of(section: Floats, largest: Floats) -> tuple[int, float]:
    """Return period (0 for none up to 16) and largest slip speed, rad/s, at the end of a run.

    section, largest : sections (n + 1, 3) and each cycle's largest slip speed (n,)
    """
    count = min(LAST, len(largest))
    last = Cycles(section[-count - 1:], largest[-count:], np.zeros(count), np.zeros(count))
    return periodicity(last).period, float(largest[-count:].max())


def steady_reference(system: System, cycles: int, method: str, rtol: float) -> SteadyState:
    """Return the motion that the engine at its tightest setting reaches from the initial state.

    SciPy (`references`) solves one period again from the section of this motion, so that largest slip speed and closure
    come from an independent solution. A short horizon would not show which motion is reached.
    """
    engine, tightest = TIGHTEST[system.friction.law]
    run = solve(system, cycles=cycles, solver=engine, rtol=tightest).solved_cycles
    period = steady_of(run.section, run.largest)[0]
    if not period:
        return SteadyState(cycles, period)
    try:
        truth = reference(State.of(run.section[cycles // period * period]).starting(system), period, method, rtol)
    except Unfinished:
        return SteadyState(cycles, period)
    size = np.maximum(truth.size, np.abs(truth.section).max(axis=0))
    closure = float((np.abs(truth.section[-1] - truth.section[0]) / np.maximum(size, 1e-300)).max())
    return SteadyState(cycles, period, float(truth.largest.max()), closure)


def measured_row(case: Case, solver: str, setting: float, truth: Reference, steady: SteadyState,
           effort: Effort) -> PrecisionResult | Omitted:
    """Run one setting and return its errors and times, or why there are none."""
    try:
        run = run_of(case, solver, setting, effort)
        deviation = errors(run.section, run.largest, truth)
        if not max(deviation) <= WRONG:
            raise peers.Failed(f"wrong: its largest relative error is {max(deviation):.2g}")
        off, expected = None, steady.max_slip_speed
        long = run.seconds * effort.steady_cycles / case.cycles > LONGEST_STEADY * effort.longest
        if (solver in LONG_RUN or solver == "fixed_step") and expected is not None and not long:
            longer = replace(case, cycles=effort.steady_cycles, system=case.scene)
            ended = run_of(longer, solver, setting, effort, timed=False)
            off = abs(steady_of(ended.section, ended.largest)[1] / expected - 1.0)
    except (peers.Failed, TccError) as error:
        return Omitted(solver, setting, str(error))
    return PrecisionResult(solver, setting, *deviation, off, run.seconds, run.slowest, run.steps)


def run_of(case: Case, solver: str, setting: float, effort: Effort, timed: bool = True) -> peers.PeerRun:
    """Run a registered solver or another program, repeatedly if `timed`.

    Raises
    ------
    peers.Failed
        The program gave no result, or stability of an explicit method would hold its steps too short.
    """
    if solver not in SOLVERS:
        name, _, method = solver.partition(" ")
        if name == "XPPAUT":
            return peers.xppaut(case.system, method, setting, case.cycles, 5 * timed)
        of = {"CVODE": peers.cvode, "numbalsoda": peers.numbalsoda, "solve_ivp": peers.bare_lsoda}[name]
        return of(case.system, case.cycles, setting, 5 * timed)
    if solver in REACH:
        step = setting if solver == "rk4" else REACH[solver] / stick_rate(case.system)
        steps = case.cycles * case.system.cycle / step
        if steps * SECONDS_PER_STEP[solver] > effort.longest:
            raise peers.Failed(f"explicit: stability holds its step below {step:.2g} s, {steps:.2g} steps in stick, "
                               f"which takes about {steps * SECONDS_PER_STEP[solver]:.2g} s")
    options: dict[str, Any] = {SOLVERS[solver].setting: setting}
    used, run = repeated(lambda: solve(case.system, cycles=case.cycles, solver=solver, **options).raise_for_status(),
                         9 if timed else 1, effort.patience)
    return peers.PeerRun(run.solved_cycles.section, run.solved_cycles.largest, min(used), max(used),
                         run.statistics.steps)


def long_runs(record: StudiedScene, case: Case, effort: Effort) -> Iterator[LongRun]:
    """Time long runs, in which the cost of a call is negligible, at the fastest settings with errors up to TARGET."""
    if case.name.split(",")[0] not in ("fig02", "minimal"):
        return
    best = record.fastest(TARGET)
    for solver, part in LONG_RUN.items():
        if solver in best:
            longer = replace(case, cycles=effort.long_cycles // part)
            try:
                run = run_of(longer, solver, best[solver].setting, effort)
            except peers.Failed:
                continue
            yield LongRun(solver, best[solver].setting, longer.cycles, 100.0 * run.seconds / longer.cycles)


def precision_tables(report: PrecisionReport) -> str:
    """Return the tables of a report: run times of solvers by scene for each error, scenes, and failures."""
    versions, scenes = environment(), report.scenes
    packages = ", ".join(f"{name} {versions[name]}" for name in ("python", "numpy", "scipy", "numba"))
    lines = [f"Measured on {versions['processor']} ({packages})."]
    lines += ["", "**Interrupted: this report is not complete.**"] * (not report.complete)
    times = {f"us a cycle, error up to {target:g}": [
        {name: 1e6 * row.seconds / scene.cycles for name, row in scene.fastest(target).items()} for scene in scenes]
        for target in TARGETS}
    times[f"us a cycle, long run, error up to {TARGET:g}"] = [
        {row.solver: 1e4 * row.seconds_per_100_cycles for row in scene.long_run} for scene in scenes]
    for head, by_scene in times.items():
        names = dict.fromkeys(row.solver for scene in scenes for row in scene.results)
        rows = [(name, _relative(name, by_scene), *(_digits(of.get(name)) for of in by_scene)) for name in names
                if any(name in of for of in by_scene)]
        heads = (head, "over `smoothed`", *(scene.scene for scene in scenes))
        lines += ["", *markdown_table(heads, rows, "---:", "---")]
    lines += ["", *markdown_table(
        ("scene", "", "references", "floor", "steady state after", "period", "largest slip (rad/s)", "closed to"),
        [(s.scene, s.description, "; ".join(s.reference.solvers), f"{s.reference.floor:.1e}",
          f"{s.steady.cycles} cycles", str(s.steady.period or "none up to 16"), _digits(s.steady.max_slip_speed, 5),
          "-" if s.steady.closure is None else f"{s.steady.closure:.1e}") for s in scenes])]
    if failed := [(scene.scene, row.solver, f"{row.setting:.3g}", row.why) for scene in scenes
                  for row in scene.omitted]:
        lines += ["", *markdown_table(("scene", "without a result", "at", "why"), failed)]
    return "\n".join(lines) + "\n"


def _relative(name: str, by_scene: Sequence[Mapping[str, float]]) -> str:
    """Return least and largest run time of a solver relative to `smoothed`, over the scenes that both solved."""
    ratios = [of[name] / of["smoothed"] for of in by_scene if name in of and "smoothed" in of]
    return " to ".join(dict.fromkeys(_digits(of(ratios), 2) for of in (min, max))) if ratios else "-"


def _digits(value: float | None, count: int = 3) -> str:
    """Return a number with some digits and without an exponent; a dash for None."""
    return "-" if value is None or math.isnan(value) else f"{float(f'{value:.{count}g}'):.12g}"
