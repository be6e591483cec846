"""Arrays and tables of runs: cycles that come back, interpolation of inputs, and text with every digit."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.lib import format as npy

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.output.samples import _cycle_columns, _holds, cycles_in, write_trajectory
from tcc_sim.output.stored_files import read_arrays
from tcc_sim.output.table_files import documented, write_columns
from tcc_sim.recording.reader import open_run
from tcc_sim.trajectory import Cycles, Trajectory


def test_cycles_come_back_from_their_arrays_with_the_columns_in_the_order_of_the_file() -> None:
    section = np.arange(9.0).reshape(3, 3)
    cycles = Cycles(section, np.ones(2), np.zeros(2), np.full(2, 3.0))
    for one, names in ((cycles, 4), (Cycles(section, np.ones(2), np.zeros(2), np.ones(2), starts=np.arange(3.0)), 5)):
        arrays = _cycle_columns(one)
        assert len(arrays) == names
        assert arrays["section_states"][0].tolist() == [1.0, 0.0, 2.0]  # Plate angle, slip speed, plate speed.
        again = cycles_in(arrays)
        assert again is not None
        for name in ("section", "highest", "lowest", "stick_time", "starts"):
            np.testing.assert_array_equal(getattr(again, name), getattr(one, name))
    assert cycles_in({}) is None
    assert _cycle_columns(None) == {}


@pytest.mark.parametrize(("engine", "pressure", "moves", "holds"), [
    ("topic", "topic", True, {"engine_torque": "next", "actuation_pressure": "next", "output_speed": "next"}),
    ("harmonic", "topic", False, {"engine_torque": "linear", "actuation_pressure": "next"}),
    ("topic", "harmonic", False, {"engine_torque": "next", "actuation_pressure": "linear"})])
def test_a_command_is_held_up_to_its_sample(engine: str, pressure: str, moves: bool, holds: dict[str, str]) -> None:
    system: Any = SimpleNamespace(engine=SimpleNamespace(source=engine), pressure=SimpleNamespace(source=pressure))
    recorded: Any = SimpleNamespace(system=system, output_speed=np.ones(2) if moves else None)
    assert _holds(recorded) == holds
    assert _holds(SimpleNamespace(system=None, output_speed=None)) == {}  # type: ignore[arg-type]


@pytest.mark.parametrize("flywheel", [None, [1.0, 2.0, 3.0]])
def test_a_recording_of_samples_has_every_number(flywheel: list[float] | None, tmp_path: Path,
                                                 monkeypatch: pytest.MonkeyPatch) -> None:
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
    left: list[bool] = []
    monkeypatch.setattr("tcc_sim.recording.mcap_file.McapFile.abandon", lambda file: left.append(True))
    with pytest.raises(AttributeError):
        write_trajectory(tmp_path / "b.mcap", replace(run, state=None))
    assert left == [True]


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
