"""Motions behind sweeps: those of slow transients, and stable ones that coexist, with places that AUTO-07p has too."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from given import Given, record, stretch
from independent import multipliers, smoothed_states

from tcc_sim.result import json_of
from tcc_sim.solvers import solve
from tcc_sim.study.paper import branches_behind
from tcc_sim.study.paper.branches_behind import motions_behind, seen_in, still_higher
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, STATIC, paper_system
from tcc_sim.study.paper.evidence import HIGHEST, KINETIC, LOWEST, Evidence, with_kinetic
from tcc_sim.study.paper.measures import AT_036
from tcc_sim.sweeps.sweep import Curve, Plan, Sweep, sweep_curves

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
    evidence = Evidence(1e-9, 1)
    (result,) = evidence.stretches([AT_036], AXIS, over=KINETIC)
    one, two = sorted(result, key=lambda s: s.period)
    assert (one.low.kind, one.high.kind, one.low.value, one.high.value) == (None, None, pytest.approx(0.865),
                                                                          pytest.approx(0.93))
    assert (two.period, two.high.kind, two.high.jumps) == (2, "fold", True)
    assert two.high.value == pytest.approx(FOLD, abs=1e-8)
    assert two.high.residual < 1e-8
    first, second = evidence.motions({"": AT_036}, AXIS, over=KINETIC)
    ends = [solve(paper_system(with_kinetic(float(x), AT_036)), cycles=650).cycles.section[-2:] for x in AXIS]
    once = {float(x): bool(np.abs(end[1] - end[0]).max() < 1e-3) for x, end in zip(AXIS, ends)}
    assert set(once.values()) == {True, False}
    assert {m.stretch.period: list(m.from_start) for m in (first, second)} == {
        1: [x for x, repeats in once.items() if repeats], 2: [x for x, repeats in once.items() if not repeats]}
    json.dumps(json_of([first, second]), allow_nan=False)
    assert evidence.jump_ends(AT_036, AXIS, over=KINETIC) == [two.high.value]
    assert len(evidence.known) == 1
    again = Evidence(1e-11, 1, known=evidence.known)
    assert again.stretches([AT_036], AXIS, over=KINETIC)[0] is result


def test_both_attractors_of_fig_2_and_a_stable_orbit_at_a_ratio() -> None:
    evidence = Evidence(1e-9, 1)
    ratios = np.array([0.45, 0.46])
    assert evidence.periodic_at({}, ratios).tolist() == [True, True]  # mu_k = mu_s: pure stick above 0.412, by (10).
    assert evidence.attractors({"engine.frequency": 0.45 * 387.3}) == [(1, pytest.approx(0.0, abs=0.1))]


def test_attractors_are_looked_for_from_all_about_the_motion_of_fig_2() -> None:
    section = solve(paper_system(FIGURES[2].series[0].values), cycles=50).cycles.section[-9:]
    assert (section.min(axis=0) > LOWEST).all()
    assert (section.max(axis=0) < HIGHEST).all()


def test_the_jump_near_033_is_found_from_beyond_it() -> None:
    """Period two of 0.75 mu_s: (13) leads to it at 0.358, SciPy follows it down and loses it by 0.340."""
    evidence, row = Evidence(1e-9, 1), with_kinetic(0.75)
    axis = np.linspace(0.334, 0.364, 4)
    (motion,) = [m for m in evidence.motions({"": row}, axis) if m.stretch.period == 2 and m.stretch.low.jumps]
    assert motion.stretch.low.kind == "fold"
    at = {r: paper_system({**row, "engine.frequency": r * paper_system(row).natural_frequency})
          for r in (0.358, 0.352, 0.347, 0.3445, 0.343, 0.340)}
    state, largest = solve(at.pop(0.358), cycles=400).cycles.section[-1], {}
    for ratio, system in at.items():
        state = smoothed_states(system, [*state[:3], 0.0], 30, 1, rtol=1e-6)[-1]
        largest[ratio] = np.abs(smoothed_states(system, state, 2, 500, rtol=1e-6)[:, 0]).max()
    assert motion.stretch.amplitude(0.343) == pytest.approx(largest[0.343], abs=0.02)
    assert largest[0.340] < 0.7 * largest[0.343]
    assert 0.340 < motion.stretch.low.value < 0.343


def test_a_motion_has_its_ends_and_where_the_start_leads_to_it() -> None:
    given = Given(lambda row, x, d: record(), stretches=lambda row: [stretch(0.67, 0.918464, 2, 48.0, "", "jump fold")],
                  reached=lambda row: {0})
    (motion,) = given.motions({"psi = 0": AT_036}, AXIS, over=KINETIC)
    result = json_of(motion)
    assert (result["curve"], result["over"], result["period"]) == ("psi = 0", "mu_k/mu_s", 2)
    assert result["from_start"] == pytest.approx(AXIS)
    assert result["high"] == {"value": 0.918464, "kind": "fold", "residual": 1e-12, "jumps": True}
    for words in ("psi = 0", "period 2", "0.67", "0.918464", "fold", "0.865 to 0.93"):
        assert words in motion.words


def test_the_orbit_behind_a_motion_has_its_multipliers() -> None:
    """Beside SciPy's variational equations; a motion without a period has none."""
    system = paper_system({"engine.frequency": 140.0})
    run = solve(system, cycles=200).raise_for_status()
    largest = float(run.solved_cycles.largest[-1])
    result = branches_behind.orbit_behind(system, run.final, 200, 1, largest)
    assert (result["period"], result["stable"]) == (1, True)
    section = [result[name] for name in ("slip_speed", "plate_angle", "plate_speed")]
    expected = sorted(np.abs(multipliers(system, np.array(section), 1)), reverse=True)
    assert [float(np.hypot(*m)) for m in result["multipliers"]] == pytest.approx(expected, abs=1e-6)
    assert branches_behind.orbit_behind(system, run.final, 200, 0, largest) is None


def test_creep_in_stick_is_an_end_of_stick() -> None:
    """Pure stick under the set-valued law from rest lies on one branch without a jump, with the multipliers of (1)."""
    axis = np.linspace(0.44, 0.46, 4)
    curve = Curve(paper_system({"friction.law": "set_valued", "initial.slip_speed": 0.0, "initial.plate_angle": 0.1}),
                  "engine.frequency", tuple(float(x) * OMEGA_N for x in axis))
    (behind,) = motions_behind(sweep_curves([curve], Plan(cycles=150, discard=50), jobs=1))
    (branch,) = behind.branches
    assert (behind.jumps, branch["period"], set(branch["stable"])) == ([], 1, {True})
    for value, pairs in zip(branch["value"], branch["multipliers"]):
        modulus = math.exp(-0.6 / (2.0 * 0.22) * 2.0 * math.pi / value)
        assert [float(np.hypot(*m)) for m in pairs] == pytest.approx([modulus, modulus, 0.0], abs=1e-6)
