"""Lines of the estimates, the friction law and the closed forms of made-up scenes, and limits of files of results."""

from __future__ import annotations

import errno
import json
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System
from tcc_sim.model.parameters import replace as changed
from tcc_sim.output import explanation, files, stored_files
from tcc_sim.output.estimates import ActuatorEffect, Estimates, Mode, Torque, estimate_lines, estimates_of
from tcc_sim.output.explanation import closed_form_lines, friction_lines
from tcc_sim.output.fields import unit_of_key, units_in
from tcc_sim.output.terminal import wrapped
from tcc_sim.scene import load_scene

ESTIMATES = Estimates(Mode(400.0, 0.04), Mode(100.0, 0.01), Torque(50.0, 300.0, 550.0), Torque(500.0, 500.0, 500.0),
                      Torque(400.0, 450.0, 500.0), -12.5, "slip", "a reason", -0.6, -250.0, 100.0, (150.0, 150.0))
LINES = ["natural frequencies", "  slipping  400 rad/s (63.66 Hz), damping ratio 0.04   sqrt(K23/I2)",
         "  stuck     100 rad/s (15.92 Hz), damping ratio 0.01   sqrt(K23/(I1 + I2))",
         "torques over a period of excitation",
         "  engine            50 to 550 N m, mean 300 N m", "  clutch, mu_s N R  500 N m",
         "  clutch, mu_k N R  400 to 500 N m, mean 450 N m",
         "  expected: slip; a reason; margin of pure stick (10): -12.5 N m",
         "critical slope (22): -0.6 N m s/rad, friction torque over slip speed; the steepest slope of this law is -250 "
         "N m s/rad, so steady slip at such speeds judders",
         "critical frequency (28): engine frequency 100 rad/s; engine frequency 150 rad/s is above it, so positive "
         "slip falls into the second half of a period of excitation"]
DAMPED = LINES[8].replace("-250", "-0.6").replace("steady slip at such speeds judders",
                                                  "the oscillation of steady slip is damped")
HALF = ("critical frequency (28): engine frequency 100 rad/s; {}, so positive slip falls into the {} half of a period "
        "of excitation")


@pytest.mark.parametrize(("changes", "rows"), [
    ({}, {}), ({"profiles": True}, {3: "torques over the profiles"}),
    ({"stick_margin": None}, {7: "  expected: slip; a reason"}),
    ({"critical_slope": None},
     {8: "critical slope (22): none, because the oscillation of steady slip is damped at every slope"}),
    ({"steepest_slope": -0.6}, {8: DAMPED}),
    ({"fastest": 60.0}, {6: "  clutch at 60 rad/s 400 to 500 N m, mean 450 N m"}),
    ({"engine_frequency": (90.0, 110.0)},
     {9: "critical frequency (28): engine frequency 100 rad/s; the engine frequency 90 to 110 rad/s passes it"}),
    ({"engine_frequency": (90.0, 99.0)}, {9: HALF.format("engine frequency 90 to 99 rad/s is below it", "first")}),
    ({"engine_frequency": (90.0, 100.0)}, {9: HALF.format("engine frequency 90 to 100 rad/s is above it", "second")}),
    ({"engine_frequency": (100.0, 110.0)}, {9: HALF.format("engine frequency 100 to 110 rad/s is above it", "second")}),
    ({"actuator": ActuatorEffect(0.03, 0.0, 2e6, -math.pi, 0.125, 5000.0)},
     {10: "actuator: lag 0.03 s, rate limit 2e+06 Pa/s; at the slipping mode, 400 rad/s, it costs 180 degrees of phase "
      "and leaves 12.5% of the amplitude; the rate limit allows an amplitude of 5000 Pa there"}),
    ({"actuator": ActuatorEffect(0.0, 0.005, 0.0, -1.0, 1.0, None)},
     {10: "actuator: dead time 0.005 s; at the slipping mode, 400 rad/s, it costs 57.3 degrees of phase and leaves "
      "100.0% of the amplitude"})])
def test_the_lines_of_estimates(changes: dict[str, Any], rows: dict[int, str]) -> None:
    lines = estimate_lines(replace(ESTIMATES, **changes))
    expected = [rows.get(k, line) for k, line in enumerate([*LINES, ""])]
    assert lines == [line for line in expected if line]


