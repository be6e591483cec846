"""A digital twin: a simulation beside the recording, or the table, whose inputs drove it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tcc_sim.recording.table import TIME, read_columns
from tcc_sim.replay.recorded import read
from tcc_sim.trajectory import Floats, Trajectory


@dataclass(frozen=True)
class Twin:
    """What was recorded and what was simulated of it.

    trajectory : the simulation
    t, slip_speed : (n,) s from the start of the recording, and rad/s
    source : where they are from
    """

    trajectory: Trajectory
    t: Floats
    slip_speed: Floats
    source: str

    @property
    def difference(self) -> Floats:
        """(n,) simulated less recorded slip speed, rad/s."""
        return np.interp(self.t, self.trajectory.t, self.trajectory.slip_speed) - self.slip_speed

    def __str__(self) -> str:
        wrong, size = (float(np.sqrt(np.mean(x**2))) for x in (self.difference, self.slip_speed))
        return f"slip speed beside {self.source}: {wrong:.4g} rad/s apart (rms), of {size:.4g} rad/s"


def twin_of(path: Path, trajectory: Trajectory) -> Twin | None:
    """A simulation beside what a recording's first run or a table says of the slip speed within its time; None where
    that is nothing.

    Raises
    ------
    InputError
        A file that cannot be read.
    """
    if path.suffix == ".csv":
        columns = read_columns(path, (TIME,))
        if "slip_speed" not in columns:
            return None
        t, slip = columns[TIME], columns["slip_speed"]
    else:
        run = read(path).trajectory(0)
        t, slip = run.t - run.t[0], run.slip_speed
    within = (t >= trajectory.t[0]) & (t <= trajectory.t[-1])
    return Twin(trajectory, t[within], slip[within], path.name) if np.count_nonzero(within) > 1 else None
