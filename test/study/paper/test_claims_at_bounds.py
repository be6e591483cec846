"""Claims just at and just beyond the bounds of their criteria, by curves and motions written down here."""

from __future__ import annotations

from typing import Any

import pytest
from given import (
    Given,
    coprime,
    growing,
    law_of,
    lowest,
    next_to,
    phase_is,
    ratio_of,
    record,
    rows,
    slips_from,
    stretch,
)

from tcc_sim.study.paper.rules import CONFIRMED, DEPENDS, NOT_CONFIRMED

YES, NO, PART = CONFIRMED, NOT_CONFIRMED, DEPENDS


def one_jump(x: float, kind: str = "jump fold", period_above: int = 0, below: int = 1,
             lyapunov: str = "chaotic") -> Given:
    """Fig. 14, psi = 0: a stable motion that ends at x, with periods on either side."""
    return Given(lambda row, at, d: record(period=below if at < x else period_above), lyapunov=lyapunov,
                 stretches=lambda row: [stretch(0.33, x, ends=kind)])


def onsets(smoothed: tuple[float, float], exact: tuple[float, float]) -> Given:
    """First slip of Figs. 8 and 14 by law."""
    return Given(slips_from(lambda row: (smoothed if law_of(row) == "smoothed" else exact)[ratio_of(row) < 1.0]))


def parts(same: float, falling: float) -> Given:
    """Part of the slipping ratios off the period of (35), where mu_k = mu_s and where it falls."""
    def period(row: Any, x: float, direction: str) -> Any:
        wild = x < 0.05 + 0.455 * (same if ratio_of(row) == 1.0 else falling)
        return record(period=0 if wild else coprime(row) if "pressure.frequency_ratio" in row else 1)

    return Given(period)


@pytest.mark.parametrize(("name", "given", "verdict"), [
    ("jump_to_chaos", one_jump(0.369), YES), ("jump_to_chaos", one_jump(0.3701), NO),
    ("jump_to_chaos", one_jump(0.331), YES), ("jump_to_chaos", one_jump(0.3299), NO),
    ("jump_to_chaos", one_jump(0.35, period_above=2, lyapunov="periodic"), NO),
    ("jump_to_chaos", one_jump(0.35, below=0), NO),
    ("jump_to_chaos", one_jump(0.35, below=-2), NO), ("jump_to_chaos", one_jump(0.35, lyapunov="periodic"), PART),
    ("jump_to_chaos", one_jump(0.35, kind="fold"), NO),
    ("earlier_onset", onsets((0.18, 0.15), (0.18, 0.15)), YES),
    ("earlier_onset", onsets((0.18, 0.15), (0.18, 0.18)), PART),
    ("earlier_onset", onsets((0.15, 0.18), (0.15, 0.18)), NO),
    ("slope_is_the_cause", parts(0.0, 0.2), YES), ("slope_is_the_cause", parts(0.0, 0.05), PART),
    ("slope_is_the_cause", parts(0.1, 0.2), PART), ("slope_is_the_cause", parts(0.2, 0.2), NO),
    ("slope_is_the_cause", parts(0.2, 0.1), NO),
    ("amplitude_enlarges_jumps", Given(jumps=growing), YES),
    ("amplitude_enlarges_jumps", Given(jumps=lambda row: [0.3 + 0.011 * k for k in range(1, 1 + len(growing(row)))]),
     YES),
    ("amplitude_enlarges_jumps", Given(jumps=lambda row: [0.295] * len(growing(row))), NO),
    ("new_peaks", Given(lambda row, x, d: record(10.0 + 5.0 * (abs(x - 0.2) < 1e-3) * (ratio_of(row) < 1.0)
                                                 * (not phase_is(row, 0.0)))), PART),
    ("phase_pi_is_worst", Given(lambda row, x, d: record(10.0 + row["pressure.phase"] * (x <= 0.29))), YES),
    ("phase_pi_is_worst", Given(lambda row, x, d: record(10.0 + row["pressure.phase"] * (x > 0.29))), YES),
    ("half_frequency_jumps", Given(lambda row, x, d: record(
        10.0 + 5.0 * (x > 0.2) * (row["pressure.frequency_ratio"] != 2.0))), PART)])
