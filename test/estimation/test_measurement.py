"""Measurements and what identify asks of them, by samples made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fig02_measured import FIG02

from tcc_sim.errors import InputError
from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement, measurement_in, noise_of
from tcc_sim.estimation.multiple_shooting import Model, sensitivities, states_of
from tcc_sim.tables.measured_table import MeasuredTable

T = np.arange(60) * 2e-3
SLIP = np.sin(40.0 * T)
PRESSURE = np.array([4.0, 1.0, 0.0, 5.0] * 15)


def measured(**changes: object) -> Measurement:
    """Sixty samples of slip."""
    return Measurement(**{"t": T, "channels": {"slip_speed": SLIP}, **changes})


@pytest.mark.parametrize("name", ["engine_torque", "actuation_pressure"])
def test_an_input_has_ends_of_every_step(name: str) -> None:
    """A smooth pressure is never below 0, a torque may be; its corners are lower by a twelfth of their bends."""
    after = np.append(PRESSURE[1:], PRESSURE[-1])
    corners = PRESSURE - np.append(0.0, np.append(np.diff(PRESSURE, 2) / 12.0, 0.0))
    if name == "actuation_pressure":
        corners = np.maximum(corners, 0.0)
    for hold, ends in ((None, (PRESSURE, PRESSURE)), ("previous", (PRESSURE, PRESSURE)), ("next", (after, after)),
                       ("linear", (PRESSURE, after)), ("smooth", (corners, np.append(corners[1:], corners[-1])))):
        of = measured(inputs={name: PRESSURE}, hold=hold)
        assert of.ends_of(name) == pytest.approx(np.stack(ends, axis=1))
        assert of.at_samples(name).tolist() == PRESSURE.tolist()
    both = np.stack([PRESSURE, PRESSURE + 1.0], axis=1)
    of = measured(inputs={name: both})
    assert (of.ends_of(name).tolist(), of.at_samples(name).tolist()) == (both.tolist(), PRESSURE.tolist())
    assert measured().ends_of(name).tolist() == [[0.0, 0.0]] * 60
    assert measured().step == pytest.approx(2e-3, rel=1e-12)


def test_noise_is_at_least_the_solvers_error_and_that_of_white_noise() -> None:
    """The sixth differences of a polynomial of degree 5 vanish, and its kink does not count."""
    assert noise_of(T**5) == pytest.approx(1e-4 * T[-1]**5)
    assert noise_of(-100.0 * np.abs(T - 0.06)) == pytest.approx(1e-4 * 6.0)
    white = 0.3 * np.random.default_rng(2).standard_normal(20_000)
    assert noise_of(white) == pytest.approx(0.3, rel=0.02)


LATE, GAP, EARLY = T.copy(), T.copy(), T.copy()
LATE[40:] += 2.1e-6
GAP[30:] += 1.1e-3
EARLY[40:] -= 2.1e-6


@pytest.mark.parametrize(("changes", "words"), [
    ({"t": T[:49], "channels": {"slip_speed": SLIP[:49]}}, ("49", "50 to 1000000")),
    ({"channels": {"plate_speed": SLIP}, "source": "x.csv"}, ("x.csv", "slip_speed")),
    ({"channels": {"slip_speed": np.append(SLIP[:7], [np.nan] * 53)}}, ("slip_speed", "sample 7")),
    ({"inputs": {"engine_torque": np.append(SLIP[:9], [np.inf] * 51)}}, ("engine_torque", "sample 9")),
    ({"t": np.append(T[:3], [np.nan] * 57)}, (" t ", "sample 3")), ({"t": T[::-1]}, ("increase",)),
    ({"t": 0.0 * T}, ("increase",)), ({"t": GAP}, ("0.058 to 0.0611 s", "0.002 s")),
    ({"t": LATE}, ("0.0020021 s", "0.078 s", "0.002 s")), ({"t": EARLY}, ("0.0019979 s", "0.078 s", "0.002 s")),
    ({"channels": {"slip_speed": 0.0 * T + 3.0}}, ("slip_speed", "3 rad/s", "dead")),
    ({"channels": {"slip_speed": SLIP, "plate_angle": 1e-13 * SLIP}}, ("plate_angle", "0 rad", "dead")),
    ({"channels": {"slip_speed": 1e3 + 0.4e-9 * SLIP}}, ("slip_speed", "1000 rad/s", "dead"))])
def test_a_measurement_names_what_is_wrong_with_it(changes: dict[str, object], words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as error:
        measured(**changes)
    assert all(word in str(error.value) for word in words), str(error.value)


def test_a_measurement_at_the_ends_of_what_is_allowed() -> None:
    assert len(measured(t=T[:50], channels={"slip_speed": SLIP[:50]}).t) == 50
    assert measured(t=np.where(T > 0.079, T + 1.9e-6, T)).step == pytest.approx(2e-3, rel=1e-4)
    for later, words in ((0.99e-3, "0.00299 s at 0.058 s"), (2e-3, "0.058 to 0.062 s")):
        with pytest.raises(InputError, match=words):
            measured(t=np.where(T > 0.059, T + later, T))
    assert measured(channels={"slip_speed": 1e3 + 1e-8 * SLIP}).hold is None
    assert measured(channels={"slip_speed": SLIP, "plate_angle": 1e-11 * SLIP}).notes == ()


def test_a_last_step_that_is_shorter_by_a_thousandth_is_left_out() -> None:
    for rows in (0, 1, 2):  # A part of a table may be empty.
        with pytest.raises(InputError, match=rf"^x.csv has {rows} samples; 50 to 1000000 are needed$"):
            measurement_in(MeasuredTable({"t": T[:rows], "slip_speed": SLIP[:rows]}, {}, "x.csv"))
    for last, left_out in ((1.999e-3, 0), (1.997e-3, 1), (2.5e-3, 0)):
        t = np.append(T, T[-1] + last)
        table = MeasuredTable({"t": t, "slip_speed": np.append(SLIP, 7.0), "engine_torque": np.append(SLIP, 8.0)},
                              {}, "x.csv")
        if last > 2e-3:
            with pytest.raises(InputError, match="has a step of"):
                measurement_in(table)
            continue
        found = measurement_in(table)
        assert (len(found.t), len(found.channels["slip_speed"]),
            len(found.inputs["engine_torque"])) == (61 - left_out,) * 3
        assert found.notes == ("x.csv: the last sample is left out; its step of 0.001997 s is shorter than the "
                               "others, 0.002 s",
                               )[:left_out]


def test_columns_that_are_sampled_more_slowly_are_joined() -> None:
    """Every third row, from the second on; an empty slip speed leaves its row out."""
    sparse = np.where((np.arange(62) - 1) % 3 == 0, np.arange(62.0), np.nan)
    slip = np.where(np.arange(62) == 61, np.nan, np.sin(0.08 * np.arange(62)))
    table = MeasuredTable({"t": 2e-3 * np.arange(62), "slip_speed": slip, "plate_speed": sparse,
                           "engine_torque": np.full(62, 7.0), "output_speed": np.zeros(62)},
                           {"engine_torque": "next"}, "x.csv")
    found = measurement_in(table)
    assert found.t.tolist() == (2e-3 * np.arange(1, 61)).tolist()
    assert found.channels["plate_speed"] == pytest.approx(np.arange(1.0, 61.0))
    assert (list(found.channels), list(found.inputs), found.hold, found.source) == (
        ["slip_speed", "plate_speed"], ["engine_torque"], "next", "x.csv")
    assert found.notes == ("x.csv: plate_speed joined by straight lines where cells are empty, between its regular "
                           "samples",)
    held = {"engine_torque": "next", "actuation_pressure": "linear"}
    whole = {"t": 2e-3 * np.arange(62), "slip_speed": np.sin(np.arange(62.0)), "engine_torque": np.full(62, 7.0)}
    assert measurement_in(MeasuredTable(whole | {"actuation_pressure": np.full(62, 1e5)}, held)).hold is None
    assert (measurement_in(MeasuredTable(whole, held)).hold, measurement_in(MeasuredTable(whole,
        held)).notes) == ("next", ())
    with pytest.raises(InputError, match=r"^x.csv: the far end of the shaft moved \(output_speed up to 2 rad/s\); "
                       r"identification needs one at rest$"):
        measurement_in(MeasuredTable(whole | {"output_speed": np.append([np.nan, -2.0], np.zeros(60))}, {}, "x.csv"))


@pytest.mark.parametrize(("free", "how", "words"), [
    ({}, {}, ("no key",)), ("friction.decai", {}, ("friction.decai", "friction.decay?")),
    (["clutch.area"], {}, ("clutch.area", "friction.curve", "driveline.damping", "actuation_pressure.offset")),
    ({"driveline.damping": 0.0}, {}, ("driveline.damping", "0 N m s/rad", "above 0")),
    ({"driveline.damping": -1.0}, {}, ("driveline.damping", "-1 N m s/rad", "0 to 10000")),
    (["driveline.damping"], {"likelihood": "driveline.stiffness"}, ("likelihood", "driveline.stiffness")),
    (["driveline.damping"], {"hold": "cubic"}, ("hold", "cubic", "previous, linear, smooth or next")),
    (["driveline.damping"], {"noise": {"slip": 1.0}}, ("noise", "'slip'", "slip_speed, plate_speed, plate_angle")),
    *((["driveline.damping"], {"noise": {"slip_speed": x}}, ("noise", "slip_speed", f"{x:g} rad/s", "above 0"))
      for x in (0.0, -1.0, math.inf)),
    (["driveline.damping"], {"scene": FIG02.with_values({"friction.law": "set_valued"})}, ("friction.law", "smoothed")),
    (["driveline.damping"], {"scene": None}, ("--scene",)),
    (["friction.curve", "friction.decay"], {}, ("friction.decay", "friction.curve")),
    *(({"friction.curve": count}, {}, ("friction.curve", f"{count:g}", "1 to 3")) for count in (0, 4, 1.5)),
    (["friction.decay"], {"scene": FIG02.with_values({"friction.slip_speeds": [0.0, 1.0, 2.0],
                                                      "friction.coefficients": [0.2, 0.2, 0.2]})},
     ("friction.decay", "friction.slip_speeds", "friction.curve")),
    (["friction.curve"], {"slip": 1e-3 * SLIP}, ("friction.curve", "slip"))])
def test_what_cannot_be_fitted_is_refused(free: object, how: dict[str, object], words: tuple[str, ...]) -> None:
    slip = how.pop("slip", SLIP)
    with pytest.raises(InputError) as error:
        identify(measured(channels={"slip_speed": slip}), free, **{"scene": FIG02, **how})
    assert all(word in str(error.value) for word in words), str(error.value)


def test_derivatives_by_every_key_are_those_of_differences() -> None:
    """With measured and unmeasured inputs, in slip and through stick."""
    values = {"friction.static_coefficient": 0.3, "friction.kinetic_coefficient": 0.24, "friction.decay": 2.0,
              "friction.smoothing": 50.0, "driveline.damping": 0.6, "driveline.stiffness": 3000.0,
              "driveline.flywheel_inertia": 0.2, "driveline.plate_inertia": 0.02, "converter.coupling": 0.1,
              "engine_torque.offset": 3.0, "actuation_pressure.offset": 2e3}
    curve = {f"friction.curve.{name}": value for name, value in (
        ("constant", 0.25), ("share_1", 0.2), ("rate_1", 0.4), ("share_2", -0.16), ("rate_2", 0.02))}
    starts = np.array([[40.0, 0.1, 2.0], [0.5, 0.09, -1.0], [-3.0, 0.1, 0.0]])
    inputs = {"engine_torque": 300.0 + 100.0 * SLIP, "actuation_pressure": 2e5 + 1e4 * SLIP}
    for named, given in ((values, {}), (values, inputs), (curve, {})):
        of, at = Model(FIG02.system, tuple(named), measured(inputs=given, hold="linear")), np.array([*named.values()])
        n = of.substeps(at)
        _, by = sensitivities(of, starts, 4, at, n)
        for i, (key, value) in enumerate(named.items()):
            ends = [states_of(of, starts, 4, at + s * value * np.eye(len(at))[i], n) for s in (1e-5, -1e-5)]
            slope = (ends[0] - ends[1]) / (2e-5 * value)
            np.testing.assert_allclose(by[..., 3 + i], slope, rtol=1e-4, atol=1e-3 * np.abs(slope).max(), err_msg=key)


@pytest.mark.parametrize("name", ["slip_speed", "plate_speed", "engine_torque"])
def test_a_flawed_stretch_leaves_the_longest_part_and_one_row_of_an_input_is_bridged(name: str) -> None:
    t = 2e-3 * np.arange(200)
    columns = {"t": t, "slip_speed": np.sin(40.0 * t), "plate_speed": np.cos(40.0 * t), "engine_torque": 5.0 * t}
    columns[name] = np.where((np.arange(200) >= 60) & (np.arange(200) < 90), np.nan, columns[name])
    columns["engine_torque"] = np.where(np.arange(200) == 120, np.nan, columns["engine_torque"])
    found = measurement_in(MeasuredTable(columns, {}, "x.csv"))
    assert found.t.tolist() == t[90:].tolist()
    assert found.inputs["engine_torque"] == pytest.approx(5.0 * found.t)
    assert any("0.18 to 0.398 s" in note for note in found.notes)
    assert any("engine_torque" in note and "0.238 to 0.242 s" in note for note in found.notes)
