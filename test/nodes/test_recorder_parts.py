"""The recorder node over a long time: parts, publishers that come and go, and bounded memory."""


import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from std_msgs.msg import String
from test_recorder import SCENE, TICK, joint_state, publisher_of, start
from test_recorder import context as context
from waiting import until

from tcc_sim.messages import cdr
from tcc_sim.nodes.middleware import COMMANDS, LATCHED, poll, subscribe
from tcc_sim.nodes.track import MOST_PUBLISHERS, Track, UnsentCount, unsent_message
from tcc_sim.recording.reader import open_run


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


class Enough(Exception):
    """`sync` was called often enough."""


def test_a_period_of_synchronisation_is_kept(context, tmp_path, monkeypatch):
    result = start(context, tmp_path / "run", fsync_period=0.2)
    synced = []

    def sync():
        synced.append(1)
        if len(synced) == 4:
            raise Enough

    monkeypatch.setattr(result.bag.file, "sync", sync)
    with pytest.raises(Enough):
        result.spin()
    result.close()


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
