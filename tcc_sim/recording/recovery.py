"""Write a complete, indexed bag from a recording that was cut short or damaged; the original is not changed."""

from __future__ import annotations

import struct
from collections.abc import Mapping
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
from tcc_sim.recording.records import Messages

_LONGEST_PROFILES, _LONGEST_ALL_PROFILES = 20_000, 400_000
"""Characters of quality of service to parse, of one channel and of all: the YAML reader takes 1 s for 0.2 MB."""
MESSAGE = struct.Struct("<HIQQ")
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

    A recovery that fails or is interrupted deletes its bag, so that the same command can be run again.

    Raises
    ------
    RecordingError
        The directory exists or cannot be created, or nothing can be read.
    OSError
        The disk is full or fails; the error names `directory`.
    """
    copy = _Copy(run, directory)
    try:
        run.tapped(copy)
        if copy.bag is None:
            reason = f" ({run.warnings[0]})" if run.warnings else ""
            raise RecordingError(f"{run.paths[0]}: nothing in it can be recovered{reason}")
        copy.bag.file.note(RECOVERY_RECORD, run.warnings)
        copy.bag.close(run.result)
    except BaseException as error:
        if copy.bag is not None:
            copy.bag.discard(error)
        raise
    saved, counts = copy.bag.counts, dict[str, int]()
    for (topic, _, _), number in copy.known.items():
        counts[topic] = counts.get(topic, 0) + saved[number]
    return Recovery(directory, counts, run.complete, list(run.warnings))


class _Copy:
    """Tap that copies the messages whose topic is described; it creates the bag at the first chunk."""

    def __init__(self, run: Run, directory: Path) -> None:
        self.bag: BagWriter | None = None
        self.known: dict[tuple[str, str, str], int] = {}
        self._profiles: dict[str, list[dict[str, Any]]] = {}
        self._parsed = 0
        self._scenes = run.recorded_scenes
        self._directory = directory

    def __call__(self, data: bytes, messages: Messages, channels: Mapping[int, Channel]) -> None:
        """Copy one chunk."""
        if self.bag is None:
            self.bag = BagWriter(self._directory)
            for scene in self._scenes:
                self.bag.describe(scene.text, scene.version, scene.log_ns)
        numbers: dict[int, int] = {}
        for offset, length in zip(messages.offset.tolist(), messages.length.tolist()):
            source, sequence, log_ns, publish_ns = MESSAGE.unpack_from(data, offset)
            if source not in numbers:
                if source not in channels:
                    continue
                numbers[source] = self._channel(self.bag, channels[source])
            self.bag.write(numbers[source], log_ns, publish_ns, data[offset + MESSAGE.size:offset + length], sequence)

    def _channel(self, bag: BagWriter, channel: Channel) -> int:
        """Return the new bag's channel for a channel of the original."""
        key = (channel.topic, channel.type, channel.publisher)
        if key not in self.known:
            text = channel.metadata.get("offered_qos_profiles", "")[:_LONGEST_PROFILES]
            if text not in self._profiles:
                self._parsed += len(text)
                self._profiles[text] = _parsed(text if self._parsed <= _LONGEST_ALL_PROFILES else "")
            schema = Definition(channel.definition, channel.metadata.get("topic_type_hash", ""))
            self.known[key] = bag.channel(channel.topic, channel.type, self._profiles[text], schema, channel.publisher,
                                           channel.metadata.get(ROW_KEY, ""))
        return self.known[key]


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
