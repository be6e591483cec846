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
from typing import Any

import numpy as np

from tcc_sim.analysis.periodicity import periodicity
from tcc_sim.errors import InputError, TccError
from tcc_sim.model import parameters
from tcc_sim.model.parameters import System
from tcc_sim.output.provenance import environment
from tcc_sim.output.tables import markdown_table
from tcc_sim.result import Described, reported, reporting
from tcc_sim.scene import load_scene
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.solvers.explicit import REACH, stick_rate
from tcc_sim.study.benchmarks import peers
from tcc_sim.study.benchmarks.peers import repeated
from tcc_sim.study.benchmarks.references import Reference, Unfinished, disagreement, errors, reference
from tcc_sim.trajectory import Cycles, Floats, State

TARGETS = (1e-3, 1e-6, 1e-9)
"""Errors for which the fastest setting of every solver is listed."""
TARGET = 1e-6
"""Error at which solvers are compared, and up to which ladders go on."""
ENGINES = {"smoothed": "smoothed", "set_valued": "event_driven"}
"""Engine with which the other solvers of each friction law are compared."""
REPEATS = 9
"""Largest number of repeats of a setting within its effort's seconds."""
TIGHTEST_TOLERANCE = 1e-14
"""Least tolerance; below it, rounding errors are larger."""
WRONG = 1.0
"""Relative error above which a result is a failure, since no digit is right."""
SECONDS_PER_STEP = {"rk4": 3e-7, "rk45": 6e-7, "dop853": 1.6e-4}
"""Estimated cost of a step, to omit settings that would take too long."""

LONG_RUN = ("smoothed", "event_driven", "numbalsoda", "solve_ivp LSODA", "CVODE", "XPPAUT cvode")
LONG_RUN_SCENES = ("fig02", "minimal")
LONGEST_STEADY = 0.05
"""Largest run time of a steady state, relative to an effort's longest run; every setting has one."""
SETTLING = 1000
"""Cycles from the initial state to the start of a settled horizon."""
FROM_START = " from its initial state"
STEADY_CYCLES, QUICK_STEADY_CYCLES = 3000, 1000
"""Engine cycles from the initial state to a steady state: Fig. 2 with the set-valued law takes some 700 to settle."""
LAST = 96
"""Number of last cycles that are evaluated, a multiple of most periods."""
TIGHTEST = {"smoothed": ("smoothed", 1e-11), "set_valued": ("event_driven", 1e-12)}
"""Engine and tolerance that settle a scene and determine its steady state."""
STEADY_SOLVERS = ("smoothed", "event_driven", "fixed_step", "numbalsoda", "solve_ivp LSODA", "CVODE", "XPPAUT cvode")
"""Solvers that are run up to a steady state."""


@dataclass(frozen=True)
class References:
    """Names of two references, and their difference, below which an error is not resolved."""

    solvers: Sequence[str] = field(metadata=reported("names of the two references"))
    floor: float = field(metadata=reported("relative difference of the references; an error below it is not resolved"))


@dataclass(frozen=True)
class SteadyState:
    """Steady motion from the initial state."""

    cycles: int = field(metadata=reported("number of periods of excitation from the initial state"))
    period: int = field(metadata=reported("period of the motion; 0 for none up to 16", "periods of excitation"))
    max_slip_speed: float | None = field(metadata=reported(
        "largest |slip speed| of SciPy's solution; null if the motion has no period or SciPy failed", "rad/s"))
    closure: float | None = field(metadata=reported(
        "distance of SciPy's solution from its start after one period, relative to each signal's maximum"))
    solvers: Sequence[str] = field(metadata=reported("names of the solvers that found the motion and solved it again"))


@dataclass(frozen=True)
class SolverSetting:
    """A solver at one of its tolerances or steps."""

    solver: str = field(metadata=reported("name of the solver"))
    setting: float = field(metadata=reported("relative tolerance, or step in s"))


@dataclass(frozen=True)
class PrecisionResult(SolverSetting):
    """Errors, fastest and slowest run time, s, and number of steps of a solver at a setting; None if not measured."""

    error_final: float = field(metadata=reported("error of the final state, relative to each signal's maximum"))
    error_section: float = field(metadata=reported("largest error on the section, relative to each signal's maximum"))
    error_max_slip: float = field(metadata=reported("relative error of the largest |slip speed|"))
    error_steady: float | None = field(metadata=reported(
        "relative error of the largest |slip speed| of the steady state; null if not measured"))
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

    cycles: int = field(metadata=reported("number of periods of excitation"))
    seconds_per_100_cycles: float = field(metadata=reported(
        "run time of 100 periods of excitation in a run so long that the cost of a call is negligible", "s"))


