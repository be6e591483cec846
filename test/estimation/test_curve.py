"""Friction curves found from motions that SciPy made with known noise: within their band, and near the law."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from documents import valid
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from tcc_sim import cli
from tcc_sim.errors import InputError
from tcc_sim.estimation.curve import (
    curve_of,
    curve_starts,
    keys_of,
    not_visited,
    pairs_of,
    rates_allowed,
    refuse_parts,
)
from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.windows import Model, sensitivities
from tcc_sim.scene import load_scene
from tcc_sim.study.benchmarks.references import equations

SPEEDS = np.round(np.linspace(0.0, 1.0, 33) ** 2 * 160.0, 6)
LAWS = {
    "rising": lambda v: 0.26 - 0.05 * np.exp(-0.04 * v),
    "dip": lambda v: 0.25 - 0.04 * np.exp(-0.02 * v) + 0.05 * np.exp(-0.4 * v),
}
FIG02 = load_scene("fig02")


@cache
def moved(law: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and states (n, 3) of scene fig02 with another friction law, from its initial slip of 150 rad/s on."""
    system = FIG02.with_values({"friction.slip_speeds": SPEEDS.tolist(),
                                "friction.coefficients": LAWS[law](SPEEDS).tolist()}).system
    rates, jacobian = equations(system)
    t = np.arange(400) / 1000.0
    run = solve_ivp(rates, (0.0, t[-1]), [150.0, 0.0, 0.0, 0.0], "LSODA", t, rtol=1e-10, atol=1e-11, jac=jacobian)
    return t, run.y.T[:, :3]


def measured(law: str, seed: int) -> Measurement:
    """Slip and plate speed with noise of 1 % of their spread."""
    t, states = moved(law)
    seen = states + 0.01 * states.std(axis=0) * np.random.default_rng(seed).standard_normal(states.shape)
    return Measurement(t, {"slip_speed": seen[:, 0], "plate_speed": seen[:, 2]})


@pytest.mark.parametrize("law", LAWS)
def test_the_law_is_within_the_band_that_is_given(law: str) -> None:
    result = identify(measured(law, 3), ["friction.curve"], scene=FIG02)
    assert result.accepted, result.why
    curve = result.curve
    seen = curve.visited
    truth = LAWS[law](curve.slip_speeds)
    inside = (curve.low <= truth) & (truth <= curve.high)
    assert inside[seen].mean() >= 0.95
    assert np.abs(curve.coefficient - truth)[seen].max() < 0.02 * truth.min()
    assert (curve.high - curve.low)[seen][5:].max() < 0.04 * truth.max()
    assert np.isnan(curve.coefficient[~seen]).all()
    assert not seen[-5:].any()
    again = result.scene.system.friction.curve
    np.testing.assert_allclose(again.at(curve.slip_speeds[seen]), curve.coefficient[seen], rtol=2e-3)


def test_derivatives_by_the_numbers_of_a_curve_are_those_of_differences() -> None:
    keys = ("friction.curve.constant", "friction.curve.share_1", "friction.curve.rate_1", "friction.curve.share_2",
            "friction.curve.rate_2")
    model, values = Model(FIG02.system, keys, measured("dip", 1)), np.array([0.25, 0.2, 0.4, -0.16, 0.02])
    starts = np.array([[40.0, 0.1, 2.0], [0.5, 0.09, -1.0]])
    n = model.substeps(values)
    _, result = sensitivities(model, starts, 8, values, n)
    for i, value in enumerate(values):
        step = np.zeros(5)
        step[i] = 1e-5 * value
        after, before = (sensitivities(model, starts, 8, values + s * step, n)[0] for s in (1.0, -1.0))
        by = (after - before) / (2.0 * step[i])
        np.testing.assert_allclose(result[..., 3 + i], by, rtol=1e-5, atol=1e-6 * np.abs(by).max())


