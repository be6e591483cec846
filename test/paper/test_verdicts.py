"""Every verdict can come out either way: each claim judged on curves and motions of the test's own."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
from given import (
    NAMED,
    Given,
    beside,
    by_amplitude,
    cliffs,
    coprime,
    denominators,
    dual,
    ending,
    fig6,
    growing,
    hills,
    law_of,
    lowest,
    orbit,
    other_phase,
    period_at,
    phase_is,
    ratio_of,
    record,
    severe,
    severe_jumps,
    sharp,
    slips_from,
    slips_to,
)

from tcc_sim.paper.catalogue import OMEGA_N
from tcc_sim.paper.claims import CLAIMS
from tcc_sim.paper.criteria import CONFIRMED, DEPENDS, NOT_CONFIRMED, Equal, Holds, Near, Shares

rows = SimpleNamespace(**{claim.name: claim for claim in CLAIMS})


CASES: list[tuple[Any, Given, str]] = [
    (rows.smooth_when_equal, Given(), CONFIRMED),
    (rows.smooth_when_equal, Given(jumps=lambda row: [0.2]), NOT_CONFIRMED),
    (rows.super_harmonic_peaks, Given(hills(*NAMED)), CONFIRMED),
    (rows.super_harmonic_peaks, Given(hills(*NAMED[:3])), DEPENDS),
    (rows.super_harmonic_peaks, Given(hills(0.29)), NOT_CONFIRMED),
    (rows.super_harmonic_jumps, Given(cliffs(*NAMED), stretches=ending(*NAMED)), CONFIRMED),
    (rows.super_harmonic_jumps, Given(cliffs(*NAMED), stretches=ending(*(x + 0.015 for x in NAMED))), NOT_CONFIRMED),
    (rows.super_harmonic_jumps, Given(cliffs(*NAMED), stretches=ending(*NAMED[:3])), DEPENDS),
    (rows.super_harmonic_jumps, Given(hills(*NAMED), stretches=ending(*(x + 0.02 for x in NAMED))), NOT_CONFIRMED),
    (rows.super_harmonic_jumps, Given(cliffs(*NAMED), stretches=ending(*NAMED, kind="period_doubling")), NOT_CONFIRMED),
    (rows.peaks_move, Given(sharp(1.0)), CONFIRMED),
    (rows.peaks_move, Given(sharp(-1.0)), NOT_CONFIRMED),
    (rows.peaks_move, Given(sharp(1.0, equal=0.215)), NOT_CONFIRMED),
    (rows.lost_at_peaks, Given(sharp(0.0), lambda row: [0.203]), CONFIRMED),
    (rows.lost_at_peaks, Given(sharp(0.0), lambda row: [0.203, 0.3]), DEPENDS),
    (rows.lost_at_peaks, Given(sharp(0.0), lambda row: [0.3]), NOT_CONFIRMED),
    (rows.jump_is_bifurcation, Given(period_at(lambda row, x: 1 + (x > 0.2)), lambda row: [0.2]), CONFIRMED),
    (rows.jump_is_bifurcation, Given(jumps=lambda row: [0.2], stretches=ending(0.2005)), NOT_CONFIRMED),
    (rows.stick_transition, Given(slips_to(lambda row: 0.4 + 0.1 * (1.0 - ratio_of(row)))), CONFIRMED),
    (rows.stick_transition, Given(slips_to(lambda row: 0.4)), NOT_CONFIRMED),
    (rows.transition_by_smoothing,
     Given(slips_to(lambda row: 0.4 + 0.2 * (1.0 - ratio_of(row)) * (law_of(row) == "smoothed"))), CONFIRMED),
    (rows.transition_by_smoothing, Given(slips_to(lambda row: 0.4 + 0.2 * (1.0 - ratio_of(row)))), NOT_CONFIRMED),
    (rows.jump_doubles_period, Given(period_at(lambda row, x: 1 + (x > 0.205)), lambda row: [0.205]), CONFIRMED),
    (rows.jump_doubles_period, Given(period_at(lambda row, x: 1), lambda row: [0.205]), NOT_CONFIRMED),
    (rows.jump_doubles_period, Given(period_at(lambda row, x: 1 + (x > 0.25)), lambda row: [0.25]), NOT_CONFIRMED),
    (rows.doubling_to_chaos, Given(period_at(lambda row, x: 2 if x > 0.7 else 0), lambda row: [0.2]), CONFIRMED),
    (rows.doubling_to_chaos, Given(period_at(lambda row, x: 2), lambda row: [0.2]), NOT_CONFIRMED),
    (rows.doubling_to_chaos, Given(period_at(lambda row, x: 1 if x > 0.7 else 0), lambda row: [0.2]), DEPENDS),
    (rows.period_one_near_unity, Given(orbit(0.92, 0.92, 0.92)), CONFIRMED),
    (rows.period_one_near_unity, Given(orbit(0.95, 0.92, 0.92)), NOT_CONFIRMED),
    (rows.period_two_from, Given(orbit(0.85, 0.85, 0.92), stretches=fig6(0.77, 0.918, 0.67)), CONFIRMED),
    (rows.period_two_from, Given(orbit(0.92, 0.92, 0.77), stretches=fig6(0.77, 0.918, 0.67)), DEPENDS),
    (rows.period_two_from, Given(orbit(0.92, 0.92, 0.77), stretches=fig6(0.77, 0.85, 0.67)), NOT_CONFIRMED),
    (rows.period_two_from, Given(orbit(0.92, 0.92, 0.77), stretches=fig6(0.92, 0.92, 0.67, "period_doubling")),
     NOT_CONFIRMED),
    (rows.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.7), stretches=fig6(0.77, 0.918, 0.67)), CONFIRMED),
    (rows.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.7), stretches=fig6(0.77, 0.76, 0.67)), DEPENDS),
    (rows.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.6), stretches=fig6(0.77, 0.918, 0.67)), NOT_CONFIRMED),
    (rows.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.6), stretches=fig6(0.77, 0.918, 0.58)), NOT_CONFIRMED),
    (rows.three_motions, Given(period_at(lambda row, x: {0.94: 1, 0.74: 2, 0.64: 0}[ratio_of(row)])), CONFIRMED),
    (rows.three_motions, Given(period_at(lambda row, x: {0.94: 1, 0.74: 2, 0.64: 0}[ratio_of(row)]),
                                   lyapunov="unresolved"), DEPENDS),
    (rows.three_motions, Given(period_at(lambda row, x: 1)), NOT_CONFIRMED),
    (rows.phase_attenuates, Given(lowest("pressure.phase", 0.0)), CONFIRMED),
    (rows.phase_attenuates, Given(lowest("pressure.phase", 0.0, high=-1.0)), DEPENDS),
    (rows.phase_attenuates, Given(lowest("pressure.phase", 0.0, low=-1.0, high=-1.0)), NOT_CONFIRMED),
    (rows.phase_bifurcations, Given(), CONFIRMED),
    (rows.phase_bifurcations, Given(period_at(lambda row, x: 1 + (x > 0.49))), NOT_CONFIRMED),
    (rows.phase_jumps, Given(), CONFIRMED),
    (rows.phase_jumps, Given(jumps=lambda row: [0.2] if phase_is(row, math.pi) else []), NOT_CONFIRMED),
    (rows.stick_below_018, Given(slips_from(lambda row: 0.18)), CONFIRMED),
    (rows.stick_below_018, Given(slips_from(lambda row: 0.18 if law_of(row) == "smoothed" else 0.10)), DEPENDS),
    (rows.stick_below_018, Given(slips_from(lambda row: 0.10)), NOT_CONFIRMED),
    (rows.stick_below_018, Given(slips_from(lambda row: 0.21)), NOT_CONFIRMED),
    (rows.actuation_periods, Given(period_at(denominators)), CONFIRMED),
    (rows.actuation_periods, Given(period_at(lambda row, x: coprime(row) if abs(x * OMEGA_N - 150.0) < 1e-6 else 5)),
     DEPENDS),
    (rows.actuation_periods, Given(period_at(lambda row, x: 7)), NOT_CONFIRMED),
    (rows.actuation_bifurcations, Given(period_at(denominators)), CONFIRMED),
    (rows.actuation_bifurcations, Given(period_at(lambda row, x: coprime(row) * (1 + (x > 0.49)))), NOT_CONFIRMED),
    (rows.actuation_attenuates, Given(beside(lowest("pressure.frequency_ratio", 1.0))), CONFIRMED),
    (rows.actuation_attenuates, Given(beside(lowest("pressure.frequency_ratio", 1.0), 8.0)), DEPENDS),
    (rows.actuation_attenuates, Given(beside(lowest("pressure.frequency_ratio", 1.0, low=-1.0))), NOT_CONFIRMED),
    (rows.actuation_reversed, Given(beside(lowest("pressure.frequency_ratio", 1.0))), CONFIRMED),
    (rows.actuation_reversed, Given(beside(lowest("pressure.frequency_ratio", 1.0, high=-1.0), 8.0)), DEPENDS),
    (rows.actuation_reversed, Given(beside(lowest("pressure.frequency_ratio", 1.0, high=-1.0))), NOT_CONFIRMED),
    (rows.amplitude_attenuates, Given(by_amplitude((-1.0, 1.0))), CONFIRMED),
    (rows.amplitude_attenuates, Given(by_amplitude((1.0, 1.0))), DEPENDS),
    (rows.amplitude_attenuates, Given(by_amplitude((1.0, -1.0))), NOT_CONFIRMED),
    (rows.amplitude_bifurcations, Given(), CONFIRMED),
    (rows.amplitude_bifurcations, Given(period_at(lambda row, x: 0 if x > 0.49 else 1)), NOT_CONFIRMED),
    (rows.period_is_denominator, Given(period_at(denominators)), CONFIRMED),
    (rows.period_is_denominator, Given(), DEPENDS),
    (rows.period_is_denominator, Given(period_at(lambda row, x: 7)), NOT_CONFIRMED),
    (rows.period_for_any, Given(period_at(denominators)), CONFIRMED),
    (rows.period_for_any, Given(period_at(lambda row, x: coprime(row) * (1 + (x > 0.4)))), NOT_CONFIRMED),
    (rows.proof_is_whole, Given(period_at(denominators)), CONFIRMED),
    (rows.proof_is_whole, Given(period_at(lambda row, x: coprime(row) * (1 + (x > 0.4 and ratio_of(row) < 1.0)))),
     DEPENDS),
    (rows.proof_is_whole, Given(period_at(lambda row, x: coprime(row) * (1 + 3 * (x > 0.4)))), NOT_CONFIRMED),
    (rows.as_dual_excitation, Given(dual(1)), CONFIRMED),
    (rows.as_dual_excitation, Given(dual(2)), NOT_CONFIRMED),
    (rows.slope_is_the_cause, Given(period_at(lambda row, x: 0 if ratio_of(row) < 1.0 else coprime(row))), CONFIRMED),
    (rows.slope_is_the_cause, Given(period_at(lambda row, x: 0 if x > 0.6 * ratio_of(row) - 0.15 else coprime(row))),
     DEPENDS),
    (rows.slope_is_the_cause, Given(period_at(lambda row, x: 0 if x > 0.55 - 0.1 * ratio_of(row) else coprime(row))),
     NOT_CONFIRMED),
    (rows.phase_with_falling_law, Given(lowest("pressure.phase", 0.0)), CONFIRMED),
    (rows.phase_with_falling_law, Given(lowest("pressure.phase", 0.0, high=1.0, place=0.22)), DEPENDS),
    (rows.phase_with_falling_law, Given(lowest("pressure.phase", 0.0, high=1.0, place=0.1)), NOT_CONFIRMED),
    (rows.phase_with_steeper_law, Given(lowest("pressure.phase", 0.0)), CONFIRMED),
    (rows.phase_pi_is_worst, Given(lambda row, x, d: record(10.0 + row["pressure.phase"])), CONFIRMED),
    (rows.phase_pi_is_worst, Given(lambda row, x, d: record(10.0 + row["pressure.phase"] * (ratio_of(row) - 0.7))),
     DEPENDS),
    (rows.phase_pi_is_worst, Given(lambda row, x, d: record(10.0 - row["pressure.phase"])), NOT_CONFIRMED),
    (rows.slope_exaggerates,
     Given(lambda row, x, d: hills(0.2)(row, x, d) if ratio_of(row) < 1.0 else record(10.0)), CONFIRMED),
    (rows.slope_exaggerates, Given(lambda row, x, d: record(11.0 if ratio_of(row) < 1.0 else 10.0)), DEPENDS),
    (rows.slope_exaggerates, Given(hills(0.2)), NOT_CONFIRMED),
    (rows.fifty_suffice, Given(), CONFIRMED),
    (rows.fifty_suffice, Given(lambda row, x, d: record(settled=x < 0.3)), NOT_CONFIRMED),
    (rows.phase_with_steeper_law, Given(lowest("pressure.phase", 0.0, high=1.0, place=0.1)), NOT_CONFIRMED),
    (rows.earlier_onset, Given(slips_from(lambda row: 0.15 if ratio_of(row) < 1.0 else 0.18)), CONFIRMED),
    (rows.earlier_onset, Given(slips_from(lambda row: 0.18)), NOT_CONFIRMED),
    (rows.phase_reversed, Given(lowest("pressure.phase", 0.0)), CONFIRMED),
    (rows.phase_reversed, Given(lowest("pressure.phase", 0.0, place=0.35)), DEPENDS),
    (rows.phase_reversed, Given(lowest("pressure.phase", 0.0, high=-1.0)), NOT_CONFIRMED),
    (rows.phase_reversed, Given(lowest("pressure.phase", 0.0), stretches=other_phase(20.0)), DEPENDS),
    (rows.phase_reversed, Given(lowest("pressure.phase", 0.0), stretches=other_phase(9.0)), CONFIRMED),
    (rows.stick_below_015, Given(slips_from(lambda row: 0.15)), CONFIRMED),
    (rows.stick_below_015, Given(slips_from(lambda row: 0.07)), NOT_CONFIRMED),
    (rows.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.352 else 1), stretches=ending(0.352)), CONFIRMED),
    (rows.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.352 else 1), lyapunov="unresolved",
                                stretches=ending(0.352)), DEPENDS),
    (rows.jump_to_chaos, Given(lambda row, x, d: record(10.0 if x < 0.352 else 14.0, 0 if x > 0.352 else 1)), DEPENDS),
    (rows.jump_to_chaos, Given(period_at(lambda row, x: 0), stretches=ending(0.352)), NOT_CONFIRMED),
    (rows.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.30 else 1), stretches=ending(0.30)), NOT_CONFIRMED),
    (rows.phase_pi_is_smooth, Given(), CONFIRMED),
    (rows.phase_pi_is_smooth, Given(jumps=lambda row: [0.2], stretches=ending(0.2), reached=lambda row: {0}),
     NOT_CONFIRMED),
    (rows.phase_pi_is_smooth, Given(jumps=lambda row: [0.2], stretches=ending(0.2), reached=lambda row: {1}), DEPENDS),
    (rows.phase_pi_is_smooth, Given(period_at(lambda row, x: 1 if x < 0.4 else 2)), DEPENDS),
    (rows.phase_pi_is_smooth, Given(period_at(lambda row, x: 1 if phase_is(row, math.pi) else 2)), CONFIRMED),
    (rows.phase_pi_is_smooth, Given(period_at(lambda row, x: 1 if x < 0.15 else 2)), NOT_CONFIRMED),
    (rows.severity_follows_abruptness, Given(severe(True), severe_jumps), CONFIRMED),
    (rows.severity_follows_abruptness, Given(severe(False), severe_jumps), NOT_CONFIRMED),
    (rows.more_with_steeper_law, Given(period_at(lambda row, x: 0 if x > ratio_of(row) - 0.3 else 1)), DEPENDS),
    (rows.more_with_steeper_law,
     Given(period_at(lambda row, x: 0 if x > ratio_of(row) - 0.3 and round(x / 0.005) % 2 else 1)), CONFIRMED),
    (rows.more_with_steeper_law, Given(period_at(lambda row, x: 0 if x > 1.1 - ratio_of(row) else 1)), NOT_CONFIRMED),
    (rows.same_frequency_suppresses, Given(lowest("pressure.frequency_ratio", 1.0)), CONFIRMED),
    (rows.same_frequency_suppresses, Given(lowest("pressure.frequency_ratio", 2.0)), NOT_CONFIRMED),
    (rows.half_frequency_jumps,
     Given(lambda row, x, d: record(10.0 + 5.0 * (round(x / 0.005) % 2) * (row["pressure.frequency_ratio"] == 0.5))),
     CONFIRMED),
    (rows.half_frequency_jumps, Given(), NOT_CONFIRMED),
    (rows.half_frequency_aperiodic, Given(period_at(lambda row, x: 0 if x < 0.49 else 2)), CONFIRMED),
    (rows.half_frequency_aperiodic, Given(period_at(lambda row, x: 0 if x < 0.4 else 2)), DEPENDS),
    (rows.half_frequency_aperiodic, Given(period_at(lambda row, x: 0 if x < 0.2 else 2)), NOT_CONFIRMED),
    (rows.mismatch_with_falling_law,
     Given(lambda row, x, d: record(9.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0,
                                    0 if ratio_of(row) < 1.0 and x > 0.3 else coprime(row))), CONFIRMED),
    (rows.mismatch_with_falling_law, Given(period_at(lambda row, x: 0 if ratio_of(row) < 1.0 else coprime(row))),
     CONFIRMED),
    (rows.mismatch_with_falling_law,
     Given(lambda row, x, d: record(11.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0, coprime(row))),
     NOT_CONFIRMED),
    (rows.mismatch_with_falling_law,
     Given(lambda row, x, d: record(9.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0, coprime(row))), DEPENDS),
    (rows.mismatch_with_falling_law,
     Given(lambda row, x, d: record(11.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0,
                                    0 if ratio_of(row) < 1.0 else coprime(row))), DEPENDS),
    (rows.amplitude_makes_stick,
     Given(lambda row, x, d: record(period=0, regime="stick" if row["pressure.amplitude"] > 5e4 else "stick-slip")),
     CONFIRMED),
    (rows.amplitude_makes_stick,
     Given(lambda row, x, d: record(period=2, regime="stick" if row["pressure.amplitude"] > 5e4 else "stick-slip")),
     DEPENDS),
    (rows.amplitude_makes_stick, Given(), NOT_CONFIRMED),
    (rows.amplitude_jumps, Given(stretches=ending(0.25, 0.35)), CONFIRMED),
    (rows.amplitude_jumps, Given(stretches=ending(0.25)), DEPENDS),
    (rows.amplitude_jumps, Given(stretches=ending(0.30)), NOT_CONFIRMED),
    (rows.amplitude_enlarges, Given(by_amplitude((1.0, 1.0)), growing), CONFIRMED),
    (rows.amplitude_enlarges, Given(by_amplitude((1.0, 1.0))), DEPENDS),
    (rows.amplitude_enlarges, Given(jumps=lambda row: [0.25]), NOT_CONFIRMED),
    (rows.amplitude_aperiodic, Given(period_at(lambda row, x: 0 if min(abs(x - 0.25), abs(x - 0.35)) < 0.01 else 1)),
     CONFIRMED),
    (rows.amplitude_aperiodic, Given(period_at(lambda row, x: 0 if abs(x - 0.25) < 0.01 else 1)), DEPENDS),
    (rows.amplitude_aperiodic, Given(period_at(lambda row, x: 0)), NOT_CONFIRMED),
]


@pytest.mark.parametrize(("claim", "given", "verdict"), CASES,
                         ids=[f"{c.name}-{v}-{k}" for k, (c, _, v) in enumerate(CASES)])
def test_a_verdict_follows_what_it_is_given(claim: Any, given: Given, verdict: str) -> None:
    assert claim(given).verdict == verdict


def test_every_claim_has_a_case_that_flips_it() -> None:
    verdicts: dict[str, set[str]] = {}
    for claim, _, verdict in CASES:
        verdicts.setdefault(claim.name, set()).add(verdict)
    assert [name for name, found in verdicts.items() if len(found) < 2] == []
    apart = {"damping_crosses", "damping_falls", "delay", "solvers_agree", "classical_differs", "maximum_falls",
             "slope_turns_negative", "pure_slip_guaranteed", "series_balance", "limits_of_stick",
             "stick_limits_varying", "positive_trend_slips", "critical_frequency", "shows_in_both"}
    assert {claim.name for claim in CLAIMS} == set(verdicts) | apart


@pytest.mark.parametrize(("criterion", "judged", "verdict"), [
    (Holds("a"), (True,), CONFIRMED), (Holds("a"), (False,), NOT_CONFIRMED), (Holds("a", "b"), (False, True), DEPENDS),
    (Shares("a"), (0.95, 1.0), CONFIRMED), (Shares("a"), (0.8, 1.0), DEPENDS), (Shares("a"), (0.8, 0.76), DEPENDS),
    (Shares("a"), (0.3, 0.96), DEPENDS), (Shares("a"), (0.3, 0.8), NOT_CONFIRMED),
    (Near("a", 0.1), ((1.05, 1.0),), CONFIRMED), (Near("a", 0.1), ((1.05, 1.0), (None, 1.0)), DEPENDS),
    (Near("a", 0.1), ((1.2, 1.0), (math.nan, 1.0)), NOT_CONFIRMED),
    (Equal("a"), ((1, 1), (2, 2)), CONFIRMED), (Equal("a"), ((1, 1), (2, 3)), DEPENDS),
    (Equal("a"), ((2, 3),), NOT_CONFIRMED)])
def test_criteria(criterion: Any, judged: Any, verdict: str) -> None:
    assert criterion.verdict(judged) == verdict


def test_every_threshold_is_in_the_words_of_its_row() -> None:
    """Numbers that a criterion compares with are those it prints."""
    for claim in CLAIMS:
        words = claim.criterion.words
        for value in vars(claim.criterion).values():
            if isinstance(value, float):
                assert f"{value:g}" in words
