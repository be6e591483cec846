"""Lines, marks and words of pictures, read from the Matplotlib figure: in print too, where labels lie within it."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from legends import spans_in

from tcc_sim.analysis.control import Event
from tcc_sim.cli import main

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from tcc_sim.trajectory import Cycles
from tcc_sim.views import overview, style, sweeps


def test_cells_that_have_not_settled_are_hatched(figures: list[Any], tmp_path: Path) -> None:
    """The hatching had an opacity of 0."""
    grid = {"over": "engine.frequency", "second_over": "pressure.mean", "values": [1.0, 2.0], "second_values": [3.0],
            "max_slip_speed": [[1.0, 2.0]], "period": [[1, 1]], "regime": [["slip", "slip"]],
            "runaway": [[False, False]], "transient": [[False, True]]}
    sweeps.draw_grid(tmp_path / "a.png", grid)
    for axis in figures[0].axes[:2]:
        cells, = (c for c in axis.collections if c.get_hatch())
        path, = cells.get_paths()
        assert path.get_extents().bounds == pytest.approx((1.5, 1.5, 1.0, 3.0))
        assert cells.get_edgecolor()[0, 3] == 1.0
    assert [text.get_text() for text in figures[0].legends[0].get_texts()] == ["hatched: 1 of 2 have not settled"]


def test_a_title_is_over_the_picture_and_a_legend_beside_no_panel_title(laid_out: list[Any], tmp_path: Path) -> None:
    words = ["simulate", "minimal", "--cycles", "60", "--width", "column", "--title", "Mine $x_{$", "--plot"]
    assert main([*words, str(tmp_path / "a.svg")]) == 0
    assert laid_out[0]._suptitle.get_text() == "Mine $x_{$"  # No formula.


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


def test_an_overview_changes_its_look_just_beyond_its_limits() -> None:
    with style.figure() as drawn:
        axes = iter(drawn.subplots(4, 3).ravel())
        events = [Event(5.0, 42 * "a"), Event(5.01, 43 * "b"), *[Event(9.0, "c")] * 4]
        overview.mark_events(axis := next(axes), events, 10.0)
        assert [(text.get_text(), text.get_ha()) for text in axis.texts[:3]] == [
            (42 * "a", "left"), (39 * "b" + "...", "right"), ("c", "right")]
        overview.mark_events(axis := next(axes), events, 10.0, labelled=False)
        assert (len(axis.texts), len(axis.lines), {line.get_label()[0] for line in axis.lines}) == (0, 6, {"_"})
        for count, spans in ((80, 80), (81, 0)):
            overview.shade_stick(axis := next(axes), np.arange(2.0 * count), np.tile([0, 1], count))
            assert len(spans_in(axis)) == spans
        for count, largest, most, size, top in ((300, 0.0, 2.0, 3.0, 3.2), (301, 5.0, 2.0, 1.5, 8.0),
                                                (3, 0.0, 0.0, 3.0, 1e-6)):
            zero = np.zeros(count)
            of: Any = SimpleNamespace(discarded=0, cycles=count, max_slip_speed=most)
            overview.draw_cycle_maxima(axis := next(axes), Cycles(np.zeros((count + 1, 3)), zero + largest, zero, zero),
                                       0, of)
            assert (axis.lines[0].get_markersize(), axis.get_ylim()) == (size, (0.0, top))
        for last, judged, over in ((2.0009, 2, "period of excitation"), (2.0011, 2, "time (s)"), (2.0, 0, "time (s)")):
            cycles = Cycles(np.zeros((3, 3)), np.ones(2), np.zeros(2), np.zeros(2), starts=np.array([0.0, 1.0, last]))
            of = SimpleNamespace(discarded=0, cycles=judged, max_slip_speed=1.0)
            overview.draw_cycle_maxima(axis := next(axes), cycles, 7, of)
            assert axis.get_xlabel() == over
            assert axis.lines[0].get_xdata().tolist() == ([7, 8] if over.startswith("period") else [0.0, 1.0])


def test_cells_meet_half_way_between_their_centres() -> None:
    for centres, edges in (([1.0, 2.0, 4.0], [0.5, 1.5, 3.0, 5.0]), ([4.0], [2.0, 6.0]), ([0.0], [-0.5, 0.5])):
        assert sweeps.edges(np.array(centres)).tolist() == edges
    np.testing.assert_array_equal(sweeps.numbers([1, None, 2.5]), [1.0, np.nan, 2.5])


def test_stick_is_shaded_from_its_first_sample_to_its_last() -> None:
    with style.figure() as drawn:
        axis = drawn.subplots()
        t = np.arange(7.0)
        assert overview.shade_stick(axis, t, np.array([0, 0, 1, 0, 0, 0, -1]))
        assert spans_in(axis) == [(0.0, 1.0), (3.0, 5.0)]
        assert [patch.get_label() == "stick" for patch in axis.patches] == [True, False]
        assert not overview.shade_stick(axis, t, np.ones(7))


def test_fast_stick_is_shaded_by_its_share_of_each_column() -> None:
    from matplotlib.collections import QuadMesh

    with style.figure() as drawn:
        axis = drawn.subplots()
        k = np.arange(10_000)
        state = np.where((k % 10 < 4) == (k < 5000), 0, 1).astype(np.int8)  # 40 %, then 60 % of each ten samples.
        assert overview.shade_stick(axis, 1e-3 * k, state)
        mesh, = (each for each in axis.collections if isinstance(each, QuadMesh))
        share = np.asarray(mesh.get_array()).ravel()
        assert len(share) == overview.COLUMNS
        assert abs(share[:235].mean() - 0.4) < 0.01
        assert abs(share[245:].mean() - 0.6) < 0.01
        assert np.ptp(share[:235]) < 0.2
        assert axis.get_legend_handles_labels()[1] == ["stick (shade: share)"]
        assert not np.isfinite(axis.dataLim.y0)  # The shade does not set the scale.


def test_a_legend_names_only_what_is_drawn(figures: list[Any], tmp_path: Path) -> None:
    """Motions without a value had entries without marks."""
    scattered = {"scatter": {"engine.frequency": [1.0, 2.0]}, "sampled": {"engine.frequency": [1.0, 2.0]},
                 "regime": ["stick", "slip"], "runaway": [False, False], "transient": [False, False],
                 "probabilities": [0.5], "quantiles": {name: [None] for name, *_ in sweeps.RESULTS},
                 **{name: [None, 2.0] for name, *_ in sweeps.RESULTS}}
    sweeps.draw_scatter(tmp_path / "a.png", scattered)
    assert [text.get_text() for text in figures[0].legends[0].get_texts()] == ["slip"]
    with style.figure() as drawn:
        axis = drawn.subplots()
        axis.plot([1.0, 2.0], [math.nan, 1.0], label="line")
        axis.plot([1.0], [math.nan], label="no line")
        axis.fill_between([1.0, 2.0], [math.nan] * 2, [1.0] * 2, label="no band")
        axis.axhline(math.nan, label="no level")
        axis.axvspan(1.0, 2.0, label="span")
        assert style.entries(axis)[1] == ["line", "span"]
        assert len(style.legend(axis).get_texts()) == 2
