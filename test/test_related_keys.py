"""Scene keys of which one defines another: the crankshaft's speed, profiles, friction tables, numbers of lists."""

import itertools
import json
import math

import numpy as np
import pytest

from tcc_sim import basins, load_scene, scatter, simulate, sweep
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.scene import parse_profiles, parse_scene
from tcc_sim.sweeps.sweep import sweep_grid

RPM = math.pi / 30.0
SPEEDS = {"engine.speed": "1500rpm"}
PROFILE = {"engine.speed_times": [0.0, 3.0], "engine.speed_values": ["800rpm", "50hz"]}


def file_of(engine):
    return "/**:\n  ros__parameters:\n    engine: {" + ", ".join(f"{key}: {value}" for key, value in engine) + "}\n"


@pytest.mark.parametrize(("engine", "changes", "frequency"), [
    ((), {"engine.speed": 150.0}, 150.0), ((), {"engine.speed": " 1500 RPM "}, 1500.0 * RPM),
    ((), {"engine.speed": "25hz", "engine.order": 2}, 100.0 * math.pi),
    ((), {"engine.frequency": "25hz"}, 50.0 * math.pi),
    ((), {"engine.order": 3}, 150.0), ((("order", 2),), {"engine.speed": 60.0}, 120.0),
    ((("speed", "1500rpm"), ("order", "2.0")), {}, 3000.0 * RPM),
    ((("order", "2.0"), ("speed", "1500rpm")), {"engine.order": 3.0}, 4500.0 * RPM),
    ((("order", 2), ("speed", 100)), {"engine.speed": 60.0}, 120.0),
    ((("order", 2), ("speed", 100)), {"engine.order": "4", "engine.speed": 60.0}, 240.0),
    ((("order", 2), ("speed", 100)), {"engine.frequency": 90.0}, 90.0),
    ((("order", 2), ("speed", 100)), {"engine.frequency": 90.0, "engine.order": 3.0}, 90.0),
    ((("order", 2), ("frequency", 90)), {"engine.order": 3.0}, 90.0)])
def test_the_speed_that_was_given_is_kept_and_else_the_frequency(engine, changes, frequency, tmp_path):
    """In a file, in changes of it, in the text of the changed scene, and in what a command works with."""
    path = tmp_path / "four.yaml"
    path.write_text(file_of(engine))
    changed = load_scene(path).with_values(changes)
    again = parse_scene(changed.text(), "four")
    words = [f"--set={key}={value}" for key, value in changes.items()]
    assert main(["explain", str(path), *words, "--json", str(tmp_path / "explained.json")]) == 0
    explained = json.loads((tmp_path / "explained.json").read_text())["scene"]
    for scene in (changed, again):
        assert scene.system == changed.system
        assert scene.system.engine.frequency == pytest.approx(frequency, rel=1e-15)
        assert scene.value("engine.speed") == pytest.approx(frequency / scene.system.engine.order)
        later = scene.with_values({"engine.order": 7.0}).system.engine.frequency
        given = "engine.speed" in changes or (dict(engine).get("speed") and "engine.frequency" not in changes)
        assert later == pytest.approx(7.0 * frequency / scene.system.engine.order if given else frequency)
    assert explained["engine.frequency"] == changed.system.engine.frequency


def test_the_profile_of_the_speed_follows_the_order_too():
    scene = load_scene("fig02").with_values({**PROFILE, "engine.order": 2.0})
    for order in (2.0, 3.0):
        changed = scene.with_values({"engine.order": order})
        for each in (changed, parse_scene(changed.text(), "again")):
            assert each.system.engine.frequency_values == pytest.approx((800 * RPM * order, 100 * math.pi * order))
            assert each.system == changed.system
    words = scene.with_values(parse_profiles(["engine.speed=0:800rpm,3:50hz"]))
    assert words.system == scene.system
    kept = scene.with_values({"engine.frequency_times": [0.0], "engine.frequency_values": [90.0]})
    assert kept.with_values({"engine.order": 5.0}).system.engine.frequency_values == (90.0,)


