"""Functions of the reader on messages and names made by hand: times, layouts, names of parts, limits and choices."""

import json
import math
import os
import struct
import zlib
from dataclasses import is_dataclass, replace
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import SimpleNamespace

import lz4.frame
import numpy as np
import pytest
import yaml
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader

import tcc_sim.recording
from tcc_sim.errors import InputError, RecordingError
from tcc_sim.messages import cdr
from tcc_sim.parameter_file import LARGEST_FILE
from tcc_sim.recording import layouts, records
from tcc_sim.recording.announcements import SceneRecord
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.columns import GrowingStates, JoinedTopic, JointStates, joined_topics, receipt_times
from tcc_sim.recording.commands import Commands, _by_clock, _Clock, _decoded, _delay, _none, _Sent
from tcc_sim.recording.contents import MOST_TOPICS, Batch, Channel, Contents, together
from tcc_sim.recording.drivelines import (
    Choice,
    Inventory,
    RecordedDriveline,
    _Announced,
    joints_sentence,
    same_process,
)
from tcc_sim.recording.layouts import Layouts
from tcc_sim.recording.mcap_file import _CHUNK_SIZE, FileSummary, McapFile, digest, information
from tcc_sim.recording.parts import (
    Parts,
    in_order,
    missing_parts,
    named_as_part,
    open_file,
    parts_of,
    records_of,
    unpacked_file,
)
from tcc_sim.recording.reader import BYTES_A_STATE, TooManyStates, open_run
from tcc_sim.recording.recovery import _parsed, default_directory
from tcc_sim.recording.stamps import Break, StampCounter
from tcc_sim.topics import DIAGNOSTIC_ARRAY, FLOAT64, FLUID_PRESSURE, JOINT_STATE, STRING

NONE = np.empty(0, np.int64)
YEAR = 365 * 86_400 * 10**9


def chunk(*bodies, log=5, sent=7, channel=1):
    """Message records one behind another, and their positions."""
    rows = [struct.pack("<HIQQ", channel, n, log, sent) + body for n, body in enumerate(bodies)]
    return records.joined(rows, np.full(len(rows), channel, np.uint16))


def test_times_of_receipt_a_year_early_are_simulation_time():
    sent = np.array([YEAR, YEAR + 1, 7, 3 * YEAR])
    assert receipt_times(np.array([0, 0, 9, 5]), sent).tolist() == [0, YEAR + 1, 9, 3 * YEAR]


@pytest.mark.parametrize(("log", "less", "delay"), [
    ([], [], []), ([0], [5], [5]), ([0, 4, 6], [5, 3, 9], [3, 3, 3]),
    # A stretch of half a second with ten messages needs no other one; one with nine takes the least of its neighbours.
    ([*range(10), *range(5 * 10**8, 5 * 10**8 + 10)], [7] * 10 + [4] * 10, [7] * 10 + [4] * 10),
    ([*range(10), *range(5 * 10**8, 5 * 10**8 + 9)], [4] * 10 + [7] * 9, [4] * 19),
    ([*range(9), *range(5 * 10**8, 5 * 10**8 + 10)], [7] * 9 + [4] * 10, [4] * 19),
    ([*range(9), *range(5 * 10**8, 5 * 10**8 + 10)], [3] * 9 + [4] * 10, [3] * 9 + [4] * 10),
    ([*range(10), 5 * 10**8, *range(10**9, 10**9 + 10), *range(2 * 10**9, 2 * 10**9 + 10)],
     [6] * 10 + [9] + [5] * 10 + [1] * 10, [6] * 10 + [5] + [5] * 10 + [1] * 10)])
def test_the_difference_of_clocks_is_the_shortest_time_to_receipt(log, less, delay):
    log = np.array(log, np.int64)
    assert _delay(log, log - np.array(less, np.int64)).tolist() == delay


def test_commands_of_each_publisher_are_moved_to_the_recorders_clock():
    def sent(publisher, times, log):
        n = len(times)
        return _Sent(np.arange(n), *map(np.array, (publisher, times, log)), np.arange(n) * 1.0, np.full(n, -1), 0, 9)

    chunks = _by_clock([sent([0, 1, 0], [10, 400, 30], [13, 15, 34]), sent([1], [440], [48])], _delay)
    assert [one.times.tolist() for one in chunks] == [[8, 13, 33], [48]]
    assert [one.values.tolist() for one in chunks] == [[1.0, 0.0, 2.0], [0.0]]
    # The order of sending; but that of the file where the clock was set back, by more than 50 ms.
    for back, order in ((50_000_000, [1, 0]), (50_000_001, [0, 1])):
        assert sent([0, 0], [back, 0], [back, 0]).by(np.zeros(2, np.int64)).values.tolist() == order


def diagnostics(values):
    """A DiagnosticArray with one status, by the rules of CDR."""
    out = bytearray(struct.pack("<iI", 1, 0))

    def text(word):
        out.extend(b"\0" * (-len(out) % 4) + struct.pack("<I", len(word) + 1) + word.encode() + b"\0")

    text("")
    out.extend(b"\0" * (-len(out) % 4) + struct.pack("<I", 1) + b"\0")
    for word in ("driveline", "running", "id"):
        text(word)
    out.extend(b"\0" * (-len(out) % 4) + struct.pack("<I", len(values)))
    for key, value in values.items():
        text(key)
        text(value)
    return b"\0\1\0\0" + bytes(out)


def test_counts_of_diagnostics_are_added_over_drivelines():
    commands = Commands("/a/joint_states", NONE)
    channels = {1: Channel("/diagnostics", DIAGNOSTIC_ARRAY, ""), 2: Channel("/diagnostics", FLOAT64, "")}
    for rows in ([{"late ticks": "3", "engine_torque refused": "2"}, {"late ticks": "5", "other": "9"}],
                 [{"late ticks": "1", "missed ticks": "x"}, {"late ticks": "1" * 19}, {"paced ticks": "1" * 18}]):
        data, messages = chunk(b"\0\1\0\0", *map(diagnostics, rows))
        commands.take(data, messages, channels, 0, 0)
    data, messages = chunk(diagnostics({"late ticks": "50"}), channel=2)
    commands.take(data, messages, channels, 0, 0)
    assert dict(commands.counts) == {"late ticks": 6, "engine_torque refused": 2, "paced ticks": int("1" * 18)}
    assert (commands.sources, commands.aligned([])) == ((), {})


def states(stamps, run=0, **columns):
    stamps = np.array(stamps, np.int64)
    return JointStates(stamps, stamps + 1, stamps + 2, *np.arange(6.0)[:, None] * stamps, run=run, **columns)


