"""Instruments of .ci/instruments: random scenes, comparison with AUTO-07p, speed, pictures of two fluids, a soak."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import random_scenes
import sweep_blocks
import sweep_speed
from branch_speed import auto, auto_installed, coexistence, constants, model, runs_of
from driveline_bags import bag, ticked
from fluids import COUPLINGS, draw_coupling, draw_fluids
from independent import smoothed_states
from soak import figures_of

from tcc_sim.scene import load_scene
from tcc_sim.study.benchmarks import peers
from tcc_sim.study.benchmarks.references import reference
from tcc_sim.study.paper.catalogue import paper_system
from tcc_sim.sweeps.simulation import Plan, simulate


@pytest.mark.parametrize("path", sorted(Path(random_scenes.__file__).parent.glob("*.py")), ids=lambda path: path.stem)
def test_every_instrument_finds_what_it_imports(path: Path) -> None:
    assert import_module(path.stem).__doc__


def test_every_part_is_drawn_with_every_hold() -> None:
    words = {word for seed in range(200) for word in random_scenes.draw(seed).words}
    assert {"smoothed", "set_valued", "slow slip", "coupling", "falls", "rises", "no slope", "sines", "pulsation",
            "profiles", "inputs", "actuator", "far end", *(f"hold {hold}" for hold in random_scenes.HOLDS)} <= words
    assert any(word.startswith("table with 1.0%") for word in words)


def test_random_scenes_agree_with_the_other_integrator() -> None:
    assert random_scenes.main(6, 8) == 0


def test_another_damping_differs() -> None:
    assert random_scenes.main(4, 8, lambda scene, **rest: simulate(scene.with_values({"driveline.damping": 0.63}),
                                                                   **rest)) >= 3


TOLD = """noise
RESULT [200, 50, 0.25, [["LP", 0.27], ["PD", 0.24]], false]
RESULT [400, 100, 0.5, [["LP", 0.2755]], true]
"""


def test_the_answer_of_auto_is_read_mesh_by_mesh() -> None:
    coarse, fine = runs_of(TOLD, 0.3)
    assert (coarse.points, coarse.seconds, coarse.options, coarse.complete) == (50, 0.25, "NTST 200", False)
    assert coarse.bifurcations == (("LP", pytest.approx(0.9)), ("PD", pytest.approx(0.8)))
    assert (fine.options, fine.complete) == ("NTST 400", True)


def test_the_model_of_auto_holds_the_numbers_of_the_scene() -> None:
    system = coexistence()
    text = model(system)
    assert f"omega = {system.engine.frequency:.17e}".replace("e+", "d+") in text
    assert f"press = {0.08 * 0.1 * 225e3:.17e}".replace("e+", "d+") in text
    assert f"11: {2 * system.cycle!r}" in constants(system, 2, 0.18, 0.3)


@pytest.mark.skipif(not auto_installed(), reason="AUTO-07p is not installed")
def test_auto_is_stopped_in_time() -> None:
    assert auto(coexistence(), 1, 0.18, 0.3, limit=0.2)[0] == []


def test_points_in_blocks_are_those_of_single_ones() -> None:
    result, kinds = sweep_blocks.differences("set_valued", 6, 5, Plan(cycles=60, section_points=3))
    assert (result, kinds.total()) == ([], 6)


def test_time_outside_of_kernels_is_counted_by_cause() -> None:
    spent = sweep_blocks.outside_kernels("set_valued", 8, 1)
    pieces = sum(spent.values()) - spent["kernel"] - spent["outside"]
    assert spent["outside"] == pytest.approx(pieces, rel=1e-9)
    assert min(spent.values()) > 0.0


SPEED = sweep_speed.SpeedEffort((0.36,), 2, 2, 5, 1, (1e-6, 1e-9, 1e-10))


def test_a_tolerance_that_leaves_too_large_an_error_does_not_count_as_fast():
    system = paper_system({"friction.kinetic_coefficient": 0.25, "engine.frequency": 77.0})
    truth = reference(system, SPEED.horizon, "LSODA", 1e-12)
    with pytest.raises(peers.Failed, match="its error is at least"):
        sweep_speed.loosest(system, sweep_speed.ENGINE, (1e-1,), truth)
    setting, error = sweep_speed.loosest(system, sweep_speed.ENGINE, (1e-1, 1e-9), truth)
    assert setting == 1e-9
    assert error < 1e-7


def test_every_scene_has_a_row_with_an_error_below_the_bound() -> None:
    swept = sweep_speed.sweep_speed(SPEED, lambda *at: None)
    engine = [row for row in swept.rows if row.solver == sweep_speed.ENGINE]
    assert [row.kinetic_ratio for row in engine[::4]] == pytest.approx([1.0, 0.83, 0.75, 0.667])
    assert all(row.error <= sweep_speed.ERROR and row.cycles_per_second > 0.0 for row in swept.rows)


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
