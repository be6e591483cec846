"""Start of nodes, without ROS: the table of their parameters, the launch file, child processes and domains.

`launch` has no wheel, so a stand-in records its calls.
"""

from __future__ import annotations

import dataclasses
import math
import re
import runpy
import socket
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from ranges import check_options, of_page

from tcc_sim.errors import InputError, TccError
from tcc_sim.nodes.children import DOMAINS, Domain
from tcc_sim.nodes.parameters import OPTIONS

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


def test_the_launch_file_starts_the_nodes_of_the_package_and_the_driveline_waits_for_them(monkeypatch) -> None:
    class Made(SimpleNamespace):
        """An action of the launch file: its arguments."""

        def __init__(self, *given, **named) -> None:
            super().__init__(given=given, **named)

    for name, kinds in {"launch": ("LaunchContext", "LaunchDescription"), "launch_ros": (),
                        "launch.actions": ("DeclareLaunchArgument", "OpaqueFunction"), "launch_ros.actions": ("Node",),
                        "launch.substitutions": ()}.items():
        module = ModuleType(name)
        vars(module).update(dict.fromkeys(kinds, Made))
        monkeypatch.setitem(sys.modules, name, module)
    sys.modules["launch.substitutions"].LaunchConfiguration = lambda name: SimpleNamespace(
        perform=lambda context: context[name])
    file = runpy.run_path(str(FILE))

    def started(**given):
        context = {name: default for name, (default, _) in file["ARGUMENTS"].items()} | given
        return [(node.executable, node.parameters[0]) for node in file["nodes"](context)]

    assert started() == [("driveline_node", {"scene": "commands", "wait_for_subscribers": 0, "publish_clock": False})]
    nodes = started(scene="controlled", record="run1", controller="true", use_sim_time="true")
    assert nodes == [("recorder_node", {"output": "run1"}), ("slip_controller_node", {}),
                     ("driveline_node", {"scene": "controlled", "wait_for_subscribers": 2, "publish_clock": True})]
    commands = set(re.findall(r"^ +(\w+_node) = ", (ROOT / "setup.cfg").read_text(), re.MULTILINE))
    for executable, parameters in nodes:
        options = {item.name for item in dataclasses.fields(OPTIONS[executable.removesuffix("_node")])}
        assert parameters.keys() <= options | {"scene"}
        assert executable in commands
    assert len(file["generate_launch_description"]().given[0]) == len(file["ARGUMENTS"]) + 1
    page = (ROOT / ".github" / "guide" / "nodes.md").read_text()
    assert all(f"`{name}`" in page for name in file["ARGUMENTS"])


def test_no_two_have_the_same_domain_until_it_is_given_back() -> None:
    some = range(90, 98)
    mine: list[Domain] = []
    with pytest.raises(TccError, match=r"90 to 97"):
        mine.extend(Domain(some) for _ in range(9))
    assert len({one.number for one in mine}) == len(mine) > 0
    assert {one.number for one in mine} <= set(some)
    mine[0].close()
    again = Domain(some)
    assert again.number == mine[0].number
    for one in (again, *mine):
        one.close()
    # The ports of these domains are below the ephemeral ones.
    assert (DOMAINS[0], 7400 + 250 * DOMAINS[-1]) >= (1, 32650)
    assert 7400 + 250 * DOMAINS[-1] < 32768


@pytest.mark.parametrize(("family", "address"), [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")])
def test_a_domain_with_a_participant_is_somebodys(family: socket.AddressFamily, address: str) -> None:
    """Every participant of a domain has bound a port of it."""
    claimed = Domain()
    with socket.socket(family, socket.SOCK_DGRAM) as participant:
        try:
            participant.bind((address, 7400 + 250 * claimed.number + 11))
        except OSError:
            pytest.skip("this machine has no such address")
        finally:
            claimed.close()
        with pytest.raises(TccError, match="ROS_DOMAIN_ID"):
            Domain([claimed.number])
    Domain([claimed.number]).close()
