"""Error against run time for every registered solver and for other programs, in the manner of SciMLBenchmarks.

Every solver runs over a ladder of tolerances or steps on each scene. Errors of the final state, of the stroboscopic
section and of each cycle's largest slip speed are relative to SciPy references of `references.py`; a fourth error is
that of the steady state after a long run. The time is the least CPU time of repeated runs, after a first run that
compiles. Failures are listed with their reasons.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tcc_sim.analysis.periodicity import periodicity
from tcc_sim.errors import TccError
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.solvers.comparison.runge_kutta import REACH, stick_rate
from tcc_sim.study.benchmarks import peers
from tcc_sim.study.benchmarks.peers import repeated
from tcc_sim.study.benchmarks.precision_report import (
    TARGET,
    LongRun,
    Omitted,
    PrecisionResult,
    References,
    SteadyState,
    StudiedScene,
    fastest_results,
)
from tcc_sim.study.benchmarks.references import Reference, Unfinished, disagreement, errors, reference
from tcc_sim.trajectory import Cycles, Floats, State

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
                    replace(self.system, {"friction.law": "set_valued"}), self.cycles)

    def settled(self) -> Case:
        """Return the case with a horizon that begins after SETTLING cycles, by the engine at its tightest tolerance."""
        engine, rtol = TIGHTEST[self.system.friction.law]
        run = solve(self.system, cycles=SETTLING, solver=engine, rtol=rtol)
        return dataclasses.replace(self, system=State.of(run.solved_cycles.section[-1]).starting(self.system),
                                   scene=self.system)


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
    steep = replace(base, {"friction.kinetic_coefficient": 0.15, "engine.mean_torque": 100.0,
                           "engine.torque_amplitude": 400.0})
    smoothed = [
        Case("fig02", "stick-slip of Fig. 2, mu_s/mu_k = 1.25", base, effort.cycles),
        Case("minimal", "mu_k = mu_s, constant pressure", fewest, effort.cycles),
        Case("steep", "mu_s/mu_k = 2, Tm = 100 N m, Tp = 400 N m, else fig02", steep, effort.cycles),
        Case("stiff", "sigma = 1e4 s/rad, else fig02", replace(base, {"friction.smoothing": 1e4}), effort.cycles)]
    wanted = [case for case in (*smoothed, *(case.set_valued() for case in smoothed[:3]))
              if not effort.scenes or case.name in effort.scenes]
    settled = [case.settled() for case in wanted]
    return [*settled, *(dataclasses.replace(case, name=f"{case.name}{FROM_START}") for case in wanted[:1]
                        if not effort.scenes)]


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


def steady_error(section: Floats, largest: Floats, expected: float) -> float:
    """Return the error of the largest slip speed over the last cycles, relative to the reference's."""
    return abs(steady_of(section, largest)[1] / expected - 1.0)


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
        run = _peer(case, solver, setting) if solver in effort.peers else _registered(record, case, solver, setting,
                                                                                      effort)
        deviation = errors(run.section, run.largest, truth)
        if not max(deviation) <= WRONG:
            raise peers.Failed(f"wrong: its largest relative error is {max(deviation):.2g}")
        steady = _steady(record, case, solver, setting, run.seconds, effort)
    except (peers.Failed, TccError) as error:
        record.omitted.append(Omitted(solver, setting, str(error)))
        return
    record.results.append(PrecisionResult(solver, setting, *deviation, steady, run.seconds, run.slowest, run.steps))


def _steady(record: StudiedScene, case: Case, solver: str, setting: float, seconds: float,
            effort: Effort) -> float | None:
    """Return the error of the steady state; None without a reference or if it would take too long."""
    expected = record.steady.max_slip_speed
    longer = dataclasses.replace(case, cycles=effort.steady_cycles, system=case.unsettled)
    if (solver not in STEADY_SOLVERS or expected is None
            or seconds * longer.cycles / case.cycles > LONGEST_STEADY * effort.longest):
        return None
    if solver in effort.peers:
        run = _peer(longer, solver, setting, repeats=0)  # Its error counts, not its time.
        return steady_error(run.section, run.largest, expected)
    options: dict[str, Any] = {SOLVERS[solver].setting: setting}
    cycles = solve(longer.system, cycles=longer.cycles, solver=solver, **options).solved_cycles
    return steady_error(cycles.section, cycles.largest, expected)


def _peer(case: Case, solver: str, setting: float, repeats: int = 5) -> peers.PeerRun:
    """Repeat runs of another program."""
    name, _, method = solver.partition(" ")
    if name == "XPPAUT":
        return peers.xppaut(case.system, method, setting, case.cycles, repeats)
    if name == "CVODE":
        return peers.cvode(case.system, case.cycles, setting, repeats)
    if name == "numbalsoda":
        return peers.numbalsoda(case.system, case.cycles, setting, repeats)
    return peers.bare_lsoda(case.system, case.cycles, setting, repeats)


def _registered(record: StudiedScene, case: Case, solver: str, setting: float, effort: Effort) -> peers.PeerRun:
    """Repeat runs of a registered solver; time its first call, which compiles, separately."""
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

    used, result = repeated(lambda: solve(case.system, cycles=case.cycles, solver=solver, **options).raise_for_status(),
                            REPEATS, effort.patience)
    cycles = result.solved_cycles
    return peers.PeerRun(cycles.section, cycles.largest, min(used), max(used), result.statistics.steps)


def long_run(record: StudiedScene, case: Case, effort: Effort) -> None:
    """Time a long run, in which the cost of a call is negligible, at the fastest setting with errors up to TARGET."""
    best = fastest_results(record, TARGET)
    for solver in LONG_RUN:
        if solver not in best or case.name.split(",")[0] not in LONG_RUN_SCENES:
            continue
        setting = best[solver].setting
        if solver in effort.peers:
            longer = dataclasses.replace(case, cycles=effort.long_cycles // (20 if solver.endswith("LSODA") else 5))
            try:
                run = _peer(longer, solver, setting)
            except peers.Failed:
                continue
        else:
            longer = dataclasses.replace(case, cycles=effort.long_cycles)
            run = _registered(record, longer, solver, setting, effort)
        record.long_run.append(LongRun(solver, setting, longer.cycles, 100.0 * run.seconds / longer.cycles))
