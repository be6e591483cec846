"""Speeds in the units that are asked for: factors by hand, axes by their tick labels."""

import math
from pathlib import Path

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.output.shown_units import in_words, show_in

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from tcc_sim.views import style
from tcc_sim.views.unit_axes import on_axes


@pytest.fixture(autouse=True)
def _rad_again():
    yield
    show_in("rad")


def test_lines_are_converted_number_by_number():
    text = "largest 104.71976 rad/s; engine frequency 60 to 600 rad/s; 3 rad/s^2; 2 N m s/rad; (rad/s)^2/Hz"
    assert in_words(text) == text
    show_in("hz")
    assert in_words(text).startswith("largest 16.666667 Hz; engine frequency 9.5493 to 95.493 Hz; 3 rad/s^2; 2 N m s/")
    show_in("rpm", 2.0)
    assert in_words(text).startswith("largest 1000 rpm; engine speed 286.48 to 2864.8 rpm; 3 rad/s^2")


def test_axes_keep_their_data_and_change_their_ticks():
    show_in("rpm", 2.0)
    with style.figure() as drawn:
        one, other = drawn.subplots(2, 1)
        one.plot([100.0, 600.0], [0.0, 100.0])
        one.set(xlabel="engine frequency (rad/s)", ylabel="slip speed (rad/s)")
        other.plot([0.0, 1.0], [0.0, 1.0])
        other.set(xlabel="time (s)", ylabel="slip speed, dB re 1 rad/s")
        on_axes(drawn)
        drawn.canvas.draw()
        assert (one.get_xlabel(), one.get_ylabel()) == ("engine speed (rpm)", "slip speed (rpm)")
        assert (other.get_xlabel(), other.get_ylabel()) == ("time (s)", "slip speed, dB re 1 rad/s")
        np.testing.assert_array_equal(one.lines[0].get_xdata(), [100.0, 600.0])
        for axis, factor in ((one.xaxis, 30.0 / math.pi / 2.0), (one.yaxis, 30.0 / math.pi)):
            places, labels = axis.get_majorticklocs(), [label.get_text() for label in axis.get_majorticklabels()]
            np.testing.assert_allclose([float(label) for label in labels], places * factor, rtol=1e-5, atol=1e-9)
            np.testing.assert_allclose(places * factor / 10.0, np.round(places * factor / 10.0), atol=1e-9)


def test_a_command_prints_rpm_and_writes_si(tmp_path, capsys):
    words = ["simulate", "slip", "--cycles", "20", "--json", str(tmp_path / "a.json")]
    assert main([*words, "--units", "rpm", "--plot", str(tmp_path / "a.png")]) == 0
    said = capsys.readouterr().out
    assert "rpm" in said
    assert "rad/s" not in said
    assert main(["simulate", "slip", "--cycles", "20"]) == 0
    assert "rad/s" in capsys.readouterr().out


def test_a_four_cylinder_scene_comes_to_three_pictures_by_the_page_alone(tmp_path, monkeypatch):
    """The scene and the commands are those of the page."""
    text = (Path(__file__).parents[2] / ".github" / "guide" / "manoeuvres.md").read_text()
    part = text[text.index("## In rpm and crank orders"):text.index("## Spectra of steady states")]
    monkeypatch.chdir(tmp_path)
    Path("four.yaml").write_text(part.split("```yaml\n")[1].split("```")[0])
    commands = [line.split()[1:] for line in part.splitlines() if line.startswith("    tcc-sim ")]
    for words in commands:
        assert main(words) == 0
    assert len(list(tmp_path.glob("*.png"))) == len(commands) == 3
