"""The recorder node: its files, refusals and ends."""

import numpy as np
import pytest
from benches import overrides

pytest.importorskip("rclpy")

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from waiting import until

from tcc_sim.messages import cdr
from tcc_sim.nodes import recorder
from tcc_sim.nodes.middleware import CHANGES, LATCHED, message_class, states
from tcc_sim.nodes.track import unsent_message
from tcc_sim.recording.reader import Run
from tcc_sim.topics import JOINT_STATE, TOPICS, topic

TICK = 1_000_000
STATES = states(1000)
SCENE = "/**:\n  ros__parameters:\n    rate: 1000.0\n"


@pytest.fixture
def context(bench):
    """A context that sees only itself."""
    return bench.context


def start(context, output, **parameters):
    """A recorder that the test drives by hand."""
    return recorder.Recorder(rclpy.create_node("recorder", context=context, parameter_overrides=overrides(
        {"output": str(output), **parameters})))


def joint_state(n):
    return cdr.joint_state(n * TICK, n, 2.0 * n, 3.0, 4.0, 5.0, 6.0)


def publisher_of(node, name, profile=STATES):
    return node.create_publisher(message_class(topic(name).type), name, LATCHED if topic(name).latched else profile)


def test_every_topic_of_the_table_is_recorded_in_the_namespace_of_the_node(context, tmp_path):
    result = start(context, tmp_path / "run", flush_period=1)
    node = rclpy.create_node("driveline", context=context)
    publishers = {row.name: publisher_of(node, row.name) for row in TOPICS}
    message = {"std_msgs/msg/Float64": cdr.float64(1.0), "std_msgs/msg/Int8": cdr.int8(1), JOINT_STATE: joint_state(1),
               "sensor_msgs/msg/FluidPressure": cdr.fluid_pressure(TICK, 1e5), "rosgraph_msgs/msg/Clock": cdr.clock(1),
               "std_msgs/msg/String": cdr.string(SCENE)}
    for row in TOPICS:
        publishers[row.name].publish(message.get(row.type) or message_class(row.type)())
    until(lambda: sum(track.messages for track in result.tracks.values()) == len(TOPICS), step=result.drain)
    assert f"{len(TOPICS)} messages" in result.close()
    run = Run(tmp_path / "run")
    assert run.topics == {node.resolve_topic_name(row.name): row.type for row in TOPICS}
    assert sum(map(len, run.columns().runs)) == 1
    assert run.scene_text == SCENE
    assert run.result["lost"] == dict.fromkeys(run.topics, 0)


def test_a_burst_is_recorded_whole_with_times_and_numbers(context, tmp_path):
    result = start(context, tmp_path / "run", topics=["joint_states"])
    node = rclpy.create_node("driveline", context=context)
    publisher = publisher_of(node, "joint_states")
    for n in range(5000):
        publisher.publish(joint_state(n))
    until(lambda: result.tracks["/joint_states"].messages == 5000, step=result.drain)
    result.look()
    result.close()
    run = Run(tmp_path / "run")
    batches = list(run.columns().runs)
    assert np.concatenate([batch.stamp_ns for batch in batches]).tolist() == [n * TICK for n in range(5000)]
    assert (np.diff(np.concatenate([batch.log_ns for batch in batches])) >= 0).all()
    assert (run.complete, run.stamps.lost, run.result["lost"], run.result["missing_stamps"]) == (
        True, 0, {"/joint_states": 0}, {"/joint_states": 0})


def test_the_offered_quality_of_service_stands_in_the_bag_and_best_effort_is_received(context, tmp_path):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    result = start(context, tmp_path / "run", topics=["joint_states", "slip_speed"])
    node = rclpy.create_node("driveline", context=context)
    publisher = publisher_of(node, "joint_states", QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT))
    slip = publisher_of(node, "slip_speed")
    result.look()
    until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(joint_state(0))
    slip.publish(cdr.float64(1.0))
    until(lambda: sum(track.messages for track in result.tracks.values()) == 2, step=result.drain)
    result.close()
    with rosbag2.Reader(tmp_path / "run") as reader:
        offered = {c.topic: c.ext.offered_qos_profiles[0].reliability.name for c in reader.connections}
    assert offered == {"/joint_states": "BEST_EFFORT", "/slip_speed": "RELIABLE"}


def test_a_best_effort_publisher_comes_and_goes_and_the_reliable_one_loses_nothing(context, tmp_path):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    result = start(context, tmp_path / "run", topics=["slip_speed"])
    track = result.tracks["/slip_speed"]
    publisher = publisher_of(rclpy.create_node("driveline", context=context), "slip_speed")
    other = rclpy.create_node("other", context=context)
    until(publisher.get_subscription_count)
    numbers = iter(range(900))

    def send(count):
        for _ in range(count):
            publisher.publish(cdr.float64(next(numbers)))

    def publishers():
        return len(result.node.get_publishers_info_by_topic("slip_speed"))

    for turn in range(3):
        send(100)
        guest = publisher_of(other, "slip_speed", QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT))
        until(lambda: publishers() == 2)
        send(100)
        result.look()
        until(guest.get_subscription_count)
        send(100)
        guest.publish(cdr.float64(-1.0 - turn))
        until(lambda turn=turn: track.messages == 301 * (turn + 1), step=result.drain)
        other.destroy_publisher(guest)
        until(lambda: publishers() == 1)
        result.look()
    assert result.close() == f"recorded 903 messages in {tmp_path / 'run'}, 0 lost"
    with rosbag2.Reader(tmp_path / "run") as reader:
        values = [cdr.read_float64(data) for _, _, data in reader.messages()]
    assert [value for value in values if value >= 0.0] == list(range(900))
    assert sorted(value for value in values if value < 0.0) == [-3.0, -2.0, -1.0]


