"""The driveline's parameters, and refusals of the entry points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from benches import overrides

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter

from tcc_sim.code_version import code_version
from tcc_sim.errors import InputError
from tcc_sim.nodes.driveline import DrivelineNode
from tcc_sim.nodes.parameters import OPTIONS, RecorderOptions, declared
from tcc_sim.scene import DEFAULT_SCENE, MEANINGS, NODE_SCENE, bundled_scenes, load_scene


@pytest.mark.parametrize(("module", "words", "parts"), [
    ("driveline", ["--ros-args", "-p", "engine.frequency:=fast"],
     ["engine.frequency", "'fast'", "0.001 to 100000 rad/s"]),
    ("driveline", ["--ros-args", "-p", "scene:=fig20"], ["'fig20'", "fig02"]),
    ("driveline", ["--ros-args", "--params-file", "nowhere.yaml"], ["--params-file nowhere.yaml"]),
    ("driveline", ["-p", "scene:=fig02"], ["-p ", "driveline_node --ros-args -p scene:=fig02"]),
    ("recorder", ["output:=run", "--ros-args", "-p", "flush_period:=1.0"],
     ["recorder_node --ros-args output:=run -p flush_period:=1.0"]),
    ("slip_controller", ["--verson"], ["--verson", "--version"]),
    ("driveline", ["--ros-args", "-p", "rate:=[]"], ["rate", "[]", "1 to 20000 Hz"]),
    ("recorder", ["--ros-args", "-p", "output:=/"], ["/ exists"])])
def test_wrong_input_is_one_line_with_the_right_spelling_and_status_2(
        entered: Callable[..., tuple[int, str, str]], module: str, words: list[str], parts: list[str]) -> None:
    status, printed, errors = entered(module, *words)
    assert (status, printed, errors.count("\n")) == (2, "", 1)
    assert [part for part in parts if part not in errors] == []


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


def test_every_parameter_is_described_with_its_range_and_those_of_a_running_node_are_live(bench: Any) -> None:
    node = bench.driveline(scene="minimal", cpu_affinity=[0], engine__mean_torque=260.0,
                           engine__harmonic_amplitudes=[9.0], engine__harmonic_phases=[0.5])
    assert (node.scene.name, node.scene.description) == (
        "minimal with overrides", f"{load_scene('minimal').description}, with overrides")
    for name, value in node.scene.values().items():
        meaning, given = MEANINGS[name], node.describe_parameter(name)
        number, whole = isinstance(value, float), isinstance(value, int) and not isinstance(value, bool)
        assert (given.description, given.read_only, given.dynamic_typing) == (
            meaning.described, not meaning.live, meaning.live), name
        assert given.additional_constraints == ("" if isinstance(value, bool) else meaning.interval()), name
        assert [(one.from_value, one.to_value, one.step) for one in given.floating_point_range] == [
            (meaning.low, meaning.high, 0.0)] * number, name
        assert [(one.from_value, one.to_value, one.step) for one in given.integer_range] == [
            (meaning.low, meaning.high, 1)] * whole, name
        if isinstance(value, tuple) and value:
            assert given.type == (ParameterType.PARAMETER_INTEGER_ARRAY if name == "cpu_affinity" else
                                  ParameterType.PARAMETER_DOUBLE_ARRAY), name
    assert [node.describe_parameter(name).read_only for name in ("scene", "scene_text")] == [True, False]
    assert node.get_parameter("scene").value == "minimal"
    for value, reason in ((node.scene.text(), ""), ("other", "scene_text follows the scene and cannot be set; set the "
                                                             "keys of the scene instead")):
        (result,) = node.set_parameters([Parameter("scene_text", value=value)])
        assert (result.successful, result.reason) == (not reason, reason)
    assert bench.driveline(namespace="other", scene="minimal").scene.name == "minimal"
    with pytest.raises(InputError, match=r"^friction\.table works only in a scene file, with -p scene:=FILE; in a "):
        bench.driveline(namespace="third", friction__table="a.csv")
    for source, name in ((["engine__source"], DEFAULT_SCENE), (["pressure__source"], DEFAULT_SCENE), ([], NODE_SCENE)):
        node = bench.driveline(namespace="fourth", **dict.fromkeys(source, "topic"))
        assert node.get_parameter("scene").value == name
        bench.remove(node)


def test_the_options_of_a_node_are_described_and_cannot_change(bench: Any) -> None:
    node = bench.node("recorder", output="here", topics=["scene"])
    assert declared(node, RecorderOptions, flush_period=0.5, output="there") == RecorderOptions("here", ("scene",), 0.5)


def test_help_names_every_parameter_wherever_it_is_asked_for(entered: Callable[..., tuple[int, str, str]]) -> None:
    for words in (["--help"], ["-h"], ["--ros-args", "-p", "--", "-h"]):
        status, printed, errors = entered("driveline", *words)
        assert (status, errors) == (0, "")
        assert {f"  {name}:" for name in ("scene", *OPTIONS["driveline"].quantities())} <= {
            line.split(":")[0] + ":" for line in printed.splitlines()}
    assert entered("slip_controller", "--version") == (0, f"tcc_sim {code_version()}\n", "")
    for words in (["x"], ["-r", "a", "--ros-args", "b", "--"]):
        status, printed, errors = entered("recorder", *words)
        assert (status, printed, errors.count("\n"), words[0] in errors) == (2, "", 1, True)


def test_every_bundled_scene_is_a_parameter_file_of_the_node(bench: Any) -> None:
    for name, file in bundled_scenes().items():
        node = DrivelineNode(context=bench.context, cli_args=["--ros-args", "--params-file", str(file)])
        text = node.get_parameter("scene_text").value
        assert text.split("\n", 1)[1].strip() == load_scene(name).text().split("\n", 1)[1].strip()
        node.destroy_node()
