"""Every key that may be free, against records that hold much, little or nothing about it."""

from __future__ import annotations

import math
import re
from functools import cache

import numpy as np
import pytest
from fig02_measured import FIG02, ONCE, QUICK, measured
from scipy.integrate import odeint

from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.multiple_shooting import FREE, OFFSETS, FitSettings
from tcc_sim.model.parameters import values_of

NOISE = {"slip_speed": 0.02, "plate_speed": 0.02}
SCENE = FIG02.with_values({"converter.coupling": 0.2})
TRUE = {**dict(values_of(SCENE.system)), **dict.fromkeys(OFFSETS, 0.0)}
NOTHING: dict[str, set[str]] = {"stuck": set(),
           "fast": {"friction.static_coefficient", "friction.decay", "friction.smoothing"}}
"""Keys without any effect on a record."""
LITTLE: dict[str, set[str]] = {
    "stuck": {*(key for key in FREE if key.startswith(("friction.", "converter."))), *OFFSETS}, "fast": set()}
"""Keys with less effect than the noise."""
ADVICE: dict[str, dict[str, str]] = {
    "stuck": dict.fromkeys(LITTLE["stuck"] - {"engine_torque.offset"},
                           "slip would determine it; here the clutch sticks throughout"),
    "fast": {"friction.smoothing": "slip below 0.2 rad/s would determine it; the slowest here is 58.4 rad/s",
             **dict.fromkeys(("friction.static_coefficient", "friction.decay"),
                             "slip below 3.45 rad/s would determine it; the slowest here is 58.4 rad/s")}}
"""Advice on these keys: slip below ln(1000)/2 rad/s shows the decay, below 2/50 rad/s the smoothing."""


def moved(name: str, stiffness: float = 3000.0, damping: float = 0.6, kinetic: float = 0.24,
          begin: tuple[float, ...] = ()) -> tuple[np.ndarray, ...]:
    """Times and states (n, 3) of a clutch that sticks, or slips at 53 to 100 rad/s, by SciPy on the equations with the
    smoothed law, from rest or from a state at the first time on; and its engine torque and pressure.
    """
    t = np.arange(0.2, 0.4 if name == "stuck" else 0.3, 1e-3)
    mean, amplitude, pressure = (150.0, 60.0, 4e5) if name == "stuck" else (230.0, 80.0, 1.2e5)

    def torque(at: float) -> float:
        return mean + amplitude * math.sin(150.0 * at)

    def rates(at: float, x: np.ndarray) -> list[float]:
        shaft = damping * x[2] + stiffness * x[1]
        friction = (kinetic + (0.3 - kinetic) * math.exp(-2.0 * abs(x[0]))) * math.tanh(50.0 * x[0]) * 0.008 * pressure
        friction += 0.2 * x[0]
        return [(torque(at) - friction) / 0.2 - (friction - shaft) / 0.02, x[2], (friction - shaft) / 0.02]

    first, times = (begin, t) if begin else ([0.0 if name == "stuck" else 80.0, 0.0, 0.0], np.append(0.0, t))
    states = odeint(rates, first, times, tfirst=True, rtol=1e-10, atol=1e-11, mxstep=100_000)[-len(t):]
    return t, states, mean + amplitude * np.sin(150.0 * t), np.full(len(t), pressure)


@cache
def record(name: str) -> Measurement:
    """This motion with noise."""
    t, states, torque, pressure = moved(name)
    noise = 0.02 * np.random.default_rng(8).normal(size=(2, len(t)))
    return Measurement(t, {"slip_speed": states[:, 0] + noise[0], "plate_speed": states[:, 2] + noise[1]},
                       {"engine_torque": torque, "actuation_pressure": pressure}, hold="smooth")


def test_errors_and_correlations_are_those_of_least_squares_over_the_whole_motion() -> None:
    """Without windows: the motion's derivatives by its first state and three keys, by differences of SciPy's."""
    keys = {"driveline.stiffness": 3000.0, "driveline.damping": 0.6, "friction.kinetic_coefficient": 0.24}
    result = identify(record("fast"), keys, scene=SCENE, noise=NOISE, gates=ONCE, settings=QUICK)
    assert result.accepted, result.why
    free = np.array([*moved("fast")[1][0], *keys.values()])
    columns = []
    for k, size in enumerate(np.maximum(np.abs(free), 0.1)):
        ends = [moved("fast", *(free + step)[3:], begin=tuple((free + step)[:3]))[1][:, [0, 2]]
                for step in np.array([1e-4, -1e-4])[:, None] * size * np.eye(6)[k]]
        columns.append((ends[0] - ends[1]).ravel() / (2e-4 * size) / 0.02)
    by = np.stack(columns, axis=1)
    covariance = np.linalg.inv(by.T @ by)[3:, 3:]
    errors = np.sqrt(np.diag(covariance))
    assert [p.standard_error for p in result.parameters] == pytest.approx(errors, rel=0.03)
    np.testing.assert_allclose(result.correlations, covariance / np.outer(errors, errors), atol=0.03)
    assert np.linalg.norm([(p.value - keys[p.key]) / p.standard_error for p in result.parameters]) < 4.0


