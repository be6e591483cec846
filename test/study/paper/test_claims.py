"""Claims with robust numbers, compared with closed forms where these exist, and the frame of the table."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documents import valid
from given import rows

from tcc_sim.cli import main
from tcc_sim.output.tables import escape, markdown_table
from tcc_sim.result import json_of
from tcc_sim.study.paper import claims
from tcc_sim.study.paper.branches_behind import StableMotions
from tcc_sim.study.paper.catalogue import OMEGA_N, paper_system
from tcc_sim.study.paper.evidence import Evidence, T
from tcc_sim.study.paper.rules import CONFIRMED, DEPENDS, NOT_CONFIRMED, Claim, Finding, Measured, holds, shares

PAGE = Path(__file__).resolve().parents[3] / ".github" / "paper" / "claims.md"


def test_the_stick_limit_is_that_of_the_closed_form() -> None:
    """(25a) by hand: the amplitude of the interface torque is mu_s N R - Tm at the limit, far above omega_sn."""
    result = rows["limits_of_stick"](claims.PaperEvidence(claims.TOLERANCE))
    (ratio, simulated), = result.values.values()
    omega = ratio * OMEGA_N
    spring = complex(3000.0, 0.6 * omega)
    assert 250.0 * abs(spring - 0.02 * omega**2) / abs(spring - 0.22
                                                       * omega**2) == pytest.approx(540.0 - 300.0, rel=1e-6)
    assert ratio > paper_system().stuck_natural_frequency / paper_system().natural_frequency
    assert simulated == pytest.approx(ratio, abs=1e-3)
    assert result.verdict == CONFIRMED


def test_the_page_has_every_claim_with_the_criterion_in_force() -> None:
    """The page has the criteria of the rows, claims sorted by verdict, and the counts of its table."""
    page = PAGE.read_text()
    head, *parts = page.split("\n## ")
    sections = dict(part.split("\n", 1) for part in parts)
    thresholds = sections.pop("Thresholds halved and doubled")
    assert [line.split("`")[1] for line in thresholds.splitlines() if "`, in " in line] == list(vars(T))
    assert sorted(sections) == sorted(f"{c.figure}: {escape(c.sentence)}" for c in claims.CLAIMS)
    for row in claims.CLAIMS:
        text = sections[f"{row.figure}: {escape(row.sentence)}"]
        assert f"**. Criterion: {escape(row.criterion.words)}.\n" in text, row.name
    words = [text.split("**")[1].lower() for text in sections.values()]
    verdicts = [DEPENDS if text.startswith(DEPENDS) else text for text in words]
    assert verdicts == sorted(verdicts, key=list(claims.VERDICTS).index)
    rows = [line.split(" | ") for line in head.splitlines() if line.startswith("| ")][2:]
    assert [cells[-2] for cells in rows] == words
    counts = [verdicts.count(v) for v in (CONFIRMED, DEPENDS, NOT_CONFIRMED)]
    assert "Of {} claims: {} confirmed, {} depend, {} not confirmed.".format(len(verdicts), *counts) in page


def test_the_page_says_what_the_cheap_claims_come_to_now() -> None:
    page = PAGE.read_text()
    cheap = [row for row in claims.CLAIMS if row.cheap]
    assert len(cheap) >= 9
    places = page.split("| verdict | at ")[1].split(" kPa")[0].split(", ")
    assert places[0] == "225"
    for verdict in claims.judge(cheap, pressures=[1e3 * float(p) for p in places], jobs=1):
        assert "\n".join(claims.claim_section(verdict)) in page
        assert markdown_table(claims.claim_row(verdict), [])[0] in page


@pytest.mark.parametrize(("judged", "verdict", "on", "words"), [
    ({225e3: (CONFIRMED, CONFIRMED), 240e3: (CONFIRMED,)}, CONFIRMED, None, ""),
    ({225e3: (DEPENDS, DEPENDS), 240e3: (DEPENDS,)}, DEPENDS, "part", ""),
    ({225e3: (CONFIRMED, NOT_CONFIRMED)}, DEPENDS, "tolerance", "the verdict changes with the tolerance"),
    ({225e3: (CONFIRMED, CONFIRMED), 240e3: (NOT_CONFIRMED,)}, DEPENDS, "pressure",
     "the verdict changes with the mean pressure: confirmed at 225 kPa, not confirmed at 240 kPa")])
def test_a_verdict_is_that_of_every_pressure_and_tolerance(judged: Any, verdict: str, on: str | None,
                                                           words: str) -> None:
    finding = Finding({"x": float("nan"), "n": np.int64(3)}, CONFIRMED)
    result = json_of(claims.Verdict(rows["maximum_falls"], finding, judged))
    assert (result["verdict"], result["depends_on"], result["why"], result["fitted"]) == (verdict, on, words, False)
    assert list(result["pressures"]) == [f"{p / 1e3:g}" for p in judged]
    assert json.loads(json.dumps(result, allow_nan=False))["values"] == {"x": None, "n": 3}


def test_a_run_goes_on_from_what_was_judged(tmp_path: Path) -> None:
    """A claim is confirmed at one pressure and not at another; stored verdicts are not computed again."""
    worked = []

    def measure(evidence: StableMotions) -> Measured:
        worked.append((evidence.pressure, evidence.rtol))
        return Measured((evidence.pressure < 235e3,), {"x": 1.5}, "why")

    row = Claim("4", "5", "a claim", holds("it holds"), measure, "a_claim")
    for count in (2, 3, 3):
        result, = claims.judge([row], pressures=claims.PRESSURES[:count], kept=tmp_path / "kept.jsonl")
    assert worked == [(225e3, claims.TOLERANCE), (225e3, claims.TIGHTER), (230e3, claims.TOLERANCE),
                      (240e3, claims.TOLERANCE)]
    assert (result.pressures, result.finding.values) == (
        {"225": CONFIRMED, "230": CONFIRMED, "240": NOT_CONFIRMED}, {"x": 1.5})
    varied, = claims.judge([row], pressures=(225e3,), kept=tmp_path / "kept.jsonl", thresholds=True)
    assert varied.varied == {}
    alone, = claims.judge([replace(row, alone=True)], pressures=(240e3, 225e3))
    assert alone.pressures == {"240": NOT_CONFIRMED}
    claims.judge([replace(row, criterion=holds("it does"))], kept=tmp_path / "kept.jsonl")
    assert len(worked) == 4 + 2 + 4


def test_every_threshold_that_a_criterion_uses_is_halved_and_doubled() -> None:
    """A difference of 0.03 from a printed ratio is near only at twice the threshold of 0.02."""
    def measure(evidence: StableMotions) -> Measured:
        return Measured((evidence.limit("near") >= 0.03,), {})

    row = Claim("4", "5", "a claim", holds("it holds"), measure, "a_claim", alone=True)
    result, = claims.judge([row], thresholds=True)
    assert json_of(result)["thresholds"] == {"near": [NOT_CONFIRMED, CONFIRMED]}
    page = claims.claims_page([result])
    assert ("| `near`, in 1 claim | largest distance from a printed frequency or friction ratio | 0.02 | none | "
            "4: a claim (confirmed instead of not confirmed) |") in page
    assert "| `jump`, in 0 claims | least size of a jump, over the curve's largest value | 0.08 | none | none |" in page
    row = Claim("4", "5", "a claim", shares("cases"), lambda evidence: Measured((0.92,), {}), "b", alone=True)
    assert claims.judge([row], thresholds=True)[0].varied == {"missing": [DEPENDS, CONFIRMED]}


def test_the_command_writes_json_and_a_page(tmp_path, judge_only, capsys) -> None:  # type: ignore[no-untyped-def]
    judge_only(rows["maximum_falls"], rows["slope_turns_negative"])
    assert main(["claims", "--json", str(tmp_path / "c.json"), "--markdown", str(tmp_path / "c.md")]) == 0
    document = valid("claims", json.loads((tmp_path / "c.json").read_text()))
    assert document["complete"] is True
    assert [{"figure", "claim", "values", "criterion", "verdict", "why", "pressures", "fitted"} <= row.keys()
            for row in document["claims"]] == [True, True]
    assert (tmp_path / "c.md").read_text().count("## 3: ") == 2
    assert "confirmed" in capsys.readouterr().out
    assert main(["claims", "--json", str(tmp_path / "none" / "c.json")]) == 2


def test_an_interrupted_command_keeps_the_claims_that_were_judged(  # type: ignore[no-untyped-def]
        tmp_path, judge_only, capsys) -> None:
    def stopped(evidence: Evidence) -> Measured:
        raise KeyboardInterrupt

    interrupted = Claim("4", "5", "a claim", holds("it holds"), stopped, "stopped")
    for chosen, kept in (((rows["maximum_falls"], interrupted), 1), ((interrupted,), 0)):
        judge_only(*chosen)
        page, file = tmp_path / f"{kept}.md", tmp_path / f"{kept}.json"
        assert main(["claims", "--json", str(file), "--markdown", str(page)]) == 130
        assert capsys.readouterr().err == "tcc-sim: interrupted; the claims judged so far are kept\n"
        assert file.exists() == page.exists() == bool(kept)
    kept_rows = json.loads((tmp_path / "1.json").read_text())
    assert (len(kept_rows["claims"]), kept_rows["complete"]) == (1, False)
    assert "Interrupted" in (tmp_path / "1.md").read_text()


def test_every_figure_with_a_claim_has_one_in_the_registry() -> None:
    assert len(claims.CLAIMS) == len({claim.name for claim in claims.CLAIMS}) >= 58
