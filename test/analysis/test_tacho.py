"""Edges, missing and extra pulses, wheels with missing teeth and smoothed edges, on signals of a few pulses."""

import numpy as np
import pytest

from tcc_sim.analysis.tacho import edges_in, pulses_of
from tcc_sim.errors import InputError


def test_edges_lie_at_the_middle_of_the_signals_range():
    """Straight flanks of 10 samples, from the samples of which single spikes stand out."""
    t = 0.01 * np.arange(400)
    signal = 7.0 + 2.0 * np.abs((t + 0.05) % 0.2 - 0.1) / 0.1
    expected = 0.1 + 0.2 * np.arange(20)
    assert edges_in(t, signal) == pytest.approx(expected)
    signal[[33, 250]] = 40.0, -30.0
    assert edges_in(t, signal)[[0, 5, 19]] == pytest.approx(expected[[0, 5, 19]], abs=2e-3)
    assert edges_in(t, np.full(400, 3.0)).size == 0


@pytest.mark.parametrize("way", [lambda t: 2.0 * t, lambda t: 3.0 * np.sin(0.4 * t)])
def test_edges_follow_an_offset_that_drifts_by_more_than_the_signal(way):
    t = 0.01 * np.arange(4000)
    edges = edges_in(t, np.sin(2.0 * np.pi * t / 0.4) + way(t))
    near = edges[(edges > 5.0) & (edges < 35.0)]
    assert np.abs(near / 0.4 - np.rint(near / 0.4)).max() < 0.05
    assert np.diff(near) == pytest.approx(0.4, abs=0.03)


T = 0.005 * np.arange(4001)
"""Times of 20 s, s."""


def rotating(*changes, rate=2.0):
    """Pulses at `rate` a second, of a half, with values in stretches (begin, end, value) of turns."""
    signal = 5.0 * ((rate * T) % 1.0 < 0.5)
    for begin, end, value in changes:
        signal[(rate * T >= begin) & (rate * T < end)] = value
    return signal


@pytest.mark.parametrize(("changes", "notes", "holes"), [
    ([], [], []),
    ([(20.0, 21.0, 0.0)], ["1 missing pulse of the tacho inserted, after 9.4975 s"], []),
    ([(20.0, 21.0, 0.0), (30.0, 31.0, 0.0)], ["2 missing pulses of the tacho inserted, after 9.4975 s, 14.4975 s"], []),
    ([(20.7, 20.8, 5.0)], ["1 extra pulse of the tacho left out, at 10.3475 s"], []),
    ([(20.0, 23.0, 0.0)], ["the tacho has no plausible pulses from 9.4975 to 11.4975 s"], [(9.4975, 11.4975)])])
def test_teeth_are_counted_and_mended(changes, notes, holes):
    """An edge lies half a sample before the first high one; the first pulse begins before the first sample."""
    pulses = pulses_of(T, rotating(*changes), 3, "t.csv")
    assert pulses.notes == notes
    assert pulses.holes.tolist() == [pytest.approx(hole) for hole in holes]
    assert pulses.per_revolution == 3
    at = np.interp(np.arange(pulses.counts[-1] + 1.0), pulses.counts, pulses.times)
    inside = np.ones(len(at), dtype=bool)
    for begin, end in holes:
        inside[(at > begin + 1e-6) & (at < end - 1e-6)] = False
    assert at[inside] == pytest.approx((0.4975 + 0.5 * np.arange(len(at)))[inside], abs=1e-6)
    assert len(at) == 40
    assert (np.diff(pulses.times) > 0.0).all()
    assert len(pulses.counts) == len(np.unique(pulses.counts)) > 7 * 36


@pytest.mark.parametrize(("signal", "sentence"), [
    (np.zeros(4001), "t.csv: the column tacho has 0 rising edges between 0 and 0; it must have 2 or more"),
    (rotating(*((k, k + 1.0, 0.0) for k in (5, 11, 19, 28))),
     "t.csv: 4 of 35 intervals between the pulses of the tacho differ from their neighbours as if pulses were missing "
     "or extra; the phase is not known")])
def test_a_tacho_without_a_phase_is_refused(signal, sentence):
    with pytest.raises(InputError) as refusal:
        pulses_of(T, signal, 1, "t.csv")
    assert str(refusal.value) == sentence


def test_the_jitter_of_edges_is_smoothed_and_named():
    jitter = 0.02 * np.random.default_rng(1).normal(size=60)
    edges = 0.3 * np.arange(60) + 0.3 * jitter
    signal = np.interp(T[:3500], np.sort([*(edges - 0.05), *(edges + 0.05)]), np.tile([-1.0, 1.0], 60))
    turns = np.searchsorted(edges + 0.15, T[:3500])
    signal = np.clip((T[:3500] - edges[np.minimum(turns, 59)]) / 0.05, -1.0, 1.0) * np.where(turns < 60, 1.0, -1.0)
    pulses = pulses_of(T[:3500], signal, 1, "t.csv")
    (note,) = pulses.notes
    assert note.startswith("edges of the tacho jitter by ")
    assert note.endswith(" % of their distance (rms); they were smoothed")
    assert float(note.split()[6]) == pytest.approx(2.0, rel=0.25)
    found = np.interp(np.arange(57.0), pulses.counts, pulses.times)
    assert np.std(found - 0.3 * np.arange(57.0)) < 0.3 * np.std(0.3 * jitter[:57])
