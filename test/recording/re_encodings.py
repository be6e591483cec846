"""One short recording, and every way of MCAP and rosbag2 to write it again."""

import math
import random
import shutil
import struct
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import yaml
import zstandard
from driveline_bags import START, TICK, ticked
from mcap.records import Message as McapMessage
from mcap.records import Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from tcc_sim.messages import cdr
from tcc_sim.messages.held import held_message
from tcc_sim.recording.announcements import holding_from
from tcc_sim.recording.bag import BagWriter
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLOAT64, FLOAT64_ARRAY, FLUID_PRESSURE, HEADER, JOINT_STATE, STRING

SCENE = load_scene("commands").with_values({"rate": 1000.0})
OF_PACKAGE, OTHER = "0" * 23 + "1", "0" * 23 + "2"
"""Identifiers of the processes of driveline and controller."""
STATES, SCENES, REPORTS = "/joint_states", "/scene", "/held"


class Channel(NamedTuple):
    topic: str
    encoding: str
    metadata: Mapping[str, str]
    schema: tuple[str, str, bytes] | None


class Message(NamedTuple):
    channel: int
    log: int
    sent: int
    number: int
    data: bytes


class Recording(NamedTuple):
    """Channels by number, messages in the order of the file, and metadata records."""

    channels: dict[int, Channel]
    messages: list[Message]
    metadata: list[tuple[str, dict[str, str]]]

    def numbers(self, topic):
        return {number for number, channel in self.channels.items() if channel.topic == topic}

    def changed(self, topic, change):
        """The recording with the data of every message of a topic replaced by change(k, data), None to leave it out."""
        mine, out, k = self.numbers(topic), [], 0
        for message in self.messages:
            data = message.data
            if message.channel in mine:
                data, k = change(k, data), k + 1
            if data is not None:
                out.append(message._replace(data=data))
        return self._replace(messages=out)

    def channel(self, change):
        return self._replace(channels={number: change(channel) for number, channel in self.channels.items()})

    def with_topic(self, topic, kind, data, every=50, log=0, number=200):
        """The recording with another topic's message before every so many of its own."""
        out = []
        for k, message in enumerate(self.messages):
            if k % every == 0:
                out.append(Message(number, message.log + log, message.sent, k, data))
            out.append(message)
        return self._replace(channels={**self.channels, number: Channel(topic, "cdr", {}, (kind, "ros2msg", b""))},
                             messages=out)


RUN = "692a1f3c9b02.001"


