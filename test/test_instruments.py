"""Instruments of .ci/instruments: their imports, random scenes, and the two fluids."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import random_scenes
from fluids import COUPLINGS
from independent import smoothed_states

from tcc_sim.scene import load_scene
from tcc_sim.sweeps.simulation import simulate


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


def slip_of(name: str, **values: float) -> np.ndarray:
    """Slip speed of twenty cycles of a scene after twenty, by SciPy."""
    scene = load_scene(name).with_values({key.replace("__", "."): value for key, value in values.items()})
    return smoothed_states(scene.system, [20.0, 0.1, 0.0, 0.0], 40, 64, rtol=1e-6)[-20 * 64:, 0]


def test_aged_fluid_judders_fresh_fluid_and_the_fluid_beside_the_clutch_do_not() -> None:
    for name, sticks in (("fresh_fluid", False), ("aged_fluid", True)):
        slip = slip_of(name)
        assert (slip.min() < 0.02) == sticks
        assert 20.0 < slip.max() < 40.0
    none, some, most = (slip_of("aged_fluid", converter__coupling=coupling, engine__frequency=110.0).max()
                        for coupling in COUPLINGS)
    assert none > 1.2 * some > 1.44 * most
