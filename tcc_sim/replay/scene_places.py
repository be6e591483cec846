"""At which state of a recording each of its scenes came into force, whatever the clock did meanwhile.

A driveline says its scenes and its states in one order, but on two topics. What the file keeps of that order is: the
order of the scenes, the stamp from which on each holds, and by the driveline's clock when everything was sent. A clock
may be set back, so it only decides where the rest leaves a choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tcc_sim.recording.batches import JointStates
from tcc_sim.recording.scene_records import SceneRecord

MOST_SCENES = 10_000
"""Scenes of a recording that are followed."""
MOST_CANDIDATES = 1_000_000
"""States at which a scene may have come into force that are weighed, beside those that the clock is sure of."""


@dataclass(frozen=True)
class Place:
    """The scene with this number holds from the state with this index on (counted over the whole recording)."""

    index: int
    scene: int


class ScenePlaces:
    """Finds the places while a recording is read.

    Parameters
    ----------
    scenes : all scenes of the recording, in its order
    """

    def __init__(self, scenes: Sequence[SceneRecord]) -> None:
        self._said = np.array([min(s.log_ns, 2**63 - 1) for s in scenes[:MOST_SCENES]], dtype=np.int64)
        stamps = np.array([min(s.first_stamp_ns, 2**63 - 1) for s in scenes[:MOST_SCENES]], dtype=np.int64)
        self._order = np.argsort(stamps, kind="stable")
        self._stamps = stamps[self._order]
        self._sure: list[list[int]] = [[] for _ in stamps]
        self._likely: list[list[int]] = [[] for _ in stamps]
        self._possible: list[list[int]] = [[] for _ in stamps]
        self._weighed = 0
        self._index = 0
        self._run = -1
        self._last_stamp = self._last_sent = -(2**63)

    def feed(self, batch: JointStates) -> None:
        """Take the next states, all of one run."""
        if not len(batch):
            return
        before = self._last_stamp if batch.run == self._run else -(2**63)
        low = np.searchsorted(self._stamps, before, side="right")
        high = np.searchsorted(self._stamps, batch.stamp_ns[-1], side="right")
        rows = np.searchsorted(batch.stamp_ns, self._stamps[low:high])
        for scene, row in zip(self._order[low:high].tolist(), rows.tolist()):
            said, sent = int(self._said[scene]), int(batch.sent_ns[row])
            earlier = int(batch.sent_ns[row - 1]) if row else self._last_sent
            set_back = sent < earlier
            if earlier <= said <= sent or (set_back and (said <= sent or said >= earlier)):
                self._sure[scene].append(self._index + row)
            elif self._weighed < MOST_CANDIDATES:
                self._weighed += 1
                (self._likely if said <= sent else self._possible)[scene].append(self._index + row)
        self._run, self._index = batch.run, self._index + len(batch)
        self._last_stamp, self._last_sent = int(batch.stamp_ns[-1]), int(batch.sent_ns[-1])

    def places(self) -> list[Place]:
        """The places in their order; a scene that never came into force has none."""
        found: list[int | None] = []
        last = 0
        for sure in self._sure:
            where = next((index for index in sure if index >= last), None)
            found.append(where)
            last = last if where is None else where
        end = self._index
        ends = []
        for where in reversed(found):
            end = end if where is None else where
            ends.append(end)
        last = 0
        for scene, end in enumerate(reversed(ends)):
            if found[scene] is None:
                others = sorted(self._likely[scene]) or sorted(self._possible[scene])
                found[scene] = next((index for index in others if last <= index <= end), None)
            last = found[scene] or last
        return [Place(index, scene) for scene, index in enumerate(found) if index is not None]
