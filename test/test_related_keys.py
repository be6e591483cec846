"""Scene keys of which one defines another: the crankshaft's speed, profiles, friction tables, numbers of lists."""

import json
import math
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tcc_sim import closed_loop, load_scene, scatter, simulate, sweep
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.scene import parse_profiles, parse_scene
from tcc_sim.sweeps.sweep import sweep_grid

RPM = math.pi / 30.0
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
    ({"engine.speed_values[2]": 1.0}, ("engine.speed_values[2]", "engine.frequency_values[2]", "engine.order")),
    ({"engine.frequency": "1500rpm"}, ("engine.frequency", "1500rpm", "engine.speed")),
    ({"pressure.mean": "3rpm"}, ("pressure.mean", "3rpm")),
    ({"engine.speed": "0rpm"}, ("engine.frequency", "0 rad/s", "0.001 to 100000 rad/s")),
    ({"engine.speeds": 1.0}, ("engine.speeds", "engine.speed?"))])
def test_a_speed_that_is_none_or_given_twice_is_refused(given, words):
    with pytest.raises(InputError) as caught:
        load_scene("fig02").with_values(given)
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize("words", [
    ("simulate", "fig02", "--inputs", "T.csv", "--set", "engine.mean_torque=3"),
    ("simulate", "fig02", "--inputs", "T.csv", "--profile", "engine.torque_amplitude=0:3"),
    ("identify", "T.csv", "--scene", "fig02", "--free", "driveline.stiffness", "--set", "engine.mean_torque=3")])
