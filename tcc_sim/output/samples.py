"""Files of tables and arrays of any command, each by the one writer of its format: .npz, .csv, .parquet, .mat and, of
the samples of a run, .mcap; and reading of the arrays of a .npz, whose sizes are checked before.
"""

from __future__ import annotations

import csv
import json
import os
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.lib import format as npy

from tcc_sim.errors import InputError, check_suffix, one_line
from tcc_sim.messages import cdr
from tcc_sim.output.files import draft
from tcc_sim.result import units_of_columns
from tcc_sim.tables.binary import write_mat, write_parquet
from tcc_sim.tables.measured_table import hold_line
from tcc_sim.topics import FAR_END, INPUTS, topic
from tcc_sim.trajectory import UNITS, Cycles, Trajectory, integral

TABLES = (".npz", ".csv", ".parquet", ".mat")
"""Suffixes of files of a table or of arrays."""
LARGEST_RATIO, SMALLEST_LIMIT = 100, 16 << 20
"""Largest ratio of the arrays that are read to their file, and bytes that the arrays of any file may have."""
_KINDS = "biufcU"
_DAMAGED = (BadZipFile, zlib.error, ValueError, KeyError, EOFError, NotImplementedError, RuntimeError, OverflowError,
            MemoryError, TokenError)


def write_columns(path: Path, suffix: str, columns: Mapping[str, Any], units: Mapping[str, str],
                  texts: Mapping[str, str], hold: Mapping[str, str], comments: Iterable[str] = ()) -> None:
    """Write a table as .csv, .parquet or .mat.

    A .csv has every digit, the names of the columns in its first line and their units in its second, behind the
    `comments` in lines that begin with #. A .parquet has units in the metadata of its fields, and `texts` and `hold` in
    its own; a .mat has column vectors, the structures `units` and `hold`, and the texts.
    """
    if suffix == ".parquet":
        write_parquet(path, columns, units, hold, texts)
    elif suffix == ".mat":
        write_mat(path, columns, units, hold, texts)
    else:
        with path.open("w", encoding="utf-8", newline="\n") as file:
            file.writelines(f"# {line}\n" for line in comments)
            rows = csv.writer(file, lineterminator="\n")
            rows.writerows([columns, [units.get(name, "") for name in columns]])
            rows.writerows(zip(*(np.asarray(values).tolist() for values in columns.values())))


def write_result(path: Path, result: Any, document: Mapping[str, Any]) -> None:
    """Write a result as .npz, .csv, .parquet or .mat, with the JSON `document` except in a .csv.

    The file has the `columns` of the result; a .npz and a .mat have its `arrays` instead, where its class has these.
    """
    named = (result.arrays if path.suffix in (".npz", ".mat") and hasattr(result, "arrays") else result.columns)()
    with draft(path) as part:
        if path.suffix == ".npz":
            with part.open("wb") as stream:
                np.savez_compressed(stream, **named, **documented(document))
        else:
            write_columns(part, path.suffix, named, units_of_columns(type(result), named),
                          {"document": json.dumps(document, allow_nan=False)}, {})


def documented(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON of a command as an array of a .npz, which thus names its origin and can be drawn again."""
    return {"document": np.array(json.dumps(document, allow_nan=False))}


def read_arrays(path: Path, names: Iterable[str]) -> dict[str, Any]:
    """Return those of the named arrays that a .npz holds; others are not read.

    Raise InputError: the file cannot be read or is damaged; an array is no array of numbers or text; or arrays are
    larger than the file or the memory can hold.
    """
    place, arrays = f"{path}", {}
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a regular file")
        left = min(LARGEST_RATIO * path.stat().st_size + SMALLEST_LIMIT,
                   os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2)
        with ZipFile(path) as file:
            for name in (name for name in names if f"{name}.npy" in file.namelist()):
                place, size = f"{path}: array {name}", file.getinfo(f"{name}.npy").file_size
                if size > left:
                    raise InputError(f"{place} would take {size} bytes; at most {left} are accepted for a file of its "
                                     "size")
                left -= size
                with file.open(f"{name}.npy") as stream:
                    arrays[name] = npy.read_array(stream, allow_pickle=False)
                    if stream.read(1):  # At the end the checksum is compared.
                        raise ValueError("bytes follow its numbers")
                if arrays[name].dtype.kind not in _KINDS:
                    raise ValueError("it holds neither numbers nor text")
        return arrays
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    except InputError:
        raise
    except _DAMAGED as error:
        raise InputError(f"{place} is damaged, or no .npz: {one_line(str(error)) or type(error).__name__}") from None


def document_in(path: Path, arrays: dict[str, Any]) -> dict[str, Any]:
    """Take the JSON of the command that wrote a .npz out of its arrays."""
    text = arrays.pop("document", None)
    if text is None or text.shape != () or text.dtype.kind != "U":
        raise InputError(f"{path} does not say which command wrote it; write it again with --out")
    try:
        document = json.loads(str(text))
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        raise InputError(f"{path}: the JSON of the command that wrote it is damaged")
    return document


SUFFIXES = (*TABLES, ".mcap")
"""Suffixes of files of samples: tables, and recordings."""


def cycles_in(arrays: Mapping[str, Any]) -> Cycles | None:
    """Return the engine cycles in the arrays of a .npz, or None."""
    if "cycle_highest" not in arrays:
        return None
    return Cycles(arrays["section_states"][:, [1, 0, 2]], arrays["cycle_highest"], arrays["cycle_lowest"],
                  arrays["cycle_stick_time"], starts=arrays.get("cycle_starts"))


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
            cycles, more = trajectory.cycles, dict[str, Any]()
            if cycles is not None:
                more = {"section_states": cycles.section[:, [1, 0, 2]], "cycle_highest": cycles.highest,
                        "cycle_lowest": cycles.lowest, "cycle_stick_time": cycles.stick_time,
                        **({} if cycles.starts is None else {"cycle_starts": cycles.starts})}
            more |= {} if document is None else documented(document)
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
