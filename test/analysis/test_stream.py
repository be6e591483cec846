"""Cycles from batches equal cycles from whole arrays; gaps, resets, repeats and NaN are counted, and only a single lost
state is bridged.
"""

import math

import numpy as np
import pytest

from tcc_sim.analysis.measured.engine_clock import Scheduled, Tracked
from tcc_sim.analysis.measured.stream import CycleStream
from tcc_sim.analysis.steady.summary import cycles_of
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


@pytest.mark.parametrize(("kind", "faster"), [("ones", 1), ("random", 500), ("large", 1)])
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
    assert kind != "large" or len(pieces) == 1
    for name in ("section", "highest", "lowest", "stick_time"):
        np.testing.assert_allclose(getattr(cycles, name), getattr(whole, name), rtol=1e-12, atol=1e-12)


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


TENTH = replace(System(), {"engine.frequency": 20.0 * math.pi})
"""A system with an engine cycle of 0.1 s."""


def rising(ticks, rate=10.0):
    """Slip of 10 rad/s that rises by 10 rad/s a second at 1 kHz; 300 N m hold the plate at rest."""
    stamps = np.asarray(ticks, dtype=np.int64) * STEP
    t, one = stamps * 1e-9, np.ones(len(stamps))
    return (stamps, 10.0 + rate * t, 0.1 * one, 0.0 * one, (300.0 + 0.2 * rate) * one, 300.0 * one)


def heat(begin, end):
    return 300.0 * (10.0 * (end - begin) + 5.0 * (end**2 - begin**2))


GAPS = np.concatenate([np.arange(0, 333), np.arange(378, 512), np.arange(513, 1050)])


@pytest.mark.parametrize(("discard", "begin", "broken", "lost"), [
    (0, 0.0, 1, 0.048), (2, 0.2, 1, 0.048), (3, 0.3, 1, 0.048), (4, 0.4, 0, 0.002), (6, 0.6, 0, 0.0)])
@pytest.mark.parametrize("sizes", ["random", "large"])
def test_figures_of_a_recording_cover_what_was_observed(discard, begin, broken, lost, sizes):
    """States are missing from 0.332 to 0.378 s, and a single one at 0.512 s, which breaks no cycle."""
    stream, _ = fed(rising(GAPS), sizes_like(sizes), TENTH)
    summary = stream.summary(discard)
    assert (summary.cycles, summary.discarded, summary.broken) == (10, discard, broken)
    assert summary.covers == pytest.approx((begin, 1.049))
    assert (summary.lost_seconds, summary.seconds) == pytest.approx((lost, 1.049 - begin - lost), abs=1e-12)
    energy = heat(begin, 1.049) - (heat(0.332, 0.378) if lost > 0.04 else 0.0) - (heat(0.511, 0.513) if lost else 0.0)
    assert summary.clutch_energy == pytest.approx(energy)
    assert summary.mean_power == pytest.approx(energy / summary.seconds)
    assert (summary.max_slip_speed, summary.min_slip_speed) == pytest.approx((20.49, 10.0 + 10.0 * begin))
    assert summary.peak_power == pytest.approx(300.0 * 20.49)
    assert (summary.max_shaft_torque, summary.min_shaft_torque) == pytest.approx((300.0, 300.0))
    assert (summary.stick_fraction, summary.breakaways, summary.runaway) == (0.0, 0, discard > 2)
    kept = stream.runs[0].kept(discard)
    first = 4 if discard == 3 else discard   # No cycle stands for a gap at the start.
    assert (kept.first, np.isnan(kept.cycles.highest).tolist()) == (first, [k == 3 for k in range(first, 10)])


def test_numbers_of_a_gap_of_several_cycles_are_those_of_the_last():
    """Cycles 3 to 5 of ten: one cycle of NaN in their place, so that the last has number 9."""
    ticks = np.concatenate([np.arange(0, 333), np.arange(560, 1001)])
    stream, pieces = fed(rising(ticks), sizes_like("ones"), TENTH)
    assert [(each.first, len(each.cycles)) for each in pieces] == [(k, 1) for k in (0, 1, 2, 6, 7, 8, 9)]
    kept = stream.runs[0].kept(1)
    assert (kept.first, len(kept.cycles), kept.dropped, kept.broken) == (3, 7, 1, 3)
    assert kept.cycles.starts is not None
    for discard in (4, 5):
        assert stream.runs[0].kept(discard)[1:4] == (6, discard, 6 - discard)
        assert stream.summary(discard).covers == pytest.approx((0.1 * discard, 1.0))


