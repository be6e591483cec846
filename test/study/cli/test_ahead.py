"""Kernels that an installation compiles ahead: commands on the pages, and nearly all scenes, compile nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.compiling import kernel_cache
from tcc_sim.compiling.compiled import not_to_ship
from tcc_sim.plant.driveline import Plant
from tcc_sim.scene import bundled_scenes, load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.fixed_step import tick
from tcc_sim.study.cli.ahead import EXPONENTIALS, PARTS, ship

NAMES = {path.name for path in kernel_cache.SHIPPED.glob("*-*")}
TICK = tick.file_name(())[:len("fixed_step.tick-")]  # type: ignore[attr-defined]
CODE = """
import sys
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
solve(load_scene("fig02"), cycles=1)
"""


@pytest.fixture(scope="module")
def shipped() -> set[str]:
    """Return the names of the kernels beside the source; skip where they are not those of this source."""
    if not NAMES or not_to_ship():
        pytest.skip("no kernels are compiled ahead here")
    before = set(kernel_cache.used)
    solve(load_scene("fig02"), cycles=1)
    if not kernel_cache.used - before <= NAMES:
        pytest.skip("the kernels that are compiled ahead are those of another source")
    return NAMES


@pytest.fixture
def lacking(shipped: set[str]) -> Iterator[set[str]]:
    """Return a set that receives, when a test has ended, the kernels that it asked for and that are not shipped."""
    out = set[str]()
    before = set(kernel_cache.used)
    kernel_cache.used.clear()
    yield out
    left = kernel_cache.used - shipped
    kernel_cache.used.update(before)
    assert left == out


@pytest.mark.parametrize("line", [
    "simulate fig02 --cycles 8 --discard 4 --out run.mcap", "simulate runup --orders --duration 1.6",
    "sweep fig02 --over engine.frequency=80,117",
    "sweep chaos --over friction.kinetic_coefficient=0.2,0.29 --lyapunov --cycles 30 --discard 20",
    "continue chaos --over friction.kinetic_coefficient=0.29:0.291",
    "continue chaos --over friction.kinetic_coefficient=0.29:0.291 --set friction.law=set_valued",
    "simulate minimal --profile engine.frequency=0:80,0.2:300",
    "basins chaos --set friction.kinetic_coefficient=0.29 --plane initial.slip_speed=-1:1:2 "
    "--plane initial.plate_angle=0:0.1:2",
    "linearise controlled --slip 20", "figure 2 --quick", "explain fig02"])
def test_a_command_asks_only_for_kernels_that_are_shipped(lacking: set[str], tmp_path: Path,
                                                          monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == 0


def test_bundled_scenes_and_random_ones_ask_only_for_kernels_that_are_shipped(lacking: set[str]) -> None:
    rng = np.random.default_rng(7)
    for k in range(60):
        values = {**EXPONENTIALS[rng.integers(4)], "driveline.damping": float(rng.uniform(0.1, 2.0)),
                  "engine.frequency": float(rng.uniform(50.0, 300.0)),
                  "converter.coupling": float(rng.choice([0.0, 3.0])),
                  "pressure.amplitude": float(rng.choice([0.0, 2e4])),
                  "friction.law": str(rng.choice(["smoothed", "set_valued"])),
                  "engine.torque_amplitude": float(rng.choice([0.0, 250.0]))}
        if rng.random() < 0.5:
            values |= {"engine.harmonic_amplitudes": [40.0], "engine.harmonic_phases": [0.2]}
        scene = load_scene("minimal").with_values(values)
        solve(scene, cycles=1, flywheel_angle=bool(k % 2))
        if scene.system.friction.law == "smoothed":
            Plant(scene).warm_up()
    for name in bundled_scenes():
        solve(load_scene(name), cycles=1)
        Plant(load_scene(name)).warm_up()


def test_a_folder_of_shipped_kernels_holds_those_of_the_uses_and_nothing_else(shipped: set[str],
                                                                              tmp_path: Path) -> None:
    (tmp_path / "left").touch()
    assert ship(tmp_path) == len(shipped)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {
        name: (kernel_cache.SHIPPED / name).read_bytes() for name in shipped}
    assert any(name.startswith(TICK) for name in shipped)
    assert len(PARTS) == 2


def test_the_first_run_of_a_process_with_an_empty_cache_prints_nothing(shipped: set[str], tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", CODE], env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
                          capture_output=True, text=True, check=True)
    assert (done.stderr, list(tmp_path.rglob("*-*"))) == ("", [])
