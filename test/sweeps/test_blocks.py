"""Runs that are judged at once get the verdicts and figures that each gets alone."""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np
import pytest

from tcc_sim.analysis.steady.summary import CycleTimes, summarise_cycles
from tcc_sim.model.parameters import replace
from tcc_sim.scene import system_of
from tcc_sim.sweeps.simulation import Plan
from tcc_sim.sweeps.sweep import solve_point, solve_points, summaries_of
from tcc_sim.trajectory import Cycles, Loads, Runs

N = 100
RANDOM = np.random.default_rng(5)


def run(points, stick=0.0, low=None):
    """Cycles with these section points, (N + 1, 3), and extremes about them."""
    high = np.maximum(points[:-1, 0], points[1:, 0]) + 0.5
    low = np.minimum(points[:-1, 0], points[1:, 0]) - 0.5 if low is None else low
    loads = Loads(*(np.abs(RANDOM.normal(size=N)) for _ in range(6)))
    return Cycles(points, high, low, np.full(N, stick), loads)


def orbit(period, noise=0.0, decay=0.0, growth=0.0):
    """A motion with a period that settles or departs."""
    n = np.arange(N + 1)
    base = RANDOM.uniform(1.0, 2.0, (period, 3))[n % period]
    shape = decay ** n if decay else growth ** (n - N) if growth else np.zeros(N + 1)
    return run(base + 0.3 * shape[:, None] * np.array([1.0, 0.5, -0.7]) + noise * RANDOM.normal(size=(N + 1, 3)))


def drifting(rate):
    """Slip that grows."""
    points = np.stack([20.0 + rate * np.arange(N + 1), np.full(N + 1, 0.1), np.full(N + 1, 5.0)], axis=1)
    return run(points, low=points[:-1, 0] - 0.1)


RUNS = [*(orbit(p) for p in range(1, 18)), *(orbit(p, noise=1e-9) for p in (1, 2, 3, 6, 12)),
        *(orbit(p, noise=5e-5) for p in (1, 2, 4)),
        *(orbit(p, decay=d) for p in (1, 2, 3) for d in (0.5, 0.9, 0.97, -0.95)),
        *(orbit(1, growth=g) for g in (1.05, 1.2, 1.5)), *(orbit(1, noise=x) for x in (1e-3, 0.3)), drifting(0.3),
        drifting(1e-7), run(np.zeros((N + 1, 3)), stick=1e-3), run(np.full((N + 1, 3), 1.0), stick=1e-3)]


def stacked(runs):
    """The same runs as one set of arrays."""
    values = np.array([[each.highest, each.lowest, each.stick_time, *each.loads.columns()] for each in runs])
    return Runs("", np.array([each.section for each in runs]), values, np.zeros(len(runs)), np.ones(len(runs), bool))


def test_every_kind_of_run_is_judged_as_alone():
    alone = [summarise_cycles(each, CycleTimes(0.05, 50, 2.5), dropped=50) for each in RUNS]
    together, sections = summaries_of(stacked(RUNS), [0.05] * len(RUNS), 50)
    assert [dataclasses.replace(each, section=[], section_states=None) for each in alone] == together
    assert [each.section_states for each in alone] == [[(x, v, w) for v, x, w in each.tolist()] for each in sections]
    kinds = Counter((each.period, each.settled, each.runaway) for each in alone)
    assert {(p, True, False) for p in range(1, 17)} <= kinds.keys()
    assert {(1, False, False), (0, False, True), (0, False, False)} <= kinds.keys()


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
@pytest.mark.parametrize("plan", [Plan(cycles=90, discard=40, section_points=5), Plan(cycles=90, discard="auto")],
                         ids=["fixed", "auto"])
def test_points_in_a_row_are_those_solved_alone(law, plan):
    """Frequencies, amplitudes and means that bring runaways, stick, settled and unsettled motions; one fails."""
    z = np.random.default_rng(2)
    scene = replace(system_of("chaos"), {"friction.law": law})
    systems = [replace(scene, {"engine.frequency": float(z.uniform(40.0, 300.0)),
                               "engine.torque_amplitude": float(z.uniform(10.0, 400.0)),
                               "engine.mean_torque": float(z.uniform(100.0, 600.0))}) for _ in range(24)]
    values = [float(k) for k in range(len(systems))]
    alone = [solve_point(system, value, plan).as_record() for system, value in zip(systems, values)]
    together = [point.as_record() for point in solve_points(systems, values, plan, None)]
    for record in (*alone, *together):
        for part in (record, record.get("summary") or {}):
            part.pop("elapsed_s", None)
    assert repr(together) == repr(alone)
