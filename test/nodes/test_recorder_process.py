"""The recorder as a process: its end by a signal, a kill or a full disk, and the files that remain."""

import hashlib
import signal
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from benches import joined
from full_disk import full_disk
from rclpy.duration import Duration
from test_recorder import TICK, joint_state, publisher_of
from waiting import until

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import RecordingError
from tcc_sim.messages import cdr
from tcc_sim.nodes.middleware import message_class, poll, states, subscribe
from tcc_sim.recording.reader import open_run
from tcc_sim.topics import JOINT_STATE


@pytest.fixture
def process_context(monkeypatch, domain, discovery):
    """A context in the domain of the processes."""
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", discovery(""))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    context = joined()
    yield context
    rclpy.shutdown(context=context)


@pytest.fixture
def process(tmp_path, process_context):
    """Process of a recorder, a publisher that it subscribes to, and the bag's directory."""
    node = rclpy.create_node("driveline", context=process_context)
    publisher = publisher_of(node, "joint_states")
    output = tmp_path / "run"
    child = subprocess.Popen([sys.executable, "-m", "tcc_sim.nodes.recorder", "--ros-args", "-p", f"output:={output}",
                              "-p", "max_bag_duration:=1.0"],
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        # The bag comes after the subscriptions: a signal before it is there ends the recorder with nothing recorded.
        until(lambda: (publisher.get_subscription_count() == 1 and any(output.glob("*.mcap")))
              or child.poll() is not None)
        yield child, publisher, output
    finally:
        child.kill()
        child.communicate()


def readable(output):
    """How many joint_states can be read now."""
    try:
        return sum(map(len, open_run(output).states()))
    except RecordingError:
        return 0


def send_until_known(publisher, output):
    """Send states until the recorder has one, perhaps some time after discovery; return the next number."""
    numbers = iter(range(10**9))

    def send():
        publisher.publish(joint_state(next(numbers)))
        # One at a time: the publisher keeps the last 1000 only.
        publisher.wait_for_all_acked(Duration(seconds=0.1))

    until(lambda: readable(output) > 0, step=send)
    return next(numbers)


def test_a_signal_ends_it_with_a_complete_bag_and_status_0(process):
    child, publisher, output = process
    known = send_until_known(publisher, output)
    for n in range(known, known + 700):
        publisher.publish(joint_state(n))
    publisher.wait_for_all_acked()
    child.send_signal(signal.SIGTERM)
    out, err = child.communicate(timeout=120)
    assert child.returncode == 0, err
    assert "Traceback" not in err
    run = open_run(output)
    stamps = np.concatenate([batch.stamp_ns for batch in run.states()])
    assert len(stamps) > 700
    assert stamps.tolist() == [n * TICK for n in range(known + 700 - len(stamps), known + 700)]
    assert out == f"recorded {len(stamps)} messages in {output}, 0 lost\n"
    assert run.complete
    assert (output / "metadata.yaml").exists()


def test_a_driveline_ends_after_a_busy_recorder_has_received_everything(process_context, start, tmp_path):
    """A stopped recorder first loses messages beyond the 512 that Fast DDS queues for a process."""
    controller = rclpy.create_node("controller", context=process_context)
    command = publisher_of(controller, "actuation_pressure")
    subscription = subscribe(controller, message_class(JOINT_STATE), "joint_states", states(1000))
    recorder = start("recorder", output=tmp_path / "run")
    driveline = start("driveline", scene="controlled", pacing="lockstep", command_timeout=0.0, wait_for_subscribers=2,
                      publish_diagnostics=False)
    heard = []

    def answer(count):
        for data, _ in poll(subscription):
            heard.append(cdr.read_stamp(data))
            if len(heard) < count:
                command.publish(cdr.fluid_pressure(heard[-1], 1e5))
        return len(heard) == count

    until(lambda: answer(100), step=list)
    recorder.send_signal(signal.SIGSTOP)
    command.publish(cdr.fluid_pressure(heard[-1], 1e5))
    until(lambda: answer(400), step=list)
    driveline.send_signal(signal.SIGINT)
    driveline.await_line("waits until subscribers have received the last messages of /")
    recorder.send_signal(signal.SIGCONT)
    assert driveline.wait() == recorder.stop() == 0
    run = open_run(tmp_path / "run")
    (result,) = run.states()
    assert result.stamp_ns.tolist() == heard == [n * TICK for n in range(400)]
    assert np.isfinite(result.applied_pressure).all()
    assert run.warnings == []


def test_recorders_that_end_one_after_the_other_leave_what_can_be_analysed_and_recovered(start, tmp_path, capsys):
    """By a kill, at a limit on the size of files, which ends as a full disk does, and in order. Each recording has its
    scene too, although the driveline still knows readers that died.
    """
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    resource = pytest.importorskip("resource")
    driveline = start("driveline", scene="minimal", publish_diagnostics=False)
    seen, files, recorders = {}, {}, {name: start("recorder", output=tmp_path / name) for name in ("full", "killed")}
    for name in ("full", "killed", "stopped"):
        until(lambda name=name: readable(tmp_path / name) > 100)
        files[name], = (tmp_path / name).iterdir()
        seen[name] = readable(tmp_path / name)
        if name == "full":
            size = files[name].stat().st_size + 20_000
            resource.prlimit(recorders[name].pid, resource.RLIMIT_FSIZE, (size, size))
            assert recorders[name].wait() == 1
            # On a busy machine the recorder may warn of silence.
            line, = (line for line in recorders[name].lines if not line.startswith(("[INFO]", "[WARN]")))
            assert line.startswith(f"recorder: {files[name]} cannot be written: ")
        elif name == "killed":
            recorders[name].kill()
            recorder = start("recorder", output=tmp_path / "stopped")
    assert recorder.stop() == 0
    driveline.check()
    driveline.kill()
    assert open_run(tmp_path / "stopped").scene_text is not None
    for name in ("full", "killed"):
        output, digest = tmp_path / name, hashlib.sha256(files[name].read_bytes()).digest()
        result = tcc_sim.analyse(output, verify=True)
        assert (result.complete, result.verification.verified) == (False, True)
        assert result.messages >= seen[name]
        recovered = tmp_path / f"{name}_saved"
        assert main(["recover", str(output), "--out", str(recovered)]) == 0
        assert "note: the recording was cut short" in capsys.readouterr().out
        with rosbag2.Reader(recovered) as reader:
            assert sum(1 for _ in reader.messages()) == reader.message_count
            assert next(c.msgcount for c in reader.connections if c.topic == "/joint_states") == result.messages
        assert open_run(recovered).complete
        assert ([path.name for path in output.iterdir()],
                hashlib.sha256(files[name].read_bytes()).digest()) == ([files[name].name], digest)
    with full_disk(20_000):  # A full disk has no room for the recovered bag.
        assert main(["recover", str(output), "--out", str(tmp_path / "none")]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_a_directory_that_is_no_more_its_own_ends_it_with_one_line_and_what_it_wrote_is_whole(process):
    child, publisher, output = process
    send_until_known(publisher, output)
    kept = output.rename(output.parent / "moved")
    _, err = child.communicate(timeout=120)
    assert child.returncode == 1
    said = [line for line in err.splitlines() if "INFO" not in line and "WARN" not in line]
    assert said == [f"recorder: {output} was renamed or removed while it was recorded to; the data written so far "
                    "stays readable"]
    assert open_run(kept / "run_0.mcap").complete
    assert readable(kept / "run_0.mcap") > 0
    assert (kept / "metadata.yaml").exists()