def test_a_silent_latched_publisher_lets_no_message_of_another_be_recorded_twice(context, tmp_path):
    result = start(context, tmp_path / "run", topics=["held", "joint_states"])
    driveline, silent = (rclpy.create_node(name, context=context) for name in ("driveline", "silent"))
    kind = message_class(topic("held").type)
    held, _ = (node.create_publisher(kind, "held", CHANGES) for node in (driveline, silent))
    publish(result, publisher_of(driveline, "joint_states"), range(2))
    for turn in range(3):
        for _ in range(10):
            held.publish(kind())
        until(lambda turn=turn: result.tracks["/held"].messages == 10 * (turn + 1), step=result.drain)
        result.look()
    assert result.close() == f"recorded 32 messages in {tmp_path / 'run'}, 0 lost"


def test_two_topics_of_other_types_remapped_onto_one_are_refused(entered, tmp_path):
    output = f"output:={tmp_path / 'run'}"
    for node, remapped, parts in (
            ("recorder", "slip_speed:=joint_states", ["slip_speed", "/joint_states", "Float64", "JointState"]),
            ("recorder", "joint_states:=scene", ["joint_states", "/scene", "JointState", "String"]),
            ("driveline", "slip_speed:=joint_states", ["incompatible type"])):
        status, out, said = entered(node, "--ros-args", "-r", remapped, "-p",
                                    output if node == "recorder" else "scene:=minimal")
        assert (status, out, said.count("\n")) == (2, "", 1)
        assert [part for part in parts if part not in said] == []
    assert list(tmp_path.iterdir()) == []


def test_a_topic_outside_the_table_is_recorded_by_its_type_once_it_is_there(context, tmp_path):
    result = start(context, tmp_path / "run", topics=["/elsewhere"])
    assert result.tracks == {}
    node = rclpy.create_node("other", context=context)
    publisher = node.create_publisher(message_class("std_msgs/msg/Int8"), "/elsewhere", 10)
    result.look()
    publisher.publish(cdr.int8(4))
    until(lambda: result.tracks["/elsewhere"].messages == 1, step=result.drain)
    result.close()
    assert Run(tmp_path / "run").topics == {"/elsewhere": "std_msgs/msg/Int8"}


def publish(result, publisher, numbers):
    """Publish states and wait until the recorder has them."""
    before = result.tracks["/joint_states"].messages
    for n in numbers:
        publisher.publish(joint_state(n))
    until(lambda: result.tracks["/joint_states"].messages == before + len(numbers), step=result.drain)


def test_a_recording_in_parts_has_the_scene_and_figures_of_its_own_in_each(context, tmp_path):
    result = start(context, tmp_path / "run", max_bag_size=20_000, topics=["joint_states", "scene"])
    node = rclpy.create_node("driveline", context=context)
    publisher_of(node, "scene").publish(String(data=SCENE))
    publisher = publisher_of(node, "joint_states")
    until(lambda: result.tracks["/scene"].messages, step=result.drain)
    for n in range(0, 2000, 200):
        publish(result, publisher, range(n, n + 200))
        result.bag.file.flush()
    result.unsent.add(b"driveline", unsent_message("driveline", {"/joint_states": 3}))
    assert "2001 messages" in (summary := result.close())
    assert "0 lost, 3 never sent" in summary
    parts = sorted((tmp_path / "run").glob("*.mcap"), key=lambda path: int(path.stem.rpartition("_")[2]))
    assert len(parts) > 2
    stamps, counted = [], 0
    for path in parts:
        run = Run(path)
        stamps += np.concatenate([batch.stamp_ns for batch in run.columns().runs]).tolist()
        assert (run.scene_text, run.complete) == (SCENE, True)
        counted += run.result["messages"]["/joint_states"]
    assert stamps == [n * TICK for n in range(2000)]
    whole = Run(tmp_path / "run")
    assert sum(map(len, whole.columns().runs)) == counted == whole.result["messages"]["/joint_states"] == 2000
    assert (whole.result["lost"], whole.result["unsent"]) == ({"/joint_states": 0, "/scene": 0}, {"/joint_states": 3})


def test_every_publisher_has_a_channel_of_its_own_and_one_that_goes_is_named(context, tmp_path, capfd):
    result = start(context, tmp_path / "run", topics=["joint_states"])
    for name in ("first", "second"):
        node = rclpy.create_node(name, context=context)
        publisher = publisher_of(node, "joint_states")
        until(lambda p=publisher: p.get_subscription_count() == 1)
        # The stamps of the second publisher continue those of the first.
        publish(result, publisher, range(50) if name == "first" else range(50, 100))
        result.look()
        node.destroy_node()
        until(lambda: not result.node.get_publishers_info_by_topic("joint_states"))
        result.look()
    assert capfd.readouterr().err.count("the publisher of /joint_states is gone") == 2
    result.close()
    runs = [Run(tmp_path / "run", driveline=k) for k in (0, 1)]
    assert sorted(stamp for run in runs for batch in run.columns().runs for stamp in batch.stamp_ns.tolist()) == [
        n * TICK for n in range(100)]
    assert [run.messages for run in runs] == [{"/joint_states": 100}] * 2
