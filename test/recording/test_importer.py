"""Bags in SQLite, of ROS 1 and of other programs become recordings with the figures of the original: kinds x contents.

The original is read by this package's own reader from MCAP; what a bag does not state is null with its reason.
"""

import json
import math
import sqlite3
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import re_encodings
import test_named_runs as named
import yaml
import zstandard
from re_encodings import SCENE, STATES, as_rosbag2, joint_state, joints

from tcc_sim.cli import main

converter = pytest.importorskip("rosbags.convert.converter", reason="rosbags is not installed")

KINDS: dict[str, tuple[str, str]] = {"bag": ("sqlite3", ""), "bag of messages": ("sqlite3", "message"),
                                     "bag of files": ("sqlite3", "file"), "ros1.bag": ("", ""), "mcap": ("mcap", ""),
                                     "mcap of files": ("mcap", "file")}
SAME = ("max_slip_speed", "min_slip_speed", "clutch_energy", "breakaways", "stick_fraction", "cycles", "lost_messages",
        "gaps", "runs", "seconds", "lost_seconds", "max_shaft_torque")


def of_package(folder: Path) -> None:
    """A recording of version 1.0, as `ros2 bag record` makes it, without 20 states."""
    source = as_rosbag2(re_encodings.made(folder.parent / "own", named=False))
    re_encodings.save(folder / "run_0.mcap", source.changed(STATES, lambda k, data: None if 80 <= k < 100 else data))


def of_others(folder: Path) -> None:
    """Other names of joints, stamps that begin at a whole number of cycles, a third joint, no scene and no sources."""
    whole = round(10**7 * 2.0 * math.pi / 150.0 * 1e9)

    def change(_: int, data: bytes) -> bytes:
        stamp, *values = joints(data)
        columns = [[*values[k:k + 2], 0.5] for k in (0, 2, 4)]
        return joint_state(stamp + whole, ["engine", "turbine", "wheel"], columns, "base")

    source = as_rosbag2(re_encodings.made(folder.parent / "own", named=False)).changed(STATES, change)
    kept = {number for name in (re_encodings.SCENES, "/input_source") for number in source.numbers(name)}
    re_encodings.save(folder / "run_0.mcap", source._replace(
        messages=[one for one in source.messages if one.channel not in kept]))


CONTENTS: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "named runs": (lambda folder: named.save(folder, named.made()), []),
    "version 1.0": (of_package, []),
    "another program": (of_others, ["--joints", "flywheel=engine,clutch_plate=turbine"]),
}


def analysed(path: Path, *options: str) -> Any:
    out = path.parent / f"{path.name}.json"
    main(["analyse", str(path), "--verify", "--discard", "0", "--frequency", "150", "--json", str(out), *options])
    return json.loads(out.read_text())


def converted(original: Path, folder: Path, kind: str) -> Path:
    storage, mode = KINDS[kind]
    if storage == "mcap":
        (folder / kind).mkdir()
        for part in original.glob("*.mcap") if mode else ():
            (folder / kind / f"{part.name}.zstd").write_bytes(zstandard.ZstdCompressor().compress(part.read_bytes()))
        return folder / kind if mode else original
    converter.convert([original], folder / kind, storage, 9, mode and "zstd", mode or "file", None, None, [], [], [],
                      [])
    return folder / kind


def with_metadata(folder: Path) -> Path:
    """Complete a folder of parts to a bag that rosbags reads."""
    again = folder.parent / "whole"
    assert main(["recover", str(folder), "--out", str(again)]) == 0
    return again


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, Any]]:
    @cache
    def made(content: str) -> tuple[Path, Any]:
        make, options = CONTENTS[content]
        folder = tmp_path_factory.mktemp("imported")
        make(folder / "run")
        scene = folder / "scene.yaml"
        scene.write_text(SCENE.text())
        return with_metadata(folder / "run"), analysed(folder / "run", *options, "--scene", str(scene))

    return made


@pytest.mark.parametrize(("content", "kind"), [
    ("another program", "bag of files"), ("another program", "mcap"), ("named runs", "bag"), ("named runs", "ros1.bag"),
    ("version 1.0", "bag of messages"), ("version 1.0", "mcap of files")])
