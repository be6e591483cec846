"""Lines, marks and words of pictures, read from the Matplotlib figure."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tcc_sim.analysis.control import Event
from tcc_sim.trajectory import Cycles
from tcc_sim.views import overview, style, sweeps, whole_runs


@pytest.fixture(autouse=True)
def _matplotlib() -> None:
    pytest.importorskip("matplotlib")


def test_texts_of_events_stand_beside_their_lines_and_are_short() -> None:
    """To the right of a line in the first half and to the left in the second, three heights in turn."""
    events = [Event(2.0, 60 * "a"), Event(4.0, "second"), Event(8.0, "third"), Event(9.0, "fourth")]
    with style.figure(style.PAGE, 3.0) as drawn:
        axis = drawn.subplots()
        axis.set_xlim(0.0, 20.0)
        overview.mark_events(axis, events, 10.0, 0.5)
        drawn.draw_without_rendering()
        assert [line.get_xdata()[0] for line in axis.lines] == [4.0, 8.0, 16.0, 18.0]
        boxes = [text.get_window_extent() for text in axis.texts]
        for event, box, inside in zip(events, boxes, ("x0", "x0", "x1", "x1")):
            apart = getattr(box, inside) - axis.transData.transform((event.t / 0.5, 0.0))[0]
            assert 0.0 < apart * (1.0 if inside == "x0" else -1.0) < 10.0
        assert boxes[0].y0 > boxes[1].y1
        assert boxes[1].y0 > boxes[2].y1
        assert boxes[3].y1 == pytest.approx(boxes[0].y1)
        assert axis.bbox.y1 > boxes[0].y1
        assert axis.texts[0].get_text() == 39 * "a" + "..."
        assert min(text.get_fontsize() for text in axis.texts) >= 6.0  # Smaller print is not read.
    with style.figure() as drawn:
        axis = drawn.subplots()
        overview.mark_events(axis, events + events[:3], 10.0)
        assert not axis.texts
        assert [line.get_label() == "event" for line in axis.lines] == [True] + 6 * [False]


def test_a_runaway_stands_above_the_others_and_within_the_axis() -> None:
    values = {"over": "engine.frequency", "values": [1.0, 2.0, 3.0, 4.0], "max_slip_speed": [10.0, 20.0, 900.0, None],
              "regime": ["stick", "slip", "slip", None], "runaway": [False, False, True, None]}
    with style.figure() as drawn:
        axis = drawn.subplots()
        sweeps.draw_maxima(axis, values)
        shown = {line.get_label(): line.get_xydata().tolist() for line in axis.lines[1:]}
        low, high = axis.get_ylim()
    ((place, height),) = shown["runaway"]
    assert shown == {"stick": [[1.0, 10.0]], "slip": [[2.0, 20.0]], "runaway": [[3.0, height]], "failed": [[4.0, 0.0]]}
    assert place == 3.0
    assert -0.1 * 20.0 < low < 0.0 < 20.0 < height < high < 1.2 * 20.0


def test_cells_meet_half_way_between_their_centres() -> None:
    for centres, edges in (([1.0, 2.0, 4.0], [0.5, 1.5, 3.0, 5.0]), ([4.0], [2.0, 6.0]), ([0.0], [-0.5, 0.5])):
        assert sweeps.edges(np.array(centres)).tolist() == edges
    np.testing.assert_array_equal(sweeps.numbers([1, None, 2.5]), [1.0, np.nan, 2.5])


def test_a_twin_shows_its_start_its_end_and_all_of_the_difference(monkeypatch, tmp_path):
    seen: list[Any] = []
    monkeypatch.setattr(style, "save", lambda drawn, path: seen.extend(drawn.axes) or path)
    t = np.arange(-10.0, 31.0)
    run = SimpleNamespace(t=t, slip_speed=2.0 * t, cycle=1.0)
    found = SimpleNamespace(trajectory=run, t=t, slip_speed=3.0 * t, difference=-t)
    whole_runs.draw_twin(tmp_path / "a.png", found)
    start, end, difference = ([line.get_xydata().tolist() for line in axis.lines] for axis in seen)
    for lines, part in ((start, t[:9]), (end, t[-9:])):
        assert lines == [[[x, 3.0 * x] for x in part], [[x, 2.0 * x] for x in part]]
    assert difference == [[[x, -x] for x in t]]
    assert seen[2].get_xlim() == (-10.0, 30.0)
    with style.figure() as drawn:
        axis = drawn.subplots()
        whole_runs.draw_slip_speeds(axis, found)
        assert all(len(line.get_xdata()) == len(t) for line in axis.lines)


def test_the_maxima_of_cycles_keep_the_scale_of_those_that_count() -> None:
    """A first cycle far above the others is dropped, counted and off the axis; the summary's maximum is a line."""
    cycles = Cycles(np.zeros((5, 3)), np.array([90.0, 5.0, 9.0, 10.0]), np.array([0.0, -8.0, 0.0, 0.0]), np.zeros(4))
    summary = SimpleNamespace(discarded=2, cycles=2, max_slip_speed=10.0)
    with style.figure() as drawn:
        axis = drawn.subplots()
        overview.draw_cycle_maxima(axis, cycles, 7, summary)
        dropped, kept, line = axis.lines
        assert dropped.get_label() == "dropped (1 off scale)"
        assert dropped.get_xydata().tolist() == [[7.0, 90.0], [8.0, 8.0]]
        assert (kept.get_label(), kept.get_xydata().tolist()) == ("kept", [[9.0, 9.0], [10.0, 10.0]])
        assert set(line.get_ydata()) == {10.0}
        assert axis.get_ylim() == (0.0, 16.0)
        assert axis.get_xlabel() == "period of excitation"
    uneven = replace(cycles, starts=np.array([0.0, 1.0, 2.0, 3.0, 5.0]))
    with style.figure() as drawn:
        axis = drawn.subplots()
        overview.draw_cycle_maxima(axis, uneven, 7, summary)
        assert axis.lines[1].get_xdata().tolist() == [2.0, 3.0]
        assert axis.get_xlabel() == "time (s)"


def test_stick_is_shaded_from_its_first_sample_to_its_last() -> None:
    with style.figure() as drawn:
        axis = drawn.subplots()
        t = np.arange(7.0)
        assert overview.shade_stick(axis, t, np.array([0, 0, 1, 0, 0, 0, -1]))
        ends = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axis.patches]
        assert ends == [(0.0, 1.0), (3.0, 5.0)]
        assert [patch.get_label() == "stick" for patch in axis.patches] == [True, False]
        assert not overview.shade_stick(axis, t, np.ones(7))
