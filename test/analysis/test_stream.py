"""Cycles from batches equal cycles from whole arrays; gaps, resets, repeats and NaN are counted, and only a single lost
state is bridged.
"""

import math

import numpy as np
import pytest

from tcc_sim.analysis.stream import CycleStream
from tcc_sim.analysis.summary import cycles_of
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.trajectory import Trajectory

FREQUENCY = 150.0
CYCLE = 2.0 * math.pi / FREQUENCY
SYSTEM = replace(System(), {"engine.frequency": FREQUENCY})
STEP = 1_000_000


def recorded(ticks, ratio=0.5, faster=1):
    """A motion v = 5 + 20 sin(ratio omega t + 0.3) at 1 kHz, with torques for which (2a) holds with the plate at rest;
    `faster` makes everything faster.
    """
    stamps = np.asarray(ticks, dtype=np.int64) * STEP // faster
    t = stamps * 1e-9
    w = ratio * FREQUENCY * faster
    zero = np.zeros_like(t)
    torque = SYSTEM.driveline.flywheel_inertia * 20.0 * w * np.cos(w * t + 0.3)
    return stamps, 5.0 + 20.0 * np.sin(w * t + 0.3), zero, zero, torque, zero


def fed(columns, sizes, system=SYSTEM):
    stream = CycleStream(system)
    pieces, start = [], 0
    while start < len(columns[0]):
        size = next(sizes)
        pieces += stream.feed(*(c[start:start + size] for c in columns))
        start += size
    return stream, pieces


def sizes_like(kind):
    rng = np.random.default_rng(5)
    while True:
        yield {"ones": 1, "large": 100_000}.get(kind) or int(rng.integers(1, 200))


@pytest.mark.parametrize("faster", [1, 500])
@pytest.mark.parametrize("kind", ["ones", "random", "large"])
def test_batches_give_what_whole_arrays_give(kind, faster):
    system = replace(SYSTEM, {"engine.frequency": FREQUENCY * faster})
    columns = recorded(np.arange(1000), faster=faster)
    stamps, v, angle, speed, engine, friction = columns
    whole = cycles_of(Trajectory(stamps * 1e-9, v, angle, speed, engine, friction, friction, np.zeros(1000, np.int8),
                                 CYCLE / faster, "recording", system))
    stream, pieces = fed(columns, sizes_like(kind), system)
    cycles, first, dropped = stream.runs[0].kept(0)[:3]
    assert (len(cycles), first, dropped, len(stream.runs)) == (len(whole), 0, 0, 1)
    assert sum(len(p.cycles) for p in pieces) == len(whole) == 23
    for name in ("section", "highest", "lowest", "stick_time"):
        np.testing.assert_allclose(getattr(cycles, name), getattr(whole, name), rtol=1e-12, atol=1e-12)


def test_the_summary_knows_the_motion():
    stream, _ = fed(recorded(np.arange(6000)), sizes_like("random"))
    summary = stream.summary(7)
    assert summary.max_slip_speed == pytest.approx(25.0, abs=1e-4)
    assert summary.min_slip_speed == pytest.approx(-15.0, abs=1e-4)
    assert summary.period == 2
    assert [p[1] for p in summary.section] == pytest.approx([5.0 + 20.0 * math.sin(0.3), 5.0 - 20.0 * math.sin(0.3)],
                                                            abs=1e-4)
    assert (summary.cycles, summary.discarded, summary.regime) == (143, 7, "slip")


def test_memory_is_that_of_a_cycle():
    stream, _ = fed(recorded(np.arange(4000)), sizes_like("random"))
    assert sum(part.shape[1] for part in stream._waiting) <= math.ceil(CYCLE * 1e9 / STEP) + 1


