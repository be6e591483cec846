"""What the paper's claims are judged by: sweeps and single motions, worked out once at a given tolerance."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.summary import summarise_cycles
from tcc_sim.model.parameters import System, Value
from tcc_sim.model.sines import common_cycles
from tcc_sim.paper.catalogue import OMEGA_N, STATIC, paper_system
from tcc_sim.paper.seen_motions import LAST, LATER, seen_in, surveyed
from tcc_sim.solvers import solve
from tcc_sim.studies.attractors import find_attractors, halton
from tcc_sim.studies.driveline_motion import DrivelineMotion
from tcc_sim.studies.point import Plan, solve_point
from tcc_sim.studies.stretches import End, Stretch, stretch_of, stretches_of
from tcc_sim.studies.survey import size_of
from tcc_sim.studies.sweep import Curve, Sweep, sweep_curves
from tcc_sim.trajectory import State, Status, Trajectory

CONFIRMED, NOT_CONFIRMED, DEPENDS = "confirmed", "not confirmed", "depends"
FREQUENCY, KINETIC = "engine.frequency", "friction.kinetic_coefficient"
SMOOTHING = "friction.smoothing"
UNITS = {FREQUENCY: OMEGA_N, KINETIC: STATIC}
"""Values of the keys at 1 on their normalised axes; the other keys have none."""
JUMP = 0.08
"""Least size of a jump, as a part of the largest value of its curve."""
BISECTIONS = 8
"""Halvings of the interval in which a jump lies; a continuous curve loses most of its change on the way."""
CYCLES, DISCARD = 150, 50
"""The paper's rule."""
SEEDS = 24
LONGEST = 2
"""Longest period, in those of the excitation, whose branches are followed."""
LOWEST, HIGHEST = np.array([-50.0, -0.1, -20.0]), np.array([200.0, 0.3, 20.0])
"""Points from which attractors are looked for: how many, and between which slip speeds, plate angles and speeds."""
STEADY = 3000
"""Cycles from (13) after which the motion of Fig. 2 is taken for its steady state."""

Floats = NDArray[np.float64]
Values = Mapping[str, Value]


@dataclass(frozen=True)
class Finding:
    """A claim judged: what was computed, the verdict by the criterion, and why where it is not plainly confirmed."""

    figure: str
    claim: str
    criterion: str
    values: dict[str, Any]
    verdict: str
    why: str = ""


