"""Parameters from measurements that SciPy made, with known noise: found, covered by their intervals, or refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from documents import valid
from scipy.integrate import solve_ivp

import tcc_sim
from tcc_sim import cli
from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement, noise_of, read_table
from tcc_sim.estimation.multiple_shooting import Fit, fit
from tcc_sim.estimation.settings import DEFAULTS, FitSettings, Gates
from tcc_sim.estimation.verdicts import judged
from tcc_sim.estimation.windows import Model
from tcc_sim.scene import load_scene

KEYS = {"friction.static_coefficient": 0.3, "friction.kinetic_coefficient": 0.24, "driveline.damping": 0.6,
        "driveline.stiffness": 3000.0, "driveline.plate_inertia": 0.02}
FIG02 = load_scene("fig02")
BEGAN, ONCE = 1.0, Gates(starts=1)


@cache
def moved(seconds: float = 0.5, rate: float = 1000.0, held: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, states (n, 3) and engine torque of scene fig02 from `BEGAN` on, by SciPy on equations (1) to (7).

    held : the torque is that of the sample before
    """
    system = FIG02.system
    engine, pressure = system.engine, system.pressure
    ratio = 0.3 / 0.24

    def torque(t: float) -> float:
        t = math.floor(t * rate * (1.0 + 1e-12)) / rate if held else t
        return engine.mean_torque + engine.torque_amplitude * math.sin(engine.frequency * t)

    def rates(t: float, x: np.ndarray) -> list[float]:
        load = 0.24 * 0.08 * 0.1 * (pressure.mean + pressure.amplitude * math.sin(engine.frequency * t))
        friction = (1.0 + (ratio - 1.0) * math.exp(-2.0 * abs(x[0]))) * math.tanh(50.0 * x[0]) * load
        plate = (friction - 0.6 * x[2] - 3000.0 * x[1]) / 0.02
        return [(torque(t) - friction) / 0.2 - plate, x[2], plate]

    t = BEGAN + np.arange(round(seconds * rate)) / rate
    step = 1.0 / rate if held else math.inf
    run = solve_ivp(rates, (0.0, t[-1]), [150.0, 0.0, 0.0], "LSODA", t, rtol=1e-9, atol=1e-10, max_step=step)
    return t, run.y.T, np.array([torque(x) for x in t])


def measured(seed: int = 0, seconds: float = 0.5, **changes: object) -> tuple[Measurement, dict[str, float]]:
    """Slip and plate speed with noise of 1 % of their spread, and that noise."""
    t, states, _ = moved(seconds)
    noise = 0.01 * states.std(axis=0)
    seen = states + noise * np.random.default_rng(seed).standard_normal(states.shape)
    channels = {"slip_speed": seen[:, 0], "plate_speed": seen[:, 2]}
    return Measurement(t, channels | dict(changes)), {"slip_speed": noise[0], "plate_speed": noise[2]}


