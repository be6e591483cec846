"""Sentences about fits and parameters, by numbers of fits made by hand."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from fig02_measured import FIG02, ONCE, measured, moved

from tcc_sim.errors import InputError
from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.multiple_shooting import Fit
from tcc_sim.estimation.residuals import Explanation, Whiteness
from tcc_sim.estimation.settings import DEFAULTS, Gates
from tcc_sim.estimation.verdicts import check_sampling, judged, why_no_noise
from tcc_sim.estimation.windows import Model
from tcc_sim.scene import Scene

STATIC, KINETIC = "friction.static_coefficient", "friction.kinetic_coefficient"
KEYS = (STATIC, KINETIC, "driveline.damping", "engine_torque.offset")
VALUES = np.array([0.3, 0.24, 0.6, 5.0])
ERRORS = np.array([3e-3, 2.4e-3, 0.03, 4.0])
LONGER = "a longer measurement would determine it, or one with larger motion"
T = np.arange(200) * 1e-3


def model(keys: tuple[str, ...] = KEYS, step: float = 1e-3, slip: np.ndarray | None = None,
    scene: object = FIG02) -> Model:
    """Keys of a scene, with slip from stick to 5 rad/s both ways by default."""
    v = 5.0 * np.sin(100.0 * T) if slip is None else slip
    return Model(scene.system, keys, Measurement(T * step / 1e-3, {"slip_speed": v}))


def verdict(key: str, of: Model | None = None, values: np.ndarray = VALUES, errors: np.ndarray = ERRORS,
            accepted: bool = True, hidden: tuple[str, float] | None = None, **correlated: float) -> tuple[str, str]:
    """Verdict and reason of a key; `correlated` are its correlations with other keys, by their last words."""
    of = of or model()
    i, correlations = of.keys.index(key), np.eye(len(of.keys))
    for name, value in correlated.items():
        k = next(k for k, each in enumerate(of.keys) if each.endswith(name))
        correlations[i, k] = correlations[k, i] = value
    found = judged(of, i, 7.0, Fit(values, np.zeros((1, 3)), {}, 1.0, 0.0, 9), errors, correlations, accepted, ONCE,
                   hidden)
    assert (found.key, found.start, found.value, found.standard_error) == (key, 7.0, values[i], errors[i])
    if math.isfinite(errors[i]):
        half = 1.959963985 * errors[i]
        assert (found.low, found.high) == pytest.approx((values[i] - half, values[i] + half))
    return found.verdict, found.why


def with_(array: np.ndarray, **changes: float) -> np.ndarray:
    """An array with some numbers changed; `x2=5.0` is number 2."""
    out = array.copy()
    for name, value in changes.items():
        out[int(name[1:])] = value
    return out


def test_a_parameter_is_identified_within_fifteen_percent_and_correlations_below_099() -> None:
    interval = "the 95 % interval reaches {} % to either side"
    assert verdict("driveline.damping") == ("identified", interval.format("9.8"))
    assert verdict("driveline.damping", hidden=("friction.decay", 4.56)) == (
        "identified", interval.format("9.8") + ", if friction.decay is right: residuals would not show an error of 20 "
        "% in it, which moves this by 4.6 standard errors")
    assert verdict("driveline.damping", errors=with_(ERRORS, x2=0.6 * 0.15))[0] == "identified"
    assert verdict("driveline.damping", errors=with_(ERRORS, x2=0.0901)) == (
        "not identifiable", f"its standard error is 15 %; {LONGER}")
    assert verdict("driveline.damping", kinetic_coefficient=-0.99)[0] == "identified"
    assert verdict("driveline.damping", kinetic_coefficient=-0.991) == (
        "not identifiable", f"its standard error is 5 %, and it depends on {KINETIC} (correlation -0.991); {LONGER}")
    assert verdict("driveline.damping", errors=with_(ERRORS, x2=0.12), kinetic_coefficient=0.9) == (
        "not identifiable", f"its standard error is 20 %; {LONGER}")
    assert verdict("driveline.damping", errors=with_(ERRORS, x2=0.12), kinetic_coefficient=0.5,
                   static_coefficient=0.91) == (
        "not identifiable", f"its standard error is 20 %, and it depends on {STATIC} (correlation 0.910); {LONGER}")
    assert verdict("driveline.damping", accepted=False) == ("not identifiable", "the fit is refused")
    assert verdict("driveline.damping", errors=with_(ERRORS, x2=math.inf)) == (
        "not identifiable", f"the measurement holds nothing about it, so it keeps its start; {LONGER}")
    assert verdict("driveline.damping", model(("driveline.damping",)), VALUES[2:3], ERRORS[2:3])[0] == "identified"


def test_an_offset_is_measured_by_the_largest_value_of_its_input() -> None:
    """Of the scene, 300 + 250 N m or the mean pressure, or of the measurement."""
    assert verdict("engine_torque.offset") == ("identified", "an offset, with its 95 % interval")
    for size, of in ((300.0, model()), (700.0, replace(model(), measured=replace(
            model().measured, inputs={"engine_torque": np.append(np.zeros(199), -700.0)})))):
        assert verdict("engine_torque.offset", of, errors=with_(ERRORS, x3=0.1499 * size))[0] == "identified"
        assert verdict("engine_torque.offset", of, errors=with_(ERRORS, x3=0.1501 * size)) == (
            "not identifiable", f"its standard error is 15 %; {LONGER}")
    pressure = model(("actuation_pressure.offset",))
    mean = FIG02.system.pressure.mean
    for error, found in ((0.1499, "identified"), (0.1501, "not identifiable")):
        assert verdict("actuation_pressure.offset", pressure, VALUES[:1], np.array([error * mean]))[0] == found
    still = model(("engine_torque.offset",), scene=FIG02.with_values({"engine.mean_torque": 0.0,
                                                                      "engine.torque_amplitude": 0.0}))
    assert verdict("engine_torque.offset", still, VALUES[:1], np.array([0.149]))[0] == "identified"


MET = ("the fit ends at the largest or smallest allowed value; if mu_s and mu_k meet, a start with a smaller value of "
       "the larger one leads to the other side")


@pytest.mark.parametrize(("static", "kinetic", "met"), [
    (0.24 * DEFAULTS.least_ratio, 0.24, True), (0.24 / DEFAULTS.least_ratio, 0.24, True), (0.24, 0.24, True),
    (0.24 * DEFAULTS.least_ratio * (1.0 + 5e-10), 0.24, True), (0.24 * DEFAULTS.least_ratio * (1.0 + 2e-9), 0.24,
                                                                False),
    (0.24 / DEFAULTS.least_ratio / (1.0 + 2e-9), 0.24, False)])
def test_coefficients_that_meet_bound_each_other(static: float, kinetic: float, met: bool) -> None:
    """Free or not, and unless one of them is unknown."""
    values = with_(VALUES, x0=static, x1=kinetic)
    for key, other, place in ((STATIC, {KINETIC: kinetic}, 0), (KINETIC, {STATIC: static}, 1)):
        found = verdict(key, values=values)
        assert found == ("at its bound", MET) if met else found[0] == "identified"
        assert verdict(key, values=values, errors=with_(ERRORS, **{f"x{1 - place}": math.inf}))[0] == "identified"
        lone = model((key,), scene=FIG02.with_values(other))
        assert (verdict(key, lone, values[[place]], ERRORS[:1])[0] == "at its bound") == met
    assert verdict("driveline.damping", values=values)[0] == "identified"


@pytest.mark.parametrize(("key", "value", "found"), [
    ("driveline.damping", 0.0, "at its bound"), ("driveline.damping", 0.5e-9, "at its bound"),
    ("driveline.damping", 2e-9, "not identifiable"), ("driveline.damping", 1e4, "at its bound"),
    ("driveline.damping", 1e4 * (1.0 - 0.5e-9), "at its bound"), ("driveline.damping", 1e4 * (1.0 - 2e-9),
                                                                  "identified"),
    ("friction.smoothing", 1.0, "at its bound"), ("friction.smoothing", 1.0 + 49e-9, "at its bound"),
    ("friction.smoothing", 1.0 + 51e-9, "identified")])
def test_ends_of_ranges_are_bounds(key: str, value: float, found: str) -> None:
    """Within 1e-9 of the end, or of the scene's own value, which is 0.6 N m s/rad or 50 s/rad."""
    size = max(value, 0.6 if key == "driveline.damping" else 50.0)
    error = 1.0 if found == "not identifiable" else 0.1499 * (size if found == "at its bound" else value)
    assert verdict(key, model((key,)), np.array([value]), np.array([error]))[0] == found
    assert verdict(key, model((key,)), np.array([value]), np.array([0.1501 * size]))[0] == "not identifiable"


