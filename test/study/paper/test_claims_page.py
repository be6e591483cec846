"""The page of claims, line by line, for three verdicts written down here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tcc_sim.result import json_of
from tcc_sim.study.paper import claims
from tcc_sim.study.paper.rules import CONFIRMED, DEPENDS, NOT_CONFIRMED, Claim, Finding, Measured, holds

YES, NO, PART = CONFIRMED, NOT_CONFIRMED, DEPENDS
ROW = Claim("4", "5.1", "it_peaks", holds("it is"), lambda evidence: Measured((True,), {}), "a")
MOTION = {"words": "period 2, stable"}
VERDICTS = [
    claims.Verdict(ROW, Finding({}, YES), {225e3: (YES, YES), 230e3: (YES,)}, {"near": [YES, NO], "jump": [NO, PART]}),
    claims.Verdict(replace(ROW, figure="6", sentence="it moves", fitted=True), Finding(
        {"x": [1.5, None], "n": 3}, NO, "since it does not", [MOTION, MOTION]), {225e3: (NO, YES), 230e3: (YES,)},
        {"near": [PART, PART]}),
    claims.Verdict(replace(ROW, figure="(35)", sentence="whole", alone=True), Finding({}, NO, motions=[MOTION]),
                   {225e3: (NO, NO)})]


def test_the_page_of_three_claims_is_written_line_by_line() -> None:
    introduction = claims.INTRODUCTION.format(kpa="225, 230 kPa", first="225", fitting="225, 230, 240", tolerance=1e-9,
                                              tighter=1e-11, later=500)
    page = claims.claims_page(VERDICTS, complete=False).replace(introduction, "(introduction)\n")
    assert page == Path(__file__).with_name("page.txt").read_text()
    assert claims.claims_page(VERDICTS[2:]).count("\n") < 30  # Without a table of thresholds.


def test_a_verdict_in_json() -> None:
    result = json_of(VERDICTS[1])
    assert {name: result[name] for name in ("figure", "where", "claim", "criterion", "verdict", "verdicts", "pressures",
                                            "depends_on", "why", "fitted", "values", "motions", "thresholds")} == {
        "figure": "6", "where": "5.1", "claim": "it moves", "criterion": "it is", "verdict": PART,
        "verdicts": {"1e-09": NO, "1e-11": YES}, "pressures": {"225": PART, "230": YES}, "depends_on": "pressure",
        "why": "the verdict changes with the tolerance; the verdict changes with the mean pressure: depends at "
               "225 kPa, confirmed at 230 kPa; since it does not",
        "fitted": True, "values": {"x": [1.5, None], "n": 3}, "motions": [MOTION, MOTION],
        "thresholds": {"near": [PART, PART]}}


@pytest.mark.parametrize(("judged", "on", "words"), [
    ({225e3: (YES, YES), 230e3: (YES,)}, None, "confirmed"),
    ({225e3: (PART, PART)}, "part", "depends: it holds in part"),
    ({225e3: (NO, YES), 230e3: (PART,)}, "tolerance", "depends on the tolerance"),
    ({225e3: (NO, NO), 230e3: (PART,)}, "pressure", "depends on the pressure"),
    ({225e3: (NO, YES), 230e3: (YES,)}, "pressure", "depends on the pressure")])
def test_a_verdict_says_on_what_it_depends(judged, on, words) -> None:  # type: ignore[no-untyped-def]
    verdict = claims.Verdict(ROW, Finding({}, YES), judged)
    assert (verdict.depends_on, verdict.words) == (on, words)
