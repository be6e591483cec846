"""A solved Trajectory as a recording, as the driveline node would have published it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tcc_sim.messages import cdr
from tcc_sim.recording.mcap_file import McapFile
from tcc_sim.topics import topic
from tcc_sim.trajectory import Trajectory, integral


def write_trajectory(path: Path, trajectory: Trajectory, scene_text: str | None = None) -> None:
    """Write joint_states, slip_speed, friction_torque and stick_slip_state of every sample to a new MCAP file.

    All times in it are simulation time. The flywheel angle, where the trajectory has none, is the plate angle plus the
    integral of the slip speed (trapezoidal rule) from 0.

    Raises
    ------
    RecordingError
        The file exists or cannot be created.
    """
    flywheel = trajectory.flywheel_angle
    if flywheel is None:
        flywheel = trajectory.plate_angle + integral(trajectory.slip_speed, trajectory.t)
    columns = (flywheel, trajectory.plate_angle, trajectory.slip_speed + trajectory.plate_speed, trajectory.plate_speed,
               trajectory.engine_torque, trajectory.friction_torque)
    stamps = np.rint(trajectory.t * 1e9).astype(np.int64).tolist()
    output = McapFile(path, scene_text)
    try:
        joints, slip, friction, state = (output.channel(f"/{name}", topic(name).type) for name in
                                         ("joint_states", "slip_speed", "friction_torque", "stick_slip_state"))
        for stamp, slip_speed, mode, *values in zip(stamps, trajectory.slip_speed.tolist(), trajectory.state.tolist(),
                                                    *(column.tolist() for column in columns)):
            output.write(joints, stamp, stamp, cdr.joint_state(stamp, *values))
            output.write(slip, stamp, stamp, cdr.float64(slip_speed))
            output.write(friction, stamp, stamp, cdr.float64(values[-1]))
            output.write(state, stamp, stamp, cdr.int8(mode))
        output.close({"lost": {}, "solver": trajectory.solver})
    except BaseException:
        output.abandon()
        raise
