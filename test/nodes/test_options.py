"""Start of nodes, without ROS: the table of their parameters, the launch file, child processes and domains.

`launch` has no wheel, so a stand-in records its calls.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import re
import socket
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from ranges import check_options, of_page

from tcc_sim.errors import InputError, TccError
from tcc_sim.nodes.children import DOMAINS, Domain, ports_in_use
from tcc_sim.nodes.options import OPTIONS
from tcc_sim.scene import load_scene

FIELDS = [(kind, item) for kind in OPTIONS.values() for item in dataclasses.fields(kind)]


PAGE = of_page("nodes")


@pytest.mark.parametrize("name", OPTIONS)
def test_an_option_takes_its_range_and_refuses_the_rest_by_a_sentence(name: str) -> None:
    check_options({item.name: PAGE[item.name] for kind, item in FIELDS if kind is OPTIONS[name]}, OPTIONS[name])


def unfit(item: Any) -> list[object]:
    """Values of a type that the option must refuse."""
    if item.type.startswith("tuple"):
        return [3, "one", [""], [True], *([[1]] if "str" in item.type else [])]
    if item.type == "str":
        return [3.0, True] if item.metadata["quantity"].choices else []
    return [0.0] if item.type == "bool" else [True, "fast", None, *([0.5, math.nan] if item.type == "int" else [])]


@pytest.mark.parametrize(("kind", "item"), FIELDS, ids=lambda value: getattr(value, "name", None))
def test_an_option_refuses_what_it_cannot_be_and_says_its_name(kind: Any, item: Any) -> None:
    for value in unfit(item):
        with pytest.raises(InputError, match=rf"^{item.name} is "):
            kind(**{item.name: value})


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
    commands = set(re.findall(r"^ +(\w+_node) = ", (ROOT / "setup.cfg").read_text(), re.MULTILINE))
    assert {executable for executable, _ in nodes} <= commands
    for executable, parameters in nodes:
        options = {item.name for item in dataclasses.fields(OPTIONS[executable.removesuffix("_node")])}
        assert parameters.keys() <= options | {"scene"}
    assert load_scene(launch_file.ARGUMENTS["scene"][0]).name == "commands"
    assert [item.kind for item in launch_file.generate_launch_description().given[0]] == [
        *["DeclareLaunchArgument"] * len(launch_file.ARGUMENTS), "OpaqueFunction"]
    page = (ROOT / ".github" / "guide" / "nodes.md").read_text()
    assert all(f"`{name}`" in page for name in launch_file.ARGUMENTS)


def test_no_two_have_the_same_domain_until_it_is_given_back() -> None:
    some = range(90, 98)
    mine: list[Domain] = []
    with pytest.raises(TccError, match="every ROS domain from 90 to 97 is in use on this machine"):
        mine.extend(Domain(some) for _ in range(9))
    assert len({one.number for one in mine}) == len(mine)
    assert mine
    assert {one.number for one in mine} <= set(some)
    mine[0].close()
    again = Domain(some)
    assert again.number == mine[0].number
    for one in (again, *mine):
        one.close()


def test_a_domain_with_a_participant_is_somebodys() -> None:
    """Every participant of a domain has bound a port of it."""
    claimed = Domain()
    claimed.close()
    one = [claimed.number]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("127.0.0.1", 7400 + 250 * claimed.number + 11))
        assert participant.getsockname()[1] in ports_in_use()
        with pytest.raises(TccError, match="in use on this machine; set ROS_DOMAIN_ID"):
            Domain(one)
    Domain(one).close()


def test_ports_are_those_of_both_tables(tmp_path: Path) -> None:
    head = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"
    (tmp_path / "udp").write_text(head + "  12: 00000000:1CE8 00000000:0000 07 00000000:00000000 00:00000000\n")
    (tmp_path / "udp6").write_text(head + "   3: 00000000000000000000000000000000:D4EE 0:0 07\n")
    assert ports_in_use([tmp_path / name for name in ("udp", "udp6", "none")]) == {7400, 0xD4EE}


def test_domains_keep_clear_of_the_ephemeral_ports() -> None:
    assert (DOMAINS[0], 7400 + 250 * DOMAINS[-1]) >= (1, 32650)
    assert 7400 + 250 * DOMAINS[-1] < 32768
