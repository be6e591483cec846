"""Claims beside closed forms and independent integration; how they are judged; the page and the command."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documents import valid
from given import Given, leaves, record, rows
from independent import smoothed_states

from tcc_sim.cli import main
from tcc_sim.output.tables import escape
from tcc_sim.result import json_of
from tcc_sim.study.paper import claims, measures
from tcc_sim.study.paper.catalogue import FIGURES, OMEGA_N, paper_system
from tcc_sim.study.paper.claims import CONFIRMED, DEPENDS, NOT_CONFIRMED, Claim, Finding, holds, shares
from tcc_sim.study.paper.evidence import FAILED, RUNAWAY, Evidence
from tcc_sim.study.paper.measures import Measured

PAGE = Path(__file__).resolve().parents[3] / ".github" / "paper" / "claims.md"


def gain(omega: float) -> complex:
    """Interface torque of stick per engine torque, (9) and (25a) by hand."""
    return complex(3000.0 - 0.02 * omega**2, 0.6 * omega) / complex(3000.0 - 0.22 * omega**2, 0.6 * omega)


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return Evidence(1e-9, 1)


@pytest.fixture(scope="module")
def cheap(evidence: Evidence) -> dict[str, Finding]:
    """Claims that take less than a second each."""
    return {row.name: row(evidence) for row in claims.CLAIMS if row.cheap}


def test_limits_of_stick_are_those_of_the_closed_form(cheap: dict[str, Finding]) -> None:
    """The largest torque of (9), with the load's at its phase, is mu_s N R there; simulations agree."""
    (ratio, simulated), = cheap["limits_of_stick"].values.values()
    assert 250.0 * abs(gain(ratio * OMEGA_N)) == pytest.approx(540.0 - 300.0, rel=1e-6)
    assert simulated == pytest.approx(ratio, abs=1e-3)
    varying, t = cheap["stick_limits_varying"].values, np.linspace(0.0, 2.0 * np.pi, 200001)
    assert len(varying) == 4
    for name, (limit, simulated) in varying.items():
        assert simulated == pytest.approx(limit, abs=1e-3), name
        torque = 300.0 + 250.0 * (gain(limit * OMEGA_N) * np.exp(1j * t)).imag
        loads = [540.0 * (1.0 + 0.25 * np.sin(t + psi)) for psi in (0.0, 0.5 * np.pi, np.pi)]
        assert min(abs((load - np.abs(torque)).min()) for load in loads) < 0.05
    assert {cheap[name].verdict for name in ("limits_of_stick", "stick_limits_varying")} == {CONFIRMED}
    assert measures.place_of_change(lambda ratio: ratio > 0.44, 0.45, 0.49, 14) is None


def test_the_law_of_figure_3_is_judged_by_its_own_maxima(cheap: dict[str, Finding]) -> None:
    """(7) on a fine grid, for mu_k/mu_s of the figure."""
    v = np.linspace(1e-4, 1.0, 200_001)
    tops, slopes = [], []
    for r in (1.0, 0.8, 0.75, 0.677):
        law = np.tanh(50.0 * v) * (1.0 + (1.0 / r - 1.0) * np.exp(-2.0 * v))
        tops.append(float(law.max() * r))
        slopes.append(float(np.gradient(law, v).min()))
    (parts,), (lowest,) = (list(cheap[name].values.values()) for name in ("maximum_falls", "slope_turns_negative"))
    assert list(parts.values()) == pytest.approx(tops[1:], rel=1e-4)
    assert list(lowest.values()) == pytest.approx(slopes, abs=2e-3)
    assert {cheap[name].verdict for name in ("maximum_falls", "slope_turns_negative")} == {CONFIRMED}


def test_creep_and_slip_of_stick_and_of_positive_trend(cheap: dict[str, Finding]) -> None:
    """Creep carries the torque: tanh(50 v) is near |Tfi|/(mu_s N R); with Tsm = 297 N m both motions stick (errata)."""
    creep = next(v for v in cheap["smoothed_stick_creeps"].values.values() if isinstance(v, dict))
    assert 0.01 < creep["smoothed"] < 0.2
    assert creep["set_valued"] < 1e-6
    assert cheap["smoothed_stick_creeps"].verdict == CONFIRMED
    assert cheap["pure_slip_guaranteed"].verdict == DEPENDS
    assert 35.0 < next(v for k, v in cheap["pure_slip_guaranteed"].values.items() if "for ever" in k) < 35.2


@pytest.mark.parametrize(("name", "verdict", "numbers"), [
    ("period_is_denominator", CONFIRMED, [n for _, n in measures.COPRIME]),
    ("as_dual_excitation", CONFIRMED, [2, 2, 1, 1, 3, 3, 3, 3]), ("three_motions", CONFIRMED, [1, 2, 0]),
    ("smoothing_is_uncertain", CONFIRMED, [1, 36.297, 1, None, 2, 63.657, 2, 63.742]),
    ("series_balance", NOT_CONFIRMED, [None, None, 300.0, None] * 4), ("balance_unsuitable", NOT_CONFIRMED, []),
    ("discontinuous_is_slow", NOT_CONFIRMED, [False]), ("classical_differs", DEPENDS, []),
    ("delay", CONFIRMED, [1.0, None, None, 0.0])])
