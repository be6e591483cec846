"""A scene as the driveline says it: its parameter file and, after a change while running, from when on it holds."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

from tcc_sim.model.course import START, Origin

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
