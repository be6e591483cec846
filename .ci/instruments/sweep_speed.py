"""Engine cycles per second on scenes of Fig. 4: the smoothed engine beside XPPAUT's CVODE at the same section error, in
the transient from the initial state and on the attractor, and a whole sweep.

`python .ci/instruments/sweep_speed.py` prints the table. Each program runs at its loosest tolerance with a section
error below ERROR over a few cycles, against a SciPy reference. Many cycles are timed, so that the cost of a call or of
a start does not count.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from tcc_sim.errors import NumericalFailure, TccError
from tcc_sim.model.parameters import System
from tcc_sim.output.tables import markdown_table
from tcc_sim.output.terminal import say
from tcc_sim.solvers import SOLVERS, solve
from tcc_sim.study.benchmarks import peers
from tcc_sim.study.benchmarks.peers import repeated
from tcc_sim.study.benchmarks.references import Reference, errors, reference
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, paper_system
from tcc_sim.sweeps.executors import cores
from tcc_sim.sweeps.progress import counted_bar
from tcc_sim.sweeps.sweep import Curve, Plan, sweep_curves

ERROR = 1e-6
"""The largest section error, relative to each signal's maximum, that a tolerance may leave."""
SETTLING = 600
"""Engine cycles after which a motion of Fig. 4 is on its attractor; steady motions and chaotic ones alike."""
STRETCHES = ("transient", "attractor")
ENGINE, PEER = "smoothed", "XPPAUT cvode"


class SpeedEffort(NamedTuple):
    """Extent of the measurement.

    frequencies : omega/omega_n of the scenes, for each mu_k/mu_s of Fig. 4
    values : frequencies of each curve of the whole sweep
    horizon : periods of excitation over which errors are taken; errors grow, since some motions of Fig. 4 are chaotic
    cycles : timed periods of excitation, as many as one point of a sweep takes
    repeats : number of runs; the least time counts
    ladder : tolerances; the first that is tight enough is timed
    """

    frequencies: tuple[float, ...] = (0.12, 0.2, 0.36)
    values: int = 200
    horizon: int = 6
    cycles: int = 150
    repeats: int = 5
    ladder: tuple[float, ...] = (1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8, 3e-9, 1e-9, 1e-10)


class SpeedRow(NamedTuple):
    """Speed of a solver in one of STRETCHES on a scene of Fig. 4, at one tolerance with its section error; without a
    tolerance that is tight enough, the reason.
    """

    kinetic_ratio: float
    frequency_ratio: float
    stretch: str
    solver: str
    setting: float = math.nan
    error: float = math.nan
    cycles_per_second: float = math.nan
    why: str = ""


class WholeSweep(NamedTuple):
    """A sweep over Fig. 4 at the default tolerance; `busy` is the CPU time over that of all cores."""

    points: int
    cycles: int
    cores: int
    seconds: float
    busy: float
    cycles_per_second_and_core: float


class SweepSpeed(NamedTuple):
    """Results, for the engine at its default tolerance too; `omitted` has the rows without a speed."""

    effort: SpeedEffort
    rows: list[SpeedRow]
    omitted: list[SpeedRow]
    sweep: WholeSweep


