"""What the paper's claims are judged by: sweeps and single motions, worked out once at a given tolerance."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.summary import Summary, summarise_cycles
from tcc_sim.model.parameters import System
from tcc_sim.model.quantity import Value
from tcc_sim.paper.catalogue import OMEGA_N, STATIC, paper_system
from tcc_sim.solvers import solve
from tcc_sim.sweeps.point import Plan, solve_point
from tcc_sim.sweeps.sweep import Curve, Sweep, sweep_curves
from tcc_sim.trajectory import State, Status, Trajectory

CONFIRMED, NOT_CONFIRMED, DEPENDS = "confirmed", "not confirmed", "depends"
FREQUENCY, KINETIC = "engine.frequency", "friction.kinetic_coefficient"
UNITS = {FREQUENCY: OMEGA_N, KINETIC: STATIC}
"""Values of the keys at 1 on their normalised axes; the other keys have none."""
JUMP = 0.08
"""Least size of a jump, as a part of the largest value of its curve."""
BISECTIONS = 8
"""Halvings of the interval in which a jump lies; a continuous curve loses most of its change on the way."""
CYCLES, DISCARD = 150, 50
"""The paper's rule."""
LATER = 500
"""Further cycles for a motion that the paper's rule leaves before its section repeats."""
LAST = 100
"""Cycles at the end of a long run in which its period is looked for."""
STEADY = 3000
"""Cycles from (13) after which the motion of Fig. 2 is taken for its steady state."""

Floats = NDArray[np.float64]
Values = Mapping[str, Value]


@dataclass(frozen=True)
class Finding:
    """A claim judged: what was computed, the verdict by the criterion, and why where it is not plainly confirmed.

    motions : where motions coexist, the stable ones, each with its ends and where the initial state leads to it
    """

    figure: str
    claim: str
    criterion: str
    values: dict[str, Any]
    verdict: str
    why: str = ""
    motions: tuple[dict[str, Any], ...] = ()


@dataclass
class Evidence:
    """Sweeps and motions of Sections 5 and 6, kept once they are worked out.

    rtol : tolerance of the smoothed engine
    jobs : threads; None takes all cores
    progress : show a bar for every sweep on a terminal
    """

    rtol: float
    jobs: int | None = None
    progress: bool = False
    _kept: dict[str, Any] = field(default_factory=dict)
    _settled: dict[tuple[Curve, Plan], NDArray[np.int64]] = field(default_factory=dict)

    def curves(self, rows: Sequence[Values], axis: Floats, *, over: str = FREQUENCY, direction: str = "cold",
               lyapunov: bool = False, damping: bool = False) -> list[Sweep]:
        """A sweep for every row of scene keys, over omega/omega_n, mu_k/mu_s, or the values of another key."""
        scaled = axis * UNITS.get(over, 1.0)
        key = tuple(float(x) for x in (np.minimum(scaled, STATIC) if over == KINETIC else scaled))
        names = [json.dumps([sorted(row.items()), key, over, direction, lyapunov, damping]) for row in rows]
        missing = [k for k, name in enumerate(names) if name not in self._kept]
        if missing:
            plan = self.plan(rows[0], direction=direction, lyapunov=lyapunov, damping=damping)
            found = sweep_curves([Curve(paper_system(rows[k]), over, key) for k in missing], plan, jobs=self.jobs,
                                 progress=self.progress)
            self._kept.update({names[k]: sweep for k, sweep in zip(missing, found)})
        return [self._kept[name] for name in names]

    def plan(self, row: Values, *, direction: str = "cold", lyapunov: bool = False, damping: bool = False) -> Plan:
        """The paper's rule at this tolerance; the exact engine of the set-valued law has its own."""
        return Plan(cycles=CYCLES, discard=DISCARD, direction=direction, rtol=self._rtol(paper_system(row)),
                    lyapunov=lyapunov, damping=damping)

    def motion(self, row: Values, *, lyapunov: bool = False) -> dict[str, Any]:
        """The record of one motion from the initial state (13); its period is that of the settled motion."""
        name = json.dumps([sorted(row.items()), lyapunov])
        if name not in self._kept:
            point = solve_point(paper_system(row), 0.0, self.plan(row, lyapunov=lyapunov))
            record = point.as_record()
            self._kept[name] = {**record, "period": self._period(paper_system(row), record)}
        found: dict[str, Any] = self._kept[name]
        return found

    def periods(self, sweep: Sweep) -> NDArray[np.int64]:
        """(n,) periods of the settled motions, 0 for none up to 16, -1 where the point failed.

        What has not settled by the paper's rule goes on for LATER cycles: a transient is neither periodic nor not.
        """
        name = (sweep.curve, sweep.plan)
        if name not in self._settled:
            records = sweep.records

            def at(k: int) -> int:
                record = records[k]
                found = None if record is None else self._period(sweep.curve.at(k), record)
                return -1 if found is None else found

            with ThreadPoolExecutor(self.jobs) as threads:
                self._settled[name] = np.array(list(threads.map(at, range(len(records)))), dtype=np.int64)
        return self._settled[name]

    def slips(self, sweep: Sweep) -> NDArray[np.bool_]:
        """(n,) whether the settled motion slips; what has not settled by the paper's rule goes on, as for `periods`."""
        def at(k: int) -> bool:
            record = sweep.records[k]
            if record is None or record.get("settled", True):
                return record is not None and record["regime"] != "stick"
            system = sweep.curve.at(k)
            found = later(system, record, self._rtol(system))
            return found is not None and found[0].regime != "stick"

        with ThreadPoolExecutor(self.jobs) as threads:
            return np.array(list(threads.map(at, range(len(sweep.records)))), dtype=bool)

    def _period(self, system: System, record: dict[str, Any]) -> int | None:
        """The period of a record, from further cycles where its section does not repeat yet."""
        period: int | None = record["period"]
        if period is None or record.get("settled", True):
            return period
        found = later(system, record, self._rtol(system))
        return -1 if found is None else found[0].period

    def _rtol(self, system: System) -> float | None:
        """The tolerance of the smoothed engine; the exact engine of the set-valued law has its own."""
        return None if system.friction.law == "set_valued" else self.rtol

    def first_cycles(self, row: Values, cycles: int, samples: int) -> Trajectory:
        """Some cycles with samples from the initial state (13)."""
        system = paper_system(row)
        return solve(system, cycles=cycles, samples_per_cycle=samples, rtol=self._rtol(system)).raise_for_status()

    def last_cycles(self, row: Values, cycles: int, samples: int) -> Trajectory:
        """Some cycles with samples, after those of the paper's rule."""
        system = paper_system(row)
        before = solve(system, cycles=CYCLES, rtol=self._rtol(system)).raise_for_status()
        return solve(system, cycles=cycles, samples_per_cycle=samples, start_cycle=CYCLES, state=before.final,
                     rtol=self._rtol(system)).raise_for_status()

    def steady(self, row: Values) -> dict[str, Any]:
        """`period`, `max_slip_speed` (rad/s) and `settled` of the last cycles of a long run from (13)."""
        system = paper_system(row)
        run = solve(system, cycles=STEADY, rtol=self._rtol(system)).raise_for_status()
        assert run.cycles is not None
        found = summarise_cycles(run.cycles[STEADY - LAST:], system.cycle, first=STEADY - LAST)
        return {"period": found.period, "max_slip_speed": found.max_slip_speed, "settled": found.settled}

    def maximum(self, row: Values, ratio: float) -> float:
        """The largest slip speed at one frequency ratio, NaN where it could not be solved."""
        found = self.motion({**row, FREQUENCY: ratio * OMEGA_N})["max_slip_speed"]
        return float("nan") if found is None else float(found)

    def jumps(self, row: Values, axis: Floats) -> list[tuple[float, float]]:
        """(omega/omega_n, change of the largest slip speed) at every true jump of a curve from cold starts.

        Where neighbours differ by more than JUMP of the curve's largest value, the interval is halved BISECTIONS times,
        always towards the larger change; what keeps most of its change on an interval 2^-8 as wide is a jump.
        """
        values = self.curves([row], axis)[0].column("max_slip_speed")
        size = float(np.nanmax(values))
        found = []
        for k in steep(values):
            a, b, fa, fb = float(axis[k]), float(axis[k + 1]), float(values[k]), float(values[k + 1])
            first = abs(fb - fa)
            for _ in range(BISECTIONS):
                middle = 0.5 * (a + b)
                fm = self.maximum(row, middle)
                if abs(fm - fa) >= abs(fb - fm):
                    b, fb = middle, fm
                else:
                    a, fa = middle, fm
            if abs(fb - fa) > 0.5 * first and abs(fb - fa) > JUMP * size:
                found.append((0.5 * (a + b), fb - fa))
        return found


