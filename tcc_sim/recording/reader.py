"""Read a bag or an MCAP file, complete, truncated or damaged, into columns."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim import topics
from tcc_sim.errors import InputError, RecordingError, counted, one_line
from tcc_sim.messages import held
from tcc_sim.recording.announcements import SceneRecord, simulation_ns, zeros_of
from tcc_sim.recording.columns import Columns, Window
from tcc_sim.recording.commands import COMMANDS, SIGNALS, SOURCE, Commands
from tcc_sim.recording.contents import CDR, Channel, Contents, batches, together
from tcc_sim.recording.drivelines import Inventory, RecordedDriveline, joints_sentence, same_process
from tcc_sim.recording.layouts import NUMBER, SENT, STAMP, Collected, Decoded, Layouts
from tcc_sim.recording.parts import numbers_of, opened, parts_of
from tcc_sim.recording.records import Messages, RecordStream, Warnings
from tcc_sim.recording.runs import BEAT, commands_held, received_of, runs_of
from tcc_sim.recording.stamps import StampCounter
from tcc_sim.topics import DIAGNOSTIC_ARRAY, FLOAT64_ARRAY, FLUID_PRESSURE, INPUTS, JOINT_STATE, LIMITS, SHAFT, TARGET

_TOPICS_OF_DRIVELINE = {*(row.name for row in topics.stamped()), SOURCE, SHAFT}
"""Topics that the driveline itself publishes."""
_MOST_TOPICS = 20
BYTES_A_STATE = 230
"""Memory for one state and its derived quantities, bytes, with a message of `held` at one state of three."""
MOST_DIFFERING = 0.2
"""Largest share of states with the stamp of another one and other values, if states do not name their run."""
_MOST_NAMED, _LARGEST_COUNT = 50, 10**18

Chunk = tuple[bytes, Messages, Mapping[int, Channel]]
"""Bytes of an unpacked chunk, the positions of its messages, and the channels of these, as far as described."""


class TooManyStates(InputError):
    """A recording needs more memory than is allowed."""


class Run:
    """A recording, a bag directory or an MCAP file; RecordingError if nothing can be read, InputError if the driveline
    does not exist.

    joints : names of flywheel and clutch_plate, if they differ
    topic : topic of the driveline's joint_states; None for any
    driveline : its number in the list of drivelines, counted from 0; None for the rule of `drivelines.chosen`
    topics : message type by topic
    drivelines : its drivelines, and other nodes with joint states
    complete : whether the recording was closed properly; False if it was cut short
    result : the recorder's final record (lost messages by topic), merged over all files; None without one
    warnings : one sentence for each damage, complete after `columns()`
    messages : number of messages read by topic, complete after `columns()`
    size : size of all files, bytes
    """

    def __init__(self, path: Path | str, joints: Mapping[str, str] | None = None, topic: str | None = None,
                 driveline: int | None = None) -> None:
        self.path = Path(path)
        self._joints = tuple((joints or {}).get(name, name) for name in topics.JOINT_NAMES)
        parts = parts_of(self.path)
        self.warnings, self.stamps, self.messages = Warnings(), StampCounter(), dict[str, int]()
        self.result: dict[str, Any] | None = None
        self._contents: dict[Path, Contents] = {}
        unreadable: list[str] = []
        for name in parts.paths:
            try:
                self._contents[name] = _contents_of(name)
            except RecordingError as error:
                if len(parts.paths) == 1:
                    raise
                unreadable.append(f"left out: {error}")
        if not self._contents:
            raise RecordingError(unreadable[0].removeprefix("left out: "))
        self.paths, every = list(self._contents), self._contents.values()
        self.size, cut = sum(one.size for one in every), not all(one.complete for one in every)
        self._left_out = [*parts.sentences(), *unreadable,
                          *["the recording was cut short: data after the last flush is missing"] * cut]
        self.parts_missing = bool(parts.missing or parts.absent)
        """Whether a part of the recording is not there."""
        self.complete = not (cut or self.parts_missing) and not any(
            parts.ordered or numbers_of([part]) for part in parts.paths if part not in self._contents)
        self._order_known = parts.ordered or len(self.paths) == 1 or bool(numbers_of(self.paths))
        for contents in every:
            self.result = together(self.result, contents.result)
        # Each part of a split recording repeats the scene.
        self.recorded_scenes = list(dict.fromkeys(scene for contents in every for scene in contents.scenes))
        inventory, self.topics = Inventory(self._joints), dict[str, str]()
        for data, messages, channels in self._chunks(inventory.wants):
            inventory.take(data, messages, channels)
        self.topics.update({channel.topic: channel.type for channel in self._every_channel()})
        self._damage, self.warnings = next(iter(self.warnings), ""), Warnings()
        self.drivelines = inventory.drivelines(self.recorded_scenes, topic, driveline)
        self._driveline = next((one for one in self.drivelines if one.read), None)
        self._refused = inventory.refused(self.joint_states_topic)

    @property
    def driveline(self) -> RecordedDriveline:
        """The driveline to read; RecordingError if the recording holds none."""
        if self._driveline is not None:
            return self._driveline
        if self.drivelines:
            raise RecordingError(joints_sentence(self.drivelines))
        damage = f" ({self._damage})" if self._damage else ""
        for channel in self._every_channel():
            if channel.type.replace("/msg/", "/") == "sensor_msgs/JointState" and channel.encoding != CDR:
                how = "; a .bag of ROS 1 is read by tcc-sim import" if channel.encoding == "ros1" else ""
                raise RecordingError(f"{self.paths[0]}: the messages of {one_line(channel.topic)} are in the encoding "
                                     f"{one_line(channel.encoding)}; only {CDR}, that of ROS 2, is read{how}")
        states = min((name for name, kind in self.topics.items() if kind == JOINT_STATE),
                     key=lambda name: (name.rpartition("/")[2] != "joint_states", len(name), name), default="")
        if states or not self.topics or damage:
            why = damage or (f" ({self._refused[1]})" if self._refused[1] else "")
            raise RecordingError(f"{self.paths[0]}: no {states or '/joint_states'} can be read{why}")
        topics = [f"{name} ({kind or 'of unknown type'})" for name, kind in sorted(self.topics.items())]
        more = f" and {len(topics) - _MOST_TOPICS} more" if len(topics) > _MOST_TOPICS else ""
        raise RecordingError(f"{self.paths[0]} holds no {JOINT_STATE}, so no driveline; its topics are "
                             f"{', '.join(topics[:_MOST_TOPICS])}{more}")

    @property
    def joint_states_topic(self) -> str:
        """Topic of the driveline's joint_states."""
        return self._driveline.topic if self._driveline is not None else "/joint_states"

    @property
    def scenes(self) -> list[SceneRecord]:
        """Scenes of the driveline; without a driveline all recorded scenes."""
        return list(self._driveline.scenes) if self._driveline is not None else self.recorded_scenes

    @property
    def scene_text(self) -> str | None:
        """The (first) scene of the driveline, YAML; None if it has no scene."""
        return self.scenes[0].text if self.scenes else None

    @property
    def solver(self) -> str:
        """Name of the solver in the result record; `fixed_step`, the driveline's, by default."""
        name = (self.result or {}).get("solver")
        return name if isinstance(name, str) else "fixed_step"

    def columns(self, window: Window | None = None) -> Columns:
        """Read the recording, or the states in a window, once and return it as columns.

        States that name their run are in the order of their stamps, wherever they stand in the files; those of other
        recordings as in `runs.runs_of`. RecordingError if there are no joint_states, or publishers are mixed and
        cannot be separated; TooManyStates if the states would need more than half of the machine's memory.
        """
        topic = self.driveline.topic
        if not (self._order_known or self.driveline.runs or self.driveline.publisher):
            raise RecordingError(f"{self.path}: the order of its {len(self.paths)} parts is not stated: no "
                                 "metadata.yaml lists them, their names have no numbers, and the states name neither "
                                 "run nor publisher; name them as run_0.mcap, run_1.mcap")
        columns = self._read(window or Window())
        self._conclude()
        if not self.stamps.messages:
            raise RecordingError(f"{self.paths[0]}: no {topic} can be read" +
                                 (f" ({self.warnings[0]})" if self.warnings else ""))
        if self.stamps.repeated == self.stamps.messages - 1 > 0:
            raise RecordingError(f"all {self.stamps.messages} stamps of {topic} are "
                                 f"{int(columns.runs[0].stamp_ns[0]) * 1e-9:g} s: its publisher does not set them, and "
                                 "without times nothing can be analysed")
        if not columns.keyed and self._differing > MOST_DIFFERING * self.stamps.messages:
            raise RecordingError(f"{topic}: {self._differing} of {self.stamps.messages} states have the stamp of "
                                 "another one and other values; publishers are mixed and cannot be separated")
        if self.stamps.mixed:
            raise RecordingError(f"{topic}: simulation time jumps back and forth "
                                 f"{counted(self.stamps.returns, 'time')} between two runs; publishers are mixed and "
                                 "cannot be separated")
        return columns

    def chunks(self) -> Iterator[Chunk]:
        """Iterate over every readable chunk of all files, in their order; then `warnings` and `messages` are complete.
        """
        self.warnings, self.messages = Warnings(), dict.fromkeys(self.topics, 0)
        yield from self._chunks(lambda _: True)
        self.warnings.extend(self._left_out)
        for kind in ("attachment", "metadata record"):
            if count := sum(contents.foreign[kind] for contents in self._contents.values()):
                self.warnings.append(f"{counted(count, kind)} of other programs not copied")

    def _read(self, window: Window) -> Columns:
        self.warnings, self.messages, self.stamps = Warnings(), dict.fromkeys(self.topics, 0), StampCounter()
        driveline, keyed = self.driveline, bool(self.driveline.runs)
        space = driveline.topic.rpartition("/")[0]
        if window.all:
            self._check_memory(driveline.states)
        self._comparable = any(one.publisher and one.topic != driveline.topic
                               and same_process(one.publisher, set(driveline.publishers))
                               for one in self._every_channel())
        zeros = zeros_of(scene.text for scene in self.scenes)
        origins = _Origins(self, window, zeros)
        joints = {"joint_states": self._joints}
        kinds = {row.name: Collected(
            Layouts(row.type, joints.get(row.name, row.joints), row.joint_fields or row.fields), origins.of)
            for row in (topics.topic("joint_states"), *topics.stamped())}
        commands, rows = Commands(space, zeros[:0] if keyed else zeros), dict[int, list[NDArray[np.float64]]]()
        for data, messages, channels in self._chunks(self._wants):
            array = np.frombuffer(data, dtype=np.uint8)
            for name, kind in kinds.items():
                if mine := [number for number, channel in channels.items() if self._is(channel, name)]:
                    kind.take(array, messages, mine)
            if keyed:
                for number, channel in channels.items():
                    if channel.type == FLOAT64_ARRAY:
                        origins.take_held(data, messages, number, rows)
            commands.take(data, messages, {
                number: channel for number, channel in channels.items() if self._ours(channel)})
            self._check_memory(kinds["joint_states"].kept)
        found = {name: kind.messages() for name, kind in kinds.items()}
        states = found.pop("joint_states")
        joined = {name: one for name, one in found.items() if one.heads.size}
        for one in joined.values():
            one.columns.pop(SHAFT, None)  # It follows from the states.
        held_rows = {run: every[np.unique(every[:, held.NUMBER], return_index=True)[1]]  # In order, each once.
                     for run, of_run in rows.items() for every in [np.concatenate(of_run)]}
        runs, self._differing, unplaced = runs_of(states, joined, held_rows, driveline.runs, commands.sources,
                                                  self.stamps)
        if unplaced:
            self.warnings.append(f"{', '.join(unplaced)}: left out, as the recording does not state to which runs they "
                                 "belong")
        if self._differing:
            self.warnings.append(f"{counted(self._differing, 'message')} left out: their {'run and ' * keyed}stamp "
                                 "came before with other values")
        if unknown := sum(int(np.count_nonzero(one.held_row < 0)) for one in runs if one.held_row is not None):
            self.warnings.append(f"inputs are unknown at {counted(unknown, 'tick')}: what stated them is missing")
        self._pass_over(kinds)
        last = int(states.heads[SENT].max(initial=0))
        recorded, before = commands.recorded(last), commands.recorded(last - BEAT)
        if not held_rows and (names := [name for name in COMMANDS if recorded.get(name)]):
            self.warnings.append(f"{', '.join(names)}: left out, as the recording does not state when the driveline "
                                 "held them (the topic held does)" + "; --target gives a target" * (TARGET in names))
        # Commands to another driveline on the same topics, and repeats without numbers, cannot be told apart.
        renamed = INPUTS[1] if keyed and kinds["applied_pressure"].unnamed else ""  # These are no applied pressures.
        mixed = (any(one.able and not one.read and one.topic.rpartition("/")[0] == space for one in self.drivelines)
                 or (self.stamps.repeated > 0 and not states.heads[NUMBER].any()))
        received: dict[str, int | None] = dict.fromkeys(
            name for name in INPUTS if (mixed or name == renamed) and recorded.get(name))
        for name in INPUTS if held_rows and not mixed else ():
            if name == renamed:
                continue
            count = received_of(held_rows, states, name)  # Those sent shortly before the end may be on their way.
            received[name] = max(count, recorded.get(name, 0)) if before.get(name, 0) <= count else count
        return Columns(runs, commands_held(runs), {name: len(who) for name, who in commands.publishers.items()},
                       recorded, received, commands.counts(driveline.runs), keyed, commands.limits)

    def _is(self, channel: Channel, name: str) -> bool:
        """Return whether a channel may hold messages of one of the driveline's topics with stamps."""
        driveline = self.driveline
        if name != "joint_states" and channel.topic == driveline.topic:
            return False
        kind = topics.topic(name).type
        if driveline.runs:  # The frame names the run; a command may have the frame of the state that it answers.
            return channel.type == kind and (name in ("joint_states", "output_state") or channel.row == name)
        if name == "joint_states":
            here = (channel.type, channel.topic) == (kind, driveline.topic)
            return here and channel.publisher in driveline.publishers
        space = driveline.topic.rpartition("/")[0]
        return (channel.type, channel.topic) == (kind, f"{space}/{name}") and self._ours(channel)

    def _wants(self, channel: Channel) -> bool:
        """Return whether messages of a channel are needed for the columns."""
        driveline = self.driveline
        if driveline.runs and channel.type in (JOINT_STATE, FLUID_PRESSURE, FLOAT64_ARRAY):
            return True
        return channel.type == DIAGNOSTIC_ARRAY or channel.topic == driveline.topic or channel.row in {
            *_TOPICS_OF_DRIVELINE, *SIGNALS, LIMITS}

    def _every_channel(self) -> Iterator[Channel]:
        for contents in self._contents.values():
            yield from contents.channels.values()

    def _ours(self, channel: Channel) -> bool:
        """Return whether a channel belongs to the driveline: commands by anyone; other topics by its own process, if
        their publishers are known.
        """
        name, publishers = channel.topic.rpartition("/")[2], self.driveline.publishers
        if name not in _TOPICS_OF_DRIVELINE or channel.topic == self.driveline.topic:
            return True
        return not self._comparable or same_process(channel.publisher, publishers)

    def _check_memory(self, count: int) -> None:
        """Raise TooManyStates if `count` states need more than half of the machine's memory."""
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        if count * BYTES_A_STATE > memory // 2:
            raise TooManyStates(f"{self.path}: its {count} states take {count * BYTES_A_STATE / 1e9:.3g} GB, "
                                f"more than half of the {memory / 1e9:.3g} GB of this machine; ask for a window: "
                                "--from and --to (simulation time, s), or start and end in Python")

    def _chunks(self, wants: Callable[[Channel], bool]) -> Iterator[Chunk]:
        """Iterate over the chunks of all files with wanted messages; skip damaged ones with a warning."""
        for path, known in self._contents.items():
            contents = replace(known, channels=dict(known.channels), schemas=dict(known.schemas))
            seen, unchecked = Counter[int](), False
            with opened(path) as file:
                stream = RecordStream(file, warnings=self.warnings)
                for data, messages, checked in batches(stream, contents, wants, seen):
                    unchecked = unchecked or not checked
                    yield data, messages, {number: contents.channels[number] for number in np.unique(
                        messages.channel).tolist() if number in contents.channels}
            known.channels = {**contents.channels, **known.channels}
            for channel, row in contents.channels.items():
                self.topics[row.topic] = row.type
                self.messages[row.topic] = self.messages.get(row.topic, 0) + seen[channel]
            self.warnings.conclude()
            self.warnings.extend(contents.warnings())
            if unchecked:
                self.warnings.append("some messages have no checksum: damage in them would go unnoticed")
            if nameless := set(seen) - set(contents.channels):
                count = sum(seen[channel] for channel in nameless)
                self.warnings.append(f"{counted(count, 'message')} left out: the description of the channel is lost")
            short = (sum(max(0, count - seen[channel]) for channel, count in known.expected.items())
                     if known.complete else 0)
            if short:
                self.warnings.append(f"{short} of {counted(sum(known.expected.values()), 'message')} could not be read")

    def _pass_over(self, kinds: Mapping[str, Collected]) -> None:
        """Add warnings for messages and drivelines that were passed over."""
        topic = self.driveline.topic
        space = topic.rpartition("/")[0]
        pressures = kinds["applied_pressure"].layouts
        for name, (refused, why) in ((topic, self._refused),
                                     (f"{space}/applied_pressure", (pressures.refused, pressures.why))):
            if refused:
                self.warnings.append(f"{counted(refused, 'message')} of {name} left out: their layout differs"
                                     + (f" ({why})" if why else ""))
        others = [(number, one) for number, one in enumerate(self.drivelines) if not one.read]
        for number, one in others[:_MOST_TOPICS]:
            how = f"; --driveline {number} reads it" if one.able else ""
            self.warnings.append(f"not read: {one.sentence()}{how}")
        if len(others) > _MOST_TOPICS:
            self.warnings.append(f"not read: {len(others) - _MOST_TOPICS} more publishers of joint states")

    def _conclude(self) -> None:
        self.warnings.extend(self._left_out)
        stamps = self.stamps
        if stamps.lost:
            self.warnings.append(f"{counted(stamps.lost, 'message')} of {self.joint_states_topic} missing, according "
                                 "to the stamps")
        result = self.result or {}
        for key, what in (("lost", "lost while recording"), ("unsent", "could not be sent by their publisher")):
            counts = result.get(key)
            for topic, count in list(counts.items())[:_MOST_NAMED] if isinstance(counts, dict) else ():
                if isinstance(count, int) and count > 0 and not (key == "lost" and topic == self.joint_states_topic):
                    lost = counted(min(count, _LARGEST_COUNT), "message")
                    self.warnings.append(f"{lost} of {one_line(topic)} {what}")
        if again := stamps.resets + stamps.restarts:
            self.warnings.append(f"simulation time started again {counted(again, 'time')} "
                                 f"({counted(stamps.resets, 'reset')}, {counted(stamps.restarts, 'restart')}): "
                                 "these are separate runs")
        if stamps.repeated:
            self.warnings.append(f"{counted(stamps.repeated, 'repeated stamp')} left out")


