"""Evidence by branches: stable motions, their ends along the axis, and the motions that (13) leads to.

Branches are followed only over the part of an axis that a claim is about, and with few points. Their motions do not
depend on the initial state, but a motion that no sweep reached is not found.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.basins.attractors import find_attractors
from tcc_sim.basins.compute import halton
from tcc_sim.basins.driveline import DrivelineMotion
from tcc_sim.continuation.diagram import SWEPT, amplitude_of, point_of
from tcc_sim.continuation.driveline import DrivelineMap
from tcc_sim.continuation.loss_of_stability import SegmentEnd, StableSegment, segment_of, stable_segments
from tcc_sim.continuation.shooting import ParameterRange
from tcc_sim.errors import counted
from tcc_sim.model.sines import common_cycles
from tcc_sim.paper.branches_behind import RUNS, seen_in, surveyed
from tcc_sim.paper.catalogue import NORMALISED
from tcc_sim.paper.evidence import CYCLES, FREQUENCY, LATER, Evidence, Values, share_where
from tcc_sim.result import reported, reporting
from tcc_sim.sweeps.executors import workers
from tcc_sim.sweeps.progress import progress_bar
from tcc_sim.sweeps.sweep import Sweep
from tcc_sim.trajectory import Floats, State

SMOOTHING = "friction.smoothing"
FEW = dataclasses.replace(SWEPT, longest_period=2, max_points=60, max_branches=5)
"""Branches over one part of an axis."""
WAYS = ("cold", "up", "down")
"""Starts of the values of a sweep: from (13), or from the neighbour below or above."""
SEEDS = 24
LOWEST, HIGHEST = np.array([-50.0, -0.1, -20.0]), np.array([200.0, 0.3, 20.0])
"""Initial states in the search for attractors: number, and ranges of slip speed, plate angle and plate speed."""


@dataclass(frozen=True)
class EndFigures:
    """An end of a stable motion along a curve."""

    value: float = field(metadata=reported("place on the axis"))
    kind: str | None = field(metadata=reported("bifurcation; null where the motion was followed to there only"))
    residual: float | None = field(metadata=reported("residual of the bifurcation"))
    jumps: bool = field(metadata=reported("whether a motion that comes here goes elsewhere"))

    @staticmethod
    def of(end: SegmentEnd) -> EndFigures:
        """Return the end of a stretch."""
        return EndFigures(end.value, end.kind or None, end.residual if end.kind else None, end.jumps)


@dataclass(frozen=True)
class Motion:
    """Stable motion along a curve, independent of the initial state; `stretch` has its period, ends and sizes."""

    curve: str = field(metadata=reported("curve of the figure; empty if there is one only"))
    over: str = field(metadata=reported("name of the axis"))
    stretch: StableSegment
    from_start: Sequence[float] = field(metadata=reported("places at which the initial state (13) leads to it"))
    period: int = field(metadata=reported("period of the motion", "periods of excitation"))
    low: EndFigures = field(metadata=reported("lower end"))
    high: EndFigures = field(metadata=reported("upper end"))

    @property
    @reporting("the motion in a sentence")
    def words(self) -> str:
        """The motion in a sentence."""
        at, where = self.from_start, "nowhere"
        if at:
            where = f"at {' to '.join(dict.fromkeys(f'{x:g}' for x in (min(at), max(at))))} " \
                    f"({counted(len(at), 'value')})"
        return (f"{self.curve}{': ' if self.curve else ''}period {self.period}, stable over {self.over} from "
                f"{self.stretch.low} to {self.stretch.high}; within {CYCLES + RUNS * LATER} cycles (13) leads to it "
                f"{where}")


@dataclass
class StableMotions(Evidence):
    """Evidence with branches.

    known : results that do not depend on the tolerance of the sweeps, by kind, rows and axes as text; evidence at
        several tolerances shares them
    """

    known: dict[str, Any] = field(default_factory=dict)

    def varied(self, name: str, factor: float) -> StableMotions:
        """Return evidence with the same sweeps and motions, and with one threshold times a factor."""
        changed = replace(self.thresholds, **{name: factor * getattr(self.thresholds, name)})
        return replace(self, thresholds=changed, used=set())

    def stretches(self, rows: Sequence[Values], axis: Floats, *, over: str = FREQUENCY) -> list[list[StableSegment]]:
        """Return for every row the stable stretches of the branches through the motions of sweeps in all WAYS.

        Their parameter is that of `curves`. Orbits are solved at 1e-12 for any tolerance of the sweeps.
        """
        def followed(sweeps: Sequence[Sweep]) -> list[StableSegment]:
            curve = sweeps[0].curve
            branches = surveyed(curve, [s for sweep in sweeps for s in seen_in(sweep)], settings=FEW)
            return stable_segments(branches, min(curve.values), max(curve.values), NORMALISED[over][1])

        names = [json.dumps(["stretches", sorted(row.items()), axis.tolist(), over]) for row in rows]
        missing = {name: row for name, row in zip(names, rows) if name not in self.known}
        ways = [self.curves(list(missing.values()), axis, over=over, direction=way) for way in WAYS]
        with workers(self.jobs, None) as (pool, _), progress_bar("branches", len(missing), shown=self.progress) as bar:
            for name, found in zip(missing, pool.map(followed, zip(*ways))):
                self.known[name] = found
                bar.update()
        return [self.known[name] for name in names]

    def reached(self, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[int | None]:
        """Return for every value the number of the stretch that (13) leads to; None if it is on none."""
        among = self.stretches([row], axis, over=over)[0]
        sweep = self.curves([row], axis, over=over)[0]
        unit, seen = NORMALISED[over][1], seen_in(sweep)
        base, size = common_cycles(sweep.curve.system), amplitude_of(seen)
        at = {s.value: segment_of(replace(s, value=s.value / unit), among, size, base) for s in seen}
        return [at.get(value) for value in sweep.curve.values]

    def motions(self, curve: str, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[Motion]:
        """Return every stretch of a curve with its ends, and the values at which (13) leads to it."""
        among = self.stretches([row], axis, over=over)[0]
        on = self.reached(row, axis, over=over)
        return [Motion(curve, NORMALISED[over][0], s, [float(x) for x, found in zip(axis, on) if found == k], s.period,
                       EndFigures.of(s.low), EndFigures.of(s.high)) for k, s in enumerate(among)]

    def jump_ends(self, row: Values, axis: Floats, *, over: str = FREQUENCY) -> list[float]:
        """Return the sorted values at which a stable motion ends in a jump."""
        among = self.stretches([row], axis, over=over)[0]
        return sorted({end.value for s in among for end in (s.low, s.high) if end.jumps})

    def amplitudes(self, row: Values, axis: Floats) -> list[list[float]]:
        """Return for every frequency ratio the largest slip speeds of all stable motions, first of that from (13)."""
        among = self.stretches([row], axis)[0]
        return [[float(c), *(h for s in among if math.isfinite(h := s.amplitude(float(x))))]
                for x, c in zip(axis, self.maxima([row], axis)[0])]

    def periodic_at(self, row: Values, axis: Floats) -> NDArray[np.bool_]:
        """Return (n,) whether Newton's method finds a stable periodic orbit at a motion of a sweep."""
        name = json.dumps(["periodic", sorted(row.items()), axis.tolist()])
        if name not in self.known:
            found = np.zeros(len(axis), dtype=bool)
            for way in WAYS:
                curve = (sweep := self.curves([row], axis, direction=way)[0]).curve
                of, span = DrivelineMap(curve.system, (curve.key,)), ParameterRange(curve.values[0], curve.values[-1])
                for seen in seen_in(sweep):
                    k = curve.values.index(seen.value)
                    if seen.period and not found[k]:
                        point = point_of(of, span, seen)
                        found[k] = point is not None and point.orbit.stable
            self.known[name] = found
        return np.array(self.known[name])

    def attractors(self, row: Values) -> list[tuple[int, float]]:
        """Return period and largest slip speed of every attractor, from (13) and from many initial states."""
        name = json.dumps(["attractors", sorted(row.items())])
        if name not in self.known:
            system = self.system(row)
            starts = [np.array(State.at_start(system).numbers), *(LOWEST + (HIGHEST - LOWEST) * halton(SEEDS, 3))]
            found = find_attractors(DrivelineMotion(system), starts)
            self.known[name] = sorted((a.period, a.largest) for a in found)
        return list(self.known[name])


def ordered_shares(found: Sequence[Sequence[Sequence[float]]], curve: int, where: Any,
                   limits: tuple[float, float] = (0.05, 0.1), *, worst: bool = False) -> tuple[float, float]:
    """Return the fractions of the slipping places at which one curve is the lowest (`worst`: the highest), for every
    choice of a motion on each curve and for some choice.

    Parameters
    ----------
    found : largest slip speeds of all stable motions, per curve and place
    limits : negligible difference, rad/s, and largest slip speed above which a curve slips
    """
    sign, holds = -1.0 if worst else 1.0, list[tuple[bool, bool, bool]]()
    for row in zip(*found):
        own, *others = ([sign * h for h in r] for r in (row[curve], *row[:curve], *row[curve + 1:]))
        holds.append((max(own) <= min(map(min, others)) + limits[0], min(own) <= min(map(max, others)) + limits[0],
                      max(map(max, row)) > limits[1]))
    every, some, moving = np.array(holds, dtype=bool).T
    return share_where(every, where & moving), share_where(some, where & moving)
