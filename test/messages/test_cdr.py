"""CDR bytes against ROS 2's own serialiser, and values decoded back."""

import json
import math
import random
import struct
from itertools import product

import pytest

from tcc_sim import topics
from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.messages.definitions import CARRIED, Definition, definition, type_parts


def values(count):
    """Ordinary, extreme and special doubles."""
    draw = random.Random(4)
    special = [0.0, -0.0, 1e308, -1e308, 5e-324, math.inf, -math.inf, math.nan]
    return special + [draw.uniform(-1e3, 1e3) for _ in range(count)]


STAMPS = [0, 1, 999_999_999, 1_000_000_000, 12_345_678_901, (2**31 - 1) * 10**9 + 999_999_999]


JOINT_STATE_PADDING = [17, 18, 19, 37, 38, 39, 57, 58, 59, 64, 65, 66, 67, 88, 89, 90, 91, 112, 113, 114, 115]


def same(ours, theirs, padding):
    """Equal but for padding, which ROS 2 leaves as it finds its buffer."""
    cleared = bytearray(theirs)
    for place in padding:
        assert ours[place] == 0
        cleared[place] = 0
    return ours == bytes(cleared)


def test_bytes_are_what_ros_serialises():
    pytest.importorskip("rclpy")
    from builtin_interfaces.msg import Time
    from rclpy.serialization import serialize_message
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import FluidPressure, JointState
    from std_msgs.msg import Float64, Header, Int8

    for number in range(-128, 128):
        assert same(cdr.int8(number), serialize_message(Int8(data=number)), [5, 6, 7])
    for value in values(200):
        assert cdr.float64(value) == bytes(serialize_message(Float64(data=value)))
    draw = random.Random(5)
    for stamp in STAMPS + [draw.randrange(2**60) for _ in range(100)]:
        time = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        assert cdr.clock(stamp) == bytes(serialize_message(Clock(clock=time)))
        six = [draw.choice(values(5)) for _ in range(6)]
        joint = JointState(header=Header(stamp=time), name=["flywheel", "clutch_plate"], position=six[:2],
                           velocity=six[2:4],
                           effort=six[4:])
        assert same(cdr.joint_state(stamp, *six), serialize_message(joint), JOINT_STATE_PADDING)
        pressure = FluidPressure(header=Header(stamp=time), fluid_pressure=six[0], variance=six[1])
        assert same(cdr.fluid_pressure(stamp, six[0], six[1]), serialize_message(pressure), [17, 18, 19])
        for frame in ("", "a", "abc", "abcdefg", "clutch/pressure"):
            pressure.header.frame_id = frame
            assert cdr.read_fluid_pressure(bytes(serialize_message(pressure))) == (stamp,
                                                                                   pytest.approx(six[0], nan_ok=True))


def by_hand(*parts):
    """Parts of a message behind the encapsulation, each aligned to its size; padding holds arbitrary bytes."""
    body = b""
    for part in parts:
        if isinstance(part, str):
            text = part.encode() + b"\0"
            body += b"\xee" * (-len(body) % 4) + struct.pack("<I", len(text)) + text
        elif isinstance(part, float):
            body += b"\xee" * (-len(body) % 8) + struct.pack("<d", part)
        else:
            body += b"\xee" * (-len(body) % 4) + struct.pack("<I", part)
    return cdr.HEADER + body


def joints_by_hand(frame, names, *arrays):
    """A JointState with the stamp 3.0000005 s."""
    return by_hand(3, 500, frame, len(names), *names, *(part for array in arrays for part in (len(array), *array)))


LAID_OUT = [(frame, names, counts) for frame, names, counts in product(
    ["", "abc", "frame of 11", "\u00b5"], [("clutch_plate", "flywheel"), ("a", "flywheel", "clutch_plate")],
    product([True, False], repeat=3))]


@pytest.mark.parametrize(("frame", "names", "there"), LAID_OUT)
def test_the_layout_of_joints_in_any_order_and_with_missing_arrays_finds_their_values(frame, names, there):
    arrays = [[10.0 * number + place for place in range(len(names))] if one else [] for number, one in enumerate(there)]
    data = joints_by_hand(frame, names, *arrays)
    assert cdr.read_header(data) == (3_000_000_500, frame)
    fields = topics.topic("joint_states").fields
    found, layout = cdr.layout_of(data, topics.JOINT_STATE, fields, topics.JOINT_NAMES)
    assert found == names
    other = data.replace(b"flywheel", b"flywhee1")
    found, mask = layout.records([other, data, data[:-1], data, data + b"\0"])
    assert mask.tolist() == [False, True, False, True, False]
    expected = {fields[2 * number + place]: arrays[number][names.index(joint)] for number in range(3) if there[number]
                for place, joint in enumerate(("flywheel", "clutch_plate"))}
    assert found.dtype.names == ("sec", "nanosec", *expected)
    assert [dict(zip(found.dtype.names, row.tolist())) for row in found] == 2 * [{"sec": 3, "nanosec": 500, **expected}]
    assert cdr.stamps(found).tolist() == [3_000_000_500] * 2


