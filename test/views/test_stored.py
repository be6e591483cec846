"""A result that is read back from its JSON or NPZ is drawn as it was: every artist has the same numbers."""

from __future__ import annotations

import json
import math
import random
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from driveline_bags import bag, ticked

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.output.provenance import head_of
from tcc_sim.scene import load_scene

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from tcc_sim.views import stored, style

FALLING = ["--set", "pressure.amplitude=0"]


def artists(drawn: Any) -> list[Any]:
    """Titles, labels and numbers of every line, collection and text of a figure."""
    values: list[Any] = [text.get_text() for text in drawn.texts]
    for axis in drawn.axes:
        values += [axis.get_title(loc="left"), axis.get_xlabel(), axis.get_ylabel(), axis.get_xlim(), axis.get_ylim()]
        values += [(line.get_label(), line.get_xydata()) for line in axis.lines]
        values += [(c.get_array(), c.get_offsets(), [p.vertices for p in c.get_paths()]) for c in axis.collections]
        values += [patch.get_path().vertices for patch in axis.patches]
    return values


def same(one: Any, other: Any) -> None:
    """Fail where two pictures' artists differ."""
    np.testing.assert_equal(artists(other), artists(one))


@pytest.mark.parametrize(("words", "npz"), [
    (["simulate", "fig02", "--cycles", "20"], False),
    (["simulate", "fig02", "--duration", "0.9", "--orders"], False),
    (["simulate", "fig02", "--cycles", "30", "--discard", "10", "--spectrum", "--units", "rpm"], True),
    (["sweep", "fig02", "--over", "engine.frequency=100:140:3", "--cycles", "10"], False),
    (["sweep", "fig02", "--over", "engine.frequency=100:140:3", "--over", "friction.kinetic_coefficient=0.2,0.28",
      "--cycles", "8"], False),
    (["sweep", "fig02", "--scatter", "pressure.mean=22e4:26e4", "--samples", "4", "--cycles", "8"], False),
    (["sweep", "fig02", "--scatter", "pressure.mean=22e4:26e4", "--samples", "2", "--cycles", "8", "--over",
      "engine.frequency=100:140:2"], False),
    (["continue", "fig02", *FALLING, "--over", "friction.kinetic_coefficient=0.23:0.25"], False),
    (["basins", "fig02", *FALLING, "--plane", "initial.slip_speed=0:300:3", "--plane", "initial.plate_angle=0:0.2:2"],
     True),
    (["linearise", "slip", "--slip", "20"], True), (["explain", "fig02"], False)])
def test_a_result_redrawn_equals_its_picture(words, npz, figures, tmp_path, capsys):
    json_, out = tmp_path / "a.json", tmp_path / "a.npz"
    assert main([*words, "--json", str(json_), "--plot", str(tmp_path / "a.png"), *(["--out", str(out)] if npz else [])
                 ]) == 0
    for k, file in enumerate([json_, *([out] if npz else [])]):
        assert main(["plot", str(file), "--plot", str(tmp_path / f"{k}.png")]) == 0
        same(figures[0], figures[-1])
        assert "picture in" in capsys.readouterr().out