def test_a_claim_has_the_numbers_of_the_text_or_of_an_independent_program(
        name: str, verdict: str, numbers: list[Any], evidence: Evidence) -> None:
    """Periods by (35), motions of Figs. 2 and 7 by SciPy, the mean torque that balances Tm, the halves of Fig. 9."""
    result = rows[name](evidence)
    assert result.verdict == verdict
    found = leaves(result.values)
    for value, expected in zip(found, numbers):
        assert expected is None or value == pytest.approx(expected, abs=2e-3), (found, numbers)


def test_crossings_are_those_of_28() -> None:
    """(28) by hand for the base case; SciPy's maxima of psi = 0 and pi are on either side of the crossing."""
    crossing = measures.crossing(Evidence(1e-9, 1), {}, OMEGA_N, (0.02 / 0.22) ** 0.5)
    assert crossing == pytest.approx(0.3016, abs=2e-4)
    apart = []
    for ratio in (crossing - 4e-3, crossing + 4e-3):
        top = []
        for series in FIGURES[8].series[::2]:
            system = paper_system({**series.values, "engine.frequency": ratio * OMEGA_N})
            states = smoothed_states(system, [150.0, 0.0, 0.0, 0.0], 30, 100, rtol=1e-6)
            top.append(np.abs(states[-1000:, 0]).max())
        apart.append(top[0] - top[1])
    assert apart[0] < 0.0 < apart[1]


def test_a_motion_that_has_not_settled_goes_on(evidence: Evidence) -> None:
    """Law (6) in Fig. 2: no period after 150 cycles from (13), period two with 63.742 rad/s once it has settled."""
    row = {**FIGURES[2].series[0].values, "friction.law": "set_valued"}
    sweep = evidence.curves([row], np.array([150.0 / OMEGA_N]))[0]
    assert (sweep.points[0].summary.period, sweep.points[0].summary.settled) == (0, False)
    assert evidence.periods(sweep).tolist() == [2]
    assert evidence.motion(row).period == 2


def test_stick_slip_runaway_and_failure_are_apart() -> None:
    kept = Given()
    sweep = kept.curves([{}], np.array([0.1, 0.2, 0.3, 0.4]))[0]
    runs = [record(regime="stick"), record(regime="slip"), None]
    away = record(period=3)
    sweep = replace(sweep, points=[*runs, replace(away, summary=replace(away.summary, runaway=True))])
    assert kept.slips(sweep).tolist() == [False, True, False, True]
    assert kept.periods(sweep).tolist() == [1, 1, FAILED, RUNAWAY]


@pytest.mark.parametrize("pressure", [200e3, 225e3, 260e3])
def test_a_row_has_the_mean_pressure_that_is_judged(pressure: float) -> None:
    """Tsp/Tsm is unchanged, and a row with a pressure of its own keeps it."""
    kept = Evidence(1e-9, 1, pressure=pressure)
    swinging = kept.system({"pressure.amplitude": 0.25 * 225e3}).pressure
    assert (swinging.mean, swinging.amplitude / swinging.mean) == (pressure, pytest.approx(0.25))
    assert kept.system({"pressure.mean": 125e3}).pressure.mean == 125e3


ROW = Claim("4", "5", "it | is", holds("it holds"), lambda evidence: Measured((True,), {}), "a_claim")
YES, NO, PART = CONFIRMED, NOT_CONFIRMED, DEPENDS


@pytest.mark.parametrize(("judged", "verdict", "on"), [
    ({225e3: (YES, YES), 240e3: (YES,)}, YES, None), ({225e3: (NO, NO), 240e3: (NO,)}, NO, None),
    ({225e3: (PART, PART), 240e3: (PART,)}, PART, "part"), ({225e3: (YES, NO)}, PART, "tolerance"),
    ({225e3: (NO, YES), 230e3: (PART,)}, PART, "tolerance"), ({225e3: (NO, NO), 230e3: (PART,)}, PART, "pressure"),
    ({225e3: (YES, YES), 240e3: (NO,)}, PART, "pressure"), ({225e3: (NO, YES), 230e3: (YES,)}, PART, "pressure")])
def test_a_verdict_is_that_of_every_pressure_and_tolerance(judged: Any, verdict: str, on: str | None) -> None:
    result = json_of(claims.verdict_on(ROW, Finding({"x": float("nan"), "n": np.int64(3)}, YES), judged))
    assert (result["verdict"], result["depends_on"]) == (verdict, on)
    assert bool(result["why"]) == (on in ("tolerance", "pressure"))
    assert list(result["pressures"]) == [f"{p / 1e3:g}" for p in judged]
    assert json.loads(json.dumps(result, allow_nan=False))["values"] == {"x": None, "n": 3}