def test_states_grow_and_are_joined_with_their_pressures_run_by_run():
    growing = GrowingStates()
    for part in (states(range(70_000)), states(range(70_000, 70_003)), states([5, 6], 1, began=Break.RESET)):
        growing.add(part)
    pressure, far = joined_topics("/a/joint_states", NONE)
    assert (pressure.topic, far.topic, far.type, [*far.columns]) == (
        "/a/applied_pressure", "/a/output_state", JOINT_STATE, ["output_angle", "output_speed"])
    data, messages = chunk(*(cdr.fluid_pressure(stamp, stamp + 0.5) for stamp in (3, 70_002)))
    pressure.take(data=np.frombuffer(data, np.uint8), messages=messages, channels=[1], runs=1,
                  publishers=lambda heads: np.zeros(len(heads), np.int64))
    (first, second), missing = growing.runs([pressure])
    assert (len(first), first.index, second.index, second.run, second.began) == (70_003, 0, 70_003, 1, Break.RESET)
    assert first.friction_torque[[1, -1]].tolist() == [5.0, 5.0 * 70_002]
    assert (first.log_ns[-1], first.sent_ns[-1], second.stamp_ns.tolist()) == (70_003, 70_004, [5, 6])
    assert np.flatnonzero(np.isfinite(first.applied_pressure)).tolist() == [3, 70_002]
    assert first.applied_pressure[[3, 70_002]].tolist() == [3.5, 70_002.5]
    assert (np.isnan(second.applied_pressure).all(), missing, first.output_angle) == (True, 70_003, None)
    assert [len(part) for part in first.blocks()] == [65536, 4467]
    assert [(part.index, len(part)) for part in second.blocks(1)] == [(70_003, 1), (70_004, 1)]
    assert (first[5:9].index, first[5:9].plate_angle.tolist()) == (5, [5.0, 6.0, 7.0, 8.0])
    assert first[np.arange(70_003) == 7].plate_angle.tolist() == [7.0]
    assert isinstance(pressure, JoinedTopic)


@pytest.mark.parametrize(("names", "numbers", "part", "order"), [
    (["a_0.mcap", "a_2.mcap", "a_10.mcap"], [1, 3, 4, 5, 6, 7, 8, 9], True, None),
    (["0_a_2026_01_02-03_04_05.mcap", "2_a_2026_01_02-03_04_06.mcap"], [1], True, None),
    (["a_1.mcap.zstd", "a_2.mcap"], [0], True, None), (["a_1.mcap", "b_3.mcap"], [], True, None),
    (["a_5.mcap"], [], True, None), (["one.mcap", "two.mcap"], [], False, None),
    (["a_0.mcap", "notes.mcap"], [], None, None)])
def test_names_of_parts_show_which_are_missing(names, numbers, part, order):
    paths = [Path(name) for name in names]
    assert missing_parts(paths) == numbers
    assert part is None or {named_as_part(path) for path in paths} == {part}
    assert in_order(paths, [5] * len(paths)) == paths
    assert in_order(paths, [*range(len(paths), 0, -1)]) == paths[::-1]


def test_sentences_on_parts_are_at_most_twenty_of_a_kind():
    absent, more = [f"a_{n}.mcap" for n in range(22)], [f"b_{n}.mcap" for n in range(23)]
    said = [*Parts([], True, absent, more, "note").sentences()]
    assert said[0] == "note"
    assert said[1:21] == [f"the part {name}, which metadata.yaml lists, is missing" for name in absent[:20]]
    assert said[21] == "2 more parts are missing"
    assert said[22:42] == [f"left out: metadata.yaml does not list {name}" for name in more[:20]]
    assert said[42:] == ["left out: 3 more files that metadata.yaml does not list"]
    assert len([*Parts([], True, absent[:20], more[:20]).sentences()]) == 40


SQLITE = ("{0} is a bag in SQLite, which is not read; convert it to MCAP with rosbags-convert --src {0} --dst {0}_mcap "
          "--dst-storage mcap (from pip install rosbags)")


@pytest.mark.parametrize(("files", "metadata", "taken", "said"), [
    (["b_10.mcap", "b_9.mcap", "x.txt"], None, ["b_9.mcap", "b_10.mcap"], []), (["b_0.mcap"], None, ["b_0.mcap"], []),
    (["b_0.mcap", "b_1.mcap.zstd"], None, ["b_0.mcap", "b_1.mcap.zstd"], []),
    (["b_0.mcap", "b_1.mcap", "c.mcap"], ["x/b_1.mcap", "b_0.mcap", "b_7.mcap", "b_1.mcap"], ["b_1.mcap", "b_0.mcap"],
     ["the part b_7.mcap, which metadata.yaml lists, is missing", "left out: metadata.yaml does not list c.mcap"]),
    (["c.mcap", "d.mcap"], ["b_7.mcap"], ["c.mcap", "d.mcap"],
     ["the part b_7.mcap, which metadata.yaml lists, is missing"]),
    (["c.mcap"], [], ["c.mcap"], ["metadata.yaml lists no parts that can be read: the log times of the parts give "
     "their order"]),
    (["c.mcap"], [7], ["c.mcap"], ["metadata.yaml lists no parts that can be read: the log times of the parts give "
     "their order"]),
    ([], None, "{0} holds no .mcap file", []), (["x.db3"], None, SQLITE, []), (["x.db3.zstd"], None, SQLITE, []),
    (["x.mcap.lz4"], None, "{0}/x.mcap.lz4 is compressed as .lz4, which is not read; unpack it, or record with "
     "--compression-format zstd", []),
    (["x.bag"], None, "{0}/x.bag is a bag of ROS 1, which is not read; convert it with rosbags-convert --src "
     "{0}/x.bag --dst {0}/x --dst-storage mcap (from pip install rosbags)", []),
    (["in/b_0.mcap"], None, ["b_0.mcap"], []),
    (["in/b.mcap", "more/c.mcap.zstd"], None, "{0} holds no .mcap file; {0}/in and 1 more folder in it hold some: "
     "name one of them", [])])
def test_the_files_of_a_folder(tmp_path, files, metadata, taken, said):
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    if metadata is not None:
        (tmp_path / "metadata.yaml").write_text(json.dumps(
            {"rosbag2_bagfile_information": {"relative_file_paths": metadata}}))
    if isinstance(taken, str):
        with pytest.raises(RecordingError) as error:
            parts_of(tmp_path)
        assert str(error.value) == taken.format(tmp_path)
        return
    parts = parts_of(tmp_path)
    assert ([path.name for path in parts.paths], [*parts.sentences()]) == (taken, said)
    assert parts.ordered is (len(files) == 1 or (metadata is not None and len(said) == 2))


