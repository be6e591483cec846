"""Kernels that an installation compiles ahead, so that first runs need not wait: all kinds of ticks and windows, solves
but those of a friction table with a profile, and maps of laws with at most one exponential.
`python -m tcc_sim.study.cli.ahead FOLDER` compiles them into a folder, on two processors.

A use calls the package's own functions on a scene, for an engine cycle or a tick, so the kinds of kernels follow from
the scenes.
"""

from __future__ import annotations

import gc
import itertools
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.analysis.steady.summary import periodicity
from tcc_sim.compiling import kernel_cache
from tcc_sim.plant.driveline import Plant
from tcc_sim.scene import Scene, load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.fixed_step_sensitivity import advance_windows
from tcc_sim.solvers.key_derivatives import key_derivatives
from tcc_sim.solvers.stroboscopic import stroboscopic_map
from tcc_sim.solvers.terms import terms_of
from tcc_sim.study.paper.catalogue import FIGURES, FigureOptions, series_system
from tcc_sim.study.paper.figures import SOLVER_CURVES

Values = dict[str, Any]
NEAR_REST = np.array([0.1, 0.1, 0.0])


def _solve_cycle(scene: Scene) -> None:
    solve(scene, cycles=1).raise_for_status()


def _map_cycle(scene: Scene) -> None:
    stroboscopic_map(scene.system, NEAR_REST, 1.0, parameters=("engine.frequency",))


def _make_ticks(scene: Scene) -> None:
    plant = Plant(scene)
    plant.warm_up()
    if not scene.system.pressure.actuated:
        solve(scene, solver="fixed_step", duration=plant.stepper.step)


def _make_windows(scene: Scene) -> None:
    by = key_derivatives(scene.system, ("driveline.stiffness",))
    advance_windows(NEAR_REST[None], 0.0, 1e-6, 1, 1, terms_of(scene.system), None, by)


def _judge_section(scene: Scene) -> None:
    periodicity(solve(scene, cycles=4).solved_cycles)


def _solve_figures(_: Scene) -> None:
    for row in FIGURES.values():
        for series in row.series:
            solve(series_system(series, FigureOptions()), cycles=1)
    for solver, (_curve, law, changes) in SOLVER_CURVES.items():
        solve(series_system(FIGURES[2].series[0], FigureOptions(law=law)), cycles=1, solver=solver, **changes)


SLIP_SPEEDS = [0.0, *(0.1 * 2.0**k for k in range(12))]
EXPONENTIALS: tuple[Values, ...] = (
    {"friction.kinetic_coefficient": 0.3}, {"friction.kinetic_coefficient": 0.24},
    *({"friction.slip_speeds": SLIP_SPEEDS,
       "friction.coefficients": [0.2 + 0.04 * math.exp(-2.0 * v) - 0.02 * math.exp(-0.2 * v)
                                 + share * math.exp(-0.02 * v) for v in SLIP_SPEEDS]} for share in (0.0, 0.02)))
"""Friction laws with no, one, two and three exponentials, by their number."""
EXACT: Values = {"friction.law": "set_valued"}
PULSATION: tuple[Values, ...] = ({"pressure.amplitude": 0.0}, {"pressure.amplitude": 2e4})
PROFILE: tuple[Values, ...] = ({}, {"engine.frequency_times": [0.0, 5.0], "engine.frequency_values": [80.0, 300.0]})
LAG: tuple[Values, ...] = ({}, {"pressure.time_constant": 0.03, "pressure.delay": 0.005})


def scenes(name: str, *choices: tuple[Values, ...]) -> Iterator[Scene]:
    """Yield a bundled scene with every combination of changes."""
    for values in itertools.product(*choices):
        yield load_scene(name).with_values({key: value for part in values for key, value in part.items()})


def uses() -> Iterator[tuple[Callable[[Scene], object], Scene]]:
    """Yield every use with its scenes; those of a law follow each other, since their kernels share compiled parts.

    The longest ones are first, so that two processes that begin at both ends meet at short ones.
    """
    yield _judge_section, load_scene("minimal")
    for scene in scenes("minimal", EXPONENTIALS[:2], PULSATION):
        yield _solve_cycle, scene
        yield _map_cycle, scene
    for scene in (*scenes("minimal", EXPONENTIALS[2:]), *scenes("minimal", EXPONENTIALS[:2], PROFILE[1:])):
        yield _solve_cycle, scene
    yield _solve_figures, load_scene("minimal")
    for scene in scenes("minimal", (EXACT,), EXPONENTIALS, PULSATION):
        yield _solve_cycle, scene
    for scene in scenes("minimal", (EXACT,), EXPONENTIALS[:2]):
        yield _map_cycle, scene
    for scene in scenes("controlled", EXPONENTIALS, PROFILE, LAG):
        yield _make_ticks, scene
    for scene in scenes("controlled", EXPONENTIALS, PROFILE):
        yield _make_windows, scene


def make(claims: Path, backwards: bool) -> None:
    """Make the uses that no other process has claimed by a folder in `claims`, from the first or from the last one on,
    and print the names of their kernels. A use that fails leaves the others.
    """
    gc.disable()  # It takes a twentieth of the time where it walks again through all that the compiler keeps.
    kernel_cache.announced.add("compiling")
    numbered = list(enumerate(uses()))
    for number, (use, scene) in reversed(numbered) if backwards else numbered:
        try:
            (claims / str(number)).mkdir()
            use(scene)
            gc.collect()
            gc.freeze()
        except FileExistsError:
            break
        except Exception as error:
            print(f"tcc_sim: not compiled ahead: {use.__name__[1:]} of {scene.name}: {error}", file=sys.stderr)
    print(*sorted(kernel_cache.used), sep="\n")


def ship(folder: Path) -> int:
    """Compile the kernels that a folder lacks in two processes, and keep nothing else in it; return their number."""
    with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as claims:
        if folder.exists():
            shutil.copytree(folder, Path(cache, "tcc_sim"))
        workers = [subprocess.Popen([sys.executable, "-m", "tcc_sim.study.cli.ahead", claims, way],
                                    stdout=subprocess.PIPE, text=True, env={**os.environ, "NUMBA_CACHE_DIR": cache})
                   for way in ("forwards", "backwards")]
        names = {name for worker in workers for name in worker.communicate()[0].split()}
        contents = {name: path.read_bytes() for name in sorted(names)
                    for path in (kernel_cache.SHIPPED / name, Path(cache, "tcc_sim", name)) if path.exists()}
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    return len(contents)


if __name__ == "__main__":
    if len(sys.argv) == 2:
        print(f"tcc_sim: {ship(Path(sys.argv[1]))} kernels compiled ahead", file=sys.stderr)
    else:
        make(Path(sys.argv[1]), sys.argv[2] == "backwards")
