"""`tcc-sim plot` draws what a file of a command holds, or refuses it by a line; formats, units and names of files."""

from __future__ import annotations

import json
import math
import random
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driveline_bags import bag, ticked
from pictures import curves, panels

import tcc_sim
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.output.provenance import head_of
from tcc_sim.scene import load_scene

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
Refused = Callable[..., str]
FALLING = ["--set", "pressure.amplitude=0"]
KEY = "engine.frequency=100:140:3"


def same(one: Any, other: Any) -> None:
    """Check that two pictures have the same curves, cells, labels and limits."""
    for first, second in zip(one.axes, other.axes, strict=True):
        assert first.get_title(loc="left") == second.get_title(loc="left")
        assert (first.get_xlabel(), first.get_ylabel()) == (second.get_xlabel(), second.get_ylabel())
        np.testing.assert_equal(curves(second), curves(first))
        for area, other_area in zip(first.collections, second.collections, strict=True):
            np.testing.assert_equal(other_area.get_array(), area.get_array())


@pytest.mark.parametrize(("words", "files"), [
    (["simulate", "fig02", "--duration", "0.9", "--orders"], ["json"]),
    (["simulate", "fig02", "--cycles", "30", "--discard", "10", "--spectrum", "--units", "rpm"], ["npz"]),
    (["simulate", "apply"], ["npz"]), (["sweep", "fig02", "--over", KEY, "--cycles", "10"], ["json"]),
    (["sweep", "fig02", "--over", KEY, "--over", "friction.kinetic_coefficient=0.2,0.28", "--cycles", "8"], ["json"]),
    (["sweep", "fig02", "--scatter", "pressure.mean=22e4:26e4", "--samples", "4", "--cycles", "8"], ["json"]),
    (["continue", "fig02", *FALLING, "--over", "friction.kinetic_coefficient=0.23:0.25"], ["json"]),
    (["basins", "fig02", *FALLING, "--plane", "initial.slip_speed=0:300:3", "--plane", "initial.plate_angle=0:0.2:2"],
     ["npz"]), (["linearise", "slip", "--slip", "20", "--frequencies", "10:1000:20"], ["json", "npz"]),
    (["explain", "fig02"], ["json"])])
def test_a_file_is_drawn_as_the_command_drew(words: list[str], files: list[str], pictures: list[Any], tmp_path: Path
                                             ) -> None:
    options = {"json": "--json", "npz": "--out"}
    written = [word for suffix in files for word in (options[suffix], str(tmp_path / f"a.{suffix}"))]
    assert main([*words, *written, "--plot", str(tmp_path / "a.png")]) == 0
    for suffix in files:
        assert main(["plot", str(tmp_path / f"a.{suffix}"), "--plot", str(tmp_path / f"{suffix}.png")]) == 0
        same(pictures[0], pictures[-1])


def test_samples_of_a_recording_are_drawn_with_its_gaps_and_the_keys_that_held(pictures: list[Any], tmp_path: Path
                                                                               ) -> None:
    """The longest run is the second one, and begins with the key that the first one ended with."""
    said: list[Any] = []
    changes = [(tick, {"friction.static_coefficient": value}, None) for tick, value in ((200, 0.5), (1350, 0.45))]
    rows = ticked(load_scene("fig02"), 1500, resets=(400,), changes=changes, said=said)
    bag(tmp_path / "run", [row for k, row in enumerate(rows) if not 1460 <= k < 1470], "fig02", said=said)
    assert main(["analyse", str(tmp_path / "run"), "--discard", "5", "--out", str(tmp_path / "a.npz"), "--plot",
                 str(tmp_path / "a.png")]) == 0
    assert main(["plot", str(tmp_path / "a.npz"), "--plot", str(tmp_path / "b.png")]) == 0
    one, two = ({**curves(panels(drawn)["Slip speed"]), **curves(panels(drawn)["Torques"])} for drawn in pictures)
    assert one.keys() == two.keys()
    for name, curve in two.items():
        np.testing.assert_allclose(curve, one[name], rtol=1e-6, atol=1e-9)
    assert np.isnan(two["slip speed"][1]).any()
    static, kinetic = (two[f"$\\mu_{which} N R$"][1] for which in "sk")
    assert len(np.unique(np.round((static / kinetic)[np.isfinite(static)], 9))) == 2


