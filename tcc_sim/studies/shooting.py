"""The equations of a periodic orbit: one or more segments of whole cycles whose ends meet (multiple shooting).

Unknowns are scaled: the nodes, each by the map's natural sizes, then the free parameters, each by the width of its
range, so that 0 to 1 is the range. U. M. Ascher, R. M. M. Mattheij, R. D. Russell, Numerical Solution of Boundary Value
Problems, SIAM 1995, Section 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.studies.maps import Floats, ParameterMap, Values

GROWTH = 1e5
"""Norm of the monodromy matrix above which an orbit of several cycles is cut into segments of one."""


@dataclass(frozen=True)
class Window:
    """The range of one free parameter; `inverse` takes the reciprocal as coordinate, 0 at infinity and 1 at `low`."""

    low: float
    high: float
    inverse: bool = False

    def value(self, scaled: float) -> float:
        """The parameter at 0 (low) to 1 (high)."""
        if self.inverse:
            return self.low / scaled
        return self.low + scaled * (self.high - self.low)

    def scaled(self, value: float) -> float:
        """0 at low to 1 at high."""
        return self.low / value if self.inverse else (value - self.low) / (self.high - self.low)

    def width(self, scaled: float) -> float:
        """Change of the parameter per unit of the scaled one."""
        return -self.low / scaled**2 if self.inverse else self.high - self.low


class Linearised(NamedTuple):
    """Equations at a point: residual (d,), Jacobian (d, d + P), and the monodromy matrix (n, n) in the map's units."""

    residual: Floats
    jacobian: Floats
    monodromy: Floats


@dataclass(frozen=True)
class Shooting:
    """The equations G = 0 of orbits of `period` cycles in `segments` parts of whole cycles."""

    map: ParameterMap
    period: int
    windows: tuple[Window, ...]
    segments: tuple[int, ...]

    rounding: ClassVar[float] = 1e-12

    @staticmethod
    def single(of: ParameterMap, period: int, *windows: Window) -> Shooting:
        """One segment over the whole period.

        Raises
        ------
        InputError
            A period in which the excitation does not repeat.
        """
        if period < 1 or period % of.forcing_period:
            raise InputError(f"the period is {period} cycles; it must be a multiple of {of.forcing_period}, after which "
                             "the excitation repeats")
        return Shooting(of, period, windows, (period,))

    @property
    def size(self) -> int:
        """Number of equations."""
        return len(self.segments) * self.map.dimension

    def values(self, z: Floats) -> Values:
        """The free parameters of a point."""
        return tuple(w.value(float(u)) for w, u in zip(self.windows, z[self.size:]))

    def nodes(self, z: Floats) -> Floats:
        """(m, n) states at the starts of the segments."""
        out: Floats = z[:self.size].reshape(-1, self.map.dimension) * self.map.scales
        return out

    def point(self, nodes: Floats, values: Values) -> Floats:
        """The scaled unknowns of nodes (m, n) and parameters."""
        return np.concatenate([(nodes / self.map.scales).ravel(),
                               [w.scaled(v) for w, v in zip(self.windows, values)]])

    def linearise(self, z: Floats) -> Linearised:
        """Residual and derivative at `z`; raises what the map raises."""
        n, size, scales = self.map.dimension, self.size, self.map.scales
        values, nodes = self.values(z), self.nodes(z)
        widths = np.array([w.width(float(u)) for w, u in zip(self.windows, z[size:])])
        if len(self.segments) == 1:
            image = self.map.evaluate(nodes[0], values, 0, self.period)
            jacobian = np.empty((n, n + len(widths)))
            jacobian[:, :n] = image.jacobian * scales / scales[:, None]
            jacobian.flat[:n * (n + len(widths)):n + len(widths) + 1] -= 1.0
            jacobian[:, n:] = image.by_parameter * widths / scales[:, None]
            return Linearised((image.value - nodes[0]) / scales, jacobian, image.jacobian)
        residual, jacobian = np.empty(size), np.zeros((size, size + len(widths)))
        monodromy, first = np.eye(n), 0
        for k, cycles in enumerate(self.segments):
            image = self.map.evaluate(nodes[k], values, first, cycles)
            rows, following = slice(k * n, k * n + n), (k + 1) % len(self.segments)
            residual[rows] = (image.value - nodes[following]) / scales
            jacobian[rows, rows] = image.jacobian * scales / scales[:, None]
            jacobian[rows, following * n:following * n + n] -= np.eye(n)
            jacobian[rows, size:] = image.by_parameter * widths / scales[:, None]
            monodromy = image.jacobian @ monodromy
            first += cycles
        return Linearised(residual, jacobian, monodromy)

    def recut(self, z: Floats) -> tuple[Shooting, Floats]:
        """The same orbit in segments of one cycle each, with the point that goes with them."""
        values, x = self.values(z), self.nodes(z)
        nodes, first = [], 0
        for k, cycles in enumerate(self.segments):
            at = x[k]
            for c in range(cycles):
                nodes.append(at)
                if c + 1 < cycles:
                    at = self.map.evaluate(at, values, first + c, 1).value
            first += cycles
        finer = Shooting(self.map, self.period, self.windows, (1,) * self.period)
        return finer, finer.point(np.array(nodes), values)
