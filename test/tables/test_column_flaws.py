"""Flaws of measured columns become holes that are named, and no clean motion has one; `test_defects` has the verbs."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.tables.flaws import without_flaws

T = np.arange(4000) * 1e-3
OMEGA = 150.0
CLEAN = {"slip_speed": 20.0 + 5.0 * np.sin(OMEGA * T + 1.0) + np.sin(2.0 * OMEGA * T),
         "plate_speed": 3.0 * np.cos(OMEGA * T), "engine_torque": 300.0 + 120.0 * np.sin(OMEGA * T),
         "actuation_pressure": 2e5 + 1e4 * np.sin(1.7 * T), "engine_speed": np.full(4000, OMEGA)}
NOISY = {name: values + 1e-3 * np.ptp(values) * np.random.default_rng(k).standard_normal(4000)
         for k, (name, values) in enumerate(CLEAN.items())}


def with_rows(values, rows, value):
    out = values.copy()
    out[rows] = value
    return out


SCATTERED = np.arange(40, 3900, 61)
FLAWS = {
    "spike": (lambda x: with_rows(x, [2000], 1e5), [2000]),
    "spikes both ways": (lambda x: with_rows(with_rows(x, [500, 900], x.mean() + 8 * np.ptp(x)), [700],
                                             x.mean() - 8 * np.ptp(x)), [500, 700, 900]),
    "-9999 in a row": (lambda x: with_rows(x, slice(2000, 2030), -9999.0), range(2000, 2030)),
    "two numbers scattered": (lambda x: with_rows(x, SCATTERED, -9999.0 - 6000.0 * (SCATTERED % 2)), SCATTERED),
    "65535 at the end": (lambda x: with_rows(x, slice(3970, 4000), 65535.0), range(3970, 4000))}
STUCK = {"frozen": (lambda x: with_rows(x, slice(1500, 1620), x[1500]), range(1501, 1620))}
COLUMNS = ("slip_speed", "plate_speed", "engine_torque")


def flawed(column, flaw):
    return without_flaws(dict(NOISY) | {column: flaw(NOISY[column])}, T, "x.csv")


@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize("name", [*FLAWS, *STUCK])
def test_a_flaw_is_a_hole_and_is_named_by_its_rows(column, name):
    flaw, rows = {**FLAWS, **STUCK}[name]
    found, notes = flawed(column, flaw)
    assert np.flatnonzero(np.isnan(found[column])).tolist() == list(rows)
    assert all(not np.isnan(values).any() for other, values in found.items() if other != column)
    (note,) = notes
    assert column in note
    assert f"{rows[0] + 1}" in note


@pytest.mark.parametrize("column", COLUMNS)
def test_a_pressure_and_too_much_of_a_column(column):
    found, _ = without_flaws({"actuation_pressure": with_rows(np.full(4000, 2e5), [7, 8], -9999.0)}, T, "x.csv")
    assert np.flatnonzero(np.isnan(found["actuation_pressure"])).tolist() == [7, 8]
    with pytest.raises(InputError) as refusal:
        flawed(column, lambda x: with_rows(x, slice(0, 1200), -9999.0))
    assert all(word in str(refusal.value) for word in ("x.csv", column, "30 %", "25 %"))


@pytest.mark.parametrize("rate", [100, 250])
def test_samples_that_are_held_are_used_once(rate):
    every = 1000 // rate
    found, notes = flawed("slip_speed", lambda x: x[np.arange(4000) // every * every])
    assert np.flatnonzero(np.isfinite(found["slip_speed"])).tolist() == list(range(0, 4000, every))
    assert f"{4000 // every} samples of 4000 rows" in notes[0]


@pytest.mark.parametrize("row", [0, -1])
def test_a_slip_that_ends_in_the_first_row_or_begins_in_the_last_is_no_flaw(row):
    """The clutch sticks, and creeps by at most 0.01 rad/s, in all other rows."""
    stuck = 0.01 * np.sin(np.arange(4000) * 0.02)
    for value, flaws in ((3.1, 0), (-40.0, 0), (-9999.0, 1), (65535.0, 1)):
        found, _ = flawed("slip_speed", lambda x, value=value: np.where(np.arange(4000) == row % 4000, value, stuck))
        assert np.count_nonzero(np.isnan(found["slip_speed"])) == flaws


def test_a_clipped_signal_has_holes_at_its_peaks_and_a_coarse_one_is_named():
    for limit in (24.2, 24.7):
        found, notes = flawed("slip_speed", lambda x, limit=limit: np.minimum(x, limit))
        assert np.isnan(found["slip_speed"]).tolist() == (NOISY["slip_speed"] >= limit).tolist()
        assert "clipped" in notes[0]
        assert "clipped" in flawed("slip_speed", lambda x, limit=limit: np.round(np.minimum(x, limit), 3))[1][0]
    assert "clipped" in flawed("slip_speed", lambda x: np.interp(T / 4, T, x).clip(0, 24) - (T * 1e3 % 10 < 0.5))[1][0]
    found, notes = flawed("slip_speed", lambda x: np.round(STUCK["frozen"][0](x), 1))
    assert np.flatnonzero(np.isnan(found["slip_speed"])).tolist() == list(range(1501, 1620))
    found, notes = flawed("slip_speed", lambda x: np.round(x))
    assert np.isfinite(found["slip_speed"]).all()
    assert "steps of 1:" in notes[-1]


@cache
def motions():
    """Clean tables of many kinds of motion, sampled in many ways, each second one or, for one motion, all."""
    random, out = np.random.default_rng(4), []
    ways = ((0.0, None), (1e-3, None), (1e-2, None), (0.0, 3), (0.0, 4), (1e-3, 4), (3e-2, 3), (0.0, 5), (5e-3, 2))
    of = [*((name, {}) for name in ("fig02", "chaos", "stick", "slip", "tip_in", "runup", "apply")),
          ("fig02", {"friction.law": "set_valued"}), ("chaos", {"friction.law": "set_valued"}),
          ("fig02", {"engine.frequency": 90.0}), ("fig02", {"engine.torque_amplitude": 400.0}), ("controlled", {})]
    for number, (scene, changes) in enumerate(of):
        system = load_scene(scene).with_values(changes)
        run = solve(system, duration=1.5, samples_per_cycle=200)
        for k, rate in enumerate((500.0, 1000.0, 2000.0, 5000.0)):
            begin = random.uniform(0.0, 0.5)
            t = np.arange(begin, 1.45, 1.0 / rate)
            columns = {name: np.interp(t, run.t, getattr(run, name)) for name in (
                "slip_speed", "plate_speed", "plate_angle", "engine_torque")}
            per_pressure = system.system.torque_per_pressure
            columns["actuation_pressure"] = np.interp(t, run.t, run.saturation_torque) / per_pressure
            chosen, most = (ways, len(t)) if scene == "apply" else (ways[(number + k) % 2::2], 700)
            for noise, digits in chosen:
                rows = {name: v + noise * np.std(v) * random.standard_normal(len(v)) for name, v in columns.items()}
                if digits is not None:
                    rows = {name: np.array((f"%.{digits}g " * len(v[:most]) % tuple(v[:most])).split(), np.float64)
                            for name, v in rows.items()}
                out.append((f"{scene} {changes} {rate:g} Hz, noise {noise}, {digits} digits",
                            t[:len(rows["slip_speed"])], rows))
    return out


def test_no_clean_motion_is_accused():
    accused = []
    for name, t, rows in motions():
        found, notes = without_flaws(rows, t, "x.csv")
        if any(np.isnan(values).any() for values in found.values()):
            accused.append((name, notes))
    assert not accused, accused[:5]
    assert len(motions()) > 200
