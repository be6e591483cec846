"""Recordings made from closed forms give the figures of these forms, complete or damaged."""

import math
import os
import re

import numpy as np
import pytest
from driveline_bags import START, bag, by_hand, ticked
from interpreter import python, rerun_rows

from tcc_sim import plot
from tcc_sim.errors import InputError
from tcc_sim.recording.columns import Window
from tcc_sim.recording.reader import BYTES_A_STATE
from tcc_sim.replay.recorded import read
from tcc_sim.replay.replay import TAIL_CYCLES, replay
from tcc_sim.scene import load_scene

OMEGA, SPEED, LOAD = 150.0, 150.0, 300.0
SWING = 250.0 / (0.2 * OMEGA)
SLIP = (lambda t: SPEED + SWING * (1.0 - np.cos(OMEGA * t)), lambda t: LOAD / 3000.0, lambda t: 0.0,
        lambda t: 300.0 + 250.0 * np.sin(OMEGA * t), lambda t: LOAD)
"""(17a) put right, steady: slip speed, plate angle, plate speed, engine and friction torque."""


def slip(seconds):
    return by_hand(seconds, *SLIP)


def is_slip(summary):
    assert summary.regime == "slip"
    assert summary.period == 1
    assert summary.max_slip_speed == pytest.approx(SPEED + 2.0 * SWING, rel=1e-7)
    assert summary.min_slip_speed == pytest.approx(SPEED, rel=1e-7)
    assert np.allclose(summary.section, [(LOAD / 3000.0, SPEED)], rtol=1e-7)


@pytest.fixture(scope="module")
def slipping(tmp_path_factory):
    """3 s of it as a complete recording."""
    return bag(tmp_path_factory.mktemp("slipping") / "run", slip(3.0), "slip")


@pytest.mark.parametrize("cut", [False, True])
def test_pure_slip_complete_and_cut_short(tmp_path, slipping, cut):
    result = replay(bag(tmp_path / "run", slip(3.0), "slip", cut=True) if cut else slipping)
    is_slip(result.summary)
    values = result.as_json()
    assert (values["messages"], values["lost_messages"], values["complete"]) == (3001, 0, not cut)
    assert (values["cycles"], values["discarded"]) == (71, 35)
    assert (values["frequency"], values["frequency_source"]) == (OMEGA, "scene")
    text = "\n".join(result.lines())
    assert ("cut short" in text) == cut
    assert "no gap" in text
    assert "from the scene" in text


def test_pure_stick(tmp_path):
    omega, response = 50.0, 250.0 / (3000.0 - 0.22 * 50.0**2 + 0.6j * 50.0)

    def angle(t):
        return 0.1 + (response * np.exp(1j * omega * t)).imag

    def speed(t):
        return (1j * omega * response * np.exp(1j * omega * t)).imag

    def friction(t):
        acceleration = (-omega**2 * response * np.exp(1j * omega * t)).imag
        return 0.02 * acceleration + 0.6 * speed(t) + 3000.0 * angle(t)

    rows = by_hand(2.0, lambda t: 0.0 * t, angle, speed, lambda t: 300.0 + 250.0 * np.sin(omega * t), friction)
    summary = replay(bag(tmp_path / "run", rows, "stick"), discard=4).summary
    assert summary.regime == "stick"
    assert summary.stick_fraction == 1.0
    assert summary.max_slip_speed == pytest.approx(0.0, abs=1e-12)
    assert np.allclose(summary.section, [(0.1 + response.imag, 0.0)], atol=1e-9)


def test_every_run_ends_with_a_reset_and_no_cycle_mean_bridges_a_gap(tmp_path):
    """The second of three runs is the longest, and lacks 60 ms."""
    scene = load_scene("fig02")
    rows = ticked(scene, 1500, resets=(300, 1300))
    del rows[700:760]
    control = replay(bag(tmp_path / "run", rows, scene)).control
    assert [(event.text, event.t) for event in control.events] == [("reset or restart", pytest.approx(0.999, abs=2e-3))]
    cycle = scene.system.cycle
    known = np.isfinite(control.mean_slip)
    assert not ((control.t > 0.4) & (control.t - cycle < 0.455))[known].any()
    assert known.sum() == pytest.approx((1.0 - 0.06) / cycle, abs=2.0)
    assert len(known) == known.sum() + 1


