"""Every kind of run x every panel and every Rerun entity: curves on the run's samples, gaps, extremes, units."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driveline_bags import bag, ticked
from pictures import broken, check, curves, labelled, panels, passes, rerun_line, shaded, shown_in_rerun

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.plant.closed_loop import LockstepRun
from tcc_sim.solvers import SOLVERS

pytest.importorskip("matplotlib", reason="matplotlib is not installed")

NAMED = {"engine": "engine_torque", "friction": "friction_torque", r"$\mu_k N R$": "saturation_torque",
         "slip speed": "slip_speed"}
"""Columns of a run by the names of their curves over time."""
LOOSE = {"fixed_step": ["--step", "2e-3"], "smoothed": ["--rtol", "1e-2"], "event_driven": ["--rtol", "1e-2"],
         "rk45": ["--rtol", "1e-2"], "lsoda": ["--rtol", "1e-2"]}
"""Settings with which a run by a solver of each kind differs from the exact one by more than a line's width."""


def samples_of(file: Path) -> dict[str, Any]:
    """Return the arrays of a .npz."""
    with np.load(file) as arrays:
        return {name: arrays[name] for name in arrays.files}


def over_time(drawn: Any, t: Any, columns: Any, summary: dict[str, Any], tolerance: float = 1e-9) -> None:
    """Check torques, slip speed, stick, portrait and maxima of the last cycles, or of all of a run."""
    shown = panels(drawn)
    for title in ("Torques", "Slip speed"):
        lines = curves(shown[title])
        label = shown[title].get_ylabel().replace("\n", " ")
        assert label == ("torque (N m)" if title == "Torques" else "slip speed (rad/s)")
        for name, column in NAMED.items():
            if name in lines and np.isfinite(columns[column]).any():
                assert passes(lines[name], t, columns[column], tolerance) > 20
    x, slip = curves(shown["Slip speed"])["slip speed"]
    assert np.nanmax(np.abs(slip)) <= summary["max_slip_speed"] * (1.0 + 1e-3)
    assert np.nanmin(slip) >= summary["min_slip_speed"] - 1e-3 * summary["max_slip_speed"]
    inside = (t >= x[0]) & (t <= x[-1])
    unstuck = t[inside & ~((columns["state"] == 0) & np.isfinite(columns["slip_speed"]))]
    for begin, end in shaded(shown["Slip speed"]):
        assert not ((unstuck > begin + 1e-9) & (unstuck < end - 1e-9)).any(), "stick is shaded where the clutch slips"
    if "Phase portrait" in shown:
        angle, height = next(iter(curves(shown["Phase portrait"]).values()))
        name = "plate_speed" if "plate speed" in shown["Phase portrait"].get_ylabel() else "slip_speed"
        last = slice(-20, None)
        place = np.stack([angle, height]) / [[np.nanmax(np.abs(angle))], [np.nanmax(np.abs(height))]]
        for sample in zip(columns["plate_angle"][inside][last], columns[name][inside][last]):
            if np.isfinite(sample).all():
                at = np.array(sample)[:, None] / [[np.nanmax(np.abs(angle))], [np.nanmax(np.abs(height))]]
                assert np.nanmin(np.abs(place - at).max(axis=0)) < 1e-6 + tolerance