LAW: dict[str, Any] = {
    "constant": 0.24, "amplitudes": [0.06], "rates": [2.0], "coefficients": (0.3, 0.24), "slopes": (-0.12, 0.0),
    "slip_speeds": (0.0, 3.5), "fit_error": None, "stick_speed": 0.0, "largest_coefficient": 0.3}
TABLE = {"fit_error": 0.0123, "fit_error_at": 2.0, "fit_error_between": 0.0345, "fit_error_between_at": 3.0}


@pytest.mark.parametrize(("changes", "lines"), [
    ({}, ["falls with slip speed from 0.3 to 0.24; its slope is -0.12 to 0 s/rad"]),
    ({"slopes": (0.0, 0.1), "coefficients": (0.2, 0.25)},
     ["rises with slip speed from 0.2 to 0.25; its slope is 0 to 0.1 s/rad"]),
    ({"slopes": (0.0, 0.0)}, ["does not depend on slip speed; its slope is 0 s/rad"]),
    ({"slopes": (-0.1, 0.1)}, ["falls and rises between 0.3 without slip and 0.24; its slope is -0.1 to 0.1 s/rad"]),
    ({"stick_speed": 0.0625},
     ["falls with slip speed from 0.3 to 0.24; its slope is -0.12 to 0 s/rad",
      "  smoothed through 0: slip speeds up to 0.0625 rad/s count as stick; largest coefficient 0.3"]),
    (TABLE, ["falls with slip speed from 0.3 to 0.24 at 3.5 rad/s, the end of the table; its slope is -0.12 to 0 s/rad",
             "  largest error of the fit 1.23% of the largest coefficient of the table, at 2 rad/s; between the points "
             "3.45% from a monotone interpolation, at 3 rad/s"])])
def test_the_lines_of_a_friction_law(changes: dict[str, Any], lines: list[str]) -> None:
    assert friction_lines({**LAW, **changes}) == [
        "sliding friction: mu(v) = 0.24 + 0.06 exp(-2 |v|)", f"  the coefficient {lines[0]}", *lines[1:]]


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
@pytest.mark.parametrize("table", [{}, {"friction.slip_speeds": [0.0, 1.0, 2.0, 4.0],
                                        "friction.coefficients": [0.14, 0.12, 0.11, 0.105]}])
def test_the_figures_of_a_friction_law(law: str, table: dict[str, Any]) -> None:
    """Of mu(v) = c + a exp(-r v) and of mu(v) tanh(50 v) on a grid; stick ends where the latter is largest."""
    found = explanation.friction_of(load_scene("fig02").with_values({**table, "friction.law": law}).system)
    if not table:
        assert (found["constant"], found["amplitudes"], found["rates"]) == (0.24, [pytest.approx(0.06)], [2.0])
    c, (a,), (r,), end = found["constant"], found["amplitudes"], found["rates"], 4.0 if table else 10.0
    v = np.linspace(0.0, end, 1_000_001)
    curve = c + a * np.exp(-r * v)
    smooth = curve * np.tanh(50.0 * v)
    assert found["slip_speeds"] == [0.0, end]
    assert found["coefficients"] == pytest.approx([curve[0], curve[-1] if table else c], rel=1e-12)
    assert found["slopes"] == pytest.approx([-a * r, -a * r * math.exp(-r * end)], rel=1e-9)
    assert found["stick_speed"] == pytest.approx(v[np.argmax(smooth)] if law == "smoothed" else 0.0, rel=1e-3)
    assert found["largest_coefficient"] == pytest.approx(smooth.max() if law == "smoothed" else curve[0], rel=1e-6)
    errors = np.abs(np.interp([0.0, 1.0, 2.0, 4.0], v, curve) - [0.14, 0.12, 0.11, 0.105]) / 0.14
    assert (found["fit_error"], found["fit_error_at"]) == (
        (pytest.approx(errors.max()), [0.0, 1.0, 2.0, 4.0][int(errors.argmax())]) if table else (None, None))
    assert (found["fit_error_between"] is None) == (not table)


