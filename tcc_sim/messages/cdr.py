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
from typing import Any, NamedTuple, TypeVar

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
Read = TypeVar("Read")
FRAME = 16
"""Byte at which the frame of a message with a header begins."""
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
    counts = tuple(len(row.joints) if there else 0 for there in row.arrays)

    def encode(stamp_ns: int, *values: float, frame: str = "") -> bytes:
        layout, head = _joints(row.joints, counts, frame)
        rest, parts = iter(values), list[float]()
        for count in counts:
            parts += count, *islice(rest, count)
        return layout.pack(HEADER, *divmod(stamp_ns, _NANOSECONDS), head, *parts)

    return encode


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


class _Reader:
    """Cursor over the fields of a serialised message; ValueError if it is cut or of another encoding."""

    def __init__(self, data: bytes, kind: str) -> None:
        self.data, self.at, self.wrong = data, 4, ValueError(f"not a little-endian {kind}")
        if len(data) < 4 or data[1] != HEADER[1]:
            raise self.wrong

    def align(self, size: int) -> int:
        """Skip the padding before a field aligned to `size` bytes, and return the place of the field."""
        self.at += -(self.at - 4) % size
        return self.at

    def take(self, layout: struct.Struct, size: int = 4) -> tuple[Any, ...]:
        """Return fields aligned to `size` bytes."""
        begin = self.align(size)
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


def layout_of(data: bytes, kind: str, fields: Sequence[str], joints: Sequence[str] = ()
              ) -> tuple[tuple[str, ...], Layout]:
    """Return the joint names of a message, and the layout of the messages that differ from it only in stamp, frame and
    values; ValueError also for a JointState with an array that has neither no value nor one for each name.

    Parameters
    ----------
    data : a message
    kind : FLUID_PRESSURE, FLOAT64 or JOINT_STATE
    fields : name of the value; of a JointState names of the positions of `joints`, then of the velocities, then of the
        efforts; an array without values has no fields
    joints : names of the joints whose values are wanted; if one is absent, the layout has no fields
    """
    reader, same = _Reader(data, kind), np.zeros(len(data), np.bool_)
    names, offsets = tuple[str, ...](), dict[str, int]()

    def fixed(read: Callable[[], Read]) -> Read:
        begin = reader.align(4)
        value = read()
        same[begin:reader.at] = True
        return value

    if kind != topics.FLOAT64:
        reader.stamp()
        fixed(reader.text)
        same[FRAME:reader.at - 1] = False
    if kind == topics.JOINT_STATE:
        number = fixed(reader.count)
        if number > MOST_JOINTS:
            raise reader.wrong
        names = tuple(fixed(lambda: reader.text("strict")) for _ in range(number))
        for place, array in enumerate(("position", "velocity", "effort")):
            count = fixed(reader.count)
            if count not in (0, number):
                raise ValueError(f"{array} has {counted(count, 'value')} for {counted(number, 'name')}")
            if count:
                reader.align(8)
                own = zip(fields[place * len(joints):], joints) if set(joints) <= set(names) else ()
                offsets |= {name: reader.at + 8 * names.index(joint) for name, joint in own}
                reader.at += 8 * count
    else:
        reader.align(8)
        for name in (*fields, "variance") if kind == topics.FLUID_PRESSURE else fields:
            offsets[name], reader.at = reader.at, reader.at + 8
    if reader.at != len(data) or data[:2] != HEADER[:2]:
        raise reader.wrong
    same[:2] = True
    record = np.dtype({"names": ["sec", "nanosec", *offsets], "formats": ["<i4", "<u4"] + ["<f8"] * len(offsets),
                       "offsets": [4, 8, *offsets.values()], "itemsize": len(data)})
    return names, Layout(record, np.frombuffer(data, np.uint8), same)


_OWN = {row.name: [layout_of(ENCODERS[row.name](0, *[0.0] * len(row.fields), frame="x" * length), row.type,
                             row.joint_fields or row.fields, row.joints)[1] for length in (RUN_LENGTH, 0)]
        for row in (topics.topic("joint_states"), *topics.stamped())}


def own_records(messages: Sequence[bytes], name: str) -> NDArray[np.void]:
    """Return the values of the driveline's messages on joint_states or a topic of `topics.stamped`, by field."""
    kind = _OWN[name][0].record
    out = np.zeros(len(messages), [(field, kind[field]) for field in kind.names or ()])
    own = np.zeros(len(messages), np.bool_)
    for layout in _OWN[name]:
        found, same = layout.records(messages)
        out[same] = found
        own |= same
    return out[own]


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


def read_pressure_limits(data: bytes) -> tuple[float, float]:
    """Return the smallest and the largest pressure, Pa, of a message of pressure_limits; ValueError also unless they
    are 0 or more and ascending.
    """
    reader = _Reader(data, topics.FLOAT64_ARRAY)
    dimensions, _, _, count = reader.count(), reader.text(), reader.take(_LENGTHS), reader.count()
    low, high = reader.take(_DOUBLES, 8)
    if (dimensions, count) != (1, 2) or reader.at != len(data) or not 0.0 <= low < high < math.inf:
        raise ValueError("not two ascending pressures")
    return low, high


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
        reader.at = reader.align(4) + 1  # The level.
        name, _, hardware_id = reader.text(), reader.text(), reader.text()
        pairs = ((reader.text(), reader.text()) for _ in range(reader.count()))
        out.append(DiagnosticsStatus(name, hardware_id, dict(pairs)))
    return out
