"""Times of a table's rows: their usual step, holes between them, and rows out of order or with repeated times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, counted
from tcc_sim.trajectory import Floats

Spans = Floats
"""Begin and end of stretches of time, (k, 2), s, ascending."""
HOLE = 1.5
"""Step beyond which rows are missing, relative to the usual one, or to the largest usual one where stamps jitter."""
LARGEST_JITTER = 2.0
"""Largest usual step, relative to the median one."""
LEAST_JITTER = 0.05
"""Variation of steps from which on a sentence names it."""
IRREGULAR = 6.0
"""Step beyond which rows are missing in an irregular table, relative to the median one."""
_BLOCK = 64
"""Steps from which the usual one is taken: it may drift, as in a table sampled over the crank angle."""
_REGULAR = 0.8
"""Least share of steps within half of the usual one in a table that was sampled."""
_FEWEST = 16
"""Rows from which a table counts as sampled."""
_MOST_RUNS, _SHOWN = 50, 5
_REPEATED = 0.01
"""Share of repeated times up to which single rows are at fault, and not the digits of all."""


def usual_steps(t: Floats) -> Floats | None:
    """Return the usual step around each of n - 1 steps, s; None for rows that were not sampled in regular steps.

    It is the median of a block of steps, or of three blocks, so that a hole does not change it.
    """
    steps = np.diff(t)
    if len(t) < _FEWEST:
        return None
    blocks = max(len(steps) // _BLOCK, 1)
    size, longer = divmod(len(steps), blocks)   # The first ones have one step more.
    cut = longer * (size + 1)
    medians = np.concatenate([np.median(steps[:cut].reshape(longer, size + 1), axis=1),
                              np.median(steps[cut:].reshape(blocks - longer, size), axis=1)])
    if blocks > 2:
        around = np.concatenate([medians[:1], medians, medians[-1:]])
        medians = np.median(np.stack([around[:-2], around[1:-1], around[2:]]), axis=0)
    usual = np.repeat(medians, np.where(np.arange(blocks) < longer, size + 1, size))
    regular = np.mean(np.abs(steps - usual) <= 0.5 * usual)
    return np.asarray(usual) if regular >= _REGULAR else None


def holes_in(t: Floats) -> Spans:
    """Return the stretches without rows, (k, 2): steps above HOLE times the usual one, or above IRREGULAR times the
    median where rows are irregular.
    """
    usual, steps = usual_steps(t), np.diff(t)
    if not len(steps):
        return np.empty((0, 2))
    if usual is None:
        at = np.flatnonzero(steps > IRREGULAR * np.median(steps))
    else:
        jitter = min(max(float(np.quantile(steps / usual, 0.9)), 1.0), LARGEST_JITTER)
        at = np.flatnonzero(steps > HOLE * jitter * usual)
    return np.stack([t[at], t[at + 1]], axis=1)


def jitter_of(t: Floats) -> float:
    """Return the 95 % quantile of the deviations of steps from the usual one, relative to it; 0 for irregular rows."""
    usual = usual_steps(t)
    return 0.0 if usual is None else float(np.quantile(np.abs(np.diff(t) / usual - 1.0), 0.95))


def merged(spans: Spans) -> Spans:
    """Return stretches of time with overlapping ones joined."""
    if len(spans) < 2:
        return spans
    spans = spans[np.argsort(spans[:, 0], kind="stable")]
    ends = np.maximum.accumulate(spans[:, 1])
    first = np.concatenate([[True], spans[1:, 0] > ends[:-1]])
    last = np.concatenate([first[1:], [True]])
    return np.stack([spans[first, 0], ends[last]], axis=1)


def in_words(spans: Spans) -> str:
    """Return stretches of time in words."""
    shown = ", ".join(f"{a:.6g} to {b:.6g} s" for a, b in spans[:_SHOWN].tolist())
    return shown + (f" and {len(spans) - _SHOWN} more" if len(spans) > _SHOWN else "")


def rows_in_order(t: Floats, same: NDArray[np.bool_], where: str) -> tuple[NDArray[np.int64], Floats, list[str]]:
    """Return the numbers of the rows in the order of time, their times, strictly increasing, s, and sentences on what
    was changed, from finite times (n,), s, and whether each row has the values of the row before (n,); InputError,
    which begins with `where`, if there is no such order.
    """
    rows, said = np.arange(len(t)), []
    if (np.diff(t) < 0.0).any():
        rows, sentence = _sorted(t, where)
        said.append(sentence)
        t, same = t[rows], same[rows] & (np.diff(rows, prepend=-2) == 1)
    repeated = np.concatenate([[False], np.diff(t) == 0.0])
    if (repeated & same).any():
        said.append(f"{counted(int((repeated & same).sum()), 'row')} repeated time and values of the row before and "
                    "were left out")
        keep = ~(repeated & same)
        rows, t, repeated = rows[keep], t[keep], repeated[keep]
    if repeated.any():
        t, sentence = _spread(t, repeated, where)
        said.append(sentence)
    return rows, t, said


def _sorted(t: Floats, where: str) -> tuple[NDArray[np.int64], str]:
    """Return the numbers of the rows of one run in the order of time, with a sentence."""
    cuts = np.flatnonzero(np.diff(t) < 0.0) + 1
    order = np.argsort(t, kind="stable")
    steps, forward = np.diff(t[order]), np.diff(t)
    usual = float(np.median(forward[forward > 0.0])) if (forward > 0.0).any() else 0.0
    repeats = int((steps == 0.0).sum()) > int((forward == 0.0).sum())
    crowded = np.count_nonzero(steps < 0.3 * usual) > np.count_nonzero(np.abs(forward) < 0.3 * usual)
    if not repeats and (not crowded or len(cuts) * 10 > len(t)):
        return order, f"{counted(len(cuts), 'row')} came before an earlier one in time; the rows were sorted by time"
    starts, ends = np.concatenate([[0], cuts]), np.concatenate([cuts, [len(t)]])
    if len(starts) > _MOST_RUNS:
        raise InputError(f"{where}: the times go back {len(cuts)} times, and sorting them gives no single run; export "
                         "one run")
    longest = int(np.argmax(ends - starts))
    a, b = int(starts[longest]), int(ends[longest])
    return np.arange(a, b), (f"the times start again {counted(len(cuts), 'time')} (first after row {cuts[0]}): only "
                             f"the longest of {len(starts)} runs is used, rows {a + 1} to {b}, {t[a]:.6g} to "
                             f"{t[b - 1]:.6g} s")


def _spread(t: Floats, repeated: NDArray[np.bool_], where: str) -> tuple[Floats, str]:
    """Return times that increase in place of repeated ones, with a sentence."""
    count, steps = int(repeated.sum()), np.diff(t)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if count <= _REPEATED * len(t):
        out = t.copy()
        for k in np.flatnonzero(repeated).tolist():
            after = out[k + 1] if k + 1 < len(t) else out[k] + 2.0 * usual
            before = out[k - 1]
            if abs(after - before - 2.0 * usual) > 0.5 * usual:
                raise InputError(f"{where}: row {k + 1} repeats the time {t[k]:.9g} s of the row before with other "
                                 f"values, and the row after it is {after - before:.3g} s later; remove one of the two")
            out[k] = 0.5 * (before + after)
        return out, (f"{counted(count, 'row')} repeated the time of the row before; each was placed between its "
                     "neighbours")
    n = np.arange(len(t), dtype=np.float64)
    slope, start = np.polyfit(n, t, 1)
    even = start + slope * n
    if np.abs(t - t[0] - slope * n).max() <= 1.05 * usual:
        even = t[0] + slope * n
    if usual and np.abs(t - even).max() <= 1.05 * usual:
        return even, (f"{count} of {len(t)} rows repeat the time of the row before, because it is written in steps of "
                      f"{usual:.3g} s; even steps of {slope:.6g} s replace them")
    raise InputError(f"{where}: {count} of {len(t)} rows repeat the time of the row before, so that their times are "
                     "not known; export the time with more digits")
