"""Speeds in the requested units: factors by hand, axes by their tick labels."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.shown_units import engine_speed, frequency, key_unit, show_in, shown_axis, shown_in, shown_unit, speed

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from tcc_sim.views import style


@pytest.fixture(autouse=True)
def _rad_again():
    yield
    show_in("rad", 1.0)


RPM, HZ = 30.0 / math.pi, 0.5 / math.pi


@pytest.mark.parametrize(("units", "unit", "other", "engine", "slip_axis", "engine_axis", "frequency_axis"), [
    ("rad", ("rad/s", 1.0), "2 rad/s", "engine frequency 2 to 4 rad/s", ("slip speed (rad/s)", 1.0),
     ("engine frequency (rad/s)", 1.0), ("angular frequency (rad/s)", 1.0)),
    ("rpm", ("rpm", RPM), "0.31831 Hz", "engine speed 9.5493 to 19.0986 rpm", ("slip speed (rpm)", RPM),
     ("engine speed (rpm)", RPM / 2.0), ("frequency (Hz)", HZ)),
    ("hz", ("Hz", HZ), "0.31831 Hz", "engine frequency 0.31831 to 0.63662 Hz", ("slip speed (Hz)", HZ),
     (r"excitation frequency $\omega/2\pi$ (Hz)", HZ), ("frequency (Hz)", HZ))])
def test_every_kind_of_speed_in_every_unit(units, unit, other, engine, slip_axis, engine_axis, frequency_axis):
    with shown_in(units, 2.0):
        assert shown_unit() == unit
        assert shown_unit("N m", engine=True) == ("N m", 1.0)
        assert frequency(2.0) == other
        assert engine_speed(2.0, last=4.0) == engine
        assert key_unit("initial.slip_speed") == unit
        assert key_unit("engine.frequency") == shown_unit(engine=True)
        assert key_unit("no.key") == ("", 1.0)
        for quantity, shown in ((("slip speed", "rad/s"), slip_axis), (("any name", "rad/s", "engine"), engine_axis),
                                (("angular frequency", "rad/s", "other"), frequency_axis),
                                (("torque", "N m"), ("torque (N m)", 1.0)), (("crank order",), ("crank order", 1.0))):
            label, factor = shown_axis(*quantity)
            assert factor == shown[1]
            assert label == shown[0].replace("engine frequency", "any name")
        show_in()  # Changes nothing.
        assert shown_unit(engine=True)[1] == pytest.approx(unit[1] / (2.0 if units == "rpm" else 1.0))
        show_in(order=4.0)
        assert shown_unit(engine=True)[1] == pytest.approx(unit[1] / (4.0 if units == "rpm" else 1.0))
    assert (shown_unit(), speed(2.0, 3, 2.0)) == (("rad/s", 1.0), "2 to 2 rad/s")  # As it was before.
    show_in("rpm")
    assert shown_unit(engine=True) == ("rpm", RPM)


@pytest.mark.parametrize(("units", "words", "status"), [
    ("rpm", ["explain", "slip", "--plot", "a.png", "--style", "a.mplstyle"], 0),
    ("rad", ["explain", "slip", "--set", "engine.frequency=100"], 0), ("rpm", ["explain", "no_scene"], 2)])
def test_the_units_and_the_style_of_a_command_end_with_it(units, words, status, tmp_path, monkeypatch, capsys,
                                                          pictures):
    (tmp_path / "a.mplstyle").write_text("lines.linewidth: 7\n")
    monkeypatch.chdir(tmp_path)
    with shown_in("hz", 3.0):
        assert main([*words, "--units", units]) == status
        assert (speed(2.0 * math.pi), shown_axis("", "rad/s", "engine")[1]) == ("1 Hz", 0.5 / math.pi)
    assert (speed(1.0), engine_speed(1.0)) == ("1 rad/s", "engine frequency 1 rad/s")
    import matplotlib

    with style.figure():
        assert matplotlib.rcParams["lines.linewidth"] < 7.0


def test_axes_keep_their_data_and_change_their_ticks():
    show_in("rpm", 2.0)
    with style.figure() as drawn:
        one, other = drawn.subplots(2, 1)
        one.plot([100.0, 600.0], [0.0, 100.0])
        style.quantities(one, style.ENGINE, style.SLIP)
        other.plot([0.0, 1.0], [0.0, 1.0])
        style.quantities(other, style.TIME, style.AxisQuantity("slip speed", "dB re 1 rad/s"))
        drawn.canvas.draw()
        assert (one.get_xlabel(), one.get_ylabel()) == ("engine speed (rpm)", "slip speed (rpm)")
        assert (other.get_xlabel(), other.get_ylabel()) == ("time (s)", "slip speed (dB re 1 rad/s)")
        np.testing.assert_array_equal(one.lines[0].get_xdata(), [100.0, 600.0])
        for axis, factor in ((one.xaxis, 30.0 / math.pi / 2.0), (one.yaxis, 30.0 / math.pi)):
            places, labels = axis.get_majorticklocs(), [label.get_text() for label in axis.get_majorticklabels()]
            np.testing.assert_allclose([float(label) for label in labels], places * factor, rtol=1e-5, atol=1e-9)
            np.testing.assert_allclose(places * factor / 10.0, np.round(places * factor / 10.0), atol=1e-9)


@pytest.mark.parametrize("words", [
    ["simulate", "slip", "--cycles", "20", "--spectrum"], ["simulate", "slip", "--duration", "2", "--orders"],
    ["explain", "slip"],
    ["sweep", "slip", "--over", "engine.frequency=100,200", "--cycles", "20"],
    ["sweep", "slip", "--scatter", "initial.slip_speed=100:200", "--samples", "2", "--cycles", "20"],
    ["linearise", "slip", "--slip", "20", "--frequencies", "5:50:3"]])
def test_a_command_prints_rpm_and_no_speed_in_si(words, capsys):
    assert main([*words, "--units", "rpm"]) == 0
    said = re.sub(r"N m s/rad|s/rad|rad/s\^2", "", capsys.readouterr().out)
    assert "rpm" in said
    assert "rad/s" not in said


def test_a_sweep_prints_engine_speeds_of_the_crankshaft(capsys):
    words = ["sweep", "slip", "--set", "engine.order=2", "--over", "engine.frequency=104.71976,209.43952", "--cycles",
             "20"]
    assert main(words) == 0
    plain = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert main([*words, "--units", "rpm"]) == 0
    shown = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert (plain[1], shown[1]) == (["rad/s", "rad/s", "periods"], ["rpm", "rpm", "periods"])
    assert [float(row[0]) for row in shown[2:]] == pytest.approx([500.0, 1000.0])
    for one, other in zip(plain[2:], shown[2:]):
        assert float(other[1]) == pytest.approx(float(one[1]) * 30.0 / math.pi, rel=1e-6)
        assert other[2:] == one[2:]


def test_a_four_cylinder_scene_comes_to_three_pictures_by_the_page_alone(tmp_path, monkeypatch, pictures):
    """The scene and the commands are those of the page."""
    text = (Path(__file__).parents[2] / ".github" / "guide" / "manoeuvres.md").read_text()
    part = text[text.index("## In rpm and crank orders"):text.index("## Spectra of steady states")]
    monkeypatch.chdir(tmp_path)
    Path("four.yaml").write_text(part.split("```yaml\n")[1].split("```")[0])
    commands = [line.split()[1:] for line in part.splitlines() if line.startswith("    tcc-sim ")]
    for words in commands:
        assert main(words) == 0
    assert len(list(tmp_path.glob("*.png"))) == sum("--plot" in words for words in commands) == 3
