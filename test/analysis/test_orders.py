"""Orders and spectra against closed forms: sines of known amplitude, pure stick, noise, slow ramps, period two."""

import dataclasses
import json
import math

import numpy as np
import pytest

from tcc_sim.analysis.measured.orders import OrderComparison, orders_of, spectrum_of
from tcc_sim.analysis.measured.signals import Signals
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.output.samples import write_trajectory
from tcc_sim.output.tables import comparison_lines
from tcc_sim.replay.given_inputs import driven_by
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve

HARDLY = {"friction.kinetic_coefficient": 0.2999}
"""mu_k as good as mu_s, with the kernels of scenes in which it is not."""


def ramp(scene, low, high, seconds):
    return load_scene(scene).with_values({"engine.frequency_times": [0.0, seconds],
                                          "engine.frequency_values": [low, high], **HARDLY})


def test_order_one_of_a_stuck_clutch_is_the_closed_form():
    scene = ramp("stick", 200.0, 205.0, 10.0)
    orders = orders_of(solve(scene, duration=10.0, samples_per_cycle=64))
    d, omega = scene.system.driveline, orders.frequency
    inertia = d.flywheel_inertia + d.plate_inertia
    spring = d.stiffness + 1j * omega * d.damping
    exact = np.abs(spring / (spring - inertia * omega**2))
    np.testing.assert_allclose(orders.transmissibility[5:, 0], exact[5:], rtol=1e-3)
    np.testing.assert_allclose(orders.cut(1.0)[5:], 250.0 * exact[5:], rtol=1e-3)
    assert orders.judder.breakaways.max() == 0.0


def test_a_recording_has_the_orders_of_the_run_that_it_holds(tmp_path):
    scene = ramp("minimal", 80.0, 160.0, 2.0)
    run = solve(scene, duration=2.0, samples_per_cycle=48, flywheel_angle=True)
    write_trajectory(tmp_path / "run.mcap", run, scene.text())
    assert main(["analyse", str(tmp_path / "run.mcap"), "--orders", "--json", str(tmp_path / "a.json")]) == 0
    result, recorded_orders = json.loads((tmp_path / "a.json").read_text())["orders"], orders_of(run)
    np.testing.assert_allclose(result["shaft_torque"], recorded_orders.shaft_torque[:len(result["time"])], atol=1e-3)
    np.testing.assert_allclose(result["transmissibility"], recorded_orders.transmissibility[:len(result["time"])],
                               rtol=1e-4)


def test_the_orders_are_those_of_the_torque_that_was_given(tmp_path):
    """A table drives the second order alone, of a stuck clutch: the closed form at twice the engine's frequency."""
    scene = load_scene("stick").with_values(HARDLY)
    omega, t = scene.system.engine.frequency, np.arange(0.0, 4.0, 5e-4)
    table = tmp_path / "second.csv"
    rows = np.column_stack([t, 300.0 + 20.0 * np.sin(2.0 * omega * t)])
    np.savetxt(table, rows, delimiter=",", header="t,engine_torque", comments="", fmt="%.17g")
    orders = orders_of(solve(driven_by(scene, table), duration=3.9, samples_per_cycle=64))
    assert orders.torque_order.tolist() == [2.0]
    d = scene.system.driveline
    inertia, spring = d.flywheel_inertia + d.plate_inertia, d.stiffness + 2j * omega * d.damping
    exact = abs(spring / (spring - inertia * (2.0 * omega) ** 2))
    np.testing.assert_allclose(orders.transmissibility[-3:, 0], exact, rtol=5e-3)


def signals(slip, shaft, cycles, per_cycle=256):
    """Signals of the default system, whose excitation has 150 rad/s, as functions of the phase in cycles."""
    system = System()
    turns = np.arange(cycles * per_cycle + 1) / per_cycle

    def at(t):
        u = t / system.cycle
        return slip(u), shaft(u), np.zeros_like(t)

    return Signals(system, turns, lambda u: u * system.cycle, at, None, None, turns * system.cycle, 0.0 * turns)