def sweep_speed(effort: SpeedEffort, done: Callable[[int, int, str], None]) -> SweepSpeed:
    """Measure; `done` is called with points done, points in all, and the name of the next."""
    points = [(series, ratio, stretch) for series in FIGURES[4].series
              for ratio in effort.frequencies for stretch in STRETCHES]
    rows, omitted = list[SpeedRow](), list[SpeedRow]()
    for count, (series, ratio, stretch) in enumerate(points):
        done(count, len(points) + 1, f"Fig. 4 at {ratio:g}, {stretch}")
        system = paper_system({**series.values, "engine.frequency": ratio * OMEGA_N})
        if stretch == "attractor":
            system = on_attractor(system)
        truth = reference(system, effort.horizon, "LSODA", 1e-12)
        for solver, ladder in ((ENGINE, effort.ladder), (ENGINE, (SOLVERS[ENGINE].default,)), (PEER, effort.ladder)):
            place = 1.0 / system.friction_ratio, ratio, stretch, solver
            try:
                setting, error = loosest(system, solver, ladder, truth)
                rows.append(SpeedRow(*place, setting, error, effort.cycles / _timed(system, solver, setting, effort)))
            except TccError as failed:
                omitted.append(SpeedRow(*place, why=str(failed)))
    done(len(points), len(points) + 1, "Fig. 4, whole sweep")
    whole = whole_sweep(effort)
    done(len(points) + 1, len(points) + 1, "")
    return SweepSpeed(effort, rows, omitted, whole)


def on_attractor(system: System) -> System:
    """The same system with its state after SETTLING periods of excitation as initial state."""
    return solve(system, cycles=SETTLING, solver=ENGINE, rtol=1e-10).raise_for_status().final.starting(system)


def loosest(system: System, solver: str, ladder: tuple[float, ...], truth: Reference) -> tuple[float, float]:
    """The first tolerance of the ladder with a section error below ERROR, and that error, else NumericalFailure."""
    least = math.inf
    for setting in ladder:
        result = errors(_run(system, solver, setting, len(truth.largest)), truth)[1]
        if result <= ERROR:
            return setting, result
        least = min(least, result)
    raise NumericalFailure(f"its error is at least {least:.1e}")


def _run(system: System, solver: str, setting: float, cycles: int) -> Any:
    """Section and largest slip speeds over some cycles."""
    if solver == PEER:
        return peers.xppaut(system, "cvode", setting, cycles, 0)
    return solve(system, cycles=cycles, solver=solver, rtol=setting).solved_cycles


def _timed(system: System, solver: str, setting: float, effort: SpeedEffort) -> float:
    """Least CPU time of the timed cycles, s."""
    if solver == PEER:
        return peers.xppaut(system, "cvode", setting, effort.cycles, 2).seconds
    return min(repeated(lambda: solve(system, cycles=effort.cycles, solver=solver, rtol=setting), effort.repeats)[0])


def whole_sweep(effort: SpeedEffort) -> WholeSweep:
    """A sweep over the four curves of Fig. 4 on all cores."""
    values = tuple(float(x) for x in np.linspace(*FIGURES[4].span, effort.values) * OMEGA_N)
    curves = [Curve(paper_system(series.values), "engine.frequency", values) for series in FIGURES[4].series]
    for curve in curves:
        solve(curve.at(0), cycles=1)
    wall, cpu, width = time.perf_counter(), time.process_time(), cores()
    sweeps = sweep_curves(curves, Plan(cycles=effort.cycles), jobs=width)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    cycles = int(sum(sweep.column("cycles").sum() for sweep in sweeps))
    return WholeSweep(effort.values * len(curves), cycles, width, wall, cpu / (wall * width), cycles / cpu)


Scenes = list[tuple[SpeedRow | None, SpeedRow | None, SpeedRow | None]]
"""For each scene the engine at its loosest tolerance and at its default one, and the peer."""


def speed_rows(result: SweepSpeed, stretch: str) -> Scenes:
    """The scenes of one stretch."""
    groups: dict[tuple[float, float], list[SpeedRow]] = {}
    for row in result.rows:
        if row.stretch == stretch:
            groups.setdefault(row[:2], []).append(row)
    out: Scenes = []
    for group in groups.values():
        engine, peer = ([row for row in group if row.solver == name] for name in (ENGINE, PEER))
        out.append((engine[0] if engine else None, engine[-1] if engine else None, peer[0] if peer else None))
    return out


def speeds(table: Scenes, place: int) -> list[float]:
    """The speeds in one column of a table."""
    return [row[place].cycles_per_second for row in table if row[place]]