@pytest.mark.parametrize(("key", "slip", "step", "advice"), [
    ("friction.decay", None, 1e-3, "samples at 10 kHz would determine it: they show slip just after breakaway"),
    (STATIC, None, 1e-3, "samples at 10 kHz, or a fixed friction.decay, would determine it"),
    ("friction.decay", None, 1.4e-4, "more breakaways, or a fixed friction.static_coefficient, would determine it"),
    (STATIC, None, 1.4e-4, "more breakaways, or a fixed friction.decay, would determine it"),
    ("friction.smoothing", None, 1.4e-4, "samples within the layer |v| < 2/sigma, at a higher rate or in a slower "
     "passage, would determine it"),
    ("driveline.flywheel_inertia", None, 1e-3, "the flywheel's speed, or a known change of the mean torque, would "
     "determine it"),
    ("friction.decay", 60.0 + T, 1e-3, "slip below 3.45 rad/s would determine it; the slowest here is 60 rad/s"),
    (STATIC, -60.0 - T, 1e-3, "slip below 3.45 rad/s would determine it; the slowest here is 60 rad/s"),
    ("friction.smoothing", 0.05 + T, 1e-3, "slip below 0.04 rad/s would determine it; the slowest here is 0.05 rad/s"),
    (KINETIC, 60.0 + T, 1e-3, LONGER), ("driveline.stiffness", 1e-3 * np.sin(T), 1e-3, LONGER),
    *((key, 0.035 * np.sin(30.0 * T), 1e-3, "slip would determine it; here the clutch sticks throughout") for key in (
        KINETIC, STATIC, "converter.coupling", "actuation_pressure.offset")),
    ("engine_torque.offset", 0.035 * np.sin(30.0 * T), 1e-3, LONGER), (KINETIC, 0.045 * np.sin(30.0 * T), 1e-3, LONGER),
    (KINETIC, 0.1 * np.random.default_rng(1).standard_normal(200), 1e-3,
     "slip would determine it; here the clutch sticks throughout")])