def test_a_run_goes_on_from_the_judged_claims(tmp_path: Path) -> None:
    """A claim is confirmed at one pressure and not at another; stored verdicts are not computed again."""
    worked = []

    def measure(evidence: Evidence) -> Measured:
        worked.append((evidence.pressure, evidence.rtol))
        return Measured((evidence.pressure < 235e3,), {"x": 1.5}, "why")

    row, kept = replace(ROW, measure=measure), tmp_path / "kept.jsonl"
    for count in (2, 3, 3):
        result, = claims.judge([row], pressures=claims.PRESSURES[:count], kept=kept)
    assert worked == [(225e3, claims.TOLERANCE), (225e3, claims.TIGHTER), (230e3, claims.TOLERANCE),
                      (240e3, claims.TOLERANCE)]
    assert (result.pressures, result.finding.values) == ({"225": YES, "230": YES, "240": NO}, {"x": 1.5})
    alone, = claims.judge([replace(row, alone=True)], pressures=(240e3, 225e3))
    assert alone.pressures == {"240": NO}
    claims.judge([replace(row, criterion=holds("it does"))], kept=kept)
    assert len(worked) == 4 + 2 + 4


@pytest.mark.parametrize(("criterion", "judged", "name", "varied"), [
    (holds("it holds"), lambda e: (e.limit("near") >= 0.03,), "near", [NO, YES]),
    (shares("cases"), lambda e: (0.92,), "missing", [PART, YES])])
def test_every_threshold_that_a_criterion_uses_is_halved_and_doubled(criterion: Any, judged: Any, name: str,
                                                                     varied: list[str]) -> None:
    """A difference of 0.03 from a printed ratio is near only at twice the threshold of 0.02."""
    row = replace(ROW, criterion=criterion, measure=lambda e: Measured(judged(e), {}), alone=True)
    result, = claims.judge([row], thresholds=True)
    assert json_of(result)["thresholds"] == {name: varied}
    line = next(line for line in claims.claims_page([result]).splitlines() if line.startswith(f"| `{name}`"))
    assert escape("it | is") in line


def test_the_page_has_every_claim_and_the_verdicts_of_the_cheap_ones() -> None:
    page = PAGE.read_text()
    sections = {name: [line for line in text.splitlines() if line.startswith("- ")]
                for name, text in re.findall(r"^## (.*)\n([^#]*)", page, re.MULTILINE)}
    for claim in claims.CLAIMS:
        begins = re.compile(rf"- \*\*.*\): {re.escape(escape(claim.sentence))}( \[[^]]*\])?\.")
        assert len([line for lines in sections.values() for line in lines if begins.match(line)]) == 1
    for verdict in claims.judge([row for row in claims.CLAIMS if row.cheap and row.alone], jobs=1):
        assert claims.claim_line(verdict) in sections[verdict.verdict.capitalize()]
    counts = [len(sections[name.capitalize()]) for name in (YES, PART, NO)]
    assert "Of {} claims: {} confirmed, {} depend, {} not confirmed".format(len(claims.CLAIMS), *counts) in page


def test_the_command_writes_json_and_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["claims", "--figures", "3", "--json", str(tmp_path / "c.json"), "--markdown", str(tmp_path / "c.md")]
    assert main(words) == 0
    document = valid("claims", json.loads((tmp_path / "c.json").read_text()))
    wanted = [claim for claim in claims.CLAIMS if claim.figure == "3"]
    assert [row["claim"] for row in document["claims"]] == [claim.sentence for claim in wanted]
    assert {row["verdict"] for row in document["claims"]} == {YES}
    assert document["complete"] is True
    page, printed = (tmp_path / "c.md").read_text(), capsys.readouterr().out
    assert all(escape(claim.sentence) in page and claim.sentence in printed for claim in wanted)
    assert main(words) == 2


def test_an_interrupted_command_keeps_the_claims_so_far(tmp_path: Path) -> None:
    """Ctrl-C once the first claim is printed; those of Fig. 4 take far longer."""
    file, page = tmp_path / "c.json", tmp_path / "c.md"
    words = [sys.executable, "-u", "-m", "tcc_sim", "claims", "--figures", "3", "4", "--jobs", "1", "--json", str(file),
             "--markdown", str(page)]
    child = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stdout is not None
    next(line for line in child.stdout if line.startswith("Fig. 3"))
    child.send_signal(signal.SIGINT)
    assert child.communicate()[1].startswith("tcc-sim: interrupted")
    assert child.returncode == 130
    document = json.loads(file.read_text())
    assert document["complete"] is False
    assert 1 <= len(document["claims"]) < sum(claim.figure in ("3", "4") for claim in claims.CLAIMS)
    assert "Interrupted" in page.read_text()


@pytest.mark.parametrize("words", [["--figures", "99"], ["--pressures", "99"], ["--jobs", "0"]])
def test_wrong_words_are_one_line(words: list[str], refused: Callable[..., str]) -> None:
    line = refused("claims", *words, "--json", "c.json")
    assert words[0][2:] in line
    assert words[1] in line
