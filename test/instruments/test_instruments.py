"""Instruments run by hand: comparison with AUTO-07p, cycles a second, picture of two fluids, losses of a soak."""

from pathlib import Path

import numpy as np
import pytest
import sweep_blocks
import sweep_speed
from branch_speed import Compared, Followed, auto, auto_installed, coexistence, constants, model, page_lines, runs_of
from driveline_bags import bag, ticked
from fluids import COUPLINGS, draw_coupling, draw_fluids
from oracle import smoothed_states
from soak import figures_of

from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.study.benchmarks import peers
from tcc_sim.study.benchmarks.references import reference
from tcc_sim.study.paper.catalogue import paper_system
from tcc_sim.sweeps import blocks
from tcc_sim.sweeps.simulation import Plan

TOLD = """noise
RESULT [200, 50, 0.25, [["LP", 0.27], ["PD", 0.24]], false]
RESULT [400, 100, 0.5, [["LP", 0.2755]], true]
"""


def test_what_auto_prints_is_read_mesh_by_mesh() -> None:
    coarse, fine = runs_of(TOLD, 0.3)
    assert (coarse.points, coarse.seconds, coarse.options, coarse.complete) == (50, 0.25, "NTST 200", False)
    assert coarse.bifurcations == (("LP", pytest.approx(0.9)), ("PD", pytest.approx(0.8)))
    assert (fine.options, fine.complete) == ("NTST 400", True)


def test_points_in_blocks_are_compared_with_single_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = Plan(cycles=60, section_points=3)
    result, kinds = sweep_blocks.differences("set_valued", 6, 5, plan)
    assert (result, kinds.total()) == ([], 6)
    monkeypatch.setattr(blocks, "_confirmed", lambda systems, *_: [None] * len(systems))
    assert any("confirmed: alone" in line for line in sweep_blocks.differences("set_valued", 6, 5, plan)[0])


def test_time_outside_of_kernels_is_counted_by_cause() -> None:
    spent = sweep_blocks.outside_kernels("set_valued", 8, 1)
    assert {"kernel", "outside", "setups", "arguments", "judging", "confirming", "rest"} <= spent.keys()
    pieces = sum(spent.values()) - spent["kernel"] - spent["outside"]
    assert spent["outside"] == pytest.approx(pieces, rel=1e-9)
    assert min(spent.values()) > 0.0


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
    sentence = "period 1  AUTO-07p is not installed: apt install auto-07p gfortran"
    assert auto(coexistence(), 1, 0.18, 0.3) == ([], sentence)


def test_the_model_holds_the_numbers_of_the_scene() -> None:
    system = coexistence()
    text = model(system)
    assert "CONSTANTS" not in text
    assert f"omega = {system.engine.frequency:.17e}".replace("e+", "d+") in text
    assert f"press = {0.08 * 0.1 * 225e3:.17e}".replace("e+", "d+") in text
    assert f"11: {2 * system.cycle!r}" in constants(system, 2, 0.18, 0.3)


@pytest.mark.skipif(not auto_installed(), reason="AUTO-07p is not installed")
def test_auto_is_stopped_in_time() -> None:
    result, sentence = auto(coexistence(), 1, 0.18, 0.3, limit=0.2)
    assert result == []
    assert sentence == "period 1  AUTO-07p was stopped after 0 s; finer meshes are left out"


SPEED = sweep_speed.SpeedEffort((0.36,), 2, 2, 5, 1, (1e-6, 1e-9, 1e-10))


def test_the_attractor_is_reached_before_it_is_timed():
    """The period-one motion of minimal with its known largest slip speed repeats from the settled state at once."""
    system = sweep_speed.on_attractor(load_scene("minimal").system)
    cycles = solve(system, cycles=3, rtol=1e-11).cycles
    assert cycles.section[3] == pytest.approx(cycles.section[0], rel=1e-9, abs=1e-9)
    assert max(cycles.highest) == pytest.approx(22.17, abs=2e-3)


