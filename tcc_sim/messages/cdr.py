"""Encode and decode the message types of this package as CDR without ROS.

Layouts follow the OMG CDR alignment rules (little-endian, version 1): a 4-byte encapsulation header, then each
primitive aligned to its size counted from the end of that header. A test compares every byte with ROS 2's own
serialisation.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim import topics
from tcc_sim.errors import counted
from tcc_sim.topics import JOINT_NAMES

HEADER = b"\x00\x01\x00\x00"
"""Encapsulation: plain CDR, little-endian, no options."""

_NANOSECONDS = 1_000_000_000
_FLOAT64 = struct.Struct("<4sd")
_INT8 = struct.Struct("<4sb3x")
_CLOCK = struct.Struct("<4siI")
_LENGTH = struct.Struct("<I")
_DOUBLE = struct.Struct("<d")
_DOUBLES = struct.Struct("<dd")
_STAMP = struct.Struct("<iI")
_LENGTHS = struct.Struct("<III")


def _string(text: str) -> bytes:
    """Encode a string that starts on a 4-byte boundary, padded to the next one."""
    data = text.encode() + b"\0"
    return _LENGTH.pack(len(data)) + data + bytes(-len(data) % 4)


MOST_JOINTS = 1000
"""Largest number of joints in a message."""
RUN_LENGTH = 16
"""Length of the name of a run, which is the frame of the driveline's messages; before version 1.1 it was empty."""


def float64(value: float) -> bytes:
    """Serialise a std_msgs/msg/Float64."""
    return _FLOAT64.pack(HEADER, value)


def int8(value: int) -> bytes:
    """Serialise a std_msgs/msg/Int8, padded with zeros to four bytes as DDS does."""
    return _INT8.pack(HEADER, value)


def header(stamp_ns: int, frame_id: str) -> bytes:
    """Serialise a std_msgs/msg/Header."""
    return HEADER + _STAMP.pack(*divmod(stamp_ns, _NANOSECONDS)) + _string(frame_id)


def string(text: str) -> bytes:
    """Serialise a std_msgs/msg/String."""
    return HEADER + _string(text)


def clock(stamp_ns: int) -> bytes:
    """Serialise a rosgraph_msgs/msg/Clock."""
    return _CLOCK.pack(HEADER, *divmod(stamp_ns, _NANOSECONDS))


@lru_cache(maxsize=64)
def _joints(names: tuple[str, ...], counts: tuple[int, ...], frame: str) -> tuple[struct.Struct, bytes]:
    """Return the layout of a JointState with these numbers of values, and its bytes from the frame to the names."""
    head = _string(frame) + _LENGTH.pack(len(names)) + b"".join(map(_string, names))
    form, position = f"<4siI{len(head)}s", 8 + len(head)
    for count in counts:
        padding = -(position + 4) % 8 if count else 0
        form += f"I{padding}x{count}d"
        position += 4 + padding + 8 * count
    return struct.Struct(form), head


@lru_cache(maxsize=64)
def _pressures(frame: str) -> tuple[struct.Struct, bytes]:
    """Return the layout of a FluidPressure, and the bytes of its frame."""
    head = _string(frame)
    return struct.Struct(f"<4siI{len(head)}s{-len(head) % 8}xdd"), head


def fluid_pressure(stamp_ns: int, pressure: float, variance: float = 0.0, frame: str = "") -> bytes:
    """Serialise a sensor_msgs/msg/FluidPressure (Pa)."""
    layout, head = _pressures(frame)
    return layout.pack(HEADER, *divmod(stamp_ns, _NANOSECONDS), head, pressure, variance)


def joint_state(stamp_ns: int, flywheel_angle: float, plate_angle: float, flywheel_speed: float, plate_speed: float,
                engine_torque: float, friction_torque: float, frame: str = "") -> bytes:
    """Serialise the driveline's sensor_msgs/msg/JointState: stamp (ns), angles (rad), speeds (rad/s), torques (N m)."""
    layout, head = _joints(JOINT_NAMES, (2, 2, 2), frame)
    return layout.pack(HEADER, stamp_ns // _NANOSECONDS, stamp_ns % _NANOSECONDS, head, 2, flywheel_angle, plate_angle,
                       2, flywheel_speed, plate_speed, 2, engine_torque, friction_torque)