@dataclass
class StudiedScene:
    """Measurements on one scene; `warm_up` is each solver's first call, which compiles, s."""

    scene: str = field(metadata=reported("name of the scene"))
    description: str = field(metadata=reported("description of the scene"))
    law: str = field(metadata=reported("friction law"))
    cycles: int = field(metadata=reported("number of periods of excitation solved"))
    reference: References = field(metadata=reported("the two references"))
    steady: SteadyState = field(metadata=reported("steady motion from the initial state"))
    results: list[PrecisionResult] = field(default_factory=list, metadata=reported("errors and run times"))
    omitted: list[Omitted] = field(default_factory=list, metadata=reported("solvers without a result"))
    warm_up: dict[str, float] = field(default_factory=dict, metadata=reported(
        "time of each solver's first call, which compiles", "s"))
    long_run: list[LongRun] = field(default_factory=list, metadata=reported(
        "run times of long runs, in which the cost of a call is negligible"))


@dataclass(frozen=True)
class PrecisionReport(Described):
    """Contents of precision.json."""

    scenes: Sequence[StudiedScene] = field(metadata=reported(
        "measurements on each scene; the fields of the first are also at the top"))
    peers: Mapping[str, str] = field(metadata=reported("participation of each other program, by its name"))
    quick: bool = field(metadata=reported("whether fewer settings were measured"))
    complete: bool = field(metadata=reported("false where it was interrupted"))
    machine: str = field(default_factory=lambda: machine(), metadata=reported("processor and versions"))

    @property
    @reporting("the first scene", spread=True)
    def first(self) -> StudiedScene:
        """First scene, whose fields are also at the top of the file."""
        return self.scenes[0]


@dataclass(frozen=True)
class Case:
    """A scene of the study.

    system : the scene from the state in which the horizon begins
    scene : the scene from its own initial state, from which the steady state is reached; None for `system`
    """

    name: str
    description: str
    system: System
    cycles: int
    scene: System | None = None

    @property
    def unsettled(self) -> System:
        """The scene from its own initial state."""
        return self.scene or self.system

    def set_valued(self) -> Case:
        """Return the same scene with the friction law (6)."""
        return Case(f"{self.name}, set-valued", f"{self.description}; friction law (6)",
                    parameters.replace(self.system, {"friction.law": "set_valued"}), self.cycles)

    def settled(self) -> Case:
        """Return the case with a horizon that begins after SETTLING cycles, by the engine at its tightest tolerance."""
        engine, rtol = TIGHTEST[self.system.friction.law]
        run = solve(self.system, cycles=SETTLING, solver=engine, rtol=rtol)
        return replace(self, system=State.of(run.solved_cycles.section[-1]).starting(self.system), scene=self.system)


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
    peers: dict[str, tuple[float, ...]]
    long_cycles: int
    steady_cycles: int = STEADY_CYCLES
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
     "lsoda": (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10), "rk4": (1.5, 0.9, 0.45, 0.225)},
    {"numbalsoda": (1e-4, 1e-6, 1e-7, 1e-8, 1e-10, 1e-12), "solve_ivp LSODA": (1e-4, 1e-6, 1e-7, 1e-8, 1e-10),
     "CVODE": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
     "XPPAUT cvode": (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11),
     "XPPAUT stiff": (1e-5, 1e-8), "XPPAUT gear": (1e-6,), "XPPAUT 2rb": (1e-5, 1e-8, 1e-10, 1e-12)}, 2000)
QUICK = Effort(
    4, 0.08, 2.8,
    {"smoothed": (("Radau", 1e-9), ("LSODA", 1e-13)), "set_valued": (("DOP853", 1e-13), ("LSODA", 1e-12))},
    {"fixed_step": (1e-3, 5e-5, 1e-5), "smoothed": (1e-4, 1e-6, 1e-8, 1e-10), "event_driven": (1e-6, 1e-10),
     "rk45": (1e-5,),
     "dop853": (1e-6,), "radau": (1e-4,), "bdf": (1e-4,), "lsoda": (1e-4, 1e-6, 1e-8), "rk4": (0.9,)},
    {"numbalsoda": (1e-8, 1e-10), "solve_ivp LSODA": (1e-6, 1e-8), "CVODE": (1e-8, 1e-10),
     "XPPAUT cvode": (1e-6, 1e-8, 1e-9, 1e-10)},
    500, QUICK_STEADY_CYCLES, 0)


