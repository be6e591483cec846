"""Pictures are made, are not blank, and are the same bytes every time; pictures and tables of runs under commands."""

import math

import numpy as np
import pytest
from driveline_bags import bag, ticked

import tcc_sim
from tcc_sim.analysis.summary import cycles_of, summarise
from tcc_sim.cli import main
from tcc_sim.model.parameters import System
from tcc_sim.scene import load_scene
from tcc_sim.trajectory import Trajectory

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from matplotlib.image import imread

from tcc_sim.views import style, whole_runs
from tcc_sim.views.overview import overview

CYCLE = System().cycle


def trajectory_of(cycles=20, samples=100):
    t = np.arange(cycles * samples + 1) * (CYCLE / samples)
    phase = 2.0 * math.pi * t / CYCLE
    v = np.maximum(30.0 * np.sin(phase), 0.0)
    zero = np.zeros_like(t)
    return Trajectory(t, v, 0.1 + 0.05 * np.cos(phase), zero, 300.0 + 250.0 * np.sin(phase), zero + 500.0, zero + 200.0,
                      np.where(v > 0.1, 1, 0).astype(np.int8), CYCLE, "by_hand", System())


def pixels(path):
    return imread(path)[..., :3]


def test_the_overview_is_a_picture_with_ink_in_all_four_panels_and_shades_stick(tmp_path):
    run = trajectory_of()
    image = pixels(overview(tmp_path / "overview.png", run, cycles_of(run), 0, summarise(run), "by hand"))
    height, width = image.shape[:2]
    assert (width, height) == (int(style.PAGE * style.DOTS), int(5.4 * style.DOTS))
    for part in (image[:height // 3], image[height // 3:height * 6 // 10], image[height * 6 // 10:, :width // 2],
                 image[height * 6 // 10:, width // 2:]):
        assert 0.01 < np.mean(part.min(axis=-1) < 0.95) < 0.6
    shade = np.array([int(style.STICK[k:k + 2], 16) for k in (1, 3, 5)]) / 255.0
    assert np.mean(np.abs(image - shade).max(axis=-1) < 0.004) > 0.04


def test_long_names_of_rows_lie_within_the_picture(tmp_path):
    with style.figure(style.PAGE, 2.0) as drawn:
        axis = drawn.subplots()
        axis.set_yticks([0.0, 1.0], ["actuation_pressure.offset"] * 2)
        path = style.save(drawn, tmp_path / "rows.png")
    assert (pixels(path)[:, :4] == 1.0).all()


def test_every_format_has_the_same_bytes_every_time(tmp_path):
    """Fonts of a PDF are TrueType."""
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    for name in "ab":
        with style.figure(style.COLUMN, 2.0) as drawn:
            drawn.add_subplot().plot([0.0, 2.0], [0.0, 1.0], clip_on=True, label=r"$\mu_k N R$")
            drawn.axes[0].legend()
            for suffix in starts:
                style.save(drawn, tmp_path / f"{name}.{suffix}")
    for suffix, start in starts.items():
        one, two = ((tmp_path / f"{name}.{suffix}").read_bytes() for name in "ab")
        assert one.startswith(start)
        assert one == two
    assert b"/Type3" not in one
    assert b"/CIDFontType2" in one


def test_digits_that_the_layout_leaves_by_chance_are_in_no_file(tmp_path):
    """An SVG names what it cuts by all digits of its place."""
    for write, names in ((style.save, ["a.svg"]), (style.save_both, ["a.v2.png", "a.v2.svg"])):
        with style.figure(style.COLUMN, 2.0) as drawn:
            drawn.add_subplot().plot([0, 1], [0, 1e7])
            write(drawn, tmp_path / names[-1].replace(".v2.svg", ".v2"))
        assert all((tmp_path / name).is_file() for name in names)
        axis = drawn.axes[0]
        places = axis.get_position(original=True).bounds
        assert places == tuple(round(x, 5) for x in places)
        # Typeset numbers would take most of a picture's time.
        assert {"0.0", "1.0"} <= {label.get_text() for label in axis.get_xticklabels()}
        assert axis.yaxis.get_offset_text().get_text() == r"$\times\mathdefault{10^{7}}\mathdefault{}$"


def law(reading):
    """A pressure that follows the slip speed."""
    return min(max(9e4 + 800.0 * (reading.slip_speed - 20.0), 0.0), 4e5)


def test_the_control_of_a_run_has_its_means_and_its_pressures():
    run = tcc_sim.closed_loop("controlled", law, 0.5)
    control, cycle = run.control, 2.0 * np.pi / 150.0
    assert control.t == pytest.approx(cycle * np.arange(1, 12), abs=1e-9)
    # The mean over a cycle by another rule: of a fine interpolation.
    fine = np.linspace(3.0 * cycle, 4.0 * cycle, 20001)
    assert control.mean_slip[3] == pytest.approx(np.interp(fine, run.t, run.slip_speed)[:-1].mean(), rel=1e-4)
    assert control.command.values.tolist() == run.commands["actuation_pressure"][1:].tolist()
    assert control.applied.t.tolist() == run.t[:-1].tolist()
    assert not len(control.target.t)
    columns = run.columns()
    assert columns["applied_pressure"] is run.applied_pressure
    assert columns["actuation_pressure"] is run.commands["actuation_pressure"]


@pytest.mark.parametrize("profile", [False, True])
def test_the_picture_of_a_run_shows_pressures_and_cycle_means(tmp_path, figures, profile):
    scene = load_scene("controlled")
    if profile:
        scene = scene.with_values({"engine.mean_torque_times": [0.0, 0.3], "engine.mean_torque_values": [200.0, 250.0]})
    run = tcc_sim.closed_loop(scene, law, 0.6)
    assert tcc_sim.plot(run, tmp_path / "run.png").is_file()
    titles = [axis.get_title(loc="left") for axis in figures[0].axes]
    assert any(title.endswith(" Actuation pressure") for title in titles)
    assert any(" Cycle mean" in title for title in titles)


def test_the_picture_of_a_recorded_manoeuvre_shows_pressure_target_and_cycle_means(tmp_path, monkeypatch, figures):
    drawn = []
    for name in ("mean_slip_panel", "pressure_panel"):
        kept = getattr(whole_runs, name)
        monkeypatch.setattr(whole_runs, name, lambda axis, control, kept=kept: (kept(axis, control),
                                                                               drawn.append((axis, control))))
    scene = load_scene("controlled").with_values({"engine.mean_torque_times": [0.0, 0.3],
                                                  "engine.mean_torque_values": [200.0, 250.0]})
    rows = ticked(scene, 501, pressure=lambda tick: 8e4 + 1e4 * (tick // 100))
    bag(tmp_path / "run", rows, scene, targets=[(0, 20.0), (250, 25.0)])
    assert main(["analyse", str(tmp_path / "run"), "--plot", str(tmp_path / "run.png")]) == 0
    (means, control), (pressures, _) = drawn
    assert [line.get_label() for line in means.lines[:2]] == ["cycle mean", "target"]
    assert control.target.values.tolist() == [20.0, 25.0]
    assert control.target.t.tolist() == [0.0, 0.25]
    assert pressures.lines[0].get_label() == "applied"
    assert set(pressures.lines[0].get_ydata()) >= {80.0, 90.0, 100.0, 110.0, 120.0}
    assert len(control.mean_slip) == int(0.5 // (2.0 * np.pi / 150.0))
