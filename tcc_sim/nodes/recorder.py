"""The recorder node: write every topic of the driveline, as raw messages, into a rosbag2 bag that survives a kill.

Subscriptions are drained in batches several times a second, which costs much less than a callback per message.
"""

from __future__ import annotations

if __name__ == "__main__":
    from tcc_sim.nodes.executables import recorder_node

    raise SystemExit(recorder_node())

import sys
import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from tcc_sim.errors import InputError, RecordingError, counted, one_line
from tcc_sim.messages import cdr
from tcc_sim.messages.definitions import definition
from tcc_sim.nodes import executables
from tcc_sim.nodes.executables import Spinner, Throttle, run_node
from tcc_sim.nodes.middleware import MOST_PUBLISHERS, publisher_of, qos_fields
from tcc_sim.nodes.parameters import RecorderOptions, declared
from tcc_sim.nodes.track import SILENCE, SimulatedTime, Taken, Track, UnsentCount
from tcc_sim.recording.announcements import simulation_ns, zeros_of
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.mcap_file import RELIABLE
from tcc_sim.topics import CLOCK_TOPIC, JOINT_STATE, TOPICS, Topic

_DRAIN_PERIOD = 0.1
_LOOK_PERIOD = 0.25


class Recorder:
    """Recorder of the driveline's topics: it subscribes, drains, follows publishers and writes.

    With use_sim_time log times are simulation time, /clock is recorded even where `topics` does not name it, and
    messages wait for the first one on /clock in the middleware.

    Raises InputError: a parameter is out of its range, or the output exists or cannot be created.
    """

    def __init__(self, node: Node) -> None:
        self.node = node
        options = declared(node, RecorderOptions, output=datetime.now().strftime("tcc_sim_%Y_%m_%d-%H_%M_%S"))
        if not options.topics:
            raise InputError("topics is empty; it must name a topic")
        self.flush_period, self.fsync_period = options.flush_period, options.fsync_period
        self.drain_period = min(_DRAIN_PERIOD, 0.5 * self.flush_period)
        self._rows: dict[str, Topic] = {}
        self._profiles: dict[str, list[dict[str, Any]]] = {}
        for row in TOPICS:
            known = self._rows.setdefault(topic := node.resolve_topic_name(row.name), row)
            if known.type != row.type:
                raise InputError(f"{row.name} is remapped onto {topic}, which is a {known.type}, not a {row.type}")
        self.tracks: dict[str, Track] = {}
        self._clock = node.resolve_topic_name(CLOCK_TOPIC)
        self._simulated = SimulatedTime() if node.get_parameter("use_sim_time").value else None
        self._held: list[tuple[Track, Taken]] = []
        wanted = {*map(node.resolve_topic_name, options.topics), *[self._clock] * (self._simulated is not None)}
        self._unknown = sorted(wanted - self._rows.keys())
        self.next_look = 0.0
        # The scene comes first, so that it precedes its states in the file. joint_states come last: the driveline may
        # wait for their subscriber, and all other subscriptions exist by then.
        states = node.resolve_topic_name("joint_states")
        self.unsent = UnsentCount()
        for topic, row in sorted(self._rows.items(), key=lambda item: (item[0] == states, not item[1].latched)):
            if topic in wanted:
                self._add(topic, row.type, row.latched)
        self._spinner, self._throttle = Spinner(node), Throttle(node)
        self._reported: dict[str, dict[str, int]] = {}
        self._zeros = zeros_of(())
        self.bag = BagWriter(Path(options.output), max_duration=options.max_bag_duration,
                             max_size=options.max_bag_size, sync=self.fsync_period > 0.0, result=self._part_result)

    def spin(self) -> None:
        """Record until a signal comes.

        Raises ExternalShutdownException: the context has been shut down, or a signal came during a wait. Raises
        OSError: Writing fails. Raises RecordingError: the directory was renamed or removed, or a file with the name of
        the next part exists.
        """
        flush = synced = time.monotonic()
        while not executables.end_requested.is_set():
            wake = time.monotonic() + self.drain_period
            self.drain()
            if time.monotonic() >= flush:
                self.bag.file.flush()
                flush = time.monotonic() + self.flush_period - self.drain_period
            if self.fsync_period and time.monotonic() >= synced + self.fsync_period - self.drain_period:
                self.bag.file.sync()
                synced = time.monotonic()
            if time.monotonic() >= self.next_look:
                self.bag.check()
                self.look()
                self.next_look = time.monotonic() + _LOOK_PERIOD
            while (left := wake - time.monotonic()) > 0.0:
                self._spinner.once(left)

    def drain(self, last: bool = False) -> None:
        """Write every waiting message; this needs no valid context.

        In simulation time, messages wait for the first message on /clock; with `last` they get their time of receipt.
        """
        if self._simulated is not None and not self._simulated.known:
            clock = self.tracks[self._clock]
            self.write(clock, clock.take())
            if not self._simulated.known:
                if not last:
                    return
                self._simulated = None
        held, self._held = self._held, []
        for track, taken in held:
            self.write(track, taken)
        # States are taken first and written last, so that what was sent before them precedes them, also in a file that
        # is cut short. /clock is taken last, so that it is known up to the newest message, and written first.
        first = self._clock if self._simulated is not None else None
        order = sorted(self.tracks.values(), key=lambda track: track.topic != first)
        for track, taken in reversed([(track, track.take()) for track in reversed(order)]):
            self.write(track, taken)

    def write(self, track: Track, taken: Taken) -> None:
        """Write messages of one topic."""
        if not taken:
            return
        write, channels = self.bag.write, track.channels
        sources: list[int] = []
        simulated, row = self._simulated, self._rows.get(track.topic)
        scene, unsent = (row is not None and row.name == name for name in ("scene", "unsent_messages"))
        if simulated is not None:
            if track.topic == self._clock:
                simulated.follow(taken)
            elif not simulated.known:
                self._held.append((track, taken))
                return
        for data, info in taken:
            number, who = info.get("publication_sequence_number") or 0, publisher_of(info)
            channel = channels.get(who) or self._channel(track, who)
            sources.append(channel)
            received = info["received_timestamp"] or time.time_ns()
            if scene:
                self._describe(data, info["source_timestamp"] or received)
            if unsent and who:
                self.unsent.add(who, data)
            log = received if simulated is None else simulated.of(info)
            write(channel, log, info["source_timestamp"], data, number, track.latched)
        if track.type == JOINT_STATE and not track.messages:
            self.next_look = 0.0  # Subscribe to a missing scene again.
        track.messages += len(taken)
        if track.stamps is not None:
            stamps = np.array([cdr.read_stamp(data) for data, _ in taken], dtype=np.int64)
            track.stamps.pieces(simulation_ns(stamps, self._zeros), np.array(sources, dtype=np.int64))

    def _describe(self, data: bytes, sent_ns: int) -> None:
        """Write a scene, which applies to messages sent after it, as a metadata record, which survives a kill."""
        try:
            text = cdr.read_string(data)
            self.bag.describe(text, log_ns=sent_ns)
            self._zeros = np.union1d(self._zeros, zeros_of([text]))
        except ValueError as error:
            self.node.get_logger().warning(f"a scene could not be read: {one_line(str(error))}")

    def look(self) -> None:
        """Check the publishers: adapt to their quality of service, add topics by type, warn of ended publishers."""
        logger = self.node.get_logger()
        if self._unknown:
            types = dict(self.node.get_topic_names_and_types())
            for topic in [topic for topic in self._unknown if topic in types]:
                self._unknown.remove(topic)
                try:
                    self._add(topic, types[topic][0])
                except InputError as error:
                    logger.warning(f"{topic} is not recorded: {error}")
        running = any(track.messages for track in self.tracks.values() if track.type == JOINT_STATE)
        for track in self.tracks.values():
            offered = self.node.get_publishers_info_by_topic(track.topic)
            self.write(track, track.follow(offered, again=running))
            now = {bytes(one.endpoint_gid) for one in offered}
            if track.latched:
                for who in track.channels.keys() - now:
                    self.bag.unlatch(track.channels[who])
            if track.topic == self._clock and self._simulated is not None and not track.messages and (
                    time.monotonic() - track.arrived > SILENCE):
                self._throttle.once("clock", "nothing is recorded yet: use_sim_time waits for a message on "
                                    f"{track.topic}")
            if track.type == JOINT_STATE:
                silent = track.fell_silent() if track.messages else None
                if silent:
                    logger.warning(f"no {track.topic} for {SILENCE:g} s: paused, stopped or killed; the recording "
                                   "continues")
                elif silent is not None:
                    logger.info(f"{track.topic} arrives again")
                if track.publishers - now:
                    left = f"; {len(now)} left" if now else ""
                    logger.warning(f"the publisher of {track.topic} is gone{left}; the recording continues")
                track.publishers = now

    def close(self, drain: bool = True) -> str:
        """Write waiting messages, close the bag, and return a summary; this needs no valid context."""
        if drain:
            self.drain(last=True)
        self.bag.close(self._part_result())
        totals = {key: sum(counts.values()) for key, counts in self._figures().items()}
        unsent = f", {totals['unsent']} never sent" if "unsent" in totals else ""
        where = one_line(str(self.bag.directory))
        return f"recorded {counted(totals['messages'], 'message')} in {where}, {totals['lost']} lost{unsent}"

    def _figures(self) -> dict[str, dict[str, int]]:
        seen = [track for track in self.tracks.values() if track.messages]
        figures = {"messages": {track.topic: track.messages for track in seen},
                   "lost": {track.topic: track.lost for track in seen},
                   "missing_stamps": {track.topic: track.stamps.lost for track in seen if track.stamps is not None}}
        unsent = dict(self.unsent.by_topic)
        return figures | ({"unsent": unsent} if any(unsent.values()) else {})

    def _part_result(self) -> dict[str, dict[str, int]]:
        """Return the figures of the part that ends: the difference since the part before it."""
        before, self._reported = self._reported, self._figures()
        return {key: {topic: count - before.get(key, {}).get(topic, 0) for topic, count in counts.items()}
                for key, counts in self._reported.items()}

    def _channel(self, track: Track, publisher: bytes) -> int:
        """Return the bag's channel of a publisher on a topic; publishers beyond MOST_PUBLISHERS share one."""
        if len(track.channels) >= MOST_PUBLISHERS:
            publisher = b""
        if publisher not in track.channels:
            row = self._rows[track.topic].name.removeprefix("/") if track.topic in self._rows else ""
            track.channels[publisher] = self.bag.channel(track.topic, track.type, self._offered(track.topic, publisher),
                                                         publisher=publisher.hex(), row=row)
        return track.channels[publisher]

    def _add(self, topic: str, type_name: str, latched: bool = False) -> None:
        definition(type_name)
        self.tracks[topic] = Track(self.node, topic, type_name, latched)

    def _offered(self, topic: str, publisher: bytes) -> Sequence[dict[str, Any]]:
        """Return the quality of service that a topic's first publisher offers (all publishers, if it is not known), as
        readers of bags expect one for all channels of a topic; the driveline's if the context is no longer valid.
        """
        if topic not in self._profiles:
            try:
                offered = self.node.get_publishers_info_by_topic(topic)
            except RuntimeError:
                return [dict(profile) for profile in RELIABLE]
            own = [one for one in offered if bytes(one.endpoint_gid) == publisher]
            self._profiles[topic] = [qos_fields(one.qos_profile) for one in own or offered]
        return self._profiles[topic]


def _record(node: Node) -> int:
    executables.end_in_order()  # An open bag must be closed properly.
    recorder = Recorder(node)
    failure: OSError | RecordingError | None = None
    try:
        node.get_logger().info(f"recording to {recorder.bag.directory}")
        recorder.spin()
    except (OSError, RecordingError) as error:
        failure = error
    except ExternalShutdownException:
        pass
    try:
        if not isinstance(failure, OSError):
            summary = recorder.close(drain=failure is None)
            sys.stdout.write(summary + "\n")
            sys.stdout.flush()
    except (OSError, RecordingError) as error:
        failure = failure or error
    if failure is None:
        return 0
    recorder.bag.abandon()
    reason = str(failure) if isinstance(failure, RecordingError) else (
        f"{recorder.bag.file.path} cannot be written: {failure.strerror}")
    sys.stderr.write(f"recorder: {one_line(reason)}; the data written so far stays readable\n")
    return 1


def main() -> int:
    """Run the recorder node."""
    return run_node(lambda: rclpy.create_node("recorder"), _record)
