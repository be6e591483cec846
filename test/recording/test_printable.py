"""What comes from a file or a topic name reaches a terminal in printable characters only, and in bounded length."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from driveline_bags import TICK

from tcc_sim.cli import main
from tcc_sim.errors import InputError, one_line, printable
from tcc_sim.messages import cdr
from tcc_sim.messages.definitions import Definition
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.mcap_file import RECOVERY_RECORD
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLUID_PRESSURE, JOINT_STATE

EVIL = "\x1b]0;owned\x07\x1b[2J\r\n\u202egnp\x9b31m\x7f\u2028"
TURNED = "\u202egnp\u2066\u200b"
"""What YAML, which a scene is, lets through."""


def recording(tmp_path: Path, cut: bool) -> Path:
    """Every text in it is evil: scene description, topics, types, recorder's figures, what a recovery said."""
    text = load_scene("slip").text().split("\n", 1)[1]
    bag = BagWriter(tmp_path / "run", f"# a scene {TURNED}\n{text}")
    states = bag.channel(f"/{EVIL}/joint_states", JOINT_STATE)
    pressure = bag.channel(f"/{EVIL}/applied_pressure", FLUID_PRESSURE)
    other = bag.channel(EVIL, EVIL, schema=Definition(EVIL, EVIL))
    bag.file.note(RECOVERY_RECORD, [EVIL, EVIL * 1000])
    for n in range(400):
        bag.write(states, n, n, cdr.joint_state(n * TICK, 0.1, 0.1, 50.0, 0.0, 300.0, 300.0 if n != 100 else 0.0), n)
        if n % 7:
            bag.write(pressure, n, n, cdr.fluid_pressure(n * TICK, 2e5), n)
        bag.write(other, n, n, b"\0\1\0\0")
    bag.write(states, 400, 400, b"\0\1\0\0 not of this layout")
    bag.file.flush()
    if cut:
        bag.abandon()
    else:
        bag.close({"lost": {EVIL: 1, EVIL * 100: 2}, "unsent": {EVIL: 3}, "solver": EVIL})
    return tmp_path / "run"


def clean(text: str) -> None:
    for line in text.split("\n"):
        assert line.isprintable(), repr(line)


@pytest.mark.parametrize("cut", [False, True])
def test_analyse_and_recover_print_nothing_that_a_terminal_obeys(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                                 cut: bool) -> None:
    path = recording(tmp_path, cut)
    for words in (["analyse", str(path)], ["recover", str(path)], ["analyse", str(tmp_path / "run_recovered")],
                  ["recover", str(tmp_path / "run_recovered")]):
        assert main(words) == 0
        captured = capsys.readouterr()
        clean(captured.out)
        clean(captured.err)
        assert len(captured.out) < 20_000
    assert main(["analyse", str(path), "--json", "-"]) == 0
    out = capsys.readouterr().out
    clean(out)
    assert json.loads(out)["messages"] == 400


def test_a_directory_with_a_name_of_that_kind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    directory = tmp_path / f"x{EVIL}"
    recording(tmp_path, True).rename(directory)
    for words in (["analyse", str(directory)], ["recover", str(directory)]):
        assert main(words) == 0
        clean(capsys.readouterr().out)
    assert main(["analyse", str(tmp_path / f"y{EVIL}")]) == 2
    clean(capsys.readouterr().err)


def test_the_one_function() -> None:
    assert printable("a\x1b[0m\nb") == "a\\x1b[0m\\nb"
    assert printable("é 漢 ω") == "é 漢 ω"
    assert printable("\ud800") == "\\ud800"
    assert one_line("x" * 5000).count("x") == 1000
    assert str(InputError(EVIL)).isprintable()