def test_a_claim_at_its_bounds(name: str, given: Given, verdict: str) -> None:
    assert rows[name](given).verdict == verdict


@pytest.mark.parametrize(("sizes", "periods", "abrupt", "verdict"), [
    ([1, 2, 3], [1, 2, 3], 1.0, YES), ([1, 2, 3], [3, 2, 1], -1.0, NO), ([1, 2, 3], [2, 2, 2], 0.0, NO),
    ([1, 2, 3], [1, 2, 0], 1.0, YES), ([-3, -2, -1], [3, 2, 1], 1.0, YES)])
def test_severity_is_a_rank_correlation(sizes: Any, periods: Any, abrupt: float, verdict: str) -> None:
    """A motion without a period ranks above period 16, a jump down counts by its size, and equal ranks link nothing."""
    places = (0.2, 0.3, 0.4)

    class Jumps(Given):
        def jumps(self, row, axis):  # type: ignore[no-untyped-def]
            return list(zip(places, sizes))

    result = rows["severity_follows_abruptness"](Jumps(lambda row, x, d: record(
        10.0, period=periods[min(range(3), key=lambda k: abs(x - places[k]))])))
    assert (result.verdict, result.values["jumps"]) == (verdict, 9)
    assert next(v for k, v in result.values.items() if k.startswith("with the size")) == pytest.approx(abrupt)
    assert next(v for k, v in result.values.items() if k.startswith("with the maximum")) == 0.0


@pytest.mark.parametrize(("value", "text", "limit", "verdict"), [
    ({"1": 0.4, "0.83": 0.41, "0.75": 0.42, "0.667": 0.43}, 0, 0.5, (YES, NO)),
    ({"1": 0.4201, "0.83": 0.41, "0.75": 0.415, "0.667": 0.43}, 0, 0.5, (NO, NO)),
    ({"1": 0.4, "0.83": 0.4, "0.75": 0.42, "0.667": 0.43}, 0, 0.5, (NO, NO))])
def test_the_last_slip_depends_on_mu_k(value: Any, text: Any, limit: float, verdict: Any, monkeypatch: Any) -> None:
    """With equal ends of both laws the smoothing is not the cause; with half of the spread it is not either."""
    monkeypatch.setattr(Given, "last_slips", lambda evidence, law: value)
    assert (rows["stick_transition"](Given()).verdict, rows["transition_by_smoothing"](Given()).verdict) == verdict
    half = {**value, "0.667": value["1"] + 0.4999 * (value["0.667"] - value["1"])}
    monkeypatch.setattr(Given, "last_slips", lambda evidence, law: value if law == "smoothed" else half)
    assert rows["transition_by_smoothing"](Given()).verdict == YES
    half["0.667"] = value["1"] + 0.5001 * (value["0.667"] - value["1"])
    assert rows["transition_by_smoothing"](Given()).verdict == NO


def test_actuation_is_below_constant_load_where_it_slips() -> None:
    """By more than a difference that shows; a curve that does not slip is lower everywhere."""
    for given, low in ((Given(next_to(lowest("pressure.frequency_ratio", 1.0))), {1.0, 0.0}),
                       (Given(next_to(lambda row, x, d: record(9.96))), {0.0}),
                       (Given(next_to(lambda row, x, d: record(9.94))), {1.0}),
                       (Given(lambda row, x, d: record(0.09)), {1.0})):
        result = rows["actuation_attenuates"](given).values
        below = next(value for key, value in result.items() if key.startswith("lower than"))
        assert (set(below.values()), below["1.000"]) == (low, max(low))