def cases(effort: Effort) -> list[Case]:
    """Return the scenes, with a short horizon, since some motions are chaotic and any error grows. It begins in a
    settled state; that of one more case begins in the initial state of fig02, with three cycles of slip.
    """
    base, fewest = load_scene("fig02").system, load_scene("minimal").system
    steep = parameters.replace(base, {"friction.kinetic_coefficient": 0.15, "engine.mean_torque": 100.0,
                                      "engine.torque_amplitude": 400.0})
    stiff = parameters.replace(base, {"friction.smoothing": 1e4})
    smoothed = [
        Case("fig02", "stick-slip of Fig. 2, mu_s/mu_k = 1.25", base, effort.cycles),
        Case("minimal", "mu_k = mu_s, constant pressure", fewest, effort.cycles),
        Case("steep", "mu_s/mu_k = 2, Tm = 100 N m, Tp = 400 N m, else fig02", steep, effort.cycles),
        Case("stiff", "sigma = 1e4 s/rad, else fig02", stiff, effort.cycles)]
    every = [*smoothed, *(case.set_valued() for case in smoothed[:3])]
    if unknown := set(effort.scenes) - {case.name for case in every}:
        names = "; ".join(case.name for case in every)
        raise InputError(f"scenes has {sorted(unknown)[0]!r}; the scenes of the report are: {names}")
    wanted = [case for case in every if not effort.scenes or case.name in effort.scenes]
    settled = [case.settled() for case in wanted]
    return [*settled, *(replace(case, name=f"{case.name}{FROM_START}") for case in wanted[:1] if not effort.scenes)]


