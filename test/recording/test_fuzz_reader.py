"""A fuzzer on the reader of recordings: arbitrary bytes, and records with false fields."""

import struct

import pytest
from mcap.opcode import Opcode
from test_bag_round_trip import TICK, columns, write

pytest.importorskip("hypothesis")

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tcc_sim.errors import RecordingError
from tcc_sim.recording.reader import Run
from tcc_sim.recording.recovery import recover

MAGIC = b"\x89MCAP0\r\n"
FUZZ = settings(derandomize=True, database=None, deadline=None, max_examples=50,
                suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
"""The same examples every time; what longer searches found stands beside the tests as an example of its own."""
NUMBERS = st.sampled_from([0, 1, 2, 7, 8, 9, 255, 65535, 1 << 20, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, 1 << 62,
                           (1 << 64) - 1])
WORDS = st.sampled_from(["", "ros2", "zstd", "lz4", "x", "\ud800".encode("utf-8", "surrogatepass"), b"\xff", "tcc_sim",
                         "tcc_sim_result", "tcc_sim_recovery", "/joint_states", "sensor_msgs/msg/JointState", "cdr",
                         "a" * 300])


def string(word, claimed=None):
    """A length, perhaps a false one, and a word."""
    data = word if isinstance(word, bytes) else word.encode()
    return struct.pack("<I", (len(data) if claimed is None else claimed) & 0xFFFFFFFF) + data


FIELDS = st.one_of(NUMBERS.map(lambda n: struct.pack("<Q", n)),
                   NUMBERS.map(lambda n: struct.pack("<I", n & 0xFFFFFFFF)),
                   NUMBERS.map(lambda n: struct.pack("<H", n & 0xFFFF)), WORDS.map(string),
                   st.tuples(WORDS, NUMBERS).map(lambda pair: string(*pair)), st.binary(max_size=40))


@st.composite
def record(draw):
    """One record of any opcode and fields; its length may be false."""
    body = b"".join(draw(st.lists(FIELDS, max_size=8)))
    length = draw(st.one_of(st.just(len(body)), st.just(len(body)), NUMBERS))
    return struct.pack("<BQ", draw(st.integers(0, 16)), length) + body


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Bytes of a complete recording."""
    return write(tmp_path_factory.mktemp("whole") / "run", columns(120), [n * TICK for n in range(120)],
                 pressures=list(range(120))).read_bytes()


def one_short_line(text):
    assert text.isprintable()
    assert len(text) < 1100


def read_or_refused(folder, data):
    """Check that the bytes can be read and recovered, or are refused in one short line."""
    path = folder / "x.mcap"
    path.write_bytes(data)
    try:
        run = Run(path)
        for batch in run.columns().runs:
            assert len(batch)
        recover(run, folder / "saved")
    except RecordingError as error:
        one_short_line(str(error).replace(str(folder), ""))


@FUZZ
@given(st.binary(max_size=300), st.booleans())
@example(b"", True)
@example(MAGIC, True)
def test_any_bytes(tmp_path_factory, data, magic):
    read_or_refused(tmp_path_factory.mktemp("x"), MAGIC + data if magic else data)


@FUZZ
@given(st.lists(record(), max_size=8), st.booleans())
@example([struct.pack("<BQ", Opcode.CHUNK, 1 << 62)], False)
@example([struct.pack("<BQ", Opcode.METADATA, 8) + string("tcc_sim", 0xFFFFFFFF)[:8]], True)
def test_any_records(tmp_path_factory, result, closed):
    read_or_refused(tmp_path_factory.mktemp("x"), MAGIC + b"".join(result) + (MAGIC if closed else b""))


@FUZZ
@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.one_of(record(), FIELDS), st.booleans()), min_size=1, max_size=4))
def test_a_recording_with_records_and_fields_put_in(tmp_path_factory, whole, edits):
    data = whole
    for where, piece, over in edits:
        place = int(where * len(data))
        data = data[:place] + piece + data[place + (len(piece) if over else 0):]
    read_or_refused(tmp_path_factory.mktemp("x"), data)
