"""Gaps, runs and the tick of stamps: counts against a stream made by hand, in batches of any size."""

import random

import numpy as np
import pytest
from driveline_bags import TICK

from tcc_sim.recording.stamps import Break, StampCounter


def fed(values, sizes=(10**6,), publisher=None):
    """A counter after these stamps, in batches of these sizes in turn, and the begins of pieces with their kind."""
    values, counter, begins, start, k = np.asarray(values, np.int64), StampCounter(), [], 0, 0
    while start < len(values):
        end = start + sizes[k % len(sizes)]
        who = 0 if publisher is None else np.asarray(publisher)[start:end]
        begins += [(start + piece.start, kind) for piece, kind in counter.pieces(values[start:end], who)
                   if kind is not Break.NOTHING]
        start, k = end, k + 1
    return counter, begins


def stream(draw):
    """Stamps of some runs with losses and repeats, and what a counter must find in them."""
    values, begins, lost, gaps, repeated = [], [], 0, 0, 0
    tick = draw.choice([10, 25, 1_000_000])
    for run in range(draw.randrange(1, 5)):
        at = 0
        begins.append((len(values), Break.RESET if run else Break.START))
        values += [0, tick, 2 * tick, 3 * tick, 4 * tick]
        at = 4 * tick
        for _ in range(draw.randrange(60, 200)):
            step = draw.choice([0] + [1] * 20 + [draw.randrange(2, 30)])
            repeated += step == 0
            if step > 1:
                lost, gaps = lost + step - 1, gaps + 1
                begins.append((len(values), Break.GAP))
            at += step * tick
            values.append(at)
    return values, begins, tick, (lost, gaps, repeated)


@pytest.mark.parametrize("seed", range(12))
def test_gaps_and_runs_of_a_stream_are_counted_whatever_its_batches(seed):
    draw = random.Random(seed)
    values, begins, tick, counts = stream(draw)
    for sizes in ((10**6,), [draw.randrange(5, 60) for _ in range(9)]):
        counter, found = fed(values, sizes)
        assert (counter.lost, counter.gaps, counter.repeated) == counts
        assert (counter.tick, counter.uneven, counter.messages) == (tick, 0, len(values))
        assert counter.runs == sum(kind is not Break.GAP for _, kind in begins) == counter.resets + 1
        assert counter.restarts == 0
        assert found == begins


@pytest.mark.parametrize(("values", "gaps", "lost", "uneven"), [
    ([*range(0, 200, 10), 205], 0, 0, 1), ([*range(0, 200, 10), 206], 1, 1, 0),
    ([0, *range(100 * 10**6, 150 * 10**6, 10**6), 149 * 10**6 + 200_000], 1, 99, 1),
    # Steps that jitter: a gap is half longer than the step before it too.
    (np.cumsum([0, *range(951, 1051), 1500, 1700, 2600]), 1, 2, 81)])
def test_a_gap_begins_beyond_one_and_a_half_ticks(values, gaps, lost, uneven):
    counter, _ = fed(values)
    assert (counter.gaps, counter.lost, counter.uneven) == (gaps, lost, uneven)


@pytest.mark.parametrize(("values", "who", "begins", "messages"), [
    ([*range(100), *range(150, 300), *range(50)], [1] * 100 + [2] * 200,
     [(0, Break.START), (100, Break.RESTART), (250, Break.RESET)], 300),
    ([*range(50), 0, 50, 1, 51, 2, 52, *range(3, 90)], [1] * 50 + [2, 1, 2, 1, 2, 1] + [2] * 87,
     [(0, Break.START), (50, Break.RESTART)], 140)])
def test_another_publisher_is_a_restart_and_the_former_one_is_left_out(values, who, begins, messages):
    counter, found = fed(values, publisher=who)
    assert (found, counter.messages, counter.lost, counter.restarts) == (begins, messages, 0, 1)


@pytest.mark.parametrize("block", [1, 7])
def test_two_publishers_by_turns_with_nothing_to_tell_them_apart_are_found(block):
    one, other = (np.arange(start, start + 700).reshape(-1, block) for start in (5000, 200))
    assert fed(np.stack([one, other], axis=1).ravel(), (100,))[0].mixed
    # A reset with losses whose stamps later pass those of the run before is no mixture.
    assert not fed([*range(100), *range(95), *range(101, 300)])[0].mixed


def test_extreme_stamps_do_not_overflow():
    counter, _ = fed([-(1 << 61), 1 << 61, -(1 << 61), 0, 1 << 61], (1, 2))
    assert (counter.runs, counter.messages) == (2, 5)


@pytest.mark.parametrize("spread", [0.1, 0.4])
def test_stamps_that_jitter_are_no_losses(spread):
    random = np.random.default_rng(6)
    stamps = (np.arange(5000) * TICK + random.uniform(-spread, spread, 5000) * TICK).astype(np.int64)
    counter = StampCounter()
    for start in range(0, 5000, 700):
        counter.pieces(stamps[start:start + 700])
    assert (counter.lost, counter.gaps, counter.runs) == (0, 0, 1)
    assert counter.tick == pytest.approx(TICK, rel=0.05)
    lossy = StampCounter()
    lossy.pieces(np.delete(stamps, slice(2000, 2030)))
    assert (lossy.gaps, lossy.lost) == (1, 30)


@pytest.mark.parametrize(("first", "last"), [(60.0, 200.0), (600.0, 60.0), (60.0, 600.0)])
@pytest.mark.parametrize("batch", [500, 3600, 10**6])
def test_so_many_samples_to_a_cycle_of_a_run_up_leave_no_gap(first: float, last: float, batch: int) -> None:
    """Distances of stamps grow or shrink steadily, cycle by cycle; an omitted stamp is still a gap."""
    t = np.linspace(0.0, 4.0, 400_001)
    phase = first * t + 0.5 * (last - first) / 4.0 * t**2
    starts = np.interp(2.0 * np.pi * np.arange(int(phase[-1] / (2.0 * np.pi)) + 1), phase, t)
    stamps = np.round(1e9 * np.interp(np.arange(200 * (len(starts) - 1) + 1) / 200.0, np.arange(len(starts)), starts))
    whole, lossy, missing = StampCounter(), StampCounter(), np.delete(stamps.astype(np.int64), slice(9000, 9010))
    for k in range(0, len(stamps), batch):
        whole.pieces(stamps[k:k + batch].astype(np.int64))
        lossy.pieces(missing[k:k + batch])
    assert (whole.gaps, whole.lost) == (0, 0)
    assert lossy.gaps == 1
