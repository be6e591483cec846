"""Basins of attraction in a plane of two initial conditions: every cell followed until it is at an attractor.

Cells are labelled by proximity to attractors with validated radii (`attractors`); a motion that is sure to run away has
a label of its own, and one that has not decided within the cycles allowed is counted, never guessed. Uncertainty
exponent of the boundary: C. Grebogi, S. W. McDonald, E. Ott, J. A. Yorke, Final state sensitivity, Phys. Lett. A 99
(1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.basins.proximity import RUNAWAY, UNDECIDED, Attractor
from tcc_sim.basins.settings import DEFAULTS as DEFAULT_SETTINGS
from tcc_sim.continuation.problem import Floats
from tcc_sim.errors import InputError, counted
from tcc_sim.model.parameters import DEFAULTS, System, unknown_key
from tcc_sim.result import Result
from tcc_sim.trajectory import State

PLANE_KEYS = ("initial.slip_speed", "initial.plate_angle", "initial.plate_speed")

Labels = NDArray[np.int16]
Counts = NDArray[np.int32]


@dataclass(frozen=True)
class Axis:
    """One axis of the plane: an initial.* key and its evenly spaced values."""

    key: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class Boundary:
    """How uncertain the final state is: the part of cells whose label differs a distance eps away grows as
    eps^exponent.

    exponent : uncertainty exponent, with the standard error of its fit
    dimension : of the boundary, 2 - exponent
    """

    exponent: float
    error: float

    @property
    def dimension(self) -> float:
        """Of the boundary in the plane."""
        return 2.0 - self.exponent


@dataclass(frozen=True, repr=False)
class Basins(Result):
    """The basins of one system in one plane.

    plane : first and second axis
    labels : (len(second), len(first)) index into `attractors`, -1 undecided, -2 runaway
    cycles : (len(second), len(first)) cycles after which the cell was decided
    seconds : wall time
    over : scene key and its value, where planes were worked out at several
    """

    plane: tuple[Axis, Axis]
    attractors: tuple[Attractor, ...]
    labels: Labels
    cycles: Counts
    seconds: float
    over: tuple[str, float] | None = None

    def fraction(self, label: int) -> float:
        """Part of the plane with this label."""
        return float(np.mean(self.labels == label))

    def boundary(self) -> Boundary | None:
        """The uncertainty exponent; None where too few labels differ to fit one."""
        return boundary_of(self.labels)

    def as_json(self) -> dict[str, Any]:
        """Plane, attractors with their fractions, and what came to none."""
        return {
            "plane": [{"key": axis.key, "values": list(axis.values)} for axis in self.plane],
            "attractors": [{
                "period": a.period, "max_slip_speed": a.largest,
                "section": [[float(p[1]), float(p[0])] for p in a.section],
                "multipliers": None if a.multipliers is None else [[float(m.real),
                                                                    float(m.imag)] for m in a.multipliers],
                "fraction": self.fraction(k), "radius": a.radius,
                "state": list(map(float, a.section[0])) if a.period else None} for k, a in enumerate(self.attractors)],
            "undecided": self.fraction(UNDECIDED), "runaway": self.fraction(RUNAWAY), "seconds": self.seconds}

    def columns(self) -> dict[str, NDArray[Any]]:
        """A row for every cell: both keys, its label, and after how many cycles it was decided."""
        first, second = self.plane
        return {first.key: np.tile(first.values, len(second.values)),
                second.key: np.repeat(second.values, len(first.values)),
                "label": self.labels.ravel(), "cycles": self.cycles.ravel()}

    def __repr__(self) -> str:
        """A line for the plane and one for each attractor."""
        return "\n".join(self.lines(DEFAULT_SETTINGS.attractors_shown))

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    def lines(self, most: int | None = None) -> list[str]:
        """The plane, up to `most` of the attractors with their parts of it, and what came to none."""
        first, second = self.plane
        lines = [f"Basins in {first.key} ({len(first.values)}) and {second.key} ({len(second.values)})"]
        lines += [f"  {100.0 * self.fraction(k):6.2f} %  {f'period {a.period}' if a.period else 'no period'}, "
                  f"largest slip speed {a.largest:.6g} rad/s" for k, a in enumerate(self.attractors[:most])]
        if most is not None and len(self.attractors) > most:
            lines.append(f"  {counted(len(self.attractors) - most, 'more attractor')}")
        return [*lines, f"  {100.0 * self.fraction(RUNAWAY):6.2f} %  runaway slip",
                f"  {100.0 * self.fraction(UNDECIDED):6.2f} %  undecided"]


def check_plane(plane: Sequence[Axis]) -> tuple[Axis, Axis]:
    """The two axes.

    Raises
    ------
    InputError
        Not two, twice the same key, a key that is no initial condition, or too many cells.
    """
    if len(plane) != 2:
        raise InputError(f"a plane has 2 axes; {len(plane)} are given")
    for axis in plane:
        if axis.key not in DEFAULTS:
            raise unknown_key(axis.key, DEFAULTS)
        if axis.key not in PLANE_KEYS:
            raise InputError(f"{axis.key} is no initial condition; a plane is made of two of {', '.join(PLANE_KEYS)}")
    if plane[0].key == plane[1].key:
        raise InputError(f"{plane[0].key} is given twice; a plane is made of two keys")
    cells = len(plane[0].values) * len(plane[1].values)
    if cells > DEFAULT_SETTINGS.most_cells:
        raise InputError(f"the plane has {cells} cells; it must have at most "
                         f"{DEFAULT_SETTINGS.most_cells}")
    return plane[0], plane[1]


def starts(system: System, plane: tuple[Axis, Axis], row: int) -> Floats:
    """(len(first), 3) initial states of one row of the plane."""
    out = np.tile(State.at_start(system).numbers, (len(plane[0].values), 1))
    out[:, PLANE_KEYS.index(plane[0].key)] = plane[0].values
    out[:, PLANE_KEYS.index(plane[1].key)] = plane[1].values[row]
    return out


def seeds_of(system: System, plane: tuple[Axis, Axis]) -> Floats:
    """(seeds + 6, 3) states from which attractors are looked for: the scene's own, corners, middle, a Halton set."""
    edges = [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    unit = np.concatenate([edges, halton(DEFAULT_SETTINGS.seeds, 2)])
    out = np.tile(State.at_start(system).numbers, (len(unit) + 1, 1))
    for axis, part in zip(plane, unit.T):
        low, high = min(axis.values), max(axis.values)
        out[1:, PLANE_KEYS.index(axis.key)] = low + (high - low) * part
    return out


def halton(count: int, dimensions: int) -> Floats:
    """(count, dimensions) points of the unit cube that fill it evenly (J. H. Halton, Numer. Math. 2, 1960)."""
    from scipy.stats.qmc import Halton

    return np.asarray(Halton(dimensions, scramble=False).random(count + 1)[1:])


def boundary_of(labels: Labels) -> Boundary | None:
    """The uncertainty exponent of a map of labels, from cells that differ from one a few away along either axis."""
    sizes, parts = [], []
    for k in DEFAULT_SETTINGS.distances:
        if k >= min(labels.shape):
            break
        along = [labels[:, k:] != labels[:, :-k], labels[k:] != labels[:-k]]
        part = sum(int(a.sum()) for a in along) / sum(a.size for a in along)
        if part > 0.0:
            sizes.append(np.log(k))
            parts.append(np.log(part))
    if len(sizes) < 3:
        return None
    (slope, _), covariance = np.polyfit(sizes, parts, 1, cov="unscaled")
    rest = np.array(parts) - np.polyval(np.polyfit(sizes, parts, 1), sizes)
    return Boundary(float(slope), float(np.sqrt(covariance[0, 0] * (rest @ rest) / max(len(sizes) - 2, 1))))
