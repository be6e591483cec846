"""The crankshaft's speed as a scene key, and units behind speeds, everywhere a key is given."""

import json
import math

import pytest

from tcc_sim.cli import main
from tcc_sim.cli.ranges import bounds_of_range, spaced, values_of_range
from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene, parse_assignments, parse_profiles, parse_scene

RPM = math.pi / 30.0
FOUR = "/**:\n  ros__parameters:\n    engine:\n      order: 2.0\n"


@pytest.mark.parametrize(("given", "frequency"), [
    ({"engine.speed": 150.0}, 150.0), ({"engine.speed": "1500rpm"}, 1500.0 * RPM),
    ({"engine.speed": " 1500 RPM "}, 1500.0 * RPM), ({"engine.speed": "25hz"}, 50.0 * math.pi),
    ({"engine.speed": "150rad/s", "engine.order": 2.0}, 300.0), ({"engine.frequency": "25hz"}, 50.0 * math.pi),
    ({"engine.speed": "1500rpm", "engine.order": "2"}, 3000.0 * RPM)])
def test_a_speed_sets_the_frequency(given, frequency):
    assert replace(System(), given).engine.frequency == pytest.approx(frequency, rel=1e-15)
    assert load_scene("fig02").with_values(given).value("engine.speed") == pytest.approx(
        frequency / float(given.get("engine.order", 1.0)))


def test_the_scene_and_the_words_of_a_command_line_take_it():
    scene = parse_scene(FOUR + "      speed: 1500rpm\n    initial:\n      slip_speed: 300rpm\n", "four")
    assert scene.system.engine.frequency == pytest.approx(3000.0 * RPM)
    assert scene.system.initial.slip_speed == pytest.approx(300.0 * RPM)
    assert parse_scene(scene.text(), "again").system == scene.system
    text = "      speed_times: [0.0, 3.0]\n      speed_values: [800rpm, 50hz]\n"
    profile = parse_scene(FOUR + text, "runup").system.engine
    assert profile.frequency_values == pytest.approx((1600.0 * RPM, 200.0 * math.pi))
    again = scene.with_values(parse_profiles(["engine.speed=0:800rpm,3:50hz"])).system.engine
    assert again.frequency_values == pytest.approx(profile.frequency_values)
    assert scene.with_values(parse_assignments(["engine.speed=25hz"])).system.engine.frequency == pytest.approx(
        100.0 * math.pi)


def test_ranges_take_units_of_speeds():
    turn = 2.0 * math.pi
    assert values_of_range("engine.speed=800rpm:3000rpm:3")[1] == pytest.approx([x * RPM for x in (800, 1900, 3000)])
    assert values_of_range("engine.speed=10hz:40hz:3:log")[1] == pytest.approx([x * turn for x in (10, 20, 40)])
    assert values_of_range("engine.frequency=100,25hz")[1] == pytest.approx([100.0, 25.0 * turn])
    assert bounds_of_range("initial.slip_speed=3000rpm:10hz", "--plane")[1:] == pytest.approx((10 * turn, 50 * turn))
    assert spaced("1hz:4hz:3", "--frequencies") == pytest.approx([turn, 2.0 * turn, 4.0 * turn])


@pytest.mark.parametrize(("given", "why"), [
    ({"engine.speed": 1.0, "engine.frequency": 2.0}, "engine.speed and engine.frequency are both given"),
    ({"engine.speed": 1.0, "engine.frequency_times": [0.0], "engine.frequency_values": [1.0]}, "are both given"),
    ({"engine.speed": "fast"}, "it must be a number in rad/s, or one with rpm or hz behind it"),
    ({"engine.speed": "3bar"}, "it must be a number in rad/s"),
    ({"engine.speed_values": [1.0, "x"]}, "it must be a number in rad/s"),
    ({"engine.frequency": "1500rpm"}, "give the crankshaft's speed in rpm as engine.speed=1500rpm"),
    ({"pressure.mean": "3rpm"}, "it must be a number"),
    ({"engine.speed": "0rpm"}, "engine.frequency is 0 rad/s; it must"),
    ({"engine.speeds": 1.0}, "did you mean engine.speed?")])
def test_what_is_no_speed_is_refused(given, why):
    with pytest.raises(InputError, match=why.replace("?", r"\?")):
        load_scene("fig02").with_values(given)


def test_a_sweep_over_the_speed_is_one_over_the_frequency(tmp_path, refused):
    words = ["sweep", "fig02", "--set", "engine.order=2", "--cycles", "12"]
    assert main([*words, "--over", "engine.speed=600rpm:1200rpm:2", "--json", str(tmp_path / "speed.json")]) == 0
    over = f"engine.frequency={1200 * RPM}:{2400 * RPM}:2"
    assert main([*words, "--over", over, "--json", str(tmp_path / "w.json")]) == 0
    speed, frequency = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("speed", "w"))
    assert speed["over"] == "engine.speed"
    assert speed["values"] == pytest.approx([600.0 * RPM, 1200.0 * RPM])
    assert speed["max_slip_speed"] == pytest.approx(frequency["max_slip_speed"], rel=1e-9)
    for path in tmp_path.glob("*.json"):
        path.unlink()
    swept = "sweep", "fig02", "--over", "engine.speed=1:2:3"
    assert "the command itself varies engine.frequency" in refused(*swept, "--set", "engine.frequency=3")
    assert "motions are followed in engine.frequency" in refused("continue", "slip", "--over", "engine.speed=1:2")
