"""Files of arrays: samples of a run as .npz, table (.csv) or recording (.mcap)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.errors import check_suffix
from tcc_sim.messages import cdr
from tcc_sim.output.files import draft
from tcc_sim.output.table_files import TABLES, documented, write_columns
from tcc_sim.tables.measured_table import hold_line
from tcc_sim.topics import FAR_END, INPUTS, topic
from tcc_sim.trajectory import UNITS, Cycles, Trajectory, integral

SUFFIXES = (*TABLES, ".mcap")
"""Suffixes of files of samples: tables, and recordings."""


def cycles_in(arrays: Mapping[str, Any]) -> Cycles | None:
    """Return the engine cycles in the arrays of a .npz, or None."""
    if "cycle_highest" not in arrays:
        return None
    return Cycles(arrays["section_states"][:, [1, 0, 2]], arrays["cycle_highest"], arrays["cycle_lowest"],
                  arrays["cycle_stick_time"], starts=arrays.get("cycle_starts"))


def _cycle_columns(cycles: Cycles | None) -> dict[str, Any]:
    """Return the engine cycles of a solver as the arrays that `cycles_in` reads."""
    if cycles is None:
        return {}
    return {"section_states": cycles.section[:, [1, 0, 2]], "cycle_highest": cycles.highest,
            "cycle_lowest": cycles.lowest, "cycle_stick_time": cycles.stick_time,
            **({} if cycles.starts is None else {"cycle_starts": cycles.starts})}


def write_samples(path: Path, trajectory: Trajectory, scene_text: str, *, recorded: bool = False,
                  document: Mapping[str, Any] | None = None) -> None:
    """Write every sample of `trajectory` to a .npz, .csv, .parquet, .mat or .mcap file.

    A .npz contains the columns, their units in the same order, the scene (YAML), the JSON `document` if given, and the
    engine cycles of the solver: `section_states` (plate angle, slip speed, plate speed at the start of each cycle and
    at the end of the last), `cycle_highest`, `cycle_lowest` (rad/s), `cycle_stick_time` and, for cycles of different
    lengths, `cycle_starts` (s). The other tables are those of `write_columns`. `recorded` samples of a commanded
    pressure that is known throughout have the pressure, Pa; and a .csv of such samples begins with the scene, and the
    interpolation of the inputs between rows. A .parquet, a .mat and a .mcap contain the scene too.

    Raises InputError: the suffix is not one of SUFFIXES.
    """
    check_suffix(path, SUFFIXES)
    columns: dict[str, Any] = dict(Trajectory.columns(trajectory))
    units = {name: UNITS[name] for name in columns}
    system, load = trajectory.system, trajectory.saturation_torque
    if recorded and system is not None and system.pressure.source == "topic" and np.isfinite(load).all():
        columns["actuation_pressure"], units["actuation_pressure"] = load / trajectory.along(
            lambda held: held.torque_per_pressure), "Pa"
    with draft(path) as part:
        if path.suffix == ".mcap":
            write_trajectory(part, trajectory, scene_text)
        elif path.suffix == ".npz":
            more = {**_cycle_columns(trajectory.cycles), **({} if document is None else documented(document))}
            np.savez(part, **columns, **more, units=np.array(list(units.values())), scene=np.array(scene_text))
        else:
            hold = _holds(trajectory) if recorded else {}
            comments = [*scene_text.splitlines(), "# " + hold_line(hold)] if recorded else []  # A comment of the scene.
            write_columns(part, path.suffix, columns, units, {"scene": scene_text}, hold, comments)


def _holds(recorded: Trajectory) -> dict[str, str]:
    """Return how to interpolate recorded inputs: a command holds through the tick that ends at the sample."""
    system = recorded.system
    commanded = [] if system is None else [system.engine.source == "topic", system.pressure.source == "topic"]
    held = dict(zip(INPUTS, commanded)) | ({} if recorded.output_speed is None else {FAR_END: True})
    return {name: "next" if tick else "linear" for name, tick in held.items()}


def write_trajectory(path: Path, trajectory: Trajectory, scene_text: str | None = None) -> None:
    """Write every sample to a new MCAP file, as the topics joint_states, slip_speed, friction_torque and
    stick_slip_state of the driveline node.

    All times in the file are simulation time. For a trajectory without flywheel angle, that angle is the plate angle
    plus the integral of the slip speed (trapezoidal rule) from 0.

    Raises RecordingError: the file exists or cannot be created.
    """
    from tcc_sim.recording.mcap_file import McapFile

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