def test_a_stuck_clutch_has_the_line_of_the_closed_form(tmp_path):
    out = tmp_path / "stick.json"
    assert main(["simulate", "stick", "--cycles", "300", "--spectrum", "--json", str(out)]) == 0
    document = json.loads(out.read_text())
    spectrum = document["spectrum"]
    spring = 3000.0 + 1j * 50.0 * 0.6
    exact = 250.0 * abs(spring / (spring - 0.22 * 50.0**2))
    assert spectrum["order"][1] == 1.0
    assert spectrum["shaft_torque"][1] == pytest.approx(exact, rel=1e-3)
    assert spectrum["shaft_torque"][0] == pytest.approx(300.0, rel=1e-4)
    assert max(spectrum["shaft_torque"][2:]) < 0.2
    assert spectrum["period"] == 1
    assert spectrum["subharmonics"] == []
    assert document["units"]["spectrum.shaft_torque"] == "N m"


def test_a_motion_of_period_two_has_half_orders_and_sections_with_three_states(tmp_path, pictures):
    out, picture, samples = tmp_path / "two.json", tmp_path / "two.png", tmp_path / "two.npz"
    words = ["simulate", "fig02", "--cycles", "600", "--discard", "500", "--set", "initial.slip_speed=300"]
    assert main([*words, "--spectrum", "--json", str(out), "--plot", str(picture), "--out", str(samples),
                 "--samples", "4"]) == 0
    document = json.loads(out.read_text())
    assert document["spectrum"]["period"] == document["period"] == 2
    assert {0.5, 1.5} <= set(document["spectrum"]["subharmonics"])
    assert not any(float(order).is_integer() for order in document["spectrum"]["subharmonics"])
    assert [state[:2] for state in document["section_states"]] == document["section"]
    with np.load(samples) as arrays:
        np.testing.assert_allclose(arrays["section_states"][-2:][np.argsort(arrays["section_states"][-2:, 0])],
                                   sorted(document["section_states"]), rtol=1e-6)
        np.testing.assert_allclose(arrays["section_states"][:, 2], arrays["plate_speed"][::4], atol=1e-6)


def test_what_has_no_steady_state_is_refused(capsys):
    assert main(["simulate", "runup", "--spectrum"]) == 2
    assert "a spectrum needs a periodic excitation" in capsys.readouterr().err
    with pytest.raises(InputError, match="a spectrum needs 16 whole cycles of the excitation, and there are 5"):
        spectrum_of(signals(np.sin, np.sin, 5), 0)


def at_150(slip, shaft, torque, seconds, begin=0.0, per_cycle=64, **more):
    """Signals of an engine of order 2 at 150 rad/s from `begin` periods on, as functions of the number of periods."""
    system = replace(System(), {"engine.order": 2.0})
    turns = begin + np.arange(round(seconds / system.cycle * per_cycle) + 1) / per_cycle

    def at(t):
        u = t / system.cycle
        return slip(u), shaft(u), torque(u)

    t = turns * system.cycle
    return Signals(system, turns, lambda u: u * system.cycle, at, more.pop("driven", None),
                   more.pop("breakaways", None), t, 7.0 * t, **more)


def wave(order, size, lead=0.3):
    return lambda u: size * np.sin(2.0 * np.pi * order * u + lead)