@pytest.mark.parametrize(("name", "key"), [*(("fast", key) for key in FREE), *(
    ("stuck", key) for key in FREE if key not in ("friction.kinetic_coefficient", "friction.decay",
                                                  "friction.smoothing", "driveline.plate_inertia"))])
def test_what_a_record_holds_nothing_about_keeps_its_start_and_the_others_are_found(name: str, key: str) -> None:
    coupling_keys = "driveline.damping" if key in ("driveline.stiffness",
                                                   "driveline.plate_inertia") else "driveline.stiffness"
    free = {key: 1.03 * float(TRUE[key]), coupling_keys: {"driveline.damping": 0.62,
                                                         "driveline.stiffness": 3090.0}[coupling_keys]}
    scene = SCENE if name == "stuck" else SCENE.with_values({"friction.smoothing": 10.0})
    result = identify(record(name), free, scene=scene, noise=NOISE, gates=ONCE,
                      settings=FitSettings(stages=FitSettings().stages[2:]))
    assert result.accepted, result.why
    judged, other = result.parameters
    assert abs(other.value - float(TRUE[other.key])) < 4.0 * other.standard_error
    assert other.verdict == "identified"
    if key in NOTHING[name]:
        assert (judged.value, judged.standard_error) == (judged.start, math.inf)
        assert "holds nothing about it, so it keeps its start" in judged.why
    if key in NOTHING[name] | LITTLE[name]:
        assert judged.verdict == "not identifiable"
        assert not np.delete(result.correlations, 0, 0)[:, 0].any() or math.isfinite(judged.standard_error)
        assert ADVICE[name].get(key, "") in judged.why
    else:
        assert judged.verdict == "identified"
        assert abs(judged.value - float(TRUE[key])) < 4.0 * judged.standard_error
    assert key in OFFSETS or result.scene.value(key) == judged.value


def test_equal_coefficients_are_found_and_no_measurement_determines_their_decay() -> None:
    t, states, torque, pressure = moved("fast", kinetic=0.3)
    noisy = states + 0.02 * np.random.default_rng(8).normal(size=states.shape)
    data = Measurement(t, {"slip_speed": noisy[:, 0], "plate_speed": noisy[:, 2]},
                       {"engine_torque": torque, "actuation_pressure": pressure}, hold="smooth")
    scene, words = SCENE.with_values({"friction.kinetic_coefficient": 0.3}), {"noise": NOISE, "gates": ONCE}
    decay, = identify(data, {"friction.decay": 2.0}, scene=scene, settings=QUICK, **words).parameters
    assert decay.verdict == "not identifiable"
    assert "would determine it" not in decay.why
    assert {"friction.static_coefficient", "friction.kinetic_coefficient"} <= {*re.findall(r"[a-z_.]+", decay.why)}
    for start in (0.29, 0.3):
        free = {"friction.kinetic_coefficient": start}
        kinetic, = identify(data, free, scene=scene, settings=QUICK, **words).parameters
        assert kinetic.standard_error < 3.5e-5
        assert abs(kinetic.value - 0.3) < 4.0 * kinetic.standard_error


def test_two_keys_of_which_a_record_holds_the_sum_alone_are_both_unknown() -> None:
    """In stick the inertias move as one."""
    result = identify(record("stuck"), {"driveline.flywheel_inertia": 0.21, "driveline.plate_inertia": 0.021,
                                        "driveline.damping": 0.7}, scene=SCENE, noise=NOISE, gates=ONCE, settings=QUICK)
    *inertias, damping = result.parameters
    assert [p.verdict for p in inertias] == ["not identifiable"] * 2
    assert sum(p.value for p in inertias) == pytest.approx(0.22, rel=1e-3)
    assert damping.verdict == "identified"


@pytest.mark.parametrize(("start", "others"), [
    (0.01, {}), (0.2, {"friction.kinetic_coefficient": 0.25, "driveline.stiffness": 3100.0})])
def test_a_key_that_may_be_0_is_judged_by_its_effect(start: float, others: dict[str, float]) -> None:
    """Without coupling, 300 N m over the largest slip of 36 rad/s would be 8 N m s/rad; 1 % of this has no effect."""
    data, noise = measured()
    result = identify(data, {"converter.coupling": start, **others}, scene=FIG02, noise=noise, gates=ONCE)
    found = result.parameters[0]
    assert (result.accepted, found.verdict) == (True, "identified"), found.why
    assert 0.0 <= found.value <= 3.0 * found.standard_error < 0.08
