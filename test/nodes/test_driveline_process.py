"""The driveline as a process: its end by a signal, its parameters, and refusals of its entry points."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

import pytest
from benches import overrides

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from tcc_sim.nodes.children import CLOCK_STARTED, NodeProcess
from tcc_sim.nodes.driveline import DrivelineNode
from tcc_sim.nodes.middleware import time_of
from tcc_sim.scene import bundled_scenes, load_scene


def test_a_signal_ends_the_node_with_status_0_and_no_traceback(start: Callable[..., NodeProcess]) -> None:
    node = start("driveline", scene="minimal")
    node.await_line(CLOCK_STARTED)
    assert "scene minimal, 1000 Hz" in node.lines[0]
    node.send_signal(signal.SIGTERM)
    assert node.wait() == 0
    # rcl itself says so where the signal falls between the print of the last line and its publication on rosout. On a
    # busy machine the node warns that it was late.
    assert [line for line in node.lines[2:] if not line.startswith("Failed to publish log message to rosout")
            and "the real-time loop was" not in line] == []


@pytest.mark.parametrize(("module", "words", "line"), [
    ("driveline", ["--ros-args", "-p", "engine.frequency:=fast"],
     "driveline_node: engine.frequency is 'fast'; it must be a number, 0.001 to 100000 rad/s\n"),
    ("driveline", ["--ros-args", "-p", "scene:=fig20"],
     "driveline_node: there is no scene 'fig20'; did you mean fig02?\n"),
    ("driveline", ["--ros-args", "--params-file", "nowhere.yaml"],
     "driveline_node: --params-file nowhere.yaml: No such file or directory\n"),
    ("driveline", ["-p", "scene:=fig02"],
     "driveline_node: -p is not an option; words for ROS 2 follow --ros-args: driveline_node --ros-args -p "
     "scene:=fig02\n"),
    ("recorder", ["output:=run", "--ros-args", "-p", "flush_period:=1.0"],
     "recorder_node: output:=run is not an option; words for ROS 2 follow --ros-args: recorder_node --ros-args "
     "output:=run -p flush_period:=1.0\n"),
    ("slip_controller", ["--verson"], "slip_controller_node: --verson is not an option; did you mean --version?\n"),
    ("driveline", ["--ros-args", "-p", "rate:=[]"], "driveline_node: rate is []; it must be a number, 1 to 20000 Hz\n"),
    ("recorder", ["--ros-args", "-p", "output:=/"], "recorder: / exists already and is not overwritten\n")])
def test_wrong_input_is_one_line_with_the_right_spelling_and_status_2(
        entered: Callable[..., tuple[int, str, str]], module: str, words: list[str], line: str) -> None:
    assert entered(module, *words) == (2, "", line)


def test_an_empty_list_is_one(bench: Any, capfd: pytest.CaptureFixture[str]) -> None:
    assert bench.driveline(scene="minimal", cpu_affinity=[], scheme=1).scene.operation.cpu_affinity == ()
    assert "parameter ignored: scheme is not one of this node; did you mean scene?" in capfd.readouterr().err


def test_a_doubtful_friction_table_is_a_warning_at_the_start_and_when_it_changes(
        bench: Any, capfd: pytest.CaptureFixture[str]) -> None:
    table: dict[str, object] = {"friction.slip_speeds": [0.0, 1.0, 9.0], "friction.coefficients": [0.2, 0.13, 0.14]}
    node = bench.driveline(scene="minimal", wait_for_subscribers=0, **table)
    assert capfd.readouterr().err.count("the fit of the friction table is 2.6%") == 1
    node.start()
    for coefficients, warned in (([0.2, 0.131, 0.14], 1), ([0.2, 0.131, 0.14], 0), ([0.145, 0.143, 0.14], 0)):
        table["friction.coefficients"] = coefficients
        assert node.set_parameters_atomically(overrides(table)).successful
        assert capfd.readouterr().err.count("the fit of the friction table") == warned


@pytest.mark.parametrize(("nanoseconds", "expected"), [(0, (0, 0)), (1_500_000_000, (1, 500_000_000)),
                                                       (2_240_000_000 * 10**9 + 7, (2**31 - 1, 7))])
def test_a_clock_beyond_2038_is_no_error(nanoseconds: int, expected: tuple[int, int]) -> None:
    time = time_of(nanoseconds)
    assert (time.sec, time.nanosec) == expected


def test_every_bundled_scene_is_a_parameter_file_of_the_node(bench: Any) -> None:
    for name, file in bundled_scenes().items():
        node = DrivelineNode(context=bench.context, cli_args=["--ros-args", "--params-file", str(file)])
        text = node.get_parameter("scene_text").value
        assert text.split("\n", 1)[1].strip() == load_scene(name).text().split("\n", 1)[1].strip()
        node.destroy_node()
