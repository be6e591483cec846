"""Counts of commands in a recording and in the driveline's diagnostics, sources of inputs, and limits of a pressure."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from tcc_sim.messages import cdr
from tcc_sim.messages.held import PROCESS, RUN
from tcc_sim.recording.announcements import MOST_SOURCES, InputSource, Stamps, read_source
from tcc_sim.recording.contents import Channel
from tcc_sim.recording.layouts import NUMBER, Floats, Layouts, Positions, sent_ns
from tcc_sim.recording.records import Messages
from tcc_sim.topics import DIAGNOSTIC_ARRAY, FLOAT64, FLOAT64_ARRAY, FLUID_PRESSURE, HEADER, LIMITS, SHAFT, TARGET

SOURCE = "input_source"
"""Topic of the sources of the inputs before version 1.1."""
COMMANDS = {"engine_torque": FLOAT64, "actuation_pressure": FLUID_PRESSURE, TARGET: FLOAT64}
"""Topics of commands to the driveline or its controller, with their types."""
SIGNALS = {**COMMANDS, SHAFT: FLOAT64}
"""Topics whose messages are counted, with their types."""
_DIGITS = 19
_RUN = re.compile(RUN)
DIAGNOSTICS = "/diagnostics"
PACED = "paced ticks"
COUNTED = ("missed ticks", "late ticks", PACED, *(f"{name} refused" for name in COMMANDS))
"""Keys of counts in the driveline's diagnostics."""
LATE: dict[str, Callable[[int, int], int]] = {
    "first late tick (s)": lambda before, now: before, "last late tick (s)": lambda before, now: now,
    "lateness max (s)": max}
"""Keys of times in the driveline's diagnostics, each with the one that counts of two, in ns."""


class Commands:
    """Collector of commands, sources of inputs, and diagnostics of a namespace, chunk by chunk; `zeros` as in
    `simulation_ns`.
    """

    def __init__(self, space: str, zeros: Stamps) -> None:
        self._zeros, self._space = zeros, space
        self._layouts = {kind: Layouts(kind, (), ["value"]) for kind in (FLOAT64, FLUID_PRESSURE)}
        self._sent: dict[str, list[tuple[Positions, Positions, Stamps, Floats]]] = {}
        self._sources: dict[InputSource, None] = {}
        self._announcers: set[str] = set()
        self._numbers: dict[str, int] = {}
        self.publishers: dict[str, set[str]] = {}
        """Publishers of commands, by topic."""
        self._statuses: dict[tuple[str, str], Mapping[str, str]] = {}
        """Values of diagnostics by the names of node and process."""
        self._several: set[str] = set()
        """Names of nodes of several processes that the recording does not tell apart."""
        self.limits: tuple[float, float] | None = None
        """Last limits of the pressure that a controller stated, Pa."""

    @property
    def sources(self) -> tuple[InputSource, ...]:
        """Announced sources of the inputs, each once, by the publisher's sequence number or the time of sending."""
        numbered = all(one.number for one in self._sources) and len(self._announcers) == 1
        return tuple(sorted(self._sources, key=lambda one: one.number if numbered else one.log_ns))

    def take(self, data: bytes, messages: Messages, channels: Mapping[int, Channel]) -> None:
        """Take one chunk."""
        for number, channel in channels.items():
            space, _, last = channel.topic.rpartition("/")
            # It belongs to the driveline by its namespace, or because it was remapped.
            name = channel.row if space == self._space or last != channel.row else ""
            if channel.type == DIAGNOSTIC_ARRAY:
                for _, body in messages.of(data, number):
                    with suppress(ValueError):
                        self._count(cdr.read_diagnostics(body), channel.publisher)
            elif name == LIMITS and channel.type == FLOAT64_ARRAY:
                for _, body in messages.of(data, number):
                    with suppress(ValueError):
                        self.limits = cdr.read_pressure_limits(body)
            elif name == SOURCE and channel.type == HEADER:
                self._announcers.add(channel.publisher)
                for head, body in messages.of(data, number):
                    source = read_source(head, body, self._zeros)
                    if source is not None and len(self._sources) < MOST_SOURCES:
                        self._sources.setdefault(source)
            elif channel.type == SIGNALS.get(name):
                found = self._layouts[channel.type].take(np.frombuffer(data, np.uint8), messages, [number])
                found = found.part(np.isfinite(found.values[0]))
                (values,) = found.values
                if name in COMMANDS and len(values):
                    self.publishers.setdefault(name, set()).add(channel.publisher)
                who = np.full(len(values), self._numbers.setdefault(channel.publisher, len(self._numbers)))
                self._sent.setdefault(name, []).append((who, found.heads[NUMBER], sent_ns(found.heads), values))

    def _count(self, statuses: Iterable[cdr.DiagnosticsStatus], publisher: str) -> None:
        """Take diagnostics: of each process the status with the most paced ticks, as its counts never decrease."""
        for status in statuses:
            process = status.hardware_id[:PROCESS] if _RUN.fullmatch(status.hardware_id) else publisher
            before = self._statuses.get((status.name, process), {})
            if _count_in(status.values, PACED) >= _count_in(before, PACED):
                self._statuses[status.name, process] = status.values
            elif not process:
                self._several.add(status.name)

    def counts(self, runs: Sequence[str]) -> dict[str, int]:
        """Return the counts in a driveline's diagnostics: those of the processes of its runs or, without names of runs,
        those of nodes in its namespace.
        """
        processes, total = {run[:PROCESS] for run in runs}, dict[str, int]()
        names = {name for name, _ in self._statuses}
        here = {name for name in names if name.rpartition("/")[0] == self._space} or (
            names if len(names) == 1 else set())
        for (name, process), values in sorted(self._statuses.items()):
            if not (process in processes if processes else name in here - self._several):
                continue
            for key in COUNTED:
                if (count := _count_in(values, key)) >= 0:
                    total[key] = total.get(key, 0) + count
            for key, chosen in LATE.items():
                with suppress(ValueError, OverflowError):
                    time = round(float(values.get(key, "")) * 1e9)
                    total[key] = chosen(total.get(key, time), time)
        return total

    def recorded(self, last: int) -> dict[str, int]:
        """Return the number of recorded messages by topic: those up to the last state, which was sent at `last`, ns,
        and behind which no command can act.
        """
        return {name: _not_behind(parts, last) for name, parts in self._sent.items()}


def _count_in(values: Mapping[str, str], key: str) -> int:
    """Return a count in the values of a status; -1 without it."""
    text = values.get(key, "")
    return int(text) if text.isdecimal() and text.isascii() and len(text) < _DIGITS else -1


def _not_behind(parts: Sequence[tuple[Any, ...]], last: int) -> int:
    """Return the number of messages without repeats, which are equal in publisher, sequence number, time of sending and
    value, and without the last ones of each publisher, all sent after `last`, ns.
    """
    columns = [np.concatenate(column) for column in zip(*parts)]
    order = np.lexsort(columns[::-1])
    columns = [column[order] for column in columns]
    fresh = np.append(True, np.any([column[1:] != column[:-1] for column in columns], axis=0))[:len(order)]
    who, _, sent, _ = (column[fresh] for column in columns)
    before = [np.flatnonzero(sent[who == publisher] <= last) for publisher in np.unique(who).tolist()]
    return sum(int(rows[-1]) + 1 for rows in before if len(rows))
