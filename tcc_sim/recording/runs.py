"""Runs of a driveline from its messages: by run and stamp or, where states do not name their run, by publisher,
sequence number and stamp.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.messages import held
from tcc_sim.recording.announcements import InputSource, SceneRecord
from tcc_sim.recording.columns import NEVER, Commanded, JointStates
from tcc_sim.recording.layouts import LOG, NUMBER, ORIGIN, ROW, SENT, STAMP, Floats, Positions, StampedMessages
from tcc_sim.recording.stamps import Break, StampCounter
from tcc_sim.topics import HELD_INPUTS, INPUTS

BEAT = round(held.BEAT * 1e9)
"""Longest simulation time between two messages on `held`, ns."""
BEGIN_TICKS = 2.5
"""Latest first state of a run whose begin was recorded, in ticks: two may be lost."""
_PRESSURE, _FAR = INPUTS[1], "output_speed"


def runs_of(states: StampedMessages, joined: Mapping[str, StampedMessages], rows: Mapping[int, Floats],
            names: Sequence[str], sources: Sequence[InputSource], counter: StampCounter
            ) -> tuple[tuple[JointStates, ...], int, list[str]]:
    """Return the runs of states in the window, each with the other messages of its number at equal stamps; the number
    of repeated states with other values than before; and the names of the other messages, `joined` by column, that
    cannot be placed. The counter receives the stamps.

    Parameters
    ----------
    rows : messages of `held` by the number of the run, which is the origin of messages that name it
    names : names of the runs; none if messages do not name them, which `_numbered` then numbers
    sources : announced sources of the inputs of states without names
    """
    unplaced: list[str] = []
    if not names:
        publisher = states.heads[ORIGIN]
        states, joined, unplaced = _numbered(states, joined)
        counter.pieces(states.heads[STAMP], publisher)
    every = _by_stamp(states.heads)
    fresh = np.append(True, (np.diff(every[ORIGIN]) != 0) | (np.diff(every[STAMP]) != 0))[:every.shape[1]]
    differing = _count_differing(states.columns, every[ROW], fresh)
    every = every.compress(fresh, axis=1)
    by_stamp = [(messages.columns, _by_stamp(messages.heads)) for messages in joined.values()]
    runs, index, process = list[JointStates](), 0, ""
    for number in np.unique(every[ORIGIN]).tolist():
        mine = _of_run(every, number)
        facts: dict[str, Any] = {"began": Break.RESET if number else Break.START}
        if names:
            kind = (Break.START if not process else
                    Break.RESET if names[number][:held.PROCESS] == process else Break.RESTART)
            process, of_run = names[number][:held.PROCESS], rows.get(number)
            stamps = mine[STAMP]
            # The runs before the first one may not be in the recording.
            joined_late = kind is Break.START and not names[number].endswith(held.FIRST)
            facts = {"began": Break.RESET if joined_late else kind, "cut": float(stamps[0]) > BEGIN_TICKS * (
                float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0)}
            ended = of_run is not None and of_run[-1, held.LAST] == held.ENDED
            counter.feed_run(stamps, kind, int(of_run[-1, held.TIME]) if ended else None)  # type: ignore[index]
        inside = mine[ROW] >= 0
        if not inside.any():
            continue
        stamps, log, sent, row = (mine[kind][inside] for kind in (STAMP, LOG, SENT, ROW))
        further = {name: column for columns, of_all in by_stamp
                   for name, column in _joined(columns, _of_run(of_all, number), stamps).items()}
        facts |= {name: column[row] for name, column in states.columns.items()}
        if number in rows:
            facts |= {"held": rows[number], "held_row": _rows_at(rows[number], stamps)}
        runs.append(_filled(JointStates(stamps, log, sent, run=number, index=index, further=further, **facts)))
        index += len(stamps)
    if names:
        counter.repeated = int(np.count_nonzero(~fresh))
        counter.messages += counter.repeated
    return _with_sources(runs, () if names else sources), differing, unplaced


def _by_stamp(heads: Positions) -> Positions:
    """Return heads sorted by run and stamp."""
    return heads.take(np.lexsort((heads[STAMP], heads[ORIGIN])), axis=1)


def _of_run(heads: Positions, number: int) -> Positions:
    """Return the part of heads that are sorted so which belongs to a run."""
    return heads[:, slice(*np.searchsorted(heads[ORIGIN], [number, number + 1]))]


def _numbered(states: StampedMessages, joined: Mapping[str, StampedMessages]
              ) -> tuple[StampedMessages, dict[str, StampedMessages], list[str]]:
    """Return messages that do not name their run in their order, with its number as origin, and the names of those that
    cannot be placed, which have -1.

    Messages of an identified publisher, with 1 as origin, are in the order of its sequence numbers, others, with 0, in
    that of the recording. A run begins where the stamp goes back, for other messages too, which belong to the states'
    runs as `_matched` says.
    """
    numbered, unplaced, of_states = dict[str, StampedMessages](), list[str](), list[int]()
    for name, messages in (("", states), *joined.items()):
        heads = messages.heads
        if (heads[ORIGIN] > 0).all():
            heads = heads.take(np.argsort(heads[NUMBER], kind="stable"), axis=1)
        stamps = heads[STAMP]
        back = np.diff(stamps, prepend=stamps[:1]) < 0
        last = stamps[np.append(np.flatnonzero(back), len(back))[:len(back)] - 1].tolist()
        of_states = of_states if name else last
        matched = _matched(last, of_states)
        unplaced += [name] if last and not matched else []
        origin = np.array(matched or [-1] * len(last), np.int64)[np.cumsum(back)]
        numbered[name] = StampedMessages(np.array([*heads[:ORIGIN], origin]), messages.columns)
    return numbered.pop(""), numbered, unplaced


def _matched(last: Sequence[int], of_states: Sequence[int]) -> list[int]:
    """Return the runs of states to which runs of other messages belong; none if their last stamps, ns, leave a choice.

    There are as many of both, or each one has no stamp behind the last state of its run.
    """
    if len(last) == len(of_states):
        return list(range(len(last)))

    def earliest(ends: Sequence[int], limits: Sequence[int]) -> list[int]:
        out, k = list[int](), 0
        for end in ends:
            while k < len(limits) and limits[k] < end:
                k += 1
            out.append(k)
            k += 1
        return out

    first = earliest(last, of_states)
    late = [len(of_states) - 1 - k for k in earliest(last[::-1], of_states[::-1])][::-1]
    return first if first == late else []


def placed(messages: Sequence[SceneRecord | InputSource], runs: Iterable[JointStates], names: Sequence[str] = (),
           from_begin: bool = True) -> list[tuple[int, int]]:
    """Return index (in the whole recording) of the first state to which an announcement applies, and its number.

    That state has the announced stamp or the next one, in the run that the announcement names (`names` are those of the
    runs) or, without names, in the first run in which it was sent after the announcement; the first one then applies
    from the begin on, as a scene does, with `from_begin`.
    """
    out = [(0, 0)] if from_begin and messages and not names else []
    for number, one in enumerate(messages[len(out):], len(out)):
        for states in runs:
            row = int(np.searchsorted(states.stamp_ns, min(one.first_stamp_ns, NEVER)))
            if row < len(states) and (one.run == names[states.run] if names else states.sent_ns[row] >= one.log_ns):
                out.append((states.index + row, number))
                break
    return sorted(out)


def _joined(columns: Mapping[str, Floats], heads: Positions, stamps: NDArray[np.int64]) -> dict[str, Floats]:
    """Return the columns of messages, sorted by stamp, at states of these stamps, (n,)."""
    heads = heads.compress(heads[ROW] >= 0, axis=1)
    out = {name: np.full(len(stamps), np.nan) for name in columns}
    if heads.size:
        nearest = np.searchsorted(heads[STAMP], stamps).clip(max=heads.shape[1] - 1)
        same = heads[STAMP][nearest] == stamps
        for name, values in columns.items():
            out[name][same] = values[heads[ROW][nearest[same]]]
    return out


def _count_differing(columns: Mapping[str, Floats], rows: Positions, fresh: NDArray[np.bool_]) -> int:
    """Return how many repeated messages differ from the one before them, by their rows in the columns."""
    again = np.flatnonzero(~fresh)
    one, other = rows[again], rows[again - 1]
    both = (one >= 0) & (other >= 0)
    wrong = np.zeros(int(np.count_nonzero(both)), np.bool_)
    for column in columns.values():
        a, b = column[one[both]], column[other[both]]
        wrong |= (a != b) & ~(np.isnan(a) & np.isnan(b))
    return int(np.count_nonzero(wrong))


def received_of(rows: Mapping[int, Floats], states: StampedMessages, name: str) -> int:
    """Return the number of commands of an input that the driveline received since its first state of each run; `rows`
    has the messages of `held` by the number of the run, the origin of the states.
    """
    total = 0.0
    for run, of_run in rows.items():
        first = int(states.heads[STAMP][states.heads[ORIGIN] == run].min(initial=NEVER))
        received = of_run[:, held.index_in_held(name, "received")]
        at = int(np.searchsorted(of_run[:, held.TIME], first, side="right")) - 1
        total += received[-1] - (received[max(at, 0)] if first > 0 else 0.0)
    return int(np.nan_to_num(total))


def _rows_at(rows: Floats, stamps: NDArray[np.int64]) -> Positions:
    """Return the message of `held` that holds at each state; -1 where a missing message may have changed it."""
    times, numbers = rows[:, held.TIME], rows[:, held.NUMBER]
    at = np.searchsorted(times, stamps, side="right") - 1
    followed = np.append(np.diff(numbers) == 1.0, False)
    since = stamps - times[np.maximum(at, 0)]
    sure = followed[at] | (since == 0) | ((at == len(rows) - 1) & (since <= BEAT + 1))
    return np.where((at >= 0) & sure, at, -1)


def _filled(states: JointStates) -> JointStates:
    """Return states with the begin of the far end's motion, and with values that only `held` states."""
    pressure, speed = states.input(_PRESSURE, "applied"), states.input(_FAR, "value")
    if np.isfinite(pressure).any() or "applied_pressure" in states.further:
        recorded = states.of("applied_pressure")
        filled = {"applied_pressure": np.where(np.isnan(recorded), pressure, recorded)}
        states = replace(states, further={**states.further, **filled})
    angle, output_speed = states.of("output_angle"), states.of("output_speed")
    if not np.isfinite(angle).any():
        return states
    moved, tick = int(np.isfinite(angle).argmax()), tick_of(states)
    absent = np.flatnonzero(np.isnan(angle[moved:])) + moved
    known = np.isin(states.input(_FAR, "source"), (held.COMMAND, held.FALLBACK, held.NOBODY))
    for k in absent.tolist():  # The far end moves at the speed of its tick, and stands still without one.
        if known[k] and abs(states.stamp_ns[k] - states.stamp_ns[k - 1] - tick) <= 1.0:
            output_speed[k] = 0.0 if np.isnan(speed[k]) else speed[k]
            angle[k] = angle[k - 1] + tick * 1e-9 * output_speed[k]
    return replace(states, moved_ns=int(states.stamp_ns[moved]))


