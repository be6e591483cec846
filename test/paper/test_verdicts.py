"""Every verdict can come out either way: each claim judged on curves and motions of the test's own."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_evidence import (
    NAMED,
    SMALL,
    Given,
    by_amplitude,
    coprime,
    dampings,
    denominators,
    law_of,
    lowest,
    orbit,
    period_at,
    phase_is,
    ratio_of,
    record,
    sharp,
    slips_from,
    slips_to,
    uneven,
)

from tcc_sim.paper import claims, claims_interaction, claims_varying_load
from tcc_sim.paper import claims_constant_load as constant
from tcc_sim.paper import claims_model as model
from tcc_sim.paper.catalogue import FIGURES, OMEGA_N, paper_system
from tcc_sim.paper.evidence import CONFIRMED, DEPENDS, KINETIC, NOT_CONFIRMED, Evidence

varying, mixed = claims_varying_load, claims_interaction


CASES: list[tuple[Any, Given, str]] = [
    (constant.smooth_when_equal, Given(), CONFIRMED),
    (constant.smooth_when_equal, Given(jumps=lambda row: [0.2]), NOT_CONFIRMED),
    (constant.super_harmonic_jumps, Given(jumps=lambda row: NAMED), CONFIRMED),
    (constant.super_harmonic_jumps, Given(jumps=lambda row: NAMED[:3]), DEPENDS),
    (constant.super_harmonic_jumps, Given(jumps=lambda row: [0.45]), NOT_CONFIRMED),
    (constant.peaks_move, Given(sharp(1.0), lambda row: [0.2 + SMALL[ratio_of(row)]]), CONFIRMED),
    (constant.peaks_move, Given(sharp(1.0), lambda row: [0.2 - SMALL[ratio_of(row)]]), DEPENDS),
    (constant.peaks_move, Given(sharp(-1.0), lambda row: [0.2 - SMALL[ratio_of(row)]]), NOT_CONFIRMED),
    (constant.stick_transition, Given(slips_to(lambda row: 0.4 + 0.1 * (1.0 - ratio_of(row)))), CONFIRMED),
    (constant.stick_transition, Given(slips_to(lambda row: 0.4)), NOT_CONFIRMED),
    (constant.transition_by_smoothing,
     Given(slips_to(lambda row: 0.4 + 0.2 * (1.0 - ratio_of(row)) * (law_of(row) == "smoothed"))), CONFIRMED),
    (constant.transition_by_smoothing, Given(slips_to(lambda row: 0.4 + 0.2 * (1.0 - ratio_of(row)))), NOT_CONFIRMED),
    (constant.stick_limits, Given(slips_to(lambda row: 0.41177)), CONFIRMED),
    (constant.stick_limits, Given(slips_to(lambda row: 0.40)), NOT_CONFIRMED),
    (constant.jump_doubles_period, Given(period_at(lambda row, x: 1 + (x > 0.205)), lambda row: [0.205]), CONFIRMED),
    (constant.jump_doubles_period, Given(period_at(lambda row, x: 1), lambda row: [0.205]), NOT_CONFIRMED),
    (constant.jump_doubles_period, Given(period_at(lambda row, x: 1 + (x > 0.25)), lambda row: [0.25]), NOT_CONFIRMED),
    (constant.doubling_to_chaos, Given(period_at(lambda row, x: 2 if x > 0.7 else 0), lambda row: [0.2]), CONFIRMED),
    (constant.doubling_to_chaos, Given(period_at(lambda row, x: 2 if x > 0.7 else 0), lambda row: [0.2], "unresolved"),
     DEPENDS),
    (constant.doubling_to_chaos, Given(period_at(lambda row, x: 2), lambda row: [0.2]), NOT_CONFIRMED),
    (constant.doubling_to_chaos, Given(period_at(lambda row, x: 1 if x > 0.7 else 0), lambda row: [0.2]), DEPENDS),
    (constant.period_one_near_unity, Given(orbit(0.92, 0.92, 0.92)), CONFIRMED),
    (constant.period_one_near_unity, Given(orbit(0.95, 0.92, 0.92)), NOT_CONFIRMED),
    (constant.period_two_from, Given(orbit(0.92, 0.92, 0.92)), CONFIRMED),
    (constant.period_two_from, Given(orbit(0.85, 0.92, 0.85)), DEPENDS),
    (constant.period_two_from, Given(orbit(0.85, 0.85, 0.85)), NOT_CONFIRMED),
    (constant.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.7)), CONFIRMED),
    (constant.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.6)), NOT_CONFIRMED),
    (constant.three_motions, Given(period_at(lambda row, x: {0.94: 1, 0.74: 2, 0.64: 0}[ratio_of(row)])), CONFIRMED),
    (constant.three_motions, Given(period_at(lambda row, x: {0.94: 1, 0.74: 2, 0.64: 0}[ratio_of(row)]),
                                   lyapunov="unresolved"), DEPENDS),
    (constant.three_motions, Given(period_at(lambda row, x: 1)), NOT_CONFIRMED),
    (varying.phase_attenuates, Given(lowest("pressure.phase", 0.0)), CONFIRMED),
    (varying.phase_attenuates, Given(lowest("pressure.phase", 0.0, high=-1.0)), DEPENDS),
    (varying.phase_attenuates, Given(lowest("pressure.phase", 0.0, low=-1.0, high=-1.0)), NOT_CONFIRMED),
    (varying.phase_bifurcations, Given(), CONFIRMED),
    (varying.phase_bifurcations, Given(period_at(lambda row, x: 1 + (x > 0.49))), NOT_CONFIRMED),
    (varying.phase_jumps, Given(), CONFIRMED),
    (varying.phase_jumps, Given(jumps=lambda row: [0.2] if phase_is(row, math.pi) else []), NOT_CONFIRMED),
    (varying.stick_below_018, Given(slips_from(lambda row: 0.18)), CONFIRMED),
    (varying.stick_below_018, Given(slips_from(lambda row: 0.18 if law_of(row) == "smoothed" else 0.10)), DEPENDS),
    (varying.stick_below_018, Given(slips_from(lambda row: 0.10)), NOT_CONFIRMED),
    (varying.actuation_periods, Given(period_at(denominators)), CONFIRMED),
    (varying.actuation_periods, Given(period_at(lambda row, x: coprime(row) if abs(x * OMEGA_N - 150.0) < 1e-6 else 5)),
     DEPENDS),
    (varying.actuation_periods, Given(), NOT_CONFIRMED),
    (varying.actuation_bifurcations, Given(period_at(denominators)), CONFIRMED),
    (varying.actuation_bifurcations, Given(period_at(lambda row, x: coprime(row) * (1 + (x > 0.49)))), NOT_CONFIRMED),
    (varying.actuation_attenuates, Given(lowest("pressure.frequency_ratio", 1.0)), CONFIRMED),
    (varying.actuation_attenuates, Given(lowest("pressure.frequency_ratio", 1.0, low=-1.0)), NOT_CONFIRMED),
    (varying.actuation_reversed, Given(lowest("pressure.frequency_ratio", 1.0)), CONFIRMED),
    (varying.actuation_reversed, Given(lowest("pressure.frequency_ratio", 1.0, high=1.0, place=0.38)), DEPENDS),
    (varying.actuation_reversed, Given(lowest("pressure.frequency_ratio", 1.0, high=-1.0)), NOT_CONFIRMED),
    (varying.amplitude_attenuates, Given(by_amplitude((-1.0, 1.0))), CONFIRMED),
    (varying.amplitude_attenuates, Given(by_amplitude((1.0, 1.0))), NOT_CONFIRMED),
    (varying.amplitude_attenuates, Given(by_amplitude((-1.0, -1.0))), NOT_CONFIRMED),
    (varying.amplitude_bifurcations, Given(), CONFIRMED),
    (varying.amplitude_bifurcations, Given(period_at(lambda row, x: 0 if x > 0.49 else 1)), NOT_CONFIRMED),
    (varying.period_is_denominator, Given(period_at(denominators)), CONFIRMED),
    (varying.period_is_denominator, Given(), DEPENDS),
    (varying.period_is_denominator, Given(period_at(lambda row, x: 7)), NOT_CONFIRMED),
    (varying.period_for_any, Given(period_at(
        lambda row, x: {0.5: 4, 1.0: 2 if abs(x * OMEGA_N - 150.0) < 1e-6 and KINETIC not in row else 1}.get(
            row["pressure.frequency_ratio"], 6))), CONFIRMED),
    (varying.period_for_any, Given(period_at(denominators)), NOT_CONFIRMED),
    (mixed.phase_with_falling_law, Given(lowest("pressure.phase", 0.0)), CONFIRMED),
    (mixed.phase_with_falling_law, Given(lowest("pressure.phase", 0.0, high=1.0, place=0.22)), DEPENDS),
    (mixed.phase_with_falling_law, Given(lowest("pressure.phase", 0.0, high=1.0, place=0.1)), NOT_CONFIRMED),
    (mixed.phase_reversed, Given(lowest("pressure.phase", 0.0)), CONFIRMED),
    (mixed.phase_reversed, Given(lowest("pressure.phase", 0.0, place=0.35)), DEPENDS),
    (mixed.phase_reversed, Given(lowest("pressure.phase", 0.0, high=-1.0)), NOT_CONFIRMED),
    (mixed.stick_below_015, Given(slips_from(lambda row: 0.15)), CONFIRMED),
    (mixed.stick_below_015, Given(slips_from(lambda row: 0.07)), NOT_CONFIRMED),
    (mixed.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.352 else 1), lambda row: [0.352]), CONFIRMED),
    (mixed.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.352 else 1), lambda row: [0.352], "unresolved"),
     DEPENDS),
    (mixed.jump_to_chaos, Given(lambda row, x, d: record(10.0 if x < 0.352 else 14.0, 0 if x > 0.352 else 1)), DEPENDS),
    (mixed.jump_to_chaos, Given(period_at(lambda row, x: 0), lambda row: [0.352]), NOT_CONFIRMED),
    (mixed.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.30 else 1), lambda row: [0.30]), NOT_CONFIRMED),
    (mixed.phase_pi_is_smooth, Given(), CONFIRMED),
    (mixed.phase_pi_is_smooth, Given(jumps=lambda row: [0.2]), DEPENDS),
    (mixed.phase_pi_is_smooth, Given(period_at(lambda row, x: 1 if x < 0.15 else 2)), NOT_CONFIRMED),
    (mixed.severity_follows_abruptness, Given(uneven(True)), CONFIRMED),
    (mixed.severity_follows_abruptness, Given(uneven(False)), NOT_CONFIRMED),
    (mixed.more_with_steeper_law, Given(period_at(lambda row, x: 0 if x > ratio_of(row) - 0.3 else 1)), CONFIRMED),
    (mixed.more_with_steeper_law, Given(period_at(lambda row, x: 0 if x > 1.1 - ratio_of(row) else 1)), NOT_CONFIRMED),
    (mixed.same_frequency_suppresses, Given(lowest("pressure.frequency_ratio", 1.0)), CONFIRMED),
    (mixed.same_frequency_suppresses, Given(lowest("pressure.frequency_ratio", 2.0)), NOT_CONFIRMED),
    (mixed.half_frequency_jumps,
     Given(lambda row, x, d: record(10.0 + 5.0 * (round(x / 0.005) % 2) * (row["pressure.frequency_ratio"] == 0.5))),
     CONFIRMED),
    (mixed.half_frequency_jumps, Given(), NOT_CONFIRMED),
    (mixed.half_frequency_aperiodic, Given(period_at(lambda row, x: 0 if x < 0.4 else 2)), CONFIRMED),
    (mixed.half_frequency_aperiodic, Given(period_at(lambda row, x: 0 if x < 0.2 else 2)), DEPENDS),
    (mixed.half_frequency_aperiodic, Given(period_at(lambda row, x: 2)), NOT_CONFIRMED),
    (mixed.mismatch_with_falling_law,
     Given(lambda row, x, d: record(9.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0,
                                    0 if ratio_of(row) < 1.0 and x > 0.3 else coprime(row))), CONFIRMED),
    (mixed.mismatch_with_falling_law, Given(period_at(lambda row, x: 0 if ratio_of(row) < 1.0 else coprime(row))),
     CONFIRMED),
    (mixed.mismatch_with_falling_law,
     Given(lambda row, x, d: record(11.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0, coprime(row))),
     NOT_CONFIRMED),
    (mixed.amplitude_makes_stick,
     Given(lambda row, x, d: record(period=0, regime="stick" if row["pressure.amplitude"] > 5e4 else "stick-slip")),
     CONFIRMED),
    (mixed.amplitude_makes_stick, Given(), NOT_CONFIRMED),
    (mixed.amplitude_jumps, Given(jumps=lambda row: [0.25, 0.35]), CONFIRMED),
    (mixed.amplitude_jumps, Given(jumps=lambda row: [0.25]), DEPENDS),
    (mixed.amplitude_jumps, Given(jumps=lambda row: [0.30]), NOT_CONFIRMED),
    (mixed.amplitude_aperiodic, Given(period_at(lambda row, x: 0 if abs(x - 0.3) < 0.06 else 1)), CONFIRMED),
    (mixed.amplitude_aperiodic, Given(period_at(lambda row, x: 0 if abs(x - 0.25) < 0.01 else 1)), DEPENDS),
    (mixed.amplitude_aperiodic, Given(), NOT_CONFIRMED),
]


@pytest.mark.parametrize(("claim", "given", "verdict"), CASES,
                         ids=[f"{c.__name__}-{v}-{k}" for k, (c, _, v) in enumerate(CASES)])
def test_a_verdict_follows_what_it_is_given(claim: Any, given: Given, verdict: str) -> None:
    assert claim(given).verdict == verdict


@pytest.mark.parametrize(("cf", "changes", "verdict"), [
    (lambda x: -1.2 * x / 0.4, True, CONFIRMED), (lambda x: -1.2 * x / 0.4, False, NOT_CONFIRMED),
    (lambda x: 0.0, True, NOT_CONFIRMED)])
def test_a_crossing_counts_with_a_change_of_period_only(cf, changes, verdict, monkeypatch) -> None:  # type: ignore
    monkeypatch.setattr(constant, "_other_readings", dict)
    assert constant.damping_crosses(Given(dampings(cf, changes))).verdict == verdict


@pytest.mark.parametrize(("shares", "verdict"), [
    ((1.0, 0.9, 0.1, 0.0), CONFIRMED), ((1.0, 0.7, 0.1, 0.0), NOT_CONFIRMED), ((1.0, 0.9, 0.3, 0.0), NOT_CONFIRMED)])
def test_the_delay_is_judged_by_the_half_cycles(shares, verdict, monkeypatch) -> None:  # type: ignore
    places = {f"{float(s.values['engine.frequency']):.6f}": x for s, x in zip(FIGURES[9].series, shares)}
    monkeypatch.setattr(varying, "first_half", lambda key: places[key])
    given = Given()
    monkeypatch.setattr(given, "last_cycles", lambda row, cycles, samples: f"{row['engine.frequency']:.6f}")
    assert varying.delay(given).verdict == verdict


@pytest.mark.parametrize(("differences", "period", "largest", "verdict"), [
    (0.01, 1, 36.3, CONFIRMED), (0.01, 2, 36.3, DEPENDS), (0.01, 1, 63.7, DEPENDS), (0.2, 1, 36.3, NOT_CONFIRMED)])
def test_solvers_agree_where_their_steady_states_do(differences, period, largest, verdict,
                                                    monkeypatch) -> None:  # type: ignore
    monkeypatch.setattr(model, "cycle_differences", lambda chosen: {name: differences for name, *_ in chosen})
    given = Given(steady=lambda row: {"period": period, "max_slip_speed": largest, "settled": True}
                  if law_of(row) == "set_valued" else {"period": 1, "max_slip_speed": 36.3, "settled": True})
    assert model.solvers_agree(given).verdict == verdict


@pytest.mark.parametrize(("sizes", "verdict"), [
    ((0.0, 0.2), DEPENDS), ((0.2, 0.2), CONFIRMED), ((0.0, 0.0), NOT_CONFIRMED)])
def test_the_classical_method_differs_at_some_steps(sizes, verdict, monkeypatch) -> None:  # type: ignore
    monkeypatch.setattr(model, "cycle_differences", lambda chosen: {name: sizes[float(name.split()[2]) > 3e-5]
                                                                    for name, *_ in chosen})
    assert model.classical_differs(Given()).verdict == verdict


@pytest.mark.parametrize(("name", "claim"), [
    ("peak_of", model.maximum_falls), ("least_slope", model.slope_turns_negative)])
def test_the_law_is_judged_for_the_figure_s_own_mu_k(name, claim, monkeypatch) -> None:  # type: ignore
    seen: list[float] = []

    def flat(system: Any) -> float:
        seen.append(round(1.0 / system.friction_ratio, 4))
        return 2.0
    monkeypatch.setattr(model, name, flat)
    assert claim(Given()).verdict == NOT_CONFIRMED
    assert {0.8, 0.75, 0.677} <= set(seen) <= {1.0, 0.8, 0.75, 0.677}


def test_pure_slip_is_held_against_the_solution(monkeypatch) -> None:  # type: ignore
    from tcc_sim.model.closed_form import pure_slip
    t = np.linspace(0.0, 1.0, 1001)
    v = pure_slip(paper_system(model.PURE_SLIP)).slip_speed(t)
    for off, verdict in ((0.0, CONFIRMED), (1e-3, NOT_CONFIRMED)):
        given = Given()
        monkeypatch.setattr(given, "first_cycles", lambda row, cycles, samples, off=off: SimpleNamespace(
            t=t, slip_speed=v * (1.0 + off)))
        found = model.pure_slip_guaranteed(given)
        assert found.verdict == verdict
        assert found.values["least Omega_e that slips for ever (rad/s)"] == pytest.approx(35.1, abs=0.1)


def test_every_claim_has_a_case_that_flips_it() -> None:
    verdicts: dict[Any, set[str]] = {}
    for claim, _, verdict in CASES:
        verdicts.setdefault(claim, set()).add(verdict)
    assert [c.__name__ for c, found in verdicts.items() if len(found) < 2] == []
    apart = {constant.damping_crosses, varying.delay, model.solvers_agree, model.classical_differs, model.maximum_falls,
             model.slope_turns_negative, model.pure_slip_guaranteed, model.series_balance}
    assert set(claims.CLAIMS) == set(verdicts) | apart


def test_a_motion_that_has_not_settled_goes_on(monkeypatch) -> None:  # type: ignore
    """Law (6) in Fig. 2: no period after 150 cycles from (13), period two once it has settled."""
    row = {**model.FIG02, "friction.law": "set_valued"}
    kept = Evidence(1e-9, 1)
    sweep = kept.curves([row], np.array([150.0 / OMEGA_N]))[0]
    summary = sweep.points[0].summary  # type: ignore[union-attr]
    assert summary is not None
    assert (summary.period, summary.settled) == (0, False)
    assert kept.periods(sweep).tolist() == [2]
    assert kept.motion(row)["period"] == 2
    monkeypatch.setattr(Evidence, "_period", lambda *_: pytest.fail("it was worked out before"))
    assert kept.periods(sweep).tolist() == [2]
