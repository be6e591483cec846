"""Recordings that are cut, flipped or zeroed anywhere: a result or one line, and no wrong figure without a warning."""

import contextlib
import errno
import os
import random
import struct

import numpy as np
import pytest
import zstandard
from full_disk import full_disk
from test_bag_round_trip import SCENE, TICK, columns, read, write

from tcc_sim.cli import main
from tcc_sim.errors import RecordingError
from tcc_sim.recording import records
from tcc_sim.recording.reader import Run
from tcc_sim.recording.recovery import recover

COUNT = 200


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """Bytes of a recording with pressures in 4 chunks, and the rows in it."""
    rows = columns(COUNT)
    path = write(tmp_path_factory.mktemp("whole") / "run", rows, [n * TICK for n in range(COUNT)],
                 pressures=list(range(COUNT)))
    return path.read_bytes(), rows


def damaged(data, draw):
    """One cut, flip, zeroed or random range at a random place."""
    kind, place = draw.choice(["cut", "flip", "zero", "noise"]), draw.randrange(len(data))
    if kind == "cut":
        return data[:place]
    changed = bytearray(data)
    if kind == "flip":
        changed[place] ^= 1 << draw.randrange(8)
    else:
        for n in range(place, min(place + draw.choice([1, 8, 100, 3000]), len(data))):
            changed[n] = 0 if kind == "zero" else draw.randrange(256)
    return bytes(changed)


def one_line(error):
    """Check that a refusal is one line."""
    assert "\n" not in str(error)
    return "refused"


def check(path, rows):
    """Read it: all states are those of the original, and none is missing without a warning."""
    try:
        run, batches, stamps, table = read(path)
    except RecordingError as error:
        return one_line(error)
    assert (table == rows[stamps // TICK]).all()
    assert (np.diff(stamps) > 0).all()
    assert run.scene_text in (SCENE, None)
    pressure = [b.of("applied_pressure") for b in batches]
    whole = len(stamps) == COUNT and run.scene_text == SCENE and run.complete and all(p is not None for p in pressure)
    if whole:
        values = np.concatenate(pressure)
        assert ((values == stamps // TICK) | np.isnan(values)).all()
        whole = not np.isnan(values).any()
    assert whole or run.warnings
    return "read"


def test_any_damage_ends_with_a_result_or_one_line(tmp_path, original):
    data, rows = original
    draw = random.Random(20)
    outcomes = []
    for _ in range(50):
        path = tmp_path / "x.mcap"
        path.write_bytes(damaged(data, draw))
        outcomes.append(check(path, rows))
    assert outcomes.count("read") > 35


def test_a_scene_with_a_changed_digit_is_not_believed(tmp_path, original):
    data, _ = original
    place = data.index(SCENE.encode())
    for n in range(0, len(SCENE), 3):
        changed = bytearray(data)
        changed[place + n] ^= 1
        (tmp_path / "x.mcap").write_bytes(changed)
        run, _, stamps, _ = read(tmp_path / "x.mcap")
        assert (run.scene_text, len(stamps)) == (None, COUNT)
        assert run.warnings == ["a record that describes the recording is damaged and was ignored"]


def test_recovery_of_damage_is_a_bag_that_reads_without_damage(tmp_path, original):
    data, rows = original
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    draw = random.Random(21)
    for n in range(6):
        path, out = tmp_path / f"{n}.mcap", tmp_path / f"{n}_recovered"
        content = damaged(damaged(data, draw), draw)
        path.write_bytes(content)
        try:
            recovered = recover(Run(path), out)
        except RecordingError as error:
            one_line(error)
            assert not out.exists()
            continue
        assert path.read_bytes() == content
        with rosbag2.Reader(out) as reader:
            assert sum(1 for _ in reader.messages()) == reader.message_count == sum(recovered.messages.values())
        if recovered.messages.get("/joint_states"):
            assert Run(out).complete
            check(out, rows)


def test_the_verb_recovers_beside_the_original_and_says_what_is_missing(tmp_path, original, capsys, refused):
    data, _ = original
    directory = tmp_path / "run"
    directory.mkdir()
    (directory / "run_0.mcap").write_bytes(data[:len(data) // 2])
    assert main(["recover", str(directory)]) == 0
    output = capsys.readouterr().out
    assert f"into {directory}_recovered" in output
    assert "note: the recording was cut short" in output
    run = Run(tmp_path / "run_recovered")
    assert run.complete
    assert run.scene_text == SCENE
    assert 0 < sum(map(len, run.columns().runs)) < COUNT
    assert "exists already" in refused("recover", directory)
    refused("recover", tmp_path / "nothing")


def test_a_new_bag_that_fails_is_taken_away_again(tmp_path, original, capsys):
    path = tmp_path / "x.mcap"
    path.write_bytes(original[0])
    for words, new in ((["recover", str(path)], "x_recovered"), (["import", str(path), str(tmp_path / "run")], "run")):
        with full_disk(5000):
            assert main(words) == 1
        assert capsys.readouterr().err == f"tcc-sim: {tmp_path / new}: {os.strerror(errno.EFBIG)}\n"
        assert not (tmp_path / new).exists()
        assert main(words) == 0
        capsys.readouterr()


def test_a_chunk_that_claims_too_much_is_refused_unread(tmp_path, original):
    data, rows = original
    start = data.index(b"\x04\0\0\0zstd") - 37
    for claim in (1 << 32, 1 << 62):
        changed = bytearray(data)
        struct.pack_into("<Q", changed, start + 25, claim)
        (tmp_path / "x.mcap").write_bytes(changed)
        assert check(tmp_path / "x.mcap", rows) == "read"
    body = bytearray(data[start + 9:start + 9 + struct.unpack_from("<Q", data, start + 1)[0]])
    struct.pack_into("<Q", body, 16, records.LARGEST_CHUNK + 1)
    with pytest.raises(records.DamagedChunk, match="claims"):
        records.unpack_chunk(bytes(body), records.Expansion(len(data)))


@pytest.mark.parametrize("sized", [True, False], ids=["size in the frame", "no size in the frame"])
def test_a_frame_of_zstandard_may_leave_out_its_size_but_not_lie(sized):
    data = random.Random(3).randbytes(1000) * 3
    packer = zstandard.ZstdCompressor(write_content_size=sized)
    for claim, refused in ((len(data), ""), (len(data) + 1, "claims" if sized else "instead of"), (len(data) - 1, ".")):
        with pytest.raises(records.DamagedChunk, match=refused) if refused else contextlib.nullcontext():
            assert records.unpack_chunk(packed(packer.compress(data), claim), records.Expansion(1 << 20)) == data


def packed(frame, size):
    """The body of a chunk in which a frame of Zstandard claims to unpack to `size` bytes."""
    return struct.pack("<QQQII", 0, 0, size, 0, 4) + b"zstd" + struct.pack("<Q", len(frame)) + frame
