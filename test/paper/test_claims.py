"""Claims with robust numbers, and the frame of the table; the numbers are compared with closed forms where there are
any.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from documents import valid

from tcc_sim.cli import main
from tcc_sim.output.tables import escape, markdown_table
from tcc_sim.paper import claims, claims_model, mean_pressure
from tcc_sim.paper.catalogue import OMEGA_N, paper_system
from tcc_sim.paper.criteria import CONFIRMED, DEPENDS, NOT_CONFIRMED, Claim, Finding, Holds, Measured
from tcc_sim.paper.evidence import Evidence, share_where
from tcc_sim.paper.stable_motions import StableMotions

PAGE = Path(__file__).resolve().parents[2] / ".github" / "claims.md"


@pytest.mark.parametrize("name", ["three_motions"])
def test_claims_with_robust_numbers_hold(name: str) -> None:
    claim = next(c for c in claims.CLAIMS if c.name == name)
    assert claim(StableMotions(claims.TOLERANCE)).verdict == CONFIRMED


def test_the_stick_limit_is_that_of_the_closed_form() -> None:
    """(25a) by hand: the amplitude of the interface torque is mu_s N R - Tm at the limit, far above omega_sn."""
    found = claims_model.limits_of_stick(StableMotions(claims.TOLERANCE))
    (ratio, simulated), = found.values.values()
    omega = ratio * OMEGA_N
    spring = complex(3000.0, 0.6 * omega)
    assert 250.0 * abs(spring - 0.02 * omega**2) / abs(spring - 0.22
                                                       * omega**2) == pytest.approx(540.0 - 300.0, rel=1e-6)
    assert ratio > paper_system().stuck_natural_frequency / paper_system().natural_frequency
    assert simulated == pytest.approx(ratio, abs=1e-3)
    assert found.verdict == CONFIRMED


def test_the_page_has_every_claim_with_the_criterion_in_force() -> None:
    """What the page was judged by is what the rows say; its counts are those of its table."""
    page = PAGE.read_text()
    sections = [part.split("\n", 1) for part in page.split("\n## ")[1:] if not part.startswith("The mean pressure")]
    assert [head for head, _ in sections] == [f"{c.figure}: {escape(c.sentence)}" for c in claims.CLAIMS]
    for row, (_, text) in zip(claims.CLAIMS, sections):
        assert f"**. Criterion: {escape(row.criterion.words)}.\n" in text, row.name
    verdicts = [text.split("**")[1].lower() for _, text in sections]
    assert [line.split(" | ")[-1] for line in page.splitlines() if line.startswith("| ")][2:len(verdicts) + 2] == [
        f"{v} |" for v in verdicts]
    counts = [verdicts.count(v) for v in (CONFIRMED, DEPENDS, NOT_CONFIRMED)]
    assert "Of {} claims: {} confirmed, {} depend, {} not confirmed.".format(len(verdicts), *counts) in page


def test_the_page_says_what_the_cheap_claims_come_to_now() -> None:
    page = PAGE.read_text()
    cheap = [row for row in claims.CLAIMS if row.cheap]
    assert len(cheap) >= 9
    for verdict in claims.judge(cheap, jobs=1):
        assert "\n".join(claims.claim_section(verdict)) in page
        assert markdown_table(claims.claim_row(verdict), [])[0] in page


class Drawn(Evidence):
    """The maxima of a curve of the test's own."""

    def __init__(self, curve: Callable[[float], float]) -> None:
        super().__init__(1e-6)
        self.curve = curve

    def curves(self, rows: Any, axis: Any, **how: Any) -> Any:
        values = np.array([self.curve(x) for x in axis])
        return [SimpleNamespace(column=lambda name: values)]

    def maximum(self, row: Any, ratio: float) -> float:
        return self.curve(ratio)


def test_a_jump_is_told_from_a_steep_curve() -> None:
    axis = np.linspace(0.1, 0.5, 21)

    for curve, expected in ((lambda x: 40.0 if x < 0.313 else 50.0, [0.313]),
                            (lambda x: 50.0 * math.tanh((x - 0.3) / 0.02), [])):
        assert [x for x, _ in Drawn(curve).jumps({}, axis)] == pytest.approx(expected, abs=1e-4)


def test_a_verdict_that_changes_with_the_tolerance_depends() -> None:
    finding = Finding("4", "5", "a claim", "a criterion", {"x": float("nan"), "n": np.int64(3)}, NOT_CONFIRMED)
    row = claims.Verdict(finding, CONFIRMED).as_json()
    assert row["verdict"] == DEPENDS
    assert "tolerance" in row["why"]
    assert json.loads(json.dumps(row, allow_nan=False))["values"] == {"x": None, "n": 3}
    assert claims.Verdict(finding, NOT_CONFIRMED).as_json()["verdict"] == NOT_CONFIRMED


def test_the_command_writes_json_and_a_page(tmp_path, judge_only, capsys) -> None:  # type: ignore[no-untyped-def]
    judge_only(claims_model.maximum_falls, claims_model.slope_turns_negative)
    assert main(["claims", "--json", str(tmp_path / "c.json"), "--markdown", str(tmp_path / "c.md")]) == 0
    found = valid("claims", json.loads((tmp_path / "c.json").read_text()))
    rows = found["claims"]
    assert found["complete"] is True
    assert [row["pressure"] for row in found["mean_pressure"]["rows"]] == list(mean_pressure.PRESSURES)
    assert [{"figure", "claim", "values", "criterion", "verdict", "why"} <= row.keys() for row in rows] == [True, True]
    page = (tmp_path / "c.md").read_text()
    assert page.count("## 3: ") == 2
    assert page.count(" of 2 |") == len(mean_pressure.PRESSURES)
    said = capsys.readouterr().out
    assert "confirmed" in said
    assert "mean pressure 225 kPa: 2 of 2 numbers of the text" in said
    assert main(["claims", "--json", str(tmp_path / "none" / "c.json")]) == 2


def test_an_interrupted_command_keeps_the_claims_that_were_judged(  # type: ignore[no-untyped-def]
        tmp_path, judge_only, capsys) -> None:
    def stopped(evidence: Evidence) -> Measured:
        raise KeyboardInterrupt

    interrupted = Claim("4", "5", "a claim", Holds("it holds"), stopped)
    for chosen, kept in (((claims_model.maximum_falls, interrupted), 1), ((interrupted,), 0)):
        judge_only(*chosen)
        page, rows = tmp_path / f"{kept}.md", tmp_path / f"{kept}.json"
        assert main(["claims", "--json", str(rows), "--markdown", str(page)]) == 130
        assert capsys.readouterr().err == "tcc-sim: interrupted; the claims judged so far are kept\n"
        assert rows.exists() == page.exists() == bool(kept)
    kept_rows = json.loads((tmp_path / "1.json").read_text())
    assert (len(kept_rows["claims"]), kept_rows["mean_pressure"], kept_rows["complete"]) == (1, None, False)
    assert "Of 1 claims: 1 confirmed, 0 depend, 0 not confirmed." in (tmp_path / "1.md").read_text()
    assert "Interrupted" in (tmp_path / "1.md").read_text()


def test_every_figure_with_a_claim_has_one_in_the_registry() -> None:
    assert len(claims.CLAIMS) == len({claim.name for claim in claims.CLAIMS}) >= 58
    assert share_where(np.array([True, False]), np.array([True, True])) == 0.5
    assert share_where(np.array([True]), np.array([False])) == 1.0