def later(system: System, record: Mapping[str, Any], rtol: float | None = None) -> tuple[Summary, State] | None:
    """The motion of a record LATER cycles on: what its last LAST cycles are, and its state behind them.

    None where it could not be solved that far.
    """
    first = record["final_cycle"]
    run = solve(system, cycles=LATER, start_cycle=first, state=State(*record["final"]), rtol=rtol)
    if run.status is not Status.DONE or run.cycles is None:
        return None
    return summarise_cycles(run.cycles[LATER - LAST:], system.cycle, first=first + LATER - LAST), run.final


def steep(values: Floats) -> NDArray[np.int64]:
    """Where neighbours differ by more than JUMP of the largest value, as a jump or as a steep rise."""
    return np.flatnonzero(np.abs(np.diff(values)) > JUMP * float(np.nanmax(values)))


def sticks(sweep: Sweep) -> NDArray[np.bool_]:
    """(n,) whether the motion is pure stick."""
    return np.array([r is not None and r["regime"] == "stick" for r in sweep.records])


def slips_at(sweep: Sweep) -> Floats:
    """Frequency ratios at which the clutch slips at all."""
    slipping: Floats = sweep.values[~sticks(sweep)] / OMEGA_N
    return slipping


def share_where(condition: Any, among: Any) -> float:
    """The part of the cases `among` in which `condition` holds; 1 where there are none."""
    return float(condition[among].mean()) if among.any() else 1.0


def judged(value: bool, partly: bool = False) -> str:
    """The verdict of a criterion that holds, holds in part, or does not."""
    return CONFIRMED if value else DEPENDS if partly else NOT_CONFIRMED


def with_kinetic(ratio: float, row: Values | None = None) -> dict[str, Value]:
    """A row with mu_k = ratio mu_s."""
    return {**(row or {}), KINETIC: ratio * STATIC}


__all__ = ["CONFIRMED", "DEPENDS", "NOT_CONFIRMED", "Evidence", "Finding", "judged", "later", "share_where",
           "slips_at", "steep", "sticks", "with_kinetic"]
