"""Differences of fourth order with several steps: truncation limits long ones, rounding short ones."""

import math
from collections.abc import Callable

import numpy as np

Function = Callable[[float], np.ndarray]


def difference(at: Function, step: float) -> np.ndarray:
    """The derivative at 0 of a function of one number."""
    behind, before, after, ahead = (np.asarray(at(k * step)) for k in (-2.0, -1.0, 1.0, 2.0))
    return (8.0 * (after - before) - (ahead - behind)) / (12.0 * step)


def one_sided(at: Function, step: float) -> np.ndarray:
    """Do as `difference` for a function known on the side of the step alone."""
    weights = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / (12.0 * step)
    return np.tensordot(weights, np.array([at(k * step) for k in range(5)]), 1)


def apart(enough: float, result: np.ndarray, at: Function, step: float, size: np.ndarray | float = 1.0,
          floor: float = 0.0, by: Callable[[Function, float], np.ndarray] = difference,
          axis: int | tuple[int, ...] | None = None) -> float:
    """Distance of a derivative from the nearest of some differences, or from the first one that is nearer than
    `enough`, in units of `size` for each row, relative to the largest or `floor`; with `axis`, separately for the other
    axes.
    """
    def relative(expected: np.ndarray) -> float:
        wrong, large = (np.abs(a / size).max(axis=axis) for a in (result - expected, expected))
        return float((wrong / np.maximum(large, floor)).max())

    least = math.inf
    for k in (1.0, 0.3, 3.0, 0.1, 0.03):
        least = min(least, relative(by(at, step * k)))
        if least < enough:
            break
    return least
