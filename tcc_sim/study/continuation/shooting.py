"""The equations of a periodic orbit: one or more segments whose ends meet (multiple shooting).

Unknowns are scaled: the nodes, each by the map's natural sizes, then the free parameters, each by the width of its
range, so that 0 to 1 is the range. U. M. Ascher, R. M. M. Mattheij, R. D. Russell, Numerical Solution of Boundary Value
Problems, SIAM 1995, Section 4.3. Lengths, steps and residuals are in natural sizes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError
from tcc_sim.study.continuation.problem import UNSEEN, Floats, Image, Observation, ParameterMap, Values


@dataclass(frozen=True)
class Settings:
    """Bounds and steps of a continuation."""

    growth: float = 1e2  # growth over a segment above which it is cut: the solver's 1e-13 stays below 1e-10
    regrowth: float = 10.0  # growth over a segment, in `growth`, above which the orbit is cut into other segments
    fewer_after: int = 20  # points after which fewer segments are tried
    # Whether growth is also measured about every change between stick and slip: growth in slip that stick removes
    # within the same part is not in the part's derivative, but in how sharply it bends.
    thorough: bool = False
    # Largest residual of an orbit, however short the last step was: where the Jacobian is singular, as in runaway slip,
    # a short step does not make an orbit.
    residual: float = 5e-9
    correct_tolerance: float = 1e-9  # last step of a point
    first_step: float = 0.01
    smallest_step: float = 1e-9
    largest_step: float = 0.1
    max_points: int = 3000  # most points in one direction of a branch
    max_tries: int = 6000  # most steps tried in one direction
    # Modulus of a multiplier above which a branch ends: an orbit known to 1e-12 closes to 1e-2 only, so that neither
    # value nor sign of the multiplier can be trusted. Motions along the falling branch of friction reach it.
    canard: float = 1e10
    max_branches: int = 24  # most branches of a diagram
    longest_period: int = 12  # longest period in it, periods of the excitation


DEFAULTS = Settings()


PARTS = 16  # parts of a cycle, or of a part of it, over which growth is measured
FINEST = 1.0 / PARTS**3  # shortest part of a segment, cycles


@dataclass(frozen=True)
class ParameterRange:
    """The range of one free parameter."""

    low: float
    high: float
    name: str = "parameter"

    def value(self, scaled: float) -> float:
        """The parameter at 0 (low) to 1 (high)."""
        return self.low + scaled * (self.high - self.low)

    def scaled(self, value: float) -> float:
        """0 at low to 1 at high."""
        return (value - self.low) / (self.high - self.low)

    @property
    def width(self) -> float:
        """Change of the parameter per unit of the scaled one."""
        return self.high - self.low


class Linearised(NamedTuple):
    """Equations at a point, in natural sizes.

    residual, jacobian : (d,), (d, d + P)
    blocks : (m, n, n) derivatives of the segments' ends by their starts
    seen : observation over the period
    amplitudes, amplitude_gradient : (N,) the largest sizes of the motion, and (N, d + P) their derivatives
    """

    residual: Floats
    jacobian: Floats
    blocks: Floats = np.empty((0, 0, 0))
    seen: Observation = UNSEEN
    amplitudes: Floats = np.empty(0)
    amplitude_gradient: Floats = np.empty((0, 0))


@dataclass(frozen=True)
class Shooting:
    """The equations G = 0 of orbits of `period` cycles in segments, whose lengths `segments` are in cycles."""

    map: ParameterMap
    period: int
    ranges: tuple[ParameterRange, ...]
    segments: tuple[float, ...]
    settings: Settings = DEFAULTS

    rounding: ClassVar[float] = 1e-10

    @staticmethod
    def single(of: ParameterMap, period: int, *ranges: ParameterRange, settings: Settings = DEFAULTS) -> Shooting:
        """One segment over the whole period.

        Raises
        ------
        InputError
            A period in which the excitation does not repeat.
        """
        if period < 1 or period % of.forcing_period:
            raise InputError(f"the period is {period} cycles; it must be a multiple of {of.forcing_period}, after "
                             "which the excitation repeats")
        return Shooting(of, period, ranges, (period,), settings)

    @property
    def size(self) -> int:
        """Number of equations, and of unknowns before the parameters."""
        return len(self.segments) * self.map.dimension

    def outer(self, vector: Floats) -> Floats:
        """The unknowns of single shooting: the first node, and those that are no nodes."""
        return np.concatenate([vector[:self.map.dimension], vector[self.size:]])

    def values(self, z: Floats) -> Values:
        """The free parameters of a point."""
        return tuple([w.value(u) for w, u in zip(self.ranges, z[self.size:].tolist())])

    @property
    def widths(self) -> list[float]:
        """Change of each free parameter per unit of its unknown."""
        return [w.width for w in self.ranges]

    def nodes(self, z: Floats) -> Floats:
        """(m, n) states at the starts of the segments."""
        return np.asarray(z[:self.size].reshape(-1, self.map.dimension) * self.map.scales)

    def unknowns(self, nodes: Floats, values: Values) -> Floats:
        """The scaled unknowns of nodes (m, n) and parameters."""
        return np.concatenate([(nodes / self.map.scales).ravel(),
                               [w.scaled(v) for w, v in zip(self.ranges, values)]])

    def linearise(self, z: Floats) -> Linearised:
        """Residual and derivative at `z`, with the map's exceptions."""
        n, size, scales, count = self.map.dimension, self.size, self.map.scales, len(self.segments)
        values, nodes = self.values(z), self.nodes(z)
        starts, blocks_at, ends_at = layout(self.segments, n)
        images = self.map.evaluate_each(nodes, values, starts, self.segments)
        sizes, units = unknowns_sizes(tuple(scales.tolist()), tuple(self.widths))
        parts = np.array([image.derivatives for image in images]) * units
        blocks, ends, following = parts[..., :n], images[0].value, nodes[0]
        if count == 1:
            jacobian = parts[0].copy()
        else:
            ends, following = np.array([image.value for image in images]), np.roll(nodes, -1, axis=0)
            jacobian = np.zeros((size, size + len(self.ranges)))
            jacobian[blocks_at], jacobian[:, size:] = blocks, parts[..., n:].reshape(size, -1)
        jacobian[ends_at] -= 1.0
        residual = ((ends - following) / scales).ravel()
        seen, scale = joined_observation([image.seen for image in images], self.segments), self.map.amplitude_scale
        gradients = [image.amplitude_gradient for image in images if image.amplitude_gradient is not None]
        if len(gradients) < count:
            return Linearised(residual, jacobian, blocks, seen)
        return Linearised(residual, jacobian, blocks, seen, np.array(seen.amplitudes) / scale,
                          self._joined(gradients, sizes / scale))

    def _joined(self, gradients: Sequence[Floats], sizes: Floats) -> Floats:
        """(N, d + P) derivatives of the amplitudes of all segments by nodes and parameters of these sizes."""
        parts = [gradient * sizes for gradient in gradients]
        if len(parts) == 1:
            return parts[0]
        n, size, row = self.map.dimension, self.size, 0
        out = np.zeros((sum(map(len, parts)), size + len(self.ranges)))
        for k, part in enumerate(parts):
            out[row:row + len(part), k * n:k * n + n], out[row:row + len(part), size:] = part[:, :n], part[:, n:]
            row += len(part)
        return out

    def cut(self, z: Floats) -> tuple[Shooting, Floats]:
        """The same orbit in as few segments as bound the growth over each, and its unknowns.

        A map that cannot be divided is cut between cycles.
        """
        values, x = self.values(z), self.nodes(z)
        parts: list[tuple[float, Floats, Floats]] = []
        first = 0.0
        for k, cycles in enumerate(self.segments):
            at, end = x[k], first + cycles
            while first < end:
                length = min(1.0 - first % 1.0, end - first)
                pieces, at = self._pieces(at, values, first, length)
                parts += pieces
                first += length
        lengths, nodes = greedy(parts, self.settings.growth)
        if not self.map.divisible:
            lengths = [round(length) for length in lengths]
        finer = replace(self, segments=tuple(lengths))
        return finer, finer.unknowns(np.array(nodes), values)

    def keeps_segments(self, blocks: Floats, regrowth: float, anew: bool) -> bool:
        """Whether the growth over each segment is bounded and `anew` is false, or there are no other segments."""
        large = float(np.abs(blocks).max()) > regrowth * self.settings.growth
        return not (large or anew) or (not self.map.divisible and len(self.segments) == self.period)

    def _pieces(self, x: Floats, values: Values, first: float,
                length: float) -> tuple[list[tuple[float, Floats, Floats]], Floats]:
        """Length, start and scaled derivative of pieces with bounded growth, and the end of the last one."""
        scales, parts = self.map.scales, PARTS
        whole: Image = self.map.evaluate(x, values, first if self.map.divisible else round(first),
                                         length if self.map.divisible else round(length))
        block = whole.jacobian * scales / scales[:, None]
        if not self.map.divisible or length <= 1.5 * FINEST:
            return [(length, x, block)], whole.value
        steady = not self.settings.thorough or len(whole.seen.events) < 2
        if length <= 1.0 / parts and steady and float(np.abs(block).max()) < self.settings.growth**0.5:
            return [(length, x, block)], whole.value
        out: list[tuple[float, Floats, Floats]] = []
        begin, end, step = first, first + length, 1.0 / parts
        while step >= length:
            step /= parts
        while begin < end:
            following = min((math.floor(begin / step + 1e-9) + 1.0) * step, end)
            pieces, x = self._pieces(x, values, begin, following - begin)
            out += pieces
            begin = following
        return out, x


