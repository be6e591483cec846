"""Recording and diagnostics of processes that are stopped, killed and started again."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from waiting import until

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import RecordingError, TccError
from tcc_sim.nodes.children import CLOCK_STARTED, NodeProcess
from tcc_sim.nodes.pacing import CATCH_UP
from tcc_sim.recording.reader import Run
from tcc_sim.scene import load_scene

RATE = 1000
LEASE = "1"
"""Time after which Fast DDS takes a silent participant for dead, s; its default is 20 s."""


def recorded(output: Path) -> Run | None:
    """The recording so far; None if it cannot be read yet."""
    try:
        run = Run(output)
        list(run.columns().runs)
    except RecordingError:
        return None
    return run


def messages_in(output: Path, count: int) -> Callable[[], bool]:
    """Whether the recording holds `count` joint_states."""
    def predicate() -> bool:
        run = recorded(output)
        return run is not None and run.messages["/joint_states"] >= count
    return predicate


def missed_ticks(output: Path) -> int:
    """Missed ticks that the driveline has reported so far."""
    with suppress(TccError):
        return tcc_sim.analyse(output, discard=0).missed_ticks or 0
    return 0


def test_a_driveline_that_was_stopped_counts_missed_ticks_and_goes_on_without_a_gap_or_a_burst(
        tmp_path: Path, start: Callable[..., NodeProcess]) -> None:
    output = tmp_path / "run"
    recorder = start("recorder", output=output)
    driveline = start("driveline", scene="minimal", wait_for_subscribers=1, publish_scalars=False)
    driveline.await_line(CLOCK_STARTED)
    until(messages_in(output, 200))
    os.kill(driveline.pid, signal.SIGSTOP)
    recorder.await_line("no /joint_states for 3 s")
    os.kill(driveline.pid, signal.SIGCONT)
    until(lambda: missed_ticks(output))
    now = recorded(output)
    assert now is not None
    until(messages_in(output, now.messages["/joint_states"] + 300))
    assert driveline.stop() == recorder.stop() == 0
    for words in ("no /joint_states for", "arrives again"):
        assert sum(words in line for line in recorder.lines) == 1
    run = Run(output)
    batches = list(run.columns().runs)
    stamps = np.concatenate([b.stamp_ns for b in batches])
    log = np.concatenate([b.log_ns for b in batches])
    assert stamps.tolist() == [k * 10**9 // RATE for k in range(len(stamps))]
    # The driveline caught up at most CATCH_UP of the ticks due while it was stopped; the others are counted as missed.
    # Signal and messages may take a while to arrive on a busy machine.
    missed = missed_ticks(output)
    assert missed >= 2 * RATE
    due = (log[-1] - log[0]) * 1e-9 * RATE
    assert abs(due - len(log) - missed) <= 2 * CATCH_UP * RATE + 0.5 * missed
    assert run.complete
    assert run.warnings == []


def test_a_killed_driveline_is_told_and_one_started_again_is_a_run_of_its_own(
        tmp_path: Path, start: Callable[..., NodeProcess]) -> None:
    output = tmp_path / "run"
    recorder = start("recorder", LEASE, output=output)
    first = start("driveline", LEASE, scene="minimal", wait_for_subscribers=1, publish_scalars=False)
    first.await_line(CLOCK_STARTED)
    until(messages_in(output, 300))
    os.kill(first.pid, signal.SIGKILL)
    recorder.await_line("the publisher of /joint_states is gone; the recording continues")
    until(lambda: (run := recorded(output)) is not None and len(run.scenes) == 1)
    before = recorded(output)
    assert before is not None
    second = start("driveline", LEASE, scene="slip", wait_for_subscribers=1, publish_scalars=False)
    second.await_line(CLOCK_STARTED)
    until(messages_in(output, before.messages["/joint_states"] + 300))
    until(lambda: (run := recorded(output)) is not None and len(run.scenes) == 2)
    assert second.stop() == recorder.stop() == 0
    run = Run(output)
    by_run: dict[int, list[int]] = {}
    first_speed: dict[int, float] = {}
    for batch in run.columns().runs:
        first_speed.setdefault(batch.run, float(batch.flywheel_speed[0]))
        by_run.setdefault(batch.run, []).extend(batch.stamp_ns.tolist())
    assert list(by_run) == [0, 1]
    for stamps in by_run.values():
        assert stamps == [k * 10**9 // RATE for k in range(len(stamps))]
    assert first_speed == {0: load_scene("minimal").system.initial.slip_speed,
                           1: load_scene("slip").system.initial.slip_speed}
    assert [scene.text.splitlines()[0] for scene in run.scenes] == [
        f"# {load_scene(name).description}" for name in ("minimal", "slip")]
    assert run.complete
    assert run.warnings == ["simulation time started again 1 time (0 resets, 1 restart): these are "
                            "separate runs"]
    # The recording assigns each run its own scene.
    batches = list(run.columns().runs)
    change = [batch.run for batch in batches].index(1)
    assert run.scenes[0].log_ns <= batches[0].log_ns[0]
    assert batches[change - 1].log_ns[-1] < run.scenes[1].log_ns <= batches[change].log_ns[0]
    assert main(["analyse", str(output), "--verify", "--json", str(tmp_path / "run.json")]) == 0
    assert json.loads((tmp_path / "run.json").read_text())["verified"] is True