def precision_study(effort: Effort, done: Callable[[int, int, str], None]) -> Iterator[StudiedScene]:
    """Yield one complete record per scene.

    Parameters
    ----------
    effort : extent of the study
    done : function called with the numbers of finished and of all runs, and the next run
    """
    chosen = cases(effort)
    total = sum(3 + len(list(settings(case, effort))) for case in chosen)
    count = 0
    for case in chosen:
        truths = []
        for method, rtol in effort.references[case.system.friction.law]:
            done(count, total, f"{case.name}: reference {method}")
            truths.append(reference(case.system, case.cycles, method, rtol))
            count += 1
        method, rtol = effort.references[case.system.friction.law][0]
        done(count, total, f"{case.name}: steady state")
        steady = steady_reference(case.unsettled, effort.steady_cycles, method, rtol)
        count += 1
        record = StudiedScene(case.name, case.description, case.system.friction.law, case.cycles,
                             References([t.name for t in truths], disagreement(*truths)), steady)
        for solver, setting in settings(case, effort):
            done(count, total, f"{case.name}: {solver} {setting:g}")
            record_run(record, case, solver, setting, truths[0], effort)
            count += 1
        for solver, setting in further(record, case, effort):
            done(count, total, f"{case.name}: {solver} {setting:g}, beyond its ladder")
            record_run(record, case, solver, setting, truths[0], effort)
        long_run(record, case, effort)
        yield record
    done(total, total, "")


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
    solvers = [f"{engine}, rtol {tightest:g}", f"SciPy {method}, rtol {rtol:g}"]
    run = solve(system, cycles=cycles, solver=engine, rtol=tightest).solved_cycles
    period = steady_of(run.section, run.largest)[0]
    if not period:
        return SteadyState(cycles, period, None, None, solvers)
    begun = run.section[cycles // period * period]
    try:
        truth = reference(State.of(begun).starting(system), period, method, rtol)
    except Unfinished:
        return SteadyState(cycles, period, None, None, solvers)
    size = np.maximum(truth.size, np.abs(truth.section).max(axis=0))
    closure = float((np.abs(truth.section[-1] - truth.section[0]) / np.maximum(size, 1e-300)).max())
    return SteadyState(cycles, period, float(truth.largest.max()), closure, solvers)


def settings(case: Case, effort: Effort) -> Iterator[tuple[str, float]]:
    """Yield every solver for this law with its ladder; steps of rk4 are fractions of its stability limit."""
    law = case.system.friction.law
    for solver, ladder in effort.ladders.items():
        if law in SOLVERS[solver].laws:
            if solver == "event_driven" and case.system.friction_ratio == 1.0:
                ladder = ladder[-1:]
            for value in ladder:
                if solver == "rk4":
                    value = float(f"{value * REACH['rk4'] / stick_rate(case.system):.2g}")
                yield solver, value
    if law == "smoothed":
        yield from ((peer, value) for peer, ladder in effort.peers.items() for value in ladder)


def further(record: StudiedScene, case: Case, effort: Effort) -> Iterator[tuple[str, float]]:
    """Yield further settings of every solver that has neither reached TARGET nor failed at its last setting.

    The next setting is a tenth of the tolerance or half of the step; the caller records each before asking for more.
    """
    for solver in dict.fromkeys(solver for solver, _ in settings(case, effort)):
        share = 0.5 if solver in ("fixed_step", "rk4") else 0.1
        for _ in range(effort.further):
            rows = [row for row in record.results if row.solver == solver]
            last = min((row.setting for row in rows), default=0.0)
            failed = min((row.setting for row in record.omitted if row.solver == solver), default=math.inf)
            if not rows or failed < last or min(row.largest_error for row in rows) <= TARGET or (
                    share * last < TIGHTEST_TOLERANCE and share == 0.1):
                break
            yield solver, float(f"{share * last:.3g}")


def record_run(record: StudiedScene, case: Case, solver: str, setting: float, truth: Reference, effort: Effort) -> None:
    """Run one setting and append it to `results` or `omitted`."""
    try:
        run = run_of(record, case, solver, setting, effort)
        deviation = errors(run.section, run.largest, truth)
        if not max(deviation) <= WRONG:
            raise peers.Failed(f"wrong: its largest relative error is {max(deviation):.2g}")
        steady, expected = None, record.steady.max_slip_speed
        long = run.seconds * effort.steady_cycles / case.cycles > LONGEST_STEADY * effort.longest
        if solver in STEADY_SOLVERS and expected is not None and not long:
            longer = replace(case, cycles=effort.steady_cycles, system=case.unsettled)
            ended = run_of(record, longer, solver, setting, effort, timed=False)
            steady = abs(steady_of(ended.section, ended.largest)[1] / expected - 1.0)
    except (peers.Failed, TccError) as error:
        record.omitted.append(Omitted(solver, setting, str(error)))
        return
    record.results.append(PrecisionResult(solver, setting, *deviation, steady, run.seconds, run.slowest, run.steps))


def run_of(record: StudiedScene, case: Case, solver: str, setting: float, effort: Effort,
           timed: bool = True) -> peers.PeerRun:
    """Run a registered solver or another program, repeatedly if `timed`; time a solver's first call, which compiles,
    separately.

    Raises
    ------
    peers.Failed
        The program gave no result, or stability of an explicit method would hold its steps too short.
    """
    name, _, method = solver.partition(" ")
    if solver in effort.peers:
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
    if solver not in record.warm_up:
        (record.warm_up[solver],), _ = repeated(
            lambda: solve(case.system, duration=1e-3 * case.system.cycle, solver=solver), 1)
    used, run = repeated(lambda: solve(case.system, cycles=case.cycles, solver=solver, **options).raise_for_status(),
                         REPEATS if timed else 1, effort.patience)
    return peers.PeerRun(run.solved_cycles.section, run.solved_cycles.largest, min(used), max(used),
                         run.statistics.steps)


def fastest_results(record: StudiedScene, target: float) -> dict[str, PrecisionResult]:
    """Return for each solver the fastest result with all three errors at most `target`."""
    rows = [row for row in record.results if row.largest_error <= target]
    return {name: min((row for row in rows if row.solver == name), key=lambda row: row.seconds)
            for name in dict.fromkeys(row.solver for row in rows)}


def long_run(record: StudiedScene, case: Case, effort: Effort) -> None:
    """Time a long run, in which the cost of a call is negligible, at the fastest setting with errors up to TARGET."""
    best = fastest_results(record, TARGET)
    for solver in LONG_RUN if case.name.split(",")[0] in LONG_RUN_SCENES else ():
        part = 1 if solver not in effort.peers else 20 if solver.endswith("LSODA") else 5
        if solver in best:
            longer = replace(case, cycles=effort.long_cycles // part)
            try:
                run = run_of(record, longer, solver, best[solver].setting, effort)
            except peers.Failed:
                continue
            record.long_run.append(LongRun(solver, best[solver].setting, longer.cycles,
                                           100.0 * run.seconds / longer.cycles))


def took_part(records: Sequence[StudiedScene]) -> dict[str, str]:
    """Return for each other program that it joined, or the reason why it did not."""
    out = {}
    for name in ("numbalsoda", "CVODE", "XPPAUT"):
        joined = any(row.solver.startswith(name) for record in records for row in record.results)
        missing = [row.why for record in records for row in record.omitted if row.solver.startswith(name)]
        out[name] = "joined" if joined else (missing[0] if missing else "not run")
    return out


def machine() -> str:
    """Name the processor and the versions that times depend on."""
    versions = environment()
    packages = ", ".join(f"{name} {versions[name]}" for name in ("numpy", "scipy", "numba"))
    return f"{versions['processor']} (Python {versions['python']}, {packages})"


def precision_tables(report: PrecisionReport) -> str:
    """Return the tables of a report: relative run times, and for each scene the fastest settings and the failures."""
    others = "; ".join(f"{name}: {why}" for name, why in report.peers.items())
    lines = [f"Measured on {report.machine}. Other programs: {others}.",
             *["", "**Interrupted: this report is not complete.**"] * (not report.complete)]
    for law, engine in ENGINES.items():
        scenes = [record for record in report.scenes if record.law == law]
        best = [fastest_results(record, TARGET) for record in scenes]
        names = dict.fromkeys(row.solver for record in scenes for row in record.results if row.solver != engine)
        rows = []
        for name in names:
            ratios = [of[name].seconds / of[engine].seconds for of in best if name in of and engine in of]
            rows.append((name, _range(ratios), str(len(ratios))))
        if rows:
            head = f"run time at an error of {TARGET:g}, relative to `{engine}`"
            lines += ["", *markdown_table((head, "least to most", f"scenes of {len(scenes)}"), rows, "---:", "---")]
    for record in report.scenes:
        lines += ["", *_scene_tables(record)]
    return "\n".join(lines) + "\n"


def _scene_tables(record: StudiedScene) -> list[str]:
    """Return the tables of one scene."""
    best, steady = [fastest_results(record, target) for target in TARGETS], record.steady
    moves = (f"period {steady.period}, {steady.max_slip_speed:.5g} rad/s, closed by SciPy to {steady.closure:.1e}"
             if steady.max_slip_speed is not None else "no period up to 16")
    lines = [f"## {record.scene}", "", f"{record.description}. References: {' and '.join(record.reference.solvers)}; "
             f"floor {record.reference.floor:.1e}. Steady state after {steady.cycles} cycles: {moves}.", ""]
    names = [name for name in dict.fromkeys(row.solver for row in record.results) if name in best[0]]
    long = {row.solver: _digits(1e4 * row.seconds_per_100_cycles, 3) for row in record.long_run}
    lines += markdown_table(
        ("us a cycle, at an error of", *(f"{target:g}" for target in TARGETS), "long run, 1e-06"),
        [(name, *(_digits(1e6 * of[name].seconds / record.cycles, 3) if name in of else "-" for of in best),
          long.get(name, "")) for name in names], "---:", "---")
    return [*lines, *[""] * bool(record.omitted),
            *(f"- without a result: {row.solver} at {row.setting:.3g}: {row.why}" for row in record.omitted)]


def _range(values: Sequence[float]) -> str:
    """Return least and largest value with two digits; a dash for none."""
    low, high = (_digits(of(values, default=math.nan), 2) for of in (min, max))
    return "-" if not values else low if low == high else f"{low} to {high}"


def _digits(value: float, count: int) -> str:
    """Return a number with some digits and without an exponent."""
    return f"{float(f'{value:.{count}g}'):.12g}"


def scene_line(record: StudiedScene) -> str:
    """Return the fastest settings of a scene as a line for a terminal."""
    best = sorted(fastest_results(record, TARGET).items(), key=lambda item: item[1].seconds)
    times = ", ".join(f"{name} {1e6 * row.seconds / record.cycles:.3g}" for name, row in best)
    return (f"{record.scene}: floor {record.reference.floor:.1e}; us a cycle with errors up to {TARGET:g}: "
            f"{times or 'none'}")
