"""Every verdict can come out either way: each claim judged on curves and motions of the test's own."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from given import Given, law_of, record, stretch

from tcc_sim.paper import claims, claims_interaction, claims_varying_load
from tcc_sim.paper import claims_constant_load as constant
from tcc_sim.paper import claims_model as model
from tcc_sim.paper.catalogue import OMEGA_N, STATIC
from tcc_sim.paper.evidence import CONFIRMED, DEPENDS, KINETIC, NOT_CONFIRMED

varying, mixed = claims_varying_load, claims_interaction


def ratio_of(row: Any) -> float:
    """mu_k/mu_s of a row."""
    return round(float(row.get(KINETIC, STATIC)) / STATIC, 4)


def phase_is(row: Any, value: float) -> bool:
    return bool(abs(row["pressure.phase"] - value) < 1e-9)


def lowest(key: str, wanted: float, low: float = 1.0, high: float = 1.0, place: float = 0.3) -> Callable[..., Any]:
    """A curve that is lowest below `place` and highest above where `key` has the wanted value."""
    def at(row: Any, x: float, direction: str) -> dict[str, Any]:
        if abs(row[key] - wanted) < 1e-9:
            return record(10.0 - low if x < place else 10.0 + high)
        return record(10.0)
    return at


def slips_to(end: Callable[[Any], float]) -> Callable[..., Any]:
    return lambda row, x, direction: record(regime="stick-slip" if x <= end(row) else "stick")


def slips_from(start: Callable[[Any], float]) -> Callable[..., Any]:
    return lambda row, x, direction: record(regime="stick-slip" if x >= start(row) else "stick")


def by_amplitude(order: tuple[float, float]) -> Callable[..., Any]:
    """Fig. 13: how the maxima change with Tsp below and above 0.3."""
    return lambda row, x, direction: record(10.0 + order[x > 0.3] * row["pressure.amplitude"] / 225e3)


def orbit(cold: float, up: float, down: float, start: float = 0.7) -> Callable[..., Any]:
    """Fig. 6: period two below an end of its own in each direction, none below `start`."""
    def at(row: Any, x: float, direction: str) -> dict[str, Any]:
        end = {"cold": cold, "up": up, "down": down}[direction]
        return record(period=0 if x <= start else 2 if x <= end + 1e-9 else 1)
    return at


def period_at(periods: Callable[[Any, float], int]) -> Callable[..., Any]:
    return lambda row, x, direction: record(period=periods(row, x))


def coprime(row: Any) -> int:
    from fractions import Fraction
    return Fraction(row["pressure.frequency_ratio"]).limit_denominator(12).denominator


def denominators(row: Any, x: float) -> int:
    return coprime(row)


NAMED = [0.167, 0.20, 0.25, 0.333]
SMALL = {0.83: 0.0, 0.75: 0.004, 0.667: 0.008}


def sharp(shift: float) -> Callable[..., Any]:
    """Fig. 4: one peak near 0.2 for every mu_k, each shifted from the last."""
    def at(row: Any, x: float, direction: str) -> dict[str, Any]:
        place = 0.2 + shift * SMALL[ratio_of(row)]
        return record(10.0 + 20.0 * math.exp(-((x - place) / 0.004) ** 2))
    return at


def uneven(severe_where_steep: bool) -> Callable[..., Any]:
    """Fig. 14: a smooth hill and a small saw; period four on one of them."""
    def at(row: Any, x: float, direction: str) -> dict[str, Any]:
        steep = x > 0.35
        slip = (5.0 + 3.0 * (round(x / 0.005) % 2)) if steep else 30.0 - 20.0 * abs(x - 0.2)
        return record(slip, period=4 if steep == severe_where_steep else 1)
    return at


def ending(*places: float, kind: str = "jump fold") -> Callable[..., Any]:
    """Stable motions that end at these places, and one over the whole range."""
    return lambda row: [*(stretch(x - 0.03, x, ends=kind) for x in places), stretch(0.05, 0.5)]


def fig6(one: float, two: float, end: float, kind: str = "jump fold") -> Callable[..., Any]:
    """Fig. 6: period one down to `one`, period two between its ends."""
    return lambda row: [stretch(one, 1.0, begins="jump period_doubling"), stretch(end, two, 2, 48.0, "jump fold", kind)]


def other_phase(height: float) -> Callable[..., Any]:
    """A second stable motion for every phase but 0."""
    return lambda row: [] if phase_is(row, 0.0) else [stretch(0.3, 0.5, amplitude=height)]


CASES: list[tuple[Any, Given, str]] = [
    (constant.smooth_when_equal, Given(), CONFIRMED),
    (constant.smooth_when_equal, Given(jumps=lambda row: [0.2]), NOT_CONFIRMED),
    (constant.super_harmonic_jumps, Given(stretches=ending(*NAMED)), CONFIRMED),
    (constant.super_harmonic_jumps, Given(stretches=ending(*NAMED[:3])), DEPENDS),
    (constant.super_harmonic_jumps, Given(stretches=ending(0.45)), NOT_CONFIRMED),
    (constant.super_harmonic_jumps, Given(stretches=ending(*NAMED, kind="period_doubling")), NOT_CONFIRMED),
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
    (constant.period_two_from, Given(orbit(0.85, 0.92, 0.85), stretches=fig6(0.77, 0.918, 0.67)), CONFIRMED),
    (constant.period_two_from, Given(orbit(0.92, 0.92, 0.92), stretches=fig6(0.77, 0.85, 0.67)), NOT_CONFIRMED),
    (constant.period_two_from, Given(orbit(0.92, 0.92, 0.92), stretches=fig6(0.92, 0.92, 0.67, "period_doubling")),
     NOT_CONFIRMED),
    (constant.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.7), stretches=fig6(0.77, 0.918, 0.67)), CONFIRMED),
    (constant.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.7), stretches=fig6(0.77, 0.76, 0.67)), DEPENDS),
    (constant.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.6), stretches=fig6(0.77, 0.918, 0.67)), NOT_CONFIRMED),
    (constant.aperiodic_from, Given(orbit(0.9, 0.9, 0.9, 0.6), stretches=fig6(0.77, 0.918, 0.58)), NOT_CONFIRMED),
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
    (mixed.phase_reversed, Given(lowest("pressure.phase", 0.0), stretches=other_phase(20.0)), DEPENDS),
    (mixed.phase_reversed, Given(lowest("pressure.phase", 0.0), stretches=other_phase(9.0)), CONFIRMED),
    (mixed.stick_below_015, Given(slips_from(lambda row: 0.15)), CONFIRMED),
    (mixed.stick_below_015, Given(slips_from(lambda row: 0.07)), NOT_CONFIRMED),
    (mixed.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.352 else 1), stretches=ending(0.352)), CONFIRMED),
    (mixed.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.352 else 1), lyapunov="unresolved",
                                stretches=ending(0.352)), DEPENDS),
    (mixed.jump_to_chaos, Given(lambda row, x, d: record(10.0 if x < 0.352 else 14.0, 0 if x > 0.352 else 1)), DEPENDS),
    (mixed.jump_to_chaos, Given(period_at(lambda row, x: 0), stretches=ending(0.352)), NOT_CONFIRMED),
    (mixed.jump_to_chaos, Given(period_at(lambda row, x: 0 if x > 0.30 else 1), stretches=ending(0.30)), NOT_CONFIRMED),
    (mixed.phase_pi_is_smooth, Given(), CONFIRMED),
    (mixed.phase_pi_is_smooth, Given(jumps=lambda row: [0.2], stretches=ending(0.2), reached=lambda row: {0}),
     NOT_CONFIRMED),
    (mixed.phase_pi_is_smooth, Given(jumps=lambda row: [0.2], stretches=ending(0.2), reached=lambda row: {1}), DEPENDS),
    (mixed.phase_pi_is_smooth, Given(period_at(lambda row, x: 1 if x < 0.4 else 2)), DEPENDS),
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
    (mixed.half_frequency_aperiodic, Given(period_at(lambda row, x: 0 if x < 0.4 else 2), periodic=lambda x: x > 0.4),
     CONFIRMED),
    (mixed.half_frequency_aperiodic, Given(period_at(lambda row, x: 0 if x < 0.4 else 2), periodic=lambda x: x > 0.2),
     DEPENDS),
    (mixed.half_frequency_aperiodic, Given(period_at(lambda row, x: 0 if x < 0.4 else 2)), NOT_CONFIRMED),
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
    (mixed.amplitude_jumps, Given(stretches=ending(0.25, 0.35)), CONFIRMED),
    (mixed.amplitude_jumps, Given(stretches=ending(0.25)), DEPENDS),
    (mixed.amplitude_jumps, Given(stretches=ending(0.30)), NOT_CONFIRMED),
    (mixed.amplitude_aperiodic, Given(period_at(lambda row, x: 0 if abs(x - 0.3) < 0.06 else 1)), CONFIRMED),
    (mixed.amplitude_aperiodic, Given(period_at(lambda row, x: 0 if abs(x - 0.25) < 0.01 else 1)), DEPENDS),
    (mixed.amplitude_aperiodic, Given(), NOT_CONFIRMED),
]


@pytest.mark.parametrize(("claim", "given", "verdict"), CASES,
                         ids=[f"{c.__name__}-{v}-{k}" for k, (c, _, v) in enumerate(CASES)])
def test_a_verdict_follows_what_it_is_given(claim: Any, given: Given, verdict: str) -> None:
    assert claim(given).verdict == verdict


def test_every_claim_has_a_case_that_flips_it() -> None:
    verdicts: dict[Any, set[str]] = {}
    for claim, _, verdict in CASES:
        verdicts.setdefault(claim, set()).add(verdict)
    assert [c.__name__ for c, found in verdicts.items() if len(found) < 2] == []
    apart = {constant.damping_crosses, varying.delay, model.solvers_agree, model.classical_differs, model.maximum_falls,
             model.slope_turns_negative, model.pure_slip_guaranteed, model.series_balance}
    assert set(claims.CLAIMS) == set(verdicts) | apart
