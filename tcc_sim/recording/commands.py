"""Commands in a recording, each assigned to the first state that was sent after it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tcc_sim.messages import cdr
from tcc_sim.recording.announcements import (
    HEAD,
    LONGEST,
    MOST_SOURCES,
    InputSource,
    Stamps,
    read_held_sources,
    read_source,
    simulation_ns,
)
from tcc_sim.recording.columns import Commanded, JointStates, receipt_times
from tcc_sim.recording.contents import Channel
from tcc_sim.recording.records import Messages
from tcc_sim.topics import DIAGNOSTIC_ARRAY, FLOAT64, FLOAT64_ARRAY, FLUID_PRESSURE, HEADER, LIMITS, shown

TARGET, SOURCE, HELD = "target_slip_speed", "input_source", "held"
COMMANDS = {"engine_torque": FLOAT64, "actuation_pressure": FLUID_PRESSURE, TARGET: FLOAT64}
"""Topics of commands to the driveline or its controller, with their types."""
_LATEST, _DIGITS = 1 << 31, 19
DIAGNOSTICS = "/diagnostics"
LATE_SHARE = 0.05
"""Share of ticks more than a period late above which the driveline and `analyse` warn."""
COUNTED = ("missed ticks", "late ticks", "paced ticks")
"""Keys of counts in the driveline's diagnostics, in addition to those of refused commands."""
LATE: dict[str, Callable[[int, int], int]] = {
    "first late tick (s)": lambda before, now: before, "last late tick (s)": lambda before, now: now,
    "lateness max (s)": max}
"""Keys of times in the driveline's diagnostics, each with the one that counts of two, in ns."""
SET_BACK = 50_000_000
"""Backward jump of the recorder's clock above which the clock was set, ns."""
STRETCH = 500_000_000
"""Length of the stretches of receipt in which the clocks of publisher and recorder are compared, ns."""
FEW = 10
"""Number of messages in a stretch below which the next stretches with as many count too."""
Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


def signal_types() -> dict[str, str]:
    """Return the topics that are placed at states by their times: commands, and others that a viewer shows by
    themselves, with their types. The applied pressure has stamps.
    """
    return {**COMMANDS, **{row.name: row.type for row in shown() if row.name != "applied_pressure"}}


class _Sent(NamedTuple):
    """Commands of one topic in one chunk, (n,) arrays: offset in the chunk, number of the publisher, time of sending
    (ns; of the recorder's clock after `_Sent.by`) and of receipt, value, and stamp of the state that each answers (ns);
    and the numbers of states before the chunk and up to its end.
    """

    offset: Rows
    publisher: Rows
    times: Stamps
    log: Stamps
    values: Floats
    answers: Stamps
    before: int
    until: int

    def by(self, delay: Stamps) -> _Sent:
        """Return the commands by the recorder's clock, in the order of sending."""
        times = self.times + delay
        order = np.argsort(self.offset if (np.diff(times) < -SET_BACK).any() else times, kind="stable")
        return self._replace(times=times[order], values=self.values[order], answers=self.answers[order])