def test_a_recording_without_a_whole_cycle_is_refused():
    stream, _ = fed(rising(np.arange(100)), sizes_like("random"), TENTH)
    gaps, _ = fed(rising(np.concatenate([np.arange(0, 333), np.arange(378, 390)])), sizes_like("random"), TENTH)
    empty = CycleStream(TENTH)
    missing = CycleStream(TENTH)
    stamps, *others = rising(np.arange(3))
    missing.feed(stamps, *(math.nan * column for column in others))
    known = CycleStream(TENTH, Tracked(0.1, {0: (np.array([4, 5]), np.array([0.1, 0.2]))}))
    known.feed(*rising(np.arange(250)))
    for refused, discard, sentence in (
            (stream, None, "no whole period .* 0 to 0.099 s"), (gaps, 3, "--discard 3 .* 3 cycles"),
            (empty, None, "no samples"), (known, 1, "--discard 1 .* only cycle"),
            (missing, None, "no samples: .* 3 states .* finite")):
        with pytest.raises(InputError, match=sentence):
            refused.summary(discard)
    hidden, _ = fed(rising(np.concatenate([np.arange(0, 230), np.arange(280, 420)])), sizes_like("random"), TENTH)
    assert hidden.summary(1).cycles == 4
    hidden, _ = fed(rising(np.concatenate([np.arange(0, 230), np.arange(280, 330), np.arange(360, 401)])),
                    sizes_like("random"), TENTH)
    with pytest.raises(InputError, match=r"gaps .* first 2"):
        hidden.summary(2)


def test_of_runs_with_as_many_cycles_the_last_is_the_longest():
    stream, _ = fed(rising(np.concatenate([np.arange(0, 301), np.arange(0, 310), np.arange(0, 220)])),
                    sizes_like("random"), TENTH)
    assert (stream.longest()[0], len(stream.runs), stream.numbers) == (1, 3, {0: 2})
    assert [run.observed() for run in stream.runs] == [3, 3, 2]
    assert stream.summary(0).max_slip_speed == pytest.approx(13.09)
    assert stream.summary(0, 0).max_slip_speed == pytest.approx(13.0)
    assert stream.summary(0, 2).covers == pytest.approx((0.0, 0.219))


def test_slices_of_time_have_extremes_and_no_period():
    stream = CycleStream(TENTH, Scheduled(0.1, identified=False))
    stream.feed(*rising(np.arange(3050), 0.0))
    summary = stream.summary(7)
    assert (summary.period, summary.settled, summary.cycles, summary.broken, summary.discarded) == (0, False, 0, 0, 0)
    assert (summary.section, summary.section_states, summary.longest_period) == ([], [], 0)
    assert math.isnan(summary.section_change)
    assert (summary.max_slip_speed, summary.covers) == (pytest.approx(10.0), pytest.approx((0.0, 3.049)))


def test_lengths_of_tracked_cycles_show_where_the_excitation_settles():
    """Cycles of 0.11 s, then of 0.1 s: a motion of constant slip has its period in the latter alone."""
    lengths = np.array([0.11] * 3 + [0.1006] + [0.1004] * 2 + [0.1] * 17)
    starts = np.append(0.0, np.cumsum(lengths))
    stream = CycleStream(TENTH, Tracked(0.1, {0: (np.arange(24), starts)}))
    stream.feed(*rising(np.arange(math.floor(starts[-1] * 1e3) + 2), 0.0))
    assert (stream.summary(0).period, stream.summary(0).longest_period) == (1, 6)
    assert stream.summary(2).covers[0] == pytest.approx(0.22)


@pytest.mark.parametrize("first", [0, 100])
def test_stamps_that_are_farther_apart_than_a_cycle_are_refused(first):
    stream = CycleStream(SYSTEM)
    with pytest.raises(InputError, match="at least one for each cycle"):  # noqa: PT012
        for k in range(5):
            stamps, *others = recorded([(first + k) * 1000])
            stream.feed(stamps, *others)


def test_a_part_before_cycle_0_is_no_cycle():
    """The first known start is that of number 0, which follows PART, the number of a part, by one."""
    starts = 0.0123 + CYCLE * np.arange(9)
    clock = Tracked(CYCLE, {0: (np.arange(9), starts)})
    stream, pieces = CycleStream(SYSTEM, clock), []
    for rows in np.split(np.array(recorded(np.arange(300))), 3, axis=1):
        pieces += stream.feed(rows[0].astype(np.int64), *rows[1:])
    run = stream.runs[0]
    kept = run.kept(0)
    assert (kept.first, len(kept.cycles)) == (0, 6)
    assert sum(len(p.cycles) for p in pieces) == 6
    assert [part[:2] for part in run.parts] == [pytest.approx((0.0, 0.0123))]
    assert kept.cycles.starts == pytest.approx(starts[:7])
