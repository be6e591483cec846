"""The recorder node: what it writes, what it refuses, and how it ends."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from tcc_sim.errors import InputError, RecordingError
from tcc_sim.nodes import polling, recorder
from tcc_sim.nodes.messages import message_class, qos_fields
from tcc_sim.recording import cdr
from tcc_sim.recording.reader import open_run
from tcc_sim.topics import JOINT_STATE, TOPICS, topic

TICK = 1_000_000
STATES = polling.states(1000)
SCENE = "/**:\n  ros__parameters:\n    rate: 1000.0\n"


@pytest.fixture
def context(monkeypatch):
    """A context that sees only itself."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    found = Context()
    rclpy.init(context=found, args=[])
    yield found
    rclpy.shutdown(context=found)


def start(context, output, **parameters):
    """A recorder that the test drives by hand."""
    overrides = [Parameter(name, value=value) for name, value in {"output": str(output), **parameters}.items()]
    return recorder.Recorder(rclpy.create_node("recorder", context=context, parameter_overrides=overrides))


def joint_state(n):
    return cdr.joint_state(n * TICK, n, 2.0 * n, 3.0, 4.0, 5.0, 6.0)


def until(predicate, *, step=lambda: None, limit=20.0):
    """Repeat `step` until the predicate holds."""
    end = time.monotonic() + limit
    while not predicate():
        assert time.monotonic() < end, "it took too long"
        step()


def publisher_of(node, name, qos=STATES):
    return node.create_publisher(message_class(topic(name).type), name, polling.LATCHED if topic(name).latched else qos)


def test_every_topic_of_the_table_is_recorded_in_the_namespace_of_the_node(context, tmp_path):
    found = start(context, tmp_path / "run", flush_period=1)
    node = rclpy.create_node("driveline", context=context)
    publishers = {row.name: publisher_of(node, row.name) for row in TOPICS}
    message = {"std_msgs/msg/Float64": cdr.float64(1.0), "std_msgs/msg/Int8": cdr.int8(1), JOINT_STATE: joint_state(1),
               "sensor_msgs/msg/FluidPressure": cdr.fluid_pressure(TICK, 1e5), "rosgraph_msgs/msg/Clock": cdr.clock(1),
               "std_msgs/msg/String": cdr.string(SCENE)}
    for row in TOPICS:
        publishers[row.name].publish(message.get(row.type) or message_class(row.type)())
    until(lambda: sum(track.messages for track in found.tracks.values()) == len(TOPICS), step=found.drain)
    assert f"{len(TOPICS)} messages" in found.close()
    run = open_run(tmp_path / "run")
    assert run.topics == {node.resolve_topic_name(row.name): row.type for row in TOPICS}
    assert sum(map(len, run.batches())) == 1
    assert run.scene_text == SCENE
    assert run.result["lost"] == dict.fromkeys(run.topics, 0)


def test_a_burst_is_recorded_whole_with_times_and_numbers(context, tmp_path):
    found = start(context, tmp_path / "run", topics=["joint_states"])
    node = rclpy.create_node("driveline", context=context)
    publisher = publisher_of(node, "joint_states")
    for n in range(5000):
        publisher.publish(joint_state(n))
    until(lambda: found.tracks["/joint_states"].messages == 5000, step=found.drain)
    found.look()
    found.close()
    run = open_run(tmp_path / "run")
    batches = list(run.batches())
    assert np.concatenate([batch.stamp_ns for batch in batches]).tolist() == [n * TICK for n in range(5000)]
    assert (np.diff(np.concatenate([batch.log_ns for batch in batches])) >= 0).all()
    assert (run.complete, run.lost_messages, run.result["lost"], run.result["missing_stamps"]) == (
        True, 0, {"/joint_states": 0}, {"/joint_states": 0})


def test_the_offered_quality_of_service_stands_in_the_bag_and_best_effort_is_received(context, tmp_path):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    found = start(context, tmp_path / "run", topics=["joint_states", "slip_speed"])
    node = rclpy.create_node("driveline", context=context)
    publisher = publisher_of(node, "joint_states", QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT))
    slip = publisher_of(node, "slip_speed")
    found.look()
    until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(joint_state(0))
    slip.publish(cdr.float64(1.0))
    until(lambda: sum(track.messages for track in found.tracks.values()) == 2, step=found.drain)
    found.close()
    with rosbag2.Reader(tmp_path / "run") as reader:
        offered = {c.topic: c.ext.offered_qos_profiles[0].reliability.name for c in reader.connections}
    assert offered == {"/joint_states": "BEST_EFFORT", "/slip_speed": "RELIABLE"}
    assert qos_fields(STATES)["deadline"] == {"sec": 9223372036, "nsec": 854775807}


def test_a_topic_outside_the_table_is_recorded_by_its_type_once_it_is_there(context, tmp_path):
    found = start(context, tmp_path / "run", topics=["/elsewhere"])
    assert found.tracks == {}
    node = rclpy.create_node("other", context=context)
    publisher = node.create_publisher(message_class("std_msgs/msg/Int8"), "/elsewhere", 10)
    found.look()
    publisher.publish(cdr.int8(4))
    until(lambda: found.tracks["/elsewhere"].messages == 1, step=found.drain)
    found.close()
    assert open_run(tmp_path / "run").topics == {"/elsewhere": "std_msgs/msg/Int8"}


