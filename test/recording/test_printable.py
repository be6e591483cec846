"""Text from a file or a topic name reaches a terminal in printable characters and in bounded length."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from driveline_bags import TICK, bag, ticked

from tcc_sim.cli import main
from tcc_sim.messages import cdr
from tcc_sim.messages.definitions import Definition
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.mcap_file import RECOVERY_RECORD
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLUID_PRESSURE, JOINT_STATE

EVIL = "\x1b]0;owned\x07\x1b[2J\r\n\u202egnp\x9b31m\x7f\u2028"
TURNED = "\u202egnp\u2066\u200b"
"""Characters that YAML allows in a scene."""


def recording(tmp_path: Path, cut: bool) -> Path:
    """A recording with evil text in scene description, topics, types, recorder's figures and notes of a recovery."""
    text = load_scene("slip").text().split("\n", 1)[1]
    writer = BagWriter(tmp_path / "run", f"# a scene {TURNED}\n{text}")
    states = writer.channel(f"/{EVIL}/joint_states", JOINT_STATE)
    pressure = writer.channel(f"/{EVIL}/applied_pressure", FLUID_PRESSURE)
    other = writer.channel(EVIL, EVIL, schema=Definition(EVIL, EVIL))
    writer.file.note(RECOVERY_RECORD, [EVIL, EVIL * 1000])
    for n in range(200):
        writer.write(states, n, n, cdr.joint_state(n * TICK, 0.1, 0.1, 50.0, 0.0, 300.0, 300.0 if n != 100 else 0.0), n)
        if n % 7:
            writer.write(pressure, n, n, cdr.fluid_pressure(n * TICK, 2e5), n)
        writer.write(other, n, n, b"\0\1\0\0")
    writer.write(states, 200, 200, b"\0\1\0\0 not of this layout")
    writer.file.flush()
    if cut:
        writer.abandon()
    else:
        writer.close({"lost": {EVIL: 1, EVIL * 100: 2}, "unsent": {EVIL: 3}, "solver": EVIL})
    return tmp_path / "run"


def clean(text: str) -> None:
    for line in text.split("\n"):
        assert line.isprintable(), repr(line)


@pytest.mark.parametrize("cut", [False, True])
def test_analyse_and_recover_print_nothing_that_a_terminal_obeys(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                                 cut: bool) -> None:
    path = recording(tmp_path, cut)
    for words in (["analyse", str(path)], ["recover", str(path)], ["analyse", str(tmp_path / "run_recovered")]):
        assert main(words) == 0
        captured = capsys.readouterr()
        clean(captured.out)
        clean(captured.err)
        assert len(captured.out) < 20_000
    assert main(["analyse", str(path), "--json", "-"]) == 0
    out = capsys.readouterr().out
    clean(out)
    assert json.loads(out)["messages"] == 200


def test_a_directory_with_a_name_of_that_kind(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                              refused: Callable[..., str]) -> None:
    directory = tmp_path / f"x{EVIL}"
    recording(tmp_path, True).rename(directory)
    for words in (["analyse", str(directory)], ["recover", str(directory)]):
        assert main(words) == 0
        clean(capsys.readouterr().out)
    clean(refused("analyse", tmp_path / f"y{EVIL}"))


def test_names_that_are_not_utf_8_are_drawn_escaped_and_refused_where_rerun_cannot_take_them(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    name = os.fsdecode(bytes(tmp_path) + b"/r\xff")
    run = bag(Path(name), ticked(load_scene("fig02"), 300), "fig02")
    (tmp_path / "scene.yaml").write_text(load_scene("slip").with_values({"friction.kinetic_coefficient": 0.29}).text())
    os.rename(tmp_path / "scene.yaml", name + ".yaml")
    assert main(["simulate", name + ".yaml", "--inputs", name, "--plot", str(tmp_path / "a.png")]) == 0
    assert (tmp_path / "a.png").stat().st_size > 10_000
    capsys.readouterr()
    pytest.importorskip("rerun")
    assert main(["analyse", str(run), "--plot", name + ".png", "--rrd", str(tmp_path / "a.rrd")]) == 0
    assert main(["analyse", str(run), "--rrd", name + ".rrd"]) == 2
    assert "is not a name in UTF-8, which Rerun needs" in capsys.readouterr().err
