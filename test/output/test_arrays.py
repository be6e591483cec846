"""Arrays and tables of runs: cycles that come back, interpolation of inputs, and text with every digit."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.lib import format as npy

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.output.files import read_json
from tcc_sim.output.samples import write_samples, write_trajectory
from tcc_sim.output.stored_files import read_arrays
from tcc_sim.output.table_files import documented, write_columns
from tcc_sim.recording.reader import open_run
from tcc_sim.scene import load_scene
from tcc_sim.trajectory import Trajectory


@pytest.mark.parametrize("flywheel", [None, [1.0, 2.0, 3.0]])
def test_a_recording_of_samples_has_every_number(flywheel: list[float] | None, tmp_path: Path) -> None:
    """Without its angle the flywheel turns by the trapezoids of the slip speed more than the plate."""
    t = np.array([0.0, 0.1, 0.3])
    run = Trajectory(t, np.array([1.0, 3.0, -2.0]), np.array([0.1, 0.2, 0.4]), np.array([5.0, 6.0, 8.0]), 10.0 * t,
                     20.0 * t, 30.0 * t + 1.0, np.array([1, 0, -1], np.int8), 0.5, "euler",
                     flywheel_angle=None if flywheel is None else np.array(flywheel))
    write_trajectory(tmp_path / "a.mcap", run, "text")
    read = open_run(tmp_path / "a.mcap")
    states, = read.states()
    assert (read.scene_text, read.solver, states.stamp_ns.tolist()) == ("text", "euler", [0, 100_000_000, 300_000_000])
    for name, values in (("flywheel_angle", flywheel or [0.1, 0.4, 0.7]), ("flywheel_speed", [6.0, 9.0, 6.0]),
                         ("plate_angle", [0.1, 0.2, 0.4]), ("plate_speed", [5.0, 6.0, 8.0]),
                         ("engine_torque", [0.0, 1.0, 3.0]), ("friction_torque", [1.0, 4.0, 10.0])):
        assert getattr(states, name) == pytest.approx(values)
    with (tmp_path / "a.mcap").open("rb") as stream:
        decoded = {}
        for _, channel, message in make_reader(stream).iter_messages():
            decoded.setdefault(channel.topic, []).append(message.data)
    assert {name: len(found) for name, found in decoded.items()} == dict.fromkeys(
        ("/joint_states", "/slip_speed", "/friction_torque", "/stick_slip_state"), 3)
    assert decoded["/slip_speed"] == [cdr.float64(x) for x in run.slip_speed.tolist()]
    assert decoded["/friction_torque"] == [cdr.float64(x) for x in run.friction_torque.tolist()]
    assert decoded["/stick_slip_state"] == [cdr.int8(x) for x in (1, 0, -1)]


def test_recorded_samples_of_a_commanded_pressure_have_the_pressure(tmp_path: Path) -> None:
    t, per = np.array([0.0, 0.1, 0.3]), load_scene("controlled").system.torque_per_pressure
    run = Trajectory(t, t, t, t, t, per * np.array([1e5, 2e5, 3e5]), t, np.zeros(3, np.int8), 0.5, "euler",
                     load_scene("controlled").system)
    for name, changes, recorded, found in (
            ("a", {}, True, [1e5, 2e5, 3e5]), ("b", {}, False, None), ("c", {"system": None}, True, None),
            ("d", {"system": load_scene("fig02").system}, True, None),
            ("e", {"saturation_torque": per * np.array([1e5, np.nan, 3e5])}, True, None)):
        write_samples(tmp_path / f"{name}.npz", replace(run, **changes), "", recorded=recorded)
        with np.load(tmp_path / f"{name}.npz") as arrays:
            assert ("actuation_pressure" in arrays) == (found is not None)
            if found is not None:
                assert arrays["actuation_pressure"] == pytest.approx(found)
                assert arrays["units"][-1] == "Pa"


def test_files_that_are_no_arrays_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "words.npz", a=np.array([{}], dtype=object), b=np.array([1, 2], "M8[s]"))
    data = io.BytesIO()
    np.save(data, np.arange(4.0))
    for name, content in (("long", data.getvalue() + b"x"), ("short", data.getvalue()[:-1])):
        with zipfile.ZipFile(tmp_path / f"{name}.npz", "w") as file:
            file.writestr("a.npy", content)
    for name, array, why in ((".", "a", "{} is not a regular file"),
                             ("no.npz", "a", "{} cannot be read: No such file or directory"),
                             ("text.npz", "a", "{} is damaged, or no .npz: File is not a zip file"),
                             ("words.npz", "a", "{}: array a holds neither numbers nor text"),
                             ("words.npz", "b", "{}: array b holds neither numbers nor text"),
                             ("long.npz", "a", "{}: array a claims 32 bytes and has 33"),
                             ("short.npz", "a", "{}: array a claims 32 bytes and has 31")):
        with pytest.raises(InputError) as caught:
            read_arrays(tmp_path / name, [array])
        assert str(caught.value) == why.format(tmp_path / name)
    for text, why in (("{", "{} is not a JSON file"), ("[1]", "{} contains no JSON object")):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(InputError) as caught:
            read_json(tmp_path / "a.json")
        assert str(caught.value) == why.format(tmp_path / "a.json")


def test_a_table_in_text_has_comments_names_units_and_every_digit(tmp_path: Path) -> None:
    columns = {"t": np.array([0.0, 0.1]), "name": ["a", "b,c"], "on": np.array([True, False])}
    write_columns(tmp_path / "a.csv", ".csv", columns, {"t": "s"}, {}, {}, ["one", "two"])
    assert (tmp_path / "a.csv").read_text() == '# one\n# two\nt,name,on\ns,,\n0.0,a,True\n0.1,"b,c",False\n'
    assert str(documented({"a": 1})["document"]) == '{"a": 1}'
    with pytest.raises(ValueError, match="not JSON compliant"):
        documented({"a": float("nan")})


@pytest.mark.parametrize(("version", "says"), [
    ((1, 0), ""), ((2, 0), ""), ((3, 0), "array a has the unknown version (3, 0)")])
def test_arrays_of_both_old_versions_are_read(version: tuple[int, int], says: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as file, file.open("a.npy", "w") as stream:
        npy.write_array(stream, np.arange(3.0), version=version)
    if says:
        with pytest.raises(InputError) as caught:
            read_arrays(tmp_path / "a.npz", ["a"])
        assert str(caught.value) == f"{tmp_path / 'a.npz'}: {says}"
    else:
        assert read_arrays(tmp_path / "a.npz", ["a"])["a"].tolist() == [0.0, 1.0, 2.0]