def test_the_scene_of_every_driveline_that_appears_is_recorded(context, tmp_path):
    found = start(context, tmp_path / "run")
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(found.node)

    def step():
        executor.spin_once(timeout_sec=0.01)
        found.drain()
        found.look()

    for number in (1, 2):
        node = rclpy.create_node("driveline", context=context)
        node.create_publisher(String, "scene", polling.LATCHED).publish(String(data=SCENE + f"# {number}\n"))
        executor.add_node(node)
        publisher = publisher_of(node, "joint_states")
        until(lambda n=number: len(found.bag.scenes) == n, step=step)
        before = found.tracks["/joint_states"].messages
        for n in range(5):
            publisher.publish(joint_state(n))
        until(lambda b=before: found.tracks["/joint_states"].messages == b + 5, step=step)
        executor.remove_node(node)
        node.destroy_node()
        found.look()
    found.close()
    run = open_run(tmp_path / "run")
    assert [scene.text for scene in run.scenes] == [SCENE + "# 1\n", SCENE + "# 2\n"]
    assert sorted({batch.run for batch in run.batches()}) == [0, 1]


def test_messages_that_a_publisher_counted_and_nobody_received_are_counted_as_lost():
    track = recorder.Track("/joint_states", JOINT_STATE)
    for publisher, number in [(b"a", 7), (b"b", 1), (b"a", 8), (b"a", 11), (b"b", 2), (b"b", 4), (b"a", 12)]:
        track.count(publisher, number)
    assert track.lost == 3


@pytest.mark.parametrize("parameters", [{"flush_period": 0.0}, {"flush_period": "soon"}, {"flush_period": float("nan")},
                                        {"flush_period": True}, {"topics": [""]}, {"topics": 3}])
def test_wrong_parameters_are_refused_and_nothing_is_written(context, tmp_path, parameters):
    with pytest.raises(InputError, match=next(iter(parameters))):
        start(context, tmp_path / "run", **parameters)
    assert list(tmp_path.iterdir()) == []


def test_an_existing_output_is_refused(context, tmp_path):
    with pytest.raises(RecordingError, match="exists already"):
        start(context, tmp_path)


@pytest.fixture
def process(tmp_path, monkeypatch):
    """A recorder in a process of its own, a publisher that it subscribes to, and the bag's directory."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(5 + os.getpid() % 90))
    context = Context()
    rclpy.init(context=context, args=[])
    node = rclpy.create_node("driveline", context=context)
    publisher = publisher_of(node, "joint_states")
    output = tmp_path / "run"
    child = subprocess.Popen([sys.executable, "-m", "tcc_sim.nodes.recorder", "--ros-args", "-p", f"output:={output}"],
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        # The bag comes after the subscriptions: a signal before it is there ends the recorder with nothing recorded.
        until(lambda: (publisher.get_subscription_count() == 1 and any(output.glob("*.mcap"))) or child.poll() is not None)
        yield child, publisher, output
    finally:
        child.kill()
        child.communicate()
        rclpy.shutdown(context=context)


def readable(output):
    """How many joint_states can be read now."""
    try:
        return sum(map(len, open_run(output).batches()))
    except RecordingError:
        return 0


def send_until_known(publisher, output):
    """Send states until the recorder has one, which may be a moment after the publisher knows it; gives the next number."""
    numbers = iter(range(10**9))

    def send():
        publisher.publish(joint_state(next(numbers)))
        # One at a time: the publisher keeps the last 1000 only.
        publisher.wait_for_all_acked(Duration(seconds=0.1))

    until(lambda: readable(output) > 0, step=send)
    return next(numbers)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_a_complete_bag_and_status_0(process, number):
    child, publisher, output = process
    known = send_until_known(publisher, output)
    for n in range(known, known + 700):
        publisher.publish(joint_state(n))
    publisher.wait_for_all_acked()
    child.send_signal(number)
    out, err = child.communicate(timeout=20)
    assert child.returncode == 0, err
    assert "Traceback" not in err
    run = open_run(output)
    stamps = np.concatenate([batch.stamp_ns for batch in run.batches()])
    assert len(stamps) > 700
    assert stamps.tolist() == [n * TICK for n in range(known + 700 - len(stamps), known + 700)]
    assert out == f"recorded {len(stamps)} messages in {output}, 0 lost\n"
    assert run.complete
    assert (output / "metadata.yaml").exists()


def test_after_a_kill_everything_up_to_the_last_flush_is_there(process):
    child, publisher, output = process
    known = send_until_known(publisher, output)
    for n in range(known, known + 700):
        publisher.publish(joint_state(n))
    until(lambda: readable(output) > 700)
    flushed = readable(output)
    for n in range(known + 700, known + 900):
        publisher.publish(joint_state(n))
    child.kill()
    child.communicate()
    run = open_run(output)
    stamps = np.concatenate([batch.stamp_ns for batch in run.batches()])
    first = int(stamps[0]) // TICK
    assert stamps.tolist() == [n * TICK for n in range(first, first + len(stamps))]
    assert len(stamps) >= flushed
    assert not run.complete
    assert run.lost_messages == 0


def test_where_the_output_exists_the_process_says_so_and_ends_with_status_2(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    found = subprocess.run([sys.executable, "-m", "tcc_sim.nodes.recorder", "--ros-args", "-p", f"output:={tmp_path}"],
                           capture_output=True, text=True, timeout=30)
    assert found.returncode == 2
    assert found.stderr == f"recorder: {tmp_path} exists already and is not overwritten\n"
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_told_at_once_and_what_was_written_stays_readable(process):
    resource = pytest.importorskip("resource")
    child, publisher, output = process
    numbers = iter(range(send_until_known(publisher, output), 10**9))
    resource.prlimit(child.pid, resource.RLIMIT_FSIZE, (20_000, 20_000))


    def flood():
        with suppress(RuntimeError):  # The middleware may refuse in the moment when the flooded recorder ends.
            publisher.publish(joint_state(next(numbers)))

    until(lambda: child.poll() is not None, step=flood)
    _, err = child.communicate()
    assert child.returncode == 1
    assert "cannot be written" in err
    assert "Traceback" not in err
    assert readable(output) >= 1
