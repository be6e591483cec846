"""Friction curves found from motions that SciPy made with known noise: within their band, and near the law."""

from __future__ import annotations

import json
import math
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documents import valid
from independent import equations
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from tcc_sim import cli
from tcc_sim.estimation.curve import curve_of, not_visited
from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.scene import load_scene

SPEEDS = np.round(np.linspace(0.0, 1.0, 33) ** 2 * 160.0, 6)
LAWS = {
    "rising": lambda v: 0.26 - 0.05 * np.exp(-0.04 * v),
    "dip": lambda v: 0.25 - 0.04 * np.exp(-0.02 * v) + 0.05 * np.exp(-0.4 * v),
}
FIG02 = load_scene("fig02")
KEYS = tuple(f"friction.curve.{name}" for name in ("constant", "share_1", "rate_1", "share_2", "rate_2"))


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


def test_the_law_is_within_the_band_that_is_given() -> None:
    result = identify(measured("dip", 3), ["friction.curve"], scene=FIG02)
    assert result.accepted, result.why
    curve = result.curve
    seen = curve.visited
    truth = LAWS["dip"](curve.slip_speeds)
    inside = (curve.low <= truth) & (truth <= curve.high)
    assert inside[seen].mean() >= 0.95
    assert np.abs(curve.coefficient - truth)[seen].max() < 0.02 * truth.min()
    assert (curve.high - curve.low)[seen][5:].max() < 0.04 * truth.max()
    assert np.isnan(curve.coefficient[~seen]).all()
    assert not seen[-5:].any()
    again = result.scene.system.friction.curve
    np.testing.assert_allclose(again.at(curve.slip_speeds[seen]), curve.coefficient[seen], rtol=2e-3)


def test_the_command_writes_curve_scene_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                    pictures: list[Any]) -> None:
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
    assert all(axis.has_data() for axis in pictures[0].axes)


@pytest.mark.parametrize(("visited", "spans"), [
    ([1, 1, 1, 1, 1, 1], []), ([0, 1, 1, 1, 1, 1], [(0.0, 1.0)]), ([1, 1, 0, 0, 1, 1], [(1.0, 4.0)]),
    ([1, 1, 1, 1, 0, 0], [(3.0, 5.0)]), ([0, 1, 0, 1, 1, 0], [(0.0, 1.0), (1.0, 3.0), (4.0, 5.0)])])
def test_slip_speeds_that_were_not_visited_are_intervals(visited: list[int], spans: list[tuple[float, float]]) -> None:
    assert not_visited(np.arange(6.0), np.array(visited, dtype=bool)) == spans


def test_the_band_is_that_of_all_numbers_together_where_slip_was_seen() -> None:
    """Scheffe's band: the root of chi-square's 95 % for five numbers times the standard error by differences."""
    values = np.array([0.25, 0.2, 0.4, -0.16, 0.02, 3000.0])
    root = np.random.default_rng(3).normal(size=(6, 6)) * (1e-3 * np.abs(values))
    covariance = root.T @ root
    slip = np.append(-np.geomspace(0.5, 60.0, 300), [80.0] * 7)   # Seven samples near 80 rad/s are too few.
    found = curve_of((*KEYS, "driveline.stiffness"), values, covariance, slip, FIG02.system.friction)

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