@pytest.mark.parametrize(("given", "words"), [
    ({"engine.speed": 1.0, "engine.frequency": 2.0}, ("engine.speed", "engine.frequency")),
    ({"engine.speed": 1.0, "engine.frequency_times": [0.0], "engine.frequency_values": [1.0]},
     ("engine.speed", "engine.frequency_times")),
    ({"engine.frequency": 1.0, **PROFILE}, ("engine.frequency", "engine.speed_times")),
    ({"engine.speed": "fast"}, ("engine.speed", "'fast'", "rad/s", "rpm", "hz")),
    ({"engine.speed": "3bar"}, ("engine.speed", "3bar", "rad/s")),
    ({"engine.speed_values": [1.0, "x"]}, ("engine.speed_values", "'x'", "rad/s")),
    ({"engine.frequency": "1500rpm"}, ("engine.frequency", "1500rpm", "engine.speed")),
    ({"pressure.mean": "3rpm"}, ("pressure.mean", "3rpm")),
    ({"engine.speed": "0rpm"}, ("engine.frequency", "0 rad/s", "0.001 to 100000 rad/s")),
    ({"engine.speeds": 1.0}, ("engine.speeds", "engine.speed?"))])
def test_a_speed_that_is_none_or_given_twice_is_refused(given, words):
    with pytest.raises(InputError) as caught:
        load_scene("fig02").with_values(given)
    assert all(word in str(caught.value) for word in words)


COLD = {"cycles": 12, "discard": 4}
ORDERS = [1.0, 2.0, 3.0]


def largest(order, speed=100.0, scene="stick", **set_):
    """Largest slip speed of one run, whose frequency is given as such."""
    values = {"engine.frequency": order * speed, "engine.mean_torque": 330.0, **set_}
    return simulate(scene, set=values, **COLD).summary.max_slip_speed


@pytest.mark.parametrize("speed", ["engine.speed=100", "engine.speed=955rpm"])
def test_a_sweep_over_the_order_is_one_over_the_frequency(speed, tmp_path):
    words = ["sweep", "stick", "--set", speed, "--set", "engine.mean_torque=330", "--cycles", "12", "--discard", "4"]
    assert main([*words, "--over", "engine.order=1,2,3", "--json", str(tmp_path / "a.json")]) == 0
    exact = 955.0 * RPM if "rpm" in speed else 100.0
    rows = json.loads((tmp_path / "a.json").read_text())["max_slip_speed"]
    assert rows == pytest.approx([largest(order, exact) for order in ORDERS], rel=1e-4)
    assert len(set(rows)) == 3


def test_grids_and_scatters_of_order_and_speed_are_single_runs():
    scene = load_scene("stick").with_values({"engine.mean_torque": 330.0, "engine.speed": 60.0})
    speeds = [80.0, 100.0]
    truth = np.array([[largest(order, speed) for order in ORDERS] for speed in speeds])
    for direction, expected in ((("engine.order", ORDERS, "engine.speed", speeds), truth),
                                (("engine.speed", speeds, "engine.order", ORDERS), truth.T)):
        grid = sweep_grid(scene, *direction, **COLD)
        np.testing.assert_allclose([each.column("max_slip_speed") for each in grid.sweeps], expected, rtol=1e-4)
    for bounds in (["engine.order", "engine.speed"], ["engine.speed", "engine.order"]):
        result = scatter(scene, {key: (1.0, 3.0) if key == "engine.order" else (80.0, 100.0) for key in bounds}, 3,
                         **COLD)
        truths = [largest(*pair) for pair in zip(*(result.columns()[key] for key in ("engine.order", "engine.speed")))]
        np.testing.assert_allclose(result.result("max_slip_speed")[:, 0], truths, rtol=1e-4)
    result = scatter(scene, {"engine.order": (1.0, 3.0)}, 2, over="engine.speed", values=speeds, **COLD)
    orders = result.tolerances.sampled["engine.order"]
    np.testing.assert_allclose(result.result("max_slip_speed"),
                               [[largest(order, speed) for speed in speeds] for order in orders], rtol=1e-4)


def test_basins_over_the_order_are_those_over_the_frequency():
    plane = [("initial.slip_speed", (0.0, 20.0)), ("initial.plate_angle", (0.0, 0.1))]
    scene = load_scene("stick").with_values({"engine.speed": 100.0})
    by_order = basins(scene, plane, over=("engine.order", [1.0, 2.0]))
    by_frequency = basins("stick", plane, over=("engine.frequency", [100.0, 200.0]))
    for one, other in zip(by_order, by_frequency):
        np.testing.assert_array_equal([each.section for each in one.attractors],
                                      [each.section for each in other.attractors])


