"""Every defect of a table with every verb: its result is right, or one sentence refuses it; no defect is silent."""

import re
from functools import cache

import numpy as np
import pytest

from tcc_sim.analysis.measured.measured_phase import signals_in
from tcc_sim.analysis.measured.orders import orders_of
from tcc_sim.errors import InputError
from tcc_sim.estimation.identify import given
from tcc_sim.model.parameters import System
from tcc_sim.replay.given_inputs import doubts_about, driven_by, input_table
from tcc_sim.scene import load_scene
from tcc_sim.solvers.terms import terms_of, torques_at
from tcc_sim.tables.measured_table import table_in

T = np.round(np.arange(0.0, 3.0, 1e-3), 6)
W = 150.0
G = np.random.default_rng(1)


def slip(t):
    return 20.0 + 5.0 * np.sin(W * t + 0.4)


def torque(t):
    return 300.0 + 100.0 * np.sin(W * t)


def columns(t=T):
    return {"t": t, "slip_speed": slip(t), "engine_torque": torque(t), "engine_speed": np.full(len(t), W)}


def rows(numbers):
    return {name: values[numbers] for name, values in columns().items()}


def without(*slices):
    return rows(np.delete(np.arange(len(T)), np.r_[slices]))


def empty(name, part):
    result = columns()
    result[name] = np.where(np.isin(np.arange(len(T)), np.arange(len(T))[part]), np.nan, result[name])
    return result


def late(shift):
    return {**columns(), "t": T + shift}


def jittered(share):
    t = T + share * 1e-3 * G.uniform(0.0, 1.0, len(T))
    return columns(t)


def repeated_stamp():
    result = columns()
    result["t"] = np.where(np.arange(len(T)) == 700, T[699], T)
    return result


def slow(name, every):
    result = columns()
    result[name] = np.where(np.arange(len(T)) % every == 0, result[name], np.nan)
    return result


def wrong(name, part, value):
    result = columns()
    result[name][part] = value
    return result


SCATTERED = np.arange(40, 2900, 131)
SWAPPED = np.arange(len(T))
SWAPPED[[100, 101, 900, 905]] = [101, 100, 905, 900]
DEFECTS = {  # Columns, shift of the time that is meant, and the words that name the defect, with all verbs or with one.
    "none": (columns(), 0.0, None), "one row is missing": (without(np.s_[1000:1001]), 0.0, "hole|missing|gap"),
    "20 ms are missing": (without(np.s_[1000:1020]), 0.0, "hole|gap"),
    "a second is missing": (without(np.s_[1000:2000]), 0.0, "hole|gap"),
    "several holes": (without(np.s_[400:500], np.s_[1000:1002], np.s_[2500:2600]), 0.0, "hole|gap"),
    "2 % of the rows are missing": (rows(np.flatnonzero(G.random(len(T)) > 0.02)), 0.0, "hole|missing|gap"),
    "a slip speed is empty": (empty("slip_speed", np.s_[700:701]), 0.0,
                              "empty cells: 1 of 3000 in slip_speed|gap"),
    "half a second of slip speed": (empty("slip_speed", np.s_[700:1200]), 0.0, "empty cells|gap"),
    "half a second of torque": (empty("engine_torque", np.s_[700:1200]), 0.0, "empty cells|hole|sample 700"),
    "half a second of engine speed": (empty("engine_speed", np.s_[700:1200]), 0.0, "empty cells"),
    "a torque that starts late": (empty("engine_torque", np.s_[:300]), 0.0, "empty cells|hole|sample 0"),
    "no torque at all": (empty("engine_torque", np.s_[:]), 0.0, "empty cells|must name the column"),
    "rows without a time": (empty("t", np.s_[700:720]), 0.0, "without a time|hole|gap"),
    "shuffled": (rows(G.permutation(len(T))), 0.0, "rows were sorted by time"),
    "backwards": (rows(np.arange(len(T))[::-1]), 0.0, "sorted by time"),
    "swapped": (rows(SWAPPED), 0.0, "sorted by time"),
    "blocks out of order": (rows(np.r_[2000:3000, 0:1000, 1000:2000]), 0.0, "sorted by time"),
    "a reset": (rows(np.r_[0:800, 0:3000]), 0.0, "the times start again 1 time .* only the longest of 2 runs is used"),
    "repeated rows": (rows(np.sort(np.r_[0:3000, 50, 51, 800])), 0.0, "3 rows repeated time and values"),
    "a repeated stamp": (repeated_stamp(), 0.0, "1 row repeated the time of the row before; each was placed between"),
    "a late start": (late(5000.0), 5000.0, "starts at its time 5000 s|^$"),
    "a start before 0": (late(-5.0), -5.0, "starts at its time -5 s|^$"),
    "seconds since 1970": (late(1.7e9), 0.0, "times in s since 1970"),
    "jitter": (jittered(0.4), 0.0, "steps between rows vary by|evenly spaced"),
    "strong jitter": (jittered(0.9), 0.0, "steps between rows vary by|evenly spaced"),
    "stamps of 10 ms": ({**columns(), "t": np.floor(T * 100.0 + 0.5) / 100.0}, 0.0, "even steps of"),
    "an engine speed at 250 Hz": (slow("engine_speed", 4), 0.0, "empty cells: 2250 of 3000 in engine_speed"),
    "a torque at 500 Hz": (slow("engine_torque", 2), 0.0, "empty cells: 1500 of 3000 in engine_torque"),
    **{f"{flaw} of {name}": (wrong(name, part, value), 0.0, rf"{name}.*row.*\b{row}\b|hole") for name in (
        "slip_speed", "engine_torque") for flaw, part, value, row in (
        ("a spike", [2000], 1e5, 2001), ("30 rows of -9999", np.s_[2000:2030], -9999.0, 2001),
        ("scattered -9999", SCATTERED, -9999.0, 41), ("65535 at the end", np.s_[2970:], 65535.0, 2971))},
    "times in ms": ({**columns(), "t": 1e3 * T}, None, "say so with --columns t=COLUMN:ms"),
    "an engine speed in rpm": ({**columns(), "engine_speed": np.full(len(T), W * 30.0 / np.pi)}, 0.0, "in rpm|^$"),
}


