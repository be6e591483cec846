"""The driveline's announcements beside its states, as they are written and read: its scene, and which inputs a command
held.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from tcc_sim.messages import cdr
from tcc_sim.model.profile import START, Origin
from tcc_sim.topics import INPUTS

COMMAND, FALLBACK = "command", "fallback"
MOST_SOURCES = 100_000
"""Announced sources of the inputs of a recording that are followed."""
MOST_SCENES = 10_000
"""Scenes of a recording that are followed."""
_TIMES, HEAD, LONGEST = struct.Struct("<QQ"), 22, 4096
_NUMBER = r"(-?\d[\de.+-]{0,30})"
_LINE = re.compile(r"# holds from stamp (\d{1,19}) ns on(, in the kernel with every term)?"
                   rf"(?:, phase {_NUMBER} rad at {_NUMBER} s, the load's ahead by {_NUMBER} rad)?")


def holding_from(text: str, stamp_ns: int, general: bool, origin: Origin = START) -> str:
    """The text of a scene that was changed while running, with a last line, a comment, that says what it applies to.

    Parameters
    ----------
    text : the scene (YAML)
    stamp_ns : stamp of the first state that it leads to: the tick after the change, or 0 where it holds since a reset
    general : the kernel with every term solves it (`general_terms`), since the driveline started with other terms
    origin : where the phases are counted from
    """
    phases = (f", phase {origin.phase!r} rad at {origin.time!r} s, the load's ahead by {origin.lead!r} rad"
              if origin != START else "")
    return f"{text}# holds from stamp {stamp_ns} ns on{', in the kernel with every term' if general else ''}{phases}\n"


@dataclass(frozen=True)
class SceneRecord:
    """A scene (YAML) that a recording holds, the package version that ran it and when it was said, by the driveline's
    clock (ns; 0: before the start). States that were sent later are its own, from `first_stamp_ns` on.
    """

    text: str
    version: str
    log_ns: int

    @cached_property
    def _line(self) -> re.Match[str] | None:
        """What the last line says of a scene that was changed while running."""
        return _LINE.fullmatch(self.text.rstrip("\n").rpartition("\n")[2])

    @property
    def first_stamp_ns(self) -> int:
        """Stamp of the first state that it led to; 0 for the scene that a driveline starts with."""
        return int(self._line[1]) if self._line else 0

    @property
    def general(self) -> bool:
        """Whether the kernel with every term solved it."""
        return self._line is not None and self._line[2] is not None

    @property
    def origin(self) -> Origin:
        """Where the phases are counted from."""
        if self._line is None or self._line[3] is None:
            return START
        try:
            phase, time, lead = map(float, self._line.groups()[2:])
        except ValueError:
            return START
        return Origin(time, phase, lead)

    @property
    def parameters(self) -> str:
        """The text without that line."""
        return self.text.rstrip("\n").rpartition("\n")[0] + "\n" if self._line else self.text


@dataclass(frozen=True)
class InputSource:
    """What one message, sent at `log_ns` by the driveline's clock, says: from the state of `first_stamp_ns` on these
    topics held a command, the others fell back.
    """

    log_ns: int
    first_stamp_ns: int
    commanded: frozenset[str]


def source_text(commanded: Mapping[str, bool]) -> str:
    """The text of a message: `engine_torque: command, actuation_pressure: fallback`."""
    return ", ".join(f"{name}: {COMMAND if held else FALLBACK}" for name, held in commanded.items())


def read_source(record: bytes) -> InputSource | None:
    """A message record: channel, number, two times and the serialised Header; None where it is none."""
    if not HEAD < len(record) <= LONGEST:
        return None
    received, sent = _TIMES.unpack_from(record, 6)
    try:
        stamp, text = cdr.read_header(record[HEAD:])
    except ValueError:
        return None
    said = dict(part.partition(": ")[::2] for part in text.split(", "))
    return InputSource(sent or received, stamp, frozenset(name for name in INPUTS if said.get(name) == COMMAND))
