"""Motions behind sweeps: those of slow transients, and stable ones that coexist, with places that AUTO-07p has too."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from given import Given, record, stretch

from tcc_sim.result import json_of
from tcc_sim.solvers import solve
from tcc_sim.study.benchmarks.references import smoothed_states
from tcc_sim.study.paper import branches_behind
from tcc_sim.study.paper.branches_behind import (
    HIGHEST,
    LOWEST,
    StableMotions,
    motions_behind,
    seen_in,
    still_higher,
)
from tcc_sim.study.paper.catalogue import FIGURES, STATIC, paper_system
from tcc_sim.study.paper.claims import CLAIMS, Verdict, claims_page
from tcc_sim.study.paper.claims_periods import AT_036
from tcc_sim.study.paper.evidence import KINETIC, with_kinetic
from tcc_sim.study.paper.rules import Finding
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep, sweep_curves
from tcc_sim.trajectory import State

DOUBLING = 0.777332549
"""mu_k/mu_s at which the motion of period one of Fig. 6 doubles, by AUTO-07p."""
AXIS = np.array([0.865, 0.88, 0.9, 0.915, 0.93])
FOLD = 0.918464437
"""Of the period-two branch at omega/omega_n = 0.36, by AUTO-07p."""


def swept(ratios: Any, direction: str = "cold") -> Sweep:
    """A sweep over mu_k/mu_s at omega/omega_n = 0.36 with constant load, as Fig. 6."""
    curve = Curve(paper_system(AT_036), KINETIC, tuple(r * STATIC for r in ratios))
    return sweep_curves([curve], Plan(cycles=150, discard=50, direction=direction))[0]


def test_a_transient_does_not_pass_for_the_size_of_the_motion_behind_it() -> None:
    sweep = swept([0.572])
    seen, = seen_in(sweep)
    record = sweep.records[0]
    assert record is not None
    assert record["settled"]
    states = smoothed_states(sweep.curve.at(0), [*seen.state, 0.0], seen.period, 5000)
    assert seen.amplitude == pytest.approx(np.abs(states[:, 0]).max(), rel=1e-6)
    # The maximum by the paper's rule is a third higher; without branches a picture shows a jump.
    assert record["max_slip_speed"] > 1.3 * seen.amplitude
    assert still_higher(sweep, [seen]) == 1


def test_motions_that_settle_slowly_lie_on_their_branch_and_their_jump_is_the_doubling() -> None:
    """Continued downward, the motion of period one loses its stability where it doubles and departs slowly: just below,
    it still looks like period one after hundreds of cycles.
    """
    result, = motions_behind([swept(np.arange(0.768, 0.8365, 0.004), "down")])
    jump, = result.jumps
    assert jump.cause == "period_doubling"
    assert jump.value / STATIC == pytest.approx(DOUBLING, abs=1e-8)


def test_both_motions_at_036_with_the_fold_and_where_the_start_leads() -> None:
    evidence = StableMotions(1e-9, 1)
    (result,) = evidence.stretches([AT_036], AXIS, over=KINETIC)
    one, two = sorted(result, key=lambda s: s.period)
    assert (one.low.kind, one.high.kind, one.low.value, one.high.value) == (None, None, pytest.approx(0.865),
                                                                          pytest.approx(0.93))
    assert (two.period, two.high.kind, two.high.jumps) == (2, "fold", True)
    assert two.high.value == pytest.approx(FOLD, abs=1e-8)
    assert two.high.residual < 1e-8
    first, second = evidence.motions("", AT_036, AXIS, over=KINETIC)
    ends = [solve(paper_system(with_kinetic(float(x), AT_036)), cycles=650).cycles.section[-2:] for x in AXIS]
    once = {float(x): bool(np.abs(end[1] - end[0]).max() < 1e-3) for x, end in zip(AXIS, ends)}
    assert set(once.values()) == {True, False}
    assert {m.stretch.period: list(m.from_start) for m in (first, second)} == {
        1: [x for x, repeats in once.items() if repeats], 2: [x for x, repeats in once.items() if not repeats]}
    json.dumps(json_of([first, second]), allow_nan=False)
    assert evidence.jump_ends(AT_036, AXIS, over=KINETIC) == [two.high.value]
    assert len(evidence.known) == 1
    again = StableMotions(1e-11, 1, known=evidence.known)
    assert again.stretches([AT_036], AXIS, over=KINETIC)[0] is result


def test_both_attractors_of_fig_2_and_a_stable_orbit_at_a_ratio() -> None:
    evidence = StableMotions(1e-9, 1)
    ratios = np.array([0.45, 0.46])
    assert evidence.periodic_at({}, ratios).tolist() == [True, True]  # mu_k = mu_s: pure stick above 0.412, by (10).
    assert evidence.attractors({"engine.frequency": 0.45 * 387.3}) == [(1, pytest.approx(0.0, abs=0.1))]


def test_attractors_are_looked_for_from_all_about_the_motion_of_fig_2() -> None:
    section = solve(paper_system(FIGURES[2].series[0].values), cycles=50).cycles.section[-9:]
    assert (section.min(axis=0) > LOWEST).all()
    assert (section.max(axis=0) < HIGHEST).all()


def test_the_jump_near_033_is_found_from_beyond_it() -> None:
    """Period two of 0.75 mu_s: (13) leads to it at 0.358, SciPy follows it down and loses it by 0.340."""
    evidence, row = StableMotions(1e-9, 1), with_kinetic(0.75)
    axis = np.linspace(0.334, 0.364, 6)
    (motion,) = [m for m in evidence.motions("", row, axis) if m.stretch.period == 2 and m.stretch.low.jumps]
    assert motion.stretch.low.kind == "fold"
    at = {r: paper_system({**row, "engine.frequency": r * paper_system(row).natural_frequency})
          for r in (0.358, 0.352, 0.347, 0.3445, 0.343, 0.340)}
    state, largest = solve(at.pop(0.358), cycles=400).cycles.section[-1], {}
    for ratio, system in at.items():
        state = smoothed_states(system, [*state[:3], 0.0], 30, 1, rtol=1e-8)[-1]
        largest[ratio] = np.abs(smoothed_states(system, state, 2, 2000, rtol=1e-8)[:, 0]).max()
    assert motion.stretch.amplitude(0.343) == pytest.approx(largest[0.343], abs=0.02)
    assert largest[0.340] < 0.7 * largest[0.343]
    assert 0.340 < motion.stretch.low.value < 0.343


def test_motions_stand_on_the_page_in_words() -> None:
    given = Given(lambda row, x, d: record(), stretches=lambda row: [stretch(0.67, 0.918464, 2, 48.0, "", "jump fold")],
                  reached=lambda row: {0})
    (motion,) = given.motions("psi = 0", AT_036, AXIS, over=KINETIC)
    assert motion.words == ("psi = 0: period 2, stable over mu_k/mu_s from 0.67 (followed no further) to 0.918464 "
                                "(fold, residual 1e-12); within 2650 cycles (13) leads to it at 0.865 to 0.93 "
                                "(5 values)")
    assert replace(motion, from_start=(0.9,)).words.endswith("leads to it at 0.9 (1 value)")
    assert replace(motion, curve="", from_start=()).words.endswith("cycles (13) leads to it nowhere")
    finding = Finding({}, "confirmed", "", json_of([motion]))
    verdict = Verdict(CLAIMS[0], finding, {225e3: ("confirmed", "confirmed")})
    page = claims_page([verdict])
    assert "1 stable motion</summary>\n\n- psi = 0: period 2, stable over mu\\_k/mu\\_s" in page
    assert json_of(verdict)["motions"][0]["high"] == {"value": 0.918464, "kind": "fold", "residual": 1e-12,
                                                      "jumps": True}


def test_the_orbit_behind_a_motion_is_sought_about_its_frequency(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    system = paper_system({"engine.frequency": 140.0})
    found = SimpleNamespace(orbit=SimpleNamespace(period=2, figures=SimpleNamespace(as_json=lambda: {"stable": True})))
    monkeypatch.setattr(branches_behind, "point_of", lambda of, span, seen: asked.append((of, span, seen)) or (
        found if seen.amplitude > 1.0 else None))
    final = State(1.0, 0.1, 5.0)
    assert branches_behind.orbit_behind(system, final, 7, 2, 30.0) == {"period": 2, "stable": True}
    assert branches_behind.orbit_behind(system, final, 7, 2, 0.5) is None
    assert branches_behind.orbit_behind(system, final, 7, 0, 30.0) is None
    (of, span, seen), _ = asked
    assert of.system_at((150.0,)).engine.frequency == 150.0
    assert (span.low, span.high) == (70.0, 210.0)
    assert {**vars(seen), "state": seen.state.tolist()} == {
        "value": 140.0, "state": [1.0, 0.1, 5.0], "cycle": 7, "period": 2, "amplitude": 30.0}
