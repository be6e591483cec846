"""Times of rows made by hand: usual steps, holes, jitter, and rows out of order or with repeated times."""

import re

import numpy as np
import pytest
from scipy.stats import linregress

from tcc_sim.errors import InputError
from tcc_sim.tables.measured_table import MeasuredTable, looks_smooth
from tcc_sim.tables.sampling import holes_in, jitter_of, merged, rows_in_order, usual_steps


def rows_after(*steps):
    """Times from 10 s on with these steps, s; (step, n) repeats a step."""
    return 10.0 + np.cumsum([0.0, *(step for step, n in steps for _ in range(n))])


@pytest.mark.parametrize(("steps", "usual"), [
    ([(0.5, 15)], [0.5] * 15), ([(0.5, 14)], None),
    ([(1.0, 16), (3.0, 4)], [1.0] * 20), ([(1.0, 15), (3.0, 5)], None),  # Four in five are regular.
    ([(1.0, 15), (1.5, 5)], [1.0] * 20), ([(1.0, 15), (1.75, 5)], None), ([(1.0, 15), (0.5, 5)], [1.0] * 20),
    ([(1.0, 64), (1.25, 63)], [1.0] * 127), ([(1.0, 64), (1.25, 64)], [1.0] * 64 + [1.25] * 64),
    ([(1.0, 96), (1.25, 95)], [1.0] * 96 + [1.25] * 95),
    ([(1.0, 64), (1.25, 64), (1.5, 64)], [1.0] * 64 + [1.25] * 64 + [1.5] * 64),
    ([(1.0, 128), (1.25, 64), (1.0, 64)], [1.0] * 256),  # One block among others is a hole or a burst.
    ([(1.25, 64), (1.0, 128)], [1.25] * 64 + [1.0] * 128)])
def test_the_usual_step_is_the_median_of_a_block_or_of_three(steps, usual):
    result = usual_steps(rows_after(*steps))
    assert (result if result is None else result.tolist()) == usual


@pytest.mark.parametrize(("steps", "holes"), [
    ([], []), ([(1.0, 1)], []), ([(1.0, 2), (6.0, 1)], []), ([(1.0, 2), (6.25, 1)], [[12.0, 18.25]]),
    ([(1.0, 20), (1.5, 1)], []), ([(1.0, 20), (1.75, 1), (1.0, 2), (4.0, 1)], [[30.0, 31.75], [33.75, 37.75]]),
    ([(1.0, 16), (1.25, 4), (1.875, 1)], []), ([(1.0, 16), (1.25, 4), (2.0, 1)], [[31.0, 33.0]]),
    ([(1.0, 40), (3.0, 10)], []), ([(1.0, 41), (3.0, 9), (3.25, 1)], [[78.0, 81.25]])])
def test_a_hole_is_longer_than_the_usual_step_allows(steps, holes):
    t = rows_after(*steps)
    assert holes_in(t).tolist() == holes


def test_jitter_is_the_95_percent_quantile_of_deviations():
    steps = np.full(101, 1.0)
    steps[:10] = [0.9, 1.1, 0.8, 1.2, 1.3, 0.7, 1.4, 0.6, 1.45, 0.55]
    t = np.concatenate([[0.0], np.cumsum(steps)])
    assert jitter_of(t) == pytest.approx(sorted(np.abs(steps - 1.0))[95])
    assert (jitter_of(t[:15]), jitter_of(np.arange(20.0))) == (0.0, 0.0)


@pytest.mark.parametrize(("spans", "joined"), [
    ([], []), ([[1, 2]], [[1, 2]]), ([[1, 2], [3, 4]], [[1, 2], [3, 4]]), ([[3, 4], [1, 2]], [[1, 2], [3, 4]]),
    ([[1, 2], [2, 3]], [[1, 3]]), ([[1, 9], [2, 3], [4, 12], [13, 14]], [[1, 12], [13, 14]]),
    ([[5, 6], [1, 7]], [[1, 7]])])
