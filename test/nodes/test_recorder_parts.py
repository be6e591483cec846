"""The recorder node over a long time: parts, publishers that come and go, and bounded memory."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.executors import ExternalShutdownException
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from test_recorder import SCENE, STATES, TICK, joint_state, publisher_of, start
from test_recorder import context as context
from waiting import until

from tcc_sim.errors import RecordingError
from tcc_sim.messages import cdr
from tcc_sim.nodes import recorder
from tcc_sim.nodes.middleware import COMMANDS, LATCHED, poll, subscribe
from tcc_sim.nodes.track import MOST_PUBLISHERS, Track, UnsentCount, unsent_message
from tcc_sim.recording.reader import open_run
from tcc_sim.recording.stamps import StampCounter
from tcc_sim.topics import JOINT_STATE


def publish(result, publisher, numbers):
    """Publish states and wait until the recorder has them."""
    before = result.tracks["/joint_states"].messages
    for n in numbers:
        publisher.publish(joint_state(n))
    until(lambda: result.tracks["/joint_states"].messages == before + len(numbers), step=result.drain)


def test_a_recording_in_parts_has_the_scene_and_figures_of_its_own_in_each(context, tmp_path):
    result = start(context, tmp_path / "run", max_bag_size=20_000, topics=["joint_states", "scene"])
    node = rclpy.create_node("driveline", context=context)
    node.create_publisher(String, "scene", LATCHED).publish(String(data=SCENE))
    publisher = publisher_of(node, "joint_states")
    until(lambda: result.bag.scene_text == SCENE, step=result.drain)
    for n in range(0, 2000, 200):
        publish(result, publisher, range(n, n + 200))
        result.bag.file.flush()
    result.unsent.add(b"driveline", unsent_message("driveline", {"/joint_states": 3}))
    assert "2001 messages" in (said := result.close())
    assert said.endswith("0 lost, 3 never sent")
    parts = sorted((tmp_path / "run").glob("*.mcap"), key=lambda path: int(path.stem.rpartition("_")[2]))
    assert len(parts) > 2
    stamps, counted = [], 0
    for path in parts:
        run = open_run(path)
        stamps += np.concatenate([batch.stamp_ns for batch in run.states()]).tolist()
        assert (run.scene_text, run.complete) == (SCENE, True)
        counted += run.result["messages"]["/joint_states"]
    assert stamps == [n * TICK for n in range(2000)]
    whole = open_run(tmp_path / "run")
    assert sum(map(len, whole.states())) == counted == whole.result["messages"]["/joint_states"] == 2000
    assert (whole.result["lost"], whole.result["unsent"]) == ({"/joint_states": 0, "/scene": 0}, {"/joint_states": 3})


def test_what_was_not_sent_is_counted_for_more_drivelines_than_are_told_apart():
    """Counts of forgotten drivelines stay in the sum."""
    count = UnsentCount(most=2)
    for name, said in (("a", 1), ("b", 10), ("a", 2), ("c", 100), ("d", 1000), ("a", 3)):
        count.add(name.encode(), unsent_message(name, {"/joint_states": said}))
    assert count.by_topic() == {"/joint_states": 2 + 10 + 100 + 1000 + 3}


def test_every_publisher_has_a_channel_of_its_own(context, tmp_path):
    result = start(context, tmp_path / "run", topics=["joint_states"])
    for name in ("first", "second"):
        node = rclpy.create_node(name, context=context)
        publisher = publisher_of(node, "joint_states")
        until(lambda p=publisher: p.get_subscription_count() == 1)
        # The stamps of the second publisher continue those of the first.
        publish(result, publisher, range(50) if name == "first" else range(50, 100))
        node.destroy_node()
    result.close()
    run = open_run(tmp_path / "run")
    assert sum(map(len, run.states())) == 100
    assert (run.stamps.restarts, run.stamps.resets, run.messages) == (1, 0, {"/joint_states": 100})


def test_what_the_recorder_keeps_of_publishers_and_scenes_is_bounded(context, tmp_path):
    """Every state has another publisher."""
    result = start(context, tmp_path / "run", topics=["joint_states", "scene"])
    for n in range(MOST_PUBLISHERS + 20):
        said = {"publication_sequence_number": 1, "publisher_gid": {"data": n.to_bytes(16, "big")},
                "received_timestamp": n + 1, "source_timestamp": n + 1}
        result.write(result.tracks["/joint_states"], [(joint_state(n), said)])
        if n % 25 == 0:
            result.write(result.tracks["/scene"], [(cdr.string(SCENE + f"# {n}\n"), said)])
    assert len(result.tracks["/joint_states"].channels) == MOST_PUBLISHERS + 1
    assert result.bag.scene_text == SCENE + "# 1000\n"
    result.close()
    run = open_run(tmp_path / "run")
    assert (sum(map(len, run.states())), len(run.scenes)) == (MOST_PUBLISHERS + 20, 41)


def test_a_publisher_is_forgotten_after_a_thousand_others(context):
    """Its later losses are not counted, and it is asked again like a new one."""
    for others, lost in ((MOST_PUBLISHERS - 1, 3), (MOST_PUBLISHERS, 0)):
        track = Track(rclpy.create_node("recorder", context=context), "/scene", "std_msgs/msg/String")
        for n, number in [(0, 1), *((n, 1) for n in range(1, others + 1)), (0, 5)]:
            track.count(n.to_bytes(16, "big"), number)
        assert track.lost == lost
        track = Track(rclpy.create_node("recorder", context=context), "/scene", "std_msgs/msg/String")
        assert [track.asks_again([b"silent"]) for _ in range(21)] == [True] * 20 + [False]
        for n in range(others + 1):
            track.asks_again([n.to_bytes(16, "big")])
        assert track.asks_again([b"silent"]) is (lost == 0)


@pytest.mark.parametrize(("fsync_period", "synced"), [(1.0, [7, 14, 21]), (0.0, [])])
def test_periods_of_flushes_synchronisations_and_looks_are_kept(monkeypatch, fsync_period, synced):
    """Each drain takes 1/32 s of 1/8 s."""
    result, now, done, waited = recorder.Recorder.__new__(recorder.Recorder), [100.0], [], []
    monkeypatch.setattr(recorder.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(recorder.signals, "end_requested", SimpleNamespace(is_set=lambda: len(waited) >= 44))

    def does(what, seconds=0.0):
        def do():
            done.append((what, len(waited) // 2))
            now[0] += seconds
        return do

    def once(left):
        waited.append(left)
        now[0] += left if len(waited) % 2 == 0 else left - 0.03125

    for name, value in {"drain": does("drain", 0.03125), "look": does("look"), "next_look": 0.0, "drain_period": 0.125,
                        "flush_period": 0.5, "fsync_period": fsync_period, "_spinner": SimpleNamespace(once=once),
                        "bag": SimpleNamespace(check=does("check"), file=SimpleNamespace(flush=does("flush"),
                                                                                         sync=does("sync")))}.items():
        setattr(result, name, value)
    result.spin()
    assert waited == [0.09375, 0.03125] * 22
    assert {what: [turn for one, turn in done if one == what] for what, _ in done} == {
        "drain": [*range(22)], "flush": [*range(0, 22, 3)], "look": [*range(0, 22, 2)], "check": [*range(0, 22, 2)]} | (
            {"sync": synced} if synced else {})


def test_messages_are_written_with_their_times_and_numbers_and_counted(monkeypatch):
    """Some middleware gives neither number nor publisher, and some no times."""
    result, written, scenes = recorder.Recorder.__new__(recorder.Recorder), [], []
    monkeypatch.setattr(recorder.time, "time_ns", lambda: 999)
    monkeypatch.setattr(recorder.time, "monotonic", lambda: 7.5)
    track = SimpleNamespace(topic="/scene", type=recorder.STRING, latched=True, messages=0, arrived=0.0, stamps=None,
                            channels={b"\1": 4}, lost=0, count=lambda who, number: counts.append((who, number)))
    counts = []
    for name, value in {"_simulated": None, "_clock": "/clock", "_scene_topics": {"/scene"}, "next_look": 5.0,
                        "_unsent_topic": "/unsent", "unsent": UnsentCount(), "tracks": {"/scene": track},
                        "_describe": lambda data, sent_ns: scenes.append((data, sent_ns)),
                        "_channel": lambda track, who: 9, "bag": SimpleNamespace(
                            write=lambda *row: written.append(row))}.items():
        setattr(result, name, value)

    def info(number, received, sent, who=1):
        return {"publication_sequence_number": number, "received_timestamp": received, "source_timestamp": sent,
                "publisher_gid": {"data": [who]} if who else None}

    result.write(track, [])
    result.write(track, [(b"a", info(None, 50, 40)), (b"b", info(3, 51, 0)), (b"c", info(4, 0, 0, 0)),
                         (b"d", info(0, 0, 41, 2))])
    assert written == [(4, 50, 40, b"a", 0, True), (4, 51, 0, b"b", 3, True), (9, 999, 0, b"c", 4, True),
                       (9, 999, 41, b"d", 0, True)]
    assert (counts, scenes) == ([(b"\1", 3)], [(b"a", 40), (b"b", 51), (b"c", 999), (b"d", 41)])
    assert (track.messages, track.arrived, result.next_look, result.unsent.by_topic()) == (4, 7.5, 5.0, {})
    track.topic, track.type = "/unsent", "diagnostic_msgs/msg/DiagnosticStatus"
    result.write(track, [(unsent_message("a", {"/x": n}), info(n, 1, 1, n % 2)) for n in (2, 3)])
    assert result.unsent.by_topic() == {"/x": 3}
    track.topic, track.type = "/joint_states", JOINT_STATE
    result.write(track, [(joint_state(0), info(1, 1, 1))])
    assert (result.next_look, track.messages, len(scenes)) == (5.0, 7, 4)
    track.messages = 0
    result.write(track, [(joint_state(0), info(1, 1, 1))])
    assert result.next_look == 0.0
    seen = {"/a": (5, 1, StampCounter()), "/b": (0, 0, None), "/c": (2, 0, None)}
    result.tracks = {name: SimpleNamespace(topic=name, messages=messages, lost=lost, stamps=stamps)
                     for name, (messages, lost, stamps) in seen.items()}
    result._reported, result.drain = {}, lambda last: written.append(last)
    assert result._part_result() == {"messages": {"/a": 5, "/c": 2}, "lost": {"/a": 1, "/c": 0},
                                     "missing_stamps": {"/a": 0}, "unsent": {"/x": 3}}
    result.tracks["/a"].messages, result.tracks["/a"].lost = 7, 4
    closed = []
    result.bag = SimpleNamespace(close=closed.append, directory=Path("a/run"))
    assert result.close() == "recorded 9 messages in a/run, 4 lost, 3 never sent"
    assert (written[-1], closed) == (True, [{"messages": {"/a": 2, "/c": 0}, "lost": {"/a": 3, "/c": 0},
                                             "missing_stamps": {"/a": 0}, "unsent": {"/x": 0}}])
    result.unsent, result.tracks["/a"].messages = UnsentCount(), 1
    del result.tracks["/c"], written[-1]
    assert result.close(drain=False) == "recorded 1 message in a/run, 4 lost"
    assert written[-1] is not True


FULL, MOVED = OSError(28, "No space left on device"), RecordingError("a was\nmoved")
UNWRITTEN = "a/b.mcap cannot be written: No space left on device"


@pytest.mark.parametrize(("spun", "closed", "drains", "out", "said"), [
    (ExternalShutdownException(), None, True, "summary\n", ""), (None, None, True, "summary\n", ""),
    (MOVED, None, False, "summary\n", r"a was\nmoved"), (FULL, None, None, "", UNWRITTEN),
    (None, FULL, True, "", UNWRITTEN), (MOVED, RecordingError("closed"), False, "", r"a was\nmoved")])
def test_how_a_recording_ends(monkeypatch, capsys, spun, closed, drains, out, said):
    asked, logged = [], []

    def does(what, error):
        def do(**given):
            asked.append((what, *given.values()))
            if error is not None:
                raise error
            return "summary"
        return do

    bag = SimpleNamespace(directory="a", file=SimpleNamespace(path="a/b.mcap"), abandon=does("abandon", None))
    monkeypatch.setattr(recorder, "Recorder", lambda node: SimpleNamespace(
        bag=bag, spin=does("spin", spun), close=does("close", closed)))
    monkeypatch.setattr(recorder, "log", lambda node, sentence: logged.append(sentence))
    assert recorder._record(None) == bool(said)
    assert logged == ["recording to a"]
    assert asked == [("spin",)] + [("close", drains)] * (drains is not None) + [("abandon",)] * bool(said)
    assert capsys.readouterr() == (out, f"recorder: {said}; the data written so far stays readable\n" if said else "")


def test_publishers_that_go_and_topics_that_cannot_be_recorded_are_named(context, tmp_path, monkeypatch):
    result = start(context, tmp_path / "run", topics=["joint_states", "scene", "/elsewhere", "/nowhere"])
    warned, offered, types = [], {}, {"/elsewhere": ["none_msgs/msg/None"]}
    monkeypatch.setattr(recorder, "warn", lambda node, sentence: warned.append(sentence))
    monkeypatch.setattr(result.node, "get_publishers_info_by_topic", lambda name: offered.get(name, []))
    monkeypatch.setattr(result.node, "get_topic_names_and_types", lambda: list(types.items()))

    def publishers(*numbers):
        offered["/joint_states"] = [SimpleNamespace(endpoint_gid=[n], qos_profile=STATES) for n in numbers]

    # Later parts do not repeat the scene of a publisher that is gone.
    unlatched, offered["/scene"] = [], [SimpleNamespace(endpoint_gid=[2], qos_profile=LATCHED)]
    result.tracks["/scene"].channels, result.tracks["/joint_states"].channels = {b"\1": 3, b"\2": 4}, {b"\1": 9}
    monkeypatch.setattr(result.bag, "unlatch", unlatched.append)
    for numbers in ((1, 2), (1, 2, 3), (2, 3), (), (4,)):
        publishers(*numbers)
        result.look()
    (first, *gone), result._simulated = warned, object()
    assert first.startswith("/elsewhere is not recorded: ")
    assert gone == ["the publisher of /joint_states is gone; 2 left; the recording continues",
                    "the publisher of /joint_states is gone; the recording continues"]
    assert (list(result.tracks), result._unknown, unlatched) == (["/scene", "/joint_states"], ["/nowhere"], [3] * 5)
    result._simulated = None
    assert "recorded 0 messages" in result.close()


def test_counts_that_are_no_numbers_or_too_many_are_left_out():
    count = UnsentCount()
    count.add(b"a", b"no message")
    count.add(b"a", serialize_message(DiagnosticStatus(values=[
        KeyValue(key=f"/{n}", value=value) for n, value in enumerate(
            ("1", "-1", "x", "", "9" * 18, "9" * 19, "²", *["1"] * 100))])))
    assert count.by_topic() == {"/0": 1, "/4": 10**18 - 1, **{f"/{n}": 1 for n in range(7, 100)}}


@pytest.mark.parametrize("most", [1, 3, 7])
def test_no_more_is_taken_than_asked_for_and_the_rest_waits(context, most):
    """In lock-step a command that is polled together with the one before would be lost."""
    node = rclpy.create_node("listener", context=context)
    subscription = subscribe(node, String, "words", COMMANDS)
    publisher = node.create_publisher(String, "words", COMMANDS)
    until(publisher.get_subscription_count)
    heard = []
    for n in range(5):
        publisher.publish(cdr.string(str(n)))
    while len(heard) < 5:
        taken = poll(subscription, most=most)
        assert len(taken) <= most
        heard += [cdr.read_string(data) for data, _ in taken]
    assert heard == list("01234")


def test_what_comes_reliably_once_is_not_taken_from_best_effort_later(monkeypatch: pytest.MonkeyPatch) -> None:
    waiting: dict[str, list[bytes]] = {"reliable": [], "best effort": []}

    def poll_once(subscription: str) -> list[tuple[bytes, dict[str, object]]]:
        taken, waiting[subscription] = waiting[subscription], []
        return [(each, {"publisher_gid": {"data": each[:2]}}) for each in taken]

    monkeypatch.setattr("tcc_sim.nodes.track.poll", poll_once)
    track = Track.__new__(Track)
    track.subscription, track._best_effort, track._heard_reliably = "reliable", "best effort", set()  # type: ignore

    def taken(reliable: list[bytes], best_effort: list[bytes]) -> list[bytes]:
        waiting.update({"reliable": reliable, "best effort": best_effort})
        return [data for data, _ in track.take()]

    assert taken([b"a 1"], [b"a 1", b"b 1"]) == [b"a 1", b"b 1"]
    assert taken([], [b"a 2", b"b 2"]) == [b"b 2"]
    waiting["reliable"] = [k.to_bytes(2, "big") for k in range(MOST_PUBLISHERS - 1)]
    assert len(track.take()) == MOST_PUBLISHERS - 1
    assert taken([], [b"a 3"]) == []
    assert taken([b"z"], []) == [b"z"]  # One more than are kept: all are forgotten.
    assert taken([], [b"a 4"]) == [b"a 4"]
