"""Drivelines of a recording: groups of joint_states by topic, publisher and joints, and the scene of each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tcc_sim.errors import InputError, RecordingError, counted, one_line
from tcc_sim.messages import cdr
from tcc_sim.messages.held import PROCESS
from tcc_sim.parameter_file import LARGEST_FILE, description_in
from tcc_sim.recording.announcements import MOST_SCENES, SceneRecord, simulation_ns, zeros_of
from tcc_sim.recording.contents import Channel
from tcc_sim.recording.layouts import LOG, ROW, SENT, STAMP, Decoded, Layouts
from tcc_sim.recording.records import Messages
from tcc_sim.result import reported, result_class
from tcc_sim.topics import CLUTCH_JOINT, JOINT_STATE, OUTPUT_JOINT, STRING

_MOST_NAMED = 20
_PARTICIPANT = 24
"""Hexadecimal digits of a publisher's identifier that it shares with all publishers of its process (RTPS)."""
_CLOCKS = ROW, LOG, SENT
_SCENE, _SCENE_KEY = "scene", "ros__parameters"


@result_class
class RecordedDriveline:
    """Joint states of one sender: a driveline with its restarts, or another node.

    publishers : identifiers of its publishers in the middleware, in the order of their first messages
    runs : names of its runs, in their order; empty if its states do not name them
    able : whether it has the joints flywheel and clutch plate
    """

    topic: str = reported("topic of its joint_states")
    publisher: str = reported("identifier of its latest publisher; empty if not recorded")
    joints: tuple[str, ...] = reported("their names")
    scene: str | None = reported("description of its first scene; null without a scene")
    states: int = reported("its joint_states")
    start: float = reported("smallest stamp of its states", "s")
    end: float = reported("largest one", "s")
    read: bool = reported("whether it was analysed")
    publishers: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    scenes: tuple[SceneRecord, ...] = ()
    able: bool = True

    def sentence(self) -> str:
        """Return the driveline in words."""
        what = f"joints {', '.join(self.joints[:_MOST_NAMED])}" if not self.able else self.scene or "no scene"
        who = f" of publisher {self.publisher}" if self.publisher else ""
        return one_line(f"{self.topic}{who}: {counted(self.states, 'state')} from {self.start:g} to {self.end:g} s, "
                        f"{what}")


class _Sent:
    """Messages of one run, or of one publisher with the same joints, or with both of those wanted (`able`)."""

    def __init__(self, topic: str, publisher: str, able: bool, run: str) -> None:
        self.topic, self.publisher, self.able, self.run = topic, publisher, able, run
        self.names = Counter[tuple[str, ...]]()
        self.spans = dict.fromkeys((*_CLOCKS, STAMP), (1 << 63, -1 << 63))
        """Smallest and largest: number in the order of reading, times of receipt and of sending, and stamp, ns."""

    def add(self, group: Decoded) -> None:
        """Take messages of one chunk."""
        self.names[group.names] += len(group.frames)
        for row, (low, high) in self.spans.items():
            self.spans[row] = min(low, int(group.heads[row].min())), max(high, int(group.heads[row].max()))