@pytest.mark.parametrize("solver", LOOSE)
def test_simulate_draws_the_run_of_its_own_solver(solver: str, pictures: list[Any], tmp_path: Path) -> None:
    """Coarse settings, so that another solver's run is another curve; figures depend on neither --plot nor --out."""
    scene = ["slip", "--set", f"friction.law={SOLVERS[solver].laws[-1]}"]
    words = ["simulate", *scene, "--solver", solver, "--cycles", "24", *LOOSE[solver]]
    for k, more in enumerate((["--plot", "a.png"], ["--out", "a.npz"], ["--out", "b.npz", "--samples", "7"], [])):
        assert main([*words, "--json", str(tmp_path / f"{k}.json"),
                     *(str(tmp_path / word) if "." in word else word for word in more)]) == 0
    documents = [json.loads((tmp_path / f"{k}.json").read_text()) for k in range(4)]
    for document in documents:
        document.pop("elapsed_s"), document.pop("command"), document.pop("created", None)
    assert documents[0] == documents[1] == documents[2] == documents[3]
    run = samples_of(tmp_path / "a.npz")
    over_time(pictures[0], run["t"], run, documents[0], 1e-6)
    _, largest = next(iter(curves(panels(pictures[0])["Maxima"]).values()))
    whole = np.maximum(np.abs(run["cycle_highest"]), np.abs(run["cycle_lowest"]))
    assert np.isin(largest, whole).all()


def test_a_run_without_samples_shows_its_section_and_maxima_alone(pictures: list[Any], tmp_path: Path) -> None:
    run = tcc_sim.solve("slip", cycles=60, solver="lsoda", rtol=1e-2)
    for result in (run, tcc_sim.simulate("apply")):
        tcc_sim.plot(result, tmp_path / "a.png", force=True)
    shown = panels(pictures[0])
    assert list(shown) == ["Phase portrait", "Maxima"]
    (angle, slip), = curves(shown["Phase portrait"]).values()
    last = run.solved_cycles.section[-len(slip):]
    assert sorted(zip(angle, slip)) == sorted(zip(last[:, 1], last[:, 0]))
    assert "Torques" not in panels(pictures[1])
    for drawn in pictures:
        labelled(drawn)


