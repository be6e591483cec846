"""`figure --branches`: the branches of periodic motions behind a figure's points, and what each of its jumps is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from tcc_sim.analysis.summary import summarise_cycles
from tcc_sim.model.parameters import System
from tcc_sim.paper.evidence import JUMP, LAST, LATER
from tcc_sim.solvers import solve
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.studies.bifurcations import Bifurcation
from tcc_sim.studies.driveline_map import DrivelineMap
from tcc_sim.studies.jumps import jumps_of
from tcc_sim.studies.shooting import Window
from tcc_sim.studies.survey import Seen, station_of, survey
from tcc_sim.studies.sweep import Sweep
from tcc_sim.trajectory import State, Status

STICK_BORDER = "stick_border"
CREEP = 3.0
"""Largest slip speed, in those up to which law (7) counts as stick, at which a motion still creeps in stick."""
SMOOTH_ENDS = ("fold", "period_doubling", "neimark_sacker", "branch_point")


def seen_in(sweep: Sweep) -> list[Seen]:
    """The motions of a sweep; what has not settled within its cycles goes on for LATER more, as the claims have it."""
    return [seen for k in range(len(sweep.curve.values)) if (seen := _seen(sweep, k)) is not None]


def _seen(sweep: Sweep, k: int) -> Seen | None:
    """One motion of a sweep, settled where it settles at all."""
    value, record = sweep.curve.values[k], sweep.records[k]
    if record is None or record["max_slip_speed"] is None:
        return None
    if record.get("settled", True):
        return Seen(value, np.array(record["final"]), record["final_cycle"], record["period"], record["max_slip_speed"])
    system, first = sweep.curve.at(k), record["final_cycle"]
    run = solve(system, cycles=LATER, start_cycle=first, state=State(*record["final"]))
    if run.status is not Status.DONE or run.cycles is None:
        return None
    found, final = summarise_cycles(run.cycles[LATER - LAST:], system.cycle, first=first + LATER - LAST), run.final
    return Seen(value, np.array([final.slip_speed, final.plate_angle, final.plate_speed]), first + LATER,
                found.period if found.settled else 0, found.max_slip_speed)


def motions_behind(sweeps: Sequence[Sweep], progress: bool = False) -> list[dict[str, Any]]:
    """Branches, bifurcations and jumps behind sweeps of one system, for each of them.

    Parameters
    ----------
    sweeps : over the same values of one key, in different directions
    progress : show a count of points on a terminal

    Returns
    -------
    For every sweep `branches` and `bifurcations` as `continue --json` has them, and `jumps`: `value`, the two values it
    is `between`, `max_slip_speed` before and after, `cause`, and the number of its `bifurcation`.
    """
    curve = sweeps[0].curve
    of = DrivelineMap(curve.system, (curve.key,))
    found = [seen_in(sweep) for sweep in sweeps]
    window = Window(min(curve.values), max(curve.values))
    with counted(progress) as tick:
        branches = survey(of, window, curve.key, [s for row in found for s in row], tick)
    bifurcations = [f for branch in branches for f in branch.bifurcations]
    shown: dict[str, Any] = {"branches": [b.as_json() for b in branches],
                             "bifurcations": [f.as_json() for f in bifurcations]}
    out = []
    for sweep, row in zip(sweeps, found):
        forward = sorted(row, key=lambda s: s.value)
        jumps = []
        for jump in jumps_of(forward, branches, JUMP, of.forcing_period):
            entry = jump.as_json(bifurcations)
            if jump.found is not None and creeps(jump.found, sweep.curve.system):
                entry["cause"] = STICK_BORDER
            jumps.append(entry)
        out.append({**shown, "jumps": jumps})
    return out


def creeps(found: Bifurcation, system: System) -> bool:
    """Whether a bifurcation of the smoothed law is the end of stick: its motion still creeps."""
    if system.friction.law != "smoothed" or found.kind not in SMOOTH_ENDS:
        return False
    limit = stick_speed_of(terms_of(system))
    return math.isfinite(limit) and found.station.orbit.seen.largest <= CREEP * limit


def orbit_behind(system: System, final: State, cycle: int, period: int, largest: float) -> dict[str, Any] | None:
    """The periodic orbit at a settled motion, with the names of `continue --json`; None where it has no period."""
    omega = system.engine.frequency
    of = DrivelineMap(system, ("engine.frequency",))
    state = np.array([final.slip_speed, final.plate_angle, final.plate_speed])
    station = station_of(of, Window(0.5 * omega, 1.5 * omega), Seen(omega, state, cycle, period, largest)) if period else None
    return None if station is None else {"period": station.orbit.period, **station.orbit.as_json()}


@contextmanager
def counted(progress: bool) -> Iterator[Callable[[Any], None]]:
    """A function to call with every point; it moves a count where that is wanted and standard error is a terminal."""
    from tqdm import tqdm

    with tqdm(disable=None if progress else True, unit="point", leave=False) as bar:
        def tick(station: Any) -> None:
            bar.set_postfix_str(f"{station.value:.6g}, period {station.orbit.period}", refresh=False)
            bar.update()

        yield tick