def test_the_advice_is_what_the_record_lacks(key: str, slip: np.ndarray | None, step: float, advice: str) -> None:
    why = verdict(key, model((key,), step, slip), np.array([0.3]), np.array([math.inf]))[1]
    assert why == f"the measurement holds nothing about it, so it keeps its start; {advice}"


def whiteness(explanation: Explanation | None, **p_value: float) -> Whiteness:
    """Tests of residuals with given probabilities."""
    return Whiteness({}, p_value or {"slip_speed": 1.0}, explanation, {}, False)


@pytest.mark.parametrize(("white", "why"), [
    (whiteness(None, slip_speed=1e-4, plate_speed=0.5), ""),
    (whiteness(None, slip_speed=0.9, plate_speed=0.99e-4), "the residuals of plate_speed are not noise (their "
     "probability is 9.9e-05): the scene does not explain the measurement"),
    (whiteness(Explanation("driveline.damping", 0.01234, "N m s/rad", -4.0)), ""),
    (whiteness(Explanation("driveline.damping", -0.01234, "N m s/rad", -4.01)), "the residuals are not noise: a "
     "change of driveline.damping by -0.0123 N m s/rad would explain them (4.01 standard errors); free it, or give "
     "its true value"),
    (whiteness(Explanation("the scale of slip_speed", 0.01, "%", 12.345, ("a", "b"))), "the residuals are not noise: "
     "a change of the scale of slip_speed by 1 % would explain them (12.3 standard errors), and so would one of a or "
     "b; mend the measurement"),
    (whiteness(Explanation("friction.static_coefficient", 0.5, "", 5.0)), "the residuals are not noise: a change of "
     "friction.static_coefficient by 0.5 would explain them (5 standard errors); free it, or give its true value")])