@pytest.mark.parametrize(("scene", "duration"), [("apply", "1"), ("runup", "4"), ("tip_in", "2.37")])
def test_a_manoeuvre_is_drawn_whole(scene: str, duration: str, pictures: list[Any], tmp_path: Path) -> None:
    words = ["simulate", scene, "--duration", duration]
    assert main([*words, "--json", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.png")]) == 0
    assert main([*words, "--out", str(tmp_path / "a.npz")]) == 0
    summary, run = json.loads((tmp_path / "a.json").read_text()), samples_of(tmp_path / "a.npz")
    drawn, shown = pictures[0], panels(pictures[0])
    over_time(drawn, run["t"], run, summary, 1e-6)
    labelled(drawn)
    (t, shaft), = curves(shown["Shaft torque"]).values()
    driveline = tcc_sim.load_scene(scene).system.driveline
    torque = driveline.damping * run["plate_speed"] + driveline.stiffness * run["plate_angle"]
    passes((t, shaft), run["t"], torque, 1e-6)
    (t, heat), = curves(shown["Cumulative heat in the clutch"]).values()
    assert (t[0], t[-1]) == (run["t"][0], run["t"][-1])
    assert 1e3 * heat[-1] == pytest.approx(summary["clutch_energy"], rel=2e-3)
    assert shaft.max() == pytest.approx(summary["max_shaft_torque"], rel=2e-3)


def held(reading: Any) -> float:
    """A pressure that rises with the slip speed."""
    return 90e3 + 1.5e3 * reading.slip_speed


COMMANDED = {
    "closed loop": lambda: tcc_sim.closed_loop("controlled", held, 1.5, at={0.5: {"engine.mean_torque": 240.0}}),
    "closed loop of changed pressure": lambda: tcc_sim.closed_loop(
        tcc_sim.load_scene("fig02"), lambda _: None, 1.5, at={0.5: {"pressure.mean": 2.4e5}}),
    "closed loop with a profile": lambda: tcc_sim.closed_loop(
        tcc_sim.load_scene("controlled").with_values({"engine.mean_torque_times": [0.0, 0.6, 0.8],
                                                      "engine.mean_torque_values": [200.0, 200.0, 260.0]}),
        held, 1.2),
    "closed loop at a low rate": lambda: tcc_sim.closed_loop(
        tcc_sim.load_scene("controlled").with_values({"engine.mean_torque_times": [0.0, 0.6],
                                                      "engine.mean_torque_values": [200.0, 230.0],
                                                      "engine.frequency": 400.0}), held, 1.0, rate=500.0),
    "kit": lambda: LockstepRun(**vars(tcc_sim.closed_loop("controlled", held, 1.5, at={
        0.5: {"engine.mean_torque": 240.0}})), targets=((20.0, 0), (25.0, 700)))}


@pytest.mark.parametrize("name", COMMANDED)
def test_a_run_under_commands_is_drawn_as_it_was(name: str, pictures: list[Any], tmp_path: Path) -> None:
    run = COMMANDED[name]()
    tcc_sim.plot(run, tmp_path / "a.png")
    drawn, shown = pictures[0], panels(pictures[0])
    columns = {column: getattr(run, column) for column in (*NAMED.values(), "state", "plate_angle", "plate_speed")}
    over_time(drawn, run.t, columns, {"max_slip_speed": np.abs(run.slip_speed).max(),
                                      "min_slip_speed": run.slip_speed.min()})
    pressure = curves(shown["Actuation pressure"])
    t, applied = pressure["applied"]
    assert t[-1] == run.t[-1]
    passes((t, 1e3 * applied), run.t[:-1], run.applied_pressure[1:], 1e-12)
    title = next(title for title in shown if title.startswith("Cycle mean"))
    ends, means = curves(shown[title])["cycle mean"]
    assert len(means) > 20
    for end, mean in list(zip(ends, means))[3::9]:
        inside = (run.t >= end - run.cycle - 1e-9) & (run.t <= end + 1e-9)
        assert mean == pytest.approx(run.slip_speed[inside].mean(), abs=0.1 * np.abs(run.slip_speed).max())
    if isinstance(run, LockstepRun):
        t, target = curves(shown[title])["target"]
        assert (t.tolist(), target.tolist()) == ([0.0, 0.7, run.t[-1]], [20.0, 25.0, 25.0])


def test_a_pressure_that_pulsates_is_drawn_by_its_range(pictures: list[Any], tmp_path: Path) -> None:
    """For 0.8 s by 20 kPa in each of 25 commands of a cycle, then by 5 kPa; commanded alike."""
    scene = tcc_sim.load_scene("controlled").with_values({"engine.speed": "4800rpm", "engine.order": 1.0})
    run = tcc_sim.closed_loop(scene, lambda r: 2e5 + (2e4 if r.stamp_ns < 8e8 else 5e3) * np.sin(
        2.0 * np.pi * 80.0 * r.stamp_ns * 1e-9), 1.6, rate=2000.0)
    tcc_sim.plot(run, tmp_path / "a.png")
    for band in panels(pictures[0])["Actuation pressure"].collections:
        t, pressure = band.get_paths()[0].vertices.T
        for begin, end, size in ((0.1, 0.75, 20.0), (0.9, 1.55, 5.0)):
            inside = pressure[(t > begin) & (t < end)]
            assert (inside.min(), inside.max()) == pytest.approx((200.0 - size, 200.0 + size), abs=0.02 * size)
            assert (np.abs(inside - 200.0) > 0.95 * size).all()
    assert len(panels(pictures[0])["Actuation pressure"].collections) == 2


def test_an_input_table_is_drawn_beside_its_measurement(pictures: list[Any], tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.2, 2401)
    columns = t, 300.0 + 250.0 * np.sin(150.0 * t), 10.0 + np.sin(150.0 * t)
    for name, count in (("a", 3), ("b", 2)):
        np.savetxt(tmp_path / f"{name}.csv", np.stack(columns[:count], axis=1), delimiter=",",
                   header=",".join(("t", "engine_torque", "slip_speed")[:count]), comments="")
        assert main(["simulate", "fig02", "--inputs", str(tmp_path / f"{name}.csv"), "--hold", "linear", "--plot",
                     str(tmp_path / f"{name}.png"), "--json", str(tmp_path / f"{name}.json"), "--out",
                     str(tmp_path / f"{name}.npz")]) == 0
    run, shown = samples_of(tmp_path / "a.npz"), panels(pictures[0])
    for title in ("Start", "End"):
        passes(curves(shown[title])["simulated"], run["t"], run["slip_speed"])
        passes(curves(shown[title])["recorded"], t, columns[2])
    (at, apart), = curves(shown["Simulated less recorded"]).values()
    np.testing.assert_allclose(apart, np.interp(at, run["t"], run["slip_speed"]) - 10.0 - np.sin(150.0 * at), atol=0.3)
    run = samples_of(tmp_path / "b.npz")
    over_time(pictures[1], run["t"], run, json.loads((tmp_path / "b.json").read_text()))
    for drawn in pictures:
        labelled(drawn)


@pytest.fixture(scope="module")
def rows() -> list[Any]:
    """Three seconds of fig02 at 1 kHz, with a change of the friction that no scene announces."""
    return ticked(tcc_sim.load_scene("fig02"), 3000, changes=[(1200, {"friction.kinetic_coefficient": 0.22}, False)])


LOST = {"whole": [], "several": [*range(500, 560), 2800, *range(2900, 2905)],
        "two per cent": sorted(np.random.default_rng(4).choice(np.arange(5, 2990), 60, replace=False).tolist())}
"""States that a recording lacks, by row."""


def table_of(rows: Any) -> dict[str, Any]:
    """Return the columns of states by the names of a run's columns."""
    stamp, _, angle, flywheel, plate, engine, friction, _ = np.array(rows, float).T
    slip = flywheel - plate
    return {"t": 1e-9 * stamp, "slip_speed": slip, "plate_angle": angle, "plate_speed": plate, "engine_torque": engine,
            "friction_torque": friction, "saturation_torque": np.full(len(slip), np.nan)}


@pytest.mark.parametrize(("lost", "part"), [("whole", False), ("two per cent", False), ("several", True)])
def test_a_recording_is_drawn_with_its_gaps(lost: str, part: bool, rows: list[Any], pictures: list[Any],
                                            tmp_path: Path) -> None:
    """By `analyse --plot`, by `plot` of the trajectory that was read, and in a Rerun file."""
    pytest.importorskip("rerun")
    kept = [row for k, row in enumerate(rows) if k not in set(LOST[lost])]
    recording = bag(tmp_path / "run", kept, "fig02")
    window = ["--from", "0.4", "--to", "2.95"] if part else []
    rrd, json_ = tmp_path / "a.rrd", tmp_path / "a.json"
    assert main(["analyse", str(recording), "--plot", str(tmp_path / "a.png"), "--json", str(json_), "--discard", "2",
                 *window, *(["--rrd", str(rrd)])]) == 0
    summary, (start, end) = json.loads(json_.read_text()), (0.4, 2.95) if window else (0.0, 2.999)
    table = table_of([row for row in kept if start <= 1e-9 * row[0] <= end])
    run = tcc_sim.read(recording).trajectory(0, *((0.4, 2.95) if window else ()))
    tcc_sim.plot(run, tmp_path / "b.png")
    table["state"] = run.state
    t = table["t"]
    gaps = [(t[k], t[k + 1]) for k in np.flatnonzero(np.diff(t) > 1.6e-3)]
    assert bool(gaps) == bool(LOST[lost])
    whole = {"max_slip_speed": np.abs(table["slip_speed"]).max() * 1.02, "min_slip_speed": -1.0}
    for drawn, extremes in zip(pictures, (whole, whole)):
        over_time(drawn, t, table, extremes, 1e-9)
        shown = panels(drawn)
        for name in ("engine", "friction"):
            x, y = curves(shown["Torques"])[name]
            assert all(broken((x, y), *gap) for gap in gaps if x[0] < gap[0] and gap[1] < x[-1])
        for begin, end in shaded(shown["Slip speed"]):
            assert not any(begin < gap[1] - 1e-9 and gap[0] + 1e-9 < end for gap in gaps)
    kept_maxima = [y for axis in (panels(pictures[0])["Maxima"],) for name, (_, y) in curves(axis).items()
                   if name.startswith("kept")]
    assert max(map(np.nanmax, kept_maxima)) == pytest.approx(summary["max_slip_speed"], rel=1e-9)
    shown = shown_in_rerun(rrd)
    for entity, column in (("/slip/speed", "slip_speed"), ("/torque/engine", "engine_torque"),
                           ("/torque/friction", "friction_torque"), ("/plate/angle", "plate_angle"),
                           ("/plate_speed/speed", "plate_speed")):
        line = rerun_line(shown[entity])
        assert passes(line, t, table[column]) == len(t)
        assert all(broken(line, *gap) for gap in gaps)
    changes = [(at, values[0]) for at, values in shown["/state"] if np.isfinite(at)]
    for begin, end in gaps:
        assert [name or "" for at, name in changes if at <= 0.5 * (begin + end)][-1] == ""
    at, largest = rerun_line(shown["/cycles/largest"])
    assert np.nanmax(largest[at > summary["covers"][0]]) == pytest.approx(summary["max_slip_speed"], rel=1e-6)
    for _, strips in shown["/phase/orbit"]:
        assert all(np.isfinite(np.array(strip, float)).all() for strip in strips or [] if len(np.shape(strip)) == 2)


def test_a_state_that_is_no_number_is_a_gap(rows: list[Any], pictures: list[Any], tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    unknown = [row if k not in range(2900, 2930) else (row[0], *[np.nan] * 6, row[-1]) for k, row in enumerate(rows)]
    recording = bag(tmp_path / "run", unknown, "fig02")
    assert main(["analyse", str(recording), "--plot", str(tmp_path / "a.png"), "--rrd", str(tmp_path / "a.rrd")]) == 0
    axis = panels(pictures[0])["Slip speed"]
    assert broken(curves(axis)["slip speed"], 2.8999, 2.9299)
    assert not any(begin < 2.9295 and end > 2.8995 for begin, end in shaded(axis))
    shown = shown_in_rerun(tmp_path / "a.rrd")
    assert broken(rerun_line(shown["/slip/speed"]), 2.8991, 2.9299)


def test_events_and_held_signals_stand_at_their_times(laid_out: list[Any], tmp_path: Path) -> None:
    """A change at 1.2 s in a recording with losses; a target and a pressure that last changed early."""
    pytest.importorskip("rerun")
    scene, said = tcc_sim.load_scene("commands").with_values({"command_timeout": 0.0}), []
    rows = ticked(scene, 2000, pressure=lambda k: 2e5 if k < 300 else 2.5e5, said=said,
                  changes=[(1200, {"friction.kinetic_coefficient": 0.25}, False)])
    row = next(k for k, _ in said)
    kept = [each for k, each in enumerate(rows) if not 600 <= k < 660]
    recording = bag(tmp_path / "run", kept, scene, said=[(row - 60, text) for _, text in said], targets=[(100, 20.0)])
    words = ["analyse", str(recording), "--frequency", "150", "--rrd", str(tmp_path / "a.rrd")]
    assert main([*words, "--plot", str(tmp_path / "a.png")]) == 0
    shown, end = panels(laid_out[0]), 1.999
    means = shown["Cycle mean of the slip speed"]
    assert curves(means)["target"][0][-1] == pytest.approx(end)
    t, applied = curves(shown["Actuation pressure"])["applied"]
    assert (t[-1], applied[-1]) == pytest.approx((end, 250.0))
    marks = [line.get_xdata()[0] for line in means.lines if len(set(line.get_xdata())) == 1]
    assert any(abs(at - 1.2) < 3e-3 for at in marks)
    assert broken(curves(means)["cycle mean"], 0.6, 0.665)
    in_rerun = shown_in_rerun(tmp_path / "a.rrd")
    for entity in ("/control/target", "/pressure/applied"):
        assert rerun_line(in_rerun[entity])[0][-1] == pytest.approx(end)
    marked, = [at for at, _ in in_rerun["/event/mark"] if np.isfinite(at)]
    assert marked == pytest.approx(1.2, abs=3e-3)
    check(laid_out[0])


CHANGES = {"friction.static_coefficient": 0.4, "friction.kinetic_coefficient": 0.2, "converter.coupling": 3.0,
           "pressure.mean": 1.6e5, "pressure.amplitude": 6e4}
"""Keys that a running driveline changes, with new values."""


@pytest.mark.parametrize("of", ["friction converter", "pressure"])
def test_what_follows_from_keys_that_change_is_its_own_at_every_sample(of: str, pictures: list[Any],
                                                                       tmp_path: Path) -> None:
    """In a closed loop, a recording, the file of its samples and their pictures."""
    changes, commanded = {key: to for key, to in CHANGES.items() if key.split(".")[0] in of}, of != "pressure"
    scene = tcc_sim.load_scene("controlled").with_values({
        "converter.coupling": 0.5, "pressure.source": "topic" if commanded else "harmonic", "pressure.amplitude": 4e4})
    said: list[Any] = []
    rows = ticked(scene, 2001, pressure=(lambda k: 1.1e5 + 20.0 * k) if commanded else None, said=said,
                  changes=[(1950, changes, False)])
    recording = bag(tmp_path / "run", rows, scene, said=said)
    assert main(["analyse", str(recording), "--out", str(tmp_path / "a.npz"), "--plot", str(tmp_path / "a.png")]) == 0
    read = tcc_sim.read(recording).trajectory()
    looped = tcc_sim.closed_loop(scene, lambda r: 1.1e5 + 2e-5 * r.stamp_ns if commanded else None, 2.0,
                                 at={1.949: changes})
    for run, name in ((read, "b.png"), (looped, "c.png"), (tmp_path / "a.npz", "d.png")):
        tcc_sim.plot(run, tmp_path / name)
    arrays = samples_of(tmp_path / "a.npz")
    for t, load, coupling, slip in (
            (read.t, read.saturation_torque, read.coupling_torque, read.slip_speed),
            (looped.t, looped.saturation_torque, looped.coupling_torque, looped.slip_speed),
            (arrays["t"], arrays["saturation_torque"], arrays["coupling_torque"], arrays["slip_speed"])):
        held = {name: np.where(t > 1.9495, changes.get(name, scene.value(name)), scene.value(name)) for name in CHANGES}
        pressure = held["pressure.mean"] + held["pressure.amplitude"] * np.sin(150.0 * t)
        if commanded:
            pressure = looped.applied_pressure if t is looped.t else np.array(rows)[:, -1]
        area = scene.value("clutch.area") * scene.value("clutch.radius") * pressure
        np.testing.assert_allclose(load, held["friction.kinetic_coefficient"] * area, rtol=1e-9)
        np.testing.assert_allclose(coupling, held["converter.coupling"] * slip, rtol=1e-12)
        for drawn in pictures:
            lines = curves(panels(drawn)["Torques"])
            if (t is looped.t) == (drawn is pictures[2]):
                passes(lines[r"$\mu_k N R$"], t, load, 1e-9)
                passes(lines[r"$\mu_s N R$"], t, held["friction.static_coefficient"] * area, 1e-9)


def test_an_event_without_a_controller_is_marked_in_seconds(pictures: list[Any], tmp_path: Path) -> None:
    scene, said = tcc_sim.load_scene("fig02"), []
    rows = ticked(scene, 2000, said=said, changes=[(1200, {"friction.kinetic_coefficient": 0.25}, False)])
    for lost in (0, 60):
        kept = [each for k, each in enumerate(rows) if not 600 <= k < 600 + lost]
        recording = bag(tmp_path / f"{lost}", kept, scene, said=[(k - lost, text) for k, text in said])
        assert main(["analyse", str(recording), "--plot", str(tmp_path / f"{lost}.png")]) == 0
        axis = panels(pictures[-1])["Maxima"]
        scale = {"time (s)": 1.0, "period of excitation": scene.system.cycle}[axis.get_xlabel()]
        marks = [scale * line.get_xdata()[0] for line in axis.lines if len(set(line.get_xdata())) == 1]
        assert any(abs(at - 1.2) < 0.01 for at in marks)


@pytest.mark.parametrize(("order", "phase"), [(0.5, 0.0), (1.5, 0.4)])
def test_a_half_order_of_a_table_is_in_its_spectrum(order: float, phase: float, pictures: list[Any],
                                                    tmp_path: Path) -> None:
    """Also where it is 0 at the start of every cycle."""
    t = np.arange(0.0, 3.0, 5e-4)
    phi = 150.0 * t
    slip = 20.0 + 5.0 * np.sin(phi) + 2.0 * np.sin(order * phi + phase)
    np.savetxt(tmp_path / "a.csv", np.stack([t, 300.0 + 250.0 * np.sin(phi), slip], axis=1), delimiter=",",
               header="t,engine_torque,slip_speed", comments="")
    assert main(["analyse", str(tmp_path / "a.csv"), "--spectrum", "--scene", "fig02", "--plot",
                 str(tmp_path / "a.png")]) == 0
    lines = curves(panels(pictures[0])["Spectrum of the slip speed"])
    for name, expected in (("amplitude", {1.0: 5.0}), ("sub-harmonic", {order: 2.0})):
        at = dict(zip(*lines[name]))
        for place, height in expected.items():
            assert at[place] == pytest.approx(height, rel=0.01)


def test_a_bode_plot_shows_frequencies_in_hertz_beside_speeds_in_rpm(pictures: list[Any], tmp_path: Path) -> None:
    """A frequency that is not that of the excitation; see `--units`."""
    words = ["linearise", "slip", "--slip", "20", "--frequencies", "10:1000:20"]
    for units, label, factor in (("rad", "angular frequency (rad/s)", 1.0), ("rpm", "frequency (Hz)", 2.0 * np.pi)):
        assert main([*words, "--units", units, "--plot", str(tmp_path / f"{units}.png"), "--json",
                     str(tmp_path / f"{units}.json")]) == 0
        axis = pictures[-1].axes[-1]
        assert axis.get_xlabel() == label
        values = json.loads((tmp_path / f"{units}.json").read_text())
        np.testing.assert_allclose(axis.lines[0].get_ydata(), np.degrees(values["phase"]))
        ticks = np.array([at for at in axis.get_xticks() if 10.0 <= at <= 1000.0])
        texts = [axis.xaxis.get_major_formatter()(at, 0) for at in ticks]
        powers = [re.search(r"10\^\{(-?\d+)\}", text) for text in texts]
        numbers = [10.0 ** int(power[1]) if power else float(text) for power, text in zip(powers, texts)]
        assert numbers == pytest.approx(ticks / factor, rel=1e-2)


def test_a_trajectory_keeps_its_samples_in_every_unit(pictures: list[Any], tmp_path: Path) -> None:
    run = tcc_sim.solve("minimal", cycles=20, samples_per_cycle=400)
    for units, unit in (("rad", "rad/s"), ("rpm", "rpm"), ("hz", "Hz")):
        tcc_sim.plot(replace(run, cycles=None), tmp_path / f"{units}.png", units=units)
        axis = panels(pictures[-1])["Slip speed"]
        assert axis.get_ylabel().replace("\n", " ") == f"slip speed ({unit})"
        assert passes(curves(axis)["slip speed"], run.t, run.slip_speed) > 1200
        labelled(pictures[-1])