def test_the_command_writes_curve_scene_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = measured("rising", 4)
    rows = "\n".join(",".join(map(repr, row)) for row in zip(
        data.t.tolist(), *(data.channels[name].tolist() for name in ("slip_speed", "plate_speed"))))
    (tmp_path / "run.csv").write_text(f"t,slip_speed,plate_speed\n{rows}\n")
    files = [f"--{option}={tmp_path / name}" for option, name in (
        ("json", "found.json"), ("out", "own.yaml"), ("plot", "found.png"))]
    assert cli.main(["identify", str(tmp_path / "run.csv"), "--scene", "fig02", "--free", "friction.curve=1", "--free",
                     "driveline.stiffness", *files]) == 0
    shown = capsys.readouterr().out
    assert "sliding friction: mu(v) = 0.26" in shown
    assert re.search(r"not visited: slip speeds 0 rad/s to [0-3]\.\d+ rad/s, 19\d(\.\d)? rad/s to 24\d(\.\d)? rad/s",
                     shown)
    document = json.loads((tmp_path / "found.json").read_text())
    valid("identify", document)
    assert [p["key"] for p in document["parameters"]] == ["driveline.stiffness"]
    assert len(document["curve"]["rates"]) == 1
    assert document["curve"]["visited"].count(False) == document["curve"]["coefficient"].count(None) > 0
    law = load_scene(tmp_path / "own.yaml").system.friction
    assert law.curve.at(50.0) == pytest.approx(float(LAWS["rising"](50.0)), rel=5e-3)
    assert (tmp_path / "found.png").stat().st_size > 10_000


CURVE_KEYS = ("friction.curve.constant", "friction.curve.share_1", "friction.curve.rate_1", "friction.curve.share_2",
              "friction.curve.rate_2")


def test_a_curve_has_a_constant_and_pairs_in_the_order_of_its_keys() -> None:
    assert [keys_of(count) for count in (None, 1, 2.0)] == [CURVE_KEYS, CURVE_KEYS[:3], CURVE_KEYS]
    assert keys_of(3) == (*CURVE_KEYS, "friction.curve.share_3", "friction.curve.rate_3")
    for count in (0, 4, 1.5):
        with pytest.raises(InputError, match=f"^friction.curve has {count:g} exponentials; it must have 1 to 3$"):
            keys_of(count)
    named = dict(zip(CURVE_KEYS, (0.2, 0.5, 3.0, -0.1, 0.4)))
    assert list(pairs_of(named)) == [0.5, 3.0, -0.1, 0.4]
    assert (rates_allowed(100.0), rates_allowed(0.5)) == ((0.003, 10.0), (0.6, 1000.0))
    v = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    for visited, spans in (([1, 1, 1, 1, 1, 1], []), ([0, 1, 1, 1, 1, 1], [(0.0, 1.0)]), ([1, 1, 0, 0, 1, 1], [(1.0,
        4.0)]),
                           ([1, 1, 1, 1, 0, 0], [(3.0, 5.0)]), ([0, 1, 0, 1, 1, 0], [(0.0, 1.0), (1.0, 3.0), (4.0,
                               5.0)])):
        assert not_visited(v, np.array(visited, dtype=bool)) == spans
    tabled = FIG02.with_values({"friction.slip_speeds": [0.0, 1.0, 2.0], "friction.coefficients": [0.2, 0.2,
        0.2]}).system.friction
    refuse_parts({"friction.curve": None, "driveline.damping": None}, tabled)
    refuse_parts({"friction.decay": None}, FIG02.system.friction)
    with pytest.raises(InputError, match=r"^friction.decay is not used where friction.slip_speeds and "
                       r"friction.coefficients are given; free friction.curve instead$"):
        refuse_parts({"friction.decay": None}, tabled)