def test_a_gap_costs_the_cycles_that_it_touches():
    ticks = np.concatenate([np.arange(0, 2000), np.arange(2100, 4000), np.arange(4001, 8000)])
    stream, _ = fed(recorded(ticks), sizes_like("random"))
    c = stream.continuity
    assert (c.gaps, c.lost, c.runs, c.messages, c.uneven) == (2, 101, 1, len(ticks), 0)
    count = int(7.999 / CYCLE)
    whole = {n for n in range(count) if n * CYCLE >= 2.1 or (n + 1) * CYCLE <= 1.999}
    assert {n for p in stream.runs[0].pieces for n in range(p.first, p.first + len(p.cycles))} == whole
    summary = stream.summary(10)
    assert summary.max_slip_speed == pytest.approx(25.0, abs=1e-4)
    assert summary.period == 2
    assert summary.section[0][1] == pytest.approx(5.0 + 20.0 * math.sin(0.3), abs=1e-4)
    assert (summary.cycles, summary.broken) == (count, count - len(whole))
    assert summary.covers == pytest.approx((10 * CYCLE, 7.999))
    assert (summary.lost_seconds, summary.seconds) == pytest.approx((0.103, 7.999 - 10 * CYCLE - 0.103))


def test_discard_counts_cycles_and_not_those_that_are_left():
    ticks = np.concatenate([np.arange(0, 500), np.arange(1500, 4000)])
    stream, _ = fed(recorded(ticks), sizes_like("random"))
    cycles, first, dropped = stream.runs[0].kept(40)[:3]
    assert first == 40
    assert dropped == 40
    assert np.isfinite(cycles.highest).all()
    with pytest.raises(InputError, match="--discard 95 leaves none of the 95 cycles"):
        stream.summary(95)
    with pytest.raises(InputError, match="0 or more"):
        stream.summary(-1)


def test_a_reset_starts_a_new_run_and_the_longest_counts():
    ticks = np.concatenate([np.arange(0, 1000), np.arange(0, 5000), np.arange(0, 800)])
    stream, pieces = fed(recorded(ticks), sizes_like("random"))
    assert stream.continuity.runs == 3
    assert stream.continuity.gaps == 0
    assert stream.longest()[0] == 1
    assert stream.summary(50).cycles == int(4.999 / CYCLE)
    assert {p.run for p in pieces} == {0, 1, 2}


def test_a_pause_repeats_stamps_and_is_not_a_gap():
    ticks = np.concatenate([np.arange(0, 1000), np.full(300, 999), np.arange(1000, 3000)])
    stream, _ = fed(recorded(ticks), sizes_like("random"))
    assert (stream.continuity.gaps, stream.continuity.repeated, stream.continuity.runs) == (0, 300, 1)
    assert stream.summary(0).cycles == int(2.999 / CYCLE)


def test_samples_that_are_not_finite_are_left_out_and_counted():
    columns = [c.copy() for c in recorded(np.arange(6000))]
    columns[1][3000] = math.nan
    columns[4][3500:3510] = math.inf
    stream, _ = fed(columns, sizes_like("random"))
    assert stream.not_finite == 11
    assert stream.continuity.lost == 11
    assert math.isfinite(stream.summary(0).max_slip_speed)
    assert stream.summary(0).period == 2


def test_a_wild_stamp_neither_fills_memory_nor_hangs():
    ticks = np.arange(6000)
    stamps, *others = recorded(ticks)
    stamps = stamps.copy()
    stamps[2000] = 1 << 61
    stream, _ = fed((stamps, *others), sizes_like("random"))
    assert stream.continuity.runs == 2
    assert stream.summary(0).cycles == int(5.999 / CYCLE) - math.ceil(2.001 / CYCLE)


def test_a_recording_without_a_whole_cycle_is_refused():
    stream, _ = fed(recorded(np.arange(20)), sizes_like("random"))
    with pytest.raises(InputError, match="no whole period of excitation"):
        stream.summary()
    with pytest.raises(InputError, match="no samples"):
        CycleStream(SYSTEM).summary()


@pytest.mark.parametrize("first", [0, 100])
def test_stamps_that_are_farther_apart_than_a_cycle_are_refused(first):
    stream = CycleStream(SYSTEM)
    with pytest.raises(InputError, match="at least one for each cycle"):  # noqa: PT012
        for k in range(5):
            stamps, *others = recorded([(first + k) * 1000])
            stream.feed(stamps, *others)
