"""Kernels that an installation compiles ahead: commands on the pages, and nearly all scenes, compile nothing."""

from __future__ import annotations

import importlib.util
import io
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from pathlib import Path

import numpy as np
import pytest

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.compiling import kernel_cache
from tcc_sim.compiling.compiled import not_to_ship
from tcc_sim.errors import InputError
from tcc_sim.plant.driveline import Plant
from tcc_sim.scene import Scene, bundled_scenes, load_scene
from tcc_sim.solvers.stroboscopic import stroboscopic_map
from tcc_sim.study.cli.ahead import EXPONENTIALS

PACKAGE = Path(tcc_sim.__file__).parent
NAMES = {path.name for path in kernel_cache.SHIPPED.glob("*-*")}
CODE = """
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
solve(load_scene("fig02"), cycles=1)
"""


class Compiles(BaseException):
    """A kernel is about to be compiled."""


class Listener(io.StringIO):
    """Standard error that raises Compiles at the line which says that kernels are compiled."""

    def write(self, text: str) -> int:
        if "compiling" in text:
            assert text.count("\n") == 1
            raise Compiles
        return super().write(text)


@pytest.fixture(scope="module")
def shipped() -> set[str]:
    """Return the names of the kernels beside the source; skip where they are not those of this source."""
    if not NAMES or not_to_ship():
        pytest.skip("no kernels are compiled ahead here")
    before = set(kernel_cache.used)
    tcc_sim.solve(load_scene("fig02"), cycles=1)
    if not kernel_cache.used - before <= NAMES:
        pytest.skip("the kernels that are compiled ahead are those of another source")
    return NAMES


@pytest.fixture
def listening(shipped: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Announce what is compiled, and use a private directory that is empty."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    kernel_cache.directory.cache_clear()
    kernel_cache.announced.discard("compiling")
    yield
    kernel_cache.announced.add("compiling")
    kernel_cache.directory.cache_clear()


@pytest.mark.usefixtures("listening", "pictures")
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
def test_a_command_asks_only_for_kernels_that_are_shipped(line: str) -> None:
    with redirect_stderr(Listener()):
        assert main(line.split()) == 0


INPUTS = "pressure.mean", "engine.mean_torque"
VERBS: tuple[Callable[[Scene], object], ...] = (
    lambda scene: tcc_sim.simulate(scene, cycles=8, discard=4),
    lambda scene: tcc_sim.sweep(scene, "engine.mean_torque", [150.0, 160.0], cycles=8, discard=4),
    lambda scene: stroboscopic_map(scene.system, np.array([20.0, 0.1, 0.0]), 1, parameters=INPUTS),
    lambda scene: tcc_sim.explain(scene), lambda scene: Plant(scene).warm_up())
"""`simulate`, `sweep`, the map of `linearise`, `explain` and the driveline's node."""


def random_scene(draw: np.random.Generator) -> Scene:
    """Return a scene of a random kind; of four laws one is flat, one has two or three exponentials."""
    values = {**EXPONENTIALS[draw.choice([0, 1, 1, draw.integers(2, 4)])],
              "driveline.damping": float(draw.uniform(0.1, 2.0)), "engine.frequency": float(draw.uniform(50.0, 300.0)),
              "converter.coupling": float(draw.choice([0.0, 3.0])),
              "pressure.amplitude": float(draw.choice([0.0, 2e4])),
              "friction.law": str(draw.choice(["smoothed", "set_valued"])),
              "engine.torque_amplitude": float(draw.choice([0.0, 250.0]))}
    if draw.random() < 0.5:
        values |= {"engine.harmonic_amplitudes": [40.0], "engine.harmonic_phases": [0.2]}
    if draw.random() < 0.2:
        values |= {"engine.frequency_times": [0.0, 0.1], "engine.frequency_values": [80.0, 120.0]}
    return load_scene("minimal").with_values(values)


@pytest.mark.usefixtures("listening")
def test_at_most_one_in_twenty_random_scenes_asks_for_a_kernel_that_is_not_shipped() -> None:
    draw, asked, refused = np.random.default_rng(7), 0, 0
    with redirect_stderr(Listener()):
        for k in range(150):
            scene = random_scene(draw)
            try:
                VERBS[k % len(VERBS)](scene)
            except InputError:  # The real-time solver has no set-valued law, a sweep and a map no profile.
                refused += 1
            except Compiles:
                asked += 1
        for name in bundled_scenes():
            tcc_sim.solve(load_scene(name), cycles=1)
            Plant(load_scene(name)).warm_up()
    assert asked <= 7
    assert refused < 50


def test_a_folder_keeps_the_kernels_of_the_uses_uncompiled_and_nothing_else(shipped: set[str], tmp_path: Path) -> None:
    source, folder = tmp_path / "source", tmp_path / "folder"
    shutil.copytree(PACKAGE, source / "tcc_sim", ignore=shutil.ignore_patterns("__pycache__", "shipped"))
    shutil.copytree(PACKAGE.parent / "config", source / "share" / "tcc_sim" / "config")
    numba = Path(str(importlib.util.find_spec("numba").origin))  # type: ignore[union-attr]
    (source / "numba").mkdir()
    (source / "numba" / "__init__.py").write_text("raise RuntimeError('it compiles')")
    shutil.copy(numba.with_name("_version.py"), source / "numba")
    shutil.copytree(kernel_cache.SHIPPED, folder)
    (folder / "left").touch()
    done = subprocess.run([sys.executable, "-m", "tcc_sim.study.cli.ahead", folder], cwd=source, capture_output=True,
                          text=True, check=True, env={**os.environ, "PYTHONPATH": str(source)})
    assert done.stderr == f"tcc_sim: {len(shipped)} kernels compiled ahead\n"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {
        name: (kernel_cache.SHIPPED / name).read_bytes() for name in shipped}


def test_the_first_run_of_a_process_with_an_empty_cache_prints_nothing(shipped: set[str], tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", CODE], env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
                          capture_output=True, text=True, check=True)
    assert (done.stderr, list(tmp_path.rglob("*-*"))) == ("", [])
