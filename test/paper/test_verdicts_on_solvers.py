"""Verdicts on the section, on smoothing, on the cost of the discontinuous solution, and on harmonic balance."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from given import Given

from tcc_sim.model.parameters import System
from tcc_sim.paper import claims_figure4
from tcc_sim.paper import claims_model as model
from tcc_sim.paper import claims_series as series_claims
from tcc_sim.paper.criteria import CONFIRMED, NOT_CONFIRMED
from tcc_sim.paper.evidence import Evidence
from tcc_sim.trajectory import Cycles


@pytest.mark.parametrize(("angle", "verdict"), [(0.1, CONFIRMED), (10.0, NOT_CONFIRMED)])
def test_the_section_varies_less_where_its_spread_over_its_size_is_smaller(angle, verdict) -> None:  # type: ignore
    """A slip speed that alternates by half of its mean beside a plate angle that alternates by `angle` of its own."""
    turn = np.arange(650) % 2 - 0.5
    section = np.stack([1.0 + turn, 2.0 + angle * turn, turn], axis=1)
    found = claims_figure4.section_varies_less(Given(runs=lambda system: SimpleNamespace(
        solved_cycles=SimpleNamespace(section=section))))
    assert found.verdict == verdict
    assert found.values["ratios"] == 51


@pytest.mark.parametrize(("slips", "verdict"), [
    ((36.0, 63.0, 63.7), CONFIRMED), ((36.0, 63.0, 36.0), NOT_CONFIRMED), ((63.7, 63.7, 63.7), NOT_CONFIRMED)])
def test_smoothing_is_uncertain_where_some_sigma_leads_elsewhere(slips, verdict) -> None:  # type: ignore
    """Made-up largest slip speeds for sigma = 50, 100, 1000 s/rad; 63.7 with law (6)."""
    def run(system: System) -> Any:
        exact = system.friction.law == "set_valued"
        size = 63.7 if exact else slips[(50.0, 100.0, 1000.0).index(system.friction.smoothing)]
        cycles = Cycles(np.zeros((2001, 3)), np.full(2000, size), np.zeros(2000), np.zeros(2000))
        return SimpleNamespace(solved_cycles=cycles)
    assert model.smoothing_is_uncertain(Given(runs=run)).verdict == verdict


@pytest.mark.parametrize(("times", "verdict"), [(11.0, CONFIRMED), (9.0, NOT_CONFIRMED)])
def test_the_discontinuous_solution_is_slow_from_ten_times_on(times, verdict) -> None:  # type: ignore
    def run(system: System) -> Any:
        seconds = times if system.friction.law == "set_valued" else 1.0
        return SimpleNamespace(statistics=SimpleNamespace(seconds=seconds))
    assert model.discontinuous_is_slow(Given(runs=run)).verdict == verdict


def test_the_smoothed_law_creeps_where_the_set_valued_one_sticks() -> None:
    """Its slip speed carries the torque: tanh(50 v) is near |Tfi|/(mu_s N R), so v is some hundredths of a rad/s."""
    found = model.smoothed_stick_creeps(Evidence(1e-9, 1))
    assert found.verdict == CONFIRMED
    assert 0.01 < found.values["largest slip speed (rad/s)"]["smoothed"] < 0.2


@pytest.mark.parametrize(("off", "verdict"), [(0.0, NOT_CONFIRMED), (3.0, CONFIRMED)])
def test_a_balance_is_unsuitable_where_its_series_is_another_motion(off, verdict) -> None:  # type: ignore
    t = np.linspace(0.0, 0.1, 50)
    run = SimpleNamespace(t=t, slip_speed=2.0 + np.cos(t), final=None)
    series = SimpleNamespace(slip=np.array([2.0]), coefficient=np.array([0.5, 0.0, 0.0]),
                             slip_speed=lambda t: 2.0 + off + np.cos(t))
    assert series_claims.balance_unsuitable(Given(runs=lambda system: run),
                                            balance=lambda system, period, count: series).verdict == verdict
