"""The comparison with AUTO-07p: its output, the table, the model for it, and its time limit."""

import branch_speed
import pytest
from branch_speed import (
    Compared,
    Followed,
    auto,
    coexistence,
    constants,
    model,
    page_lines,
    runs_of,
)

TOLD = """noise
RESULT [200, 50, 0.25, [["LP", 0.27], ["PD", 0.24]], false]
RESULT [400, 100, 0.5, [["LP", 0.2755]], true]
"""


def test_what_auto_prints_is_read_mesh_by_mesh() -> None:
    coarse, fine = runs_of(TOLD, 0.3)
    assert (coarse.points, coarse.seconds, coarse.options, coarse.complete) == (50, 0.25, "NTST 200", False)
    assert coarse.bifurcations == (("LP", pytest.approx(0.9)), ("PD", pytest.approx(0.8)))
    assert (fine.options, fine.complete) == ("NTST 400", True)


def test_the_page_has_a_row_for_every_run() -> None:
    mine = Followed(100, 0.05, (("LP", 0.9), ("PD", 0.8)), "default settings")
    other = Followed(50, 0.25, (("LP", 0.9 + 2e-7), ("PD", 0.8 - 1e-7)), "NTST 800", False)
    coarse = Followed(50, 0.25, (("LP", 0.9 + 2e-7), ("LP", 0.6), ("PD", 0.81), ("TR", 0.7)), "NTST 200")
    lines = page_lines([Compared(2, mine, [other, coarse], "period 2  AUTO-07p was stopped")])
    assert "| 2 | tcc-sim, default settings | 100 | 0.50 | LP 0.900000000, PD 0.800000000 |  |" in lines
    assert ("| 2 | AUTO-07p, NTST 800, did not get through | 50 | 5.00 | LP 0.900000200, PD 0.799999900 | 2.0e-07 |"
            in lines)
    assert lines[-1] == "period 2  AUTO-07p was stopped."


def test_without_auto_there_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert auto(coexistence(), 1, 0.18, 0.3) == ([],
                                                 "period 1  AUTO-07p is not installed: apt install auto-07p gfortran")


def test_the_model_holds_the_numbers_of_the_scene() -> None:
    system = coexistence()
    text = model(system)
    assert "CONSTANTS" not in text
    assert f"omega = {system.engine.frequency:.17e}".replace("e+", "d+") in text
    assert f"press = {0.08 * 0.1 * 225e3:.17e}".replace("e+", "d+") in text
    assert f"11: {2 * system.cycle!r}" in constants(system, 2, 0.18, 0.3)


@pytest.mark.skipif(not branch_speed.auto_installed(), reason="AUTO-07p is not installed")
def test_auto_is_stopped_in_time() -> None:
    found, sentence = auto(coexistence(), 1, 0.18, 0.3, limit=0.2)
    assert found == []
    assert sentence == "period 1  AUTO-07p was stopped after 0 s; finer meshes are left out"