def test_a_spectrum_of_a_table_is_drawn_from_its_json(pictures: list[Any], tmp_path: Path) -> None:
    t = np.linspace(0.0, 0.6, 601)
    columns = t, 300.0 + 250.0 * np.sin(150.0 * t), 10.0 + np.sin(150.0 * t)
    np.savetxt(tmp_path / "a.csv", np.stack(columns, axis=1), delimiter=",", header="t,engine_torque,slip_speed",
               comments="")
    words = ["analyse", str(tmp_path / "a.csv"), "--spectrum", "--json", str(tmp_path / "a.json")]
    assert main([*words, "--plot", str(tmp_path / "a.png")]) == 0
    (tmp_path / "a.csv").unlink()
    assert main(["plot", str(tmp_path / "a.json"), "--plot", str(tmp_path / "b.png")]) == 0
    same(*pictures)


@pytest.mark.usefixtures("pictures")
def test_a_run_without_samples_is_refused_with_the_command_that_writes_them(tmp_path: Path, refused: Refused,
                                                                            capsys: pytest.CaptureFixture[str]) -> None:
    """The command works as it is printed."""
    bag(tmp_path / "run", ticked(load_scene("fig02"), 600), "fig02")
    for k, words in enumerate((["simulate", "fig02", "--cycles", "12"], ["analyse", "run"])):
        assert main([*words, "--json", f"{k}.json"]) == 0
        line = refused("plot", f"{k}.json", "--plot", "a.png")
        command = line[line.index("tcc-sim ", 8) + 8:].split()
        assert main(command) == 0
        capsys.readouterr()
        assert main(["plot", "FILE.npz", "--plot", f"{k}.png"]) == 0
        Path("FILE.npz").unlink()
    document = {**json.loads(Path("1.json").read_text()), "command": ["demo"]}
    Path("demo.json").write_text(json.dumps(document))
    assert "analyse DIR/recording --out FILE.npz" in refused("plot", "demo.json", "--plot", "b.png")


@pytest.mark.parametrize(("content", "part"), [
    ("{}", "a.json"), ('{"format": "tcc_sim soak 1"}', "soak"), ("[1]", "a.json"), ("{", "a.json"),
    ('{"format": "tcc_sim sweep 1", "command": "demo"}', "command"),
    ('{"format": "tcc_sim simulate 1", "command": ["simulate", "fig02", "--former"]}', "--former"),
    *((json.dumps(head_of(kind, load_scene("slip"), [kind])), kind) for kind in ("claims", "realtime"))])
def test_what_has_no_picture_is_refused_in_a_line(content: str, part: str, tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "a.json").write_text(content)
    assert part in refused("plot", "a.json", "--plot", "a.pdf")


@pytest.mark.parametrize("words", [
    ["simulate", "fig02", "--plot", "run.jpg"], ["sweep", "fig02", "--over", "engine.frequency=1:2:2", "--plot",
                                                 "no/run.png"], ["simulate", "fig02", "--plot", "here.png"],
    ["simulate", "fig02", "--plot", "x.svg", "--json", "x.svg"], ["plot", "a.txt"], ["plot", "x.npz"],
    ["plot", "none.json"]])
def test_what_cannot_be_a_picture_is_refused_before_anything_is_solved(words: list[str], tmp_path: Path,
                                                                       refused: Refused) -> None:
    (tmp_path / "here.png").write_text("mine")
    np.savez(tmp_path / "x.npz", x=np.ones(2))
    line = refused(*words)
    assert any(Path(word).name in line for word in words if "." in word)
    assert (tmp_path / "here.png").read_text() == "mine"


@pytest.mark.parametrize("words", [
    ["simulate", "fig02", "--plot", "run.png"], ["figure", "4", "--out", "figures"],
    ["precision", "--quick", "--out", "p"], ["sweep", "fig02", "--over", "engine.frequency=1:2:2", "--plot", "run.svg"],
    ["plot", "a.json"]])