def test_residuals_that_are_no_noise_are_named(white: Whiteness, why: str) -> None:
    assert why_no_noise(white, Gates()) == why


def test_samples_that_are_many_oscillations_apart_have_other_units() -> None:
    """Five of the slipping mode, 2 pi/387 s, are 81 ms."""
    for step, refused in ((0.0811, False), (0.0812, True)):
        data = Measurement(T / 1e-3 * step, {"slip_speed": np.sin(T * 500.0)})
        if not refused:
            check_sampling(data, FIG02.system)
            continue
        with pytest.raises(InputError, match=r"^the measurement has a sample every 0.0812 s, in which the driveline "
                           r"oscillates 5 times; if its times are in ms, say so with --columns t=COLUMN:ms$"):
            check_sampling(data, FIG02.system)


def refused(data: Measurement, noise: dict[str, float], scene: Scene = FIG02) -> str:
    """Why the stiffness of a measurement is refused."""
    result = identify(data, {"driveline.stiffness": 3050.0}, scene=scene, noise=noise, gates=ONCE)
    assert not result.accepted
    return result.why


@pytest.mark.parametrize("name", ["slip_speed", "plate_speed", "engine_torque"])
def test_a_wrong_sign_is_named(name: str) -> None:
    data, noise = measured(0)
    inputs = {"engine_torque": moved(0.2)[2]}
    columns = {**data.channels, **inputs}
    columns[name] = -columns[name]
    why = refused(replace(data, channels={k: columns[k] for k in data.channels}, hold="smooth",
                          inputs={"engine_torque": columns["engine_torque"]}), noise)
    assert f"sign of {name}" in why


@pytest.mark.parametrize("flaw", [lambda v: np.minimum(v, 0.6 * v.max()), lambda v: v[np.arange(len(v)) // 10 * 10],
                                  lambda v: 1.2 * v])
def test_other_flaws_are_no_wrong_sign(flaw: Callable[[np.ndarray], np.ndarray]) -> None:
    """Clipped, held, and scaled."""
    data, noise = measured(0)
    for name in data.channels:
        why = refused(replace(data, channels={**data.channels, name: flaw(data.channels[name])}), noise)
        assert "sign" not in why
        assert name in why


@pytest.mark.parametrize("share", [0.6, 0.75])
def test_noise_that_is_stated_too_small_is_named_and_nothing_else(share: float) -> None:
    for seed in range(4):
        data, noise = measured(seed, 0.4)
        why = refused(data, {name: share * level for name, level in noise.items()})
        assert "noise" in why
        assert not any(word in why for word in ("speed than", "sign", "drifts"))
        stated = float(re.search(r"give ([0-9.e-]+)", why).group(1))
        assert min(abs(stated / level - 1.0) for level in noise.values()) < 0.15


def test_another_engine_speed_is_named_unless_the_torque_was_measured() -> None:
    data, noise = measured(1, 0.6)
    other = FIG02.with_values({"engine.frequency": 151.5})
    assert "at another speed than engine.frequency, 151.5 rad/s" in refused(data, noise, other)
    driven = replace(data, inputs={"engine_torque": moved(0.6)[2]}, hold="smooth")
    wrong = other.with_values({"driveline.plate_inertia": 0.03})
    assert "speed than" not in refused(driven, noise, wrong)