def starts(seed: int) -> dict[str, float]:
    """Every key 10 % off, in a random direction."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(KEYS))
    return {k: v * (1.0 + 0.1 * s) for (k, v), s in zip(KEYS.items(), signs)}


def test_parameters_are_found_from_starts_ten_percent_off() -> None:
    for seed in range(2):
        data, noise = measured(seed)
        found = identify(data, starts(seed), scene=FIG02, noise=noise)
        assert found.accepted, found
        for p in found.parameters:
            assert abs(p.value - KEYS[p.key]) < 4.0 * p.standard_error, p
            assert p.verdict == "identified", p
            assert p.standard_error < 0.05 * p.value, p


def test_intervals_cover_the_truth() -> None:
    """The last stage from the truth on, for 10 draws of the noise: squared errors are their variances.

    Fifty numbers, of which five go together: where the counts of sub-steps were not held this was above 50.
    """
    _, states, _ = moved(0.3)
    truth, settings, squares = np.array(list(KEYS.values())), FitSettings(), []
    for seed in range(10):
        data, noise = measured(100 + seed, 0.3)
        model = Model(FIG02.system, tuple(KEYS), data)
        found = fit(model, noise, truth, settings, settings.stages[-1:], states[::100].copy())
        squares.append((found.values - truth) ** 2 / np.diag(found.covariance))
    assert 0.4 < np.mean(squares) < 2.0
    assert np.mean(np.array(squares) < 1.96**2) >= 0.88


def test_what_one_kilohertz_does_not_tell_is_said() -> None:
    """The decay goes with mu_s: at 1 kHz the fall after breakaway is over within a sample or two."""
    data, noise = measured(3)
    free = {k: KEYS[k] for k in list(KEYS)[:2]} | {"friction.decay": 2.5}
    found = identify(data, free, scene=FIG02, noise=noise)
    decay = found.parameters[2]
    assert abs(found.correlations[0, 2]) > 0.9
    assert decay.verdict == "not identifiable"
    assert "friction.static_coefficient" in decay.why
    assert "10 kHz" in decay.why


def test_measured_torque_drives_the_model_and_its_offset_is_found() -> None:
    t, states, torque = moved(0.2, 1000.0, held=True)
    rng = np.random.default_rng(5)
    channels = {"slip_speed": states[:, 0] + 0.05 * rng.standard_normal(len(t)),
                "plate_speed": states[:, 2] + 0.05 * rng.standard_normal(len(t))}
    data = Measurement(t, channels, {"engine_torque": torque + 6.0})
    found = identify(data, {"driveline.stiffness": 3150.0, "engine_torque.offset": None}, scene=FIG02,
                     noise={"slip_speed": 0.05, "plate_speed": 0.05})
    assert found.accepted
    for p, truth in zip(found.parameters, (3000.0, 6.0)):
        assert abs(p.value - truth) < 4.0 * p.standard_error, p


def test_the_noise_of_a_smooth_signal_is_found() -> None:
    t = np.arange(2000) * 1e-3
    for level in (0.01, 1.0):
        signal = 50.0 * np.sin(100.0 * t) + level * np.random.default_rng(0).standard_normal(len(t))
        assert noise_of(signal) == pytest.approx(level, rel=0.1)


def refused(channels: dict[str, np.ndarray], words: str, t: np.ndarray | None = None, **changes: float) -> None:
    """The fit of the stiffness is said to be none, with these words."""
    data, noise = measured()
    scene = FIG02.with_values({key.replace("__", "."): value for key, value in changes.items()})
    found = identify(Measurement(data.t if t is None else t, data.channels | channels), {"driveline.stiffness": 3100.0},
                     scene=scene, noise=noise, gates=ONCE)
    assert not found.accepted
    assert words in found.why
    assert found.parameters[0].verdict == "not identifiable"
    assert found.scene.text() == scene.text()


def test_a_dead_channel_is_said() -> None:
    t, states, _ = moved()
    with pytest.raises(InputError, match="plate_speed is 0 rad/s throughout; the channel is dead"):
        Measurement(t, {"slip_speed": states[:, 0], "plate_speed": np.zeros_like(t)})
    with pytest.raises(InputError, match="slip_speed of sample 201 is no number"):
        Measurement(t, {"slip_speed": np.where(t > 1.2, np.nan, states[:, 0])})


def test_a_swapped_sign_is_said() -> None:
    refused({"plate_speed": -measured()[0].channels["plate_speed"]}, "plate_speed looks as if its sign were swapped")


def test_a_wrong_scene_is_said() -> None:
    refused({}, "the scene does not explain the measurement", engine__torque_amplitude=200.0)


def test_clock_drift_is_said() -> None:
    """0.3 % between two clocks; a transient, whose phase moves by itself, is no such thing and is fitted."""
    t = moved()[0]
    refused({}, "or the clocks differ", BEGAN + (t - BEGAN) * 1.003)
    run = tcc_sim.closed_loop("fig02", lambda reading: None, seconds=0.4)
    assert np.abs(run.slip_speed).max() > 149.0
    found = identify(Measurement(run.t, {"slip_speed": run.slip_speed, "plate_speed": run.plate_speed}),
                     {"driveline.stiffness": 3100.0}, scene=FIG02)
    assert found.accepted
    assert found.parameters[0].value == pytest.approx(3000.0, rel=1e-4)


def test_gaps_and_uneven_samples_are_said() -> None:
    t, states, _ = moved()
    slip = states[:, 0]
    with pytest.raises(InputError, match=r"gap of 0\.031 s"):
        Measurement(np.delete(t, slice(100, 130)), {"slip_speed": np.delete(slip, slice(100, 130))})
    slower = np.r_[0:200, 200:500:2]
    with pytest.raises(InputError, match=r"a gap of 0\.002 s at 1\.2 s"):
        Measurement(t[slower], {"slip_speed": slip[slower]})
    with pytest.raises(InputError, match="evenly spaced"):
        Measurement(t + 1e-4 * (np.arange(len(t)) % 7 == 0), {"slip_speed": slip})


@pytest.mark.parametrize("rate", [500.0, 4000.0])
def test_any_even_rate_of_sampling_will_do(rate: float) -> None:
    t, states, _ = moved(0.2, rate)
    seen = states + 0.05 * np.random.default_rng(4).standard_normal(states.shape)
    found = identify(Measurement(t, {"slip_speed": seen[:, 0], "plate_speed": seen[:, 2]}),
                     {"driveline.stiffness": 3300.0}, scene=FIG02, noise={"slip_speed": 0.05, "plate_speed": 0.05})
    assert found.accepted
    assert abs(found.parameters[0].value - 3000.0) < 4.0 * found.parameters[0].standard_error


def test_what_cannot_be_identified_is_said() -> None:
    data = measured()[0]
    for wrong, words in (({"clutch.area": 1.0}, "cannot be identified"), ({"friction.decai": 1.0}, "friction.decay"),
                         ({"driveline.stiffness": -1.0}, "driveline.stiffness is -1"), ({}, "no key is free"),
                         ("friction.decai", "friction.decay")):
        with pytest.raises(InputError, match=words):
            identify(data, wrong, scene=FIG02)


def test_a_profile_is_what_fits_with_the_key_held_come_to() -> None:
    data, noise = measured(1, 0.3)
    free = {"driveline.stiffness": 3010.0, "driveline.damping": 0.61}
    found = identify(data, free, scene=FIG02, noise=noise, likelihood="driveline.stiffness", gates=ONCE)
    assert found.likelihood is not None
    values, excess = found.likelihood.values, found.likelihood.excess
    samples = sum(map(len, found.residuals.values()))
    for k in (1, 8):
        held = FIG02.with_values({"driveline.stiffness": float(values[k])})
        by_hand = identify(data, {"driveline.damping": 0.61}, scene=held, noise=noise, gates=replace(ONCE, known=9.0))
        rise = by_hand.chi2_per_dof * (samples - 4) - found.chi2_per_dof * (samples - 5)
        assert excess[k] == pytest.approx(rise, abs=0.05)
        # And that of a parabola: k is (k - 6)/2 standard errors from the best value.
        assert excess[k] == pytest.approx((0.5 * (k - 6)) ** 2, rel=0.2, abs=0.1)


def test_verdicts() -> None:
    """At a bound, told, and not told because of another parameter, by the numbers of a fit."""
    keys, none = ("friction.static_coefficient", "friction.kinetic_coefficient", "driveline.damping"), np.zeros(3)
    values, errors = np.array([0.24 * DEFAULTS.least_ratio, 0.24, 0.6]), np.array([1e-3, 1e-3, 0.01])
    fitted = Fit(values, np.diag(errors**2), np.zeros((1, 3)), {}, 1.0, 0.0)
    alone, together = np.eye(3), np.eye(3) + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.995], [0.0, -0.995, 0.0]])
    told = [judged(keys, i, none[i], fitted, errors, alone, True, Gates(), 1e-3) for i in range(3)]
    assert [p.verdict for p in told] == ["at its bound", "at its bound", "identified"]
    damping = judged(keys, 2, 0.6, fitted, errors, together, True, Gates(), 1e-3)
    assert damping.verdict == "not identifiable"
    assert "friction.kinetic_coefficient (correlation -0.995)" in damping.why
    wide = judged(keys, 2, 0.6, fitted, 20.0 * errors, alone, True, Gates(), 1e-3)
    assert (wide.verdict, wide.high - wide.low) == ("not identifiable", pytest.approx(2.0 * 1.96 * 0.2, rel=1e-3))
    fitted = replace(fitted, values=np.array([0.3, 0.24, 0.6]))
    slow, fast = (judged(keys, 0, 0.3, fitted, 100.0 * errors, alone, True, Gates(), step) for step in (1e-3, 1e-4))
    assert "10 kHz" in slow.why
    assert "10 kHz" not in fast.why
    assert "more breakaways" in fast.why


def test_a_start_that_leads_nowhere_is_followed_by_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first two fits fail; the third one begins elsewhere, within the spread, and is taken."""
    data, noise = measured(2, 0.3)
    begun: list[float] = []

    def failing(model: Model, levels: dict[str, float], values: np.ndarray, *rest: object, **named: object) -> Fit:
        begun.append(float(values[0]))
        if len(begun) < 3:
            raise NumericalFailure("nowhere")
        return fit(model, levels, values, *rest, **named)

    monkeypatch.setattr("tcc_sim.estimation.identify.fit", failing)
    found = identify(data, {"driveline.stiffness": 3100.0}, scene=FIG02, noise=noise)
    assert (found.accepted, found.starts) == (True, 3)
    assert begun[0] == 3100.0
    assert len(set(begun)) == 3
    assert all(abs(value / 3100.0 - 1.0) <= Gates().spread for value in begun)


