"""Ticks of the real-time solver whose inputs are known beforehand, in few compiled calls."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tcc_sim.compiling.compiled import Kernel
from tcc_sim.solvers.fixed_step import tick
from tcc_sim.solvers.terms import Terms, for_ticks, holding, substeps
from tcc_sim.trajectory import Floats

TICKS_AT_ONCE, WITH_PROFILES = 1 << 14, 1 << 8
"""Ticks of `solve_ticks` in one compiled call, without and with a profile for each."""
RESULTS = 7
"""Numbers in `fixed_step.Reached`, of which the last counts iterations."""


def substeps_of_ticks(terms: Terms, step: float, torque: Floats | None, load: Floats | None,
                      ticks: int) -> NDArray[np.int64]:
    """Return the sub-steps of ticks with the inputs of `solve_ticks`, (ticks,); OutOfRange for too many.

    More load never needs fewer, so a load between two that need as many needs no count.
    """
    held = None if torque is None else float(torque[0])
    if load is None:
        return np.full(ticks, substeps(holding(terms, held, None), step))
    loads, place = np.unique(load, return_inverse=True)
    counts, parts = np.zeros(len(loads), np.int64), [(0, len(loads) - 1)]
    for low, high in parts:
        for k in (low, high):
            counts[k] = counts[k] or substeps(holding(terms, held, float(loads[k])), step)
        if counts[low] == counts[high]:
            counts[low:high] = counts[low]
        elif high > low + 1:
            parts += [(low, (low + high) // 2), ((low + high) // 2, high)]
    return counts[place]


def solve_ticks(terms: Terms, step: float, first: NDArray[np.int64], states: Sequence[Floats], count: NDArray[np.int64],
                torque: Floats | None = None, load: Floats | None = None, approach: Floats | None = None,
                far: Floats | None = None) -> Floats:
    """Make n ticks one after the other, to the last bit as a Stepper makes them, in a few compiled calls.

    Parameters
    ----------
    terms : of the scene, as `terms_of`
    step : length of a tick, s
    first : (n,) number of each tick, which begins at this number times the step
    states : n arrays (4,), which the ticks change in place; the same one where a tick follows the one before
    count : (n,) sub-steps, as `substeps_of_ticks`
    torque, load : (n,) commanded engine torque and saturation torque, N m; None for those of the scene
    approach, far : (n, 4) rows of `Terms`; None without a lag, and where the far end stands still

    Returns
    -------
    (n, 6) v, theta2, omega2, theta1, engine and friction torque after each tick
    """
    varies = terms.profile is not None and not (torque is None and load is None)
    size, out = WITH_PROFILES if varies else TICKS_AT_ONCE, np.empty((len(first), 6))
    for begin in range(0, len(first), size):
        part = slice(begin, begin + size)
        held = [itertools.repeat(None) if values is None else values[part].tolist() for values in (torque, load)]
        own = [for_ticks(holding(terms, *inputs)) for inputs, _ in zip(zip(*held), first[part] if varies else range(1))]
        arrays = {"profile": [one.profile for one in own] if varies else None,
                  "approach": None if approach is None else list(approach[part, None]),
                  "far": [own[0].far] * len(first[part]) if far is None else list(far[part, None])}
        means = [np.full(len(first[part]), mean) if values is None else values[part]
                 for values, mean in ((torque, own[0].mean_torque), (load, own[0].mean_load))]
        out[part] = _solve_part(own[0], step, first[part], states[part], count[part], means,
                                {name: rows for name, rows in arrays.items() if rows is not None})
    return out


def _solve_part(terms: Terms, step: float, first: NDArray[np.int64], states: Sequence[Floats], count: NDArray[np.int64],
                means: Sequence[Floats], arrays: Mapping[str, Sequence[Any]]) -> Floats:
    """Make ticks by one call of machine code, which takes the arguments of each call of `tick` one after the other.

    Parameters
    ----------
    means : (n,) mean torques and loads
    arrays : the last fields of `terms`, of which each tick has its own
    """
    numbers = first * step, (first + 1) * step, count, step / count, *means

    def arguments(k: int) -> tuple[Any, ...]:
        own = terms._replace(**{name: rows[k] for name, rows in arrays.items()})
        return (states[k], *(column[k].item() for column in numbers), own)

    def addresses(rows: Sequence[Any]) -> NDArray[np.int64]:
        return np.fromiter(map(id, rows), np.int64, len(rows))

    entry, block = cast(Kernel, tick).laid_out(arguments(0))
    if type(block) is list:  # Without machine code that is kept.
        return np.array([entry.run([list(arguments(k))]) for k in range(len(first))])[:, :RESULTS - 1]
    one = np.frombuffer(block, np.float64)[1:]
    laid = np.empty(1 + len(first) * len(one))
    laid[:1].view(np.int64)[0] = len(first)
    rows, inputs = laid[1:].reshape(len(first), len(one)), len(one) - RESULTS
    rows[:] = one
    for place, column in ((0, addresses(states)), *enumerate(numbers, 1),
                          *((inputs - 1 - k, addresses(of)) for k, of in enumerate(reversed([*arrays.values()])))):
        rows[:, place] = column.view(np.float64)
    entry.run((ctypes.c_char * laid.nbytes).from_buffer(laid.data))
    return rows[:, inputs:-1]
