"""Names of runs, and the topic `held`: which command each input of the driveline held, since which tick, and counts.

A run goes from a start or reset of a driveline to the next. Its name is `SSSSSSSSRRRR.NNN`: the time of the process's
start (s of the wall clock) and a random number, both hexadecimal, and the number of the run in the process. It is the
frame of every stamped message of the driveline, so that run and stamp identify a state.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence

import numpy as np

from tcc_sim.messages import cdr
from tcc_sim.topics import HELD_INPUTS, INPUTS

RUN = r"[0-9a-f]{12}\.[0-9]{3}"
"""Pattern of the name of a run."""
FIRST = ".001"
"""End of the name of the first run of a process."""
PROCESS = 12
"""Characters of the name of a run that all runs of a process share."""
BEAT = 0.1
"""Longest simulation time between two messages on `held`, s."""
SCENE, FALLBACK, COMMAND, NOBODY = range(4)
"""Sources of an input."""
TICK, TIME, NUMBER, LAST, HEAD = range(5)
"""Places of tick, simulation time (ns), number of the message in the run, and what follows it; and their number."""
GOES_ON, ENDED, PAUSED = range(3)
"""Events after a message: further ticks, the end of the run, or a pause after its tick."""
FIELDS = ("source", "value", "applied", "stamp", "since", "publisher", "received", "superseded", "refused", "lost")
"""Values of each input: its source, value held and value at the end of the tick (of the pressure: behind the actuator),
stamp of the command (ns since the run's zero; NaN without), first tick that the command acts on, number of its
publisher in the run (0: unknown), and counts of commands since the run's begin.
"""
SIZE = HEAD + len(FIELDS) * len(HELD_INPUTS)
_MOST = 999


def runs(clock: float | None = None) -> Iterator[str]:
    """Iterate over the names of the runs of a process that started at `clock`, s; None for now."""
    while True:
        process = f"{int(time.time() if clock is None else clock) & 0xFFFFFFFF:08x}{os.urandom(2).hex()}"
        for number in range(1, _MOST + 1):
            yield f"{process}.{number:03d}"


def index_in_held(name: str, field: str) -> int:
    """Return the place of a field of an input in the values."""
    return HEAD + len(FIELDS) * HELD_INPUTS.index(name) + FIELDS.index(field)


def held_message(run: str, values: Sequence[float]) -> bytes:
    """Serialise a message of `held`, (SIZE,) values."""
    return cdr.float64_array(f"held 1 {run}", values)


_EXAMPLE = held_message(f"{0:012x}{FIRST}", [0.0] * SIZE)
_RUN_AT = _EXAMPLE.index(f"{0:012x}{FIRST}".encode())
LAYOUT = cdr.Layout(
    np.dtype({"names": ["run", "values"], "formats": [f"S{cdr.RUN_LENGTH}", ("<f8", (SIZE,))],
              "offsets": [_RUN_AT, len(_EXAMPLE) - 8 * SIZE], "itemsize": len(_EXAMPLE)}),
    np.frombuffer(_EXAMPLE, np.uint8), np.isin(np.arange(len(_EXAMPLE)), [0, 1, *range(4, _RUN_AT)]))
"""Layout of the messages of `held`."""


def sources_in_words(values: Sequence[float]) -> str:
    """Return the sources of the inputs that the scene does not set, such as `actuation_pressure: fallback`."""
    sources = {name: int(values[index_in_held(name, "source")]) for name in INPUTS}
    return ", ".join(f"{name}: {'fallback' if source == FALLBACK else 'command'}" for name, source in sources.items()
                     if source != SCENE)