def test_torques_over_profiles_are_largest_at_their_corners() -> None:
    """Also at the last one; the mean is that over whole engine cycles."""
    still = {"engine.torque_amplitude": 0.0, "pressure.amplitude": 0.0}
    for times, torques, ends in (([0.0, 0.1003, 0.3], [100.0, 500.0, 50.0], (50.0, 500.0)),
                                 ([0.0, 0.1003, 0.3], [300.0, 50.0, 500.0], (50.0, 500.0))):
        scene = load_scene("fig02").with_values({**still, "engine.mean_torque_times": times,
                                                 "engine.mean_torque_values": torques})
        engine = estimates_of(scene.system).engine
        assert (engine.low, engine.high) == pytest.approx(ends, rel=1e-12)
        cycle = 2.0 * math.pi / 150.0
        t = np.linspace(0.0, math.ceil(0.3 / cycle) * cycle, 100_001)[:-1]
        assert engine.mean == pytest.approx(np.interp(t, times, torques).mean(), rel=1e-3)


SLIP = {"mean": 158.0, "amplitude": 8.0, "growth": 0.0, "least": 100.0, "pure_slip": True, "margin": 150.0,
        "tick_difference": 0.125}
STICK = {"margin": 12.5, "sticks": True, "mean": 0.1, "amplitude": 0.02}


def test_the_lines_of_closed_forms() -> None:
    closed: dict[str, Any] = {"slip": SLIP, "stick": STICK, "slip_why": "", "stick_why": ""}
    lines = closed_form_lines(closed)
    assert lines == [
        "closed forms", "  pure slip (15): 158 rad/s plus sines of 8 rad/s",
        "    margin of (16) 150 rad/s; smallest slip speed with the transient 100 rad/s, so pure slip lasts for ever",
        "    the real-time solver is within 0.12 rad/s of (14) over 500 ticks",
        "  pure stick (10): margin 12.5 N m, so pure stick is possible; plate angle (8) 0.1 rad plus sines of 0.02 rad"]
    closed["slip"] = {**SLIP, "growth": 1.5, "least": -1.0, "pure_slip": False, "tick_difference": None}
    closed["stick"] = {**STICK, "sticks": False}
    other = closed_form_lines(closed)
    assert other[1] == lines[1] + ", growing by 1.5 rad/s^2"
    assert other[2].endswith("smallest slip speed with the transient -1 rad/s, so pure slip does not last")
    assert other[3] == lines[4].replace("is possible", "is not possible")
    closed["slip"]["least"] = None
    assert closed_form_lines(closed)[2].endswith("; slip ends, because the friction torque outweighs the engine torque")
    assert closed_form_lines({"slip": None, "stick": None, "slip_why": "a", "stick_why": "b"}) == [
        "closed forms", "  pure slip (12) to (18): none: a", "  pure stick (8) to (11): none: b"]
    assert closed_form_lines(None) == ["closed forms: none, because a torque comes from a topic"]


def test_kinds_of_terms_and_torques_over_the_whole_period() -> None:
    assert [explanation._kind(value) for value in (None, 1.0, (1.0, 2.0), np.zeros((2, 3)))] == [
        "left out", "number", "2 numbers", "array of 2 by 3 numbers"]
    # The pressure repeats after two cycles of the engine, in each of which the load has other extremes.
    half = changed(System(), {"pressure.frequency_ratio": 0.5, "pressure.amplitude": 0.2 * System().pressure.mean})
    kinetic = estimates_of(half).kinetic
    assert (kinetic.low / kinetic.mean, kinetic.high / kinetic.mean) == pytest.approx((0.8, 1.2), rel=1e-5)
    rising = changed(System(), {"initial.slip_speed": -50.0})
    form, _ = explanation._slip(changed(rising, {"friction.kinetic_coefficient": 0.3}))
    assert form is not None
    assert form.direction == -1


def test_names_of_files_are_as_long_as_a_file_system_allows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    longest = os.pathconf(tmp_path, "PC_NAME_MAX")
    files.check_name(tmp_path / ("x" * longest))
    files.check_name(tmp_path / ("x" * (longest - 5)), 5)
    with pytest.raises(InputError, match=rf"too long: {longest} bytes are allowed$"):
        files.check_name(tmp_path / ("x" * (longest + 1)))
    with pytest.raises(InputError, match=rf"too long: {longest} bytes are allowed, and this command adds 6 bytes$"):
        files.check_name(tmp_path / ("x" * (longest - 5)), 6)
    deep = Path("/" + "/".join(["y" * 99] * 40))  # 4000 bytes.
    files.check_name(deep / ("x" * 94))
    for path, reserve in ((deep / ("x" * 95), 0), (deep / ("x" * 94), 1)):
        with pytest.raises(InputError, match=r"is too long: 4095 bytes are allowed$"):
            files.check_name(path, reserve)
    assert {errno.ENOSPC, errno.EDQUOT, errno.EFBIG} == files.FULL
    path = tmp_path / "a.json"
    path.write_text('{"a": 1}')
    for size, fine in ((8, True), (7, False)):
        monkeypatch.setattr(files, "LARGEST_JSON", size)
        if fine:
            assert files.read_json(path) == {"a": 1}
        else:
            with pytest.raises(InputError, match=r"has 8 bytes; a JSON file of results has at most 7$"):
                files.read_json(path)
    with pytest.raises(InputError, match="is not a regular file"):
        files.read_json(tmp_path)
    with pytest.raises(InputError, match="cannot be read: No such file or directory"):
        files.read_json(tmp_path / "b.json")
    for name, says in (("a.json", "exists; name a directory that does not"), ("no/x", "there is no directory")):
        with pytest.raises(InputError, match=says):
            files.new_directory(tmp_path / name)
    assert files.new_directory(tmp_path / "x") == tmp_path / "x"


