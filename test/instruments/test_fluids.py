"""The picture of the two fluids, and that one slips where the other judders, by SciPy too."""

from pathlib import Path

import numpy as np
import pytest
from fluids import draw_fluids
from oracle import smoothed_states

from tcc_sim.scene import load_scene


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    assert draw_fluids(tmp_path / "fluids.png", np.array([90.0, 100.0])).stat().st_size > 10_000


@pytest.mark.parametrize(("name", "sticks"), [("fresh_fluid", False), ("aged_fluid", True)])
def test_aged_fluid_judders_and_fresh_fluid_does_not(name: str, sticks: bool) -> None:
    system = load_scene(name).system
    slip = smoothed_states(system, [20.0, 0.1, 0.0, 0.0], 40, 64, rtol=1e-8)[-20 * 64:, 0]
    assert (slip.min() < 0.02) == sticks
    assert 20.0 < slip.max() < 40.0
    assert slip.min() > -1e-2
