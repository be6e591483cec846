"""Kernels that an installation compiles ahead, so that first runs need not wait: those of the bundled scenes and of the
commands on the pages. `python -m tcc_sim.study.cli.ahead FOLDER` compiles them into a folder, on two processors.

A use calls the package's own functions on a scene, for an engine cycle or a tick, so the kinds of kernels follow from
the scenes.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tcc_sim.analysis.periodicity import periodicity
from tcc_sim.compiling import kernel_cache
from tcc_sim.plant.driveline import Plant
from tcc_sim.scene import Scene, bundled_scenes, load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.fixed_step import advance
from tcc_sim.solvers.fixed_step_sensitivity import advance_windows
from tcc_sim.solvers.key_derivatives import key_derivatives
from tcc_sim.solvers.stroboscopic import sections, stroboscopic_map
from tcc_sim.solvers.terms import terms_of
from tcc_sim.study.paper.catalogue import FIGURES, FigureOptions, series_system
from tcc_sim.study.paper.figures import SOLVER_CURVES

Use = Callable[[Scene], object]
NEAR_REST = np.array([0.1, 0.1, 0.0])


def solve_cycle(scene: Scene) -> None:
    """Solve one cycle."""
    solve(scene, cycles=1).raise_for_status()


def map_cycle(scene: Scene) -> None:
    """Map the section by one cycle, with derivatives."""
    stroboscopic_map(scene.system, NEAR_REST, 1.0, parameters=("engine.frequency",))


def find_sections(scene: Scene) -> None:
    """Find section points of many motions."""
    sections(scene.system, NEAR_REST[None], 0, 1, 1e-9)


def make_ticks(scene: Scene) -> None:
    """Make ticks of the node, alone and with every term, and ticks with the states between."""
    plant = Plant(scene)
    plant.warm_up()
    advance(np.zeros(3), 0.0, 1e-6, 1, plant.stepper.terms, None, np.empty((1, 3)))


def make_windows(scene: Scene) -> None:
    """Make ticks with derivatives by a key."""
    by = key_derivatives(scene.system, ("driveline.stiffness",))
    advance_windows(NEAR_REST[None], 0.0, 1e-6, 1, 1, terms_of(scene.system), None, by)


def judge_section(scene: Scene) -> None:
    """Judge a motion, as the core's verbs do."""
    periodicity(solve(scene, cycles=4).solved_cycles)


def solve_figures(scene: Scene) -> None:
    """Solve a cycle of every curve of the paper's figures, and of Fig. 2 by every solver; `scene` is not used."""
    for row in FIGURES.values():
        for series in row.series:
            solve(series_system(series, FigureOptions()), cycles=1)
    for solver, (_, law, changes) in SOLVER_CURVES.items():
        solve(series_system(FIGURES[2].series[0], FigureOptions(law=law)), cycles=1, solver=solver, **changes)


OTHER_SCENES: dict[str, tuple[str, dict[str, object]]] = {
    "ramp": ("minimal", {"engine.frequency_times": [0.0, 5.0], "engine.frequency_values": [80.0, 300.0]}),
    "set_valued": ("chaos", {"friction.law": "set_valued"}),
    "actuator": ("controlled", {"pressure.time_constant": 0.03, "pressure.delay": 0.005}),
    "curve": ("controlled", {"friction.slip_speeds": [0.0, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0],
                             "friction.coefficients": [0.22, 0.2072, 0.1887, 0.1816, 0.1879, 0.1955, 0.1999]})}
"""Scenes that commands on the pages make of bundled ones: a profile, the set-valued law, an actuator, and friction by
two exponentials, which `identify --free friction.curve` takes.
"""
USES: tuple[tuple[Use, tuple[str, ...]], ...] = (
    (solve_cycle, (*bundled_scenes(), "ramp")), (make_ticks, (*bundled_scenes(), "actuator")),
    (make_windows, ("commands", "controlled", "curve")), (map_cycle, ("chaos", "minimal", "set_valued")),
    (find_sections, ("chaos",)), (solve_cycle, ("set_valued",)),
    (solve_figures, ("minimal",)), (judge_section, ("minimal",)))
"""Every use with its scenes: all bundled ones for a run and the nodes, those of the pages for other verbs."""
PARTS = slice(0, 3), slice(3, None)
"""Two halves of the work, in processes of their own."""


def named_scene(name: str) -> Scene:
    """Return a bundled scene, or one of OTHER_SCENES."""
    base, changes = OTHER_SCENES.get(name, (name, {}))
    return load_scene(base).with_values(changes)


def make(part: int) -> None:
    """Make the uses of a part of USES, and print the names of their kernels; a use that fails leaves the others."""
    kernel_cache.announced.add("compiling")
    for use, scenes in USES[PARTS[part]]:
        for name in scenes:
            try:
                use(named_scene(name))
            except Exception as error:
                print(f"tcc_sim: not compiled ahead: {use.__name__} of {name}: {error}", file=sys.stderr)
    print(*sorted(kernel_cache.used), sep="\n")


def ship(folder: Path) -> int:
    """Compile the kernels into a folder, which then holds nothing else; return their number."""
    with tempfile.TemporaryDirectory() as cache:
        workers = [subprocess.Popen([sys.executable, "-m", "tcc_sim.study.cli.ahead", "part", str(part)],
                                    stdout=subprocess.PIPE, text=True, env={**os.environ, "NUMBA_CACHE_DIR": cache})
                   for part in range(len(PARTS))]
        names = {name for worker in workers for name in worker.communicate()[0].split()}
        contents = {name: path.read_bytes() for name in sorted(names)
                    for path in (kernel_cache.SHIPPED / name, Path(cache, "tcc_sim", name)) if path.exists()}
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    return len(contents)


def run(words: list[str]) -> None:
    """Ship the kernels into the folder that is the only word, or make the part whose number is the second one."""
    if len(words) == 1:
        print(f"tcc_sim: {ship(Path(words[0]))} kernels compiled ahead", file=sys.stderr)
    else:
        make(int(words[1]))


if __name__ == "__main__":
    run(sys.argv[1:])
