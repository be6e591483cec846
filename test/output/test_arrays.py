"""Arrays and tables of runs: cycles that come back, interpolation of inputs, and text with every digit."""

from __future__ import annotations

import errno
import io
import os
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
from tcc_sim.output.samples import documented, read_arrays, write_columns, write_samples, write_trajectory
from tcc_sim.recording.reader import Run
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
    read = Run(tmp_path / "a.mcap")
    states, = read.columns().runs
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
    """By a line with the name of the file and of the array."""
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "words.npz", a=np.array([{}], dtype=object), b=np.array([1, 2], "M8[s]"))
    data = io.BytesIO()
    np.save(data, np.arange(4.0))
    for name, content in (("long", data.getvalue() + b"x"), ("short", data.getvalue()[:-1])):
        with zipfile.ZipFile(tmp_path / f"{name}.npz", "w") as file:
            file.writestr("a.npy", content)
    np.savez_compressed(tmp_path / "large.npz", a=np.zeros(100_000_000, np.int8))
    for text, name in (("{", "a.json"), ("[1]", "b.json")):
        (tmp_path / name).write_text(text)
    for name, words in ((".", "regular file"), ("no.npz", os.strerror(errno.ENOENT)), ("text.npz", "zip"),
                        ("words.npz", "array a"), ("long.npz", "array a"), ("short.npz", "array a"),
                        ("large.npz", "100000128 bytes"),
                        ("a.json", "JSON"), ("b.json", "JSON")):
        with pytest.raises(InputError) as caught:
            read_json(tmp_path / name) if name.endswith(".json") else read_arrays(tmp_path / name, ["a"])
        assert str(tmp_path / name) in str(caught.value)
        assert words in str(caught.value)


def test_a_table_in_text_has_comments_names_units_and_every_digit(tmp_path: Path) -> None:
    columns = {"t": np.array([0.0, 0.1]), "name": ["a", "b,c"], "on": np.array([True, False])}
    write_columns(tmp_path / "a.csv", ".csv", columns, {"t": "s"}, {}, {}, ["one", "two"])
    assert (tmp_path / "a.csv").read_text() == '# one\n# two\nt,name,on\ns,,\n0.0,a,True\n0.1,"b,c",False\n'
    assert str(documented({"a": 1})["document"]) == '{"a": 1}'
    with pytest.raises(ValueError, match="not JSON compliant"):
        documented({"a": float("nan")})


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_arrays_of_every_version_are_read(version: tuple[int, int], tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as file, file.open("a.npy", "w") as stream:
        npy.write_array(stream, np.arange(3.0), version=version)
    assert read_arrays(tmp_path / "a.npz", ["a"])["a"].tolist() == [0.0, 1.0, 2.0]