def test_a_recordings_json_names_it(figures: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is read again while it is there; afterwards the samples of a .npz serve."""
    recording = bag(tmp_path / "run", ticked(load_scene("fig02"), 900), "fig02")
    words = ["analyse", str(recording), "--discard", "5", "--spectrum", "--plot", str(tmp_path / "a.png"), "--json",
             str(tmp_path / "a.json"), "--out", str(tmp_path / "a.npz")]
    assert main(words) == 0
    alone = tmp_path / "alone" / "a.json"
    alone.parent.mkdir()
    (tmp_path / "a.json").rename(alone)
    (tmp_path / "a.npz").rename(tmp_path / "c.npz")
    capsys.readouterr()
    assert main(["plot", str(alone), "--plot", str(tmp_path / "b.png")]) == 0
    same(figures[0], figures[1])
    recording.rename(tmp_path / "elsewhere")
    assert main(["plot", str(tmp_path / "c.npz"), "--plot", str(tmp_path / "c.png")]) == 0
    assert len(figures) == 3


def test_a_spectrum_of_a_table_is_drawn_from_its_json(figures: list[Any], tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.2, 2401)
    columns = t, 300.0 + 250.0 * np.sin(150.0 * t), 10.0 + np.sin(150.0 * t)
    np.savetxt(tmp_path / "a.csv", np.stack(columns, axis=1), delimiter=",", header="t,engine_torque,slip_speed",
               comments="")
    words = ["analyse", str(tmp_path / "a.csv"), "--spectrum", "--json", str(tmp_path / "a.json")]
    assert main([*words, "--plot", str(tmp_path / "a.png")]) == 0
    (tmp_path / "a.csv").unlink()
    assert main(["plot", str(tmp_path / "a.json"), "--plot", str(tmp_path / "b.png")]) == 0
    same(figures[0], figures[1])


def test_a_json_without_cells_draws_the_attractors_and_says_so(figures, tmp_path, capsys):
    words = ["basins", "fig02", *FALLING, "--plane", "initial.slip_speed=0:300:3", "--plane",
             "initial.plate_angle=0:0.2:2", "--json", str(tmp_path / "a.json")]
    assert main(words) == 0
    assert main(["plot", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.png"), "--title", "T", "--width",
                 "column"]) == 0
    assert "a.json has no cells" in capsys.readouterr().out
    assert len(figures) == 1


@pytest.mark.parametrize(("content", "says"), [
    ("{}", "no result of a command"), ('{"format": "tcc_sim soak 1"}', "no picture of a JSON of soak"),
    ("[1]", "no JSON object"), ("{", "is not a JSON file")])
def test_what_has_no_picture_is_refused_in_a_line(content, says, tmp_path, refused):
    (tmp_path / "a.json").write_text(content)
    assert says in refused("plot", "a.json", "--plot", "a.pdf")
    np.savez(tmp_path / "a.npz", x=np.ones(2))
    with pytest.raises(InputError, match="does not say which command wrote it"):
        stored.read_stored(tmp_path / "a.npz")
    with pytest.raises(InputError, match="must end in"):
        stored.read_stored(tmp_path / "a.txt")


@pytest.mark.parametrize(("kind", "words"), [
    ("claims", ["claims"]), ("realtime", ["realtime"]),
    ("sweep_points", ["sweep", "slip", "--over", "engine.frequency=100,200"]),
    ("basin_rows", ["basins", "slip", "--plane", "initial.slip_speed=0:1:2", "--plane", "initial.plate_angle=0:1:2"])])
def test_a_kind_without_a_picture_is_refused_by_its_name(kind, words, tmp_path, refused):
    """Every other kind is drawn in a test of its own."""
    (tmp_path / "a.json").write_text(json.dumps(head_of(kind, load_scene("slip"), words)))
    assert f"there is no picture of a JSON of {kind}" in refused("plot", "a.json", "--plot", "a.pdf")


def test_a_picture_is_a_pdf_by_default_and_never_overwritten(figures, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["explain", "minimal", "--json", "a.json"]) == 0
    assert main(["plot", "a.json"]) == 0
    (tmp_path / "a.pdf").write_text("mine")
    assert main(["plot", "a.json", "--width", "column"]) == 2
    assert "not overwritten" in capsys.readouterr().err
    assert (tmp_path / "a.pdf").read_text() == "mine"
    assert main(["plot", "a.json", "--width", "column", "--force"]) == 0
    assert [drawn.get_figwidth() for drawn in figures] == [style.PAGE, style.COLUMN]


def test_a_recorded_command_is_read_as_its_parser_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Options before the scene, and abbreviated ones."""
    words = ["simulate", "--cycl", "60", "--set", "engine.frequency=130", "fig02", "--disc", "20", "--js",
             str(tmp_path / "a.json"), f"--ou={tmp_path / 'a.npz'}"]
    assert main(words) == 0
    values = stored.read_stored(tmp_path / "a.json")
    assert stored.title_of(values) == "fig02"
    assert "slip_speed" in values["arrays"]
    assert stored.missing_data(values) == ""
    assert stored.title_of({"command": ["sweep", "fig02", "--ov", "engine.frequency=1,2", "--ti=T"]}) == "T"
    capsys.readouterr()
    with pytest.raises(InputError, match=r"command is none of this version: .*--former"):
        stored.title_of({"command": ["simulate", "fig02", "--former"]})
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("more", [[], ["--orders"]])
def test_a_run_driven_by_a_table_is_drawn_again_while_the_table_exists(more, figures, tmp_path):
    """Beside the measured slip speed; with --orders, the maps of both and their difference."""
    t = np.linspace(0.0, 1.2, 2401)
    table, json_ = tmp_path / "run.csv", tmp_path / "a.json"
    columns = t, 300.0 + 250.0 * np.sin(150.0 * t), 10.0 + np.sin(150.0 * t), np.full(len(t), 150.0)
    np.savetxt(table, np.stack(columns, axis=1),
               delimiter=",", header="t,engine_torque,slip_speed,engine_speed", comments="")
    words = ["simulate", "fig02", "--inputs", str(table), "--hold", "linear", *more, "--json", str(json_)]
    assert main([*words, "--plot", str(tmp_path / "a.png")]) == 0
    assert main(["plot", str(json_), "--plot", str(tmp_path / "b.png")]) == 0
    same(figures[0], figures[1])
    table.unlink()
    if not more:
        with pytest.raises(InputError, match=r"run.csv, which has the inputs, does not exist; .* --out FILE.npz"):
            tcc_sim.plot(json_, tmp_path / "c.png")


def test_a_result_is_drawn_in_the_units_of_its_command_or_in_others(figures, tmp_path):
    words = ["sweep", "slip", "--over", "engine.frequency=100,200", "--set", "engine.order=2", "--cycles", "20"]
    assert main([*words, "--units", "rpm", "--json", str(tmp_path / "a.json")]) == 0
    for more in ([], ["--units", "hz"]):
        assert main(["plot", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.png"), "--force", *more]) == 0
    tcc_sim.plot(tcc_sim.sweep("slip", "engine.frequency", [100.0, 200.0], cycles=20), tmp_path / "b.png", units="rpm")
    labels = [{text for text in artists(drawn) if isinstance(text, str)} for drawn in figures]
    assert [{"engine speed (rpm)", "max |slip speed|\n(rpm)"} <= each for each in labels] == [True, False, True]
    assert r"excitation frequency $\omega/2\pi$ (Hz)" in labels[1]
    with pytest.raises(InputError, match="units is 'bpm'; it must be rad, rpm, hz"):
        tcc_sim.plot("a.json", tmp_path / "c.png", units="bpm")


def test_a_json_of_identify_draws_its_parameters(figures: list[Any], tmp_path: Path) -> None:
    parameter = {"key": "driveline.stiffness", "start": 3000.0, "value": 3030.0, "high": 3060.0}
    values = {"parameters": [parameter], "chi2_per_dof": 1.0, "accepted": True}
    tcc_sim.plot(values, tmp_path / "a.png")
    assert any(isinstance(item, tuple) and np.array_equal(item[1], [[1.0, 0.0]]) for item in artists(figures[0]))


def test_a_fit_is_made_again_where_its_measurements_are_and_refused_where_they_differ(monkeypatch, tmp_path):
    (tmp_path / "a.csv").write_text("t\n")
    document = {"format": "tcc_sim identify 1", "command": ["identify", str(tmp_path / "a.csv"), "--free", "k"],
                "parameters": [{"value": 100.0, "standard_error": 10.0}, {"value": -8.0, "standard_error": None}]}
    for first, second, why in ((100.0099, -8.0079, ""), (99.9901, -7.9921, ""),
                               (100.011, -8.0, "k is 100.011 in the fit and 100 in the JSON"),
                               (100.0, -8.0081, "k is -8.0081 in the fit and -8 in the JSON")):
        fit = SimpleNamespace(parameters=[SimpleNamespace(key="k", value=value) for value in (first, second)])
        monkeypatch.setattr("tcc_sim.cli.identify.fit_again", lambda arguments, fit=fit: fit)
        if not why:
            assert stored.revived(document) is fit
            continue
        with pytest.raises(InputError, match=rf"^{tmp_path / 'a.csv'} has changed: {why}$"):
            stored.revived(document)
    (tmp_path / "a.csv").unlink()
    assert stored.revived(document)["parameters"] == document["parameters"]
    for words, why in (("demo", "no list of words"), ([1], "no list of words"), (["demo"], "DIR/analysis.json")):
        with pytest.raises(InputError, match=why):
            stored.arguments_in({"command": words})
    (tmp_path / "analysis.json").write_text(json.dumps({"command": ["demo"], "format": "tcc_sim analyse 1"}))
    assert stored.read_stored(tmp_path / "analysis.json")["command"] == ["analyse", str(tmp_path / "recording")]


def mutants(text: str, count: int) -> Iterator[str]:
    """JSON texts with a key or value left out, replaced, shortened or repeated."""
    draw = random.Random(5)
    for _ in range(count):
        whole = json.loads(text)
        place, key = whole, draw.choice([name for name in whole if name not in ("environment", "units", "version")])
        while isinstance(place[key], dict | list) and place[key] and draw.random() < 0.6:
            place = place[key]
            key = draw.choice(list(place)) if isinstance(place, dict) else draw.randrange(len(place))
        match draw.randrange(5):
            case 0:
                del place[key]
            case 1 | 2:
                place[key] = draw.choice(["x", [], {}, [1, 2], -1, 1e308, True, [[1]], {"a": 1}, None, math.nan])
            case 3 if isinstance(place[key], list):
                place[key] = place[key][:-1]
            case _ if isinstance(place[key], list):
                place[key] = place[key] * 2
        yield json.dumps(whole)


def sweep_json(folder: Path) -> str:
    """The JSON of a small sweep."""
    assert main(["sweep", "slip", "--over", "engine.frequency=100,120", "--cycles", "4", "--json",
                 str(folder / "sweep.json")]) == 0
    return (folder / "sweep.json").read_text()


def test_a_damaged_json_is_drawn_or_refused_in_a_line(figures, tmp_path, capsys):
    statuses = []
    for text in mutants(sweep_json(tmp_path), 12):
        (tmp_path / "a.json").write_text(text)
        statuses.append(main(["plot", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.png"), "--force"]))
        assert len(capsys.readouterr().err.splitlines()) == (statuses[-1] > 0)
    assert set(statuses) == {0, 2}


@pytest.mark.parametrize("shorter", ["max_slip_speed", "values", "breakaways"])
def test_lists_of_unequal_length_are_refused(tmp_path, shorter):
    values = json.loads(sweep_json(tmp_path))
    values[shorter] = values[shorter][:1]
    with pytest.raises(InputError, match=r"has [12] values; [12] are expected"):
        tcc_sim.plot(values, tmp_path / "a.png")


def samples(folder: Path, **changes: Any) -> Path:
    """A .npz of `simulate`, with arrays replaced."""
    assert main(["simulate", "slip", "--cycles", "4", "--out", str(folder / "a.npz"), "--force"]) == 0
    with np.load(folder / "a.npz") as file:
        arrays = {name: file[name] for name in file.files} | changes
    np.savez_compressed(folder / "a.npz", **arrays)
    return folder / "a.npz"


def test_damaged_arrays_are_refused_in_a_line(tmp_path):
    data, draw, outcomes = samples(tmp_path).read_bytes(), random.Random(6), []
    for _ in range(80):
        changed, place = bytearray(data), draw.randrange(len(data))
        size = draw.choice([1, 8, 60])
        changed[place:place + size] = draw.choice([b"", bytes(size), draw.randbytes(size)])
        (tmp_path / "b.npz").write_bytes(changed)
        try:
            outcomes.append(len(stored.read_stored(tmp_path / "b.npz")["arrays"]))
        except InputError as error:
            outcomes.append(0 if str(error).isprintable() else -1)
    assert set(outcomes) <= {0, len(stored.read_stored(tmp_path / "a.npz")["arrays"])}
    assert outcomes.count(0) > 40


@pytest.mark.parametrize(("changes", "says"), [
    ({"slip_speed": np.zeros(5)}, "has 5 values"), ({"slip_speed": np.zeros((5, 2))}, "has 2 dimensions"),
    ({"cycle_lowest": np.zeros(2)}, "cycle_lowest has 2 values"), ({"section_states": np.zeros((9, 2))}, "the shape"),
    ({"document": np.array("[1]")}, "the JSON of the command that wrote it is damaged"),
    ({"document": np.array(1)}, "does not say which command wrote it")])
def test_arrays_that_do_not_belong_together_are_refused(tmp_path, changes, says):
    with pytest.raises(InputError, match=says):
        stored.read_stored(samples(tmp_path, **changes))


def test_an_array_that_no_picture_uses_is_not_read(tmp_path):
    """2 kB that would take 80 MB; as an array that is used it is refused by its declared size."""
    path = samples(tmp_path, other=np.zeros(10_000_000))
    tracemalloc.start()
    stored.read_stored(path)
    assert tracemalloc.get_traced_memory()[1] < 4 << 20
    tracemalloc.stop()
    with pytest.raises(InputError, match=r"array cycle_highest would take 80000000 bytes; at most \d+ are accepted"):
        stored.read_stored(samples(tmp_path, cycle_highest=np.zeros(10_000_000)))
    with pytest.raises(InputError, match="neither numbers nor text"):
        stored.read_stored(samples(tmp_path, t=np.array([{}], dtype=object)))


def test_a_json_of_any_size_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr("tcc_sim.output.files.LARGEST_JSON", 10)
    (tmp_path / "a.json").write_text('{"format": "x"}')
    with pytest.raises(InputError, match="has 15 bytes; a JSON file of results has at most 10"):
        stored.read_stored(tmp_path / "a.json")