def test_stretches_that_touch_are_joined(spans, joined):
    assert merged(np.array(spans, dtype=float).reshape(-1, 2)).tolist() == joined


EVEN = np.arange(20.0)
STAIRS = np.floor(np.arange(40) / 4.0)
HUNDRED = np.arange(100.0)


def at(values, changes):
    """Values with some of them changed."""
    return np.array([changes.get(k, x) for k, x in enumerate(values)])


LINE = linregress(np.arange(40), at(STAIRS, {0: -1.3}))


@pytest.mark.parametrize(("t", "same", "rows", "times", "said"), [
    ([], [], [], [], []), ([3.0], [], [0], [3.0], []), (EVEN, [5], range(20), EVEN, []),
    ([0.0, 2.0, 1.0, 3.0], [], [0, 2, 1, 3], [0.0, 1.0, 2.0, 3.0], ["1 row came before"]),
    ([3.0, 2.0, 1.0, 0.0], [], [3, 2, 1, 0], [0.0, 1.0, 2.0, 3.0], ["3 rows came before"]),
    # Values of the row before count only where that row is still the one before.
    ([0.0, 1.0, 1.0, 2.0], [2], [0, 1, 3], [0.0, 1.0, 2.0], ["1 row repeated time and values"]),
    ([1.0, 1.0, 2.0, 0.0], [1], [3, 0, 2], [0.0, 1.0, 2.0], ["1 row came before", "1 row repeated time and values"]),
    ([0.0, 0.0, 0.0, 1.0], [1, 2], [0, 3], [0.0, 1.0], ["2 rows repeated time and values"]),
    ([0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0], [], range(4), [0.0, 1.0, 2.0, 3.0], ["1 time.*row 4.*2 runs.*rows 1 to 4,"]),
    ([0.0, 1.0, 0.5, 1.5, 2.5, 0.5], [], range(2, 5), [0.5, 1.5, 2.5], ["2 times.*row 2.*3 runs.*rows 3 to 5,"]),
    # Interleaved closely without one equal time: two runs too, if few cuts.
    ([*EVEN, *(EVEN[:-1] + 0.1)], [], range(20), EVEN, ["1 time.*row 20.*2 runs.*rows 1 to 20,"]),
    ([*EVEN, *(EVEN[:-1] + 0.4)], [], [*[k for pair in zip(range(20), range(20, 39)) for k in pair], 19],
     np.sort([*EVEN, *(EVEN[:-1] + 0.4)]), ["1 row came before"]),
    (at(HUNDRED, {50: 49.0}), [], range(100), at(HUNDRED, {50: 50.0}), ["1 row repeated the time"]),
    (at(HUNDRED, {50: 49.0, 51: 51.5}), [], range(100), at(HUNDRED, {50: 50.25, 51: 51.5}), ["1 row repeated"]),
    (at(HUNDRED, {99: 98.0}), [], range(100), at(HUNDRED, {99: 99.0}), ["1 row repeated the time"]),
    # Lines by least squares: slopes 1 - 0.5/665 and 33/133.25, from the first time on, or with an offset.
    (at(EVEN, {10: 9.0}), [], range(20), (1.0 - 0.5 / 665.0) * EVEN, ["1 of 20 rows.*0.999248 s"]),
    (STAIRS, [], range(40), 33.0 / 133.25 * np.arange(40), ["30 of 40 rows.*0.247655 s"]),
    (at(STAIRS, {0: -1.3}), [], range(40), LINE.intercept + LINE.slope * np.arange(40), ["29 of 40 rows.*0.252411 s"])])
def test_rows_are_put_in_order_or_left_out(t, same, rows, times, said):
    flags = np.isin(np.arange(len(t)), same)
    used, at, sentences = rows_in_order(np.array(t, dtype=float), flags, "t")
    assert used.tolist() == [*rows]
    assert len(sentences) == len(said)
    assert all(re.search(word, each) for word, each in zip(said, sentences))
    assert at == pytest.approx(np.array(times), abs=1e-12)