class Commands:
    """Collector of commands and announced sources of the inputs, chunk by chunk.

    Commands and states are sorted by their times of sending. Times of receipt are not monotonic on a busy machine: a
    reliable middleware delivers a resent message up to seconds late. Times of sending of one sender decrease only if
    its clock is set back.

    Parameters
    ----------
    joint_states_topic : joint_states topic in the namespace of the commands
    zeros : stamps of simulation time 0, as in `simulation_ns`
    """

    def __init__(self, joint_states_topic: str, zeros: Stamps) -> None:
        self._zeros = zeros
        space = joint_states_topic.rpartition("/")[0]
        self._types = signal_types()
        self._names = {f"{space}/{name}": name for name in (*self._types, SOURCE, HELD, LIMITS)}
        self._sent: dict[str, list[_Sent]] = {name: [] for name in self._types}
        self._sources: dict[InputSource, None] = {}
        self.coarse = False
        """Whether times of receipt are so coarse that most states share them with others."""
        self._numbers: dict[str, int] = {}
        self.publishers: dict[str, set[str]] = {}
        """Publishers of commands, by topic."""
        self.counts = Counter[str]()
        """Totals over all drivelines of the counts in their diagnostics, by key."""
        self._counted: dict[str, int] = {}
        self.limits: tuple[float, float] | None = None
        """Last limits of the pressure that a controller stated, Pa."""

    @property
    def sources(self) -> tuple[InputSource, ...]:
        """Announced sources of the inputs, without the repeats that a latched topic sends to a new subscription."""
        return tuple(self._sources)

    def take(self, data: bytes, messages: Messages, channels: Mapping[int, Channel], before: int, until: int) -> None:
        """Take one chunk, with `before` states before it and `until` states up to its end."""
        pieces: dict[str, list[tuple[Rows, Rows, Stamps, Stamps, Floats, Stamps]]] = {}
        for number, row in channels.items():
            if (row.topic, row.type) == (DIAGNOSTICS, DIAGNOSTIC_ARRAY):
                mine = messages.channel == number
                self._count(data, messages.offset[mine].tolist(), messages.length[mine].tolist())
            name = self._names.get(row.topic)
            if name is None or row.type != self._types.get(name, HEADER if name == SOURCE else FLOAT64_ARRAY):
                continue
            mine = messages.channel == number
            if not mine.any():
                continue
            offset, length = messages.offset[mine], messages.length[mine]
            if name == LIMITS:
                for start, size in zip(offset.tolist(), length.tolist()):
                    with suppress(ValueError):
                        self.limits = cdr.read_pressure_limits(data[start + HEAD:start + size])
                continue
            if name in (SOURCE, HELD):
                read = read_held_sources if name == HELD else partial(read_source, zeros=self._zeros)
                self._announced(data, offset.tolist(), length.tolist(), read)
                continue
            offset, log, sent, values, answers = _decoded(np.frombuffer(data, dtype=np.uint8), offset, length, row.type)
            if len(offset):
                if name in COMMANDS:
                    self.publishers.setdefault(name, set()).add(row.publisher)
                who = self._numbers.setdefault(row.publisher, len(self._numbers))
                pieces.setdefault(name, []).append((offset, np.full(len(offset), who), sent, log, values,
                                                    simulation_ns(answers, self._zeros)))
        for name, parts in pieces.items():
            offset, publisher, sent, log, values, answers = (np.concatenate(columns) for columns in zip(*parts))
            self._sent[name].append(_Sent(offset, publisher, sent, log, values, answers, before, until))

    def _announced(self, data: bytes, offsets: Sequence[int], lengths: Sequence[int],
                   read: Callable[[bytes], InputSource | None]) -> None:
        """Take messages that announce the sources of the inputs."""
        for offset, length in zip(offsets, lengths):
            source = read(data[offset:offset + length]) if HEAD < length <= LONGEST else None
            if source is not None and len(self._sources) < MOST_SOURCES:
                before = next(reversed(self._sources), None)
                if read is not read_held_sources or before is None or before.commanded != source.commanded or (
                        source.first_stamp_ns == 0):
                    self._sources.setdefault(source)

    def _count(self, data: bytes, offsets: Sequence[int], lengths: Sequence[int]) -> None:
        """Take diagnostics. A count that decreases belongs to a new driveline, which began at 0."""
        for offset, length in zip(offsets, lengths):
            try:
                values = cdr.read_diagnostics(data[offset + HEAD:offset + length])
            except ValueError:
                continue
            for key in (*COUNTED, *(f"{name} refused" for name in COMMANDS)):
                text = values.get(key, "")
                if text.isdecimal() and text.isascii() and len(text) < _DIGITS:
                    before = self._counted.get(key, 0)
                    self._counted[key] = int(text)
                    self.counts[key] += int(text) - (before if int(text) >= before else 0)
            for key, chosen in LATE.items():
                with suppress(ValueError, OverflowError):
                    time = round(float(values.get(key, "")) * 1e9)
                    self.counts[key] = chosen(self.counts.get(key, time), time)

    def aligned(self, runs: Sequence[JointStates]) -> dict[str, Commanded]:
        """Return the commands, and the other signals, by the name of their topic, each at a state."""
        wanted = {name: sent for name, sent in self._sent.items() if sent}
        if not wanted or not runs:
            return {}
        log = np.concatenate([states.log_ns for states in runs])
        self.coarse = 2 * len(np.unique(log)) < len(log)
        delay = _none if self.coarse else _delay
        clock = _Clock(runs, delay)
        return {name: clock.rows(_by_clock(sent, delay)) for name, sent in wanted.items()}


def _none(log: Stamps, sent: Stamps) -> Stamps:
    """Return no difference of clocks, where times of receipt are too coarse to show it."""
    return np.zeros(len(log), np.int64)


