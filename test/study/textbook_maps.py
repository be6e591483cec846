"""Maps of textbooks with known bifurcations, in the protocol of `continuation`, and the same maps in other clothes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tcc_sim.study.continuation.bifurcations import Bifurcation
from tcc_sim.study.continuation.branch import Branch, branch_through, first_point
from tcc_sim.study.continuation.orbits import (
    DEFAULTS,
    Floats,
    Image,
    Margin,
    Margins,
    Observation,
    ParameterRange,
    Settings,
    Shooting,
    Values,
    find_orbit,
)

Step = Callable[[Floats, Values], tuple[Floats, Floats, Floats]]


class TextbookMap:
    """A smooth map given by one step: value, derivative by the state, derivative by the parameters.

    size : the size of a state, its derivative by the state, and its natural size; by default the largest coordinate,
        without a derivative
    """

    forcing_period = 1
    piecewise = False
    divisible = False

    def __init__(self, step: Step, dimension: int, scales: Sequence[float] = (), amplitude_scale: float = 1.0,
                 size: Callable[[Floats], tuple[float, Floats]] | None = None) -> None:
        self.step, self.dimension, self.amplitude_scale, self.size = step, dimension, amplitude_scale, size
        self.scales = np.array(scales or [1.0] * dimension)

    def evaluate(self, x: Floats, values: Values, first: float, cycles: float) -> Image:
        slopes, sizes, rows = np.eye(self.dimension, self.dimension + len(values)), [], []
        for _ in range(int(cycles)):
            size, by = (float(np.abs(x).max()), None) if self.size is None else self.size(x)
            sizes.append(size)
            rows += [] if by is None else [by @ slopes]
            x, by_state, by_parameters = self.step(x, values)
            slopes = by_state @ slopes
            slopes[:, self.dimension:] += by_parameters
        if not np.isfinite(x).all():
            raise ArithmeticError("not finite")
        return Image(x, slopes, Observation(amplitudes=tuple(sizes)), np.array(rows or np.empty((0, 1))))

    def evaluate_each(self, states: Floats, values: Values, firsts: Sequence[float],
                      cycles: Sequence[float]) -> list[Image]:
        return [self.evaluate(x, values, first, count) for x, first, count in zip(states, firsts, cycles)]

    def margins(self, x: Floats, values: Values, first: float, cycles: float) -> Margins:
        return {}


BORDERS = {"stick_border": ("S", "S+S", "stick"), "adding_sliding": ("+S", "+S+S", "stick"),
           "grazing_sliding": ("+", "+S+", "grazing"), "crossing_sliding": ("S+-S", "S+S-S", "arrival"),
           "switching_sliding": ("S+S", "S+-S", "arrival")}
"""Kinds of borders: events on the side with fewer of them and on the other one, and the margin that vanishes."""


class Edged(TextbookMap):
    """A map whose events change where the first coordinate passes an edge at the start of a motion; below it a margin
    is the distance from there, and two others are large.
    """

    piecewise = True

    def __init__(self, step: Step, dimension: int, kind: str, edge: float, scales: Sequence[float] = ()) -> None:
        super().__init__(step, dimension, scales)
        self.edge, (self.below, self.above, self.margin) = edge, BORDERS[kind]

    def evaluate(self, x: Floats, values: Values, first: float, cycles: float) -> Image:
        image = super().evaluate(x, values, first, cycles)
        return image._replace(seen=image.seen._replace(events=self.above if x[0] > self.edge else self.below))

    def margins(self, x: Floats, values: Values, first: float, cycles: float) -> Margins:
        slopes = np.zeros(self.dimension + len(values))
        out = {name: Margin(0.5, slopes) for name in ("grazing", "arrival", "stick") if name != self.margin}
        slopes = slopes.copy()
        slopes[0] = -1.0
        return out if x[0] > self.edge else {**out, self.margin: Margin(self.edge - float(x[0]), slopes)}


def branch_of(of: TextbookMap, low: float, high: float, value: float, guess: Sequence[float], period: int = 1,
              settings: Settings = DEFAULTS) -> Branch:
    """The branch through the orbit near a guess."""
    shooting = Shooting.single(of, period, ParameterRange(low, high, name="p"), settings=settings)
    z = find_orbit(shooting, (value,), [np.array(guess)])
    assert z is not None
    return branch_through(first_point(shooting, z))


def of_kind(branch: Branch, kind: str) -> Bifurcation:
    return next(f for f in branch.bifurcations if f.kind == kind)


def mirrored(step: Step) -> Step:
    """The map with the first parameter of the other sign."""
    def other(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
        value, by_state, by = step(x, (-p[0], *p[1:]))
        return value, by_state, by * np.array([-1.0, *[1.0] * (len(p) - 1)])

    return other


def resized(step: Step, sizes: Sequence[float]) -> Step:
    """The map of states in other units."""
    c = np.array(sizes)

    def other(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
        value, by_state, by = step(x / c, p)
        return c * value, by_state * c[:, None] / c, by * c[:, None]

    return other


def at_second(step: Step, second: float) -> Step:
    """The map with its first parameter free alone."""
    def fixed(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
        value, by_state, by = step(x, (p[0], second))
        return value, by_state, by[:, :1]

    return fixed


def henon(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
    """x' = a - x^2 + b y, y' = x: fold at a = -(1 - b)^2/4, doubling at 3 (1 - b)^2/4; parameters a, b.

    Period two has x + y = 1 - b and x y = (1 - b)^2 - a; it doubles at a = (1 - b)^2 + (1 + b)^2/4.
    """
    a, b = p[0], p[1] if len(p) > 1 else 0.3
    by = np.array([[1.0, x[1]], [0.0, 0.0]])[:, :len(p)]
    return np.array([a - x[0] ** 2 + b * x[1], x[0]]), np.array([[-2.0 * x[0], b], [1.0, 0.0]]), by


def delayed_logistic(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
    """x' = r x (1 - y), y' = x: Neimark-Sacker at r = 2 on x = 1 - 1/r."""
    r = p[0]
    return (np.array([r * x[0] * (1.0 - x[1]), x[0]]), np.array([[r * (1.0 - x[1]), -r * x[0]], [1.0, 0.0]]),
            np.array([[x[0] * (1.0 - x[1])], [0.0]]))


def logistic(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
    """x' = r x (1 - x): doublings at r = 3, 1 + sqrt 6, 3.5440903595..., a transcritical branch point at r = 1."""
    return p[0] * x * (1.0 - x), np.array([[p[0] * (1.0 - 2.0 * x[0])]]), (x * (1.0 - x))[:, None]


def isola(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
    """x' = x + (x^2 + p^2 - 1)/4: fixed points on the unit circle, folds at p = -1 and 1."""
    return (x + 0.25 * (x**2 + p[0] ** 2 - 1.0), np.array([[1.0 + 0.5 * x[0]]]), np.array([[0.5 * p[0]]]))


def hysteresis(x: Floats, p: Values) -> tuple[Floats, Floats, Floats]:
    """x' = x + 0.3 (p + x - x^3): folds at p = -2/(3 sqrt 3) and 2/(3 sqrt 3)."""
    return x + 0.3 * (p[0] + x - x**3), np.array([[1.0 + 0.3 * (1.0 - 3.0 * x[0] ** 2)]]), np.array([[0.3]])
