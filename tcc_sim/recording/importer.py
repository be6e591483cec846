"""Import a foreign bag as a recording of this package, in which every state names its run and `held` its inputs.

The package rosbags reads SQLite and ROS 1; MCAP is read by this package's own reader, compressed files once unpacked.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
import zstandard

from tcc_sim.errors import RecordingError, counted, one_line, require
from tcc_sim.messages import cdr, held
from tcc_sim.messages.definitions import CARRIED, Definition, definition
from tcc_sim.recording.announcements import holding_from
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.commands import COMMANDS
from tcc_sim.recording.contents import Channel
from tcc_sim.recording.mcap_file import McapFile
from tcc_sim.recording.parts import KINDS, METADATA, PACKED, listed, listed_counts, needed_of
from tcc_sim.recording.reader import Run
from tcc_sim.recording.records import PASSED_OVER, Expansion
from tcc_sim.recording.recovery import copy_messages, recover
from tcc_sim.recording.runs import placed
from tcc_sim.topics import DIAGNOSTIC_ARRAY, FLOAT64_ARRAY, FLUID_PRESSURE, HELD_INPUTS, INPUTS, JOINT_STATE, topic

_WANTED = {*CARRIED, DIAGNOSTIC_ARRAY}
"""Message types that are copied."""


@dataclass(frozen=True)
class Imported:
    """Result of an import: the new bag, its numbers of states and runs, and sentences on losses and on what is unknown.
    """

    directory: Path
    states: int
    runs: int
    notes: list[str]


def import_bag(path: Path, directory: Path, joints: Mapping[str, str] | None = None, topic: str | None = None,
               driveline: int | None = None) -> Imported:
    """Write a driveline of a foreign bag into a new recording.

    Messages whose states name their run are copied as they are. Otherwise the states of each run get a name and the
    layout of this package; a source that the bag does not state is `nobody`, and its counts are unknown. Stamps count
    from the zero that the scene states or, without a scene, from the first state of each run.

    Parameters
    ----------
    path : a bag in SQLite (directory or .db3), a .bag of ROS 1, or MCAP, also in files compressed by zstd
    joints : names of flywheel and clutch_plate, if they differ
    topic : topic of the joint_states to read, if there are several
    driveline : number of the driveline to read, counted from 0; None for one with a scene, on the shortest topic

    Raises
    ------
    MissingPackage
        The bag needs rosbags, which is not installed.
    RecordingError
        The directory exists, or the bag cannot be read, lacks messages that it counts, or holds no driveline.
    """
    if directory.exists():
        raise RecordingError(f"{directory} exists already and is not overwritten")
    with tempfile.TemporaryDirectory(prefix="tcc_sim_") as folder:
        inside, staged = needed_of(sorted(path.iterdir()), listed(path)[0]) if path.is_dir() else [path], path
        packed = [part for part in inside if re.search(PACKED, part.name)]
        foreign = [part for part in inside if re.search("|".join(KINDS), part.name) and part not in packed]
        if foreign:
            require("rosbags", f"importing {path}")
            staged = Path(folder, "bag.mcap")
            _stage(foreign, staged, Path(folder), listed_counts(path))
        elif packed:
            for part in [*(part for part in inside if part.suffix == ".mcap"), *path.glob(METADATA)]:
                Path(folder, part.name).symlink_to(part.resolve())
            unpacked = [_unpacked(part, Path(folder)) for part in packed]
            staged = Path(folder) if path.is_dir() else unpacked[0]
        run = Run(staged, joints, topic, driveline)
        if run.driveline.runs:
            columns = run.columns()
            saved = recover(run, directory)
            return Imported(directory, sum(map(len, columns.runs)), len(columns.runs), saved.missing)
        return _written(run, directory)


def _unpacked(part: Path, folder: Path) -> Path:
    """Unpack a compressed file into a folder; RecordingError if it is damaged or too large for its size."""
    where = folder / part.stem
    try:
        limit = PASSED_OVER * Expansion(part.stat().st_size).limit
        with part.open("rb") as packed, where.open("wb") as plain, zstandard.ZstdDecompressor().stream_reader(
                packed, read_across_frames=True) as reader:
            while block := reader.read(1 << 20):
                plain.write(block)
                if plain.tell() > limit:
                    raise RecordingError(f"{part} would unpack to more than {limit} bytes, the most allowed for a file "
                                         "of its size")
    except (OSError, zstandard.ZstdError) as error:
        raise RecordingError(f"{part} cannot be unpacked: {error}") from None
    return where


def _stage(parts: Sequence[Path], staged: Path, folder: Path, counts: Mapping[str, int]) -> None:
    """Copy the wanted messages of every part into an MCAP file, and count them against what the part states."""
    file = McapFile(staged)
    for part in parts:
        try:
            read, stated = _copied(_unpacked(part, folder) if part.suffix == ".zstd" else part, file)
        except RecordingError:
            raise
        except Exception as error:  # rosbags raises many kinds.
            raise RecordingError(f"{part} cannot be read by rosbags: {one_line(str(error))}") from None
        stated = counts.get(part.name, stated)
        if read != stated:
            raise RecordingError(f"{part}: {read} of {counted(stated, 'message')} could be read by rosbags")
    file.close()


def _copied(part: Path, file: McapFile) -> tuple[int, int]:
    """Copy the wanted messages of a part; return the numbers of messages read, and in the part as it states."""
    from rosbags.rosbag1 import Reader as Ros1Reader
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    ros1, types = part.suffix == ".bag", get_typestore(Stores.ROS2_FOXY)
    channels: dict[int, int | None] = {}
    with Ros1Reader(part) if ros1 else Reader(part) as reader:
        read = 0
        for connection, time, data in reader.messages():
            read += 1
            if connection.id not in channels:
                kind = connection.msgtype
                schema = definition(kind) if kind in CARRIED else Definition("", "")
                channels[connection.id] = file.channel(
                    connection.topic, kind, schema=schema) if kind in _WANTED else None
            number = channels[connection.id]
            if number is not None:
                file.write(number, time, time, bytes(types.ros1_to_cdr(data, connection.msgtype) if ros1 else data))
        return read, int(reader.message_count)


def _written(run: Run, directory: Path) -> Imported:
    """Write the states of a run without names into a new recording."""
    columns = run.columns()
    with BagWriter(directory) as bag:
        scenes = placed(run.scenes, columns.runs)
        channels = {row: bag.channel(f"/{row}", kind, row=row) for row, kind in (
            ("joint_states", JOINT_STATE), ("held", FLOAT64_ARRAY), ("applied_pressure", FLUID_PRESSURE),
            ("output_state", JOINT_STATE))}
        for states, name in zip(columns.runs, held.runs()):
            for index, number in scenes:
                if states.index <= index < states.index + len(states):
                    scene = run.scenes[number]
                    # Stamps of the new recording are simulation time.
                    bag.describe(holding_from(scene.parameters, scene.first_stamp_ns, scene.origin, 0, name,
                                              run.driveline.topic), scene.version)
            _write_run(bag, channels, states, name, 0 if run.scenes else int(states.stamp_ns[0]))
        space = run.driveline.topic.rpartition("/")[0]

        def channel_of(channel: Channel) -> int | None:
            if COMMANDS.get(channel.row) != channel.type or channel.topic.rpartition("/")[0] != space:
                return None
            if channel.row not in channels:
                channels[channel.row] = bag.channel(f"/{channel.row}", channel.type, row=channel.row)
            return channels[channel.row]

        copy_messages(run, bag, channel_of)
        bag.close(run.result)
    notes = [text for text in run.warnings if "of other programs" not in text]
    if not run.scenes:
        notes.append("the bag holds no scene: give --scene to analyse; time begins at the first state of each run")
    if all(states.held is None for states in columns.runs):
        notes.append("the bag does not state who set its inputs: sources and counts of commands are unknown")
    return Imported(directory, sum(map(len, columns.runs)), len(columns.runs), list(dict.fromkeys(notes)))


def _write_run(bag: BagWriter, channels: Mapping[str, int], states: JointStates, run: str, zero: int) -> None:
    """Write the messages of a run, whose stamps count from `zero`, ns."""
    tick = float(np.median(np.diff(states.stamp_ns))) if len(states) > 1 else 1e6
    angle, speed = (np.broadcast_to(column, len(states)).tolist() for column in states.far_end[:2])
    reports, pressures = dict(_reports(states, tick, zero)), states.of("applied_pressure").tolist()
    values = zip(*(getattr(states, name).tolist() for name in topic("joint_states").fields))
    rows = zip((states.stamp_ns - zero).tolist(), states.log_ns.tolist(), states.sent_ns.tolist(), values)
    for k, (stamp, log, sent, joints) in enumerate(rows):
        if k in reports:
            bag.write(channels["held"], log, sent, held.held_message(run, reports[k]), latched=True)
        bag.write(channels["joint_states"], log, sent, cdr.ENCODERS["joint_states"](stamp, *joints, frame=run))
        if np.isfinite(pressures[k]):
            bag.write(channels["applied_pressure"], log, sent, cdr.fluid_pressure(stamp, pressures[k], frame=run))
        if states.stamp_ns[k] >= states.moved_ns and np.isfinite(angle[k]):
            bag.write(channels["output_state"], log, sent,
                      cdr.ENCODERS["output_state"](stamp, angle[k], speed[k], np.nan, frame=run))


def _reports(states: JointStates, tick: float, zero: int) -> Iterator[tuple[int, list[float]]]:
    """Iterate over the states before which `held` is sent, and its values: the sources that the bag states."""
    sources = np.nan_to_num(np.stack([states.input(name, "source") for name in INPUTS], axis=1), nan=held.NOBODY)
    changed = {0, len(states) - 1, *(1 + np.flatnonzero((np.diff(sources, axis=0) != 0).any(axis=1))).tolist()}
    for number, k in enumerate(sorted(changed), 1):
        time = float(states.stamp_ns[k] - zero)
        stated = dict(zip(INPUTS, sources[k].tolist()))
        values = [(stated.get(name, held.NOBODY), *[np.nan] * 4, 0, *[np.nan] * 4) for name in HELD_INPUTS]
        yield k, [round(time / tick), time, number, held.GOES_ON, *chain.from_iterable(values)]
