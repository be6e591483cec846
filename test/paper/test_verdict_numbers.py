"""The numbers beside a verdict are those of the curves and motions that it is given."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from given import (
    NAMED,
    Given,
    beside,
    by_amplitude,
    cliffs,
    coprime,
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
from test_verdicts import rows

from tcc_sim.paper.catalogue import OMEGA_N


def thirds(row: Any, x: float, direction: str) -> Any:
    """Jumps of a third of the size at 0.2 and 0.3, the second one down."""
    return record(30.0 if 0.2 < x < 0.3 else 20.0)


def at_phase(value: float, there: int, other: int) -> Callable[..., Any]:
    return period_at(lambda row, x: there if phase_is(row, value) else other)


VALUES: list[tuple[Any, Given, dict[str, Any]]] = [
    (rows.smooth_when_equal, Given(jumps=lambda row: [0.2]), {"jumps": [0.2]}),
    (rows.super_harmonic_peaks, Given(hills(*NAMED[:3])), {
        "curves of nine": [9, 9, 9, 0],
        "peaks from (13)": [0.167, 0.2, 0.251] * 12}),
    (rows.super_harmonic_jumps, Given(cliffs(*NAMED), lambda row: [0.2], stretches=ending(*NAMED)), {
        "curves of nine": [9] * 4, "nearest end": NAMED, "jumps from (13)": [0.2] * 3}),
    (rows.peaks_move, Given(sharp(-1.0)), {
        "peaks followed": [0.206, 0.2, 0.194, 0.188], "all peaks": [0.206, 0.2, 0.194, 0.188]}),
    (rows.lost_at_peaks, Given(sharp(0.0), lambda row: [0.203, 0.3]), {
        "jumps": [6], "part of them": [0.5], "part of the ratios": [7 / 127] * 3}),
    (rows.stick_transition, Given(slips_to(lambda row: 0.4 + 0.1 * (1.0 - ratio_of(row)))), {
        "last slip": [0.4, 0.416, 0.424, 0.432]}),
    (rows.jump_is_bifurcation, Given(period_at(lambda row, x: 1 + (x > 0.2)), lambda row: [0.2, 0.3]), {
        "jumps": [6], "part of them": [0.5], "periods below and above": [1, 2, 2, 2] * 3}),
    (rows.jump_doubles_period, Given(period_at(lambda row, x: 1 + (x > 0.205)), lambda row: [0.205, 0.3]), {
        "periods around": [1, 2]}),
    (rows.doubling_to_chaos, Given(period_at(lambda row, x: 2 if x > 0.7 else 0), lambda row: [0.2]), {
        "omega/omega_n": [0.202], "period at 0.83": [2], "mu_k/mu_s without": [0.56 + 0.01 * k for k in range(15)],
        "diagnosis": ["chaotic", 0.0, 1.0] * 6}),
    (rows.period_one_near_unity, Given(orbit(0.95, 0.92, 0.92)), {"periods": [1, 2]}),
    (rows.period_two_from, Given(orbit(0.85, 0.92, 0.9), stretches=fig6(0.77, 0.918, 0.67)), {
        "stable period two": [0.918], "highest mu_k/mu_s": [0.85, 0.92, 0.9]}),
    (rows.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.7), stretches=fig6(0.77, 0.918, 0.67)), {
        "period one or two down to": [0.67], "highest mu_k/mu_s": [0.7] * 3}),
    (rows.three_motions,
     Given(period_at(lambda row, x: {0.94: 1, 0.74: 2, 0.64: 0}[ratio_of(row)]), longer="chaotic"), {
        "periods": [1, 2, 0], "exponent at 0.64": ["0.5 +- 0.5"], "diagnosis": ["chaotic"]}),
    (rows.phase_attenuates, Given(lowest("pressure.phase", 0.0, place=0.27)), {
        "part at which it is the lowest": [44 / 49], "mean maxima": [10.0 + (5 - 44) / 49, 10.0, 10.0],
        "another curve is lower at": [0.27, 0.275, 0.28, 0.285, 0.29]}),
    (rows.phase_attenuates_least, Given(lowest("pressure.phase", 0.0, place=0.27)), {
        "part at which it is the highest": [1.0], "mean maxima": [11.0, 10.0, 10.0]}),
    (rows.phase_bifurcations, Given(at_phase(math.pi, 2, 1)), {"periods": [1, 1, 2]}),
    (rows.phase_jumps, Given(jumps=lambda row: [0.2] if phase_is(row, math.pi) else []), {"jumps": [0.2]}),
    (rows.stick_below_018, Given(slips_from(lambda row: 0.18 if law_of(row) == "smoothed" else 0.10)), {
        "lowest slip and highest stick, smoothed": [0.18, 0.179],
        "lowest slip and highest stick, set_valued": [0.1, 0.099]}),
    (rows.actuation_periods, Given(period_at(lambda row, x: coprime(row) if abs(x * OMEGA_N - 150.0) < 1e-6 else 5)), {
        "at 150 rad/s": [2, 1, 3, 3], "at the slipping ratios": [5] * 6}),
    (rows.actuation_attenuates, Given(beside(lowest("pressure.frequency_ratio", 1.0), 9.5)), {
        "lowest of its figure": [1.0, 1.0], "lower than Tsp = 0": [0.0, 1.0, 0.0, 0.0, 0.0]}),
    (rows.actuation_reversed, Given(beside(lowest("pressure.frequency_ratio", 1.0, place=0.4))), {
        "above Tsp = 0": [0.0, 11 / 29, 0.0, 0.0, 0.0], "highest of its figure": [11 / 29] * 2}),
    (rows.amplitude_reversed, Given(by_amplitude((1.0, 1.0))), {
        "part in order": [1.0], "mean maxima": [10.0, 10.125, 10.25, 10.5]}),
    (rows.period_is_denominator, Given(), {"periods": [1] * 19}),
    (rows.as_dual_excitation, Given(dual(2)), {"1/2": [2, 4], "2/1": [1, 2], "2/3": [3, 6]}),
    (rows.proof_is_whole, Given(period_at(lambda row, x: coprime(row) * (1 + (x > 0.4 and ratio_of(row) < 1.0)))), {
        "multiples of N": [4, 2, 2, 6, 2, 6], "at mu_k = mu_s": []}),
    (rows.phase_with_falling_law, Given(lowest("pressure.phase", 0.0, place=0.22)), {
        "part at which it is the lowest": [34 / 49], "mean maxima": [10.0 + (15 - 34) / 49, 10.0, 10.0],
        "another curve is lower at": [0.22 + 0.005 * k for k in range(15)]}),
    (rows.earlier_onset, Given(slips_from(lambda row: 0.15 if ratio_of(row) < 1.0 else 0.18)), {
        "lowest slip at": [0.18, 0.15]}),
    (rows.phase_reversed, Given(lowest("pressure.phase", 0.0, place=0.38), stretches=other_phase(10.5)), {
        "worst for every choice": [15 / 29] * 4, "from (13)": [15 / 29] * 2}),
    (rows.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.352 else 1), stretches=ending(0.352)), {
        "stable motions end": [0.352], "steep rises": [], "period below 0.3520": [1],
        "above 0.3520": [0, 0.0, 1.0, "chaotic"] * 3}),
    (rows.jump_to_chaos, Given(thirds), {"stable motions end": [], "steep rises": [0.2025, 0.2975]}),
    (rows.severity_follows_abruptness, Given(severe(True), severe_jumps), {
        "jumps": [9], "with the size of the jump": [1.0], "with the maximum": [-1.0]}),
    (rows.phase_pi_is_smooth, Given(at_phase(math.pi, 1, 2)), {"part with period 1": [1.0], "periods": [1]}),
    (rows.more_with_steeper_law, Given(period_at(lambda row, x: 0 if x > ratio_of(row) - 0.3 else 1)), {
        "aperiodic part": [10 / 91] * 3 + [26 / 91] * 3, "changes of period": [1] * 6}),
    (rows.same_frequency_suppresses, Given(lowest("pressure.frequency_ratio", 1.0, place=0.22)), {
        "part at which it is the lowest": [34 / 49],
        "another curve is lower at": [0.22 + 0.005 * k for k in range(15)]}),
    (rows.half_frequency_jumps, Given(thirds), {"changes for": [2] * 3}),
    (rows.half_frequency_aperiodic, Given(period_at(lambda row, x: 0 if x < 0.4 else 2),
                                           periodic=lambda x: x > 0.3), {
        "aperiodic part": [70 / 91] * 3, "some motion aperiodic": [70 / 91], "a stable periodic": [40 / 91]}),
    (rows.mismatch_with_falling_law,
     Given(lambda row, x, d: record(9.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0, coprime(row))), {
        "part off the period": [0.0] * 6, "omega_f = omega best": [1.0], "not at": []}),
    (rows.amplitude_makes_stick,
     Given(lambda row, x, d: record(period=2, regime="stick" if row["pressure.amplitude"] > 5e4 else "stick-slip")), {
        "pure stick": [0.0, 0.0, 1.0, 1.0], "no period": [0.0] * 4}),
    (rows.amplitude_jumps, Given(stretches=ending(0.25)), {"stable motions end": [0.25] * 2}),
    (rows.amplitude_aperiodic, Given(period_at(lambda row, x: 0 if abs(x - 0.25) < 0.006 else 1)), {
        "part without a period near": [1 / 3, 0.0]}),
    (rows.amplitude_enlarges_jumps, Given(jumps=growing), {"largest jump there": [10.0, 11.0, 12.0, 13.0]}),
    (rows.amplitude_enlarges_slip, Given(by_amplitude((1.0, 1.0))), {"mean maxima": [10.0, 10.125, 10.25, 10.5]}),
    (rows.new_peaks, Given(hills(0.1, 0.2)), {"peaks below": [2] * 6}),
    (rows.slope_exaggerates, Given(lambda row, x, d: record(20.0 - 10.0 * ratio_of(row))), {
        "mean maxima": [10.0, 11.7, 12.5, 13.33], "largest of all": [10.0, 11.7, 12.5, 13.33]}),
    (rows.fifty_suffice, Given(lambda row, x, d: record(settled=x < 0.3)), {"settled part": [50 / 91] * 33}),

]


def leaves(value: Any) -> list[Any]:
    """The numbers and words of nested results, in order."""
    if isinstance(value, dict):
        value = list(value.values())
    return [x for part in value for x in leaves(part)] if isinstance(value, (list, tuple)) else [value]


@pytest.mark.parametrize(("claim", "given", "expected"), VALUES, ids=[claim.name for claim, *_ in VALUES])
def test_the_numbers_beside_a_verdict_are_those_of_what_it_is_given(claim: Any, given: Given,
                                                                    expected: dict[str, Any]) -> None:
    """Counted by hand on the same made-up curves."""
    values = claim(given).values
    for words, numbers in expected.items():
        (name,) = [name for name in values if name.startswith(words)][:1]
        assert leaves(values[name]) == pytest.approx(numbers, abs=1e-9), name