def test_the_band_is_that_of_all_numbers_together_where_slip_was_seen() -> None:
    """Scheffe's band: the root of chi-square's 95 % for five numbers times the standard error by differences."""
    values = np.array([0.25, 0.2, 0.4, -0.16, 0.02, 3000.0])
    root = np.random.default_rng(3).normal(size=(6, 6)) * (1e-3 * np.abs(values))
    covariance = root.T @ root
    slip = np.append(-np.geomspace(0.5, 60.0, 300), [80.0] * 7)   # Seven samples near 80 rad/s are too few.
    found = curve_of((*CURVE_KEYS, "driveline.stiffness"), values, covariance, slip, FIG02.system.friction)

    def mu(x: np.ndarray) -> np.ndarray:
        return x[0] * (1.0 + x[1] * np.exp(-x[2] * found.slip_speeds) + x[3] * np.exp(-x[4] * found.slip_speeds))

    by = np.stack([(mu(values + s) - mu(values - s)) / (2.0 * s.max()) for s in np.diag(1e-5 * np.abs(values))], axis=1)
    error = np.sqrt(np.einsum("vi,ij,vj->v", by, covariance, by)) * math.sqrt(chi2.ppf(0.95, 5))
    v = found.slip_speeds
    assert (len(v), v[0], v[80], v[-1]) == (86, 0.0, pytest.approx(80.0), pytest.approx(100.0))
    assert v[:81] == pytest.approx(80.0 * np.linspace(0.0, 1.0, 81) ** 2)
    near = np.array([np.count_nonzero((np.abs(slip) >= x / 1.5) & (np.abs(slip) <= 1.5 * x)) for x in v])
    assert found.visited.tolist() == ((near >= 8) & (v >= 0.5) & (v <= 80.0)).tolist()
    assert 0 < np.count_nonzero(found.visited) < len(v)
    seen = found.visited
    np.testing.assert_allclose(found.coefficient[seen], mu(values)[seen])
    np.testing.assert_allclose((found.high - found.coefficient)[seen], error[seen], rtol=1e-5)
    np.testing.assert_allclose((found.coefficient - found.low)[seen], error[seen], rtol=1e-5)
    assert np.isnan(np.stack([found.coefficient, found.low, found.high])[:, ~seen]).all()
    assert found.scene == pytest.approx(0.24 + 0.06 * np.exp(-2.0 * v))
    assert (found.constant, found.amplitudes, found.rates) == (0.25, pytest.approx((0.05, -0.04)), (0.4, 0.02))
    table, last = found.table(), int(np.flatnonzero(seen)[-1])
    assert table["friction.slip_speeds"] == v[:last + 1].tolist()
    assert table["friction.coefficients"] == pytest.approx(mu(values)[:last + 1])
    for constant, within in ((2.5, 2.0), (2.0, 2.0), (1.9, 1.9), (-0.1, 1e-3)):
        wild = dataclasses.replace(found, constant=constant, amplitudes=(0.0, 0.0)).table()["friction.coefficients"]
        assert set(wild) == {within}
    with pytest.raises(InputError, match=r"^fewer than 8 samples slip near any speed; friction.curve needs a "
                       r"measurement with slip$"):
        curve_of(CURVE_KEYS, values[:5], covariance[:5, :5], slip[:7], FIG02.system.friction)


def test_starts_of_a_curve_are_what_the_flywheel_shows_in_slip_or_else_the_scene() -> None:
    """Exponentials with two of the sixteen tried rates, at which the plate stands still and I1 v' = Te - Tf."""
    t = np.arange(400) * 1e-3
    low, high = 0.3 / 150.0, 1000.0 / 150.0
    rates = np.geomspace(10.0 * low, high, 16)[[3, 9]]
    pressure, torque = 2.5e5, 350.0

    def mu(v: float) -> float:
        return float(0.2 * (1.0 + 0.5 * np.exp(-rates[0] * abs(v)) - 0.3 * np.exp(-rates[1] * abs(v))))

    for sign in (1.0, -1.0):
        run = solve_ivp(lambda _, v, sign=sign: [(sign * torque - sign * 0.008 * pressure * mu(v[0])) / 0.2], (0.0,
            t[-1]),
                        [sign * 150.0], "LSODA", t, rtol=1e-11, atol=1e-11)
        data = Measurement(t, {"slip_speed": run.y[0], "plate_speed": 0.0 * t + 1e-6 * np.sin(t)}, {
            "engine_torque": 0.0 * t + sign * torque, "actuation_pressure": 0.0 * t + pressure}, hold="linear")
        found = curve_starts(FIG02.system, data, keys_of(2))
        assert list(found) == list(CURVE_KEYS)
        constant, *numbers = found.values()
        v = np.abs(run.y[0])
        got = constant * (1.0 + sum(c * np.exp(-a * v) for c, a in zip(numbers[::2], numbers[1::2])))
        assert np.abs(got / [mu(x) for x in v] - 1.0).max() < 4e-3
    alone = dataclasses.replace(data, channels={"slip_speed": data.channels["slip_speed"]})
    by_scene = curve_starts(FIG02.system, alone, keys_of(2))
    assert list(by_scene.values()) == pytest.approx([0.24, 0.25, 2.0, 0.02, np.geomspace(10.0 * low, 100.0 * low,
        3)[1]])
    equal = FIG02.with_values({"friction.kinetic_coefficient": 0.3}).system
    assert [curve_starts(equal, alone, keys_of(1))[key] for key in CURVE_KEYS[:3]] == pytest.approx([0.3, 0.02,
        10.0 * low])
    short = dataclasses.replace(data, t=t[:60], channels={"slip_speed": np.where(t[:60] < 0.04, 1e-3,
        1.0) * np.cos(3e3 * t[:60]),
                                                          "plate_speed": np.sin(t[:60])}, inputs={})
    assert curve_starts(FIG02.system, short, keys_of(1))["friction.curve.constant"] == 0.24
