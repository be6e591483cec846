"""CDR bytes against ROS 2's own serialiser, and values decoded back."""

import math
import random

import numpy as np
import pytest

from tcc_sim.messages import cdr
from tcc_sim.messages.definitions import _dependencies


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


@pytest.mark.parametrize("stamp", STAMPS)
def test_numpy_reads_a_joint_state_back(stamp):
    six = [1.5, -2.5, 3.25, 4.125, -5.0, 6.75]
    record = np.frombuffer(cdr.joint_state(stamp, *six), dtype=cdr.JOINT_STATE)
    assert cdr.stamps(record).tolist() == [stamp]
    assert list(record[0])[2:] == six
    assert cdr.read_stamp(cdr.joint_state(stamp, *six)) == stamp


def test_template_holds_for_any_values_and_not_for_other_names():
    _, expected, fixed = cdr.joint_state_layout()
    data = np.frombuffer(cdr.joint_state(2**60, *values(0)[1:7]), dtype=np.uint8)
    assert (data[fixed] == expected[fixed]).all()
    assert sorted(np.flatnonzero(fixed)) == [n for n in range(len(data)) if n not in JOINT_STATE_PADDING
                                             and n not in (2, 3)
                                             and not 4 <= n < 12
                                             and not any(n - first in range(16) for first in (68, 92, 116))]
    other = np.frombuffer(bytes(data).replace(b"flywheel", b"flywhee1"), dtype=np.uint8)
    assert not (other[fixed] == expected[fixed]).all()


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0", b"\0\0\0\0" + bytes(8), b"\0\1\0\0" + b"\xff" * 30])
def test_what_is_no_message_is_refused(data):
    with pytest.raises(ValueError, match="FluidPressure"):
        cdr.read_fluid_pressure(data)
    if len(data) < 12 or data[1] == 0:
        with pytest.raises(ValueError, match="Float64"):
            cdr.read_float64(data)


@pytest.mark.parametrize("data", [b"", cdr.HEADER, cdr.HEADER + b"\x05\0\0\0ab", b"\0\0\0\0" + cdr.string("x")[4:],
                                  cdr.HEADER + b"\0\0\0\0", cdr.HEADER + b"\xff\xff\xff\xffabcd"])
def test_a_malformed_string_is_an_error_and_no_text(data):
    with pytest.raises(ValueError, match="not a little-endian"):
        cdr.read_string(data)


@pytest.mark.parametrize("text", ["", "a", "scene: 1\n", "é" * 100])
def test_a_string_comes_back(text):
    assert cdr.read_string(cdr.string(text)) == text


@pytest.mark.parametrize("length", range(17))
def test_a_pressure_is_read_whatever_the_frame_is_called(length):
    """Doubles stand at multiples of 8 behind the four bytes of the encapsulation."""
    import struct

    body = struct.pack("<iII", 3, 500, length + 1) + b"f" * length + b"\0"
    body += b"\xff" * (-len(body) % 8) + struct.pack("<dd", 2.5e5, 0.0)
    assert cdr.read_fluid_pressure(b"\0\1\0\0" + body) == (3_000_000_500, 2.5e5)


@pytest.mark.parametrize("frame", ["", "x", "driveline", "µ"])
def test_a_header_comes_back(frame):
    assert cdr.read_header(cdr.header(3_000_000_500, frame)) == (3_000_000_500, frame)


def test_the_names_of_joints_come_back_and_a_cut_message_is_refused() -> None:
    whole = cdr.joint_state(5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert cdr.read_joints(whole) == ("", ("flywheel", "clutch_plate"), (2, 2, 2))
    for length in range(len(whole)):
        with pytest.raises(ValueError, match="JointState"):
            cdr.read_joints(whole[:length])
    with pytest.raises(ValueError, match="JointState"):
        cdr.read_joints(whole + b"\0")


def test_the_types_of_fields_are_found_behind_bounds_and_comments() -> None:
    text = "Point[3] corners  # of Box\nstd_msgs/Header[<=2] heads\nstring<=5 name\nuint8 LARGE=2\nfloat64 x\nPose at\n"
    assert list(_dependencies("geometry_msgs/msg/Shape", text)) == [
        "geometry_msgs/msg/Point", "std_msgs/msg/Header", "geometry_msgs/msg/Pose"]