def test_files_that_are_none_are_refused(tmp_path):
    for name in ("x.db3", "x.db3.zstd"):
        with pytest.raises(RecordingError) as error:
            parts_of(tmp_path / name)
        assert str(error.value) == SQLITE.format(tmp_path)
    assert parts_of(tmp_path / "x.mcap").paths == [tmp_path / "x.mcap"]
    with pytest.raises(RecordingError, match=r"none cannot be read: No such file or directory$"):
        open_file(tmp_path / "none")
    with pytest.raises(RecordingError, match=f"{tmp_path} is not a regular file$"):
        open_file(tmp_path)
    packed = tmp_path / "x.mcap.zstd"
    packed.write_bytes(zstandard.compress(b"one") + zstandard.compress(b"two"))
    with open_file(packed) as file, unpacked_file(packed, file) as unpacked:
        unpacked.seek(0)
        assert unpacked.read() == b"onetwo"
    packed.write_bytes(b"one")
    with open_file(packed) as file:
        assert (unpacked_file(packed, file), file.read()) == (None, b"one")
    assert default_directory(packed) == tmp_path / "x.mcap_recovered"
    assert default_directory(tmp_path) == tmp_path.parent / f"{tmp_path.name}_recovered"


def chunk_record(data, compression="", size=None, checksum=None, packed=None):
    word = compression.encode()
    packed = data if packed is None else packed
    return (struct.pack("<QQQI", 0, 0, len(data) if size is None else size, zlib.crc32(data) if checksum is None else
     checksum)
            + struct.pack("<I", len(word)) + word + struct.pack("<Q", len(packed)) + packed)


DATA = b"a chunk's records"
FRAME = lz4.frame.compress(DATA)


@pytest.mark.parametrize(("body", "why"), [
    (chunk_record(DATA), None), (chunk_record(DATA, checksum=0), None), (chunk_record(DATA, "lz4", packed=FRAME), None),
    (chunk_record(DATA, "zstd", packed=zstandard.compress(DATA)), None), (chunk_record(b"", "zstd"), None),
    (chunk_record(DATA, checksum=1), "its checksum is wrong"), (chunk_record(DATA)[:9], "its fields do not fit into "
     "it"),
    (chunk_record(DATA, size=18), "it unpacks to 17 bytes instead of 18"),
    (chunk_record(DATA, "lz4", packed=FRAME, size=16), "it unpacks to 17 bytes instead of 16"),
    (chunk_record(DATA, "lz4", packed=FRAME, size=9), "it unpacks to 10 bytes instead of 9"),
    (chunk_record(DATA, "zstd", packed=zstandard.compress(DATA), size=9), "it claims 17 bytes in one place and 9 in "
     "another"),
    (chunk_record(DATA, "bz2"), "its compression 'bz2' is unknown"),
    (chunk_record(DATA, size=(256 << 20) + 1), "it claims 268435457 bytes; at most 268435456 are accepted"),
    (chunk_record(DATA, size=168 << 20), "with it the recording would unpack to more than 167772160 bytes, the most "
     "allowed for a file of its size")])
def test_a_chunk_is_whole_or_refused(body, why):
    if why is None:
        assert records.unpack_chunk(body, records.Expansion(0)) in (DATA, b"")
        return
    with pytest.raises(records.DamagedChunk) as error:
        records.unpack_chunk(body, records.Expansion(0))
    assert str(error.value) == why


def test_damaged_places_and_messages_compressed_alone():
    warnings = records.Warnings()
    for n in range(20):
        warnings.place(str(n))
    warnings.conclude()
    assert warnings == [*map(str, range(20))]
    warnings.place("20")
    warnings.conclude()
    warnings.conclude()
    assert warnings[20:] == ["1 more place damaged"]
    data, messages = chunk(zstandard.compress(b"\0\1\0\0one"), b"\0\1\0\0two", zstandard.compress(b""))
    text = np.frombuffer(data, np.uint8)
    assert records.starts_with(text, messages.offset, messages.length, records.ZSTD).tolist() == [True, False, True]
    data, messages = records.uncompressed(data, messages, np.array([True, True, True]), records.Expansion(0))
    assert [data[k + 22:k + n] for k, n in zip(messages.offset.tolist(), messages.length.tolist())] == [
        b"\0\1\0\0one", b"\0\1\0\0two", b""]
    assert messages.channel.tolist() == [1, 1, 1]
    for content, why in ((zstandard.ZstdCompressor(write_content_size=False).compress(b"x" * 99), "a compressed "
     "message in it does not give its size, or one above 268435456 bytes"),
                         (zstandard.compress(b"x" * 99)[:-3], "a compressed message in it does not unpack")):
        with pytest.raises(records.DamagedChunk, match=why):
            records.uncompressed(*chunk(content), np.array([True]), records.Expansion(0))


def test_messages_without_times_are_numbered_by_their_places():
    data, messages = chunk(b"abcd", b"ef", log=0, sent=0)
    numbered = records.with_places(data, messages, 40)
    assert [numbered[k:k + n] for k, n in zip(messages.offset.tolist(), messages.length.tolist())] == [
        struct.pack("<HIQQ", 1, 0, 41, 0) + b"abcd", struct.pack("<HIQQ", 1, 1, 42, 0) + b"ef"]
    assert records.with_places(*chunk(b"abcd", log=0, sent=1), 0) is records.with_places(*chunk(), 0) is None


def entry(*pairs, channel=3):
    body = b"".join(struct.pack("<QQ", *pair) for pair in pairs)
    return struct.pack("<HI", channel, len(body)) + body


def test_messages_of_a_chunk_by_index_or_one_by_one():
    def record(opcode, body):
        return struct.pack("<BQ", opcode, len(body)) + body

    one, two = (struct.pack("<HIQQ", channel, 0, 0, 0) + b"data" for channel in (3, 4))
    data = record(Opcode.CHANNEL, b"abc") + record(Opcode.MESSAGE, one) + record(Opcode.MESSAGE, two)
    whole = [entry((0, 47 - 35), channel=3), entry((0, 47), channel=4)]
    for indexes in (whole, whole[:1], [], [b"\0"], [entry((0, 1))], [entry((0, 10**6))]):
        found = records.find_messages(data, indexes)
        assert (found.offset.tolist(), found.length.tolist(), found.channel.tolist(), found.others) == (
            [21, 56], [26, 26], [3, 4], [(Opcode.CHANNEL, 9, 3)])
    assert records.indexed([*whole, entry((0, 1), (0, 2)), b"\0\0\0"]) == {3: 3, 4: 1}
    for broken in (data[:-1], data + b"\1", record(Opcode.MESSAGE, one[:21])):
        with pytest.raises(records.DamagedChunk, match=r"^its records do not fit into it$"):
            records.find_messages(broken, [])
    assert len(records.find_messages(b"", []).offset) == 0


