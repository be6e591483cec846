"""Pictures are made, are not blank, and are the same bytes every time."""

import math

import numpy as np
import pytest

from tcc_sim.analysis.summary import cycles_of, summarise
from tcc_sim.model.parameters import System
from tcc_sim.trajectory import Trajectory
from tcc_sim.views import overview as pictures
from tcc_sim.views import style

CYCLE = System().cycle


def trajectory_of(cycles=20, samples=100):
    t = np.arange(cycles * samples + 1) * (CYCLE / samples)
    phase = 2.0 * math.pi * t / CYCLE
    v = np.maximum(30.0 * np.sin(phase), 0.0)
    zero = np.zeros_like(t)
    return Trajectory(t, v, 0.1 + 0.05 * np.cos(phase), zero, 300.0 + 250.0 * np.sin(phase), zero + 500.0, zero + 200.0,
                      np.where(v > 0.1, 1, 0).astype(np.int8), CYCLE, "by_hand", System())


@pytest.fixture(autouse=True)
def _matplotlib():
    pytest.importorskip("matplotlib")


def pixels(path):
    from matplotlib.image import imread

    return imread(path)[..., :3]


def overview(path):
    run = trajectory_of()
    return pictures.overview(path, run, cycles_of(run), 0, summarise(run), "by hand")


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """The overview in a file."""
    pytest.importorskip("matplotlib")
    return overview(tmp_path_factory.mktemp("pictures") / "overview.png")


def test_the_overview_is_a_picture_with_ink_in_all_four_panels(drawn):
    image = pixels(drawn)
    height, width = image.shape[:2]
    assert (width, height) == (int(style.PAGE * style.DOTS), int(5.4 * style.DOTS))
    for part in (image[:height // 3], image[height // 3:height * 6 // 10], image[height * 6 // 10:, :width // 2],
                 image[height * 6 // 10:, width // 2:]):
        assert 0.01 < np.mean(part.min(axis=-1) < 0.95) < 0.6


def test_stick_is_shaded_where_the_clutch_sticks(drawn):
    shade = np.array([int(style.STICK[k:k + 2], 16) for k in (1, 3, 5)]) / 255.0
    assert np.mean(np.abs(pixels(drawn) - shade).max(axis=-1) < 0.004) > 0.04


def test_cycles_that_were_not_observed_leave_gaps(tmp_path):
    run = trajectory_of()
    cycles = cycles_of(run)
    cycles.highest[5:8] = cycles.lowest[5:8] = math.nan
    assert pictures.overview(tmp_path / "a.png", run, cycles, 3, summarise(run)).stat().st_size > 10_000


def test_long_names_of_rows_lie_within_the_picture(tmp_path):
    from matplotlib.image import imread

    with style.figure(style.PAGE, 2.0) as drawn:
        axis = drawn.subplots()
        axis.set_yticks([0.0, 1.0], ["actuation_pressure.offset"] * 2)
        path = style.save(drawn, tmp_path / "rows.png")
    assert (imread(path)[:, :4, :3] == 1.0).all()


def test_both_files_of_a_figure(tmp_path):
    with style.figure(style.COLUMN, 2.0) as drawn:
        drawn.add_subplot().plot([0, 1], [0, 1])
        png, svg = style.save_both(drawn, tmp_path / "fig.v2")
    assert png.name == "fig.v2.png"
    assert svg.read_text().startswith("<?xml")


def test_digits_that_the_layout_leaves_by_chance_are_in_no_file(tmp_path):
    """An SVG names what it cuts by all digits of its place."""
    for write in (style.save, style.save_both):
        with style.figure(style.COLUMN, 2.0) as drawn:
            drawn.add_subplot().plot([0, 1], [0, 1])
            write(drawn, tmp_path / "a.svg")
        places = drawn.axes[0].get_position(original=True).bounds
        assert places == tuple(round(x, 5) for x in places)
