"""Every verdict can be either: each claim is judged on made-up curves and motions."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from given import (
    NAMED,
    Given,
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
    next_to,
    orbit,
    other_phase,
    period_at,
    phase_is,
    ratio_of,
    record,
    rows,
    severe,
    severe_jumps,
    sharp,
    slips_from,
    slips_to,
)

from tcc_sim.study.paper.catalogue import OMEGA_N
from tcc_sim.study.paper.evidence import T
from tcc_sim.study.paper.rules import CONFIRMED, DEPENDS, NOT_CONFIRMED, equal, holds, near, shares

YES, NO, PART = CONFIRMED, NOT_CONFIRMED, DEPENDS


def thirds(row: Any, x: float, direction: str) -> Any:
    """Jumps of a third of the size at 0.2 and 0.3, the second one down."""
    return record(30.0 if 0.2 < x < 0.3 else 20.0)


def between(row: Any, x: float, direction: str) -> Any:
    """The curve of psi = 0 between those of pi/2 and pi."""
    turn = row["pressure.phase"] / math.pi
    return record(10.0 + turn * (4.0 * turn - 3.0))


def at_phase(value: float, first: int, other: int) -> Callable[..., Any]:
    return period_at(lambda row, x: first if phase_is(row, value) else other)


CASES: dict[str, list[tuple[Any, ...]]] = {
    "smooth_when_equal": [(Given(), YES), (Given(jumps=lambda row: [0.2]), NO, {"jumps": [0.2]})],
    "super_harmonic_peaks": [(Given(hills(*NAMED)), YES),
        (Given(hills(*NAMED[:3])), PART, {"curves of nine": [9, 9, 9, 0], "peaks from (13)": [0.167, 0.2, 0.251] * 12}),
        (Given(hills(0.29)), NO)],
    "super_harmonic_jumps": [(Given(cliffs(*NAMED), stretches=ending(*NAMED)), YES),
        (Given(cliffs(*NAMED), stretches=ending(*(x + 0.015 for x in NAMED))), NO),
        (Given(cliffs(*NAMED), stretches=ending(*NAMED[:3])), PART),
        (Given(hills(*NAMED), stretches=ending(*(x + 0.02 for x in NAMED))), NO),
        (Given(cliffs(*NAMED), stretches=ending(*NAMED, kind="period_doubling")), NO),
        (Given(cliffs(*NAMED), lambda row: [0.2], stretches=ending(*NAMED)), YES, {"curves of nine": [9] * 4,
         "nearest end": NAMED, "jumps from (13)": [0.2] * 3})],
    "peaks_move": [(Given(sharp(1.0)), YES),
        (Given(sharp(-1.0)), NO, {"peaks followed": [0.206, 0.2, 0.194, 0.188],
         "all peaks": [0.206, 0.2, 0.194, 0.188]}),
        (Given(sharp(1.0, equal=0.215)), NO), (Given(sharp(1.0, equal=0.2)), YES), (Given(sharp(0.0)), NO)],
    "lost_at_peaks": [(Given(sharp(0.0), lambda row: [0.203]), YES),
        (Given(sharp(0.0), lambda row: [0.203, 0.3]), PART, {"jumps": [6], "part of them": [0.5],
         "part of the ratios": [7 / 127] * 3}),
        (Given(sharp(0.0), lambda row: [0.215]), NO)],
    "jump_is_bifurcation": [(Given(period_at(lambda row, x: 1 + (x > 0.2)), lambda row: [0.2]), YES),
        (Given(period_at(lambda row, x: 1 + (x > 0.2)), lambda row: [0.2, 0.3]), PART, {"jumps": [6],
         "part of them": [0.5], "periods below and above": [1, 2, 2, 2] * 3}),
        (Given(jumps=lambda row: [0.2]), NO)],
    "jumps_lose_stability": [(Given(period_at(lambda row, x: 1 + (x > 0.2)), lambda row: [0.2]), YES),
        (Given(jumps=lambda row: [0.2]), NO)],
    "stick_transition": [
        (Given(slips_to(lambda row: 0.4 + 0.1 * (1.0 - ratio_of(row)))), YES,
         {"last slip": [0.4, 0.416, 0.424, 0.432]}),
        (Given(slips_to(lambda row: 0.4)), NO)],
    "transition_by_smoothing": [
        (Given(slips_to(lambda row: 0.4 + 0.2 * (1.0 - ratio_of(row)) * (law_of(row) == "smoothed"))), YES),
        (Given(slips_to(lambda row: 0.4 + 0.2 * (1.0 - ratio_of(row)))), NO)],
    "jump_doubles_period": [(Given(period_at(lambda row, x: 1 + (x > 0.205)), lambda row: [0.205]), YES),
        (Given(period_at(lambda row, x: 1), lambda row: [0.205]), NO),
        (Given(period_at(lambda row, x: 1 + (x > 0.25)), lambda row: [0.25]), NO),
        (Given(period_at(lambda row, x: 1 + (x > 0.205)), lambda row: [0.205, 0.3]), YES, {"periods around": [1, 2]})],
    "doubling_to_chaos": [
        (Given(period_at(lambda row, x: 2 if x > 0.7 else 0), lambda row: [0.2]), YES, {"omega/omega_n": [0.202],
         "period at 0.83": [2], "mu_k/mu_s without": [0.56 + 0.01 * k for k in range(15)],
         "diagnosis": ["chaotic", 0.0, 1.0] * 6}),
        (Given(period_at(lambda row, x: 2 if x > 0.7 else 0), lambda row: [0.05, 0.2]), YES,
         {"omega/omega_n": [0.202]}),
        (Given(period_at(lambda row, x: 2), lambda row: [0.2]), NO),
        (Given(period_at(lambda row, x: 1 if x > 0.7 else 0), lambda row: [0.2]), PART)],
    "period_one_near_unity": [(Given(orbit(0.92, 0.92, 0.92)), YES),
        (Given(orbit(0.95, 0.92, 0.92)), NO, {"periods": [1, 2]})],
    "period_two_from": [(Given(orbit(0.85, 0.85, 0.92), stretches=fig6(0.77, 0.918, 0.67)), YES),
        (Given(orbit(0.92, 0.92, 0.77), stretches=fig6(0.77, 0.918, 0.67)), PART),
        (Given(orbit(0.92, 0.92, 0.77), stretches=fig6(0.77, 0.85, 0.67)), NO),
        (Given(orbit(0.92, 0.92, 0.77), stretches=fig6(0.92, 0.92, 0.67, "period_doubling")), NO),
        (Given(orbit(0.85, 0.92, 0.9), stretches=fig6(0.77, 0.918, 0.67)), PART, {"stable period two": [0.918],
         "highest mu_k/mu_s": [0.85, 0.92, 0.9]})],
    "aperiodic_from": [
        (Given(orbit(0.9, 0.9, 0.9, 0.7), stretches=fig6(0.77, 0.918, 0.67)), YES,
         {"period one or two down to": [0.67], "highest mu_k/mu_s": [0.7] * 3}),
        (Given(orbit(0.9, 0.9, 0.9, 0.7), stretches=fig6(0.77, 0.76, 0.67)), PART),
        (Given(orbit(0.9, 0.9, 0.9, 0.6), stretches=fig6(0.77, 0.918, 0.67)), NO),
        (Given(orbit(0.9, 0.9, 0.9, 0.6), stretches=fig6(0.77, 0.918, 0.58)), NO)],
    "three_motions": [
        (Given(period_at(lambda row, x: {0.94: 1, 0.74: 2, 0.64: 0}[ratio_of(row)]), longer="chaotic"), YES,
         {"periods": [1, 2, 0], "exponent at 0.64": ["0.5 +- 0.5"], "diagnosis": ["chaotic"]}),
        (Given(period_at(lambda row, x: {0.94: 1, 0.74: 2, 0.64: 0}[ratio_of(row)]), longer="unresolved"), PART),
        (Given(period_at(lambda row, x: 1)), NO)],
    "phase_attenuates": [(Given(lowest("pressure.phase", 0.0)), YES),
        (Given(lowest("pressure.phase", 0.0, place=0.2)), PART), (Given(lowest("pressure.phase", 0.0, low=-1.0)), NO),
        (Given(between), NO),
        (Given(lowest("pressure.phase", 0.0, place=0.27)), PART, {"part at which it is the lowest": [44 / 49],
         "mean maxima": [10.0 + (5 - 44) / 49, 10.0, 10.0],
         "another curve is lower at": [0.27, 0.275, 0.28, 0.285, 0.29]})],
    "phase_attenuates_least": [(Given(lowest("pressure.phase", 0.0)), YES),
        (Given(lowest("pressure.phase", 0.0, place=0.35)), PART), (Given(lowest("pressure.phase", 0.0, high=-1.0)), NO),
        (Given(lowest("pressure.phase", 0.0, place=0.27)), YES, {"part at which it is the highest": [1.0],
         "mean maxima": [11.0, 10.0, 10.0]})],
    "phase_bifurcations": [(Given(), YES), (Given(period_at(lambda row, x: 1 + (x > 0.49))), NO),
        (Given(at_phase(math.pi, 2, 1)), PART, {"periods": [1, 1, 2]})],
    "phase_jumps": [(Given(), YES),
        (Given(jumps=lambda row: [0.2] if phase_is(row, math.pi) else []), NO, {"jumps": [0.2]})],
    "stick_below_018": [(Given(slips_from(lambda row: 0.18)), YES),
        (Given(slips_from(lambda row: 0.18 if law_of(row) == "smoothed" else 0.10)), PART,
         {"lowest slip and highest stick, smoothed": [0.18, 0.179],
         "lowest slip and highest stick, set_valued": [0.1, 0.099]}),
        (Given(slips_from(lambda row: 0.10)), NO), (Given(slips_from(lambda row: 0.21)), NO)],
    "actuation_periods": [(Given(period_at(denominators)), YES),
        (Given(period_at(lambda row, x: coprime(row) if abs(x * OMEGA_N - 150.0) < 1e-6 else 5)), PART,
         {"at 150 rad/s": [2, 1, 3, 3], "at the slipping ratios": [5] * 6}),
        (Given(period_at(lambda row, x: 7)), NO)],
    "actuation_bifurcations": [(Given(period_at(denominators)), YES),
        (Given(period_at(lambda row, x: coprime(row) * (1 + (x > 0.49)))), NO)],
    "actuation_attenuates": [(Given(next_to(lowest("pressure.frequency_ratio", 1.0))), YES),
        (Given(next_to(lowest("pressure.frequency_ratio", 1.0), 8.0)), PART),
        (Given(next_to(lowest("pressure.frequency_ratio", 1.0, low=-1.0))), NO),
        (Given(next_to(lowest("pressure.frequency_ratio", 1.0), 9.5)), YES, {"lowest of its figure": [1.0, 1.0],
         "lower than Tsp = 0": [0.0, 1.0, 0.0, 0.0, 0.0]})],
    "actuation_reversed": [(Given(next_to(lowest("pressure.frequency_ratio", 1.0))), YES),
        (Given(next_to(lowest("pressure.frequency_ratio", 1.0, high=-1.0), 8.0)), PART),
        (Given(next_to(lowest("pressure.frequency_ratio", 1.0, high=-1.0))), NO),
        (Given(next_to(lowest("pressure.frequency_ratio", 1.0, place=0.4))), NO,
         {"above Tsp = 0": [0.0, 11 / 29, 0.0, 0.0, 0.0], "highest of its figure": [11 / 29] * 2})],
    "amplitude_attenuates": [(Given(by_amplitude((-1.0, 1.0))), YES), (Given(by_amplitude((1.0, 1.0))), NO)],
    "amplitude_reversed": [
        (Given(by_amplitude((1.0, 1.0))), YES, {"part in order": [1.0], "mean maxima": [10.0, 10.125, 10.25, 10.5]}),
        (Given(by_amplitude((-1.0, -1.0))), NO)],
    "amplitude_bifurcations": [(Given(), YES), (Given(period_at(lambda row, x: 0 if x > 0.49 else 1)), NO)],
    "period_is_denominator": [(Given(period_at(denominators)), YES), (Given(), PART, {"periods": [1] * 19}),
        (Given(period_at(lambda row, x: 7)), NO)],
    "period_for_any": [(Given(period_at(denominators)), YES),
        (Given(period_at(lambda row, x: coprime(row) * (1 + (x > 0.4)))), NO)],
    "proof_is_whole": [(Given(period_at(denominators)), YES),
        (Given(period_at(lambda row, x: coprime(row) * (1 + (x > 0.4 and ratio_of(row) < 1.0)))), PART,
         {"multiples of N": [4, 2, 2, 6, 2, 6], "at mu_k = mu_s": []}),
        (Given(period_at(lambda row, x: coprime(row) * (1 + 3 * (x > 0.4)))), NO)],
    "as_dual_excitation": [(Given(dual(1)), YES), (Given(dual(2)), NO, {"1/2": [2, 4], "2/1": [1, 2], "2/3": [3, 6]})],
    "slope_is_the_cause": [(Given(period_at(lambda row, x: 0 if ratio_of(row) < 1.0 else coprime(row))), YES),
        (Given(period_at(lambda row, x: 0 if x > 0.6 * ratio_of(row) - 0.15 else coprime(row))), PART),
        (Given(period_at(lambda row, x: 0 if x > 0.55 - 0.1 * ratio_of(row) else coprime(row))), NO)],
    **{name: [(Given(lowest("pressure.phase", 0.0)), YES),
              (Given(lowest("pressure.phase", 0.0, high=1.0, place=0.22)), PART),
              (Given(lowest("pressure.phase", 0.0, high=1.0, place=0.1)), NO)]
       for name in ("phase_with_falling_law", "phase_with_steeper_law")},
    "phase_pi_is_worst": [(Given(lambda row, x, d: record(10.0 + row["pressure.phase"])), YES),
        (Given(lambda row, x, d: record(10.0 + row["pressure.phase"] * (ratio_of(row) - 0.7))), PART),
        (Given(lambda row, x, d: record(10.0 - row["pressure.phase"])), NO)],
    "new_peaks": [(Given(lambda row, x, d: hills(0.2)(row, x, d) if ratio_of(row) < 1.0 else record(10.0)), YES),
        (Given(lambda row, x, d: hills(0.2)(row, x, d) if ratio_of(row) < 1.0 and phase_is(row,
         0.0) else record(10.0)), PART),
        (Given(hills(0.2)), NO), (Given(hills(0.1, 0.2)), NO, {"peaks below": [2] * 6})],
    "fifty_suffice": [(Given(), YES),
        (Given(lambda row, x, d: record(settled=x < 0.3)), NO, {"settled part": [50 / 91] * 33})],
    "earlier_onset": [
        (Given(slips_from(lambda row: 0.15 if ratio_of(row) < 1.0 else 0.18)), YES, {"lowest slip at": [0.18, 0.15]}),
        (Given(slips_from(lambda row: 0.18)), NO)],
    "phase_reversed": [(Given(lowest("pressure.phase", 0.0)), YES),
        (Given(lowest("pressure.phase", 0.0, place=0.35)), PART), (Given(lowest("pressure.phase", 0.0, high=-1.0)), NO),
        (Given(lowest("pressure.phase", 0.0), stretches=other_phase(20.0)), PART),
        (Given(lowest("pressure.phase", 0.0), stretches=other_phase(9.0)), YES),
        (Given(lowest("pressure.phase", 0.0, place=0.38), stretches=other_phase(10.5)), PART,
         {"worst for every choice": [15 / 29] * 4, "from (13)": [15 / 29] * 2})],
    "stick_below_015": [(Given(slips_from(lambda row: 0.15)), YES), (Given(slips_from(lambda row: 0.07)), NO)],
    "jump_to_chaos": [
        (Given(period_at(lambda row, x: 0 if x > 0.352 else 1), stretches=ending(0.352)), YES,
         {"stable motions end": [0.352], "steep rises": [], "period below 0.3520": [1], "above 0.3520": [0, 0.0, 1.0,
         "chaotic"] * 3}),
        (Given(period_at(lambda row, x: 0 if x > 0.352 else 1), lyapunov="unresolved", stretches=ending(0.352)), PART),
        (Given(lambda row, x, d: record(10.0 if x < 0.352 else 14.0, 0 if x > 0.352 else 1)), PART),
        (Given(period_at(lambda row, x: 0), stretches=ending(0.352)), NO),
        (Given(period_at(lambda row, x: 0 if x > 0.30 else 1), stretches=ending(0.30)), NO),
        (Given(thirds), NO, {"stable motions end": [], "steep rises": [0.2025, 0.2975]})],
    "phase_pi_is_smooth": [(Given(), YES),
        (Given(jumps=lambda row: [0.2], stretches=ending(0.2), reached=lambda row: {0}), NO),
        (Given(jumps=lambda row: [0.2], stretches=ending(0.2), reached=lambda row: {1}), PART),
        (Given(period_at(lambda row, x: 1 if x < 0.4 else 2)), PART),
        (Given(period_at(lambda row, x: 1 if phase_is(row, math.pi) else 2)), YES),
        (Given(period_at(lambda row, x: 1 if x < 0.15 else 2)), NO),
        (Given(at_phase(math.pi, 1, 2)), YES, {"part with period 1": [1.0], "periods": [1]})],
    "severity_follows_abruptness": [
        (Given(severe(True), severe_jumps), YES, {"jumps": [9], "with the size of the jump": [1.0],
         "with the maximum": [-1.0]}),
        (Given(severe(False), severe_jumps), NO)],
    "more_with_steeper_law": [
        (Given(period_at(lambda row, x: 0 if x > ratio_of(row) - 0.3 else 1)), PART,
         {"aperiodic part": [10 / 91] * 3 + [26 / 91] * 3, "changes of period": [1] * 6}),
        (Given(period_at(lambda row, x: 0 if x > ratio_of(row) - 0.3 and round(x / 0.005) % 2 else 1)), YES),
        (Given(period_at(lambda row, x: 0 if x > 1.1 - ratio_of(row) else 1)), NO)],
    "same_frequency_suppresses": [(Given(lowest("pressure.frequency_ratio", 1.0)), YES),
        (Given(lowest("pressure.frequency_ratio", 2.0)), NO),
        (Given(lowest("pressure.frequency_ratio", 1.0, place=0.22)), PART)],
    "half_frequency_jumps": [
        (Given(lambda row, x,
         d: record(10.0 + 5.0 * (round(x / 0.005) % 2) * (row["pressure.frequency_ratio"] == 0.5))), YES),
        (Given(), NO), (Given(thirds), NO, {"changes for": [2] * 3})],
    "half_frequency_aperiodic": [(Given(period_at(lambda row, x: 0 if x < 0.49 else 2)), YES),
        (Given(period_at(lambda row, x: 0 if row["pressure.frequency_ratio"] != 0.5 else 2)), NO),
        (Given(period_at(lambda row, x: 0 if x < 0.4 else 2)), PART),
        (Given(period_at(lambda row, x: 0 if x < 0.2 else 2)), NO),
        (Given(period_at(lambda row, x: 0 if x < 0.4 else 2), periodic=lambda x: x > 0.3), PART,
         {"aperiodic part": [70 / 91] * 3, "some motion aperiodic": [70 / 91], "a stable periodic": [40 / 91]})],
    "mismatch_with_falling_law": [
        (Given(lambda row, x, d: record(9.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0,
         0 if ratio_of(row) < 1.0 and x > 0.3 else coprime(row))), YES),
        (Given(period_at(lambda row, x: 0 if ratio_of(row) < 1.0 else coprime(row))), YES),
        (Given(lambda row, x, d: record(11.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0, coprime(row))), NO),
        (Given(lambda row, x, d: record(9.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0, coprime(row))), PART,
         {"part off the period": [0.0] * 6, "omega_f = omega best": [1.0], "not at": []}),
        (Given(lambda row, x, d: record(11.0 if row["pressure.frequency_ratio"] == 1.0 else 10.0,
         0 if ratio_of(row) < 1.0 else coprime(row))), PART)],
    "amplitude_makes_stick": [
        (Given(lambda row, x, d: record(period=0,
         regime="stick" if row["pressure.amplitude"] > 5e4 else "stick-slip")), YES),
        (Given(lambda row, x, d: record(period=2,
         regime="stick" if row["pressure.amplitude"] > 5e4 else "stick-slip")), PART,
         {"pure stick": [0.0, 0.0, 1.0, 1.0], "no period": [0.0] * 4}),
        (Given(), NO)],
    "amplitude_jumps": [(Given(stretches=ending(0.25, 0.35)), YES),
        (Given(stretches=ending(0.25)), PART, {"stable motions end": [0.25] * 2}), (Given(stretches=ending(0.30)), NO)],
    "amplitude_enlarges_slip": [(Given(by_amplitude((1.0, 1.0))), YES, {"mean maxima": [10.0, 10.125, 10.25, 10.5]}),
        (Given(lambda row, x, d: record(10.0 + (row["pressure.amplitude"] > 1e5))), PART), (Given(), NO)],
    "amplitude_enlarges_jumps": [(Given(jumps=growing), YES, {"largest jump there": [10.0, 11.0, 12.0, 13.0]}),
        (Given(jumps=lambda row: growing(row)[-2:]), PART), (Given(jumps=lambda row: [0.25]), NO)],
    "amplitude_aperiodic": [
        *((Given(period_at(lambda row, x, only=share * 225e3: int(row.get("pressure.amplitude", 0.0) != only or min(
            abs(x - 0.25), abs(x - 0.35)) > 0.01))), says) for share, says in ((0.125, NO), (0.25, YES), (0.5, YES))),
        (Given(period_at(lambda row, x: 0 if min(abs(x - 0.25), abs(x - 0.35)) < 0.01 else 1)), YES),
        (Given(period_at(lambda row, x: 0 if abs(x - 0.25) < 0.01 else 1)), PART),
        (Given(period_at(lambda row, x: 0)), NO),
        (Given(period_at(lambda row, x: 0 if abs(x - 0.25) < 0.006 else 1)), PART,
         {"part without a period near": [1 / 3, 0.0]})],
    "slope_exaggerates": [(Given(lambda row, x, d: record(20.0 + ratio_of(row))), NO),
        (Given(lambda row, x, d: record(20.0 - 10.0 * ratio_of(row))), YES,
         {"mean maxima": [10.0, 11.7, 12.5, 13.33], "largest of all": [10.0, 11.7, 12.5, 13.33]})],
    "slope_exaggerates_varying": [(Given(lambda row, x, d: record(20.0 - ratio_of(row))), YES),
        (Given(lambda row, x, d: record(20.0 + ratio_of(row))), NO)],
}
"""By claim: evidence, verdict, and numbers counted by hand, by the beginning of their name."""


ALWAYS = {"actuation_reversed", "aperiodic_from", "earlier_onset", "fifty_suffice", "proof_is_whole", "stick_below_015",
          "stick_below_018"}
SELDOM = {"amplitude_aperiodic", "half_frequency_aperiodic", "jump_is_bifurcation", "jumps_lose_stability", "new_peaks",
          "peaks_move", "period_for_any", "phase_attenuates", "phase_attenuates_least", "phase_pi_is_smooth",
          "phase_reversed", "phase_with_falling_law", "phase_with_steeper_law", "same_frequency_suppresses",
          "severity_follows_abruptness", "super_harmonic_jumps", "super_harmonic_peaks", "transition_by_smoothing"}
SEVERAL = {"jump_to_chaos", "mismatch_with_falling_law"}
"""Claims with a reason for any verdict, for one that does not confirm, and in cases of their own; others have none."""


def explained(name: str, verdict: str) -> bool:
    """Whether the verdict on a claim comes with a reason."""
    own = {"lost_at_peaks": verdict == PART, "period_two_from": verdict != NO}
    return own.get(name, name in ALWAYS or (name in SELDOM and verdict != YES))


def leaves(value: Any) -> list[Any]:
    """The numbers and words of nested results, in order."""
    if isinstance(value, dict):
        value = list(value.values())
    return [x for part in value for x in leaves(part)] if isinstance(value, (list, tuple)) else [value]


@pytest.mark.parametrize(("name", "case"), [pytest.param(name, case, id=f"{name}-{case[1]}-{k}")
                                            for name, cases in CASES.items() for k, case in enumerate(cases)])
def test_verdict_and_numbers_follow_what_a_claim_is_given(name: str, case: tuple[Any, ...]) -> None:
    given, verdict, *numbers = case
    result = rows[name](given)
    assert result.verdict == verdict
    assert name in SEVERAL or bool(result.why) == explained(name, verdict)
    assert set(rows[name].labels.values()) - {"another curve is lower at"} <= set(result.values)
    for words, expected in (numbers[0] if numbers else {}).items():
        (key,) = [key for key in result.values if key.startswith(words)][:1]
        assert leaves(result.values[key]) == pytest.approx(expected, abs=1e-9), key


def test_every_claim_has_a_case_that_flips_it() -> None:
    assert [name for name, cases in CASES.items() if len({verdict for _, verdict, *_ in cases}) < 2] == []
    apart = {"damping_crosses", "damping_falls", "delay", "solvers_agree", "classical_differs", "maximum_falls",
             "slope_turns_negative", "pure_slip_guaranteed", "series_balance", "limits_of_stick",
             "stick_limits_varying", "positive_trend_slips", "critical_frequency", "shows_in_both",
             "section_varies_less", "smoothing_is_uncertain", "discontinuous_is_slow", "smoothed_stick_creeps",
             "balance_unsuitable"}
    assert set(rows) == set(CASES) | apart


@pytest.mark.parametrize(("criterion", "judged", "verdict"), [
    (holds("a"), (True,), YES), (holds("a"), (False,), NO), (holds("a", "b"), (False, True), PART),
    (shares("a"), (0.95, 1.0), YES), (shares("a"), (0.8, 1.0), PART), (shares("a"), (0.8, 0.76), PART),
    (shares("a"), (0.3, 0.96), PART), (shares("a"), (0.3, 0.8), NO), (shares("a", 0.2), (0.3, 0.8), PART),
    (near("a", 0.1), ((1.05, 1.0),), YES), (near("a", 0.1), ((1.05, 1.0), (None, 1.0)), PART),
    (near("a", 0.1), ((1.2, 1.0), (math.nan, 1.0)), NO),
    (equal("a"), ((1, 1), (2, 2)), YES), (equal("a"), ((1, 1), (2, 3)), PART), (equal("a"), ((2, 3),), NO)])
def test_criteria(criterion: Any, judged: Any, verdict: str) -> None:
    assert criterion.verdict(judged, lambda name: getattr(T, name)) == verdict