@dataclass
class Evidence:
    """Sweeps and motions of Sections 5 and 6, kept once they are worked out.

    rtol : tolerance of the smoothed engine
    jobs : threads; None takes all cores
    progress : show a bar for every sweep on a terminal
    known : stable stretches of branches, which no tolerance changes, for several to share
    """

    rtol: float
    jobs: int | None = None
    progress: bool = False
    known: dict[str, list[Stretch]] = field(default_factory=dict)
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

    def stretches(self, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[Stretch]:
        """The stable stretches of the branches through the motions of cold starts and of sweeps up and down.

        Their parameter is that of `curves`. Orbits are solved at 1e-12, whatever the tolerance of the sweeps.
        """
        name = json.dumps([sorted(row.items()), axis.tolist(), over])
        if name not in self.known:
            sweeps = [self.curves([row], axis, over=over, direction=d)[0] for d in ("cold", "up", "down")]
            branches = surveyed(sweeps[0].curve, [s for sweep in sweeps for s in seen_in(sweep)], self.progress,
                                LONGEST)
            unit = UNITS.get(over, 1.0)
            values = sweeps[0].curve.values
            self.known[name] = stretches_of(branches, min(values), max(values), unit)
        return self.known[name]

    def reached(self, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[int | None]:
        """For every value the number of the stretch that the initial state (13) leads to; None where it is on none."""
        among, sweep = self.stretches(row, axis, over=over), self.curves([row], axis, over=over)[0]
        unit, seen = UNITS.get(over, 1.0), seen_in(sweep)
        base, size = common_cycles(sweep.curve.system), size_of(seen)
        at = {s.value: stretch_of(replace(s, value=s.value / unit), among, size, base) for s in seen}
        return [at.get(value) for value in sweep.curve.values]

    def told(self, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[str]:
        """Every stretch in words: what it is, where it begins and ends, and from where on (13) leads to it."""
        out = []
        on = self.reached(row, axis, over=over)
        for k, stretch in enumerate(self.stretches(row, axis, over=over)):
            at = [float(x) for x, found in zip(axis, on) if found == k]
            where = f"at {len(at)} of {len(axis)} values, {min(at):g} to {max(at):g}" if at else "nowhere"
            out.append(f"{stretch}; within {CYCLES + LATER} cycles (13) leads to it {where}")
        return out

    def ends(self, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[End]:
        """Where a stable motion ends in a jump, whatever was started from, in order."""
        found = {end.value: end for s in self.stretches(row, axis, over=over) for end in (s.low, s.high) if end.jumps}
        return [found[value] for value in sorted(found)]

    def heights(self, row: Values, axis: Floats) -> list[list[float]]:
        """For every frequency ratio the largest slip speed of every stable motion known, that from (13) among them."""
        among = self.stretches(row, axis)
        cold = self.curves([row], axis)[0].column("max_slip_speed")
        return [[float(c), *(h for s in among if math.isfinite(h := s.height(float(x))))] for x, c in zip(axis, cold)]

    def attractors(self, row: Values) -> list[tuple[int, float]]:
        """Period and largest slip speed of every attractor found from (13) and from points spread over states."""
        system = paper_system(row)
        i = system.initial
        spread = LOWEST + (HIGHEST - LOWEST) * halton(SEEDS, 3)
        own = np.array([i.slip_speed, i.plate_angle, i.plate_speed])
        found = find_attractors(DrivelineMotion(system), [own, *spread])
        return sorted((a.period, a.largest) for a in found)

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

    def _period(self, system: System, record: dict[str, Any]) -> int | None:
        """The period of a record, from further cycles where its section does not repeat yet."""
        period: int | None = record["period"]
        if period is None or record.get("settled", True):
            return period
        run = solve(system, cycles=LATER, start_cycle=record["final_cycle"], state=State(*record["final"]),
                    rtol=self._rtol(system))
        if run.status is not Status.DONE or run.cycles is None:
            return -1
        return summarise_cycles(run.cycles[LATER - LAST:], system.cycle, first=CYCLES + LATER - LAST).period

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


def words_of(ends: Sequence[End]) -> list[str]:
    """Ends in words."""
    return [str(end) for end in ends]


def ordered_shares(found: Sequence[Sequence[Sequence[float]]], curve: int, where: Any, *,
                   worst: bool = False) -> tuple[float, float]:
    """The part of the places at which one curve is the lowest of all (the highest), where any slips.

    Parameters
    ----------
    found : per curve and place the largest slip speeds of all stable motions there

    Returns
    -------
    The part at which it is so whichever motion there is on every curve, and at which it is so for some.
    """
    sign = -1.0 if worst else 1.0
    every, some, moving = [], [], []
    for row in zip(*found):
        own, others = [sign * h for h in row[curve]], [[sign * h for h in r] for k, r in enumerate(row) if k != curve]
        every.append(max(own) <= min(min(r) for r in others) + 0.05)
        some.append(min(own) <= min(max(r) for r in others) + 0.05)
        moving.append(max(max(r) for r in row) > 0.1)
    among = np.asarray(where) & np.array(moving)
    return share_where(np.array(every), among), share_where(np.array(some), among)


def share_where(condition: Any, among: Any) -> float:
    """The part of the cases `among` in which `condition` holds; 1 where there are none."""
    return float(condition[among].mean()) if among.any() else 1.0


def judged(value: bool, partly: bool = False) -> str:
    """The verdict of a criterion that holds, holds in part, or does not."""
    return CONFIRMED if value else DEPENDS if partly else NOT_CONFIRMED


def with_kinetic(ratio: float, row: Values | None = None) -> dict[str, Value]:
    """A row with mu_k = ratio mu_s."""
    return {**(row or {}), KINETIC: ratio * STATIC}


__all__ = ["CONFIRMED", "DEPENDS", "LATER", "NOT_CONFIRMED", "Evidence", "Finding", "judged", "ordered_shares",
           "share_where", "slips_at", "steep", "sticks", "with_kinetic", "words_of"]