@pytest.mark.parametrize(("t", "why"), [
    (np.arange(153) % 3, "50 times"), (np.square(np.arange(30) // 3), "20 of 30"), ([0.0] * 5, "4 of 5"),
    (at(HUNDRED, {50: 49.0, 51: 51.75}), "row 51 .*49 s.*2.75 s"),
    (at(HUNDRED, {50: 49.0, 51: 50.25}), "row 51 .*49 s.*1.25 s"),
    (at(np.arange(200.0), {100: 99.0, 101: 99.0}), "row 101 .*99 s.*0 s")])
def test_rows_without_an_order_are_refused(t, why):
    with pytest.raises(InputError, match=f"^here: .*{why}"):
        rows_in_order(np.array(t, dtype=float), np.zeros(len(t), np.bool_), "here")


def test_fifty_runs_are_the_most():
    rows, _, said = rows_in_order(np.arange(150.0) % 3, np.zeros(150, np.bool_), "t")
    assert rows.tolist() == [0, 1, 2]
    assert "50 runs" in said[0]


NAN = np.nan


@pytest.mark.parametrize(("t", "column", "holes", "step"), [
    (EVEN, EVEN, [], 1.0), (rows_after((1.0, 20), (5.0, 1)), np.zeros(22), [[30.0, 35.0]], 1.0),
    (EVEN, at(EVEN, {7: NAN}), [[6, 8]], 1.0),                              # A step of 2 among steps of 1.
    (EVEN, at(EVEN, {0: NAN}), [], 1.0), (EVEN, at(EVEN, {0: NAN, 1: NAN}), [[0, 2]], 1.0),
    (EVEN, at(EVEN, {19: NAN, 18: NAN, 17: NAN}), [[16, 19]], 1.0), (EVEN, np.full(20, NAN), [[0, 19]], 0.0),
    (np.arange(40.0), np.where(np.arange(40) % 2, NAN, 1.0), [], 2.0),      # Every other row, which is its own rate.
    (EVEN[:5], at(EVEN[:5], {2: NAN}), [], 0.0),                            # Too few rows to have a rate.
    (EVEN[:5], at(np.full(5, NAN), {0: 3.0}), [[0, 4]], 0.0)])
def test_holes_and_rate_of_a_column(t, column, holes, step):
    table = MeasuredTable({"t": t, "slip_speed": column})
    assert table.holes("slip_speed").tolist() == holes
    assert table.usual_step("slip_speed") == step
    assert table.usual_step("t", "slip_speed") == max(step, table.usual_step())
    assert [part.tolist() for part in table.filled("slip_speed")] == [
        t[np.isfinite(column)].tolist(), column[np.isfinite(column)].tolist()]


def test_a_part_has_both_of_its_ends():
    table = MeasuredTable({"t": EVEN, "slip_speed": 2.0 * EVEN}, {"slip_speed": "next"}, "x", ("read",))
    for start, end, rows in ((None, None, range(20)), (3.0, None, range(3, 20)), (None, 3.0, range(4)),
                             (3.0, 4.0, [3, 4]), (3.5, 3.75, [])):
        part = table.part(start, end)
        assert {name: values.tolist() for name, values in part.columns.items()} == {
            "t": [*rows], "slip_speed": [2 * k for k in rows]}
        assert (part.hold, part.source, part.notes) == ({"slip_speed": "next"}, "x", ("read",))
    assert table.noting("one", "two").notes == ("read", "one", "two")


@pytest.mark.parametrize(("values", "smooth"), [
    (np.sin(0.7 * np.arange(40)), True), (np.sin(1.2 * np.arange(40)), False),  # Limit: 2 sin(w/2) = 1, w = 1.047.
    (np.repeat(np.sin(np.arange(10)), 4), False), (np.arange(10.0), True), (np.arange(9.0), False),
    (np.concatenate([np.zeros(9), np.arange(10.0)]), True), (np.concatenate([np.zeros(10), np.arange(10.0)]), False),
    (np.full(20, 3.0), False)])
def test_a_smooth_column_differs_from_one_held_in_steps(values, smooth):
    assert looks_smooth(values) is smooth