def test_records_of_other_programs_and_damaged_ones_are_counted():
    def metadata(name, **values):
        pairs = b"".join(b"".join(struct.pack("<I", len(w.encode())) + w.encode() for w in pair) for pair in
         values.items())
        return struct.pack("<I", len(name)) + name.encode() + struct.pack("<I", len(pairs)) + pairs

    contents = Contents()
    for name, text, damaged in (("rosbag2", "", 0), ("other", "", 0), ("tcc_sim_result", '{"lost": {}}', 0),
                                ("tcc_sim_result", "[]", 1), ("tcc_sim_recovery", '["a"]', 1), ("tcc_sim_recovery",
                                 "[1]", 2),
                                ("tcc_sim_recovery", "{}", 3), ("tcc_sim_result", "{", 4)):
        contents.add(Opcode.METADATA, metadata(name, result=text, sha256=digest(text)))
        assert contents.damaged == damaged
    for digits, damaged in (("1" * 19, 4), ("1" * 20, 5)):
        contents.add(Opcode.METADATA, metadata("tcc_sim", version="1", scene="a", log_time=digits,
                                               sha256=digest("1", "a", digits)))
        assert contents.damaged == damaged
    contents.add(Opcode.METADATA, metadata("tcc_sim", version="1", scene="a", log_time="1", sha256="x"))
    contents.add(Opcode.METADATA, metadata("tcc_sim_result", result="{}", sha256="x"))
    contents.add(Opcode.METADATA, metadata("other", a="b"), checked=True)
    contents.add(Opcode.ATTACHMENT, b"")
    assert (contents.result, contents.foreign, contents.attachments, len(contents.scenes), contents.damaged) == (
        {"lost": {}}, 1, 1, 1, 7)
    assert contents.warnings() == ["7 records that describe the recording are damaged and were ignored",
                                   "missing before the recovery: a"]
    assert Contents(damaged=1).warnings() == ["a record that describes the recording is damaged and was ignored"]
    many = Contents()
    for count, said in ((20, 20), (22, 21)):
        text = json.dumps([f"loss {n}" for n in range(count)])
        many.add(Opcode.METADATA, metadata("tcc_sim_recovery", result=text, sha256=digest(text)))
        assert len(many.recovered) == said
    assert many.recovered[19:] == ["missing before the recovery: loss 19", "missing before the recovery: 2 more places"]
    many.add(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 77, 5))
    many.add(Opcode.CHUNK, struct.pack("<QQQ", 66, 0, 0))
    assert many.first_ns == 77
    many.add(Opcode.CHUNK, struct.pack("<QQQ", 66, 0, 1))
    assert many.first_ns == 66
    many.add(Opcode.CHUNK, b"")
    assert many.damaged == 1
    for number in range(MOST_TOPICS):
        many._keep(many.schemas, number, (str(number), ""), False)
    many._keep(many.schemas, 5, ("again", ""), False)
    assert many.schemas[5] == ("5", "")
    many._keep(many.schemas, 5, ("checked", ""), True)
    assert many.schemas[5] == ("checked", "")
    with pytest.raises(ValueError, match="too many topics"):
        many._keep(many.schemas, MOST_TOPICS, ("", ""), True)


@pytest.mark.parametrize(("one", "other", "both"), [
    (None, None, None), (None, {"a": 1}, {"a": 1}), ({"a": 1}, None, {"a": 1}),
    ({"lost": {"/x": 1, "/y": 2}, "solver": "a"}, {"lost": {"/x": 3, "/z": 4}, "solver": "b"},
     {"lost": {"/x": 4, "/y": 2, "/z": 4}, "solver": "b"}),
    ({"lost": {"/x": "?"}, "n": 1}, {"lost": {"/x": 3}, "n": {}}, {"lost": {"/x": 3}, "n": {}}),
    ({"lost": {"/x": 3}}, {"lost": {"/x": "?"}, "n": 2}, {"lost": {"/x": "?"}, "n": 2})])
def test_results_of_two_parts_are_merged(one, other, both):
    assert together(one, other) == both


def test_sentences_on_drivelines():
    one = RecordedDriveline("/a/joint_states", "", ("x", "y"), None, 1, 0.0, 2.5, False, able=False)
    two = RecordedDriveline("/b/joint_states", "ab", (), "Fig. 2", 3, 0.5, 2.5, False)
    assert one.sentence() == "/a/joint_states: 1 state from 0 to 2.5 s, joints x, y"
    assert two.sentence() == "/b/joint_states of publisher ab: 3 states from 0.5 to 2.5 s, Fig. 2"
    asks = "; say which of them are flywheel and clutch plate: --joints flywheel=NAME,clutch_plate=NAME"
    assert joints_sentence([one]) == f"its joints are x, y{asks}"
    assert joints_sentence([one, two]) == f"joints are x, y on /a/joint_states; without names on /b/joint_states{asks}"
    assert Choice({"flywheel": "x"}).names == ("x", "clutch_plate")
    process = "0123456789abcdef01234567"
    assert [same_process(*pair) for pair in (
        ("", []), ("ab", []), ("ab", [""]), (process + "aa", [process + "bb"]), (process, [process[:-1] + "0"]))] == [
            True, False, True, True, False]


def test_times_and_counts_of_a_bag():
    empty, file = FileSummary("a_0.mcap"), FileSummary("a_1.mcap", 5, 30, {}, {1: 2, 2: 3})
    none = (1 << 63) - 1
    assert (file.count, empty.count) == (5, 0)
    for files, count, start, duration in (([empty], 0, none, 0), ([FileSummary("a_0.mcap", 5, 5, {}, {1: 1})], 1, 5, 0),
                                          ([empty, file], 5, 5, 25), ([], 0, none, 0)):
        result = information(files)
        assert (result["message_count"], result["starting_time"]["nanoseconds_since_epoch"],
                result["duration"]["nanoseconds"]) == (count, start, duration)
        assert result["relative_file_paths"] == [one.name for one in files]
    assert result["version"] == 9


