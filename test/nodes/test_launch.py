"""The launch file: its nodes and their parameters. `launch` has no wheel, so a stand-in records its calls."""

import dataclasses
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from tcc_sim.nodes.options import OPTIONS
from tcc_sim.scene import load_scene

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "config" / "driveline.launch.py"


@pytest.fixture
def launch_file(monkeypatch):
    """The file as a module; its actions are namespaces of their arguments."""
    parts = {"launch": ("LaunchContext", "LaunchDescription"),
             "launch.actions": ("DeclareLaunchArgument", "OpaqueFunction"),
             "launch.substitutions": ("LaunchConfiguration",), "launch_ros": (), "launch_ros.actions": ("Node",)}
    for name, kinds in parts.items():
        module = ModuleType(name)
        for kind in kinds:
            setattr(module, kind, lambda *given, kind=kind, **named: SimpleNamespace(kind=kind, given=given, **named))
        monkeypatch.setitem(sys.modules, name, module)
    sys.modules["launch.substitutions"].LaunchConfiguration = lambda name: SimpleNamespace(
        perform=lambda context: context[name])
    spec = importlib.util.spec_from_file_location("driveline_launch", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def started(launch_file, **given):
    """Executable and parameters of the nodes, in the order of their start."""
    context = {name: default for name, (default, _) in launch_file.ARGUMENTS.items()} | given
    return [(node.executable, node.parameters[0]) for node in launch_file.nodes(context)]


def test_the_driveline_waits_for_the_nodes_that_are_started_beside_it(launch_file):
    assert started(launch_file) == [
        ("driveline_node", {"scene": "commands", "wait_for_subscribers": 0, "publish_clock": False})]
    assert started(launch_file, scene="controlled", record="run1", controller="true", use_sim_time="true") == [
        ("recorder_node", {"output": "run1"}), ("slip_controller_node", {}),
        ("driveline_node", {"scene": "controlled", "wait_for_subscribers": 2, "publish_clock": True})]


def test_the_launch_file_names_what_the_package_has(launch_file):
    nodes = started(launch_file, record="run1", controller="true")
    commands = set(re.findall(r"^(\w+_node) = ", (ROOT / "pyproject.toml").read_text(), re.MULTILINE))
    assert {executable for executable, _ in nodes} <= commands
    for executable, parameters in nodes:
        options = {item.name for item in dataclasses.fields(OPTIONS[executable.removesuffix("_node")])}
        assert parameters.keys() <= options | {"scene"}
    assert load_scene(launch_file.ARGUMENTS["scene"][0]).name == "commands"
    assert [item.kind for item in launch_file.generate_launch_description().given[0]] == [
        *["DeclareLaunchArgument"] * len(launch_file.ARGUMENTS), "OpaqueFunction"]
    page = (ROOT / ".github" / "guide" / "nodes.md").read_text()
    assert all(f"`{name}`" in page for name in launch_file.ARGUMENTS)
