"""Parameters from measurements by SciPy with known noise: found, covered by their intervals, or refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from documents import valid
from driveline_bags import bag, ticked
from fig02_measured import FIG02, KEYS, ONCE, QUICK, measured, moved

from tcc_sim import cli
from tcc_sim.errors import InputError
from tcc_sim.estimation.identify import given, identify
from tcc_sim.estimation.measurement import Measurement, measurement_in
from tcc_sim.estimation.multiple_shooting import INDEX, Gates
from tcc_sim.output.samples import write_samples
from tcc_sim.recording.announcements import holding_from
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.tables.measured_table import table_in


def starts(seed: int) -> dict[str, float]:
    """Every key 10 % off, in a random direction."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(KEYS))
    return {k: v * (1.0 + 0.1 * s) for (k, v), s in zip(KEYS.items(), signs)}


def test_parameters_are_found_from_starts_ten_percent_off() -> None:
    for seed in range(2):
        data, noise = measured(seed)
        result = identify(data, starts(seed), scene=FIG02, noise=noise)
        assert result.accepted, result
        assert list(result.as_json()) == ["parameters", "correlations", "chi2_per_dof", "accepted", "why", "noise",
                                          "windows",
                                          "starts", "seconds", "whiteness", "warnings"]
        assert list(result.columns()) == ["key", "start", "value", "standard_error", "low", "high", "verdict", "why"]
        assert result.columns()["key"] == list(KEYS)
        assert repr(result).startswith(f"<Identification: chi2/dof {result.chi2_per_dof:.3f}; "
                                       f"friction.static_coefficient ")
        for p in result.parameters:
            assert abs(p.value - KEYS[p.key]) < 4.0 * p.standard_error, p
            assert p.verdict == "identified", p
            assert p.standard_error < 0.05 * p.value, p


@pytest.mark.parametrize("hold", ["previous", "linear", "next"])
def test_how_an_input_holds_is_found(hold: str) -> None:
    """Samples of a smooth torque are linear between; with `next` a row has what acted in the step that ended there."""
    t, states, torque = moved(0.1, held=hold != "linear")
    if hold == "next":
        torque = np.append(torque[:1], torque[:-1])
    rng, level = np.random.default_rng(5), 0.2 if hold == "linear" else 0.05   # A line misses 0.2 % of the sine.
    channels = {"slip_speed": states[:, 0] + level * rng.standard_normal(len(t)),
                "plate_speed": states[:, 2] + level * rng.standard_normal(len(t))}
    data, noise = Measurement(t, channels, {"engine_torque": torque}), {"slip_speed": level, "plate_speed": level}
    result = identify(data, {"driveline.stiffness": 3150.0}, scene=FIG02, noise=noise, settings=QUICK,
                      gates=ONCE)
    assert (result.accepted, result.hold) == (True, hold), result.why
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.2)
    assert abs(result.parameters[0].value - 3000.0) < 4.0 * result.parameters[0].standard_error
    if hold == "previous":
        assumed = identify(data, {"driveline.stiffness": 3150.0}, scene=FIG02, noise=noise, hold="linear", gates=ONCE,
                           settings=QUICK)
        assert (assumed.accepted, assumed.hold) == (False, "linear")
        with pytest.raises(InputError, match="hold is 'cubic'"):
            identify(data, {"driveline.stiffness": 3150.0}, scene=FIG02, hold="cubic")


def test_a_refused_fit_tries_no_more_starts_than_it_has_work_for() -> None:
    data, noise = measured(0, 0.1)
    wrong = FIG02.with_values({"engine.torque_amplitude": 200.0})
    tried = [identify(data, {"driveline.stiffness": 3100.0}, scene=wrong, noise=noise, settings=QUICK,
                      gates=Gates(starts=2, work=work)).starts for work in (1.0, 1e9)]
    assert tried == [1, 2]


def test_the_offset_of_a_pressure_is_what_its_sensor_shows_too_much() -> None:
    t, states, _ = moved(0.2)
    pressure = FIG02.system.pressure
    shown = pressure.mean + pressure.amplitude * np.sin(FIG02.system.engine.frequency * t) + 5e3
    seen = states + 0.2 * np.random.default_rng(9).standard_normal(states.shape)
    result = identify(Measurement(t, {"slip_speed": seen[:, 0], "plate_speed": seen[:, 2]},
                                  {"actuation_pressure": shown}), ["actuation_pressure.offset"], scene=FIG02,
                      noise={"slip_speed": 0.2, "plate_speed": 0.2}, hold="linear").parameters[0]
    assert result.value == pytest.approx(5e3, abs=4.0 * result.standard_error)
    assert result.standard_error < 500.0