def test_a_missing_library_is_named_before_anything_is_computed(words: list[str], tmp_path: Path,
                                                                monkeypatch: pytest.MonkeyPatch,
                                                                capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(words) == 1
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "pip install 'tcc_sim[view]'" in err
    assert list(tmp_path.iterdir()) == []


def test_a_picture_is_a_pdf_by_default_in_the_width_and_units_that_are_asked_for(
        pictures: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the command that wrote the file, or others."""
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", "slip", "--over", "engine.frequency=100,200", "--set", "engine.order=2", "--cycles", "20",
                 "--units", "rpm", "--title", "T", "--json", "a.json"]) == 0
    assert main(["plot", "a.json"]) == 0
    assert (tmp_path / "a.pdf").is_file()
    assert main(["plot", "a.json"]) == 2
    assert main(["plot", "a.json", "--width", "column", "--force", "--units", "hz", "--title", "U"]) == 0
    assert [drawn.get_figwidth() for drawn in pictures] == [7.2, 3.5]
    assert [drawn._suptitle.get_text() for drawn in pictures] == ["T", "U"]
    shown = []
    for drawn in pictures:
        axis = list(panels(drawn).values())[2]
        ticks = [float(axis.xaxis.get_major_formatter()(at)) / at for at in axis.get_xticks() if at > 0.0]
        shown.append((axis.get_xlabel(), "max" in drawn.axes[0].get_ylabel(), float(np.mean(ticks))))
    assert [label for label, *_ in shown] == ["engine speed (rpm)", r"excitation frequency $\omega/2\pi$ (Hz)"]
    assert [factor for *_, factor in shown] == pytest.approx([30.0 / math.pi / 2.0, 0.5 / math.pi], rel=1e-3)


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


def test_a_damaged_json_is_drawn_or_refused_in_a_line(pictures: list[Any], tmp_path: Path,
                                                      capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "slip", "--over", "engine.frequency=100,120", "--cycles", "4", "--json",
                 str(tmp_path / "sweep.json")]) == 0
    text, statuses = (tmp_path / "sweep.json").read_text(), []
    for damaged in mutants(text, 8):
        (tmp_path / "a.json").write_text(damaged)
        capsys.readouterr()
        statuses.append(main(["plot", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.png"), "--force"]))
        assert len(capsys.readouterr().err.splitlines()) == (statuses[-1] > 0)
    assert set(statuses) == {0, 2}
    for shorter in ("max_slip_speed", "values", "regime", "section", "stick_fraction"):
        values = json.loads(text)
        values[shorter] = values[shorter][:1]
        with pytest.raises(InputError):
            tcc_sim.plot(values, tmp_path / "b.png")


def samples(folder: Path, **changes: Any) -> Path:
    """A .npz of `simulate`, with arrays replaced."""
    assert main(["simulate", "slip", "--cycles", "4", "--out", str(folder / "a.npz"), "--force"]) == 0
    with np.load(folder / "a.npz") as file:
        arrays = {name: file[name] for name in file.files} | changes
    np.savez_compressed(folder / "a.npz", **arrays)
    return folder / "a.npz"


def test_damaged_arrays_are_drawn_or_refused_in_a_line(tmp_path: Path, pictures: list[Any],
                                                            capsys: pytest.CaptureFixture[str]) -> None:
    data, draw, refusals = samples(tmp_path).read_bytes(), random.Random(6), 0
    capsys.readouterr()
    for _ in range(15):
        changed, place = bytearray(data), draw.randrange(len(data))
        size = draw.choice([1, 8, 60])
        changed[place:place + size] = draw.choice([b"", bytes(size), draw.randbytes(size)])
        (tmp_path / "b.npz").write_bytes(changed)
        status = main(["plot", str(tmp_path / "b.npz"), "--plot", str(tmp_path / "b.png"), "--force"])
        refusals += status == 2
        assert status in (0, 2)
        assert capsys.readouterr().err.count("\n") == (status > 0)
    assert refusals > 7


@pytest.mark.parametrize("changes", [
    {"slip_speed": np.zeros(5)}, {"slip_speed": np.zeros((5, 2))}, {"cycle_lowest": np.zeros(2)},
    {"section_states": np.zeros((9, 2))}, {"document": np.array("[1]")}, {"document": np.array(1)},
    {"cycle_highest": np.zeros(10_000_000)}, {"t": np.array([{}], dtype=object)}, {"t": np.linspace(0.0, 0.1, 9)}])
def test_arrays_that_do_not_belong_together_are_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        tcc_sim.plot(samples(tmp_path, **changes), tmp_path / "b.png")
    assert "a.npz" in str(caught.value)
    assert str(caught.value).isprintable()