def test_points_on_disk_are_those_of_the_same_rule(tmp_path):
    """The frequency is the same in both commands, but only one of them changes it with the order."""
    words = ["sweep", "stick", "--cycles", "12", "--over", "engine.order=1,2", "--out", str(tmp_path / "points.jsonl")]
    assert main([*words, "--set", "engine.speed=100"]) == 0
    assert main([*words, "--set", "engine.frequency=100"]) == 2


SPEED, FREQUENCY, ORDER = "engine.speed=90:100:2", "engine.frequency=90:100:2", "engine.order=1:2:2"


@pytest.mark.parametrize("words", [
    ("sweep", "fig02", "--over", SPEED, "--over", FREQUENCY), ("sweep", "fig02", "--over", FREQUENCY, "--over", SPEED),
    ("sweep", "fig02", "--over", SPEED, "--set", "engine.frequency=3"),
    ("sweep", "fig02", "--over", FREQUENCY, "--set", "engine.speed=3"),
    ("sweep", "fig02", "--over", SPEED, "--scatter", "engine.frequency=90:100", "--samples", "2"),
    ("sweep", "fig02", "--scatter", "engine.speed=90:100", "--scatter", "engine.frequency=90:100", "--samples", "2"),
    ("sweep", "runup", "--over", SPEED), ("sweep", "runup", "--over", FREQUENCY),
    ("simulate", "runup", "--set", "engine.speed=3"), ("simulate", "tip_in", "--set", "engine.mean_torque=3"),
    ("explain", "apply", "--set", "pressure.mean=3"), ("linearise", "runup", "--set", "engine.frequency=3"),
    ("simulate", "runup", "--set", "engine.speed=3", "--profile", "engine.speed=0:3,1:4"),
    ("continue", "slip", "--over", "engine.speed=1:2"), ("continue", "slip", "--over", "engine.order=1:2"),
    ("continue", "slip", "--set", "engine.speed=100", "--over", "engine.order=1:2"),
    ("continue", "slip", "--over", "engine.mean_torque=1:2", "--second", "engine.speed=1:2"),
    ("sweep", "aged_fluid", "--over", "friction.kinetic_coefficient=0.1:0.2:2"),
    ("sweep", "aged_fluid", "--over", "friction.coefficients=0.9:1.1:2", "--over", "friction.coefficients[2]=0.1,0.2"),
    ("continue", "aged_fluid", "--over", "friction.decay=1:2"),
    ("simulate", "aged_fluid", "--set", "friction.static_coefficient=0.2"),
    ("simulate", "fig02", "--set", "friction.coefficients=[0.1]"),
    ("explain", "fig02", "--set", "friction.table=x.csv", "--set", "friction.coefficients=[0.1]")])
def test_a_key_that_another_one_defines_is_refused(words, refused):
    line = refused(*words)
    assert any(word.partition("=")[0].split(".")[-1] in line for word in words if "=" in word)


@pytest.mark.parametrize("verb", ["simulate", "explain", "sweep"])
def test_a_table_beside_coefficients_warns_of_those_that_it_replaces(verb, tmp_path):
    table, out = tmp_path / "t.csv", tmp_path / "out.json"
    table.write_text("slip_speed,coefficient\n0,0.12\n2,0.13\n10,0.14\n40,0.14\n")
    words = [f"--set=friction.table={table}", "--set=friction.kinetic_coefficient=0.2", "--json", str(out)]
    more = {"simulate": ["--cycles", "3"], "sweep": ["--cycles", "12", "--over", "engine.mean_torque=1:2:2"]}
    assert main([verb, "fig02", *words, *more.get(verb, [])]) == 0
    assert any("friction.kinetic_coefficient" in each for each in json.loads(out.read_text())["warnings"])


def test_one_number_of_a_list_is_that_of_the_list():
    scene = load_scene("fig02").with_values({"engine.harmonic_amplitudes": [5.0, 6.0],
                                             "engine.harmonic_phases": [0.0, 0.0]})
    for n, value in itertools.product((1, 2), (7.0, "8")):
        whole = [5.0, 6.0]
        whole[n - 1] = float(value)
        changed = scene.with_values({f"engine.harmonic_amplitudes[{n}]": value})
        assert changed.system.engine.harmonic_amplitudes == tuple(whole)
    result = sweep(scene, "engine.harmonic_amplitudes[2]", [6.0, 60.0], **COLD).column("max_slip_speed")
    whole = [simulate(scene, set={"engine.harmonic_amplitudes": [5.0, x]}, **COLD).summary.max_slip_speed
             for x in (6.0, 60.0)]
    np.testing.assert_allclose(result, whole, rtol=1e-4)
