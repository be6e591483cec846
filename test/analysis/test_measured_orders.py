"""A table of a run-up by SciPy beside the simulated one, and sources of its phase."""

import json
import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tcc_sim.analysis.measured.measured_phase import signals_in
from tcc_sim.analysis.measured.orders import orders_of
from tcc_sim.cli import main
from tcc_sim.model.parameters import System
from tcc_sim.tables.measured_table import MeasuredTable

I1, I2, C23, K23, MU_S, MU_K, ALPHA, SIGMA, LOAD = 0.2, 0.02, 0.6, 3000.0, 0.3, 0.24, 2.0, 50.0, 225e3 * 0.08 * 0.1
SCENE = ["fig02", "--set", "initial.slip_speed=5"]
END = 2.0


def rates(t, y):
    v, angle, speed, phase = y
    torque = 300.0 + 250.0 * math.sin(phase) + 60.0 * math.sin(2.0 * phase + 0.3)
    friction = (MU_K + (MU_S - MU_K) * math.exp(-ALPHA * abs(v))) * math.tanh(SIGMA * v) * LOAD
    plate = (friction - C23 * speed - K23 * angle) / I2
    return [(torque - friction) / I1 - plate, speed, plate, 130.0 + 20.0 * t]


@pytest.fixture(scope="module")
def columns():
    t = np.arange(0.0, END, 2.5e-4)
    v, angle, speed, phase = solve_ivp(rates, (0.0, END), [5.0, 0.0, 0.0, 0.0], "LSODA", t, rtol=1e-9, atol=1e-9).y
    return {"t": t, "engine_torque": 300.0 + 250.0 * np.sin(phase) + 60.0 * np.sin(2.0 * phase + 0.3),
            "actuation_pressure": np.full_like(t, 225e3), "slip_speed": v, "plate_speed": speed, "plate_angle": angle,
            "engine_speed": 130.0 + 20.0 * t, "tacho": 5.0 * (np.sin(phase) > 0.0)}


def table(path, columns, *left_out):
    kept = {name: values for name, values in columns.items() if name not in left_out}
    np.savetxt(path, np.column_stack(list(kept.values())), delimiter=",", header=",".join(kept), comments="",
               fmt="%.12g")
    return str(path)


@pytest.fixture(scope="module")
def fewer(columns):
    """The columns at 1 kHz."""
    return {name: values[::4] for name, values in columns.items()}


@pytest.fixture(scope="module")
def aligned(tmp_path_factory, columns, fewer):
    """Function that gives a table without some columns, and the JSON of a simulation beside it."""
    @cache
    def of(*left_out, hold):
        folder = tmp_path_factory.mktemp("orders")
        path = table(folder / "run.csv", fewer if hold == "smooth" else columns, *left_out)
        assert main(["simulate", *SCENE, "--inputs", path, "--hold", hold, "--orders", "--json",
                     str(folder / "result.json")]) == 0
        return path, json.loads((folder / "result.json").read_text())
    return of


def levels(result, name, order):
    column = result["order"].index(order)
    return 20.0 * np.log10(np.array(result[name])[:, column])


@pytest.mark.parametrize(("left_out", "hold"), [
    (("engine_speed",), "linear"), (("engine_speed", "tacho"), "linear"), (("tacho",), "smooth")])
def test_simulated_orders_are_within_a_third_of_a_decibel_of_measured_ones(aligned, left_out, hold):
    """Sampled at 4 kHz, or at 1 kHz."""
    _, result = aligned(*left_out, hold=hold)
    for name in ("slip_speed", "shaft_torque"):
        for order in (1.0, 2.0, 3.0, 4.0):
            measured, simulated = (levels(result[run], name, order) for run in ("measured_orders", "orders"))
            loud = measured > measured.max() - 30.0
            assert loud.sum() > 5
            assert np.abs(simulated - measured)[loud].max() < 0.3
    speed = 130.0 + 20.0 * np.array(result["measured_orders"]["time"])
    np.testing.assert_allclose(result["measured_orders"]["frequency"], speed, rtol=5e-3)


@pytest.mark.parametrize(("source", "words"), [
    ("engine_speed", ["--scene", "four.yaml"]), ("tacho", ["--pulses", "2"])])
def test_orders_are_those_of_the_crankshaft(tmp_path, monkeypatch, fewer, source, words):
    """With two periods of the excitation a revolution, and with two pulses."""
    monkeypatch.chdir(tmp_path)
    columns = {**fewer, "engine_speed": 0.5 * fewer["engine_speed"]}
    table(tmp_path / "run.csv", columns, *{"engine_speed", "tacho"} - {source})
    (tmp_path / "four.yaml").write_text("/**:\n  ros__parameters:\n    engine:\n      order: 2.0\n")
    assert main(["analyse", "run.csv", "--orders", *words, "--json", "result.json"]) == 0
    document = json.loads((tmp_path / "result.json").read_text())["orders"]
    assert (document["torque_order"], 0.5 in document["order"]) == ([2.0, 4.0], True)
    speed = (130.0 + 20.0 * np.array(document["time"])) * (1.0 if source == "engine_speed" else 0.5)
    np.testing.assert_allclose(document["frequency"], speed, rtol=1e-2)


@pytest.mark.parametrize(("left_out", "words", "message"), [
    (("engine_speed", "tacho", "engine_torque"), ["--orders"], "orders need one of the columns engine_speed, tacho"),
    (("slip_speed",), ["--orders"], "there is no column slip_speed"),
    ((), [], "a table needs --orders or --spectrum"),
    ((), ["--orders", "--verify"], "--verify: only for recordings; a table takes"),
    ((), ["--orders", "--from", "1.998"], "at least 4 rows"),
    ((), ["--orders", "--to", "0.3"], "orders need 16 periods of the excitation"),
])
def test_a_table_that_shows_no_orders_is_refused(tmp_path, fewer, refused, left_out, words, message):
    path = table(tmp_path / "run.csv", fewer, *left_out)
    assert message in refused("analyse", path, *words, "--json", "none.json")


@pytest.mark.parametrize(("rate", "low", "high"), [(200.0, 150.0, 150.0), (400.0, 150.0, 150.0), (260.0, 100.0, 250.0)])
def test_orders_keep_their_size_up_to_the_end_of_the_band(rate, low, high):
    """Orders 1 and 2 of 2 rad/s, order 2 sampled 4.2 and 8.4 times in a period, or 8.2 to 3.3 times in a run-up."""
    t = np.arange(0.0, 6.0, 1.0 / rate)
    speed, phase = low + (high - low) * t / 6.0, low * t + (high - low) * t**2 / 12.0
    slip = 20.0 + 2.0 * np.sin(phase + 0.3) + 2.0 * np.sin(2.0 * phase)
    found = orders_of(signals_in(MeasuredTable({"t": t, "slip_speed": slip, "engine_speed": speed}), System()))
    for order in (1.0, 2.0):
        assert found.cut(order, "slip_speed") == pytest.approx(np.full(len(found.time), 2.0), rel=0.012)