def tick_of(states: JointStates) -> float:
    """Return the time of a tick by the messages of `held`, ns; 0 if they do not tell it."""
    if states.held is None or not len(states.held) or not states.held[-1, held.TICK] > 0.0:
        return 0.0
    return float(states.held[-1, held.TIME] / states.held[-1, held.TICK])


def _with_sources(runs: Sequence[JointStates], sources: Sequence[InputSource]) -> tuple[JointStates, ...]:
    """Return runs with the announced sources of their inputs as rows of `held`."""
    if not sources:
        return tuple(runs)
    rows = np.full((len(sources), held.SIZE), np.nan)
    for number, one in enumerate(sources):
        rows[number, held.TIME] = one.first_stamp_ns
        for name in HELD_INPUTS:
            rows[number, held.index_in_held(name, "source")] = (
                held.NOBODY if name not in INPUTS else held.COMMAND if name in one.commanded else held.FALLBACK)
    at = np.array([(0, -1), *placed(sources, runs, from_begin=False)])  # Unknown before the first.
    out = []
    for states in runs:
        last = np.searchsorted(at[:, 0], states.index + np.arange(len(states)), side="right") - 1
        out.append(replace(states, held=rows, held_row=at[last, 1]))
    return tuple(out)


def commands_held(runs: Iterable[JointStates]) -> dict[str, Commanded]:
    """Return the commands that acted, by topic, each at the first state that it acted on."""
    parts: dict[str, list[Commanded]] = {name: [] for name in HELD_INPUTS}
    for states in runs:
        if states.held is None or not len(states.held):
            continue
        rows, tick = states.held, tick_of(states)
        for name in HELD_INPUTS:
            source, value, stamp, since = (rows[:, held.index_in_held(name, field)]
                                           for field in ("source", "value", "stamp", "since"))
            acting = np.flatnonzero((source == held.COMMAND) & np.isfinite(since))
            _, first = np.unique(since[acting], return_index=True)
            acting = acting[first]
            begin = np.rint(since[acting] * tick).astype(np.int64)
            row = np.searchsorted(states.stamp_ns, begin)
            early = int(np.count_nonzero(begin <= states.stamp_ns[0]))  # The last of them holds at the first state.
            inside = (row < len(states)) & (np.arange(len(row)) >= early - 1)
            answers = np.where(np.isfinite(stamp[acting]), stamp[acting], -1.0).astype(np.int64)
            parts[name].append(Commanded((states.index + row)[inside], value[acting][inside], answers[inside]))
    return {name: Commanded(*map(np.concatenate, zip(*of))) for name, of in parts.items() if any(len(one.rows)
                                                                                            for one in of)}
