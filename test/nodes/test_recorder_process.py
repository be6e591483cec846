"""The recorder as a process: its end by a signal, a kill or a full disk, and the files that remain."""

import hashlib
import signal

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from benches import joined
from full_disk import full_disk
from test_recorder import TICK, publisher_of
from waiting import until

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import RecordingError
from tcc_sim.messages import cdr
from tcc_sim.nodes.middleware import message_class, poll, states, subscribe
from tcc_sim.recording.reader import Run
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


def readable(output):
    """How many joint_states can be read now."""
    try:
        return sum(map(len, Run(output).columns().runs))
    except RecordingError:
        return 0


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
    run = Run(tmp_path / "run")
    (result,) = run.columns().runs
    assert result.stamp_ns.tolist() == heard == [n * TICK for n in range(400)]
    assert np.isfinite(result.of("applied_pressure")).all()
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
    assert Run(tmp_path / "stopped").scene_text is not None
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
        assert Run(recovered).complete
        assert ([path.name for path in output.iterdir()],
                hashlib.sha256(files[name].read_bytes()).digest()) == ([files[name].name], digest)
    with full_disk(20_000):  # A full disk has no room for the recovered bag.
        assert main(["recover", str(output), "--out", str(tmp_path / "none")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