def written(path, result):
    np.savetxt(path, np.column_stack(list(result.values())), delimiter=",", header=",".join(result), comments="",
               fmt="%.13g")
    return path


def analysed(path, shift):
    """The amplitude of order 1 of the slip speed, 5 rad/s, in every window."""
    table = table_in(path, ("slip_speed",))
    signals = signals_in(table, System())
    orders = orders_of(signals)
    assert np.abs(orders.cut(1.0, "slip_speed") / 5.0 - 1.0).max() < 0.01
    assert np.abs(orders.frequency / W - 1.0).max() < 1e-3
    return (*table.notes, *signals.notes)


def simulated(path, shift):
    """The torque that drives, at every instant."""
    table = input_table(path)
    system = driven_by(load_scene("minimal"), table, "smooth").system
    if shift is not None:
        t = np.linspace(0.01, table.t[-1] - 0.01, 5000)
        assert np.abs(torques_at(terms_of(system), t)[0] - torque(t)).max() < 3.0
    return (*table.notes, *doubts_about(table))


def identified(path, shift):
    """The slip speed and the torque at the samples that a fit uses."""
    measured, _ = given(path, load_scene("minimal"))
    if shift is not None:
        assert np.abs(measured.channels["slip_speed"] - slip(measured.t - shift)).max() < 0.4
        assert "engine_torque" not in measured.inputs or np.abs(
            measured.inputs["engine_torque"] - torque(measured.t - shift)).max() < 3.0
        assert measured.step == pytest.approx(1e-3, rel=1e-3)
    return measured.notes


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Function of a defect's name that returns its table, written once."""
    return cache(lambda name: written(tmp_path_factory.mktemp("defects") / "run.csv", DEFECTS[name][0]))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("verb", [analysed, simulated, identified])
@pytest.mark.parametrize("name", DEFECTS)
def test_no_defect_is_silent(stored, name, verb):
    (_, shift, words), path = DEFECTS[name], stored(name)
    if name == "times in ms" and verb is identified:
        pytest.skip("test_times_in_ms_are_found_by_the_driveline")
    try:
        said = " ".join(verb(path, shift))
    except InputError as error:
        said = str(error)
        assert "\n" not in said
    assert (said == "") if words is None else re.search(words, said), said


def test_times_in_ms_are_found_by_the_driveline(tmp_path, refused):
    written(tmp_path / "run.csv", DEFECTS["times in ms"][0])
    assert "in which the driveline oscillates 62 times; if its times are in ms, say so with --columns" in refused(
        "identify", "run.csv", "--scene", "minimal", "--free", "driveline.stiffness")


def test_a_simulation_takes_a_part_beside_a_hole(tmp_path, refused):
    path = written(tmp_path / "run.csv", DEFECTS["a second is missing"][0])
    why = refused("simulate", "minimal", "--inputs", path)
    assert "0.999 to 2 s, beside steps of 0.001 s; a simulation needs inputs without holes: take a part" in why
    part = input_table(path, start=2.0)
    system = driven_by(load_scene("minimal"), part, "smooth").system
    t = np.linspace(0.01, 0.9, 500)
    assert np.abs(torques_at(terms_of(system), t)[0] - torque(t + 2.0)).max() < 1.0
    assert part.notes == ("run.csv: the simulation starts at its time 2 s",)