def test_what_one_kilohertz_does_not_tell_is_said() -> None:
    """The decay goes with mu_s: at 1 kHz the fall after breakaway is over within a sample or two."""
    data, noise = measured(3)
    free = {k: KEYS[k] for k in list(KEYS)[:2]} | {"friction.decay": 2.5}
    result = identify(data, free, scene=FIG02, noise=noise)
    decay = result.parameters[2]
    assert abs(result.correlations[0, 2]) > 0.9
    assert decay.verdict == "not identifiable"
    assert "friction.static_coefficient" in decay.why
    assert "10 kHz" in decay.why


@pytest.mark.parametrize("suffix", [".mcap", ".csv"])
@pytest.mark.parametrize(("cycles", "left_out"), [(2.0, 0), (2.005, 1)])
def test_a_short_last_step_is_left_out(tmp_path, suffix: str, cycles: float, left_out: int) -> None:
    """With 100 samples a cycle: a simulation ends at its duration, here half a step after its last full step."""
    run, path = solve(FIG02, duration=cycles * FIG02.system.cycle, samples_per_cycle=100), tmp_path / f"run{suffix}"
    write_samples(path, run, FIG02.text())
    kept = slice(0, 201)
    measured, _ = given(path, FIG02)
    assert measured.t.tolist() == pytest.approx(run.t[kept], abs=1e-9)
    assert measured.channels["slip_speed"] == pytest.approx(run.slip_speed[kept], rel=1e-12)
    assert {len(values) for values in measured.inputs.values()} <= {201}
    assert measured.notes == (f"{path}: the last sample is left out; its step of 0.00020944 s is shorter than the "
                              "others, 0.000418879 s",)[:left_out]


@pytest.mark.parametrize(("rate", "channel", "level"), [(500.0, "plate_speed", 0.05), (2000.0, "plate_angle", 2e-4)])
def test_any_even_rate_and_any_channel_of_the_plate_will_do(rate: float, channel: str, level: float) -> None:
    t, states, _ = moved(0.1, rate)
    seen = states + np.array([0.05, 2e-4, 0.05]) * np.random.default_rng(4).standard_normal(states.shape)
    result = identify(Measurement(t, {"slip_speed": seen[:, 0], channel: seen[:, INDEX[channel]]}),
                      {"driveline.stiffness": 3300.0}, scene=FIG02, noise={"slip_speed": 0.05, channel: level})
    assert result.accepted
    assert abs(result.parameters[0].value - 3000.0) < 4.0 * result.parameters[0].standard_error


def test_the_profile_of_a_key_that_is_free_alone_is_a_parabola() -> None:
    """No other key is fitted again."""
    data, noise = measured(1)
    found = identify(data, {"driveline.stiffness": 3010.0}, scene=FIG02, noise=noise, likelihood="driveline.stiffness",
                     gates=ONCE)
    assert found.likelihood.excess == pytest.approx((0.5 * np.arange(-6.0, 7.0)) ** 2, rel=0.2, abs=0.1)


def test_the_command_writes_the_scene_that_it_found(tmp_path, capsys, pictures) -> None:
    t, states, _ = moved(0.1)
    table, out = tmp_path / "data.csv", tmp_path / "mine.yaml"
    noise = 0.1 * np.random.default_rng(8).standard_normal((len(t), 2))
    np.savetxt(table, np.column_stack([t, states[:, [0, 2]] + noise]), delimiter=",", header="t,slip_speed,plate_speed",
               comments="")
    words = ["identify", str(table), "--free", "driveline.stiffness=3200", "--free", "driveline.damping", "--scene",
             "fig02", "--noise", "slip_speed=0.1,plate_speed=0.1", "--likelihood", "driveline.stiffness", "--json",
             str(tmp_path / "found.json"), "--out", str(out), "--plot", str(tmp_path / "found.png")]
    assert cli.main(words) == 0
    assert "identified" in capsys.readouterr().out
    document = valid("identify", json.loads((tmp_path / "found.json").read_text()))
    assert document["accepted"]
    assert set(document["whiteness"]["p_value"]) == {"slip_speed", "plate_speed"}
    stiffness = document["parameters"][0]
    assert load_scene(str(out)).system.driveline.stiffness == pytest.approx(stiffness["value"])
    profile = document["likelihood"]
    # One parameter's profile is a parabola: 1.96 standard errors from the best value it rises by 3.84.
    rise = np.interp(stiffness["high"], profile["values"], profile["excess"])
    assert rise == pytest.approx(3.84, rel=0.3)
    assert cli.main(words) == 2
    assert cli.main(["identify", str(table), "--free", "driveline.stiffness"]) == 2
    assert "--scene" in capsys.readouterr().err
    twice = ["--free", "driveline.stiffness=2800", "--free", "driveline.stiffness=3200"]
    assert cli.main(["identify", str(table), "--scene", "fig02", *twice]) == 2
    assert "--free gives driveline.stiffness twice" in capsys.readouterr().err


