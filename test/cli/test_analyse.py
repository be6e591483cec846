"""`tcc-sim analyse` from the outside: figures, JSON, Rerun file, and refusals."""

import json
import math

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.output.samples import write_trajectory
from tcc_sim.plant.closed_loop import closed_loop
from tcc_sim.scene import load_scene
from tcc_sim.trajectory import Trajectory

KEYS = {"max_slip_speed", "min_slip_speed", "period", "section", "stick_fraction", "regime", "cycles", "solver",
        "elapsed_s",
        "messages", "lost_messages", "complete"}
SWING = 250.0 / (0.2 * 150.0)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Steady pure slip by the corrected (17a), 2 s."""
    scene = load_scene("slip")
    t = np.arange(2001) * 1e-3
    zero = np.zeros_like(t)
    run = Trajectory(t, 150.0 + SWING * (1.0 - np.cos(150.0 * t)), zero + 0.1, zero, 300.0 + 250.0 * np.sin(150.0 * t),
                     zero + 300.0, zero + 300.0, zero.astype(np.int8) + 1, 2.0 * math.pi / 150.0, "by_hand",
                     scene.system)
    path = tmp_path_factory.mktemp("analyse") / "run.mcap"
    write_trajectory(path, run, scene.text())
    return path.read_bytes()


@pytest.fixture
def recording(tmp_path, written):
    path = tmp_path / "run.mcap"
    path.write_bytes(written)
    return path


def test_json_on_standard_output_is_nothing_but_json(capsys, recording):
    assert main(["analyse", str(recording), "--json", "-", "--verify", "--discard", "10"]) == 1
    out = capsys.readouterr()
    document = json.loads(out.out)
    assert out.err == ""
    assert set(document) >= KEYS | {"verified", "largest_difference"}
    assert (document["messages"], document["lost_messages"], document["complete"]) == (2001, 0, True)
    assert (document["cycles"], document["discarded"], document["period"], document["regime"]) == (47, 10, 1, "slip")
    assert document["max_slip_speed"] == pytest.approx(150.0 + 2.0 * SWING, rel=1e-7)
    assert document["solver"] == "by_hand"
    # The closed form is not the solution of the ticks, which start from a plate at rest at angle 0.
    assert document["verified"] is False


def test_a_recorded_scene_comes_to_what_simulate_says(capsys, tmp_path):
    """Stick-slip of period two under pressure at half the engine's frequency, at 1 kHz, against the adaptive engine.

    The real-time solver is good to some 5e-4 of the largest slip speed at this rate; stick ends and begins within a
    tick."""
    values = {"friction.kinetic_coefficient": 0.285, "engine.frequency": 120.0, "pressure.frequency_ratio": 0.5}
    scene = load_scene("fig02").with_values(values)
    (tmp_path / "scene.yaml").write_text(scene.text())
    write_trajectory(tmp_path / "run.mcap", closed_loop(scene, lambda reading: None, 2.6), scene.text())
    assert main(["analyse", str(tmp_path / "run.mcap"), "--damping", "--json", "-"]) == 0
    recorded = json.loads(capsys.readouterr().out)
    assert recorded["cycles"] >= 40
    assert main(["simulate", str(tmp_path / "scene.yaml"), "--cycles", str(recorded["cycles"]), "--discard",
                 str(recorded["discarded"]), "--damping", "--json", "-"]) == 0
    solved = json.loads(capsys.readouterr().out)
    assert (recorded["period"], recorded["regime"]) == (solved["period"], solved["regime"]) == (2, "stick-slip")
    size = solved["max_slip_speed"]
    assert size > 50.0
    assert recorded["max_slip_speed"] == pytest.approx(size, rel=1e-3)
    assert recorded["min_slip_speed"] == pytest.approx(solved["min_slip_speed"], abs=2e-3 * size)
    ticks_per_cycle = 1000.0 * 2.0 * math.pi / 120.0
    assert recorded["stick_fraction"] == pytest.approx(solved["stick_fraction"], abs=1.0 / ticks_per_cycle)
    assert len(recorded["section"]) == len(solved["section"]) == 2
    for mine, theirs in zip(recorded["section"], solved["section"]):
        assert mine == pytest.approx(theirs, rel=1e-3, abs=1e-4)
    assert recorded["equivalent_damping"] == pytest.approx(solved["equivalent_damping"], rel=5e-3)
    assert recorded["negative_slope_mean"] == pytest.approx(solved["negative_slope_mean"], rel=5e-3)


@pytest.mark.parametrize("words", [["runup", "--profile", "engine.frequency=0:60,1:120"], ["apply"]])
def test_a_recorded_manoeuvre_has_the_period_that_simulate_gives_it(capsys, tmp_path, words):
    """The excitation changes up to the end of a profile, whether or not the cycles change their length with it."""
    out = str(tmp_path / "run.mcap")
    assert main(["simulate", *words, "--out", out, "--json", "-"]) == 0
    solved = json.loads(capsys.readouterr().out)
    assert main(["analyse", out, "--json", "-"]) == 0
    recorded = json.loads(capsys.readouterr().out)
    keys = "cycles", "discarded", "period", "settled", "section_change"
    assert [recorded[key] for key in keys] == [solved[key] for key in keys]


@pytest.mark.parametrize(("words", "order", "discarded"), [
    ([], 1.0, 23), (["--discard", "30"], 1.0, 30), (["--frequency", "75"], 2.0, 11)])
def test_a_spectrum_covers_the_kept_cycles_at_the_frequency_of_the_figures(tmp_path, capsys, words, order, discarded):
    """The slip speed swings three times as far in the first 0.9 s; a table of the run drops its first half too."""
    scene, t = load_scene("slip"), np.arange(2001) * 1e-3
    zero, swing = np.zeros_like(t), SWING * np.where(t < 0.9, 3.0, 1.0)
    run = Trajectory(t, 150.0 - swing * np.cos(150.0 * t), zero + 0.1, zero, 300.0 + 250.0 * np.sin(150.0 * t),
                     zero + 300.0, zero + 300.0, zero.astype(np.int8) + 1, 2.0 * math.pi / 150.0, "by_hand",
                     scene.system)
    write_trajectory(tmp_path / "run.mcap", run, scene.text())
    table, json_ = tmp_path / "run.csv", tmp_path / "found.json"
    assert main(["analyse", str(tmp_path / "run.mcap"), *words, "--spectrum", "--orders", "--out", str(table), "--json",
                 str(json_)]) == 0
    assert "of real time" not in capsys.readouterr().out  # The file has simulation time alone.
    document = json.loads(json_.read_text())
    assert (document["discarded"], document["real_time_factor"]) == (discarded, None)
    assert document["orders"]["frequency"][0] == pytest.approx(150.0 / order)
    spectra = [document["spectrum"]]
    if not words:
        assert main(["analyse", str(table), "--spectrum", "--json", str(json_), "--force"]) == 0
        spectra.append(json.loads(json_.read_text())["spectrum"])
    for spectrum in spectra:
        assert spectrum["slip_speed"][spectrum["order"].index(order)] == pytest.approx(SWING, rel=1e-3)
        assert float(spectrum["window"].split()[-4]) > 0.9


def test_a_frequency_that_is_given_is_that_of_the_figures(capsys, recording, tmp_path):
    words = ["analyse", str(recording), "--json", str(tmp_path / "a.json"), "--frequency", "75", "--damping"]
    assert main(words) == 0
    document = json.loads((tmp_path / "a.json").read_text())
    assert (document["frequency"], document["equivalent_damping"], document["negative_slope_mean"]) == (75.0, 0.0, 0.0)
    out = capsys.readouterr().out
    assert not [word for word in ("complete", "2001", "1 ms", "75 rad/s", "slip speed", "N m s/rad") if word not in out]


TABLE = ("run.csv", "--orders")


@pytest.mark.parametrize(("words", "says"), [
    *(((*TABLE, *words), words[0]) for words in (
        ("--discard", "0"), ("--target", "0"), ("--run", "0"), ("--driveline", "0"), ("--frequency", "0"),
        ("--rrd", "a.rrd"), ("--damping",), ("--verify",), ("--spawn",), ("--topic", "a"))),
    (("run.csv", "--scene", "fig02"), "--orders"), (("nowhere.mcap",), "nowhere.mcap"), ((".",), ".mcap"),
    (("empty.mcap",), "empty.mcap"), (("run.mcap", "--discard", "47"), "47"), (("run.mcap", "--discard", "x"), "x"),
    (("run.mcap", "--frequency", "0"), "0 rad/s"), (("run.mcap", "--scene", "nowhere"), "nowhere"),
    (("run.mcap", "--from", "nan"), "nan s"), (("run.mcap", "--to=-inf"), "-inf s"),
    (("run.mcap", "--rrd", "no/run.rrd"), "no"), (("run.mcap", "--json", "."), "."),
    (("run.mcap", "--rrd", "x", "--json", "x"), "x"), (("run.mcap", "--spawn", "--rrd", "x"), "--rrd"),
    (("run.mcap", "--connect", "http://x"), "http://x")])
def test_wrong_input_ends_with_status_2_and_writes_nothing(refused, recording, words, says, tmp_path):
    if "--connect" in words:
        pytest.importorskip("rerun")
    (tmp_path / "run.csv").write_text("t,slip_speed\n0,1\n1,2\n")
    (tmp_path / "empty.mcap").write_bytes(b"nothing of the kind")
    if words == (".",):
        recording.unlink()
        (tmp_path / "empty.mcap").unlink()
    assert says in refused("analyse", *words)