def _joint_encoder(row: topics.Topic) -> Callable[..., bytes]:
    """Return the encoder of a topic's JointState by its joints and arrays."""
    counts = _counts_of(row)

    def encode(stamp_ns: int, *values: float, frame: str = "") -> bytes:
        layout, head = _joints(row.joints, counts, frame)
        rest, parts = iter(values), list[float]()
        for count in counts:
            parts += count, *islice(rest, count)
        return layout.pack(HEADER, *divmod(stamp_ns, _NANOSECONDS), head, *parts)

    return encode


def _counts_of(row: topics.Topic) -> tuple[int, ...]:
    """Return the numbers of positions, velocities and efforts of a topic's JointState."""
    return tuple(len(row.joints) if there else 0 for there in row.arrays)


@lru_cache(maxsize=64)
def _array(label: str, count: int) -> tuple[struct.Struct, bytes]:
    """Return the layout of a Float64MultiArray of one dimension, and the bytes of its label."""
    head = _string(label)
    return struct.Struct(f"<4sI{len(head)}sIIII{-(20 + len(head)) % 8}x{count}d"), head


def float64_array(label: str, values: Sequence[float]) -> bytes:
    """Serialise a std_msgs/msg/Float64MultiArray of one dimension with this label."""
    layout, head = _array(label, len(values))
    return layout.pack(HEADER, 1, head, len(values), len(values), 0, len(values), *values)


def pressure_limits(low: float, high: float) -> bytes:
    """Serialise a message of the topic pressure_limits, Pa."""
    return float64_array(topics.LIMITS, (low, high))


def _framed(encode: Callable[..., bytes]) -> Callable[..., bytes]:
    """Return an encoder of a message without header, which takes a stamp and a frame too."""
    return lambda _, value, frame="": encode(value)


_BY_TYPE: Mapping[str, Callable[..., bytes]] = {
    topics.FLOAT64: _framed(float64), topics.INT8: _framed(int8), topics.CLOCK: _framed(clock),
    topics.FLUID_PRESSURE: lambda stamp_ns, pressure, frame="": fluid_pressure(stamp_ns, pressure, frame=frame)}
ENCODERS: Mapping[str, Callable[..., bytes]] = {
    **{row.name: _BY_TYPE.get(row.type) or _joint_encoder(row) for row in topics.TOPICS if row.fields},
    "joint_states": joint_state}
"""Topic with a message for every tick -> function that serialises a stamp (ns) and the fields; `frame` is that of
messages with a header.
"""