def test_a_recording_with_losses_is_identified_from_its_longest_part(tmp_path) -> None:
    scene = load_scene("controlled")
    rows = ticked(scene, 400, pressure=lambda k: 90e3 + 10e3 * np.sin(0.05 * k))
    for lost, kept in (((), (0, 399)), ((60, 61, 250), (62, 249)), ((30,), (31, 399))):
        path = bag(tmp_path / f"run{len(lost)}", [row for k, row in enumerate(rows) if k not in lost], scene)
        found, _ = given(path)
        stamps = np.round(found.t / found.step)
        assert (stamps[0], stamps[-1], len(stamps)) == (*kept, kept[1] - kept[0] + 1)
        assert found.inputs["actuation_pressure"].shape == (len(stamps), 2)
        assert len(found.notes) == bool(lost)
        assert all(f"{kept[0] * 1e-3:g} to {kept[1] * 1e-3:g} s" in note for note in found.notes)


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize(("keys", "ticks", "changed"), [
    ({"driveline.stiffness": 1000.0}, (100, 400), None), ({"driveline.stiffness": 1000.0}, (400, 100), None),
    ({"pressure.source": "harmonic"}, (100, 400), None), ({}, (100, 400), None), ({}, (100, 400), 40),
    ({}, (100, 400), 140)])
def test_a_recording_is_identified_with_the_scene_of_its_longest_run(tmp_path, named, keys, ticks, changed):
    """A driveline is started again with other keys; another one changes while it runs."""
    scenes = first, second = load_scene("controlled"), load_scene("controlled").with_values(keys)
    rows = [row for scene, count in zip(scenes, ticks) for row in ticked(
        scene, count, pressure=lambda k: 90e3 + 10e3 * np.sin(0.05 * k))]
    said = {ticks[0]: second.text()}
    if changed is not None:
        said[changed] = holding_from(first.with_values({"driveline.damping": 7.0}).text(), rows[changed][0])
    path = bag(tmp_path / "run", rows, first, said=sorted(said.items()), named=named,
               publishers=[(0, "a1"), (ticks[0], "b2")] if named else None)
    if changed is not None and changed > ticks[0]:
        with pytest.raises(InputError, match="scene changed"):
            given(path)
        return
    found, scene = given(path)
    assert (len(found.t), scene.system) == (400, scenes[ticks[1] > ticks[0]].system)
    assert list(found.inputs) == ["actuation_pressure"] * (scene.system.pressure.source == "topic")


def test_a_table_is_read_or_refused(tmp_path) -> None:
    path = tmp_path / "x.csv"
    rows = "".join(f"{k * 1e-3},{k % 7}\n" for k in range(60))
    path.write_text("t,slip_speed\n" + rows)
    assert measurement_in(table_in(path)).step == pytest.approx(1e-3)
    path.write_text("\ufefft,slip_speed\n" + rows)  # As spreadsheets write it.
    assert measurement_in(table_in(path)).step == pytest.approx(1e-3)
    for text, words in (("t,slip_speed\n1,2\n", "samples"),
                        ("t,slip\n" + rows, "no column slip_speed; the file has slip"),
                        ("t\n1\n", "no columns were recognised"),
                        ("t,slip_speed\n1,x\n", "line 2"), ("t,slip_speed\n1,2,3\n", "has 3 values")):
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            measurement_in(table_in(path, ("slip_speed",)))
    for option in ({"columns": "t=t"}, {"start": 0.0}, {"end": 0.0}):
        with pytest.raises(InputError, match=r"^--columns, --from and --to are for tables, and .*run is a recording$"):
            given(tmp_path / "run", FIG02, **option)
