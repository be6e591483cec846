"""`tcc-sim simulate` against closed forms, and its refusals."""

import json
import math

import numpy as np
import pytest
from interpreter import python

from tcc_sim.cli import main

I1, I2, C23, K23 = 0.2, 0.02, 0.6, 3000.0


def values_of(capsys, *arguments):
    status = main(["simulate", *map(str, arguments), "--json", "-"])
    out = capsys.readouterr()
    assert status == 0, out.err
    return json.loads(out.out)


ABOUT = ("units", "scene", "document", "section_states", "cycle_highest", "cycle_lowest", "cycle_stick_time")
"""Names in a file of samples beside the signals."""


def test_samples_in_npz_end_at_the_end_and_satisfy_the_equations(tmp_path):
    path = tmp_path / "run.npz"
    assert main(["simulate", "slip", "--duration", "0.3", "--out", str(path)]) == 0
    with np.load(path) as arrays:
        samples = {name: arrays[name] for name in arrays if name not in ABOUT}
        assert set(samples) == {"t", "slip_speed", "plate_angle", "plate_speed", "engine_torque", "saturation_torque",
                                "friction_torque", "state"}
        assert set(ABOUT) <= set(arrays)
        t, v = arrays["t"], arrays["slip_speed"]
        assert t[0] == 0.0
        assert t[-1] == 0.3
        assert len(set(map(len, samples.values()))) == 1
        assert np.all(arrays["state"] == 1)
        # Momentum of the whole driveline: I1 theta1'' + I2 theta2'' = Te - C theta2' - K theta2.
        momentum = I1 * (v + arrays["plate_speed"]) + I2 * arrays["plate_speed"]
        load = arrays["engine_torque"] - C23 * arrays["plate_speed"] - K23 * arrays["plate_angle"]
        impulse = np.concatenate([[0.0], np.cumsum(0.5 * (load[1:] + load[:-1]) * np.diff(t))])
        assert momentum - momentum[0] == pytest.approx(impulse, abs=2e-3 * float(np.ptp(momentum)))


def test_a_recording_has_its_scene_and_every_cycle_although_its_stamps_are_whole_nanoseconds(capsys, tmp_path):
    """Cycles of 2 pi/150 s end between nanoseconds, and the stamp of the last state may lie before the end."""
    pytest.importorskip("mcap")
    for cycles in (6, 10, 23):
        path = tmp_path / f"{cycles}.mcap"
        solved = values_of(capsys, "fig02", "--cycles", cycles, "--samples", 50, "--out", path, "--discard", 2, "--set",
                           "engine.mean_torque=301")
        assert main(["analyse", str(path), "--discard", "2", "--json", "-"]) == 0
        document = json.loads(capsys.readouterr().out)
        assert (document["cycles"], document["breakaways"]) == (cycles, solved["breakaways"])
        assert (document["messages"], document["scene"]["engine.mean_torque"]) == (50 * cycles + 1, 301.0)


def test_the_defaults_are_150_cycles_and_50_dropped(capsys):
    result = values_of(capsys, "slip")
    assert (result["cycles"], result["discarded"]) == (150, 50)
    result = values_of(capsys, "slip", "--cycles", 30)
    assert (result["cycles"], result["discarded"]) == (30, 15)
    cycle = 2.0 * math.pi / 150.0
    result = values_of(capsys, "slip", "--set", "engine.frequency=150", "--duration", 9.5 * cycle)
    assert (result["cycles"], result["discarded"]) == (9, 3)


@pytest.mark.parametrize(("cycles", "none"), [(100, "none up to 16 "), (12, "none up to 2 "), (1, "none: ")])
def test_no_period_is_denied_beyond_a_third_of_the_kept_cycles(capsys, cycles, none):
    assert main(["simulate", "chaos", "--cycles", str(cycles), "--discard", str(cycles // 2)]) == 0
    assert f"  {none}" in capsys.readouterr().out


@pytest.mark.parametrize(("arguments", "words"), [
    (["nowhere"], "nowhere"), (["fig02", "--cycles", "0"], "cycles is 0"), (["fig02", "--cycles", "1e3"], "--cycles"),
    (["fig02", "--cycles", "10", "--discard", "10"], "discard is 10"), (["fig02", "--discard", "-1"], "discard is -1"),
    (["fig02", "--duration", "nan"], "nan s"), (["fig02", "--duration", "-1"], "-1 s"),
    (["fig02", "--cycles", "3", "--duration", "1"], "--duration"), (["fig02", "--solver", "euler"], "euler"),
    (["fig02", "--rtol", "2"], "rtol is 2"), (["fig02", "--solver", "fixed_step", "--rtol", "1e-6"], "rtol"),
    (["fig02", "--solver", "fixed_step", "--step", "1"], "1"), (["fig02", "--json", "no/run.json"], "no"),
    (["fig02", "--samples", "-3"], "-3"), (["s" * 5000], "sssss: "),
    (["fig02", "--duration", "1e-12"], "4.19e-10 to 1e6 s"), (["runup", "--duration", "1e-12"], "1e-12 s"),
    (["fig02", "--out", "run.npz", "--cycles", "1000000"], "--out"),
    (["fig02", "--out", "run.csv", "--json", "run.csv"], "run.csv"),
    (["fig02", "--inputs", "a.csv", "--spectrum"], "spectrum")])
def test_wrong_input_ends_with_status_2_and_writes_nothing(refused, arguments, words, tmp_path):
    (tmp_path / "a.csv").write_text("t,engine_torque\ns,N m\n0,300\n1,310\n")
    assert words in refused("simulate", *arguments)


def test_existing_files_are_replaced_only_by_force(refused, tmp_path):
    out, summary = tmp_path / "run.npz", tmp_path / "run.json"
    for path, option in ((out, "--out"), (summary, "--json")):
        path.write_text("mine")
        assert "exists" in refused("simulate", "slip", "--cycles", "3", option, path)
        assert path.read_text() == "mine"
    assert main(["simulate", "slip", "--cycles", "3", "--out", str(out), "--json", str(summary), "--force"]) == 0
    assert json.loads(summary.read_text())["cycles"] == 3
    assert np.load(out)["t"][0] == 0.0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.json", "run.npz"]


def test_a_solve_imports_nothing_that_it_does_not_need():
    unwanted = {"rclpy", "rerun", "mcap", "matplotlib", "scipy.integrate", "scipy.stats", "tqdm", "dask"}
    script = ("import sys; from tcc_sim.cli import main; main(['simulate', 'minimal', '--cycles', '4']);"
              f"print(sorted({unwanted} & set(sys.modules)))")
    done = python("-c", script)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(("words", "said"), [
    (["slip", "--cycles", "4"], "0 N m s/rad, "), (["fig02", "--duration", "0.01"], "none: "),
    (["fig02", "--cycles", "2", "--set", "friction.law=set_valued", "--set", "engine.torque_amplitude=0",
      "--set", "initial.slip_speed=0", "--set", "initial.plate_angle=0.1"], "none: ")])
def test_damping_is_said_or_why_there_is_none(words, said, capsys):
    assert main(["simulate", *words, "--damping"]) == 0
    assert f"equivalent damping (21)  {said}" in capsys.readouterr().out