class Inventory:
    """Collector of everything in a recording that tells its drivelines apart, chunk by chunk; `joints` are the names of
    flywheel and clutch plate.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = joints
        self._layouts: dict[tuple[str, str], Layouts] = {}
        self._sent: dict[tuple[str, ...], _Sent] = {}
        self._scenes: dict[tuple[str, str, SceneRecord], None] = {}
        """Namespace, publisher and text of each scene on a topic."""
        self._before = 0

    @staticmethod
    def wants(channel: Channel) -> bool:
        """Return whether messages of a channel are read."""
        return channel.type == JOINT_STATE or (channel.type == STRING and channel.row == _SCENE)

    def refused(self, topic: str) -> tuple[int, str]:
        """Return the number of messages on a topic that could not be decoded, and the reason of one."""
        here = [layouts for (name, _), layouts in self._layouts.items() if name == topic]
        return sum(layouts.refused for layouts in here), next((layouts.why for layouts in here if layouts.why), "")

    def take(self, data: bytes, messages: Messages, channels: Mapping[int, Channel]) -> None:
        """Take one chunk."""
        array = np.frombuffer(data, dtype=np.uint8)
        for number, channel in channels.items():
            if not self.wants(channel):
                continue
            if channel.type == STRING:
                self._announced(data, messages, number, channel)
                continue
            layouts = self._layouts.setdefault((channel.topic, channel.publisher), Layouts(JOINT_STATE))
            for same in layouts.groups(array, messages, [number]):
                if same.names in ((OUTPUT_JOINT,), (CLUTCH_JOINT,)):
                    continue
                able = set(self._joints) <= set(same.names)
                names = self._joints if able else sorted(same.names)
                same.heads[ROW] += self._before
                for frame in np.unique(same.frames).tolist():
                    run = frame.decode() if able else ""
                    sent = _Sent(channel.topic, channel.publisher, able, run)
                    key = (run,) if run else (sent.topic, sent.publisher, *names)
                    self._sent.setdefault(key, sent).add(same.part(same.frames == frame))
        self._before += len(messages.channel)

    def _announced(self, data: bytes, messages: Messages, number: int, channel: Channel) -> None:
        for head, body in messages.of(data, number):
            if len(body) > LARGEST_FILE * 4 or len(self._scenes) >= MOST_SCENES:
                continue
            try:
                text = cdr.read_string(body)
            except ValueError:
                continue
            if _SCENE_KEY in text and len(text) <= LARGEST_FILE:
                when = int(head["sent_ns"]) or int(head["log_ns"])
                space = channel.topic.rpartition("/")[0]
                self._scenes.setdefault((space, channel.publisher, SceneRecord(text, "", when)))

    def drivelines(self, recorded: Sequence[SceneRecord], topic: str | None,
                   number: int | None) -> list[RecordedDriveline]:
        """Return the drivelines, those that can be read first, with the one on a topic or with a number marked, as
        `chosen` says; InputError if it does not exist or lacks the joints. `recorded` are the scenes in metadata
        records.
        """
        scenes = list(dict.fromkeys([*recorded, *(record for *_, record in self._scenes)]))
        drivelines = [self._unnamed(sent, recorded) for sent in self._sent.values() if not sent.run]
        drivelines += [self._named(chain, [one for one in scenes if one.run]) for chain in self._named_chains(scenes)]
        drivelines.sort(key=lambda one: (not one.able, len(one.topic), one.topic))
        number = chosen(drivelines, topic, number)
        return [replace(one, read=place == number) for place, one in enumerate(drivelines)]

    def _named_chains(self, scenes: Sequence[SceneRecord]) -> list[list[_Sent]]:
        """Return the runs of each driveline, in their order. Runs are those of one driveline if its node has the same
        name, by the scenes; without a scene, if they are on one topic. Processes that ran at the same time are several.
        """
        names = {one.run[:PROCESS]: one.driveline for one in scenes if one.run}
        chains: dict[str, list[list[list[_Sent]]]] = {}
        processes: dict[str, list[_Sent]] = {}
        for run in sorted((sent for sent in self._sent.values() if sent.run), key=lambda one: one.run):
            processes.setdefault(run.run[:PROCESS], []).append(run)
        for process, runs in sorted(processes.items(), key=lambda item: (item[0][:8], item[1][0].spans[LOG][0])):
            several = chains.setdefault(names.get(process, runs[0].topic), [])
            before = next((chain for chain in several if not _beside(chain[-1], runs)), None)
            if before is None:
                several.append([runs])
            else:
                before.append(runs)
        return [[run for runs in chain for run in runs] for several in chains.values() for chain in several]

    def _named(self, chain: Sequence[_Sent], scenes: Sequence[SceneRecord]) -> RecordedDriveline:
        runs = tuple(one.run for one in chain)
        latest: dict[str, SceneRecord] = {}
        for one in sorted(scenes, key=lambda one: one.log_ns):
            if one.run in runs:  # A message on the topic does not state the version, which a metadata record does.
                known = latest.get(one.text, one).version
                latest[one.text] = replace(one, version=one.version or known)
        mine = tuple(sorted(latest.values(), key=lambda one: (runs.index(one.run), one.first_stamp_ns, one.log_ns)))
        zeros = {one.run: one.zero_ns for one in mine}
        stamps = [stamp - zeros.get(one.run, 0) for one in chain for stamp in one.spans[STAMP]]
        return _recorded(chain, mine, stamps)

    def _unnamed(self, sent: _Sent, recorded: Sequence[SceneRecord]) -> RecordedDriveline:
        scenes = self._scenes_of(sent.topic.rpartition("/")[0], sent.publisher, recorded) if sent.able else ()
        zeros = zeros_of(one.text for one in scenes)
        return _recorded([sent], scenes, simulation_ns(np.array(sent.spans[STAMP]), zeros).tolist())

    def _scenes_of(self, space: str, publisher: str,
                   recorded: Sequence[SceneRecord]) -> tuple[SceneRecord, ...]:
        """Return the scenes of a driveline: in metadata records, and on the topic of its namespace by its process.

        A metadata record has no publisher; one whose scene only other drivelines announced on a topic is theirs.
        """
        senders = [sent.publisher for sent in self._sent.values() if not sent.run]
        comparable = any(same_process(who, senders) for _, who, _ in self._scenes)
        published = [record for of, who, record in self._scenes
                     if of == space and (same_process(who, (publisher,)) or not comparable)]
        others = {record.text for *_, record in self._scenes} - {record.text for record in published}
        scenes = {(record.text, record.log_ns): record for record in recorded if record.text not in others}
        known = {record.text for record in scenes.values()}
        more = {(record.text, record.log_ns): record for record in published if record.text not in known}
        every = [*scenes.values(), *more.values()]
        return tuple(sorted(every, key=lambda record: record.log_ns) if more else every)


def chosen(drivelines: Sequence[RecordedDriveline], topic: str | None, number: int | None) -> int | None:
    """Return the number of the driveline to read, or None if no driveline has the joints.

    The rule without a number: one with a scene before one without; then the shortest topic, alphabetically; then the
    latest run, if runs have names; then the one with the most states.
    """
    topic = None if topic is None else "/" + topic.removeprefix("/")
    if number is not None:
        if not 0 <= number < len(drivelines):
            raise InputError(f"driveline is {number}; the recording holds {counted(len(drivelines), 'driveline')}, "
                             "counted from 0")
        if topic is not None and drivelines[number].topic != topic:
            raise InputError(f"driveline {number} is on {drivelines[number].topic}, not on {topic}")
        if not drivelines[number].able:
            raise RecordingError(joints_sentence([drivelines[number]]))
        return number
    on = [one for one in drivelines if topic in (None, one.topic)]
    if topic is not None and not on:
        topics = ", ".join(dict.fromkeys(one.topic for one in drivelines)) or "none"
        raise InputError(f"no joint_states were recorded on {topic}; the topics with joint_states are {topics}")
    able = [(place, one) for place, one in enumerate(drivelines) if one in on and one.able]
    if topic is not None and not able:
        raise RecordingError(joints_sentence(on))
    best = min(able, default=None, key=lambda item: (
        not item[1].scenes, len(item[1].topic), item[1].topic,
        [-int(run[:8], 16) for run in item[1].runs[-1:]] or [0], -item[1].states, item[1].publisher))
    return None if best is None else best[0]


def _recorded(chain: Sequence[_Sent], scenes: tuple[SceneRecord, ...], stamps: Sequence[int]) -> RecordedDriveline:
    """Return the driveline of these messages, with its scenes and simulation times, ns."""
    names = sum((one.names for one in chain), Counter[tuple[str, ...]]())
    topic = Counter({one.topic: sum(one.names.values()) for one in chain}).most_common(1)[0][0]
    scene = (description_in(scenes[0].text) or "scene without a description") if scenes else None
    return RecordedDriveline(topic, chain[-1].publisher, names.most_common(1)[0][0], scene, sum(names.values()),
                             min(stamps) / 1e9, max(stamps) / 1e9, False,
                             tuple(dict.fromkeys(one.publisher for one in chain)),
                             tuple(one.run for one in chain if one.run), scenes, chain[0].able)


def _beside(one: Sequence[_Sent], other: Sequence[_Sent]) -> bool:
    """Return whether the runs of two processes overlap in the file and by every clock that tells time."""
    for clock in _CLOCKS:
        (low, high), (begin, end) = ((min(run.spans[clock][0] for run in runs),
                                      max(run.spans[clock][1] for run in runs)) for runs in (one, other))
        if low == high == begin == end:
            continue
        if begin > high or low > end:
            return False
    return True


def joints_sentence(drivelines: Iterable[RecordedDriveline]) -> str:
    """Return the sentence that asks for the names of the joints."""
    several = [(one.topic, ", ".join(one.joints[:_MOST_NAMED]) or "without names") for one in drivelines][:_MOST_NAMED]
    what = (f"its joints are {several[0][1]}" if len(several) == 1 else
            f"joints are {'; '.join(f'{names} on {topic}' for topic, names in several)}")
    return one_line(f"{what}; say which of them are flywheel and clutch plate: "
                    "--joints flywheel=NAME,clutch_plate=NAME")


def same_process(publisher: str, publishers: Iterable[str]) -> bool:
    """Return whether a publisher belongs to the process of one of others; true if it is unknown."""
    return not publisher or any(not one or one[:_PARTICIPANT] == publisher[:_PARTICIPANT] for one in publishers)