def test_data_in_the_place_of_a_key_are_said(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = simulate("fig02", cycles=2, discard=0, samples_per_cycle=30).trajectory
    np.savetxt("T.csv", np.transpose([run.t, run.slip_speed, run.engine_torque]), delimiter=",",
               header="t,slip_speed,engine_torque", comments="")
    assert main([*words, "--json", "out.json"]) in (0, 1)
    key = words[-1].partition("=")[0]
    assert any(key in line for line in json.loads((tmp_path / "out.json").read_text())["warnings"])


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


def test_points_on_disk_are_those_of_the_same_rule(tmp_path):
    """The frequency is the same in both commands, but only one of them changes it with the order."""
    words = ["sweep", "stick", "--cycles", "12", "--over", "engine.order=1,2", "--out", str(tmp_path / "points.jsonl")]
    assert main([*words, "--set", "engine.speed=100"]) == 0
    assert main([*words, "--set", "engine.frequency=100"]) == 2


SPEED, FREQUENCY, ORDER = "engine.speed=90:100:2", "engine.frequency=90:100:2", "engine.order=1:2:2"


IDENTIFY = ("identify", "T.csv", "--scene", "fig02")
SMOOTH = ("fig02", "--set", "friction.law=set_valued", "--over", "friction.smoothing=50:60:2")
TABLE = "slip_speed,coefficient\n0,0.3\n2,0.26\n10,0.24\n40,0.24\n"


@pytest.mark.parametrize("words", [
    ("sweep", "fig02", "--over", SPEED, "--over", FREQUENCY), ("sweep", "fig02", "--over", FREQUENCY, "--over", SPEED),
    ("sweep", "fig02", "--over", SPEED, "--set", "engine.frequency=3"),
    ("sweep", "fig02", "--over", FREQUENCY, "--set", "engine.speed=3"),
    ("sweep", "fig02", "--over", SPEED, "--scatter", "engine.frequency=90:100", "--samples", "2"),
    ("sweep", "fig02", "--scatter", "engine.speed=90:100", "--scatter", "engine.frequency=90:100", "--samples", "2"),
    ("sweep", "runup", "--over", SPEED), ("sweep", "runup", "--over", FREQUENCY),
    ("simulate", "runup", "--set", "engine.speed=3", "--profile", "engine.speed=0:3,1:4"),
    ("simulate", "fig02", "--set", "pressure.mean=3", "--profile", "pressure.mean=0:3"),
    (*IDENTIFY, "--free", "friction.decay=3", "--set", "friction.decay=2"),
    (*IDENTIFY, "--free", "engine.speed=3"), (*IDENTIFY, "--free", "engine.frequency=3"),
    (*IDENTIFY, "--free", "friction.curve=2", "--free", "friction.decay"),
    (*IDENTIFY, "--free", "friction.decay=3", "--set", "friction.table=t.csv"),
    ("linearise", "fig02", "--slip", "20", "--set", "pressure.mean=1e5"),
    ("sweep", "controlled", "--over", "pressure.amplitude=0:1e5:2"),
    ("sweep", "controlled", "--scatter", "pressure.phase=0:1", "--samples", "2"), ("sweep", *SMOOTH),
    ("basins", *SMOOTH, "--plane", "initial.slip_speed=0:9:2", "--plane", "initial.plate_angle=0:1:2"),
    ("control", "set", "engine.speed=3"),
    ("continue", "slip", "--over", "engine.speed=1:2"), ("continue", "slip", "--over", "engine.order=1:2"),
    ("continue", "slip", "--set", "engine.speed=100", "--over", "engine.order=1:2"),
    ("continue", "slip", "--over", "engine.mean_torque=1:2", "--second", "engine.speed=1:2"),
    ("sweep", "aged_fluid", "--over", "friction.kinetic_coefficient=0.1:0.2:2"),
    ("sweep", "aged_fluid", "--over", "friction.coefficients=0.9:1.1:2", "--over", "friction.coefficients[2]=0.1,0.2"),
    ("continue", "aged_fluid", "--over", "friction.decay=1:2"),
    ("simulate", "fig02", "--set", "friction.coefficients=[0.1]")])
def test_a_key_that_another_one_defines_is_refused(words, refused, tmp_path):
    if words[0] == "control":
        pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    (tmp_path / "T.csv").write_text("t,slip_speed,engine_torque\n" + "".join(f"{k}e-3,{k},300\n" for k in range(60)))
    (tmp_path / "t.csv").write_text(TABLE)
    line = refused(*words)
    assert any(word.partition("=")[0].split(".")[-1] in line for word in words if "=" in word)


@pytest.mark.parametrize("verb", ["simulate", "explain", "sweep"])
def test_a_table_beside_coefficients_warns_of_those_that_it_replaces(verb, tmp_path):
    table, out = tmp_path / "t.csv", tmp_path / "out.json"
    table.write_text(TABLE)
    words = [f"--set=friction.table={table}", "--set=friction.kinetic_coefficient=0.2", "--json", str(out)]
    more = {"simulate": ["--cycles", "3"], "sweep": ["--cycles", "12", "--over", "engine.mean_torque=1:2:2"]}
    assert main([verb, "fig02", *words, *more.get(verb, [])]) == 0
    assert any("friction.kinetic_coefficient" in each for each in json.loads(out.read_text())["warnings"])


def test_a_sweep_over_one_number_of_a_list_is_one_over_the_list():
    scene = load_scene("fig02").with_values(TWO)
    result = sweep(scene, "engine.harmonic_amplitudes[2]", [6.0, 60.0], **COLD).column("max_slip_speed")
    whole = [simulate(scene, set={"engine.harmonic_amplitudes": [5.0, x]}, **COLD).summary.max_slip_speed
             for x in (6.0, 60.0)]
    np.testing.assert_allclose(result, whole, rtol=1e-4)


CURVE = {"friction.slip_speeds": [0.0, 2.0, 10.0, 40.0], "friction.coefficients": [0.3, 0.26, 0.24, 0.24]}
TWO = {"engine.harmonic_amplitudes": [5.0, 6.0], "engine.harmonic_phases": [0.0, 0.0]}
PAIRS = {
    "speed": ({}, {"engine.speed": "955rpm"}, {"engine.frequency": 955.0 * RPM}),
    "order of a speed": ({"engine.speed": 100.0}, {"engine.order": 2.0},
                         {"engine.frequency": 200.0, "engine.order": 2.0}),
    "order of a frequency": ({"engine.frequency": 100.0}, {"engine.order": 2.0},
                             {"engine.frequency": 100.0, "engine.order": 2.0}),
    "frequency after a speed": ({"engine.speed": 100.0, "engine.order": 2.0}, {"engine.frequency": 90.0},
                                {"engine.frequency": 90.0, "engine.order": 2.0}),
    "number of a list": (TWO, {"engine.harmonic_amplitudes[2]": 60.0},
                         {**TWO, "engine.harmonic_amplitudes": [5.0, 60.0]}),
    "number of a table": (CURVE, {"friction.coefficients[1]": 0.35},
                          {**CURVE, "friction.coefficients": [0.35, 0.26, 0.24, 0.24]}),
    "table": ({}, {"friction.table": "t.csv"}, CURVE),
    "profile of a speed": ({"engine.order": 2.0},
                           {"engine.speed_times": [0.0, 0.02], "engine.speed_values": ["150", "200rad/s"]},
                           {"engine.order": 2.0, "engine.frequency_times": [0.0, 0.02],
                            "engine.frequency_values": [300.0, 400.0]})}
"""Keys of a scene, a change of them, and the keys of the changed scene without those that define others."""
LENGTH = ["--cycles", "10", "--discard", "2"]
COMMANDS = {"simulate": LENGTH, "explain": [], "sweep": [*LENGTH, "--over", "engine.mean_torque=300,301"],
            "scatter": [*LENGTH, "--scatter", "engine.mean_torque=300:301", "--samples", "2"],
            "basins": ["--plane", "initial.slip_speed=0:20:2", "--plane", "initial.plate_angle=0:0.1:2",
                       "--set", "driveline.damping=20"],
            "continue": ["--over", "engine.mean_torque=300:301"], "linearise": ["--frequencies", "10:100:2"],
            "identify": ["--free", "driveline.stiffness", "--noise", "slip_speed=0.05,plate_speed=0.05"],
            "fmu": ["--sources-only"]}
"""Words of the commands."""
SLOW = ("basins", "continue", "linearise", "identify", "fmu")
RUNNING = ("at", "change")
LOOPS = ("closed_loop", "parameters", *RUNNING)
"""Changes of a running driveline, and all that run one."""
UNEQUAL = ("scene", "command", "seconds", "wall_s", "elapsed_s", "fit_s")


def figures(verb, keys, changes, drivelines):
    """Results of a verb from a scene file with some keys and from changes of them; None if it refuses them."""
    scene = load_scene("fig02").with_values(keys)
    Path("own.yaml").write_text(scene.text())
    try:
        if verb == "change":
            rig = drivelines("own.yaml")
            rig.change(changes)
            return rig.run(0.1).slip_speed.tolist()
        if verb in LOOPS:
            if verb == "parameters":
                scene = parameters_of({"scene": "own.yaml", **changes})
            at = {0.0: changes} if verb == "at" else {}
            scene = scene.with_values(changes) if verb == "closed_loop" else scene
            return closed_loop(scene, lambda reading: None, 0.1, at=at).slip_speed.tolist()
    except InputError:
        return None
    words = ["sweep" if verb == "scatter" else verb, *(["m.csv", "--scene"] if verb == "identify" else []), "own.yaml",
             *COMMANDS[verb], *(f"--set={key}={value}" for key, value in changes.items()), "--force"]
    Path("own.fmu").unlink(missing_ok=True)
    if main([*words[:-1], "--out", "own.fmu"] if verb == "fmu" else [*words, "--json", "out.json"]) == 2:
        return None
    if verb == "fmu":
        with zipfile.ZipFile("own.fmu") as file:
            return {name: file.read(name) for name in file.namelist()}
    return {name: value for name, value in json.loads(Path("out.json").read_text()).items() if name not in UNEQUAL}


def parameters_of(values):
    """The scene of a driveline node with these parameters."""
    from rclpy.parameter import Parameter

    from tcc_sim.nodes.driveline import DrivelineNode

    node = DrivelineNode(parameter_overrides=[Parameter(key, value=value) for key, value in values.items()])
    node.destroy_node()
    return node.scene


def measure(keys):
    """Write a measurement of a scene's first cycles, with noise."""
    run = simulate("fig02", set=keys, cycles=4, discard=0, samples_per_cycle=16).trajectory
    noise = 0.05 * np.random.default_rng(1).standard_normal((2, len(run.t)))
    np.savetxt("m.csv", np.transpose([run.t, run.slip_speed + noise[0], run.plate_speed + noise[1]]), delimiter=",",
               header="t,slip_speed,plate_speed", comments="")


@pytest.mark.parametrize(("verb", "name"), [
    (verb, name) for k, verb in enumerate((*COMMANDS, *LOOPS)) for n, name in enumerate(PAIRS)
    if (2 * k + 3 * n) % 8 < (1 if verb in SLOW else 4) or n > 5])
def test_a_key_means_in_every_verb_those_that_it_defines(verb, name, tmp_path, monkeypatch, request):
    """Two equivalent scenes give the same figures, or the verb refuses the key. Each verb has half of the pairs, a slow
    one has one, and all have a table and a profile, which some refuse.
    """
    monkeypatch.chdir(tmp_path)
    drivelines = request.getfixturevalue("driveline") if verb in ("change", "parameters") else None
    if verb == "parameters":
        drivelines("fig02").close()  # The context stays.
    Path("t.csv").write_text(TABLE)
    before, changes, plain = PAIRS[name]
    if verb == "identify" and "profile" not in name:
        measure(plain)
    changed = figures(verb, before, changes, drivelines)
    assert (changed is None) == (
        (name == "profile of a speed" and verb in ("basins", "continue", "linearise", "identify"))
        or (name == "table" and verb in LOOPS)
        or (name not in ("frequency after a speed", "number of a table") and verb in RUNNING))
    if changed is not None:
        assert changed == figures(verb, plain, {}, drivelines)
        if verb == "identify":
            assert changed["accepted"]
        if verb == "simulate":
            assert (changed == figures(verb, before, {}, drivelines)) == (name == "order of a frequency")


@pytest.mark.parametrize("verb", COMMANDS)
def test_no_verb_takes_a_key_beside_the_one_that_defines_it(verb, refused, tmp_path):
    (tmp_path / "t.csv").write_text(TABLE)
    words = ["sweep" if verb == "scatter" else verb, *(["m.csv", "--scene"] if verb == "identify" else [])]
    (tmp_path / "m.csv").write_text("t,slip_speed\n" + "".join(f"{k}e-3,{k}\n" for k in range(60)))
    for scene, *values in (
            ("fig02", "engine.speed=100", "engine.frequency=100"), ("runup", "engine.speed=3"),
            ("fig02", "engine.speed=100", "engine.frequency_times=[0]", "engine.frequency_values=[100]"),
            ("fig02", "pressure.phase=1", "pressure.mean=3", "pressure.mean_times=[0]", "pressure.mean_values=[3]"),
            ("apply", "pressure.mean=3"), ("fig02", "engine.harmonic_amplitudes[1]=3"),
            ("fig02", "friction.table=t.csv", "friction.coefficients=[0.1]"), ("aged_fluid", "friction.decay=3")):
        line = refused(*words, scene, *COMMANDS[verb], *(f"--set={value}" for value in values))
        assert values[-1].partition("=")[0].partition("[")[0].removesuffix("_values") in line