def test_the_end_of_the_run_is_kept_for_a_picture(tmp_path, slipping, pictures):
    result = replay(slipping)
    end, cycle = result.trajectory, 2.0 * math.pi / OMEGA
    assert end.t[-1] == 3.0
    assert end.t[0] == pytest.approx(3.0 - TAIL_CYCLES * cycle, abs=1e-3)
    assert np.allclose(end.slip_speed, SLIP[0](end.t), rtol=1e-12)
    assert np.allclose(end.saturation_torque, LOAD)
    assert np.all(end.state == 1)
    assert (len(result.cycles), result.first_cycle) == (71, 0)
    plot(result, tmp_path / "o.png")
    assert len(pictures) == 1


def test_the_frequency_of_a_commanded_torque_is_found_or_given(tmp_path):
    scene = load_scene("commands").with_values({"engine.frequency": 99.0})
    path = bag(tmp_path / "run", slip(3.0), scene)
    result = replay(path)
    assert result.frequency_source == "found"
    assert result.frequency == pytest.approx(OMEGA, rel=1e-6)
    assert result.summary.max_slip_speed == pytest.approx(SPEED + 2.0 * SWING, rel=1e-6)
    given = replay(path, frequency=75.0)
    assert (given.frequency, given.frequency_source) == (75.0, "given")
    assert given.summary.cycles == 35
    constant = by_hand(2.0, *SLIP[:3], lambda t: 300.0, SLIP[4])
    unknown = replay(bag(tmp_path / "constant", constant, scene))
    values = unknown.as_json()
    assert (values["frequency"], values["frequency_source"], values["frequency_range"]) == (None, "none", [None, None])
    assert (values["period"], values["section"], values["cycles"], values["settled"]) == (0, [], 0, False)
    assert values["max_slip_speed"] == pytest.approx(SPEED + 2.0 * SWING, rel=1e-6)
    assert [text for text in unknown.warnings if "cycle" in text] == [
        "periods of excitation could not be identified, so there is no section, period or cycle mean: the engine "
        "torque is constant"]


def test_everything_goes_to_rerun(tmp_path):
    pytest.importorskip("rerun")
    path = tmp_path / "run.rrd"
    replay(bag(tmp_path / "run", slip(2.0) + slip(1.0), "slip"), rrd=path)
    assert python("-m", "rerun_cli", "rrd", "verify", str(path), HOME=str(tmp_path)).returncode == 0
    rows, static = rerun_rows(path), 1
    assert rows["/slip/speed"] == 3002 + static
    assert rows["/cycles/largest"] == 47 + 23 + static
    assert rows["/events"] == 2
    assert rows["/summary"] == 1


def test_a_file_for_rerun_appears_whole_or_not_at_all(tmp_path):
    pytest.importorskip("rerun")
    path = bag(tmp_path / "run", slip(0.02), "slip")
    with pytest.raises(InputError, match="no whole period of excitation"):
        replay(path, rrd=tmp_path / "run.rrd")
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_nothing_of_a_manoeuvre_is_dropped(tmp_path):
    scene = load_scene("minimal").with_values({"engine.frequency_times": [0.0, 1.0],
                                               "engine.frequency_values": [80.0, 160.0]})
    rows = ticked(scene, 1500)
    result = replay(bag(tmp_path / "run", rows, scene))
    assert result.summary.discarded == 0
    assert result.summary.max_slip_speed == pytest.approx(max(abs(row[3] - row[4]) for row in rows), rel=1e-3)


