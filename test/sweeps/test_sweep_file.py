"""The file of a sweep: damage gives one line, and a killed sweep resumes where it stopped."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

import pytest
from full_disk import full_disk

from tcc_sim.cli import main
from tcc_sim.sweeps.file import SweepFile, decoded_line, encoded_line

WORDS = ["sweep", "slip", "--over", "engine.torque_amplitude=10:40:4", "--cycles", "6", "--solver", "fixed_step"]


def signed(body: str) -> bytes:
    """A line with the checksum of its text, worked out without the package."""
    return f'{body[:-1]}, "crc32": "{zlib.crc32(body[:-1].encode()):08x}"}}\n'.encode()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    """The lines of a finished sweep."""
    out = tmp_path_factory.mktemp("sweep") / "whole.jsonl"
    assert main([*WORDS, "--out", str(out), "--jobs", "1"]) == 0
    return out.read_bytes().splitlines(keepends=True)


def test_every_line_has_the_checksum_of_its_text(whole: list[bytes]) -> None:
    assert len(whole) == 5
    for line in whole:
        values = json.loads(line)
        body = line[:line.rindex(b', "crc32"')]
        assert values["crc32"] == f"{zlib.crc32(body):08x}"
        assert {k: v for k, v in values.items() if k != "crc32"} == {k: v for k, v in decoded_line(line).items()
                                                                     if k != "crc32"}
    assert decoded_line(encoded_line({"curve": 3})) == {"curve": 3}


def body_of(line: bytes) -> str:
    """A line's object without its checksum."""
    return line[:line.rindex(b', "crc32"')].decode() + "}"


def without(line: bytes, key: str) -> bytes:
    """A line whose record lacks a key, signed again."""
    values = json.loads(body_of(line))
    del values["record"][key]
    return signed(json.dumps(values))


HOSTILE = {
    "nan": lambda x: signed(body_of(x).replace('"value": ', '"value": NaN, "was": ')),
    "infinity": lambda x: signed(body_of(x).replace('"value": ', '"value": -Infinity, "was": ')),
    "beyond floats": lambda x: signed(body_of(x).replace('"value": ', '"value": 1e999, "was": ')),
    "many digits": lambda x: signed(body_of(x).replace('"final_cycle": ', '"final_cycle": ' + "9" * 5000)),
    "nested": lambda x: signed('{"record": ' + "[" * 100_000 + "]" * 100_000 + "}"),
    "a list": lambda x: signed("[1, 2]"),
    "no value": lambda x: without(x, "max_slip_speed"),
    "no end": lambda x: without(x, "final"),
    "no cycle": lambda x: without(x, "final_cycle"),
    "words for numbers": lambda x: signed(body_of(x).replace('"period": ', '"period": "many", "was": ')),
    "another curve": lambda x: signed(body_of(x).replace('"curve": 0', '"curve": 7')),
    "below 0": lambda x: signed(body_of(x).replace('"index": ', '"index": -1')),
    "a flipped digit": lambda x: x.replace(b'"stick_fraction": 0', b'"stick_fraction": 1'),
    "no checksum": lambda x: body_of(x).encode() + b"\n",
    "not utf-8": lambda x: b"\xff\xfe" + x,
    "empty": lambda x: b"\n",
}


FIRST = {"a word of the first": lambda x: x.replace(b"fixed_step", b"fixed_stop"),
         "no checksum of the first": lambda x: body_of(x).encode() + b"\n"}


@pytest.mark.parametrize("name", [*HOSTILE, *FIRST])
def test_a_damaged_or_hostile_line_is_one_line_and_the_file_stays(name, whole, tmp_path, refused):
    out, place = tmp_path / "sweep.jsonl", 0 if name in FIRST else 2
    changed = {**HOSTILE, **FIRST}[name](whole[place])
    assert changed != whole[place]
    out.write_bytes(b"".join([*whole[:place], changed, *whole[place + 1:]]))
    before = out.read_bytes()
    assert f"line {place + 1}" in refused(*WORDS, "--out", out)
    assert out.read_bytes() == before


@pytest.mark.parametrize("kept", [lambda x: b"", lambda x: x[:1], lambda x: x[:40], lambda x: x[:x.index(b'"command"')],
                                  lambda x: x[:x.index(b'"--out"') + 20], lambda x: x[:-1]])
def test_a_first_line_that_was_cut_short_is_written_again(kept, whole, tmp_path):
    """Whatever the command was: that of `whole` names another file."""
    out = tmp_path / "sweep.jsonl"
    out.write_bytes(kept(whole[0]))
    words = [*WORDS, "--out", str(out), "--jobs", "1"]
    assert main(words) == 0
    first, old = (decoded_line(lines[0]) for lines in (out.read_bytes().splitlines(keepends=True), whole))
    assert first.pop("command") == words != old.pop("command")
    assert first == old


@pytest.mark.parametrize("change", [lambda x: x[:200].replace(b'"cycles": 6', b'"cycles": 7'), lambda x: b"{}",
                                    lambda x: x[:x.index(b'"scene"')].replace(b"40.0", b"41.0") + b'"scene": {'])
def test_a_first_line_of_another_sweep_that_was_cut_short_stays(change, whole, tmp_path):
    out, changed = tmp_path / "sweep.jsonl", change(whole[0])
    assert not whole[0].startswith(changed)
    out.write_bytes(changed)
    assert main([*WORDS, "--out", str(out)]) == 2
    assert out.read_bytes() == changed


@pytest.mark.parametrize("left", [1, 30])
def test_a_last_line_that_was_cut_short_is_solved_again(left: int, whole: list[bytes], tmp_path: Path) -> None:
    out = tmp_path / "sweep.jsonl"
    out.write_bytes(b"".join(whole[:3]) + whole[3][:left])
    assert main([*WORDS, "--out", str(out), "--jobs", "1"]) == 0
    again = out.read_bytes().splitlines(keepends=True)
    assert again[:3] == whole[:3]

    def untimed(line: bytes) -> object:
        record = json.loads(line)["record"]
        return {k: v for k, v in record.items() if k != "elapsed_s"}

    def by_index(lines: list[bytes]) -> list[bytes]:
        return sorted(lines, key=lambda x: int(json.loads(x)["index"]))  # the file has them as they were done

    assert [untimed(x) for x in by_index(again[1:])] == [untimed(x) for x in by_index(whole[1:])]


def test_a_full_disk_is_said_with_the_name_of_the_file(tmp_path: Path) -> None:
    file = SweepFile(tmp_path / "points.jsonl", {}, lambda *_: None)
    with full_disk(), pytest.raises(OSError, match=r"points\.jsonl"):
        file.append(0, 0, {})
    file.close()


def test_a_point_is_with_the_operating_system_as_soon_as_it_is_appended(tmp_path: Path) -> None:
    out = tmp_path / "sweep.jsonl"
    file = SweepFile(out, {"values": [1.0]}, lambda *_: None)
    assert out.read_bytes().count(b"\n") == 1
    for n in range(3):
        file.append(0, n, {"status": "DONE"})
        lines = out.read_bytes().splitlines(keepends=True)[1:]
        assert [decoded_line(line)["index"] for line in lines] == [*range(n + 1)]
    file.close()
