"""Windows of a recording: which rows they select, what they say, and what they refuse."""

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.recording.columns import JointStates
from tcc_sim.recording.window import LATEST, Window

TIMES = np.arange(5, dtype=np.int64) * 10**9
STATES = JointStates(TIMES, TIMES, TIMES, *np.zeros((6, 5)))


@pytest.mark.parametrize(("run", "start", "end", "rows", "sentence"), [
    (None, None, None, [0, 1, 2, 3, 4], ""), (0, None, None, [0, 1, 2, 3, 4], "only run 0 is analysed"),
    (1, None, None, [], "only run 1 is analysed"),
    (None, 1.0, 3.0, [1, 2, 3], "only from 1 s on, up to 3 s is analysed"),
    (None, 1.5, None, [2, 3, 4], "only from 1.5 s on is analysed"),
    (None, None, 0.0, [0], "only up to 0 s is analysed"),
    (None, -LATEST, LATEST, [0, 1, 2, 3, 4], f"only from {-LATEST:g} s on, up to {LATEST:g} s is analysed")])
def test_a_window_selects_its_rows_and_names_itself(run, start, end, rows, sentence) -> None:
    window = Window(run, start, end)
    assert np.arange(5)[window.rows(STATES)].tolist() == rows
    assert (window.sentence(), window.all) == (sentence, not sentence)


@pytest.mark.parametrize(("run", "start", "end", "words"), [
    (-1, None, None, "run is -1"), (None, 2.0 * LATEST, None, "start is"), (None, None, -2.0 * LATEST, "end is"),
    (None, float("nan"), None, "start is nan"), (None, 2.0, 2.0, "must end after"), (None, 3.0, 2.0, "must end after")])
def test_a_window_that_cannot_be_is_refused(run, start, end, words) -> None:
    with pytest.raises(InputError, match=words):
        Window(run, start, end)


@pytest.mark.parametrize(("run", "words"), [(2, "no run 2: the recording holds 2 runs"), (1, "no state in the window"),
                                            (None, "no state in the window")])
def test_an_empty_window_says_why(run, words) -> None:
    with pytest.raises(InputError, match=words):
        Window(run).refuse(2)