def stamps(records: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the stamps of decoded messages, ns."""
    nanoseconds: NDArray[np.int64] = records["sec"].astype(np.int64) * _NANOSECONDS + records["nanosec"]
    return nanoseconds


class Layout(NamedTuple):
    """Offsets of the values in messages of one kind, as a NumPy type, with the bytes of an example message.

    `fixed` marks the bytes that every message of this layout shares: lengths, counts and names, but neither values, nor
    the frame, nor padding, in which ROS 2 sends arbitrary bytes.
    """

    record: np.dtype[np.void]
    example: NDArray[np.uint8]
    fixed: NDArray[np.bool_]

    def records(self, messages: Sequence[bytes]) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
        """Return the values of the messages with this layout, and an (n,) mask of these messages."""
        right = np.array([len(data) == len(self.example) for data in messages], dtype=np.bool_)
        joined = b"".join(data for data, whole in zip(messages, right.tolist()) if whole)
        found, right[right] = self.found(np.frombuffer(joined, np.uint8).reshape(-1, len(self.example)))
        return found, right

    def found(self, rows: NDArray[np.uint8]) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
        """Return the values of messages with this layout among (n, length) bytes, and an (n,) mask of these."""
        same: NDArray[np.bool_] = (rows[:, self.fixed] == self.example[self.fixed]).all(axis=1)
        return np.ascontiguousarray(rows[same]).view(self.record)[:, 0], same


class _Shape:
    """Bytes of a message that is laid out, and which of them are fixed."""

    def __init__(self) -> None:
        self.data, self.fixed = bytearray(HEADER + bytes(8)), bytearray(b"\1\1" + bytes(10))

    def put(self, content: bytes, same: bool) -> None:
        """Append bytes."""
        self.data.extend(content)
        self.fixed.extend(bytes([same]) * len(content))

    def align(self, size: int) -> None:
        """Append padding up to a multiple of `size`."""
        self.put(bytes(-(len(self.data) - 4) % size), False)

    def text(self, text: str, same: bool = True) -> None:
        """Append a string, whose length is fixed."""
        content = text.encode()
        self.align(4)
        self.put(_LENGTH.pack(len(content) + 1), True)
        self.put(content, same)
        self.put(b"\0", True)

    def layout(self, values: Mapping[str, int]) -> Layout:
        """Return the layout with a stamp and these doubles, by name and offset."""
        record = np.dtype({"names": ["sec", "nanosec", *values], "formats": ["<i4", "<u4"] + ["<f8"] * len(values),
                           "offsets": [4, 8, *values.values()], "itemsize": len(self.data)})
        return Layout(record, np.frombuffer(bytes(self.data), np.uint8), np.frombuffer(bytes(self.fixed), np.bool_))


def joint_state_layout(names: Sequence[str] = JOINT_NAMES, joints: Sequence[str] = JOINT_NAMES, frame_id: str = "",
                       fields: Sequence[str] = topics.topic("joint_states").fields,
                       counts: Sequence[int] | None = None) -> Layout:
    """Return the layout of joint_states with these names; ValueError if a joint is not among the names.

    Parameters
    ----------
    names : names of all joints
    joints : flywheel and clutch plate
    frame_id : frame, of which only the length matters
    fields : names of the values: positions of `joints`, then velocities, then efforts
    counts : numbers of positions, velocities and efforts, each 0 or that of the names; an array without values has no
        fields. By default all are there
    """
    shape, values = _Shape(), dict[str, int]()
    shape.text(frame_id, same=False)
    shape.align(4)
    shape.put(_LENGTH.pack(len(names)), True)
    for name in names:
        shape.text(name)
    places = [list(names).index(joint) for joint in joints]
    for number, count in enumerate(counts if counts is not None else [len(names)] * 3):
        shape.align(4)
        shape.put(_LENGTH.pack(count), True)
        if count:
            shape.align(8)
            joint_fields = fields[number * len(joints):(number + 1) * len(joints)]
            values |= {name: len(shape.data) + 8 * place for name, place in zip(joint_fields, places)}
            shape.put(bytes(8 * count), False)
    return shape.layout(values)


def fluid_pressure_layout(frame_id: str = "", field: str = "fluid_pressure") -> Layout:
    """Return the layout of FluidPressure messages with a frame of this length; `field` names the pressure."""
    shape = _Shape()
    shape.text(frame_id, same=False)
    shape.align(8)
    start = len(shape.data)
    shape.put(bytes(16), False)
    return shape.layout({field: start, "variance": start + 8})



def float64_layout(field: str) -> Layout:
    """Return the layout of Float64 messages; `field` names the value."""
    return _Shape().layout({field: 4})


def _own_layout(row: topics.Topic, frame_id: str) -> Layout:
    """Return the layout of the driveline's messages on a topic with a frame of this length."""
    if row.type == topics.FLUID_PRESSURE:
        return fluid_pressure_layout(frame_id, *row.fields)
    return joint_state_layout(row.joints, row.joints, frame_id, row.joint_fields, _counts_of(row))


_OWN = {row.name: [_own_layout(row, "x" * length) for length in (RUN_LENGTH, 0)]
        for row in (topics.topic("joint_states"), *topics.stamped())}


def own_records(messages: Sequence[bytes], name: str) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
    """Return the values of the driveline's messages on joint_states or a topic of `topics.stamped`, by field, and an
    (n,) mask of those.
    """
    layouts = _OWN[name]
    names = layouts[0].record.names or ()
    out = np.zeros(len(messages), [(name, layouts[0].record[name]) for name in names])
    own = np.zeros(len(messages), np.bool_)
    for layout in layouts:
        found, same = layout.records(messages)
        for name in names:
            out[name][same] = found[name]
        own |= same
    return out[own], own


class _Reader:
    """Cursor over the fields of a serialised message; ValueError if it is cut or of another encoding."""

    def __init__(self, data: bytes, kind: str) -> None:
        self.data, self.at, self.wrong = data, 4, ValueError(f"not a little-endian {kind}")
        if len(data) < 4 or data[1] != HEADER[1]:
            raise self.wrong

    def take(self, layout: struct.Struct, size: int = 4) -> tuple[Any, ...]:
        """Return fields aligned to `size` bytes."""
        begin = self.at + -(self.at - 4) % size
        if begin + layout.size > len(self.data):
            raise self.wrong
        self.at = begin + layout.size
        return layout.unpack_from(self.data, begin)

    def stamp(self) -> int:
        """Return a time, ns."""
        sec, nanosec = self.take(_STAMP)
        return int(sec) * _NANOSECONDS + int(nanosec)

    def count(self) -> int:
        """Return the length of a sequence."""
        return int(self.take(_LENGTH)[0])

    def text(self, errors: str = "replace") -> str:
        """Return a string."""
        size = self.count()
        if not 1 <= size <= len(self.data) - self.at:
            raise self.wrong
        begin, self.at = self.at, self.at + size
        return self.data[begin:begin + size - 1].decode(errors=errors)


def read_stamp(data: bytes) -> int:
    """Return the stamp, ns, of a message that starts with a header or a time; 0 if the message is too short."""
    if len(data) < 12:
        return 0
    sec, nanosec = _STAMP.unpack_from(data, 4)
    return int(sec) * _NANOSECONDS + int(nanosec)


def read_header(data: bytes) -> tuple[int, str]:
    """Return stamp (ns) and frame_id of a Header; ValueError if it is none, as in all these functions."""
    reader = _Reader(data, topics.HEADER)
    return reader.stamp(), reader.text()


def read_string(data: bytes) -> str:
    """Return the text of a String."""
    return _Reader(data, topics.STRING).text()


def read_float64(data: bytes) -> float:
    """Return the value of a Float64."""
    return float(_Reader(data, topics.FLOAT64).take(_DOUBLE, 8)[0])


def read_fluid_pressure(data: bytes) -> tuple[int, float]:
    """Return stamp (ns) and pressure (Pa) of a FluidPressure with any frame_id."""
    reader = _Reader(data, topics.FLUID_PRESSURE)
    stamp, _ = reader.stamp(), reader.text()
    return stamp, float(reader.take(_DOUBLES, 8)[0])


def read_float64_array(data: bytes) -> tuple[str, NDArray[np.float64]]:
    """Return the label of the dimension and the values of a Float64MultiArray of one dimension."""
    reader = _Reader(data, topics.FLOAT64_ARRAY)
    dimensions, label, _ = reader.count(), reader.text(), reader.take(_LENGTHS)
    count = reader.count()
    begin = reader.at + -(reader.at - 4) % 8
    if dimensions != 1 or len(data) != begin + 8 * count:
        raise ValueError(f"not a little-endian {topics.FLOAT64_ARRAY} of one dimension")
    return label, np.frombuffer(data, "<f8", count, begin)


def read_pressure_limits(data: bytes) -> tuple[float, float]:
    """Return the smallest and the largest pressure, Pa, of a message of pressure_limits; ValueError also unless they
    are 0 or more and ascending.
    """
    _, values = read_float64_array(data)
    if len(values) != 2 or not 0.0 <= values[0] < values[1] < math.inf:
        raise ValueError("not two ascending pressures")
    return float(values[0]), float(values[1])


class Joints(NamedTuple):
    """Frame and joint names of a JointState, and its numbers of positions, velocities and efforts."""

    frame_id: str
    names: tuple[str, ...]
    counts: tuple[int, ...]


def read_joints(data: bytes) -> Joints:
    """Return what defines the layout of a JointState; ValueError also if an array has neither no value nor one for each
    name.
    """
    reader = _Reader(data, topics.JOINT_STATE)
    _, frame_id, number = reader.stamp(), reader.text(), reader.count()
    if number > MOST_JOINTS:
        raise reader.wrong
    names, counts = tuple(reader.text("strict") for _ in range(number)), list[int]()
    for field in ("position", "velocity", "effort"):
        count = reader.count()
        if count not in (0, number):
            raise ValueError(f"{field} has {counted(count, 'value')} for {counted(number, 'name')}")
        counts.append(count)
        reader.at += (-(reader.at - 4) % 8 + 8 * count) if count else 0
    if reader.at != len(data):
        raise reader.wrong
    return Joints(frame_id, names, tuple(counts))


def read_frame(data: bytes, kind: str) -> str:
    """Return the frame of a message of this type that starts with a header."""
    reader = _Reader(data, kind)
    return (reader.stamp(), reader.text())[1]


class DiagnosticsStatus(NamedTuple):
    """DiagnosticsStatus in a DiagnosticArray: name of its sender, hardware identifier, and values by key."""

    name: str
    hardware_id: str
    values: dict[str, str]


def read_diagnostics(data: bytes) -> list[DiagnosticsStatus]:
    """Return the statuses of a DiagnosticArray."""
    reader, out = _Reader(data, topics.DIAGNOSTIC_ARRAY), list[DiagnosticsStatus]()
    reader.stamp(), reader.text()
    for _ in range(reader.count()):
        reader.at += -(reader.at - 4) % 4 + 1  # The level.
        name, _, hardware_id = reader.text(), reader.text(), reader.text()
        pairs = ((reader.text(), reader.text()) for _ in range(reader.count()))
        out.append(DiagnosticsStatus(name, hardware_id, dict(pairs)))
    return out
