"""Simulation of a slipping torque converter clutch driveline, in real time on ROS 2 and offline.

config/*.yaml (a scene) -> scene.Scene -> model + solvers, holding only what the scene needs
    -> Trajectory (offline), or nodes.driveline -> topics -> nodes.recorder -> MCAP -> recording -> Trajectory
    -> analysis (maxima, sections, periods, damping) -> views (Rerun, pictures), JSON, reports.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tcc_sim.analysis.measured.orders import orders_of as orders
    from tcc_sim.estimation.identify import identify
    from tcc_sim.estimation.linearise import linearise
    from tcc_sim.fmi.controller import fmu_controller
    from tcc_sim.functions import analysis as analyse
    from tcc_sim.functions import explanation as explain
    from tcc_sim.functions import fmu_file as fmu
    from tcc_sim.functions import simulation as simulate
    from tcc_sim.functions import spectrum_of_run as spectrum
    from tcc_sim.model.parameters import System
    from tcc_sim.plant.closed_loop import closed_loop
    from tcc_sim.replay.recorded import read
    from tcc_sim.scene import Scene, load_scene
    from tcc_sim.solvers import solve
    from tcc_sim.study.basins.compute import basins
    from tcc_sim.study.continuation.motions import continuation
    from tcc_sim.study.paper.drawings import paper_figure as figure
    from tcc_sim.sweeps.gains import gain_map
    from tcc_sim.sweeps.scatter import scatter
    from tcc_sim.sweeps.sweep import sweep, sweep_grid
    from tcc_sim.trajectory import Trajectory
    from tcc_sim.views.plots import plot

__version__ = "1.1.0"

_PUBLIC = {"System": "tcc_sim.model.parameters", "Scene": "tcc_sim.scene", "load_scene": "tcc_sim.scene",
           "solve": "tcc_sim.solvers", "Trajectory": "tcc_sim.trajectory", "simulate": "tcc_sim.functions",
           "scatter": "tcc_sim.sweeps.scatter", "sweep": "tcc_sim.sweeps.sweep", "sweep_grid": "tcc_sim.sweeps.sweep",
           "analyse": "tcc_sim.functions", "explain": "tcc_sim.functions", "fmu": "tcc_sim.functions",
           "orders": "tcc_sim.analysis.measured.orders", "spectrum": "tcc_sim.functions",
           "figure": "tcc_sim.study.paper.drawings",
           "continuation": "tcc_sim.study.continuation.motions", "basins": "tcc_sim.study.basins.compute",
           "linearise": "tcc_sim.estimation.linearise", "identify": "tcc_sim.estimation.identify",
           "plot": "tcc_sim.views.plots", "closed_loop": "tcc_sim.plant.closed_loop",
           "gain_map": "tcc_sim.sweeps.gains", "fmu_controller": "tcc_sim.fmi.controller",
           "read": "tcc_sim.replay.recorded"}
_OTHERWISE_NAMED = {"analyse": "analysis", "explain": "explanation", "figure": "paper_figure", "fmu": "fmu_file",
                    "orders": "orders_of", "simulate": "simulation", "spectrum": "spectrum_of_run"}

__all__ = ["Scene", "System", "Trajectory", "__version__", "analyse", "basins", "closed_loop", "continuation",
           "explain", "figure", "fmu", "fmu_controller", "gain_map", "identify", "linearise", "load_scene", "orders",
           "plot", "read", "scatter", "simulate", "solve", "spectrum", "sweep", "sweep_grid"]


def __getattr__(name: str) -> object:
    """Import a public name when it is first used, so that `import tcc_sim` stays light."""
    if name in _PUBLIC:
        return getattr(import_module(_PUBLIC[name]), _OTHERWISE_NAMED.get(name, name))
    raise AttributeError(f"module 'tcc_sim' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted(__all__)


class _Package(ModuleType):
    """Module type of the package: importing a subpackage does not hide the public function of the same name."""

    def __setattr__(self, name: str, value: object) -> None:
        """Bind a name unless it would replace a public function by a subpackage."""
        if not (name in _PUBLIC and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