def test_an_imported_bag_has_the_figures_of_the_original(
        tmp_path: Path, original: Callable[[str], tuple[Path, Any]], content: str, kind: str,
        refused: Callable[..., str], capsys: pytest.CaptureFixture[str]) -> None:
    path, expected = original(content)
    options = CONTENTS[content][1]
    bag, run, scene = converted(path, tmp_path, kind), tmp_path / "run", tmp_path / "scene.yaml"
    scene.write_text(SCENE.text())
    if kind != "mcap":
        assert "tcc-sim import" in refused("analyse", bag)
    capsys.readouterr()
    assert main(["import", str(bag), str(run), *options]) == 0
    assert f" of {3 if content == 'named runs' else 1} run" in capsys.readouterr().out
    result = analysed(run, "--scene", str(scene))
    for name in SAME:
        assert result[name] == pytest.approx(expected[name], rel=1e-6), name
    assert result["verified"] is (content != "another program")
    assert result["largest_difference"] <= 1e-6
    for name, one in result["inputs"].items():
        before = expected["inputs"][name]
        for field in ("topic", "fallback", "scene", "commands", "applied", "superseded", "lost"):
            assert one[field] == pytest.approx(before[field]), (name, field)
        assert (one["applied"] is None) is (one["why"] != "") is (content != "named runs")
    assert "exists already" in refused("import", bag, run)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> tuple[re_encodings.Recording, int]:
    """A recording, and the number of its states."""
    folder = tmp_path_factory.mktemp("own") / "run"
    return re_encodings.made(folder), analysed(folder)["messages"]


PLAIN, COMPRESSED = ["run_0.mcap", "run_1.mcap"], ["run_0.mcap.zstd", "run_1.mcap.zstd"]


@pytest.mark.parametrize(("beside", "listed"), [
    ([], PLAIN), ([], []), (PLAIN[1:], []), (PLAIN[1:], COMPRESSED), (PLAIN, PLAIN), (PLAIN, COMPRESSED)])
def test_a_bag_with_compressed_and_plain_parts_is_read_or_imported_whole(
        tmp_path: Path, own: tuple[re_encodings.Recording, int], beside: list[str], listed: list[str],
        refused: Callable[..., str]) -> None:
    """A recorder that was killed leaves its last part plain, and perhaps one beside its unfinished compressed file.

    A file that metadata.yaml does not list is no part, if it lists any.
    """
    source, states = own
    re_encodings.in_parts(["run_0.mcap", "run_1.mcap"])(tmp_path / "bag", source)
    for part in [*(tmp_path / "bag").glob("*.mcap")]:
        data = part.read_bytes()
        frames = [zstandard.ZstdCompressor().compress(half) for half in (data[:5000], data[5000:])]
        if part.name not in beside or part.name == "run_0.mcap":
            part.with_name(f"{part.name}.zstd").write_bytes(frames[0] if part.name in beside else b"".join(frames))
        if part.name not in beside:
            part.unlink()
    if listed:
        (tmp_path / "bag" / "metadata.yaml").write_text(
            yaml.safe_dump({"rosbag2_bagfile_information": {"relative_file_paths": listed}}))
        (tmp_path / "bag" / "other_0.mcap.zstd").write_bytes(bytes(100))
    if len(beside) == 2:
        assert analysed(tmp_path / "bag")["messages"] == states
    else:
        assert "tcc-sim import" in refused("analyse", tmp_path / "bag")
    assert main(["import", str(tmp_path / "bag"), str(tmp_path / "run")]) == 0
    assert analysed(tmp_path / "run")["messages"] == states


def test_a_file_that_unpacks_to_too_much_is_refused(tmp_path: Path, refused: Callable[..., str]) -> None:
    bag, packer = tmp_path / "run_0.mcap.zstd", zstandard.ZstdCompressor()
    bag.write_bytes(packer.compress(bytes(1 << 24)) * 14)
    assert "would unpack to more than" in refused("import", bag, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_bag_that_lacks_messages_which_it_counts_is_refused(
        tmp_path: Path, original: Callable[[str], tuple[Path, Any]], refused: Callable[..., str]) -> None:
    bag = converted(original("version 1.0")[0], tmp_path, "bag")
    (part,) = bag.glob("*.db3")
    with sqlite3.connect(part) as base:
        base.execute("DELETE FROM messages WHERE id % 7 = 0")
    assert "messages could be read by rosbags" in refused("import", bag, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    part.write_bytes(part.read_bytes()[:3000])
    assert str(part) in refused("import", bag, tmp_path / "out")