def ratios(table: Scenes) -> list[float]:
    """Speeds of the engine relative to the peer."""
    return [loose.cycles_per_second / peer.cycles_per_second for loose, _, peer in table if loose and peer]


def speed_summary(result: SweepSpeed) -> list[str]:
    """The figures in a few sentences."""
    out = []
    for stretch in STRETCHES:
        table = speed_rows(result, stretch)
        where = "from the initial state" if stretch == "transient" else "on the attractor"
        out.append(f"{where}: {_range(speeds(table, 0))} periods of excitation a second and core at a section error of "
                   f"at most {ERROR:g} on {len(table)} scenes of Fig. 4, {_range(speeds(table, 1))} at the default "
                   "tolerance")
        if faster := ratios(table):
            out[-1] += (f"; XPPAUT's CVODE {_range(speeds(table, 2))} at the same error: {min(faster):.2g} to "
                        f"{max(faster):.2g} times as long")
    if not any(row.solver == PEER for row in result.rows):
        out.append(f"XPPAUT's CVODE did not take part: {next((row.why for row in result.omitted), 'not run')}")
    sweep = result.sweep
    return [*out, f"a sweep over Fig. 4, {sweep.points} points and {sweep.cycles} cycles: {sweep.seconds:.3g} s "
                  f"on {sweep.cores} cores, {100.0 * sweep.busy:.0f} % busy, "
                  f"{_round(sweep.cycles_per_second_and_core)} cycles a second and core with everything"]


def speed_section(result: SweepSpeed) -> list[str]:
    """The page's section on cycles per second on the scenes of Fig. 4."""
    lines = ["## Engine cycles a second, on the scenes of Fig. 4", "",
             f"Each program at its loosest tolerance with a section error of at most {ERROR:g} over "
             f"{result.effort.horizon} cycles, from the initial state and from a state on the attractor; the time is "
             f"that of {result.effort.cycles} cycles from there, on one core.", ""]
    for stretch in STRETCHES:
        head = (f"{stretch}: mu_k/mu_s", "omega/omega_n", "`smoothed`: cycles a second", "rtol", "error",
                "at the default rtol", "error", "XPPAUT cvode: cycles a second", "toler", "error", "ratio")
        cells = []
        for loose, default, peer in speed_rows(result, stretch):
            one = loose or peer
            cells.append((f"{one.kinetic_ratio:.3g}", f"{one.frequency_ratio:g}", *_cells(loose, True),
                          *_cells(default, False), *_cells(peer, True),
                          *([f"{x:.2g}" for x in ratios([(loose, default, peer)])] or ["-"])))
        lines += [*markdown_table(head, cells, "---:"), ""]
    left_out = [f"{row.solver} at {row.kinetic_ratio:.3g}, {row.frequency_ratio:g}, {row.stretch}: "
                f"{row.why}" for row in result.omitted]
    if left_out:
        lines += ["Omitted (mu_k/mu_s, omega/omega_n): " + "; ".join(left_out) + ".", ""]
    return [*lines, *(f"- {line[0].upper()}{line[1:]}." for line in speed_summary(result)), ""]


def _cells(row: SpeedRow | None, tolerance: bool) -> list[str]:
    """Cycles a second, the tolerance if requested, and the error."""
    if row is None:
        return ["-", "-", "-"] if tolerance else ["-", "-"]
    return [f"{row.cycles_per_second:.0f}", *([f"{row.setting:g}"] if tolerance else []), f"{row.error:.0e}"]


def _range(values: list[float]) -> str:
    """Least and largest."""
    return f"{_round(min(values))} to {_round(max(values))}" if values else "none"


def _round(value: float) -> str:
    """Two digits of a large number."""
    return f"{float(f'{value:.2g}'):.0f}"


def main() -> int:
    """Measure and print the section of Markdown."""
    with counted_bar("scene") as done:
        say("\n".join(speed_section(sweep_speed(SpeedEffort(), done))))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