@pytest.mark.parametrize("array", [np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6.0).reshape(2, 3)),
                                   np.array("text"), np.array([1, 2], np.int8), np.array([True]), np.empty(0),
                                   np.array([1.0 + 2.0j])])
def test_arrays_come_back_as_they_were(array: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez(tmp_path / "a.npz", a=array, b=np.zeros(3))
    found = stored_files.read_arrays(tmp_path / "a.npz", ["a", "c"])["a"]
    np.testing.assert_array_equal(found, array)
    assert (found.dtype, found.flags.writeable) == (array.dtype, True)
    monkeypatch.setattr(stored_files, "LARGEST_RATIO", 0)
    monkeypatch.setattr(stored_files, "SMALLEST_LIMIT", array.nbytes)
    stored_files.read_arrays(tmp_path / "a.npz", ["a"])
    if array.nbytes:
        monkeypatch.setattr(stored_files, "SMALLEST_LIMIT", array.nbytes - 1)
        with pytest.raises(InputError, match=rf"a would take {array.nbytes} bytes; at most {array.nbytes - 1} are"):
            stored_files.read_arrays(tmp_path / "a.npz", ["a"])
        monkeypatch.setattr(stored_files, "SMALLEST_LIMIT", array.nbytes + 23)
        with pytest.raises(InputError, match=r"b would take 24 bytes; at most 23 are accepted"):
            stored_files.read_arrays(tmp_path / "a.npz", ["a", "b"])


def test_lists_that_belong_together_have_one_length() -> None:
    values = {"a": [1, 2], "b": np.ones(2), "c": "xyz", "d": None}
    stored_files.check_lengths("it", values, ["a", "b", "c", "d", "e"])
    stored_files.check_lengths("it", values, ["a"], 2)
    with pytest.raises(InputError, match=r"^it: b has 2 values; 3 are in a$"):
        stored_files.check_lengths("it", {**values, "a": [1, 2, 3]}, ["a", "b"])
    with pytest.raises(InputError, match=r"^it: a has 2 values; 3 are expected$"):
        stored_files.check_lengths("it", values, ["a"], 3)


def test_units_of_fields_are_found_through_lists_and_keys() -> None:
    keys = ("engine.frequency", "engine.speed", "slip_speed", "engine_torque.offset", "regime", "nothing")
    assert [unit_of_key(key) for key in keys] == ["rad/s", "rad/s", "rad/s", "N m", "", ""]
    assert units_in({"a": ESTIMATES})["slipping.frequency"] == "rad/s"
    assert units_in(ESTIMATES)["engine.low"] == "N m"
    assert "slipping.damping_ratio" not in units_in(ESTIMATES)


def test_lines_are_broken_under_their_last_column() -> None:
    assert wrapped("a" * 50, None) == "a" * 50
    assert wrapped("aaa bbb", 7) == "aaa bbb"
    assert wrapped("aaa bbb", 6) == "aaa\n  bbb"
    assert wrapped("  aaa bbb ccc", 12) == "  aaa bbb\n    ccc"
    assert wrapped("ab  one two three four", 16) == "ab  one two\n    three four"
    assert wrapped("abcdefgh  one two three", 18) == "abcdefgh  one two\n  three"  # The column is in the right half.
    assert wrapped("abcdefg  one two three", 18) == "abcdefg  one two\n         three"
    assert json.loads(json.dumps(wrapped("a\nb", 5))) == "a\nb"