def test_a_file_counts_its_messages_and_chunks(tmp_path):
    file = McapFile(tmp_path / "a.mcap")
    channel, size = file.channel("/x", FLOAT64), file.size
    file.flush()
    assert (file.chunks, file.size) == (0, size)
    for log in (7, 3, 9, 5):
        file.write(channel, log, log + 1, cdr.float64(log), (1 << 32) + log)
    for _ in range(2):
        file.flush()
    assert (file.chunks, file.summary.counts, file.summary.first_ns, file.summary.last_ns) == (1, {channel: 4}, 3, 9)
    body = bytes(_CHUNK_SIZE - 31)
    for chunks in (1, 2):   # A chunk ends beyond its size, with 31 bytes of each message's head.
        file.write(channel, 10, 11, body if chunks == 1 else b"", 0)
        assert file.chunks == chunks
    assert file.size > size
    assert file.linked()
    file.close({"lost": {}})
    with (tmp_path / "a.mcap").open("rb") as stream:
        rows = [(m.log_time, m.publish_time, m.sequence) for *_, m in make_reader(stream).iter_messages()]
    assert rows == [(3, 4, 3), (5, 6, 5), (7, 8, 7), (9, 10, 9), (10, 11, 0), (10, 11, 0)]
    with pytest.raises(RecordingError, match=r"a.mcap exists already and is not overwritten$"):
        McapFile(tmp_path / "a.mcap")
    (tmp_path / "a.mcap").unlink()
    other = McapFile(tmp_path / "a.mcap")
    other.remove()
    assert list(tmp_path.iterdir()) == []


def test_only_what_collects_is_not_frozen():
    collects = {"Contents", "RecordStream", "FileSummary", "StampCounter", "_Run"}
    for found in iter_modules(tcc_sim.recording.__path__, "tcc_sim.recording."):
        for one in vars(import_module(found.name)).values():
            if is_dataclass(one) and isinstance(one, type) and one.__module__ == found.name:
                assert one.__dataclass_params__.frozen is (one.__name__ not in collects), one


@pytest.mark.parametrize(("returns", "resets", "restarts", "mixed"), [
    (3, 0, 0, False), (4, 0, 0, True), (4, 39, 0, True), (4, 40, 0, False), (4, 20, 20, False), (4, 20, 19, True)])
def test_publishers_are_mixed_if_runs_return_often(returns, resets, restarts, mixed):
    assert StampCounter(returns=returns, resets=resets, restarts=restarts).mixed is mixed


def test_a_record_that_describes_has_at_most_16_mib(tmp_path):
    for more, read, said in ((0, 16 << 20, []), (1, 0, ["the record at byte 8 is left out: it has 16777217 bytes; at "
     "most 16777216 are accepted"])):
        path = tmp_path / f"{more}.mcap"
        with path.open("wb") as file:
            file.write(records.MAGIC + struct.pack("<BQ", Opcode.METADATA, (16 << 20) + more))
            file.truncate(8 + 9 + (16 << 20) + more)
        with path.open("rb") as file:
            stream = records.RecordStream(file)
            assert [(row.opcode, row.offset, row.length, len(row.body)) for row in stream] == [
                (Opcode.METADATA, 8, (16 << 20) + more, read)]
            assert (stream.warnings, stream.complete) == (said, False)


class Failing:
    """A file on a disk that fails."""

    def seek(self, *_):
        return 0

    def read(self, *_):
        raise OSError(5, "Input/output error")


def test_a_disk_that_fails_is_named(tmp_path):
    stream = records.RecordStream(Failing())
    for call in (lambda: unpacked_file(tmp_path, Failing()), lambda: [*records_of(tmp_path, stream)]):
        with pytest.raises(RecordingError) as error:
            call()
        assert str(error.value) == f"{tmp_path} cannot be read: Input/output error"
    for length, why in ((256 << 20, "it cannot be read: Input/output error"),
                        ((256 << 20) + 1, "it has 268435457 bytes; at most 268435456 are accepted")):
        with pytest.raises(records.DamagedChunk) as error:
            stream.read(records.McapRecord(Opcode.CHUNK, 0, length, b""))
        assert str(error.value) == why


@pytest.mark.parametrize(("times", "options", "parts"), [
    ([0, 999, 1000, 1999, 2000], {"max_duration": 1e-6}, [2, 2, 1]), ([0, 3500, 3600], {"max_duration": 1e-6}, [1, 2]),
    ([0, 10**15], {}, [2]), ([0, 10**15], {"max_duration": -1.0, "max_size": -1}, [2])])
def test_a_part_ends_with_its_duration(tmp_path, times, options, parts):
    writer = BagWriter(tmp_path / "run", **options)
    channel = writer.channel("/x", FLOAT64)
    for t in times:
        writer.write(channel, t, t, cdr.float64(t))
    writer.close()
    files = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["files"]
    assert [file["message_count"] for file in files] == parts
    assert writer.counts == {channel: len(times)}


def test_a_bag_that_fails_closes_its_folder(tmp_path, monkeypatch):
    open_before = len(os.listdir("/proc/self/fd"))
    for scene in ("a" * (LARGEST_FILE + 1), None):
        if scene is None:
            monkeypatch.setattr("tcc_sim.recording.bag.McapFile", None)
        with pytest.raises((InputError, TypeError)):
            BagWriter(tmp_path / "in" / "run", scene)
        assert [*tmp_path.iterdir()] == []
        assert len(os.listdir("/proc/self/fd")) == open_before


def recorded(path, topic="/joint_states", count=3, scenes=()):
    writer = BagWriter(path)
    channel, said = writer.channel(topic, JOINT_STATE), writer.channel("/scene", STRING) if scenes else 0
    for text in scenes:
        writer.write(said, 0, 0, cdr.string(text))
    for n in range(count):
        writer.write(channel, n, n, cdr.joint_state(n * 10**6, *[0.0] * 6), n)
    writer.close()
    return path


def test_states_may_take_half_of_the_memory(tmp_path, monkeypatch):
    path = recorded(tmp_path / "run")
    monkeypatch.setattr("tcc_sim.recording.reader._memory", lambda: 2 * 3 * BYTES_A_STATE)
    assert len(open_run(path).states()[0]) == 3
    monkeypatch.setattr("tcc_sim.recording.reader._memory", lambda: 2 * 3 * BYTES_A_STATE - 1)
    with pytest.raises(TooManyStates, match=r"its 3 states take 3.3e-07 GB, more than half of the 6.59e-07 GB of this"):
        open_run(path).states()


def test_so_many_scenes_are_read(tmp_path, monkeypatch):
    scenes = [f"driveline:\n  ros__parameters: {n}\n" for n in range(3)]
    path = recorded(tmp_path / "run", scenes=[*scenes, "no scene"])
    assert [scene.text for scene in open_run(path).scenes] == scenes
    monkeypatch.setattr("tcc_sim.recording.drivelines.MOST_SCENES", 2)
    assert [scene.text for scene in open_run(path).scenes] == scenes[:2]


