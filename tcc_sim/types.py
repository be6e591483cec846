"""Types of arguments and results, for annotations and `isinstance`: ``from tcc_sim.types import Reading``."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tcc_sim.analysis.loop.control import Steps
    from tcc_sim.analysis.loop.tracking import Tracking
    from tcc_sim.analysis.measured.orders import Orders, Spectrum
    from tcc_sim.analysis.measured.signals import Signals
    from tcc_sim.analysis.steady.summary import Summary
    from tcc_sim.errors import InputError
    from tcc_sim.estimation.identify import Identification
    from tcc_sim.estimation.linearise import Linearisation
    from tcc_sim.estimation.measurement import Measurement
    from tcc_sim.estimation.multiple_shooting import FitSettings, Gates
    from tcc_sim.fmi.controller import FmuController
    from tcc_sim.plant.closed_loop import ControlledRun
    from tcc_sim.plant.driveline import Reading
    from tcc_sim.plant.sensors import Sensor
    from tcc_sim.replay.measured import MeasuredRun
    from tcc_sim.replay.recorded import RecordedRun, Recording
    from tcc_sim.replay.result import Replay
    from tcc_sim.study.basins.results import Axis, Basins, Planes
    from tcc_sim.study.continuation.branch import Branch
    from tcc_sim.study.continuation.motions import Motions, Seed
    from tcc_sim.study.paper.figures import Figure
    from tcc_sim.sweeps.gains import GainMap
    from tcc_sim.sweeps.results import Grid, Sweep
    from tcc_sim.sweeps.scatter import Scattered
    from tcc_sim.sweeps.simulation import Plan, Simulation
    from tcc_sim.sweeps.steady_state import Start
    from tcc_sim.tables.measured_table import MeasuredTable
    from tcc_sim.testing.rig import Rig
    from tcc_sim.testing.run import LockstepRun
    from tcc_sim.trajectory import Status, Transitions

__all__ = ["Axis", "Basins", "Branch", "ControlledRun", "Figure", "FitSettings", "FmuController", "GainMap", "Gates",
           "Grid", "Identification", "InputError", "Linearisation", "LockstepRun", "MeasuredRun", "MeasuredTable",
           "Measurement", "Motions", "Orders", "Plan", "Planes", "Reading", "RecordedRun", "Recording", "Replay", "Rig",
           "Scattered", "Seed", "Sensor", "Signals", "Simulation", "Spectrum", "Start", "Status", "Steps", "Summary",
           "Sweep", "Tracking", "Transitions"]

_MODULES = {
    "analysis.loop.control": "Steps", "analysis.loop.tracking": "Tracking",
    "analysis.measured.orders": "Orders Spectrum", "analysis.measured.signals": "Signals",
    "analysis.steady.summary": "Summary", "errors": "InputError", "estimation.identify": "Identification",
    "estimation.linearise": "Linearisation", "estimation.measurement": "Measurement",
    "estimation.multiple_shooting": "FitSettings Gates", "fmi.controller": "FmuController",
    "plant.closed_loop": "ControlledRun", "plant.driveline": "Reading", "plant.sensors": "Sensor",
    "replay.measured": "MeasuredRun", "replay.recorded": "RecordedRun Recording", "replay.result": "Replay",
    "study.basins.results": "Axis Basins Planes", "study.continuation.branch": "Branch",
    "study.continuation.motions": "Motions Seed", "study.paper.figures": "Figure", "sweeps.gains": "GainMap",
    "sweeps.results": "Grid Sweep", "sweeps.scatter": "Scattered", "sweeps.simulation": "Plan Simulation",
    "sweeps.steady_state": "Start",
    "tables.measured_table": "MeasuredTable", "testing.rig": "Rig", "testing.run": "LockstepRun",
    "trajectory": "Status Transitions"}
_PLACES = {name: f"tcc_sim.{module}" for module, names in _MODULES.items() for name in names.split()}


def __getattr__(name: str) -> object:
    """Import a type when it is first used, so that neither ROS nor the study is loaded without need."""
    if name in _PLACES:
        return getattr(import_module(_PLACES[name]), name)
    raise AttributeError(f"module 'tcc_sim.types' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names of the types."""
    return sorted(__all__)