@lru_cache(maxsize=64)
def unknowns_sizes(scales: tuple[float, ...], widths: tuple[float, ...]) -> tuple[Floats, Floats]:
    """(n + P,) sizes of a node and the parameters, and (n, n + P) those of a node's derivatives by them."""
    sizes = np.array(scales + widths)
    return sizes, sizes / np.array(scales)[:, None]


Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns in a Jacobian."""


@lru_cache(maxsize=64)
def layout(segments: tuple[float, ...], n: int) -> tuple[list[float], Places, Places]:
    """Starts of segments, in cycles, and the places of their derivatives and of the nodes in which they end."""
    diagonal = np.arange(len(segments) * n)
    rows = diagonal.reshape(-1, n)
    square = (len(segments), n, n)
    return ([sum(segments[:k]) for k in range(len(segments))],
            (np.broadcast_to(rows[:, :, None], square), np.broadcast_to(rows[:, None, :], square)),
            (diagonal, np.roll(diagonal, -n)))


def greedy(parts: list[tuple[float, Floats, Floats]], growth: float) -> tuple[list[float], list[Floats]]:
    """Lengths and first nodes of the longest segments with bounded growth from any of their pieces to their ends."""
    lengths: list[float] = []
    nodes: list[Floats] = []
    ahead = np.empty((0, *parts[0][2].shape))
    for length, node, block in parts:
        ahead = np.concatenate([block @ ahead, block[None]])
        if not lengths or float(np.abs(ahead).max()) > growth:
            lengths.append(length)
            nodes.append(node)
            ahead = block[None]
        else:
            lengths[-1] += length
    return lengths, nodes


def joined_observation(seen: list[Observation], segments: tuple[float, ...]) -> Observation:
    """The observation over several segments."""
    if len(seen) == 1:
        return seen[0]
    events = "".join(mode for mode, _ in groupby("".join(part.events for part in seen)))
    stick = sum(part.stick_fraction * length for part, length in zip(seen, segments)) / sum(segments)
    return Observation(max(part.largest for part in seen), stick, events,
                       tuple(h for part in seen for h in part.amplitudes))
