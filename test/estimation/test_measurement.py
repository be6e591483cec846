"""Measurements and what identify asks of them, by samples made by hand."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from fig02_measured import FIG02

from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.estimation import identify as identification
from tcc_sim.estimation.measurement import Measurement, measurement_in, noise_of
from tcc_sim.estimation.multiple_shooting import Fit
from tcc_sim.estimation.search import Search
from tcc_sim.estimation.settings import FitSettings, Gates
from tcc_sim.estimation.windows import (
    LOAD_AMPLITUDE,
    LOG_LOAD,
    MEAN_LOAD,
    Model,
    check_key,
    largest_errors,
    on_its_side,
    sensitivities,
    states_of,
)
from tcc_sim.solvers.terms import terms_of
from tcc_sim.tables.measured_table import MeasuredTable

T = np.arange(60) * 2e-3
SLIP = np.sin(40.0 * T)
PRESSURE = np.array([4.0, 1.0, 0.0, 5.0] * 15)
STATIC, KINETIC = "friction.static_coefficient", "friction.kinetic_coefficient"


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


@pytest.mark.parametrize(("changes", "why"), [
    ({"t": T[:49], "channels": {"slip_speed": SLIP[:49]}}, "the measurement has 49 samples; 50 to 1000000 are needed"),
    ({"channels": {"plate_speed": SLIP}, "source": "x.csv"}, "x.csv has no slip_speed; identification needs it"),
    ({"channels": {"slip_speed": np.append(SLIP[:7], [np.nan] * 53)}}, "the measurement: slip_speed of sample 7 is not "
     "a number"),
    ({"inputs": {"engine_torque": np.append(SLIP[:9], [np.inf] * 51)}}, "the measurement: engine_torque of sample 9 is "
     "not a number"),
    ({"t": np.append(T[:3], [np.nan] * 57)}, "the measurement: t of sample 3 is not a number"),
    ({"t": T[::-1]}, "the measurement: the times do not increase"), ({"t": 0.0 * T}, "the measurement: the times do "
                                                                     "not increase"),
    ({"t": GAP}, "the measurement has a gap of 0.0031 s at 0.058 s beside steps of 0.002 s; identification needs "
     "evenly spaced samples: take a part by --from and --to"),
    ({"t": LATE}, "the measurement has a step of 0.0020021 s at 0.078 s beside steps of 0.002 s; identification needs "
     "evenly spaced samples"),
    ({"t": EARLY}, "the measurement has a step of 0.0019979 s at 0.078 s beside steps of 0.002 s; identification "
     "needs evenly spaced samples"),
    ({"channels": {"slip_speed": 0.0 * T + 3.0}}, "the measurement: slip_speed is 3 rad/s throughout; the channel is "
     "dead, or nothing moved"),
    ({"channels": {"slip_speed": SLIP, "plate_angle": 1e-13 * SLIP}}, "the measurement: plate_angle is 0 rad "
     "throughout; the channel is dead, or nothing moved"),
    ({"channels": {"slip_speed": 1e3 + 0.4e-9 * SLIP}}, "the measurement: slip_speed is 1000 rad/s throughout; the "
     "channel is dead, or nothing moved")])
def test_a_measurement_names_what_is_wrong_with_it(changes: dict[str, object], why: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(why)}$"):
        measured(**changes)


def test_a_measurement_at_the_ends_of_what_is_allowed() -> None:
    assert len(measured(t=T[:50], channels={"slip_speed": SLIP[:50]}).t) == 50
    late, gap = T.copy(), T.copy()
    late[40:] += 1.9e-6
    assert measured(t=late).step == pytest.approx(2e-3, rel=1e-4)
    gap[30:] += 0.99e-3
    with pytest.raises(InputError, match=r"has a step of 0.00299 s at 0.058 s"):
        measured(t=gap)
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


@pytest.mark.parametrize(("free", "how", "why"), [
    ({}, {}, "no key is free; name at least one"), ("friction.decai", {}, "friction.decai is not a scene key; did you "
                                                    "mean friction.decay?"),
    (["clutch.area"], {}, "clutch.area cannot be identified; what can: friction.curve, friction.static_coefficient, "
     "friction.kinetic_coefficient, friction.decay, friction.smoothing, driveline.damping, driveline.stiffness, "
     "driveline.flywheel_inertia, driveline.plate_inertia, converter.coupling, engine_torque.offset, "
     "actuation_pressure.offset"),
    ({"driveline.damping": 0.0}, {}, "driveline.damping begins at 0 N m s/rad; the start must be above 0"),
    ({"driveline.damping": -1.0}, {}, "driveline.damping is -1 N m s/rad; it must be 0 to 10000 N m s/rad"),
    (["driveline.damping"], {"likelihood": "driveline.stiffness"}, "likelihood is driveline.stiffness; it must be one "
     "of the free "
     "keys"), (["driveline.damping"], {"hold": "cubic"}, "hold is 'cubic'; it must be previous, linear, smooth or "
               "next"),
    (["driveline.damping"], {"noise": {"slip": 1.0}}, "noise of 'slip' was given; channels are slip_speed, "
     "plate_speed, plate_angle"),
    *((["driveline.damping"], {"noise": {"slip_speed": x}}, f"the noise of slip_speed is {x:g} rad/s; it must be a "
       f"number above 0")
      for x in (0.0, -1.0, math.inf)),
    (["driveline.damping"], {"scene": FIG02.with_values({"friction.law": "set_valued"})}, "friction.law is "
     "set_valued; parameters are identified with smoothed, whose limit for a large friction.smoothing it is"),
    (["driveline.damping"], {"scene": None}, "no scene is given for the table; give one (--scene)"),
    (["friction.curve", "friction.decay"], {}, "friction.decay is a part of friction.curve; free one of them")])
def test_what_cannot_be_fitted_is_refused(free: object, how: dict[str, object], why: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(why)}$"):
        identification.identify(measured(), free, **{"scene": FIG02, **how})


def test_keys_have_sides_and_errors_beyond_which_nothing_is_known() -> None:
    for value, other, falls, found in ((0.3, 0.2, None, 0.3), (0.201, 0.2, None, 0.22), (0.2, 0.2, None, 0.22),
                                       (0.199, 0.2, None, 0.2 / 1.1), (0.1, 0.2, None, 0.1), (0.3, 0.2, False,
                                           0.2 / 1.1),
                                       (0.1, 0.2, True, 0.22)):
        assert on_its_side(value, other, 1.1, falls) == pytest.approx(found)
    assert largest_errors(("driveline.damping", "engine_torque.offset", "actuation_pressure.offset",
                           "friction.curve.rate_1")).tolist() == [
        100.0, 1e5, 1e7, math.inf]
    check_key("actuation_pressure.offset")
    of = Model(FIG02.system, ("friction.curve.share_1", "friction.curve.rate_1", STATIC),
        measured(channels={"slip_speed": 50.0 * SLIP}))
    fastest = float(50.0 * np.abs(SLIP).max())
    assert of.within(np.array([-30.0, 1e-9, 9.0])) == pytest.approx([-20.0, 0.3 / fastest, 9.0])
    assert of.within(np.array([30.0, 1e9, 9.0])) == pytest.approx([20.0, 1000.0 / fastest, 9.0])
    assert of.within(np.array([1.0, 1.0, 9.0])).tolist() == [1.0, 1.0, 9.0]
    assert Model(FIG02.system, (), measured()).within(np.empty(0)).tolist() == []
    with pytest.raises(NumericalFailure, match=r"driveline.damping is -1 N m s/rad"):
        Model(FIG02.system, ("driveline.damping",), measured()).drive(np.array([-1.0]))


def test_measured_inputs_replace_those_of_the_scene_less_their_offsets() -> None:
    """The load that they add is at least the negative of the scene's own."""
    keys = ("engine_torque.offset", "actuation_pressure.offset")
    values, per = np.array([3.0, 2.0]), FIG02.system.torque_per_pressure
    none, held, _ = Model(FIG02.system, (), measured()).drive(np.empty(0))
    assert (none, held) == (terms_of(FIG02.system), None)
    for inputs in ({}, {"engine_torque": PRESSURE}, {"actuation_pressure": PRESSURE}, {"engine_torque": PRESSURE,
                                                                                       "actuation_pressure": PRESSURE}):
        terms, held, by = Model(FIG02.system, keys, measured(inputs=inputs, hold="linear")).drive(values)
        for column, name, offset, mean, scale in ((0, "engine_torque", 3.0, terms.mean_torque, 1.0),
                                                  (1, "actuation_pressure", 2.0, terms.mean_load, per)):
            own = {"engine_torque": 300.0, "actuation_pressure": FIG02.system.saturation_mean}[name]
            assert mean == (0.0 if name in inputs else pytest.approx(own))
            expected = -scale * offset + (scale * PRESSURE if name in inputs else 0.0)
            if name in inputs and name == "actuation_pressure":
                expected = np.maximum(expected, 0.0)
            assert held[:, 0, column] == pytest.approx(np.broadcast_to(expected, 60))
            assert held[:-1, 1, column] == pytest.approx(np.broadcast_to(expected, 60)[1:])
        assert np.sort(by[by != 0.0]).tolist() == [-1.0, -per]
        by = Model(FIG02.system, (KINETIC,), measured(inputs=inputs, hold="linear")).drive(np.array([0.24]))[2][:, 0]
        assert by[MEAN_LOAD:LOAD_AMPLITUDE + 1].tolist() == [0.0] * (LOAD_AMPLITUDE + 1 - MEAN_LOAD)
        assert by[LOG_LOAD] == 1.0 / 0.24


