"""--plot and plot(): their pictures and sources, and refusals before any computation."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from driveline_bags import bag, ticked

from tcc_sim.analysis.control import Control, Steps
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.replay.replay import replay
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.sweeps.simulation import simulate
from tcc_sim.sweeps.sweep import sweep

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from matplotlib.figure import Figure

from tcc_sim.views import plots, style, sweeps
from tcc_sim.views.overview import mean_slip_panel, pressure_panel


@pytest.fixture
def drawn(figures):
    """Function that gives (label, x, y) of the lines, and the axis, of each panel of the last picture by its title."""
    def panels():
        return {axis.get_title(loc="left") or axis.get_title(): {"axis": axis, "lines": [
            (line.get_label(), np.asarray(line.get_xdata()), np.asarray(line.get_ydata())) for line in axis.lines]}
            for axis in figures[-1].axes}
    return panels


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return bag(tmp_path_factory.mktemp("plots") / "run", ticked(load_scene("fig02"), 3000), "fig02")


def test_a_recording_is_drawn_as_a_curve(recording, tmp_path, drawn):
    assert main(["analyse", str(recording), "--plot", str(tmp_path / "run.png")]) == 0
    (_, angle, speed), (_, *section) = drawn()["(c) Phase portrait"]["lines"]
    assert len(angle) > 1000  # the ticks alone are 42 a cycle
    assert len(section[0])
    for place in zip(*section):  # The section lies on the orbit.
        assert np.hypot((angle - place[0]) / np.ptp(angle), (speed - place[1]) / np.ptp(speed)).min() < 0.03
    names = [name for name, *_ in drawn()["(a) Torques"]["lines"]]
    assert names == ["engine", "friction", r"$\mu_k N R$", r"$\mu_s N R$"]
    kinetic, static = (line[2] for line in drawn()["(a) Torques"]["lines"][2:])
    np.testing.assert_allclose(static, 0.3 / 0.24 * kinetic)


def test_simulate_draws_its_last_cycles(tmp_path, drawn, figures):
    assert main(["simulate", "minimal", "--cycles", "60", "--plot", str(tmp_path / "a.png"), "--width", "column"]) == 0
    assert figures[0].get_size_inches()[0] == style.COLUMN
    names = [name for name, *_ in drawn()["(a) Torques"]["lines"]]
    assert names == ["engine", "friction", r"$\mu_k N R$"]  # mu_s = mu_k
    (_, t, v) = drawn()["(b) Slip speed"]["lines"][0]
    assert len(t) > 6 * 1000
    last = solve(load_scene("minimal").system, cycles=60).cycles.highest[-6:]
    assert np.abs(v).max() == pytest.approx(last.max(), rel=1e-4)


def test_a_run_shorter_than_a_cycle_is_drawn(tmp_path, drawn):
    assert main(["simulate", "fig02", "--duration", "0.02", "--plot", str(tmp_path / "a.png")]) == 0
    assert len(drawn()["(b) Slip speed"]["lines"][0][1]) > 90


def test_a_run_of_samples_alone_has_its_cycles_worked_out(tmp_path, drawn):
    run = solve(load_scene("minimal"), cycles=5, samples_per_cycle=200)
    plots.plot(replace(run, cycles=None), tmp_path / "a.png")
    shown = [point for _, *line in drawn()["(d) Maxima"]["lines"][:-1] for point in zip(*line)]
    assert sorted(number for number, _ in shown) == [0, 1, 2, 3, 4]
    assert sorted(y for _, y in shown) == pytest.approx(sorted(run.cycles.highest), rel=1e-3)


@pytest.mark.parametrize(("words", "says"), [
    (["simulate", "fig02", "--plot", "run.jpg"], "must end in .png, .svg or .pdf"),
    (["sweep", "fig02", "--over", "engine.frequency=1:2:2", "--plot", "no/run.png"], "no directory"),
    (["simulate", "fig02", "--plot", "here.png"], "not overwritten"),
    (["simulate", "fig02", "--plot", "x.svg", "--json", "x.svg"], "two options name the file")])
def test_what_cannot_be_a_picture_is_refused_first(words, says, tmp_path, refused):
    (tmp_path / "here.png").write_text("mine")
    assert says in refused(*words)
    assert (tmp_path / "here.png").read_text() == "mine"


@pytest.mark.parametrize(("missing", "words"), [
    ("matplotlib", ["simulate", "fig02", "--plot", "run.png"]), ("matplotlib", ["figure", "4", "--out", "figures"]),
    ("matplotlib", ["precision", "--quick", "--out", "p"]), ("matplotlib", ["stability", "--quick", "--out", "s"]),
    ("matplotlib", ["sweep", "fig02", "--over", "engine.frequency=1:2:2", "--plot", "run.svg"]),
    ("matplotlib", ["analyse", "RUN", "--plot", "run.png"]), ("rerun", ["analyse", "RUN", "--rrd", "run.rrd"]),
    ("rerun", ["analyse", "RUN", "--spawn"]),
    ("distributed", ["sweep", "fig02", "--over", "engine.frequency=1:2:2", "--dask", "tcp://localhost:1", "--out",
                     "x"])])
def test_a_missing_extra_is_said_before_anything_is_computed(missing, words, recording, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, missing, None)
    for module in ("tcc_sim.solvers", "tcc_sim.sweeps.sweep", "tcc_sim.replay.replay", "tcc_sim.study.paper.figures"):
        for name in ("solve", "sweep", "replay", "figure_data"):
            if hasattr(sys.modules.get(module), name):
                monkeypatch.setattr(sys.modules[module], name, lambda *_, **__: pytest.fail("something was computed"))
    assert main([str(recording) if word == "RUN" else word for word in words]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    extra = "cluster" if missing == "distributed" else "view"
    assert f"pip install 'tcc_sim[{extra}]'" in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_result_cannot_be_drawn(tmp_path):
    with pytest.raises(InputError, match="a float cannot be drawn"):
        plots.plot(3.0, tmp_path / "a.png")
    with pytest.raises(InputError, match="column or page"):
        plots.plot(3.0, tmp_path / "a.png", "poster")


def test_a_part_of_a_controllers_test_fills_its_panels_and_rounding_does_not():
    t = np.arange(20.0, 30.0)
    control = Control(t, 20.0 + 1e-3 * np.sin(t), applied=Steps(t, 9e4 + np.sin(t)), command=Steps(t, 9e4 + np.sin(t)))
    means, pressure = Figure().subplots(2, 1)
    mean_slip_panel(means, control)
    pressure_panel(pressure, control)
    assert pressure.get_xlim() == (20.0, 29.0)
    for axis, size in ((means, 20.0), (pressure, 90.0)):
        assert np.ptp(axis.get_ylim()) == pytest.approx(0.02 * size, rel=0.1)


def test_events_of_a_recording(tmp_path):
    scene = load_scene("commands").with_values({"command_timeout": 0.2})
    said = []
    rows = ticked(scene, 1500, pressure=lambda k: 2e5 if k < 700 else 2.5e5, said=said,
                  changes=[(900, {"friction.kinetic_coefficient": 0.25}, False)], resets=(1300,))
    result = replay(bag(tmp_path / "run", rows, scene, said=said), frequency=150.0).control
    assert [event.text for event in result.events] == ["friction.kinetic_coefficient = 0.25", "reset or restart"]
    assert result.events[0].t == pytest.approx(0.9, abs=2e-3)
    assert result.events[1].t == pytest.approx(1.3, abs=2e-3)
    assert result.applied.values.min() == 2e5
    assert result.applied.values[-1] == 2.5e5
    assert len(result.mean_slip) == int(1.3 / load_scene("fig02").system.cycle)


def test_a_held_signal_is_drawn_to_the_end_once() -> None:
    held = Steps(np.array([0.0, 0.5]), np.array([1.0, 2.0]))
    assert (held.until(0.7).t.tolist(), held.until(0.7).values.tolist()) == ([0.0, 0.5, 0.7], [1.0, 2.0, 2.0])
    assert held.until(0.5) is held
    assert Steps.none().until(1.0).t.tolist() == []


def test_a_runaway_is_a_class() -> None:
    swept = sweeps.classes(["stick", "slip", None, "slip"], [False, True, None, False])
    assert {name: mine.tolist() for name, (_, mine) in swept.items()} == {
        "stick": [True, False, False, False], "slip": [False, False, False, True],
        "runaway": [False, True, False, False]}


def test_a_manoeuvre_is_drawn_from_its_beginning_to_its_end(figures, tmp_path) -> None:
    result = simulate("apply")
    plots.plot(result, tmp_path / "it.png")
    torques, slip, shaft, heat = figures[0].axes
    kinetic, static = (line.get_ydata() for line in torques.lines[2:])
    assert static == pytest.approx(load_scene("apply").system.friction_ratio * kinetic)
    t, warm = heat.lines[0].get_data()
    assert (t[0], t[-1]) == (0.0, 1.0)
    assert 1e3 * warm[-1] == pytest.approx(result.summary.clutch_energy, rel=0.01)
    assert max(shaft.lines[0].get_ydata()) == pytest.approx(result.summary.max_shaft_torque, rel=0.01)
    assert max(slip.lines[0].get_ydata()) == pytest.approx(result.summary.max_slip_speed, rel=1e-3)


def test_a_picture_without_a_file_is_one_for_a_notebook_and_a_run_needs_three_samples(monkeypatch) -> None:
    run = solve(load_scene("minimal"), cycles=3, samples_per_cycle=50)
    with monkeypatch.context() as patch:
        patch.setattr(style, "save", lambda drawn, path: path.write_bytes(b"png!") and path)
        picture = plots.plot(run)
    assert (repr(picture), picture._repr_png_()) == ("<Picture: 4 bytes of PNG>", b"png!")
    names = ("t", "slip_speed", "plate_angle", "plate_speed", "engine_torque", "saturation_torque", "friction_torque",
             "state")
    short, three = (replace(run, **{name: getattr(run, name)[:count] for name in names}) for count in (2, 3))
    ax = Figure().subplots()
    assert plots.plot(three, ax=ax, title="mine").get_title() == "mine"
    with pytest.raises(InputError, match=r"^a Trajectory has no curve for an axis; a run needs samples"):
        plots.plot(short, ax=ax)
    for result, order in ((SimpleNamespace(per_revolution=2.0), 2.0), ({"scene": {"engine.order": 3.0}}, 3.0),
                          ({}, None), (SimpleNamespace(measured=SimpleNamespace(per_revolution=4.0)), 4.0), (3.0, None),
                          (load_scene("fig02").with_values({"engine.order": 2.0}), 2.0)):
        assert plots._order_of(result) == order


def test_an_axis_takes_the_main_curve_and_no_file_is_overwritten(figures, tmp_path) -> None:
    run = solve(load_scene("minimal"), cycles=3, samples_per_cycle=50)
    ax = Figure().subplots()
    assert plots.plot(run, ax=ax) is ax
    assert ax.lines[0].get_ydata() == pytest.approx(run.slip_speed)
    swept = sweep("slip", "engine.torque_amplitude", [10.0, 20.0], cycles=20)
    axis = Figure().subplots()
    plots.plot(swept, ax=axis)
    assert axis.lines[0].get_ydata() == pytest.approx(swept.column("max_slip_speed"))
    assert swept._repr_html_().count("<tr>") == 3
    path = tmp_path / "a.svg"
    path.write_text("mine")
    for wrong in ({"file": path}, {"file": path, "ax": ax}):
        with pytest.raises(InputError):
            plots.plot(swept, **wrong)
    assert path.read_text() == "mine"
    assert plots.plot(swept, path, force=True) == path
