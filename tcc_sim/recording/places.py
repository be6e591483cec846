"""Find the first state to which each announcement of the driveline applies, robust to a clock that is set back.

A driveline publishes states and announcements in one order, but on several topics. The file preserves the order within
each topic, the first stamp to which each message applies, and the times of sending. Since the clock may be set back,
times of sending only decide where the rest leaves a choice.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from tcc_sim.recording.announcements import InputSource, SceneRecord
from tcc_sim.recording.columns import JointStates

MOST_CANDIDATES = 1_000_000
"""Largest number of candidate states considered, in addition to those that the clock settles."""


def places_of(messages: Sequence[SceneRecord | InputSource], runs: Iterable[JointStates]) -> list[tuple[int, int]]:
    """Return index (in the whole recording) of the first state to which a message applies, and number of the message.

    The messages are of one kind, in the order of the recording. A message that applies to no state is left out.
    """
    if len(messages) < 2:
        return [(0, 0)] if messages else []
    sent_at = np.array([min(one.log_ns, 2**63 - 1) for one in messages], dtype=np.int64)
    stamps = np.array([min(one.first_stamp_ns, 2**63 - 1) for one in messages], dtype=np.int64)
    order = np.argsort(stamps, kind="stable")
    stamps = stamps[order]
    sure, likely, possible = ([list[int]() for _ in messages] for _ in range(3))
    weighed = last = 0
    last_sent = -(2**63)
    for states in runs:
        numbers = order[:np.searchsorted(stamps, states.stamp_ns[-1], side="right")]
        rows = np.searchsorted(states.stamp_ns, stamps[:len(numbers)])
        at, sent = sent_at[numbers], states.sent_ns[rows]
        earlier = np.where(rows > 0, states.sent_ns[rows - 1], last_sent)
        between, set_back = (earlier <= at) & (at <= sent), sent < earlier
        certain = between | (set_back & ((at <= sent) | (at >= earlier)))
        for number, row in zip(numbers[certain].tolist(), rows[certain].tolist()):
            sure[number].append(states.index + row)
        others = np.flatnonzero(~certain)[:MOST_CANDIDATES - weighed]
        weighed += len(others)
        for number, row, before_it in zip(numbers[others].tolist(), rows[others].tolist(),
                                          (at <= sent)[others].tolist()):
            (likely if before_it else possible)[number].append(states.index + row)
        last, last_sent = states.index + len(states), int(states.sent_ns[-1])
    return _chosen(sure, likely, possible, last)


def _chosen(sure: list[list[int]], likely: list[list[int]], possible: list[list[int]],
            end: int) -> list[tuple[int, int]]:
    """Choose one state for each message from its candidates, in the order of the messages."""
    found: list[int | None] = []
    last = 0
    for candidates in sure:
        where = next((index for index in candidates if index >= last), None)
        found.append(where)
        last = last if where is None else where
    ends = []
    for where in reversed(found):
        end = end if where is None else where
        ends.append(end)
    last = 0
    for number, end in enumerate(reversed(ends)):
        if found[number] is None:
            others = sorted(likely[number]) or sorted(possible[number])
            found[number] = next((index for index in others if last <= index <= end), None)
        last = found[number] or last
    return [(index, number) for number, index in enumerate(found) if index is not None]
