"""Friction curves found from motions that SciPy made with known noise: within their band, and near the law."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from documents import valid
from oracle import equations
from scipy.integrate import solve_ivp

from tcc_sim import cli
from tcc_sim.errors import InputError
from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.windows import Model, sensitivities
from tcc_sim.scene import load_scene

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


@pytest.mark.parametrize(("free", "sentence"), [
    (["friction.curve", "friction.decay"], "friction.decay is a part of friction.curve; free one of them"),
    ({"friction.curve": 4.0}, "friction.curve has 4 exponentials; it must have 1 to 3"),
    ({"friction.curve": 1.5}, "friction.curve has 1.5 exponentials; it must have 1 to 3")])
def test_what_makes_no_curve_is_refused(free: list[str] | dict[str, float | None], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        identify(measured("dip", 1), free, scene=FIG02)


def test_single_coefficients_of_a_table_are_refused() -> None:
    scene = FIG02.with_values({"friction.slip_speeds": [0.0, 1.0, 2.0], "friction.coefficients": [0.2, 0.2, 0.2]})
    with pytest.raises(InputError, match=r"is not used where friction\.slip_speeds .* free friction\.curve instead"):
        identify(measured("dip", 1), ["friction.kinetic_coefficient"], scene=scene)


def test_the_command_writes_curve_scene_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                    figures) -> None:
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
    assert len(figures[0].axes) == 5
