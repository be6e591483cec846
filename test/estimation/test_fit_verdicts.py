"""Verdicts on parameters and reasons against fits, by numbers made by hand and by flawed measurements."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from fig02_measured import FIG02, ONCE, QUICK, measured, moved

from tcc_sim.errors import InputError
from tcc_sim.estimation.identify import Identification, identify, judged
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.multiple_shooting import EQUAL, Fit, Model
from tcc_sim.scene import Scene

STATIC, KINETIC, DAMPING = "friction.static_coefficient", "friction.kinetic_coefficient", "driveline.damping"
TORQUE, PRESSURE = "engine_torque.offset", "actuation_pressure.offset"
KNOWN = {STATIC: (0.3, 3e-3), KINETIC: (0.24, 2.4e-3), DAMPING: (0.6, 0.03), TORQUE: (5.0, 4.0)}
"""Values and standard errors of keys that are fitted together."""
T = np.arange(200) * 1e-3
YES, NO, BOUND, LEAST = "identified", "not identifiable", "at its bound", EQUAL


def verdict(key: str, changes: dict[str, tuple[float, float]] | None = None, alone: bool = False,
            scene: Scene = FIG02, slip: np.ndarray | None = None, step: float = 1e-3, accepted: bool = True,
            hidden: tuple[str, float] | None = None, inputs: dict[str, np.ndarray] | None = None,
            correlated: tuple[str, float] | None = None) -> tuple[str, str]:
    """Verdict and reason of a key among KNOWN or by itself; slip is from stick to 5 rad/s both ways by default."""
    known = {**({} if alone else KNOWN), **(changes or {})}
    keys = tuple(known)
    data = Measurement(T * step / 1e-3, {"slip_speed": 5.0 * np.sin(100.0 * T) if slip is None else slip}, inputs or {})
    values, errors = np.array(list(known.values())).T
    i, correlations = keys.index(key), np.eye(len(keys))
    if correlated is not None:
        k = keys.index(correlated[0])
        correlations[i, k] = correlations[k, i] = correlated[1]
    found = judged(Model(scene.system, keys, data), i, 7.0, Fit(values, np.zeros((1, 3)), {}, 1.0, 0.0, 9), errors,
                   correlations, accepted, ONCE, hidden)
    assert (found.key, found.start, found.value, found.standard_error) == (key, 7.0, values[i], errors[i])
    if math.isfinite(errors[i]):
        half = 1.959963985 * errors[i]
        assert (found.low, found.high) == pytest.approx((values[i] - half, values[i] + half))
    return found.verdict, found.why


CASES: list[tuple[str, dict[str, object], str, tuple[str, ...]]] = [
    (DAMPING, {}, YES, ("9.8 %",)), (DAMPING, {"hidden": ("friction.decay", 4.56)}, YES, ("friction.decay", "4.6")),
    (DAMPING, {"changes": {DAMPING: (0.6, 0.0899)}}, YES, ()), (DAMPING, {"changes": {DAMPING: (0.6, 0.0901)}}, NO, (
        "15 %",)), (DAMPING, {"correlated": (KINETIC, -0.99)}, YES, ()),
    (DAMPING, {"correlated": (KINETIC, -0.991)}, NO, (KINETIC, "-0.991")),
    (DAMPING, {"changes": {DAMPING: (0.6, 0.12)}, "correlated": (STATIC, 0.91)}, NO, ("20 %", STATIC)),
    (DAMPING, {"accepted": False}, NO, ("refused",)),
    (DAMPING, {"changes": {DAMPING: (0.6, math.inf)}}, NO, ("start",)),
    (DAMPING, {"alone": True, "changes": {DAMPING: KNOWN[DAMPING]}}, YES, ()),
    # An offset is measured by the largest value of its input: of the scene, 300 + 250 N m, or of the measurement.
    *((key, {"alone": True, "changes": {key: (5.0, share * size)}, "inputs": inputs}, found, ())
      for key, size, inputs in ((TORQUE, 300.0, {}), (PRESSURE, FIG02.system.pressure.mean, {}),
                                (TORQUE, 700.0, {"engine_torque": np.append(np.zeros(199), -700.0)}))
      for share, found in ((0.1499, YES), (0.1501, NO))),
    # Ends of ranges are bounds, within 1e-9 of the end or of the scene's own value: 0.6 N m s/rad, 50 s/rad.
    *((key, {"alone": True, "changes": {key: (value, 0.0899 if value < 1.0 else 0.149 * value)}}, found, ())
      for key, value, found in (
          (DAMPING, 0.0, BOUND), (DAMPING, 0.5e-9, BOUND), (DAMPING, 2e-9, NO), (DAMPING, 1e4, BOUND),
          (DAMPING, 1e4 * (1.0 - 0.5e-9), BOUND), (DAMPING, 1e4 * (1.0 - 2e-9), YES),
          ("friction.smoothing", 1.0, BOUND), ("friction.smoothing", 1.0 + 49e-9, BOUND),
          ("friction.smoothing", 1.0 + 51e-9, YES))),
    (DAMPING, {"alone": True, "changes": {DAMPING: (0.0, 0.0901)}}, NO, ()),
    # mu_s and mu_k bound each other, free or not, unless one of them is unknown.
    *((key, {"changes": {STATIC: (0.24 * ratio, 3e-3), KINETIC: (0.24, 2.4e-3)}}, found, ())
      for key in (STATIC, KINETIC) for ratio, found in (
          (LEAST, BOUND), (1.0 / LEAST, BOUND), (1.0, BOUND), (LEAST * (1.0 + 2e-9), YES),
          (1.0 / LEAST / (1.0 + 2e-9), YES))),
    (STATIC, {"changes": {STATIC: (0.24, 3e-3), KINETIC: (0.24, math.inf)}}, YES, ()),
    (STATIC, {"alone": True, "changes": {STATIC: (0.24, 3e-3)}}, BOUND, ()),
    (KINETIC, {"alone": True, "changes": {KINETIC: (0.3, 3e-3)}}, BOUND, ()),
    # Advice is what the record lacks.
    *((key, {"alone": True, "changes": {key: (0.3, math.inf)}, "slip": slip, "step": step}, NO, words)
      for key, slip, step, words in (
          ("friction.decay", None, 1e-3, ("10 kHz",)), (STATIC, None, 1e-3, ("10 kHz", "friction.decay")),
          ("friction.decay", None, 1.4e-4, ("breakaways", STATIC)), (STATIC, None, 1.4e-4, ("breakaways", "decay")),
          ("friction.smoothing", None, 1.4e-4, ("layer",)), ("driveline.flywheel_inertia", None, 1e-3, ("flywheel's",)),
          ("friction.decay", 60.0 + T, 1e-3, ("3.45 rad/s", "60 rad/s")),
          (STATIC, -60.0 - T, 1e-3, ("3.45 rad/s", "60 rad/s")),
          ("friction.smoothing", 0.05 + T, 1e-3, ("0.04 rad/s", "0.05 rad/s")), (KINETIC, 60.0 + T, 1e-3, ("longer",)),
          ("driveline.stiffness", 1e-3 * np.sin(T), 1e-3, ("longer",)),
          *((key, 0.035 * np.sin(30.0 * T), 1e-3, ("sticks throughout",)) for key in (
              KINETIC, STATIC, "converter.coupling", PRESSURE)),
          (TORQUE, 0.035 * np.sin(30.0 * T), 1e-3, ("longer",)), (KINETIC, 0.045 * np.sin(30.0 * T), 1e-3, ("longer",)),
          (KINETIC, 0.1 * np.random.default_rng(1).standard_normal(200), 1e-3, ("sticks throughout",))))]


@pytest.mark.parametrize(("key", "how", "found", "words"), CASES)
def test_a_parameter_is_judged_by_error_correlation_bound_and_record(key: str, how: dict[str, object], found: str,
                                                                     words: tuple[str, ...]) -> None:
    given, why = verdict(key, **how)
    assert given == found, why
    assert all(word in why for word in words), why


def fitted(data: Measurement, noise: dict[str, float] | None = None, scene: Scene = FIG02) -> Identification:
    """The stiffness found from a measurement."""
    return identify(data, {"driveline.stiffness": 3050.0}, scene=scene, noise=noise, gates=ONCE, settings=QUICK)


@pytest.mark.parametrize(("step", "refused"), [(0.0811, False), (0.0812, True)])
def test_samples_that_are_many_oscillations_apart_have_other_units(step: float, refused: bool) -> None:
    """Five of the slipping mode, 2 pi/387 s, are 81 ms."""
    data = Measurement(np.arange(60) * step, {"slip_speed": np.sin(np.arange(60.0))})
    with pytest.raises(InputError, match="columns t=" if refused else "no key"):
        identify(data, ["driveline.stiffness"] if refused else [], scene=FIG02)


def flawed(name: str, flaw: Callable[[np.ndarray], np.ndarray]) -> str:
    """Why a tenth of a second with a flaw in a column is refused."""
    data, noise = measured(0, 0.1)
    columns = {**data.channels, "engine_torque": moved(0.1)[2]}
    columns[name] = flaw(columns[name])
    inputs = {"engine_torque": columns.pop("engine_torque")} if name == "engine_torque" else {}
    result = fitted(Measurement(data.t, {key: columns[key] for key in data.channels}, inputs, hold="smooth"), noise)
    assert (result.accepted, result.parameters[0].verdict) == (False, NO)
    assert result.scene.text() == FIG02.text()
    shares = {key: float(np.sqrt(np.mean(r**2))) / noise[key] for key, r in result.residuals.items()}
    assert f"in {max(shares, key=lambda key: shares[key])}" in result.why
    return result.why


@pytest.mark.parametrize("name", ["plate_speed", "engine_torque"])
def test_a_wrong_sign_is_named(name: str) -> None:
    assert f"sign of {name}" in flawed(name, np.negative)


@pytest.mark.parametrize(("name", "flaw"), [
    ("slip_speed", lambda v: np.minimum(v, 0.6 * v.max())), ("plate_speed", lambda v: v[np.arange(len(v)) // 10 * 10]),
    ("slip_speed", lambda v: 1.2 * v)], ids=["clipped", "held", "scaled"])
def test_other_flaws_are_no_wrong_sign(name: str, flaw: Callable[[np.ndarray], np.ndarray]) -> None:
    why = flawed(name, flaw)
    assert "sign" not in why
    assert name in why


@pytest.mark.parametrize(("share", "seed"), [(0.6, 0), (0.75, 1)])
def test_noise_that_is_stated_too_small_is_named_and_nothing_else(share: float, seed: int) -> None:
    data, noise = measured(seed, 0.4)
    why = fitted(data, {name: share * level for name, level in noise.items()}).why
    assert "noise" in why
    assert not any(word in why for word in ("speed than", "sign", "drifts"))
    stated = float(re.search(r"give ([0-9.e-]+)", why).group(1))
    assert min(abs(stated / level - 1.0) for level in noise.values()) < 0.15


def test_another_engine_speed_is_named_unless_the_torque_was_measured() -> None:
    data, noise = measured(1, 0.4)
    other = FIG02.with_values({"engine.frequency": 151.5})
    assert "at another speed than engine.frequency, 151.5 rad/s" in fitted(data, noise, other).why
    driven = replace(data, inputs={"engine_torque": moved(0.4)[2]}, hold="smooth")
    why = fitted(driven, noise, other.with_values({"driveline.plate_inertia": 0.03})).why
    assert why
    assert "speed than" not in why