def test_a_tolerance_that_leaves_too_large_an_error_does_not_count_as_fast():
    system = paper_system({"friction.kinetic_coefficient": 0.25, "engine.frequency": 77.0})
    truth = reference(system, SPEED.horizon, "LSODA", 1e-12)
    with pytest.raises(peers.Failed, match="its error is at least"):
        sweep_speed.loosest(system, sweep_speed.ENGINE, (1e-1,), truth)
    setting, error = sweep_speed.loosest(system, sweep_speed.ENGINE, (1e-1, 1e-9), truth)
    assert setting == 1e-9
    assert error < 1e-7


def test_every_scene_has_a_row_with_an_error_below_the_bound(monkeypatch):
    monkeypatch.setattr(peers, "TIMED", 20)
    swept = sweep_speed.sweep_speed(SPEED, lambda *at: None)
    engine = [row for row in swept.rows if row.solver == sweep_speed.ENGINE]
    assert [row.kinetic_ratio for row in engine[::4]] == pytest.approx([1.0, 0.83, 0.75, 0.667])
    assert [row.stretch for row in engine] == ["transient", "transient", "attractor", "attractor"] * 4
    assert all(row.error <= sweep_speed.ERROR and row.cycles_per_second > 0.0 for row in swept.rows)
    assert len([row for row in [*swept.rows, *swept.omitted] if row.solver == sweep_speed.PEER]) == 8
    assert (swept.sweep.points, swept.sweep.cycles) == (8, 40)
    assert "\n".join(sweep_speed.speed_section(swept)).count("| 0.83 | 0.36 |") == 2


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    assert draw_fluids(tmp_path / "fluids.png", np.array([90.0, 100.0])).stat().st_size > 10_000
    assert draw_coupling(tmp_path / "coupling.png", np.array([90.0, 100.0])).stat().st_size > 10_000


@pytest.mark.parametrize(("name", "sticks"), [("fresh_fluid", False), ("aged_fluid", True)])
def test_aged_fluid_judders_and_fresh_fluid_does_not(name: str, sticks: bool) -> None:
    system = load_scene(name).system
    slip = smoothed_states(system, [20.0, 0.1, 0.0, 0.0], 40, 64, rtol=1e-8)[-20 * 64:, 0]
    assert (slip.min() < 0.02) == sticks
    assert 20.0 < slip.max() < 40.0
    assert slip.min() > -1e-2


@pytest.mark.parametrize("frequency", [60.0, 110.0])
def test_the_fluid_beside_the_clutch_takes_slip_from_the_judder(frequency: float) -> None:
    scenes = [load_scene("aged_fluid").with_values({"converter.coupling": coupling, "engine.frequency": frequency})
              for coupling in COUPLINGS]
    none, some, most = (smoothed_states(scene.system, [20.0, 0.1, 0.0, 0.0], 40, 64, rtol=1e-8)[-20 * 64:, 0].max()
                        for scene in scenes)
    assert none > 1.2 * some > 1.44 * most


ROWS = ticked(load_scene("minimal"), 300)


@pytest.mark.parametrize(("kept", "gaps"), [(ROWS, 0), (ROWS[:50] + ROWS[51:100] + ROWS[140:], 41)])
@pytest.mark.parametrize("beyond", [0, 1, -1])
def test_the_count_of_the_recorder_is_compared_with_the_gaps_in_the_stamps(tmp_path, kept, gaps, beyond):
    result = figures_of(bag(tmp_path / "run", kept, "minimal", lost=gaps + beyond))
    assert (result.lost_messages, result.messages["/joint_states"], result.complete) == (gaps, 300 - gaps, True)
    assert result.count_is_honest == (beyond == 0)


def test_without_a_count_there_is_nothing_to_believe(tmp_path):
    assert not figures_of(bag(tmp_path / "run", ROWS, "minimal", cut=True)).count_is_honest