def test_the_command_writes_the_scene_that_it_found(tmp_path, capsys) -> None:
    pytest.importorskip("matplotlib")
    t, states, _ = moved()
    table, out = tmp_path / "data.csv", tmp_path / "mine.yaml"
    noise = 0.1 * np.random.default_rng(8).standard_normal((len(t), 2))
    np.savetxt(table, np.column_stack([t, states[:, [0, 2]] + noise]), delimiter=",", header="t,slip_speed,plate_speed",
               comments="")
    words = ["identify", str(table), "--free", "driveline.stiffness=3200", "--free", "driveline.damping", "--scene",
             "fig02", "--noise", "slip_speed=0.1,plate_speed=0.1", "--likelihood", "driveline.stiffness", "--json",
             str(tmp_path / "found.json"), "--out", str(out), "--plot", str(tmp_path / "found.png")]
    assert cli.main(words) == 0
    assert "identified" in capsys.readouterr().out
    found = valid("identify", json.loads((tmp_path / "found.json").read_text()))
    assert found["accepted"]
    stiffness = found["parameters"][0]
    assert load_scene(str(out)).system.driveline.stiffness == pytest.approx(stiffness["value"])
    profile = found["likelihood"]
    # One parameter's profile is a parabola: 1.96 standard errors from the best value it rises by 3.84.
    rise = np.interp(stiffness["high"], profile["values"], profile["excess"])
    assert rise == pytest.approx(3.84, rel=0.3)
    assert cli.main(words) == 2
    assert cli.main(["identify", str(table), "--free", "driveline.stiffness"]) == 2
    assert "--scene" in capsys.readouterr().err
    twice = ["--free", "driveline.stiffness=2800", "--free", "driveline.stiffness=3200"]
    assert cli.main(["identify", str(table), "--scene", "fig02", *twice]) == 2
    assert "--free gives driveline.stiffness twice" in capsys.readouterr().err


def test_a_table_is_read_or_refused(tmp_path) -> None:
    path = tmp_path / "x.csv"
    rows = "".join(f"{k * 1e-3},{k % 7}\n" for k in range(60))
    path.write_text("t,slip_speed\n" + rows)
    assert read_table(path).step == pytest.approx(1e-3)
    path.write_text("\ufefft,slip_speed\n" + rows)  # As spreadsheets write it.
    assert read_table(path).step == pytest.approx(1e-3)
    for text, words in (("t,slip_speed\n1,2\n", "samples"), ("t,slip\n" + rows, "slip is not"), ("t\n1\n", "no column"),
                        ("t,slip_speed\n1,x\n", "line 2"), ("t,slip_speed\n1,2,3\n", "has 3 values")):
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            read_table(path)