def test_a_part_that_cannot_be_read_makes_a_recording_incomplete(tmp_path):
    for name, complete in (("run_1.mcap", False), ("notes.mcap", True)):
        path = recorded(tmp_path / name.partition(".")[0])
        (path / "metadata.yaml").unlink()
        next(path.iterdir()).rename(path / "run_0.mcap")
        (path / name).write_bytes(b"no recording")
        run = open_run(path)
        assert (run.complete, len(run.states()[0])) == (complete, 3)
        assert run.warnings == [f"left out: {path / name}: it is not an MCAP file, or its start is damaged"]


def test_metadata_is_written_where_hard_links_are_refused(tmp_path, monkeypatch):
    def link(*_, **__):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", link)
    path = recorded(tmp_path / "run")
    assert sorted(file.name for file in path.iterdir()) == ["metadata.yaml", "run_0.mcap"]
    assert yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["message_count"] == 3
    writer = BagWriter(tmp_path / "other")
    (tmp_path / "other" / "metadata.yaml").write_text("mine")
    with pytest.raises(RecordingError, match=r"metadata.yaml exists already and is not overwritten"):
        writer.close()
    assert (tmp_path / "other" / "metadata.yaml").read_text() == "mine"
    assert len([*(tmp_path / "other").iterdir()]) == 2


@pytest.mark.parametrize(("most", "values", "refused"), [(9, [1.0, 2.0, 3.0, 4.0], 1), (2, [1.0, 2.0, 3.0, 4.0], 1),
                                                        (1, [1.0, 4.0], 3)])
def test_pressures_of_other_frames_are_read_up_to_a_number_of_layouts(monkeypatch, most, values, refused):
    def pressure(frame, value):
        name = frame.encode() + b"\0"
        body = struct.pack("<iII", 1, 5, len(name)) + name
        return b"\0\1\0\0" + body + b"\0" * (-len(body) % 8) + struct.pack("<dd", value, 0.0)

    monkeypatch.setattr(layouts, "MOST_LAYOUTS", most)
    data, messages = chunk(pressure("", 1.0), pressure("plate", 2.0), b"\0\1\0\0", pressure("plate", 3.0),
     pressure("", 4.0))
    found = Layouts(FLUID_PRESSURE, (), ("fluid_pressure",), np.array([10**9]))
    result = found.take(np.frombuffer(data, np.uint8), messages, [1])
    assert (result.columns["fluid_pressure"].tolist(), found.refused) == (values, refused)
    assert result.rows.tolist() == [{1.0: 0, 2.0: 1, 3.0: 3, 4.0: 4}[value] for value in values]
    assert (set(result.stamps.tolist()), result.heads["log_ns"].tolist()) == ({5}, [5] * len(values))
    assert len(found.take(np.frombuffer(data, np.uint8), messages, [2]).rows) == 0
    assert Layouts(FLOAT64).take(np.frombuffer(data, np.uint8), messages, [1]).rows.tolist() == []


def driveline(topic, began=0, scene=True, able=True):
    return RecordedDriveline(topic, "", ("a", "b"), None, 1, 0.0, 1.0, False, (), ("scene",) if scene else (), able,
     began)


BOTH = [driveline("/a/x"), driveline("/b/x", able=False)]


@pytest.mark.parametrize(("drivelines", "choice", "number"), [
    ([], Choice(), None), ([driveline("/a", able=False)], Choice(), None), ([driveline("/aa"), driveline("/b")],
     Choice(), 1),
    ([driveline("/b"), driveline("/a")], Choice(), 1), ([driveline("/a", scene=False), driveline("/bb")], Choice(), 1),
    ([driveline("/a", 5), driveline("/a", 9), driveline("/a", 7)], Choice(), 1),
    ([driveline("/a", 9), driveline("/a", 9)], Choice(), 1), ([driveline("/a"), driveline("/b")], Choice(topic="b"), 1),
    ([driveline("/a"), driveline("/b")], Choice(driveline=1), 1), ([driveline("/a"), driveline("/b")], Choice(None,
     "b", 1), 1),
    ([driveline("/a")], Choice(driveline=1), "driveline is 1; the recording holds 1 driveline, counted from 0"),
    ([driveline("/a")] * 2, Choice(driveline=-1), "driveline is -1; the recording holds 2 drivelines, counted from 0"),
    ([driveline("/a"), driveline("/b")], Choice(None, "/a", 1), "driveline 1 is on /b, not on /a"),
    ([driveline("/a"), driveline("/b")], Choice(None, "/b", 0), "driveline 0 is on /a, not on /b"),
    (BOTH, Choice(topic="/c"), "no joint_states were recorded on /c; the topics with joint_states are /a/x, /b/x"),
    ([], Choice(topic="/c"), "no joint_states were recorded on /c; the topics with joint_states are none"),
    (BOTH, Choice(topic="/b/x"), "its joints are a, b; say which of them are flywheel and clutch plate: --joints "
     "flywheel=NAME,clutch_plate=NAME"),
    (BOTH, Choice(driveline=1), "its joints are a, b; say which of them are flywheel and clutch plate: --joints "
     "flywheel=NAME,clutch_plate=NAME")])
def test_the_driveline_to_read(drivelines, choice, number):
    if isinstance(number, str):
        with pytest.raises(InputError) as error:
            Inventory(()).chosen(drivelines, choice)
        assert str(error.value) == number
    else:
        assert Inventory(()).chosen(drivelines, choice) == number


def test_a_recording_out_of_order_that_is_too_large_to_sort_keeps_its_order(tmp_path, monkeypatch):
    writer = BagWriter(tmp_path / "run")
    channel = writer.channel("/joint_states", JOINT_STATE)
    for n in (*range(40, 80), *range(40)):
        writer.write(channel, n * 10**6, n * 10**6, cdr.joint_state(n * 10**6, *[0.0] * 6), n + 1)
    writer.close()
    ordered = open_run(tmp_path / "run")
    assert [len(run) for run in ordered.states()] == [80]
    monkeypatch.setattr("tcc_sim.recording.reader._memory", lambda: 20_000)
    large = open_run(tmp_path / "run")
    assert [len(run) for run in large.states()] == [40, 40]
    assert ("the blocks of the recording are out of order, and it is too large to sort them by log time"
            in large.warnings)


@pytest.mark.parametrize(("text", "depth"), [
    ("- depth: 7", 7), ("[]", None), ("", 100), ("depth: 7", 100), ("- 7", 100), ("- {depth: 7", 100), ("- &a {depth: "
     "7}", 100),
    ("[" * 3000, 100), ("- {depth: 2026-99-99}", 100)])
def test_quality_of_service_that_is_none_is_that_of_the_driveline(text, depth):
    profiles = _parsed(text)
    assert [profile["depth"] for profile in profiles] == ([] if depth is None else [depth])