def test_pressures_are_found_whatever_frame_they_have():
    for frame in ("f" * length for length in range(17)):
        messages = [by_hand(3, 500, text, 2.5e5, 4.0) for text in (frame, frame.upper(), frame + "x" * 8)]
        found, mask = cdr.layout_of(messages[0], topics.FLUID_PRESSURE, ["fluid_pressure"])[1].records(messages)
        assert mask.tolist() == [True, True, False]
        assert found.tolist() == [(3, 500, 2.5e5, 4.0)] * 2
        assert cdr.read_fluid_pressure(messages[0]) == (3_000_000_500, 2.5e5)
        assert cdr.read_fluid_pressure(messages[0][:-8] + bytes(8))[1] == 2.5e5


def test_messages_of_one_joint_are_those_by_hand():
    stamp, clear = 3_000_000_500, bytes.maketrans(b"\xee", b"\0")
    for name, words, expected in (
            ("output_state", (1.5, 2.5, 3.5), joints_by_hand("", [topics.OUTPUT_JOINT], [1.5], [2.5], [3.5])),
            ("slip_speed_stamped", (2.5,), joints_by_hand("", [topics.CLUTCH_JOINT], [], [2.5], [])),
            ("friction_torque_stamped", (3.5,), joints_by_hand("", [topics.CLUTCH_JOINT], [], [], [3.5])),
            ("applied_pressure", (1.0,), by_hand(3, 500, "", 1.0, 0.0)), ("slip_speed", (1.0,), by_hand(1.0)),
            ("stick_slip_state", (-1,), cdr.int8(-1)), ("/clock", (stamp,), by_hand(3, 500))):
        data = cdr.ENCODERS[name](stamp, *words)
        assert data == expected.translate(clear), name
        if name in ("output_state", "applied_pressure"):
            found = cdr.own_records([data], name)
            assert found[list(topics.topic(name).fields)].tolist() == [words]


def test_joints_are_refused_beyond_their_largest_number_and_with_an_array_of_another_length():
    most = tuple("" for _ in range(1000))
    for names in (most, ()):
        assert cdr.layout_of(joints_by_hand("", names, [], [], []), topics.JOINT_STATE, ["x"], ["y"])[0] == names
    whole = joints_by_hand("x", ["a", "b"], [1.0, 2.0], [3.0, 4.0], [])
    wrong = [joints_by_hand("", (*most, ""), [], [], []), joints_by_hand("", ["a", "b"], [1.0], [], []),
             joints_by_hand("", ["a"], [], [1.0, 2.0], []), joints_by_hand("", [], [], [], [1.0]), whole + b"\0",
             *(whole[:length] for length in range(len(whole))), b"\0\0" + whole[2:], b"\7\1" + whole[2:]]
    for data in wrong:
        with pytest.raises(ValueError, match=r"not a little-endian sensor_msgs/msg/JointState|has . values? for"):
            cdr.layout_of(data, topics.JOINT_STATE, ())


def test_the_values_of_all_statuses_of_diagnostics_are_read():
    first, second = ("node: driveline", "fine", ""), ("other", "", "id")
    data = by_hand(3, 500, "frame", 2, 0, *first, 2, "rate", "1000", "regime", "stick", 1, *second, 1, "rate", "50 Hz")
    assert cdr.read_diagnostics(data) == [("node: driveline", "", {"rate": "1000", "regime": "stick"}),
                                         ("other", "id", {"rate": "50 Hz"})]
    assert cdr.read_diagnostics(by_hand(3, 500, "", 0)) == []
    for length in range(len(data)):
        with pytest.raises(ValueError, match=r"^not a little-endian diagnostic_msgs/msg/DiagnosticArray$"):
            cdr.read_diagnostics(data[:length])


WHOLE = {cdr.read_fluid_pressure: by_hand(3, 500, "frame", 2.5e5, 4.0), cdr.read_float64: by_hand(2.5),
         cdr.read_string: by_hand("text"), cdr.read_header: by_hand(3, 500, "frame")}


