"""Simulation of a slipping torque converter clutch driveline, in real time on ROS 2 and offline.

config/*.yaml (a scene) -> scene.Scene -> model + solvers, holding only what the scene needs
    -> Trajectory (offline), or nodes.driveline -> topics -> nodes.recorder -> MCAP -> recording -> Trajectory
    -> analysis (maxima, sections, periods, damping) -> views (Rerun, pictures), JSON, reports.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tcc_sim.later_rooms import importing

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

__all__ = ["Scene", "System", "Trajectory", "__version__", "analyse", "basins", "closed_loop", "continuation",
           "explain", "figure", "fmu", "fmu_controller", "gain_map", "identify", "linearise", "load_scene", "orders",
           "plot", "read", "scatter", "simulate", "solve", "spectrum", "sweep", "sweep_grid"]

__getattr__, __dir__ = importing(__name__)
