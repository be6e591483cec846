"""Recordings made to cost time, memory or the reader's screen: stated limits hold, and a sentence names them."""

from __future__ import annotations

import json
import os
import struct
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
import zstandard
from driveline_bags import TICK, bag, ticked
from mcap.opcode import Opcode

from tcc_sim.cli import main
from tcc_sim.errors import InputError, RecordingError
from tcc_sim.messages import cdr
from tcc_sim.parameter_file import LARGEST_FILE
from tcc_sim.recording import contents, records
from tcc_sim.recording.mcap_file import RECOVERY_RECORD, RESULT_RECORD, SCENE_RECORD, McapFile, digest
from tcc_sim.recording.reader import Run
from tcc_sim.recording.recovery import recover
from tcc_sim.replay.recorded import read
from tcc_sim.replay.replay import replay
from tcc_sim.replay.verification import SMALLEST_WORK, WORK_PER_BYTE, verify
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLOAT64_ARRAY, JOINT_STATE

MEMORY = 250 << 20
"""Bytes that reading a file of some kB may take at most."""
SCENE = load_scene("minimal")


def word(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def pairs(values: dict[str, str]) -> bytes:
    body = b"".join(word(key) + word(value) for key, value in values.items())
    return struct.pack("<I", len(body)) + body


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def chunk(data: bytes) -> bytes:
    packed = zstandard.ZstdCompressor().compress(data)
    return record(Opcode.CHUNK, struct.pack("<QQQI", 0, 0, len(data), zlib.crc32(data)) + word("zstd") +
                  struct.pack("<Q", len(packed)) + packed)


def schema(number: int = 1) -> bytes:
    return record(Opcode.SCHEMA, struct.pack("<H", number) + word(JOINT_STATE) + word("ros2msg") + word("x"))


def channel(number: int, topic: str = "/joint_states", metadata: dict[str, str] | None = None) -> bytes:
    return record(Opcode.CHANNEL, struct.pack("<HH", number, 1) + word(topic) + word("cdr") + pairs(metadata or {}))


def message(number: int, stamp_ns: int, values: tuple[float, ...] = (0.0,) * 6) -> bytes:
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", number, 0, 0, 0) + cdr.joint_state(stamp_ns, *values))


def metadata(name: str, values: dict[str, str]) -> bytes:
    return record(Opcode.METADATA, word(name) + pairs(values))


def result(name: str, value: object) -> bytes:
    text = value if isinstance(value, str) else json.dumps(value)
    return metadata(name, {"result": text, "sha256": digest(text)})


def scene(text: str = "") -> bytes:
    text = text or SCENE.text()
    return metadata(SCENE_RECORD, {"version": "1", "scene": text, "log_time": "0", "sha256": digest("1", text, "0")})


def written(path: Path, *parts: bytes) -> Path:
    path.write_bytes(records.MAGIC + b"".join(parts))
    return path


def cost(path: Path) -> tuple[str, int]:
    """Result of reading in words, and the most memory of Python and NumPy, bytes."""
    tracemalloc.start()
    try:
        run = Run(path)
        said = f"{sum(map(len, run.columns().runs))} read; {'; '.join(run.warnings)}"
    except RecordingError as error:
        said = str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return said, peak


def test_a_chunk_of_nothing_but_records_is_left_out(tmp_path: Path) -> None:
    empty = chunk(record(15, b"") * (60 << 20 >> 4))
    path = written(tmp_path / "x.mcap", *[empty] * 3)
    assert path.stat().st_size < 100_000
    said, peak = cost(path)
    assert f"more than {records.MOST_DESCRIPTIONS} of its records are not messages" in said or "would unpack" in said
    assert peak < MEMORY


def test_what_a_file_may_unpack_to_is_16_mib_and_a_hundred_times_its_size_and_ten_times_as_much_unused() -> None:
    limit = (16 << 20) + 100 * 7
    for used, most in ((True, limit), (False, 10 * limit)):
        expansion = records.Expansion(7)
        expansion.take(most - 5, used)
        expansion.take(5, used)
        expansion.take(1, not used)
        with pytest.raises(records.DamagedChunk, match=f"would unpack to more than {most} bytes"):
            expansion.take(1, used)


def test_chunks_that_unpack_to_too_much_together_are_left_out(tmp_path: Path) -> None:
    full = chunk(record(Opcode.MESSAGE, struct.pack("<HIQQ", 9, 0, 0, 0) + bytes(20_000)) * 200)
    path = written(tmp_path / "x.mcap", schema(), channel(1), chunk(message(1, TICK)), *[full] * 10)
    limit = records.SMALLEST_EXPANSION + records.LARGEST_EXPANSION * path.stat().st_size
    said, peak = cost(path)
    assert f"the recording would unpack to more than {limit} bytes" in said
    assert said.startswith("1 read")
    assert peak < MEMORY


def test_arrays_of_other_programs_do_not_count_as_used(tmp_path: Path) -> None:
    grids = {k: [("/grid", FLOAT64_ARRAY, 0, 0, cdr.float64_array("", [0.0] * 60_000))] for k in range(100)}
    bag(tmp_path / "run", ticked(load_scene("fig02"), 100), "fig02", joined=grids)
    assert len(Run(tmp_path / "run").columns().runs[0]) == 100


def test_more_topics_than_any_recording_has_are_passed_over(tmp_path: Path) -> None:
    count = contents.MOST_TOPICS + 50
    many = b"".join(channel(n, f"/{n}/x") for n in range(count))
    run = Run(written(tmp_path / "x.mcap", chunk(schema() + many), channel(count, "/joint_states"), schema(),
                           channel(1), chunk(message(1, TICK))))
    list(run.columns().runs)
    assert len(run.topics) == contents.MOST_TOPICS


def test_extreme_stamps_are_a_sentence_and_no_memory(tmp_path: Path, refused: Callable[..., str]) -> None:
    states = chunk(b"".join(message(1, n * 10**17) for n in range(20)))
    path = written(tmp_path / "x.mcap", scene(), schema(), channel(1), states)
    assert "a period of excitation takes" in refused("analyse", path, "--verify")


def test_a_gap_of_years_is_not_solved_through(tmp_path: Path) -> None:
    rows = ticked(SCENE, 300)
    late = [(stamp + 10**15, *rest) for stamp, *rest in rows[150:]]
    outcome = replay(bag(tmp_path / "run", rows[:150] + late, SCENE), discard=0, verify=True).verification
    assert outcome is not None
    assert (outcome.verified, outcome.compared, outcome.exact) == (False, 300,
                                                                   150)  # The phase of the excitation differs.
    outcome = replay(bag(tmp_path / "same", rows[:150] + late[:1], SCENE), discard=0, verify=True).verification
    assert outcome is not None
    assert "1 gap could not be solved through within the limit" in outcome.sentence


def test_work_that_a_scene_asks_for_is_bounded_by_the_size_of_the_file(tmp_path: Path) -> None:
    rows = ticked(SCENE, 300)
    line = read(bag(tmp_path / "run", rows[50:], SCENE)).line()
    assert verify(line, 0).verified
    outcome = verify(line, (1000 - SMALLEST_WORK) // WORK_PER_BYTE)
    assert not outcome.verified
    assert "1000 sub-steps, the most allowed for a recording of its size" in outcome.sentence


def test_damaged_places_are_named_up_to_a_number(tmp_path: Path) -> None:
    broken = bytearray(chunk(message(1, 0)))
    broken[-3] ^= 1
    run = Run(written(tmp_path / "x.mcap", schema(), channel(1), chunk(message(1, TICK)), bytes(broken) * 500))
    assert sum(map(len, run.columns().runs)) == 1
    assert sum("is left out" in sentence for sentence in run.warnings) == records.MOST_SENTENCES
    assert f"{500 - records.MOST_SENTENCES} more places damaged" in run.warnings


DAMAGED = {
    "metadata": (metadata(SCENE_RECORD, {"scene": "x"}), "more records that may describe the recording were not read"),
    "channel": (record(Opcode.CHANNEL, b"\1\0"), "more records that may describe the recording were not read"),
    "chunk without fields": (record(Opcode.CHUNK, b"ab"), "980 more places damaged"),
    "message without fields": (record(Opcode.MESSAGE, b""), "980 more places damaged"),
    "chunk that does not unpack": (record(Opcode.CHUNK, struct.pack("<QQQI", 5, 6, 9, 0) + word("xz") + struct.pack(
        "<Q", 4) + b"abcd"), "chunks are damaged"),
}


@pytest.mark.parametrize("kind", DAMAGED)
def test_thousands_of_damaged_records_are_left_out_and_what_is_before_them_is_saved(tmp_path: Path, kind: str,
                                                                                    capsys: pytest.CaptureFixture[str]
                                                                                    ) -> None:
    damaged, sentence = DAMAGED[kind]
    count = 1000 if "without fields" in kind else contents.MOST_DAMAGED + 100
    states = chunk(b"".join(message(1, n * TICK) for n in range(60)))
    path = written(tmp_path / "x.mcap", scene(), schema(), channel(1), states, damaged * count)
    assert main(["recover", str(path)]) == 0
    out = capsys.readouterr().out
    assert "recovered 60 messages" in out
    assert sentence in out


VALUES = [[], 3, "text", None, {"a": [1]}, {"lost": [1]}, {"lost": {"/x": "many"}},
          {"lost": {"/x": 1e999}}, {"lost": {"/x": 10**30}}, {"solver": 5}, "[" * 5000, "NaN", "9" * 5000,
          {"messages": {"/x": []}, "missing_stamps": 3, "unsent": {"/x": -1}}, ["\x1b[2J" * 1000] * 500]


@pytest.mark.parametrize("value", VALUES, ids=lambda value: str(value)[:20])
def test_records_of_any_value_are_used_or_passed_over(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                      value: object) -> None:
    text = value if isinstance(value, str) and value != "text" else json.dumps(value)
    states = chunk(b"".join(message(1, n * TICK) for n in range(60)))
    path = written(tmp_path / "x.mcap", scene(), result(RESULT_RECORD, text), result(RECOVERY_RECORD, text), schema(),
                   channel(1), states)
    assert main(["analyse", str(path)]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert len(captured.out) < 5000
    assert all(line.isprintable() for line in captured.out.splitlines())
    assert main(["recover", str(path)]) == 0
    assert capsys.readouterr().err == ""


def test_recovery_parses_so_much_quality_of_service_and_no_more(tmp_path: Path) -> None:
    """100 topics with 19 000 characters each; beyond 400 000 characters topics get the driveline's."""
    many = b"".join(channel(n, f"/{n}", {"offered_qos_profiles": f"- depth: {n + 1000}\n" + " " * 18_987})
                    for n in range(100))
    path = written(tmp_path / "x.mcap", chunk(schema() + many + b"".join(message(n, TICK) for n in range(100))))
    assert sum(recover(Run(path), tmp_path / "saved").messages.values()) == 100
    saved = yaml.safe_load((tmp_path / "saved" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    offered = [row["topic_metadata"]["offered_qos_profiles"][0]["depth"]
               for row in saved["topics_with_message_count"]]
    assert sum(depth >= 1000 for depth in offered) == 400_000 // 19_000


@pytest.mark.parametrize(("name", "content"), [
    ("run_3.mcap", b""), ("run_1.mcap", records.MAGIC[:7]), ("notes.mcap", b"not a recording at all\n" * 9)])
def test_a_part_that_cannot_be_read_does_not_cost_the_others(tmp_path: Path, content: bytes, name: str,
                                                             capsys: pytest.CaptureFixture[str]) -> None:
    path = bag(tmp_path / "run", ticked(SCENE, 300), SCENE, max_duration=0.1)
    (path / name).write_bytes(content)
    lost = 100 * (name == "run_1.mcap")
    run = Run(path)
    assert sum(map(len, run.columns().runs)) == 300 - lost
    assert [text for text in run.warnings if name in text and text.startswith("left out")]
    assert run.complete is (name != "run_1.mcap")
    assert main(["analyse", str(path)]) == 0
    assert name in capsys.readouterr().out
    assert main(["recover", str(path)]) == 0
    assert sum(map(len, Run(tmp_path / "run_recovered").columns().runs)) == 300 - lost


def test_nothing_but_parts_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    for number in range(2):
        (tmp_path / "run" / f"run_{number}.mcap").write_bytes(b"")
    with pytest.raises(RecordingError, match=r"run_0\.mcap: it is not an MCAP file"):
        Run(tmp_path / "run")


def test_a_pipe_is_no_recording_and_keeps_nobody_waiting(tmp_path: Path, refused: Callable[..., str]) -> None:
    os.mkfifo(tmp_path / "x.mcap")
    assert "is not a regular file" in refused("analyse", tmp_path / "x.mcap")


def test_times_near_the_end_of_the_clock_stay_in_one_part(tmp_path: Path) -> None:
    late = [record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, n, 2**64 - 50 + n if n % 2 else n, n) +
                   cdr.joint_state(n * TICK, *(0.0,) * 6)) for n in range(40)]
    path = written(tmp_path / "x.mcap", schema(), channel(1), chunk(b"".join(late)))
    saved = recover(Run(path), tmp_path / "saved")
    assert saved.messages == {"/joint_states": 40}
    assert sorted(part.name for part in (tmp_path / "saved").iterdir()) == ["metadata.yaml", "saved_0.mcap"]


def test_quality_of_service_with_chained_merge_keys_is_not_followed(tmp_path: Path) -> None:
    chain = "- &a0 {x: 1}\n" + "".join(f"- &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 9)}]}}\n" for n in range(1, 40))
    path = written(tmp_path / "x.mcap", chunk(schema() + channel(1, metadata={"offered_qos_profiles": chain})
                                              + message(1, TICK)))
    assert recover(Run(path), tmp_path / "saved").messages == {"/joint_states": 1}


def test_a_scene_is_as_long_for_the_writer_as_for_the_reader(tmp_path: Path) -> None:
    text = SCENE.text() + "# " + "\u00e4" * (LARGEST_FILE - len(SCENE.text()) - 3) + "\n"
    assert len(text) == LARGEST_FILE
    path = tmp_path / "x.mcap"
    output = McapFile(path, text)
    with pytest.raises(InputError, match=f"{LARGEST_FILE + 1}.*{LARGEST_FILE}"):
        output.describe(text + "#")
    output.close()
    assert Run(path).scene_text == text
    longer = Run(written(tmp_path / "y.mcap", scene(text + "#"), schema(), channel(1), chunk(message(1, TICK))))
    list(longer.columns().runs)
    assert longer.scene_text is None
    assert "a record that describes the recording is damaged and was ignored" in longer.warnings