class _Origins:
    """Runs of a driveline by number, the zeros of their stamps, and the window."""

    def __init__(self, run: Run, window: Window, zeros: NDArray[np.int64]) -> None:
        self._names, self._window, self._zeros = run.driveline.runs, window, zeros
        self._numbers = {name.encode(): number for number, name in enumerate(self._names)}
        by_run = {scene.run: scene.zero_ns for scene in run.scenes}
        self._zero = np.array([by_run.get(name, 0) for name in self._names], np.int64)
        self._identified = int(bool(run.driveline.publisher))

    def of(self, found: Decoded) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Return number of the run (-1: another driveline's) and simulation time (ns) of each message, and whether it
        lies in the window. Runs without names have 1 in place of the number if the publisher is identified, else 0, and
        lie in the window by time alone.
        """
        if not self._names:
            stamps = simulation_ns(found.heads[STAMP], self._zeros)
            return np.where(found.frames == b"", self._identified, -1), stamps, self._window.mask(stamps, None)
        names, inverse = np.unique(found.frames, return_inverse=True)
        origin = np.array([self._numbers.get(name, -1) for name in names.tolist()], np.int64)[inverse]
        stamps = found.heads[STAMP] - self._zero[np.maximum(origin, 0)]
        return origin, stamps, self._window.mask(stamps, origin)

    def take_held(self, data: bytes, messages: Messages, channel: int,
                  rows: dict[int, list[NDArray[np.float64]]]) -> None:
        """Add the messages of `held` on a channel to the rows of their runs."""
        found, _ = held.LAYOUT.records([body for _, body in messages.of(data, channel)])
        found = found[np.isfinite(found["values"][:, :held.HEAD]).all(axis=1)]
        for name in np.unique(found["run"]).tolist():
            if name in self._numbers:
                rows.setdefault(self._numbers[name], []).append(found["values"][found["run"] == name])


def _contents_of(path: Path) -> Contents:
    contents = Contents()
    with opened(path) as file:
        contents.size = file.seek(0, os.SEEK_END)
        stream = RecordStream(file)
        for record in stream:
            contents.add(record.opcode, record.body)
    contents.complete = stream.complete
    return contents