@pytest.mark.parametrize("reader", WHOLE, ids=lambda reader: reader.__name__)
def test_a_message_that_is_cut_or_of_another_encoding_is_refused(reader):
    whole = WHOLE[reader]
    wrong = [whole[:length] for length in range(len(whole))] + [b"\0\0" + whole[2:], cdr.HEADER + b"\xff" * 30]
    for data in wrong[:-1] if reader is cdr.read_float64 else wrong:
        with pytest.raises(ValueError, match="not a little-endian"):
            reader(data)


def test_messages_come_back():
    for text in ("", "a", "scene: 1\n", "\u00e9" * 100):
        assert cdr.read_string(cdr.string(text)) == text
        assert cdr.read_header(cdr.header(3_000_000_500, text)) == (3_000_000_500, text)
    assert cdr.read_string(by_hand("", 7)) == ""
    assert cdr.read_header(cdr.HEADER + struct.pack("<iI", -1, 5) + by_hand("abc")[4:]) == (-999_999_995, "abc")
    assert cdr.read_float64(by_hand(2.5)) == cdr.read_float64(cdr.float64(2.5)) == 2.5
    assert [cdr.read_stamp(by_hand(3, 500)[:length]) for length in (0, 11, 12)] == [0, 0, 3_000_000_500]
    with pytest.raises(ValueError, match="not a little-endian"):
        cdr.read_string(cdr.HEADER + b"\0\0\0\0")


def test_definitions_have_every_type_once_in_the_order_of_use_and_the_hash_of_the_installed_one(tmp_path, monkeypatch):
    first, second = tmp_path / "first", tmp_path / "second"
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{first}:{second}")
    monkeypatch.setattr("sys.prefix", str(tmp_path / "wheels"))
    texts = {"Whole": "Left l\nRight[] r\nLeft again\nstd_msgs/Header h\n", "Left": "Right r\n", "Right": "int8 x\n"}
    for folder in (first, second):
        (folder / "share" / "mine" / "msg").mkdir(parents=True)
        for name, text in texts.items():
            if folder == second or name != "Left":
                (folder / "share" / "mine" / "msg" / f"{name}.msg").write_text(text if folder == first else "Right r\n")
    (first / "share" / "mine" / "msg" / "Whole.json").write_text(json.dumps({"type_hashes": [
        {"type_name": "mine/msg/Right", "hash_string": "no"},
        {"type_name": "mine/msg/Whole", "hash_string": "RIHS01_1"}]}))
    line = "\n" + "=" * 80 + "\nMSG: "
    assert definition("mine/msg/Whole") == Definition(
        f"{texts['Whole']}{line}mine/Left\nRight r\n{line}mine/Right\nint8 x\n{line}std_msgs/Header\n"
        f"builtin_interfaces/Time stamp\nstring frame_id\n{line}builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
        "RIHS01_1")
    assert definition("mine/msg/Right") == Definition("int8 x\n", "")
    assert definition("std_msgs/msg/Float64") == Definition(*CARRIED["std_msgs/msg/Float64"])
    (first / "share" / "mine" / "msg" / "Right.msg").write_text("Absent a\n")
    with pytest.raises(InputError, match=r"^the definition of mine/msg/Absent is not installed$"):
        definition("mine/msg/Whole")


def test_a_type_has_a_package_and_a_name():
    assert type_parts("std_msgs/msg/Float64") == ("std_msgs", "Float64")
    for name in ("Float64", "std_msgs/Float64", "Std/msg/Float64", "std_msgs/msg/float64", "std_msgs/msg/Float64 "):
        with pytest.raises(InputError, match=f"'{name}'.*std_msgs/msg/Float64"):
            type_parts(name)


def test_the_types_of_fields_are_found_behind_bounds_and_comments(tmp_path, monkeypatch) -> None:
    texts = {"Shape": "Point[3] corners  # of Box\nstd_msgs/Header[<=2] heads\nstring<=5 name\n"
             "uint8 LARGE=2\nPose at\n",
             "Point": "float64 x\n", "Pose": "Point at\n"}
    folder = tmp_path / "share" / "geometry_msgs" / "msg"
    folder.mkdir(parents=True)
    for name, text in texts.items():
        (folder / f"{name}.msg").write_text(text)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    lines = definition("geometry_msgs/msg/Shape").text.splitlines()
    assert [line.removeprefix("MSG: ") for line in lines if line.startswith("MSG: ")] == [
        "geometry_msgs/Point", "std_msgs/Header", "geometry_msgs/Pose", "builtin_interfaces/Time"]
