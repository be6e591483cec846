"""Convert recorded messages and states of the real-time solver to rows of numbers."""

from __future__ import annotations

import math

import numpy as np

from tcc_sim.recording.columns import JointStates
from tcc_sim.solvers.fixed_step import Reached
from tcc_sim.topics import topic
from tcc_sim.trajectory import Floats

COLUMNS = topic("joint_states").fields
"""Columns of a row: angles (rad) and speeds (rad/s) of flywheel and plate, engine and friction torque (N m)."""


def rows_of(batch: JointStates) -> Floats:
    """Return states as rows, (n, 6)."""
    return np.stack([getattr(batch, name) for name in COLUMNS], axis=1)


def recorded_beside(batch: JointStates) -> tuple[list[float], list[float], list[float]]:
    """Return the applied pressures, Pa, and angles (rad) and speeds (rad/s) of the far end; NaN if not recorded."""
    pressure, angle, speed = ([math.nan] * len(batch) if column is None else column.tolist() for column in (
        batch.applied_pressure, batch.output_angle, batch.output_speed))
    return pressure, angle, speed


def state_of(row: list[float]) -> tuple[float, float, float, float]:
    """Return the solver's state, slip speed, plate angle, plate speed and flywheel angle, at a row."""
    return row[2] - row[3], row[1], row[3], row[0]


def message_row(reached: Reached) -> list[float]:
    """Return the row of a solver state."""
    v, plate_angle, plate_speed, flywheel_angle, engine, friction, _ = reached
    return [flywheel_angle, plate_angle, v + plate_speed, plate_speed, engine, friction]
