"""Instruments of .ci/instruments: random scenes, sweeps in blocks, pictures of two fluids, a soak."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import random_scenes
import sweep_blocks
from branch_speed import coexistence, constants, model
from driveline_bags import bag, ticked
from fluids import COUPLINGS, draw_coupling, draw_fluids
from independent import smoothed_states
from soak import figures_of

from tcc_sim.scene import load_scene
from tcc_sim.sweeps.simulation import Plan, simulate


@pytest.mark.parametrize("path", sorted(Path(random_scenes.__file__).parent.glob("*.py")), ids=lambda path: path.stem)
def test_every_instrument_finds_what_it_imports(path: Path) -> None:
    assert import_module(path.stem).__doc__


def test_random_scenes_agree_with_the_other_integrator_and_wrong_ones_do_not() -> None:
    words = {word for seed in range(200) for word in random_scenes.draw(seed).words}
    assert {"smoothed", "set_valued", "slow slip", "coupling", "falls", "rises", "no slope", "sines", "pulsation",
            "profiles", "inputs", "actuator", "far end", *(f"hold {hold}" for hold in random_scenes.HOLDS)} <= words
    assert random_scenes.main(6, 8) == 0
    assert random_scenes.main(4, 8, lambda scene, **rest: simulate(scene.with_values({"driveline.damping": 0.63}),
                                                                   **rest)) >= 3


def test_the_model_of_auto_holds_the_numbers_of_the_scene() -> None:
    system = coexistence()
    assert f"omega = {system.engine.frequency:.17e}".replace("e+", "d+") in model(system)
    assert f"11: {2 * system.cycle!r}" in constants(system, 2, 0.18, 0.3)


def test_points_in_blocks_are_those_of_single_ones() -> None:
    result, kinds = sweep_blocks.differences("set_valued", 6, 5, Plan(cycles=60, section_points=3))
    assert (result, kinds.total()) == ([], 6)


def test_the_pictures_are_drawn(tmp_path: Path) -> None:
    for draw in (draw_fluids, draw_coupling):
        assert draw(tmp_path / f"{draw.__name__}.png", np.array([90.0, 100.0])).stat().st_size > 10_000


def slip_of(name: str, **values: float) -> np.ndarray:
    """Slip speed of twenty cycles of a scene after twenty, by SciPy."""
    scene = load_scene(name).with_values({key.replace("__", "."): value for key, value in values.items()})
    return smoothed_states(scene.system, [20.0, 0.1, 0.0, 0.0], 40, 64, rtol=1e-8)[-20 * 64:, 0]


def test_aged_fluid_judders_fresh_fluid_and_the_fluid_beside_the_clutch_do_not() -> None:
    for name, sticks in (("fresh_fluid", False), ("aged_fluid", True)):
        slip = slip_of(name)
        assert (slip.min() < 0.02) == sticks
        assert 20.0 < slip.max() < 40.0
    for omega in (60.0, 110.0):
        none, some, most = (slip_of("aged_fluid", converter__coupling=coupling, engine__frequency=omega).max()
                            for coupling in COUPLINGS)
        assert none > 1.2 * some > 1.44 * most


def test_the_count_of_the_recorder_is_compared_with_the_gaps_in_the_stamps(tmp_path: Path) -> None:
    rows = ticked(load_scene("minimal"), 300)
    for kept, gaps in ((rows, 0), (rows[:50] + rows[51:100] + rows[140:], 41)):
        for beyond in (0, 1, -1):
            result = figures_of(bag(tmp_path / f"{gaps}{beyond}", kept, "minimal", lost=gaps + beyond))
            assert (result.lost_messages, result.complete) == (gaps, True)
            assert result.count_is_honest == (beyond == 0)
    assert not figures_of(bag(tmp_path / "cut", rows, "minimal", cut=True)).count_is_honest
