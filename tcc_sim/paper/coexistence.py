"""Where a map of cold starts shows one of several motions: those reached from a neighbour's state instead of (13)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from tcc_sim.paper.evidence import JUMP, steep
from tcc_sim.paper.figure_results import Coexisting, Reached
from tcc_sim.sweeps.point import handed_over, solve_point
from tcc_sim.sweeps.sweep import Sweep


def coexisting(sweep: Sweep, jobs: int | None = None) -> list[Coexisting]:
    """The motions that a neighbour's last state leads to where they differ from those of the cold start.

    Looked for at both sides of every change of more than JUMP of the curve's largest value between neighbours that both
    have a period: the scatter of an aperiodic motion's maximum is no other motion.
    """
    largest = sweep.column("max_slip_speed")
    periods = [0 if p is None or p.summary is None else p.summary.period for p in sweep.points]
    size = float(np.nanmax(largest))
    pairs = [(here, there) for k in steep(largest) for here, there in ((int(k), int(k) + 1), (int(k) + 1, int(k)))
             if periods[here] and periods[there]]

    def follow(pair: tuple[int, int]) -> Coexisting | None:
        here, there = pair
        neighbour = sweep.points[there]
        assert neighbour is not None
        plan = replace(sweep.plan, section_points=0, damping=False, lyapunov=False)
        system = sweep.curve.at(here)
        start = handed_over(sweep.curve.at(there), neighbour.end, system)
        point = solve_point(system, sweep.curve.values[here], plan, start)
        found = point.summary
        if found is None or not found.period or abs(found.max_slip_speed - largest[here]) <= JUMP * size:
            return None
        return Coexisting(here, sweep.curve.values[here], float(largest[here]), periods[here],
                          Reached(found.max_slip_speed, found.period), stands_out(largest, here, JUMP * size))

    with ThreadPoolExecutor(jobs) as threads:
        rows = [row for row in threads.map(follow, pairs) if row is not None]
    return sorted(rows, key=lambda row: row.index)


def stands_out(values: np.ndarray, k: int, least: float) -> bool:
    """Whether a value lies above both of its neighbours, or below both, by more than `least`."""
    if not 0 < k < len(values) - 1:
        return False
    left, right = values[k] - values[k - 1], values[k] - values[k + 1]
    return bool(left * right > 0.0 and min(abs(left), abs(right)) > least)