def test_derivatives_by_every_key_are_those_of_differences() -> None:
    """With measured and unmeasured inputs, in slip and through stick."""
    keys = (STATIC, KINETIC, "friction.decay", "friction.smoothing", "driveline.damping", "driveline.stiffness",
            "driveline.flywheel_inertia", "driveline.plate_inertia", "converter.coupling", "engine_torque.offset",
            "actuation_pressure.offset")
    values = np.array([0.3, 0.24, 2.0, 50.0, 0.6, 3000.0, 0.2, 0.02, 0.1, 3.0, 2e3])
    starts = np.array([[40.0, 0.1, 2.0], [0.5, 0.09, -1.0], [-3.0, 0.1, 0.0]])
    for inputs in ({}, {"engine_torque": 300.0 + 100.0 * SLIP, "actuation_pressure": 2e5 + 1e4 * SLIP}):
        of = Model(FIG02.system, keys, measured(inputs=inputs, hold="linear"))
        n = of.substeps(values)
        _, by = sensitivities(of, starts, 4, values, n)
        for i, value in enumerate(values):
            step = np.zeros(len(values))
            step[i] = 1e-5 * value
            ends = [states_of(of, starts, 4, values + s * step, n) for s in (1.0, -1.0)]
            slope = (ends[0] - ends[1]) / (2.0 * step[i])
            np.testing.assert_allclose(by[..., 3 + i], slope, rtol=1e-4, atol=1e-3 * np.abs(slope).max(),
                                       err_msg=keys[i])


def search(begin: list[float], guessed: bool = False, **gates: float) -> Search:
    """Fits of 100 samples."""
    return Search(np.array(begin), {"slip_speed": 0.1}, guessed, 100, FitSettings(), Gates(**gates), lambda: None)


def fitted(chi2: float, gap: float = 0.0, work: float = 0.0) -> Fit:
    """A fit with a given chi-square."""
    return Fit(np.zeros(1), np.zeros((1, 3)), {}, chi2, gap, 50, work)


def test_a_fit_is_accepted_within_four_standard_deviations_of_its_chi_square() -> None:
    assert search([1.0]).limit(fitted(1.0)) == pytest.approx(1.0 + 4.0 * math.sqrt(2.0 / 50.0))
    assert search([1.0], True).limit(fitted(1.0)) == pytest.approx(1.0 + 4.0 * math.sqrt(2.0 / 50.0 + 3.5**2 / 100.0))
    assert [search([1.0]).joins(fitted(1.0, gap)) for gap in (4.0, 4.001)] == [True, False]