def test_every_figure_of_orders_is_that_of_the_sines():
    """Windows of 16 periods, each 4 after the one before, of which the second half of the last is missing."""
    system, cycle = replace(System(), {"engine.order": 2.0}), 2.0 * np.pi / 150.0
    middles = (2.0 + 8.0 + 4.0 * np.arange(5)) * cycle
    broke = np.array([1.0, 3.0, 3.5, 19.0, 25.0, 40.0]) * cycle
    found = orders_of(at_150(
        lambda u: -3.0 + wave(1.0, 2.0)(u) + wave(2.5, 0.5)(u),
        lambda u: 40.0 + wave(1.0, 9.0)(u) + wave(3.0, 4.0)(u),
        lambda u: 200.0 + wave(1.0, 60.0)(u) + wave(2.0, 20.0)(u) + wave(4.0, 2.9)(u), 34.5 * cycle, 2.0,
        breakaways=broke))
    assert found.time == pytest.approx(middles)
    assert found.frequency == pytest.approx(np.full(5, 150.0))
    assert found.order == pytest.approx(2.0 * np.arange(161) / 16.0)
    for name, sines in (("slip_speed", {0.0: 3.0, 1.0: 2.0, 2.5: 0.5}),
                        ("shaft_torque", {0.0: 40.0, 1.0: 9.0, 3.0: 4.0})):
        for order, size in sines.items():
            assert found.cut(2.0 * order, name) == pytest.approx(np.full(5, size))
            if order:   # Hann's window spreads a line to its neighbours by a half.
                assert found.cut(2.0 * order + 0.125, name) == pytest.approx(np.full(5, 0.5 * size))
        assert found.cut(10.0, name) == pytest.approx(np.zeros(5), abs=1e-9)
    assert found.torque_order.tolist() == [2.0, 4.0]   # 2.9 is below a twentieth of 60.
    assert found.transmissibility == pytest.approx(np.tile([9.0 / 60.0, 0.0], (5, 1)), abs=1e-9)
    u = np.arange(640) / 64.0
    slip = wave(1.0, 2.0)(u) + wave(2.5, 0.5)(u)
    apart = (slip.reshape(-1, 64) - slip.reshape(-1, 64).mean(axis=1, keepdims=True)).ravel()
    assert found.judder.rms == pytest.approx(np.full(5, np.sqrt(np.mean(apart**2))))
    assert found.judder.peak == pytest.approx(np.full(5, np.abs(apart).max()))
    counts = [np.count_nonzero((broke >= (2 + 4 * k) * cycle) & (broke < (18 + 4 * k) * cycle)) for k in range(5)]
    assert found.judder.breakaways == pytest.approx(np.array(counts) / (16.0 * cycle))
    assert found.heat == pytest.approx(7.0 * middles)
    assert (found.per_revolution, found.left_out, found.cuts) == (2.0, 0, [2.0, 4.0, 6.0, 8.0])
    d = system.driveline
    assert found.modes == pytest.approx((math.sqrt(d.stiffness / (d.flywheel_inertia + d.plate_inertia)),
                                         math.sqrt(d.stiffness / d.plate_inertia)), rel=1e-2)
    assert repr(found) == "<Orders: 5 windows, 150 to 150 rad/s, orders up to 20>"
    columns = found.columns()
    assert list(columns) == ["time", "frequency", "rms", "peak", "breakaways", "heat",
                             *(f"shaft_torque_{order}" for order in (2, 4, 6, 8))]
    assert columns["shaft_torque_6"] == pytest.approx(np.full(5, 4.0))


def test_windows_that_touch_a_hole_are_left_out_and_blank():
    """A hole within period 30 touches the windows from periods 16, 20, 24 and 28 on."""
    cycle = 2.0 * np.pi / 150.0
    holes = np.array([[30.2, 30.6]]) * cycle
    found = orders_of(at_150(wave(1.0, 2.0), wave(1.0, 9.0), wave(1.0, 60.0), 64.0 * cycle, holes=holes))
    begins = np.array([0, 4, 8, 12, *range(32, 52, 4)])
    assert found.time == pytest.approx((begins + 8.0) * cycle)
    assert found.left_out == 4
    blank = found.with_blanks()
    assert blank.time == pytest.approx((np.arange(13) * 4.0 + 8.0) * cycle)
    assert blank.frequency == pytest.approx(np.full(13, 150.0))
    known = [k not in (4, 5, 6, 7) for k in range(13)]
    for values in (blank.slip_speed[:, 0], blank.shaft_torque[:, 3], blank.transmissibility[:, 0], blank.heat,
                   blank.judder.rms, blank.judder.peak):
        assert np.isfinite(values).tolist() == known
    assert blank.cut(2.0)[5:9] == pytest.approx([*[math.nan] * 3, 9.0], nan_ok=True)
    whole = orders_of(at_150(wave(1.0, 2.0), wave(1.0, 9.0), wave(1.0, 60.0), 30.0 * cycle))
    assert whole.with_blanks() is whole
    part = found.part(np.array([1, 4]), 33)
    assert (part.time, part.order[-1], part.slip_speed.shape) == (pytest.approx(found.time[[1, 4]]), 4.0, (2, 33))
    assert (part.heat, part.judder.rms) == (pytest.approx(found.heat[[1, 4]]), pytest.approx(found.judder.rms[[1, 4]]))