def pressed(value, stamp=(3, 7), frame=b"", order=0, cut=0):
    """A FluidPressure by the rules of CDR."""
    body = struct.pack("<II", *stamp) + struct.pack("<I", len(frame) + 1) + frame + b"\0"
    body += b"\0" * (-len(body) % 8) + struct.pack("<dd", value, 0.0)
    return bytes([0, 1 - order, 0, 0]) + body[:len(body) - cut]


@pytest.mark.parametrize(("kind", "bodies", "values", "answers"), [
    (FLOAT64, [cdr.float64(2.5), cdr.float64(math.nan), cdr.float64(math.inf), cdr.float64(-1.0)[:-1],
               cdr.float64(-0.5), b"\0\0\0\0" + struct.pack(">d", 1.0)], [2.5, -0.5], [-1, -1]),
    (FLUID_PRESSURE, [pressed(1.0), pressed(2.0, (0, 0)), pressed(3.0, (2**31 - 1, 999_999_999), b"plate"),
                      pressed(4.0, (2**31, 0), b"abc"), pressed(math.nan), pressed(6.0, cut=9), pressed(7.0, cut=8),
                      pressed(8.0, order=1), b"\0\1\0\0" + bytes(11), pressed(9.0, frame=b"12345678")],
     [1.0, 2.0, 3.0, 4.0, 7.0, 9.0],
     [3 * 10**9 + 7, 0, (2**31 - 1) * 10**9 + 999_999_999, -1, 3 * 10**9 + 7, 3 * 10**9 + 7])])
def test_values_and_stamps_of_commands_in_any_frame(kind, bodies, values, answers):
    """Not finite, cut short and big-endian ones are left out."""
    for log, sent, times in ((5, 7, (5, 7)), (5, 0, (5, 5)), (0, YEAR + 1, (YEAR + 1, YEAR + 1))):
        data, messages = chunk(*bodies, log=log, sent=sent)
        offset, received, said, found, stamps = _decoded(np.frombuffer(data, np.uint8), messages.offset,
                                                         messages.length, kind)
        assert (found.tolist(), stamps.tolist()) == (values, answers)
        assert {*zip(received.tolist(), said.tolist())} == {times}
        assert len(offset) == len(values)


MILLISECOND = 10**6


def sent_at(times, values=None, answers=None, before=0, until=6):
    """Commands of one chunk, sent at times in ms."""
    values = range(len(times)) if values is None else values
    times = np.array(times, np.int64) * MILLISECOND
    return _Sent(np.arange(len(times)), np.zeros(len(times), int), times, times, np.array(values, float), np.array(
        [-1] * len(times) if answers is None else answers), before, until)


@pytest.mark.parametrize(("states_ms", "commands", "rows", "values"), [
    ([0, 10, 20, 30], [([-5, 0, 1, 10, 15, 30, 31], range(7))], [0, 0, 1, 1, 2, 3], [0, 1, 2, 3, 4, 5]),
    # Received twice: the same time, stamp and value in a row.
    ([0, 10, 20, 30], [([5, 5, 5, 7], [1.0, 1.0, 2.0, 2.0])], [1, 1, 1], [1.0, 2.0, 2.0]),
    ([0, 10, 20, 30], [([5, 25], [1.0, 2.0]), ([15], [3.0])], [1, 3, 3], [1.0, 2.0, 3.0]),
    # The clock is set back by 100 ms between the third and the fourth state.
    ([100, 110, 120, 30, 40, 50], [([105, 25, 35, 45], range(4))], [1, 3, 4, 5], [0, 1, 2, 3]),
    # A jump of 50 ms is no step of the clock: the states never go back.
    ([100, 110, 120, 70, 130], [([115, 119], [1.0, 2.0])], [2, 2], [1.0, 2.0])])
def test_each_command_is_at_the_first_state_sent_after_it(states_ms, commands, rows, values):
    times = np.array(states_ms, np.int64) * MILLISECOND
    run = JointStates(np.arange(len(times)) * 10 * MILLISECOND, times, times, *np.zeros((6, len(times))))
    found = _Clock([run], _none).rows([sent_at(*one, until=len(times) - 1) for one in commands])
    assert (found.rows.tolist(), found.values.tolist()) == (rows, values)
    whole = Commands("/a/joint_states", NONE)
    assert whole.aligned([run]) == {}
    whole._sent["engine_torque"] = [sent_at(*commands[0], until=len(times) - 1)]
    assert [*whole.aligned([run])] == ["engine_torque"]
    assert whole.aligned([]) == {}
    for log, coarse in (([0, 0, 0, 0], True), ([0, 0, 1, 1], False), ([0, 0, 0, 1], False), ([0, 0, 0, 0, 1], True)):
        received = np.array(log)
        whole.aligned([JointStates(received, received, received, *np.zeros((6, len(log))))])
        assert whole.coarse is coarse


@pytest.mark.parametrize(("senders", "found"), [
    # Publisher, times of receipt (ms) and stamps (ms) of each chunk in the order of the file.
    ([("a", [10, 11, 12], [0, 1, 2])], [("a", 3, 0.0, 0.002, 10)]),
    ([("a", [10, 11], [0, 1]), ("b", [20, 21], [0, 5])], [("b", 4, 0.0, 0.005, 20)]),  # A restart.
    ([("a", [10, 20], [0, 1]), ("b", [15, 25], [7, 8]), ("a", [30], [2])], [("a", 3, 0.0, 0.002, 10),
                                                                          ("b", 2, 0.007, 0.008, 8)]),
    ([("a", [12, 10], [2, 0]), ("a", [9], [5])], [("a", 3, 0.0, 0.005, 4)]),
    ([("a", [10, 20], [0, 1]), ("b", [15, 25], [7, 8])], [("b", 4, 0.0, 0.008, 8)])])  # In the order of the file.
@pytest.mark.parametrize("chunks", [1, 9])
def test_publishers_that_follow_one_another_are_one_driveline(senders, found, chunks):
    inventory = Inventory(("flywheel", "clutch_plate"))
    numbers = {name: k for k, name in enumerate(dict.fromkeys(who for who, *_ in senders), 1)}
    channels = {k: Channel("/joint_states", JOINT_STATE, "", {"publisher": name}) for name, k in numbers.items()}
    assert {channel.publisher for channel in channels.values()} == set(numbers)
    parts = []
    for who, log, stamps in senders:
        parts += [struct.pack("<HIQQ", numbers[who], n, received * MILLISECOND, 0) + cdr.joint_state(
            stamp * MILLISECOND, *[0.0] * 6) for n, (received, stamp) in enumerate(zip(log, stamps))]
    for rows in [parts] if chunks == 1 else [[part] for part in parts]:
        data, messages = records.joined(rows, np.array([row[0] for row in rows], np.uint16))
        inventory.take(Batch(data, messages, True, {}), channels)
    result = inventory.drivelines([], Choice())
    assert [(one.publisher, one.states, one.start, one.end, one.began_ns // MILLISECOND) for one in sorted(
        result, key=lambda one: one.publisher)] == found
    assert sum(one.read for one in result) == 1
    assert inventory.refused("/joint_states") == 0


