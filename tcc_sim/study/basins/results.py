"""Results of basins: a plane with attractors, labels of cells and boundary, and planes along a key."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import counted
from tcc_sim.model.parameters import System
from tcc_sim.model.quantity import sequence_of_numbers
from tcc_sim.result import Described, Result, as_lists, reported, reporting, result_class
from tcc_sim.shown_units import speed
from tcc_sim.study.basins.attractors import RUNAWAY, UNDECIDED, Attractor, Counts, Labels

ATTRACTORS_SHOWN = 12  # attractors in the text of a result
# Distances, cells, over which final states are compared (C. Grebogi et al., Phys. Lett. A 99, 1983).
DISTANCES = (1, 2, 4, 8, 16)


@result_class
class Axis:
    """Axis of the plane: an initial.* key and its values, numbers in any sequence or array."""

    key: str = reported("scene key")
    values: Sequence[float] = reported("its values", "{key}")

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", sequence_of_numbers(self.key, self.values))


@result_class
class Boundary:
    """Uncertainty of the final state: the share of cells with another label at a distance eps grows as eps^exponent."""

    exponent: float = reported("uncertainty exponent of the boundary", name="uncertainty_exponent")
    error: float = reported("standard error of its fit", name="standard_error")

    @reporting("dimension of the boundary, 2 minus the exponent")
    def dimension(self) -> float:
        return 2.0 - self.exponent


@result_class
class AttractorFigures:
    """Attractor in JSON."""

    number: int = reported("number, the same at all values of over at which it continues")
    period: int = reported("period of the motion; 0 for none", "periods of excitation")
    max_slip_speed: float = reported("largest |slip speed|", "rad/s")
    section: NDArray[np.float64] = reported("plate angle and slip speed at t = 2 pi n/omega", "rad, rad/s")
    section_states: NDArray[np.float64] = reported("with the plate speed", "rad, rad/s, rad/s")
    multipliers: NDArray[np.complex128] | None = reported("Floquet multipliers, [re, im]; null without a period")
    fraction: float = reported("share of the plane")
    radius: float = reported("capture radius around section points, in natural sizes of states")
    validated: bool = reported("whether motions that start there return")
    state: NDArray[np.float64] | None = reported(
        "slip speed, plate angle and plate speed at t = 0; null without a period", "rad/s, rad, rad/s")


@result_class(repr=False)
class Basins(Result):
    """Basins of one system in one plane.

    labels : (len(second), len(first)) index into `attractors`, -1 undecided, -2 runaway
    cycles : (len(second), len(first)) cycles until the cell was decided
    over : scene key and its value, if there are planes at several values
    """

    plane: tuple[Axis, Axis] = reported("first and second axis")
    attractors: tuple[Attractor, ...]
    labels: Labels
    cycles: Counts
    seconds: float = reported("computing time", "s")
    system: System
    over: tuple[str, float] | None = None

    def fraction(self, label: int) -> float:
        """Return the share of the plane with this label."""
        return float(np.mean(self.labels == label))

    def boundary(self) -> Boundary | None:
        """Return the uncertainty exponent; None if too few labels differ for a fit."""
        return boundary_of(self.labels)

    @reporting("attractors in the plane", name="attractors")
    def figures(self) -> list[AttractorFigures]:
        return [AttractorFigures(a.number, a.period, a.largest, a.section[:, [1, 0]], a.section[:, [1, 0, 2]],
                                 a.multipliers, self.fraction(k), a.radius, a.validated,
                                 a.section[0] if a.period else None)
                for k, a in enumerate(self.attractors)]

    @reporting("share of the plane that reached no attractor")
    def undecided(self) -> float:
        return self.fraction(UNDECIDED)

    @reporting("share of the plane in which slip grows for ever")
    def runaway(self) -> float:
        return self.fraction(RUNAWAY)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return a row for every cell: both keys, its label, and the cycles until it was decided."""
        first, second = self.plane
        return {first.key: np.tile(first.values, len(second.values)),
                second.key: np.repeat(second.values, len(first.values)),
                "label": self.labels.ravel(), "cycles": self.cycles.ravel()}

    def _text(self) -> str:
        return "\n".join(self.lines(ATTRACTORS_SHOWN))

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    def lines(self, most: int | None = None) -> list[str]:
        """Return lines for the plane, up to `most` attractors with their shares, runaway slip and undecided cells."""
        first, second = self.plane
        lines = [f"Basins in {first.key} ({len(first.values)}) and {second.key} ({len(second.values)})"]
        names = [(f"attractor {a.number}: " if self.over else "") + (f"period {a.period}" if a.period else "no period")
                 for a in self.attractors]
        lines += [f"  {100.0 * self.fraction(k):6.2f} %  {names[k]}, largest slip speed {speed(a.largest)}"
                  f"{'' if a.validated else ', capture radius not validated'}"
                  for k, a in enumerate(self.attractors[:most])]
        if most is not None and len(self.attractors) > most:
            lines.append(f"  {counted(len(self.attractors) - most, 'more attractor')}")
        return [*lines, f"  {100.0 * self.fraction(RUNAWAY):6.2f} %  runaway slip",
                f"  {100.0 * self.fraction(UNDECIDED):6.2f} %  undecided"]


