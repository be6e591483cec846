"""No text in a recording decides where a file is written."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tcc_sim.cli import main
from tcc_sim.messages import cdr
from tcc_sim.messages.definitions import Definition
from tcc_sim.nodes.children import private_environment
from tcc_sim.recording.bag import BagWriter
from tcc_sim.scene import load_scene
from tcc_sim.topics import JOINT_STATE

TICKS = 300
WATCHED: list[list[str]] = []


def watch(event: str, arguments: tuple[object, ...]) -> None:
    """Note files and folders that are opened for writing, made, renamed or removed."""
    if WATCHED and event in ("open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.symlink", "os.link"):
        writing = event != "open" or bool(int(arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR
                                                                    | os.O_CREAT))  # type: ignore[call-overload]
        if writing and isinstance(arguments[0], str | bytes | os.PathLike):
            WATCHED[0].append(os.path.abspath(os.fsdecode(arguments[0])))


@pytest.fixture
def written() -> Iterator[list[str]]:
    """Every path that this process writes to."""
    sys.addaudithook(watch)  # It stays, and does nothing once the list is gone.
    WATCHED.append([])
    yield WATCHED[0]
    WATCHED.clear()


@pytest.mark.parametrize("evil", ["../../evil", "/tmp/evil", "~/evil", "$(touch evil)", "a\x00b", "evil/../../evil"])
def test_names_in_a_recording_are_never_paths_to_write(tmp_path: Path, written: list[str], evil: str,
                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    """Topics, types, definitions, scene, version and all other texts carry a path; only requested files are written."""
    monkeypatch.chdir(tmp_path)
    parameters = load_scene("fig02").text().split("\n", 1)[1]
    bag = BagWriter(tmp_path / "run", f"# {evil.encode('unicode_escape').decode()}\n{parameters}", evil)
    states = bag.channel(f"/{evil}/joint_states", JOINT_STATE)
    other = bag.channel(evil, evil, schema=Definition(evil, evil))
    for n in range(TICKS):
        bag.write(states, n * 1_000_000, n * 1_000_000,
                  cdr.joint_state(n * 1_000_000, 0.1, 0.1, 50.0, 0.0, 300.0, 300.0))
        bag.write(other, n, n, b"\0\1\0\0" + evil.encode())
    bag.file.metadata("rosbag2", {"serialized_metadata": f"relative_file_paths: ['{evil}']", "path": evil})
    bag.file.note(evil, {"output": evil})
    bag.close({"lost": {evil: 1}, "solver": evil, "output": evil})
    (tmp_path / "run" / "metadata.yaml").write_text(f"relative_file_paths: ['{evil!r}']\n")
    assert main(["analyse", "run", "--verify"]) == 1  # From here on every kernel is in its cache.
    written.clear()
    assert main(["recover", "run", "--out", "saved"]) == 0
    assert main(["analyse", "run", "--verify", "--json", "run.json"]) == 1
    paths = [Path(path) for path in written if not path.startswith("/dev/") and "__pycache__" not in path]
    # A bag opens these by name relative to its open directory; none of them remains in the working directory.
    in_bag = re.compile(r"saved_0\.mcap|\.[0-9a-f]{16}\.part")
    names = {"saved" if in_bag.fullmatch(name) else name
             for name in (path.relative_to(tmp_path).parts[0] for path in paths)}
    drafts = {name for name in names if name.startswith(".run.") and name.endswith(".part")}
    assert len(drafts) == 1
    assert names == {"saved", "run.json"} | drafts
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run", "run.json", "saved"]
    assert sorted(path.name for path in (tmp_path / "saved").iterdir()) == ["metadata.yaml", "saved_0.mcap"]


def test_commands_that_start_nodes_keep_discovery_on_this_machine_unless_told_otherwise(
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    environment, release = private_environment()
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert 1 <= int(environment["ROS_DOMAIN_ID"]) <= 101
    release()
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    result, _ = private_environment()
    assert (result["ROS_AUTOMATIC_DISCOVERY_RANGE"], result["ROS_DOMAIN_ID"]) == ("SUBNET", "7")