def test_more_than_half_of_the_memory_is_refused_and_a_window_of_it_is_read(tmp_path, slipping, monkeypatch):
    pages = 2 * 2000 * BYTES_A_STATE // os.sysconf("SC_PAGE_SIZE")
    monkeypatch.setattr(os, "sysconf", lambda name, known=os.sysconf: pages if name == "SC_PHYS_PAGES" else known(name))
    for cut in (slipping / "run_0.mcap", tmp_path / "cut.mcap"):
        if not cut.exists():  # Without an index the number of states is unknown.
            cut.write_bytes((slipping / "run_0.mcap").read_bytes()[:-3000])
        with pytest.raises(InputError, match=r"states take .* ask for a window: --from and --to"):
            replay(cut)
        result = replay(cut, window=Window(start=1.0, end=2.5))
        assert result.segments[0].start == 1.0
        assert result.segments[0].end == 2.5
        assert len(read(cut).trajectory(0, 0.5, 0.6).t) == 101


def test_damping_is_refused_before_reading_where_inputs_came_from_topics(tmp_path):
    scene = load_scene("commands")
    path = bag(tmp_path / "driven", ticked(scene, 600, torque=lambda k: 300.0, pressure=lambda k: 240e3), scene)
    with pytest.raises(InputError, match=r"engine\.source is topic"):
        replay(path, damping=True, rrd=tmp_path / "x.rrd")
    assert not (tmp_path / "x.rrd").exists()


@pytest.fixture(scope="module")
def run_up():
    """A commanded run-up from 100 to 160 rad/s in 3 s; the scene states another frequency."""
    scene = load_scene("commands").with_values({"engine.frequency": 150.0, "friction.kinetic_coefficient": 0.27})

    def torque(k):
        t = k * 1e-3
        return 300.0 + 250.0 * math.sin(100.0 * t + 10.0 * t * t)

    return scene, ticked(scene, 3000, torque=torque, pressure=lambda k: 260e3)


@pytest.fixture(scope="module")
def whole(run_up, tmp_path_factory):
    """The run-up without a lost state."""
    return replay(bag(tmp_path_factory.mktemp("whole") / "run", run_up[1], run_up[0]), discard=10)


def test_a_commanded_run_up_is_analysed_at_its_own_frequency(run_up, whole):
    (_, rows), result, values = run_up, whole, whole.as_json()
    assert values["frequency_source"] == "found"
    assert values["frequency_range"] == pytest.approx([100.0, 160.0], rel=0.02)
    starts = result.cycles.starts
    turns = (100.0 * starts + 10.0 * starts * starts) / (2.0 * math.pi)
    # The torque of a tick is held from the tick before.
    assert np.abs(turns - np.rint(turns)).max() < 0.02
    assert len(result.cycles) == pytest.approx(390.0 / (2.0 * math.pi), abs=3)
    v = np.array([row[3] - row[4] for row in rows])
    late = v[round(float(starts[10]) * 1000):]
    assert values["max_slip_speed"] == pytest.approx(np.abs(late).max(), rel=0.02)
    stuck = np.abs(late) <= 0.03
    assert values["stick_fraction"] == pytest.approx(stuck.mean(), abs=0.05)
    assert values["covers"] == pytest.approx([starts[10], rows[-1][0] * 1e-9])
    assert values["lost_seconds"] == 0.0
    text = "\n".join(result.lines())
    assert re.search(r"frequency +1\d\d[.\d]* to \d+[.\d]* rad/s, found", text)


def test_a_commanded_run_up_is_followed_through_single_lost_states(tmp_path, run_up, whole):
    """Every 47th state is lost, so no stretch of two cycles is without a loss."""
    scene, rows = run_up
    kept = [row for k, row in enumerate(rows) if k % 47 != 20]
    result = replay(bag(tmp_path / "run", kept, scene, clock=lambda k: START + kept[k][0]), discard=10)
    assert result.as_json()["frequency_range"] == pytest.approx([100.0, 160.0], rel=0.02)
    assert (result.summary.cycles, result.summary.broken) == (whole.summary.cycles, 0)
    assert result.summary.covers == pytest.approx(whole.summary.covers, abs=1e-3)
    assert result.summary.lost_seconds == pytest.approx(0.002 * 52, abs=0.005)
    assert result.summary.clutch_energy == pytest.approx(whole.summary.clutch_energy * (1.0 - 0.104 / 3.0), rel=0.005)