@result_class
class Bounded:
    """Plane with the uncertainty of its boundary."""

    basins: Basins = reported("the plane", spread=True)
    boundary: Boundary | None = reported("with --boundary; null if too few cells differ", optional=True)


@dataclass(frozen=True)
class Planes(Described):
    """One plane, or planes at the values of a key; `bounded` adds the uncertainty of their boundaries."""

    planes: Sequence[Basins]
    bounded: bool = False

    @reporting("key that has a plane at each of its values", optional=True)
    def over(self) -> str | None:
        return None if self.planes[0].over is None else self.planes[0].over[0]

    @reporting("its values", "{over}", optional=True)
    def values(self) -> list[float] | None:
        return [one.over[1] for one in self.planes if one.over is not None] or None

    @reporting("the plane; with over, everything but the axes in lists", spread=True, of=(Bounded,))
    def figures(self) -> Any:
        planes = [Bounded(one, one.boundary()) if self.bounded else one for one in self.planes]
        if self.over is None:
            return planes[0]
        return {**as_lists(planes, Bounded if self.bounded else Basins), "plane": self.planes[0].plane}

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of `Basins` for all planes below each other, with the values of `over` first."""
        tables = [one.columns() for one in self.planes]
        over = {} if self.over is None else {self.over: np.repeat(np.array(self.values), self.planes[0].labels.size)}
        return {**over, **{name: np.concatenate([table[name] for table in tables]) for name in tables[0]}}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return `labels` and `cycles`, (second, first) arrays, and the values of both axes; `over` adds a first axis.

        Labels: -1 undecided, -2 runaway, else an index into the attractors.
        """
        cells = {name: np.stack([getattr(one, name) for one in self.planes]) for name in ("labels", "cycles")}
        first, second = self.planes[0].plane
        axes = {"first_values": np.array(first.values), "second_values": np.array(second.values)}
        if self.over is None:
            return {**{name: each[0] for name, each in cells.items()}, **axes}
        return {**cells, **axes, "over_values": np.array(self.values)}


def boundary_of(labels: Labels) -> Boundary | None:
    """Return the uncertainty exponent of a map of labels, from differences between decided cells along either axis."""
    sizes, parts = [], []
    for k in DISTANCES:
        if k >= min(labels.shape):
            break
        pairs = (labels[:, k:], labels[:, :-k]), (labels[k:], labels[:-k])
        decided = [(one != UNDECIDED) & (other != UNDECIDED) for one, other in pairs]
        unlike = sum(int(((one != other) & known).sum()) for (one, other), known in zip(pairs, decided))
        part = unlike / max(sum(int(known.sum()) for known in decided), 1)
        if part > 0.0:
            sizes.append(np.log(k))
            parts.append(np.log(part))
    if len(sizes) < 3:
        return None
    (slope, _), covariance = np.polyfit(sizes, parts, 1, cov="unscaled")
    rest = np.array(parts) - np.polyval(np.polyfit(sizes, parts, 1), sizes)
    return Boundary(float(slope), float(np.sqrt(covariance[0, 0] * (rest @ rest) / max(len(sizes) - 2, 1))))