def made(folder, ticks=220, named=True):
    """Write a driveline on commands, then on its fallback, as the recorder does; return the recording.

    Without `named` it is one of version 1.0: no run in the frames, and the topic input_source in place of held."""
    said, sources = [], []
    rows = ticked(SCENE, ticks, torque=lambda k: 300.0 + 250.0 * np.sin(0.15 * k) if 30 < k < 170 else None,
                  pressure=lambda k: 2.4e5 + 1e3 * (k // 50) if 30 < k < 170 else None, said=said, sources=sources)
    scene, frame = holding_from(SCENE.text(), 0, run=RUN, name="/driveline") if named else SCENE.text(), RUN * named
    writer = BagWriter(folder, scene)
    draw = random.Random(1)
    one = {name: writer.channel(name, kind, publisher=who + end) for name, kind, who, end in (
        (SCENES, STRING, OF_PACKAGE, "01"), (REPORTS, FLOAT64_ARRAY, OF_PACKAGE, "02") if named else (
            "/input_source", HEADER, OF_PACKAGE, "02"), (STATES, JOINT_STATE, OF_PACKAGE, "03"),
        ("/applied_pressure", FLUID_PRESSURE, OF_PACKAGE, "04"), ("/slip_speed", FLOAT64, OF_PACKAGE, "05"),
        ("/engine_torque", FLOAT64, OTHER, "01"), ("/actuation_pressure", FLUID_PRESSURE, OTHER, "02"))}
    writer.write(one[SCENES], START - TICK, START - TICK, cdr.string(scene), 1)
    changes = {row: (stamp, text) for row, stamp, text in sources}
    for k, (stamp, *values, pressure) in enumerate(rows):
        sent = START + k * TICK
        log = sent + draw.randrange(20_000, 60_000)
        if named:
            acts, count = 30 < k < 170, min(max(k - 30, 0), 139)
            inputs = [entry for value, answered in ((values[4], math.nan), (pressure, float(stamp - TICK)))
                      for entry in ((2.0, value, value, answered, k, 1, count, 0, 0, 0) if acts else
                                    (1.0, *[math.nan] * 4, 0, count, 0, 0, 0))]
            writer.write(one[REPORTS], log - 1000, sent - 1000, held_message(RUN, [
                k, stamp, k + 1, k == ticks - 1, *inputs, *2 * [3.0, *[math.nan] * 4, 0, 0, 0, 0, 0]]), k + 1)
        elif k in changes:
            writer.write(one["/input_source"], log - 1000, sent - 1000, cdr.header(*changes[k]), k + 1)
        writer.write(one[STATES], log, sent, cdr.joint_state(stamp, *values, frame=frame), k + 1)
        writer.write(one["/applied_pressure"], log + 1000, sent + 1000,
                     cdr.fluid_pressure(stamp, pressure, frame=frame), k + 1)
        writer.write(one["/slip_speed"], log + 2000, sent + 2000, cdr.float64(values[2] - values[3]), k + 1)
        if 29 < k < min(169, ticks - 1):
            log += 300_000
            writer.write(one["/engine_torque"], log + 3000, sent + 300_000, cdr.float64(rows[k + 1][5]), k + 1)
            writer.write(one["/actuation_pressure"], log + 4000, sent + 310_000,
                         cdr.fluid_pressure(stamp, rows[k + 1][7]), k + 1)
        if k % 50 == 49:
            writer.file.flush()
    writer.close({"lost": {STATES: 0}})
    return read(folder / f"{folder.name}_0.mcap")


def read(path):
    """Take an MCAP file apart by the mcap package."""
    channels, messages, metadata, schemas = {}, [], [], {}
    with path.open("rb") as file:
        for record in StreamReader(file, validate_crcs=True).records:
            kind = type(record).__name__
            if kind == "Schema":
                schemas[record.id] = (record.name, record.encoding, record.data)
            elif kind == "Channel":
                channels[record.id] = Channel(record.topic, record.message_encoding, dict(record.metadata),
                                              schemas[record.schema_id])
            elif isinstance(record, McapMessage):
                messages.append(Message(record.channel_id, record.log_time, record.publish_time, record.sequence,
                                        record.data))
            elif isinstance(record, Metadata):
                metadata.append((record.name, dict(record.metadata)))
    return Recording(channels, messages, metadata)


def save(path, source, *, metadata=True, start=None, end=None, of_package=True, **options):
    """Write a file by the mcap package; `start(writer, file)` and `end(writer, file)` add records of their own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    options.setdefault("compression", CompressionType.ZSTD)
    options.setdefault("chunk_size", 40_000)
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2", library="other")
        if start is not None:
            start(writer, file)
        scenes, others = ([one for one in source.metadata if (one[0] == "tcc_sim") is of_package]
                          for of_package in (True, False))
        for name, values in scenes if metadata else ():
            writer.add_metadata(name, values)
        schemas, numbers = {}, {}
        for message in source.messages:
            if message.channel not in numbers:
                channel = source.channels[message.channel]
                if channel.schema is not None and channel.schema not in schemas:
                    schemas[channel.schema] = writer.register_schema(*channel.schema)
                numbers[message.channel] = writer.register_channel(
                    channel.topic, channel.encoding, schemas[channel.schema] if channel.schema else 0,
                    dict(channel.metadata))
            writer.add_message(numbers[message.channel], message.log, message.data, message.sent, message.number)
        if end is not None:
            end(writer, file)
        for name, values in others if metadata else ():
            if name != "rosbag2":
                writer.add_metadata(name, values)
        writer.finish()


def listing(folder, names, **more):
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": {
        "version": 9, "storage_identifier": "mcap", "relative_file_paths": names, **more}}))


def joints(data):
    """Stamp (ns) and values of a message of the driveline's."""
    (record,) = cdr.own_records([data], "joint_states")
    stamp, *values = (record[name].item() for name in record.dtype.names)
    return stamp * 10**9 + values[0], *values[1:]


def frame_of(data):
    """Frame of a message of the driveline's."""
    return cdr.read_header(data)[1]


def joint_state(stamp, names, columns, frame=""):
    """Serialise a JointState by the rules of CDR: names, and lists of positions, velocities and efforts."""
    out = bytearray(struct.pack("<iI", *divmod(stamp, 10**9)))

    def text(word):
        out.extend(bytes(-len(out) % 4) + struct.pack("<I", len(word.encode()) + 1) + word.encode() + b"\0")

    text(frame)
    out.extend(bytes(-len(out) % 4) + struct.pack("<I", len(names)))
    for name in names:
        text(name)
    for column in columns:
        out.extend(bytes(-len(out) % 4) + struct.pack("<I", len(column)))
        if column:
            out.extend(bytes(-len(out) % 8) + struct.pack(f"<{len(column)}d", *column))
    return b"\0\1\0\0" + bytes(out)


def without(what):
    """Function that leaves out the positions or efforts of a state, or makes its efforts NaN."""
    def change(_, data):
        stamp, *values = joints(data)
        columns = {"positions": values[:2], "velocities": values[2:4], "efforts": values[4:]}
        columns |= {"efforts": [np.nan] * 2} if what == "NaN" else {what: []}
        return joint_state(stamp, ["flywheel", "clutch_plate"], list(columns.values()), frame_of(data))
    return change


def laid_out(names, frame=None, flywheel="flywheel", clutch_plate="clutch_plate"):
    """Function that lays a state out again with these joints, the two among them; None keeps its frame."""
    def change(_, data):
        stamp, *values = joints(data)
        columns = []
        for pair in zip(values[::2], values[1::2]):
            given = dict(zip((flywheel, clutch_plate), pair))
            columns.append([given.get(name, 7.0) for name in names])
        return joint_state(stamp, names, columns, frame_of(data) if frame is None else frame)
    return change


FINGER = joint_state(123, ["finger"], [[0.0], [0.0], [0.0]])
OLD, UNSORTED = [f"run_{number}.mcap" for number in range(11)], ["z.mcap", "a.mcap", "m.mcap"]
NEW = [f"{number}_run_2026_11_27-10_{58 - 5 * number:02d}_{50 - number}.mcap" for number in range(11)]


def by(change=lambda source: source, **options):
    """Way that changes the recording and writes it with options of the writer."""
    return lambda folder, source: save(folder / "run_0.mcap", change(source), **options)


def by_channel(change):
    """Way that changes the topic, or the name, encoding and text of the schema, of every channel."""
    return by(lambda source: source.channel(change))


def by_state(change):
    """Way that changes the data of the state k."""
    return by(lambda source: source.changed(STATES, change))


def with_schema(change):
    return by_channel(lambda c: c._replace(schema=change(*c.schema)))


def with_record(*parts):
    """Way that puts records at the beginning, by the opcode and the body of each."""
    return by(start=lambda _, file: [file.write(struct.pack("<BQ", opcode, len(body)) + body)
                                     for opcode, body in zip(parts[::2], parts[1::2])])


def with_bytes(change):
    """Way that changes the bytes of the file."""
    def write(folder, source):
        save(folder / "x.mcap", source)
        (folder / "run_0.mcap").write_bytes(change((folder / "x.mcap").read_bytes()))
        (folder / "x.mcap").unlink()
    return write


def in_parts(names, after=None, change=lambda source: source):
    """Way that writes parts; `after(folder)` adds to them."""
    def write(folder, source):
        source = change(source)
        size = len(source.messages) // len(names) + 1
        for number, name in enumerate(names):
            save(folder / name, source._replace(messages=source.messages[number * size:(number + 1) * size]))
        if after is not None:
            after(folder)
    return write


def without_publishers(source):
    return source.channel(lambda c: c._replace(metadata={k: v for k, v in c.metadata.items() if k != "publisher"}))


def with_messages(source, change):
    return source._replace(messages=list(map(change, source.messages)))


def as_rosbag2(source):
    """The recording as `ros2 bag record -a` makes it: no metadata, publisher, number or time of sending."""
    return with_messages(without_publishers(source)._replace(metadata=[]), lambda m: m._replace(number=0, sent=m.log))


def set_back(source):
    """The clock is set back by 2 s in the middle."""
    half = len(source.messages) // 2
    return source._replace(messages=[*source.messages[:half], *(
        m._replace(log=m.log - 2 * 10**9, sent=m.sent - 2 * 10**9) for m in source.messages[half:])])


def repeated_channels(source):
    """Channels of the same topic and publisher; their schemas have the same name and other texts."""
    channels, out = {}, []
    for k, message in enumerate(source.messages):
        number, old = 1 + message.channel + 20 * (k % 10), source.channels[message.channel]
        channels[number] = old._replace(schema=(old.schema[0], "ros2msg", old.schema[2] + b"#" * (k % 10)))
        out.append(message._replace(channel=number))
    return source._replace(channels=channels, messages=out)


UNKNOWN_CHUNK = struct.pack("<QQQI", 5, 6, 9, 0) + struct.pack("<I", 2) + b"xz" + struct.pack("<Q", 4) + b"abcd"


def another_topic_in_a_chunk_of_unknown_compression(writer, file):
    """Its index says that it holds another topic alone."""
    schema = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"")
    writer.register_channel("/image", "cdr", schema, {})
    index = struct.pack("<HIQQ", 1, 16, 5, 0)
    for opcode, body in ((6, UNKNOWN_CHUNK), (7, index)):
        file.write(struct.pack("<BQ", opcode, len(body)) + body)


def without_data_end(data):
    place = data.rindex(struct.pack("<BQ", 15, 4))
    return data[:place] + data[place + 13:]


def compressed_messages(folder, source):
    pack = zstandard.ZstdCompressor().compress
    save(folder / "run_0.mcap", with_messages(source, lambda m: m._replace(data=pack(m.data))))
    listing(folder, ["run_0.mcap"], compression_format="zstd", compression_mode="MESSAGE")


def with_another_node(source):
    mine = source.numbers(STATES)
    return source._replace(messages=[one for m in source.messages for one in (
        (m._replace(data=FINGER), m) if m.channel in mine else (m,))])


def moved(source, to):
    return source.channel(lambda c: c._replace(topic=to + c.topic))


def twice(source, right):
    """The recording with a copy of every message, of another run, on other channels."""
    return source._replace(
        channels={**source.channels, **{100 + number: right(channel) for number, channel in source.channels.items()}},
        messages=[one for m in source.messages for one in (m, m._replace(channel=m.channel + 100, data=m.data.replace(
            RUN.encode(), b"00000000ffff.001")))])


def left_and_right(source):
    return as_rosbag2(twice(moved(source, "/lef"), lambda c: c._replace(topic=c.topic.replace("/lef/", "/right/"))))


def forgotten(source, who="3" * 24, ahead=50):
    """The recording beside an older driveline with another scene on the same topics, received some ticks ahead."""
    older = twice(source, lambda c: c._replace(metadata={
        **c.metadata, "publisher": who + c.metadata["publisher"][24:]}))
    out = []
    for message in older.messages:
        topic = older.channels[message.channel].topic
        if message.channel < 100:
            out.append(message)
        elif topic == STATES:
            stamp, *values = joints(message.data)
            out.append(message._replace(log=message.log - ahead * TICK, sent=message.sent - ahead * TICK,
                                        data=cdr.joint_state(stamp + 70 * 10**9, *values)))
        elif topic == SCENES:
            out.append(message._replace(log=message.log - ahead * TICK, data=cdr.string(load_scene("fig02").text())))
        elif topic == "/applied_pressure":
            out.append(message._replace(data=cdr.fluid_pressure(cdr.read_stamp(message.data) + 70 * 10**9, 1.0)))
        elif topic == "/input_source":
            out.append(message._replace(data=cdr.header(0, "engine_torque: command, actuation_pressure: command")))
    return older._replace(messages=sorted(out, key=lambda m: m.log))


def forgotten_without_pressure(source):
    """Only the older one publishes the topic, and only the newer one is read."""
    both = forgotten(source)
    numbers = {number for number in both.numbers("/applied_pressure") if number > 100}
    return both._replace(messages=[m for m in both.messages if m.channel not in numbers])


def with_frames(source):
    ways = [laid_out(["flywheel", "clutch_plate"], "x" * length) for length in range(17)]
    source = source.changed(STATES, lambda k, data: ways[k % 17](k, data))
    for topic in ("/applied_pressure", "/actuation_pressure"):
        source = source.changed(topic, lambda k, data: framed(data, "f" * (k % 17)))
    return source


def framed(data, frame):
    """A FluidPressure with a frame."""
    body = data[4:12] + struct.pack("<I", len(frame) + 1) + frame.encode() + b"\0"
    return data[:4] + body + bytes(-len(body) % 8) + data[20:36]


ORDERS = [laid_out(names) for names in (["flywheel", "clutch_plate"], ["clutch_plate", "flywheel"])]
FIRST_ODD = laid_out(["arm", "flywheel", "clutch_plate"])
WAYS = {
    # Storage.
    "lz4_in_small_chunks": by(compression=CompressionType.LZ4, chunk_size=2000),
    "one_chunk_without_compression": by(compression=CompressionType.NONE, chunk_size=1 << 30),
    "no_summary": by(index_types=IndexType.NONE, repeat_channels=False, repeat_schemas=False, use_statistics=False,
                     use_summary_offsets=False),
    "no_chunk_index": by(index_types=IndexType.ATTACHMENT | IndexType.METADATA),
    "no_message_index_and_statistics": by(index_types=IndexType.CHUNK, use_statistics=False),
    "outside_chunks": by(use_chunking=False), "no_checksums": by(enable_crcs=False),
    "data_checksum": by(enable_data_crcs=True), "unknown_records": with_record(0x10, bytes(5), 0xFF, bytes(5)),
    "large_private_record": with_record(0x91, bytes(20 << 20)),
    "large_attachment": by(start=lambda writer, _: writer.add_attachment(0, 0, "x", "y", bytes(20 << 20))),
    "chunk_without_messages": with_record(6, bytes(40)),
    "chunk_of_unknown_compression": with_record(6, UNKNOWN_CHUNK),
    "chunk_of_unknown_compression_without_driveline": by(start=another_topic_in_a_chunk_of_unknown_compression,
                                                         use_statistics=False),
    "blank_map_beside": by(lambda source: source.with_topic("/map", "nav_msgs/msg/OccupancyGrid", bytes(1 << 20),
                                                            every=60), chunk_size=1 << 20),
    "image_outside_chunks": by(lambda source: source.with_topic("/image", "sensor_msgs/msg/Image", bytes(20 << 20),
                                                                every=10**9), use_chunking=False),
    "no_data_end": with_bytes(without_data_end), "no_footer": with_bytes(lambda data: data[:-37]),
    "wrong_summary_checksum": with_bytes(lambda data: data[:-9] + bytes([data[-9] ^ 1]) + data[-8:]),
    "compressed_messages": compressed_messages,
    # Topics, types, channels and times.
    "no_leading_slash_and_types_without_msg": by_channel(lambda c: c._replace(
        topic=c.topic[1:], schema=(c.schema[0].replace("/msg/", "/"), *c.schema[1:]))),
    "schema_without_text": with_schema(lambda name, *_: (name, "", b"")),
    "schema_zero": by_channel(lambda c: c._replace(schema=None)),
    "a_channel_for_every_tenth_message": by(repeated_channels), "no_publisher": by(without_publishers),
    "by_rosbag2": by(as_rosbag2),
    "no_times": by(lambda source: with_messages(source, lambda m: m._replace(log=0, sent=0))),
    # Parts.
    "parts": in_parts(OLD),
    "parts_by_rosbag2": in_parts(UNSORTED, lambda folder: listing(folder, UNSORTED), as_rosbag2),
    "parts_after_the_clock_was_set_back": in_parts(OLD, change=set_back),
    "parts_named_counter_first": in_parts(NEW, lambda folder: listing(folder, NEW)),
    "parts_named_counter_first_without_listing": in_parts(NEW),
    "parts_of_any_name_listed": in_parts(["z 1.mcap", "a'2.mcap", "m: 3.mcap"], lambda folder: (
        folder / "metadata.yaml").write_text("# quoted\nrosbag2_bagfile_information: {relative_file_paths: ["
                                             "'z 1.mcap', \"a'2.mcap\", 'm: 3.mcap']}\n")),
    "part_not_listed": in_parts(OLD[:3], lambda folder: (shutil.copy(folder / OLD[0], folder / "copy_7.mcap"),
                                                         listing(folder, OLD[:3]))),
    "part_listed_and_absent": in_parts(OLD[:3], lambda folder: listing(folder, OLD[:4])),
    "listing_not_valid": in_parts(NEW[:3], lambda folder: (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: [\n")),
    # Other nodes.
    "another_node_on_the_topic": by(with_another_node),
    "joint_states_of_a_robot_beside": by(lambda source: moved(source, "/clutch").with_topic(STATES, JOINT_STATE, FINGER,
                                                                                            every=47)),
    "left_and_right": by(left_and_right), "forgotten_driveline": by(forgotten),
    # The recorder discovers the older driveline after the one that waited for it.
    "forgotten_driveline_received_later": by(lambda source: forgotten(source, ahead=-5)),
    "forgotten_driveline_without_pressure": by(forgotten_without_pressure),
    "messages_of_another_type_on_the_topic": by(lambda source: source.with_topic(
        STATES, "sensor_msgs/msg/Image", b"\0\1\0\0" + bytes(200))),
    "messages_that_are_no_joint_states": by(lambda source: source.with_topic(STATES, JOINT_STATE,
                                                                             b"\0\1\0\0" + bytes(7))),
    # Layout of the states.
    "further_joints": by_state(laid_out(["wheel", "clutch_plate", "a", "flywheel"])),
    "joints_that_alternate": by_state(lambda k, data: ORDERS[k % 2](k, data)),
    "first_message_odd": by_state(lambda k, data: data if k else FIRST_ODD(k, data)), "frames": by(with_frames),
}
"""Functions (folder, recording) that write the recording again, by name."""
UNCHECKED, UNKNOWN = ({"warnings"}, "some messages have no checksum"), "recorded by an unknown version"
FORGOTTEN = {"drivelines", "warnings"}, "not read: /joint_states of publisher 3"
DIFFERS = {
    "outside_chunks": UNCHECKED, "no_checksums": UNCHECKED, "image_outside_chunks": UNCHECKED,
    "no_publisher": ({"drivelines"}, ""),
    **dict.fromkeys(("by_rosbag2", "parts_by_rosbag2"), ({"drivelines", "warnings"}, UNKNOWN)),
    "no_times": ({"real_time_factor", "warnings"}, ""),
    "parts_after_the_clock_was_set_back": ({"real_time_factor", "warnings"}, "times of receipt went back by 2.0000"),
    "part_not_listed": ({"warnings"}, "left out: metadata.yaml does not list copy_7.mcap"),
    "part_listed_and_absent": ({"warnings", "complete"}, "the part run_3.mcap, which metadata.yaml lists, is missing"),
    "listing_not_valid": ({"warnings"}, "metadata.yaml lists no parts that can be read"),
    "chunk_of_unknown_compression": ({"warnings"}, "is left out: its compression 'xz' is unknown"),
    "no_footer": ({"warnings", "complete"}, "cut short"),
    "another_node_on_the_topic": ({"drivelines", "warnings"}, "not read: /joint_states"),
    "joint_states_of_a_robot_beside": ({"drivelines", "warnings"}, "not read: /joint_states:"),
    "left_and_right": ({"drivelines", "warnings"}, "not read: /right/joint_states"),
    **dict.fromkeys(("forgotten_driveline", "forgotten_driveline_received_later",
                     "forgotten_driveline_without_pressure"), FORGOTTEN),
    "further_joints": ({"drivelines"}, ""), "messages_of_another_type_on_the_topic": ({"drivelines"}, ""),
    "messages_that_are_no_joint_states": ({"warnings", "drivelines"},
                                          "messages of /joint_states left out: their layout differs"),
}
"""By way: names of the fields that may differ, and a part of the sentence that gives the reason."""
