"""At which state of a recording what its driveline said beside the states came into force, whatever the clock did
meanwhile: its scenes, and which inputs a command held.

A driveline says all of it in one order, but on several topics. What the file keeps of that order is: the order within
each topic, the stamp from which on each message holds, and by the driveline's clock when everything was sent. A clock
may be set back, so it only decides where the rest leaves a choice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tcc_sim.recording.announcements import InputSource, SceneRecord
from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.reader import Run, Tap

MOST_SCENES = 10_000
"""Scenes of a recording that are followed."""
MOST_CANDIDATES = 1_000_000
"""States at which a message may have come into force that are weighed, beside those that the clock is sure of."""


Said = SceneRecord | InputSource
"""A message that was sent at `log_ns` by the driveline's clock, and holds from the state of `first_stamp_ns` on."""


@dataclass(frozen=True)
class ScenePlace:
    """The message with this number holds from the state with this index on (counted over the whole recording)."""

    index: int
    number: int


class Places:
    """Finds the places while a recording is read.

    Parameters
    ----------
    said : all messages of one kind in the recording, in its order
    """

    def __init__(self, said: Sequence[Said]) -> None:
        self._said = np.array([min(one.log_ns, 2**63 - 1) for one in said], dtype=np.int64)
        stamps = np.array([min(one.first_stamp_ns, 2**63 - 1) for one in said], dtype=np.int64)
        self._order = np.argsort(stamps, kind="stable")
        self._stamps = stamps[self._order]
        self._sure: list[list[int]] = [[] for _ in stamps]
        self._likely: list[list[int]] = [[] for _ in stamps]
        self._possible: list[list[int]] = [[] for _ in stamps]
        self._weighed = 0
        self._end = 0
        self._run = -1
        self._last_stamp = self._last_sent = -(2**63)

    def feed(self, batch: JointStates) -> None:
        """Take the next states, all of one run."""
        if not len(batch):
            return
        before = self._last_stamp if batch.run == self._run else -(2**63)
        low = np.searchsorted(self._stamps, before, side="right")
        high = np.searchsorted(self._stamps, batch.stamp_ns[-1], side="right")
        if high > low:
            numbers = self._order[low:high]
            rows = np.searchsorted(batch.stamp_ns, self._stamps[low:high])
            said, sent = self._said[numbers], batch.sent_ns[rows]
            earlier = np.where(rows > 0, batch.sent_ns[rows - 1], self._last_sent)
            between, set_back = (earlier <= said) & (said <= sent), sent < earlier
            sure = between | (set_back & ((said <= sent) | (said >= earlier)))
            for number, row in zip(numbers[sure].tolist(), rows[sure].tolist()):
                self._sure[number].append(batch.index + row)
            others = np.flatnonzero(~sure)[:MOST_CANDIDATES - self._weighed]
            self._weighed += len(others)
            for number, row, before_it in zip(numbers[others].tolist(), rows[others].tolist(),
                                              (said <= sent)[others].tolist()):
                (self._likely if before_it else self._possible)[number].append(batch.index + row)
        self._run, self._end = batch.run, batch.index + len(batch)
        self._last_stamp, self._last_sent = int(batch.stamp_ns[-1]), int(batch.sent_ns[-1])

    def places(self) -> list[ScenePlace]:
        """The places in their order; a message that never came into force has none."""
        found: list[int | None] = []
        last = 0
        for sure in self._sure:
            where = next((index for index in sure if index >= last), None)
            found.append(where)
            last = last if where is None else where
        end = self._end
        ends = []
        for where in reversed(found):
            end = end if where is None else where
            ends.append(end)
        last = 0
        for number, end in enumerate(reversed(ends)):
            if found[number] is None:
                others = sorted(self._likely[number]) or sorted(self._possible[number])
                found[number] = next((index for index in others if last <= index <= end), None)
            last = found[number] or last
        return [ScenePlace(index, number) for number, index in enumerate(found) if index is not None]


def places_of(run: Run, progress: bool = False) -> list[ScenePlace]:
    """From which states on the scenes of a recording hold."""
    return found_places(run, run.scenes[:MOST_SCENES], "scenes", progress)


def found_places(run: Run, said: Sequence[Said], what: str, progress: bool) -> list[ScenePlace]:
    """From which states on what the driveline said holds; the recording is read once more for more than one message."""
    if len(said) < 2:
        return [ScenePlace(0, 0)] if said else []
    found = Places(said)
    for batch in watched(run, what, progress):
        found.feed(batch)
    return found.places()


def watched(run: Run, what: str, progress: bool, tap: Tap | None = None) -> Iterator[JointStates]:
    """The batches of a run, with a bar on a terminal."""
    from tqdm import tqdm

    with tqdm(desc=what, unit=" messages", unit_scale=True, leave=False, disable=None if progress else True) as bar:
        for batch in run.batches(tap):
            yield batch
            bar.update(len(batch))
