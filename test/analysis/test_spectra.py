"""Spectra against closed forms: lines of a stuck clutch, the power of noise, half orders of a motion of period two."""

import json
import math

import numpy as np
import pytest

from tcc_sim.analysis.signals import Signals
from tcc_sim.analysis.spectra import spectrum_of
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System


def signals(slip, shaft, cycles, per_cycle=256):
    """Signals of the default system, whose excitation has 150 rad/s, as functions of the phase in cycles."""
    system = System()
    turns = np.arange(cycles * per_cycle + 1) / per_cycle

    def at(t):
        u = t / system.cycle
        return slip(u), shaft(u), np.zeros_like(t)

    return Signals(system, turns, lambda u: u * system.cycle, at, None, None, turns * system.cycle, 0.0 * turns)


def test_lines_are_the_amplitudes_of_sines_without_a_window():
    found = spectrum_of(signals(lambda u: 3.0 + 2.0 * np.sin(2 * np.pi * u) + 0.5 * np.cos(np.pi * u),
                                lambda u: 7.0 * np.sin(6.0 * np.pi * u + 0.4), 7), 2)
    lines = dict(zip(found.order.tolist(), zip(found.slip_speed, found.shaft_torque)))
    assert lines[0.0][0] == pytest.approx(3.0)
    assert lines[1.0][0] == pytest.approx(2.0)
    assert lines[0.5][0] == pytest.approx(0.5)
    assert lines[3.0][1] == pytest.approx(7.0)
    others = [slip for order, (slip, _) in lines.items() if order not in (0.0, 0.5, 1.0)]
    assert max(others) < 1e-12
    assert found.subharmonics.tolist() == [0.5]
    assert found.window == "none: 3 whole periods of the motion"
    np.testing.assert_allclose(found.frequency, 150.0 * found.order)


def test_a_density_holds_the_power_of_the_signal():
    """Parseval: the density over frequency in Hz integrates to the variance."""
    draw = np.random.default_rng(3)
    level = draw.standard_normal(256 * 512 + 1)
    turns = np.arange(len(level)) / 256.0

    def noise(u):
        smooth = np.convolve(level, np.ones(64) / 64.0, mode="same")  # No power above the orders that are given.
        return np.interp(u, turns, smooth)

    found = spectrum_of(signals(noise, lambda u: 0.0 * u, 512), 0)
    assert found.slip_speed is None
    assert found.window == "Hann of 64 cycles, half of each shared with the next"
    variance = float(np.var(noise(turns)))
    power = float(np.trapezoid(found.slip_speed_density, found.frequency / (2.0 * math.pi)))
    assert power == pytest.approx(variance, rel=0.05)


def test_a_stuck_clutch_has_the_line_of_the_closed_form(tmp_path):
    out = tmp_path / "stick.json"
    assert main(["simulate", "stick", "--cycles", "300", "--spectrum", "--json", str(out)]) == 0
    found = json.loads(out.read_text())
    spectrum = found["spectrum"]
    spring = 3000.0 + 1j * 50.0 * 0.6
    exact = 250.0 * abs(spring / (spring - 0.22 * 50.0**2))
    assert spectrum["order"][1] == 1.0
    assert spectrum["shaft_torque"][1] == pytest.approx(exact, rel=1e-3)
    assert spectrum["shaft_torque"][0] == pytest.approx(300.0, rel=1e-4)
    assert max(spectrum["shaft_torque"][2:]) < 0.2
    assert spectrum["period"] == 1
    assert spectrum["subharmonics"] == []
    assert found["units"]["spectrum.shaft_torque"] == "N m"


def test_a_motion_of_period_two_has_half_orders_and_sections_with_three_states(tmp_path, figures):
    out, picture, samples = tmp_path / "two.json", tmp_path / "two.png", tmp_path / "two.npz"
    words = ["simulate", "fig02", "--cycles", "600", "--discard", "500", "--set", "initial.slip_speed=300"]
    assert main([*words, "--spectrum", "--json", str(out), "--plot", str(picture), "--out", str(samples),
                 "--samples", "4"]) == 0
    found = json.loads(out.read_text())
    assert found["spectrum"]["period"] == found["period"] == 2
    assert {0.5, 1.5} <= set(found["spectrum"]["subharmonics"])
    assert not any(float(order).is_integer() for order in found["spectrum"]["subharmonics"])
    assert [state[:2] for state in found["section_states"]] == found["section"]
    with np.load(samples) as arrays:
        np.testing.assert_allclose(arrays["section_states"][-2:][np.argsort(arrays["section_states"][-2:, 0])],
                                   sorted(found["section_states"]), rtol=1e-6)
        np.testing.assert_allclose(arrays["section_states"][:, 2], arrays["plate_speed"][::4], atol=1e-6)


def test_a_motion_without_a_period_has_densities(tmp_path, figures):
    out = tmp_path / "chaos.json"
    assert main(["simulate", "chaos", "--spectrum", "--json", str(out), "--plot", str(tmp_path / "chaos.png")]) == 0
    spectrum = json.loads(out.read_text())["spectrum"]
    assert spectrum["period"] == 0
    assert "slip_speed" not in spectrum
    assert len(spectrum["slip_speed_density"]) == len(spectrum["frequency"])


def test_what_has_no_steady_state_is_refused(capsys):
    assert main(["simulate", "runup", "--spectrum"]) == 2
    assert "a spectrum needs a periodic excitation" in capsys.readouterr().err
    with pytest.raises(InputError, match="a spectrum needs 16 whole cycles of the excitation, and there are 5"):
        spectrum_of(signals(np.sin, np.sin, 5), 0)
