"""Write and read the driveline's announcements: its scene, and which inputs follow a command."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tcc_sim.messages import cdr
from tcc_sim.messages.held import RUN
from tcc_sim.model.profile import START, Origin
from tcc_sim.topics import INPUTS

Stamps = NDArray[np.int64]
MOST_SOURCES = 100_000
"""Largest number of input-source messages that are read from a recording."""
MOST_SCENES = 10_000
"""Largest number of scenes that are read from a recording."""
LATE_SHARE = 0.05
"""Share of ticks more than a period late above which the driveline and `analyse` warn."""
LONGEST = 4096
_NUMBER = r"-?\d[\de.+-]{0,30}"
_LINE = re.compile(rf"# (?:run (?P<run>{RUN}) of (?P<name>\S+), )?holds from stamp (?P<stamp>\d{{1,19}}) ns on"
                   r"(?:, in the kernel with every term)?"
                   rf"(?:, phase (?P<phase>{_NUMBER}) rad at (?P<time>{_NUMBER}) s, the load's ahead by "
                   rf"(?P<lead>{_NUMBER}) rad)?"
                   r"(?:, simulation time 0 is (?P<zero>\d{1,19}) ns of the wall clock)?")


def holding_from(text: str, stamp_ns: int, origin: Origin = START, zero_ns: int = 0, run: str = "",
                 name: str = "") -> str:
    """Return the text of a scene with a comment line that states run and driveline and from when it holds.

    Parameters
    ----------
    stamp_ns : simulation time (ns) of the first state computed with it: the tick after the change, or 0 after a reset
    origin : time and phase from which the phases are counted
    zero_ns : stamp of simulation time 0, ns; 0 where stamps are simulation time
    run, name : run, and fully qualified name of the driveline's node; empty in recordings before version 1.1
    """
    phases = (f", phase {origin.phase!r} rad at {origin.time!r} s, the load's ahead by {origin.lead!r} rad"
              if origin != START else "")
    wall = f", simulation time 0 is {zero_ns} ns of the wall clock" if zero_ns else ""
    of = f"run {run} of {name}, " if run else ""
    return f"{text}# {of}holds from stamp {stamp_ns} ns on{phases}{wall}\n"


@dataclass(frozen=True)
class SceneRecord:
    """A scene (YAML) in a recording, the package version that ran it, and when the driveline published it (ns of its
    clock; 0: before the start). It applies to states sent later whose stamps are at least `first_stamp_ns`.
    """

    text: str
    version: str
    log_ns: int

    @cached_property
    def _line(self) -> re.Match[str] | None:
        """Match of the comment line of a scene that was changed while running, or None."""
        return _LINE.fullmatch(self.text.rstrip("\n").rpartition("\n")[2])

    @property
    def run(self) -> str:
        """Run of the driveline; empty before version 1.1."""
        return (self._line["run"] or "") if self._line else ""

    @property
    def driveline(self) -> str:
        """Fully qualified name of the driveline's node; empty before version 1.1."""
        return (self._line["name"] or "") if self._line else ""

    @property
    def first_stamp_ns(self) -> int:
        """Stamp (ns) of the first state computed with it; 0 for the scene that a driveline starts with."""
        return int(self._line["stamp"]) if self._line else 0

    @property
    def zero_ns(self) -> int:
        """Stamp of simulation time 0, ns; 0 where stamps are simulation time."""
        return int(self._line["zero"]) if self._line and self._line["zero"] and int(self._line["zero"]) < 1 << 62 else 0

    @property
    def origin(self) -> Origin:
        """Time and phase from which the phases are counted."""
        if self._line is None or self._line["phase"] is None:
            return START
        try:
            phase, time, lead = map(float, self._line.group("phase", "time", "lead"))
        except ValueError:
            return START
        return Origin(time, phase, lead)

    @property
    def parameters(self) -> str:
        """The text without the comment line."""
        return self.text.rstrip("\n").rpartition("\n")[0] + "\n" if self._line else self.text


def zeros_of(texts: Iterable[str]) -> Stamps:
    """Return the stamps of simulation time 0 that published scenes name, ns, ascending; empty for simulation time."""
    return np.unique(np.array([zero for text in texts if (zero := SceneRecord(text, "", 0).zero_ns)], dtype=np.int64))


def simulation_ns(stamps: Stamps, zeros: Stamps) -> Stamps:
    """Return simulation times, ns, of stamps: those of the wall clock count from the last of `zeros` before them."""
    if not len(zeros):
        return stamps
    return np.asarray(stamps - np.append(0, zeros)[np.searchsorted(zeros, stamps, side="right")])


@dataclass(frozen=True)
class InputSource:
    """Inputs that follow a command from the state with stamp `first_stamp_ns` on; the others use their fallback.

    The driveline sent the message at `log_ns` of its clock (ns); `number` is its publisher's sequence number.
    """

    log_ns: int
    first_stamp_ns: int
    commanded: frozenset[str]
    number: int = 0
    run = ""  # Such a message does not name its run.


def read_source(head: np.void, body: bytes, zeros: Stamps) -> InputSource | None:
    """Decode a Header by HEAD and content of its message, its stamp as in `simulation_ns`; None if it is not valid."""
    try:
        stamp, text = cdr.read_header(body[:LONGEST])
    except ValueError:
        return None
    sources = dict(part.partition(": ")[::2] for part in text.split(", "))
    stamp = int(simulation_ns(np.array([stamp]), zeros)[0])
    return InputSource(int(head["sent_ns"] or head["log_ns"]), stamp,
                       frozenset(name for name in INPUTS if sources.get(name) == "command"), int(head["number"]))