def test_drivelines_with_the_joints_come_first_and_what_cannot_be_decoded_counts_by_topic():
    inventory = Inventory(("a", "b"))
    assert [inventory.wants(Channel(topic, kind, "")) for topic, kind in (
        ("/x", JOINT_STATE), ("/x/scene", STRING), ("/x", STRING), ("/scene", "tf2_msgs/msg/TFMessage"))] == [
            True, True, False, False]
    for number, (topic, names) in enumerate((("/a", ("c", "d")), ("/bb", ("x", "b", "a")), ("/cc", ("a", "b"))), 1):
        good = cdr.joint_state_layout(names, (), "", ()).example.tobytes()
        data, messages = chunk(good, b"no message", channel=number)
        inventory.take(Batch(data, messages, True, {}), {number: Channel(topic, JOINT_STATE, "")})
    assert [(one.topic, one.able, one.read) for one in inventory.drivelines([], Choice())] == [
        ("/bb", True, True), ("/cc", True, False), ("/a", False, False)]
    assert [inventory.refused(topic) for topic in ("/a", "/bb", "/cc", "/d")] == [1, 1, 1, 0]


def test_what_a_recording_tells_of_its_losses(tmp_path):
    """Losses are those of the record at the end; joint_states by their stamps."""
    run = open_run(recorded(tmp_path / "run"))
    run.states()
    assert (list(run.warnings), run.solver, run.lost_messages, run.controlled) == ([], "fixed_step", 0, False)
    run._incomplete, run._left_out = True, ["left out: x"]
    run.result = {"solver": "rosenbrock", "lost": {"/joint_states": 9, "/a": 1, "/b": 0, "/c\n": 2, "/d": "?"},
                  "unsent": {"/joint_states": 3, "/e": 10**30}}
    for name, value in {"resets": 1, "restarts": 2, "repeated": 1, "late": 2}.items():
        setattr(run.stamps, name, value)
    run.warnings.clear()
    run._conclude()
    assert run.warnings == [
        "left out: x", "the recording was cut short: data after the last flush is missing",
        "1 message of /a lost while recording", r"2 messages of /c\n lost while recording",
        "3 messages of /joint_states could not be sent by their publisher",
        "1000000000000000000 messages of /e could not be sent by their publisher",
        "simulation time started again 3 times (1 reset, 2 restarts): these are separate runs",
        "1 repeated stamp left out",
        "2 messages of /joint_states left out: their publisher had ended and another had begun"]
    run.result = {"solver": 7, "lost": 5}
    assert run.solver == "fixed_step"
    run.topics["/target_slip_speed"] = FLOAT64
    assert run.controlled
    run.warnings.clear()
    run.drivelines, run._refused = [replace(run.drivelines[0], read=True), *(
        driveline(f"/{n}/x", able=n > 1) for n in range(1, 23))], 1
    run._pass_over([])
    assert run.warnings[:3] == [
        "1 message of /joint_states left out: their layout differs",
        "not read: /1/x: 1 state from 0 to 1 s, joints a, b",
        "not read: /2/x: 1 state from 0 to 1 s, no scene; --driveline 2 reads it"]
    assert (len(run.warnings), run.warnings[-1]) == (22, "not read: 2 more publishers of joint states")


def test_topics_of_a_recording_without_a_driveline_and_missing_parts_are_named(tmp_path):
    for count, more in ((20, ""), (22, " and 2 more")):
        writer = BagWriter(tmp_path / str(count))
        for n in range(count):
            writer.write(writer.channel(f"/t{n:02}", FLOAT64), n, n, cdr.float64(1.0))
        writer.close()
        with pytest.raises(RecordingError) as error:
            open_run(tmp_path / str(count)).states()
        assert str(error.value) == (
            f"{tmp_path / str(count) / f'{count}_0.mcap'} holds no {JOINT_STATE}, so no driveline; its topics are "
            f"{', '.join(f'/t{n:02} ({FLOAT64})' for n in range(20))}{more}")
    (part,) = recorded(tmp_path / "run").glob("*.mcap")
    (part.parent / "metadata.yaml").unlink()
    for number, said in ((2, ["part 1 is missing"]), (4, ["2 parts are missing, the first is part 1"])):
        (part.parent / f"run_{number}.mcap").write_bytes(part.read_bytes())
        run = open_run(part.parent)
        run.states()
        assert [text for text in run.warnings if "missing" in text] == said
        assert not run.complete


MINE, SAME, THEIRS = "a" * 24 + "01", "a" * 24 + "02", "b" * 24 + "01"
"""Identifiers of publishers: two of one process, and one of another."""


@pytest.mark.parametrize(("recorded_", "announced", "scenes"), [
    ([], [], []), (["A1", "B2"], [], ["A1", "B2"]), (["B2", "A1"], [], ["B2", "A1"]), (["A1", "A1"], [], ["A1"]),
    ([], [("", SAME, "A5")], ["A5"]), (["A1"], [("", SAME, "A5")], ["A1"]),
    (["A1"], [("", SAME, "B5")], ["A1", "B5"]), (["A9"], [("", SAME, "B5"), ("", MINE, "C7")], ["B5", "C7", "A9"]),
    (["A1", "C2"], [("/other", SAME, "C5")], ["A1"]), (["D1"], [("", THEIRS, "D5"), ("", SAME, "A6")], ["A6"]),
    (["D1"], [("", THEIRS, "D5"), ("", SAME, "D6")], ["D1"]), ([], [("", THEIRS, "D5")], ["D5"]),
    ([], [("", THEIRS, "D5"), ("/other", SAME, "E5")], []), ([], [("", "", "D5"), ("/other", THEIRS, "E5")], ["D5"])])
def test_scenes_are_those_of_the_namespace_and_of_the_process(recorded_, announced, scenes):
    """Each text with its time of sending; a recorded scene that only others announced is theirs."""
    def record(word):
        return SceneRecord(word[0], "", int(word[1:]))

    inventory = Inventory(())
    inventory._scenes = {_Announced(space, who, record(word)): None for space, who, word in announced}
    inventory._sent = {("/joint_states", MINE, ()): SimpleNamespace(publisher=MINE)}
    found = inventory._scenes_of("", [MINE], [record(word) for word in recorded_])
    assert [f"{one.text}{one.log_ns}" for one in found] == scenes
