"""Types of arguments and results, for annotations and `isinstance`: ``from tcc_sim.types import Reading``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tcc_sim.later_rooms import importing

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
    from tcc_sim.plant.closed_loop import ControlledRun, LockstepRun
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
    from tcc_sim.sweeps.simulation import Plan, Simulation, Start
    from tcc_sim.tables.measured_table import MeasuredTable
    from tcc_sim.testing.rig import Rig
    from tcc_sim.trajectory import Status, Transitions

__all__ = ["Axis", "Basins", "Branch", "ControlledRun", "Figure", "FitSettings", "FmuController", "GainMap", "Gates",
           "Grid", "Identification", "InputError", "Linearisation", "LockstepRun", "MeasuredRun", "MeasuredTable",
           "Measurement", "Motions", "Orders", "Plan", "Planes", "Reading", "RecordedRun", "Recording", "Replay", "Rig",
           "Scattered", "Seed", "Sensor", "Signals", "Simulation", "Spectrum", "Start", "Status", "Steps", "Summary",
           "Sweep", "Tracking", "Transitions"]

__getattr__, __dir__ = importing(__name__)