def _delay(log: Stamps, sent: Stamps) -> Stamps:
    """Return the shortest time from sending to receipt, ns, in the stretch of receipt around each message, (n,).

    It is the difference of the clocks of publisher and recorder. For a stretch with few messages, which may all be
    late, the next stretches with more count too.
    """
    stretches, inverse, counts = np.unique(log // STRETCH, return_inverse=True, return_counts=True)
    shortest = np.full(len(stretches), np.iinfo(np.int64).max)
    np.minimum.at(shortest, inverse, log - sent)
    full = np.flatnonzero(counts >= FEW)
    if len(full):
        after = np.searchsorted(full, np.arange(len(stretches))).clip(max=len(full) - 1)
        known = np.minimum(shortest[full[after]], shortest[full[np.maximum(after - 1, 0)]])
        shortest = np.where(counts < FEW, np.minimum(shortest, known), shortest)
    return np.asarray(shortest[inverse])


def _by_clock(sent: Sequence[_Sent], delay_of: Callable[[Stamps, Stamps], Stamps]) -> list[_Sent]:
    """Return the commands of each chunk by the recorder's clock."""
    who, times, log = (np.concatenate([getattr(one, name) for one in sent]) for name in ("publisher", "times", "log"))
    delay = np.empty(len(log), np.int64)
    for number in np.unique(who):
        mine = who == number
        delay[mine] = delay_of(log[mine], times[mine])
    ends = np.cumsum([len(one.times) for one in sent])
    return [one.by(part) for one, part in zip(sent, np.split(delay, ends[:-1]))]


class _Clock:
    """Times of sending of the states, corrected so that they never decrease.

    A clock that is set back affects states and commands alike. Each such step is added to all later times. If the file
    does not show on which side of a step a command was sent, the neighbouring states in the file decide.
    """

    def __init__(self, runs: Sequence[JointStates], delay_of: Callable[[Stamps, Stamps], Stamps]) -> None:
        times = np.concatenate([states.sent_ns for states in runs])
        times += np.concatenate([delay_of(states.log_ns, states.sent_ns) for states in runs])
        steps = np.diff(times)
        self._cuts = 1 + np.flatnonzero(steps < -SET_BACK)
        self._shift = np.zeros(len(self._cuts) + 1, np.int64)
        if len(self._cuts):
            tick = int(np.median(steps[steps > 0])) if (steps > 0).any() else 0
            np.cumsum(tick - steps[self._cuts - 1], out=self._shift[1:])
            times += np.repeat(self._shift, np.diff(self._cuts, prepend=0, append=len(times)))
        self._times: Stamps = np.maximum.accumulate(times)

    def rows(self, sent: Sequence[_Sent]) -> Commanded:
        """Return each command with the first state after it; commands after the last state are left out."""
        times = np.concatenate([self._unrolled(one) if len(self._cuts) else one.times for one in sent])
        values, answers = (np.concatenate(columns) for columns in zip(*((one.values, one.answers) for one in sent)))
        again = (np.diff(times, prepend=-1) == 0) & (np.diff(answers, prepend=-2) == 0)
        again &= np.append(False, values[1:] == values[:-1])  # The same message, recorded twice.
        rows = np.searchsorted(self._times, np.maximum.accumulate(times), side="left")
        inside = (rows < len(self._times)) & ~again
        return Commanded(rows[inside].astype(np.int64), values[inside], answers[inside])

    def _unrolled(self, sent: _Sent) -> Stamps:
        """Return the times of commands, corrected by the clock steps that fit best to the neighbouring states."""
        last = len(self._times) - 1
        low, high = self._times[min(max(sent.before - 1, 0), last)], self._times[min(sent.until, last)]
        first, end = np.searchsorted(self._cuts, [sent.before - 1, sent.until], side="right").tolist()
        shifts = self._shift[max(first - 1, 0):end + 2]
        steps = np.cumsum(np.diff(sent.times, prepend=sent.times[0]) < -SET_BACK)  # Steps that the commands show.
        moved = sent.times + shifts[np.minimum(steps + np.arange(len(shifts))[:, None], len(shifts) - 1)]
        apart = np.maximum(low - moved, 0) + np.maximum(moved - high, 0)
        return np.asarray(moved[apart.sum(axis=1, dtype=np.float64).argmin()])


def _decoded(array: NDArray[np.uint8], offset: NDArray[np.int64], length: NDArray[np.int64],
             kind: str) -> tuple[Stamps, Stamps, Stamps, Floats, Stamps]:
    """Return offsets, times of receipt and sending (ns), finite values, and stamps (ns; -1: none) of valid messages."""
    if kind == FLOAT64:
        place = offset + 22 + 4
    else:
        whole = length >= 22 + 16
        offset, length = offset[whole], length[whole]
        body = offset + 22
        # The pressure follows the frame's name and is aligned to eight bytes, counted from byte 4.
        name = sliding_window_view(array, 4)[body + 12].copy().view("<u4")[:, 0].astype(np.int64)
        place = body + 4 + (12 + name + 7) // 8 * 8
    inside = place + 8 <= np.minimum(offset + length, len(array))
    offset, place = offset[inside], place[inside]
    little = (array[offset + 22] == 0) & (array[offset + 23] == 1)  # Little-endian, as cdr encodes.
    offset, place = offset[little], place[little]
    values = sliding_window_view(array, 8)[place].copy().view("<f8")[:, 0]
    finite = np.isfinite(values)
    offset = offset[finite].astype(np.int64)
    stamps = np.full(len(offset), -1)
    if kind != FLOAT64:
        seconds, rest = sliding_window_view(array, 8)[offset + 26].copy().view("<u4").T.astype(np.int64)
        stamps = np.where(seconds < _LATEST, seconds * 1_000_000_000 + rest, -1)
    return offset, *_times(array, offset), values[finite].astype(np.float64), stamps


def _times(array: NDArray[np.uint8], offset: Stamps) -> tuple[Stamps, Stamps]:
    """Return the times of receipt and of sending, ns; the time of receipt for both if no time of sending is given."""
    log, sent = (sliding_window_view(array, 8)[offset + place].copy().view("<i8")[:, 0].astype(np.int64)
                 for place in (6, 14))
    sent = np.where(sent > 0, sent, log)
    return receipt_times(log, sent), sent
