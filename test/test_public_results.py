"""Results of public functions: each has a short text, columns, a notebook's view and a picture."""

from __future__ import annotations

import inspect
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

import tcc_sim
from tcc_sim.errors import InputError
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.output.samples import write_trajectory
from tcc_sim.study.basins.results import Axis
from tcc_sim.study.continuation.bifurcations import Bifurcation

AMPLITUDE, PRESSURE = "engine.torque_amplitude", "pressure.mean"
FOLDER = TemporaryDirectory()
STICK = tcc_sim.load_scene("stick").with_values({"friction.law": "set_valued"})


@cache
def recording() -> Path:
    scene = tcc_sim.load_scene("slip")
    path = Path(FOLDER.name) / "run.mcap"
    write_trajectory(path, tcc_sim.solve(scene, cycles=60, samples_per_cycle=50), scene.text())
    return path


def identified() -> Any:
    run = tcc_sim.closed_loop("minimal", lambda reading: None, seconds=0.4)
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(run.t))
    return tcc_sim.identify(Measurement(run.t, {"slip_speed": run.slip_speed + noise}),
                            {"driveline.stiffness": 3200.0}, scene="minimal")


RESULTS = {
    "solve": lambda: tcc_sim.solve("fig02", cycles=30, samples_per_cycle=50),
    "simulate": lambda: tcc_sim.simulate("slip", cycles=40, samples_per_cycle=50),
    "closed_loop": lambda: tcc_sim.closed_loop("controlled", lambda reading: 200e3, seconds=0.3),
    "sweep": lambda: tcc_sim.sweep("slip", AMPLITUDE, [10.0, 20.0], cycles=20),
    "sweep_grid": lambda: tcc_sim.sweep_grid("slip", AMPLITUDE, [10.0, 20.0], PRESSURE, [2e5, 3e5], cycles=20),
    "gain_map": lambda: tcc_sim.gain_map("controlled", lambda gain: lambda reading: 80e3 + gain * (
        reading.slip_speed - 20.0), {"gain": [500.0, 2000.0]}, target=20.0, duration=0.4),
    "scatter": lambda: tcc_sim.scatter("slip", {AMPLITUDE: (10.0, 20.0)}, 4, cycles=20),
    "analyse": lambda: tcc_sim.analyse(recording()),
    "read": lambda: tcc_sim.read(recording()),
    "continuation": lambda: tcc_sim.continuation(STICK, "engine.mean_torque", 295.0, 305.0),
    "basins": lambda: tcc_sim.basins("stick", [Axis("initial.slip_speed", (0.0, 50.0)),
                                               Axis("initial.plate_angle", (0.0, 0.1))])[0],
    "linearise": lambda: tcc_sim.linearise("controlled", slip=20.0, frequencies=[5.0, 50.0]),
    "identify": identified,
    "orders": lambda: tcc_sim.orders(tcc_sim.solve("slip", cycles=40, samples_per_cycle=50)),
    "spectrum": lambda: tcc_sim.spectrum(tcc_sim.simulate("slip", cycles=40)),
}
"""A result of every function, cheap ones."""
OTHERS = ("explain", "figure", "fmu", "fmu_controller")
"""Functions that return an object of JSON, a figure of the paper, a path or a law; they have tests of their own."""


@cache
def result(name: str) -> Any:
    return RESULTS[name]()


def functions() -> list[str]:
    """The public functions that compute or read something."""
    return [name for name in tcc_sim.__all__
            if inspect.isfunction(getattr(tcc_sim, name)) and name not in ("load_scene", "plot", *OTHERS)]


def test_every_public_function_is_tried_and_names_its_keywords() -> None:
    assert set(functions()) <= set(RESULTS)
    for name in (*functions(), *OTHERS):
        kinds = {p.kind for p in inspect.signature(getattr(tcc_sim, name)).parameters.values()}
        assert not kinds & {inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL}, name


@pytest.mark.parametrize("name", RESULTS)
def test_its_text_is_short_and_its_columns_are_a_table(name: str) -> None:
    outcome = result(name)
    assert len(repr(outcome)) < 800
    assert "array(" not in repr(outcome)
    columns = outcome.columns()
    assert len({len(column) for column in columns.values()}) == 1
    assert not {np.ndim(column) for column in columns.values()} - {1}
    shown = outcome._repr_html_()
    assert shown.count("<tr>") in range(2, 22) or "<pre>" in shown


def test_a_doubtful_fit_of_the_friction_table_is_in_the_text_of_a_result() -> None:
    """No sum of falling exponentials passes through a table that goes up and down by 3 %."""
    table = {"friction.slip_speeds": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
             "friction.coefficients": [0.123, 0.117, 0.123, 0.117, 0.123, 0.117]}
    scene = tcc_sim.load_scene("slip").with_values(table)
    assert "friction table" in repr(tcc_sim.simulate(scene, cycles=4))


@pytest.mark.parametrize("name", RESULTS)
def test_it_is_drawn_and_no_file_is_overwritten(name: str, pictures: list[Any], tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    from tcc_sim.views import style

    path = tmp_path / "it.png"
    assert tcc_sim.plot(result(name), path, width="column", title="a title") == path
    assert all(axis.has_data() for axis in pictures[0].axes)
    path.write_text("mine")
    with pytest.raises(InputError, match="not overwritten"):
        tcc_sim.plot(result(name), path)
    assert path.read_text() == "mine"
    axis = Figure().subplots()
    assert tcc_sim.plot(result(name), ax=axis, title="a title") is axis
    assert axis.has_data()
    assert axis.get_xlabel()
    assert axis.get_ylabel()
    named = style.entries(axis)[1]
    assert len(named) < 2 or [text.get_text() for text in axis.get_legend().get_texts()] == named


def test_parts_of_results_are_short_too() -> None:
    outcome = result("continuation")
    kink = Bifurcation("fold", outcome.branches[0].points[0], 1e-9)
    parts = [*outcome.branches, kink, outcome.branches[0].points[0], *result("analyse").segments,
             *result("basins").attractors]
    assert outcome.branches
    for part in parts:
        assert len(repr(part)) < 400
