"""Motions of sweeps as branches start from them: solved over whole common periods, or continued until they settle."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from given import record

from tcc_sim.study.paper import branches_behind
from tcc_sim.study.paper.branches_behind import RUNS, seen_in
from tcc_sim.study.paper.catalogue import paper_system
from tcc_sim.sweeps.steady_state import Start
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep
from tcc_sim.trajectory import Cycles, State


def sweep_of(*points: Any, **keys: Any) -> Sweep:
    curve = Curve(paper_system(keys), "engine.mean_torque", tuple(100.0 + k for k in range(len(points))))
    return Sweep(curve, Plan(), list(points), 0.0)


@pytest.mark.parametrize(("keys", "period", "cycles"), [
    ({}, 1, 1), ({}, 3, 3), ({"pressure.amplitude": 5e4, "pressure.frequency_ratio": 0.5}, 3, 6),
    ({"pressure.amplitude": 5e4, "pressure.frequency_ratio": 2 / 3}, 2, 6),
    ({"pressure.amplitude": 5e4, "pressure.frequency_ratio": 2.0**0.5}, 2, 2)])
def test_a_settled_motion_is_solved_over_its_periods_and_those_of_the_load(keys: Any, period: int, cycles: int,
                                                                          monkeypatch: pytest.MonkeyPatch) -> None:
    """Its size is that of these cycles, since the maximum in the sweep may belong to a transient."""
    asked: list[Any] = []

    def solve(system: Any, **how: Any) -> Any:
        asked.append((system.engine.mean_torque, how["cycles"], how["start_cycle"]))
        n = how["cycles"]
        cycles = Cycles(np.zeros((n + 1, 3)), np.full(n, 7.0), np.full(n, -7.5), np.zeros(n))
        return SimpleNamespace(solved_cycles=cycles)

    monkeypatch.setattr(branches_behind, "solve", solve)
    seen, = seen_in(sweep_of(None, record(10.0, period), **keys))
    assert asked == [(101.0, cycles, 150)]
    assert (seen.value, seen.period, seen.cycle) == (101.0, period, 150)
    assert seen.amplitude == pytest.approx(7.5)


def test_an_aperiodic_motion_keeps_its_size() -> None:
    seen, = seen_in(sweep_of(record(10.0, 0)))
    assert (seen.period, seen.amplitude) == (0, 10.0)


@pytest.mark.parametrize(("periods", "runs", "found"), [
    ([2], 1, (2, 650)), ([0, 0, 1], 3, (1, 1650)), ([0] * 9, RUNS, (0, 2650)), ([0, None], 2, (0, 650)),
    ([None], 1, None)])
def test_a_motion_that_still_settles_is_continued(periods: Any, runs: int, found: Any,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    """500 cycles at a time, at most five times, or until it has a period or fails."""
    asked: list[int] = []

    def later(system: Any, start: Start) -> Any:
        asked.append(start.cycle)
        period = periods[len(asked) - 1]
        return None if period is None else (record(5.0, period).summary, Start(State(0.0, 0.0, 0.0), start.cycle + 500))

    monkeypatch.setattr(branches_behind, "later", later)
    monkeypatch.setattr(branches_behind, "approached", lambda curve, late, settled: late)
    seen = seen_in(sweep_of(record(10.0, 1, settled=False)))
    assert asked == [150 + 500 * k for k in range(runs)]
    assert [(s.period, s.cycle) for s in seen] == ([] if found is None else [found])
