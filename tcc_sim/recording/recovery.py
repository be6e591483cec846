"""Write a complete, indexed bag from a recording that was cut short or damaged; the original is not changed."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from tcc_sim.errors import RecordingError
from tcc_sim.messages.definitions import Definition
from tcc_sim.recording.bag import BagWriter
from tcc_sim.recording.contents import Channel
from tcc_sim.recording.mcap_file import RECOVERY_RECORD, RELIABLE, ROW_KEY
from tcc_sim.recording.parts import LOADER
from tcc_sim.recording.reader import Run
from tcc_sim.recording.records import MESSAGE_HEAD

_LONGEST_PROFILES, _LONGEST_ALL_PROFILES = 20_000, 400_000
"""Characters of quality of service to parse, of one channel and of all: the YAML reader takes 1 s for 0.2 MB."""
_MESSAGE = struct.Struct("<HIQQ")
"""Head of a message record: channel, sequence number, times of receipt and sending, ns."""


@dataclass(frozen=True)
class Recovery:
    """Result of a recovery: the new bag, messages saved by topic, whether the original was complete, and the losses."""

    directory: Path
    messages: dict[str, int]
    complete: bool
    missing: list[str]


def default_directory(path: Path) -> Path:
    """Return the default directory of a recovery, a sibling of the original."""
    original = path.resolve()
    return original.parent / f"{original.stem if original.is_file() else original.name}_recovered"


def recover(run: Run, directory: Path) -> Recovery:
    """Write every readable message into a new bag, with the scenes of the original and a record of the losses.

    A recovery that fails or is interrupted deletes its bag, so that the same command can be run again. RecordingError
    if the directory exists or nothing can be read; OSError, which names the directory, if the disk is full.
    """
    with BagWriter(directory) as bag:
        for scene in run.recorded_scenes:
            bag.describe(scene.text, scene.version, scene.log_ns)
        channels, profiles = dict[tuple[str, str, str], int](), dict[str, list[dict[str, Any]]]()

        def channel_of(channel: Channel) -> int:
            key = (channel.topic, channel.type, channel.publisher)
            if key not in channels:
                schema = Definition(channel.definition, channel.metadata.get("topic_type_hash", ""))
                text = channel.metadata.get("offered_qos_profiles", "")[:_LONGEST_PROFILES]
                if text not in profiles:
                    known = sum(map(len, profiles)) + len(text) <= _LONGEST_ALL_PROFILES
                    profiles[text] = _parsed(text if known else "")
                channels[key] = bag.channel(channel.topic, channel.type, profiles[text], schema, channel.publisher,
                                            channel.metadata.get(ROW_KEY, ""))
            return channels[key]

        copy_messages(run, bag, channel_of)
        if not channels:
            reason = f" ({run.warnings[0]})" if run.warnings else ""
            raise RecordingError(f"{run.paths[0]}: nothing in it can be recovered{reason}")
        bag.file.note(RECOVERY_RECORD, run.warnings)
        bag.close(run.result)
    counts = {topic: run.messages[topic] for topic, _, _ in channels}
    return Recovery(directory, counts, run.complete, list(run.warnings))


def copy_messages(run: Run, bag: BagWriter, channel_of: Callable[[Channel], int | None]) -> None:
    """Write the readable messages of a recording, as they are, into the channels of a bag; None leaves them out."""
    for data, messages, channels in run.chunks():
        numbers = {number: channel_of(channels[number]) for number in dict.fromkeys(messages.channel.tolist())
                   if number in channels}
        for offset, length in zip(messages.offset.tolist(), messages.length.tolist()):
            source, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(data, offset)
            if (number := numbers.get(source)) is not None:
                bag.write(number, log_ns, publish_ns, data[offset + MESSAGE_HEAD:offset + length], sequence)


def _parsed(text: str) -> list[dict[str, Any]]:
    """Parse quality of service from YAML; return the driveline's if it is not valid."""
    try:
        # Aliases of anchors can expand a few bytes without limit.
        plain = not any(getattr(event, "anchor", None) for event in yaml.parse(text, Loader=LOADER))
        profiles = yaml.load(text, Loader=LOADER) if plain else None  # noqa: S506
    except (yaml.YAMLError, RecursionError, ValueError):
        profiles = None
    if isinstance(profiles, list) and all(isinstance(profile, dict) for profile in profiles):
        return profiles
    return [dict(profile) for profile in RELIABLE]