@pytest.mark.parametrize(("periods", "per_cycle", "sentence"), [
    (15.9, 64, "16 periods .* 15"), (20.0, 7.9, r"8 samples .* 7\.95")])
def test_the_least_run_and_the_fewest_samples_of_orders(periods, per_cycle, sentence):
    cycle = 2.0 * np.pi / 150.0
    with pytest.raises(InputError, match=sentence):
        orders_of(at_150(wave(1.0, 2.0), wave(1.0, 9.0), wave(1.0, 60.0), periods * cycle, per_cycle=per_cycle))
    least = orders_of(at_150(wave(1.0, 2.0), wave(1.0, 9.0), wave(1.0, 60.0), 16.0 * cycle, per_cycle=8.0))
    assert (len(least.time), least.order[-1]) == (1, 4.0)


def test_a_density_is_that_of_hanns_window():
    """One window of 40 cycles, by sums over its samples, with the mean of the run removed."""
    level = np.random.default_rng(3).standard_normal(256 * 40 + 1)
    turns = np.arange(len(level)) / 256.0
    noise = signals(lambda u: np.interp(u, turns, 3.0 + level), lambda u: np.interp(u, turns, level), 40)
    spectrum, cycle = spectrum_of(noise, 0), 2.0 * np.pi / 150.0
    hann = np.sin(np.pi * turns[:-1] / 40.0) ** 2
    for k in (0, 1, 17, 240, 400):
        line = np.sum((level[:-1] - level[:-1].mean()) * hann * np.exp(-2j * np.pi * k / 40.0 * turns[:-1]))
        density = abs(line) ** 2 * cycle / 256.0 / np.sum(hann**2) * (2.0 if k else 1.0)
        assert spectrum.slip_speed_density[k] == pytest.approx(density, rel=1e-6)
        assert spectrum.shaft_torque_density[k] == pytest.approx(density, rel=1e-6)
    assert spectrum.frequency == pytest.approx(150.0 * np.arange(401) / 40.0)
    assert repr(spectrum).startswith("<Spectrum: 401 densities up to order 10; Hann of 40 cycles, half of each shared")
    assert list(spectrum.columns()) == ["frequency", "order", "slip_speed_density", "shaft_torque_density"]


@pytest.mark.parametrize(("period", "last", "cycles", "begin"), [
    (2, None, 6, 1), (3, None, 6, 1), (1, 4, 4, 3), (2, 5, 4, 3)])
def test_whole_periods_at_the_end_are_transformed(period, last, cycles, begin):
    """Of seven cycles."""
    found = spectrum_of(signals(lambda u: 3.0 + wave(1.0, 2.0)(u), lambda u: wave(2.0, 0.1)(u) + wave(0.5, 4.0)(u), 7),
                        period, last)
    cycle, many = 2.0 * np.pi / 150.0, cycles // period
    assert found.window == (f"none: {many} whole period{'s' * (many > 1)} of the motion, {begin * cycle:.6g} to "
                            f"{7 * cycle:.6g} s")
    assert (found.period, found.order[-1], len(found.order)) == (period, 10.0, 10 * period + 1)
    assert found.slip_speed[[0, period]] == pytest.approx([3.0, 2.0])
    assert period != 2 or found.subharmonics.tolist() == [0.5]
    assert repr(found).startswith(f"<Spectrum: {10 * period + 1} lines up to order 10; none: ")


def test_simulated_orders_are_compared_with_measured_ones_in_decibels() -> None:
    """Twice the amplitude is 6.02 dB; an order that was not measured is not compared."""
    measured, simulated = (orders_of(at_150(wave(1.0, 2.0 * factor), wave(1.0, 9.0), wave(1.0, 60.0), 30.0 * 2.0 * np.pi
                                            / 150.0)) for factor in (1.0, 2.0))
    measured = dataclasses.replace(measured, shaft_torque=np.nan * measured.shaft_torque)
    lines = comparison_lines(OrderComparison(measured, simulated))
    slip, torque = (next(line for line in lines if f"order 2 of {name}" in line) for name in ("slip", "shaft"))
    assert "6.02 dB" in slip
    assert "dB" not in torque
