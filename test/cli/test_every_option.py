"""Every option of every verb does something: results, words or pictures are others with it, or a line refuses it."""

import argparse
import json
import re
import shlex

import numpy as np
import pytest
from driveline_bags import bag, ticked

from tcc_sim.cli import VERBS, build_parser, main
from tcc_sim.scene import load_scene

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
from matplotlib.text import Text

from tcc_sim.views import style

ELSEWHERE = {"demo", "watch", "control", "recover", "import", "realtime", "claims", "precision", "stability", "figure",
             "scenes", "plot", "fmu"}
"""Verbs with nodes, with long runs or without a JSON; they have tests of their own."""
SAME = {"--jobs", "--dask", "--spawn", "--connect", "--force", "--cost"}
"""Options that change no result: how many processes work, where a viewer runs, what is overwritten, what is timed."""
FILES = {"--help", "--json", "--out", "--plot", "--rrd", "--layout"}
"""Options that write one more file."""
MU_K = "friction.kinetic_coefficient"
DRAWN = "--style my.mplstyle --width column --title Mine"
"""Options of every verb that need --plot."""
TABLED = ["--columns slip_speed=rounded", "--from 0.03", "--to 0.03"]
RECORDED = ["--topic /x", "--driveline 2", "--joints flywheel=a,clutch_plate=b"]
SOLVED = ["--solver fixed_step", "--rtol 1e-4", "--step 1e-4 | --solver rk4", "--damping", "--lyapunov",
          "--discard 3"]


def beside(options, words):
    """The options with further words that both runs have."""
    return [f"{option}{' ' if '|' in option else ' | '}{words}" for option in options]


OPTIONS = {
    "explain fig02": ["--set engine.frequency=120", "--units rpm"],
    "simulate fig02": [
        "--cycles 9", "--duration 0.4", "--inputs T.csv", "--scene fig02", "--pulses 2", "--orders | --duration 0.9",
        "--samples 9 | --out a.npz --cycles 3", *RECORDED, *beside(["--hold next", *TABLED], "--inputs T.csv"),
        *beside(["--set engine.frequency=120", "--profile engine.frequency=0:150,1:120", "--spectrum", *SOLVED,
                 "--units rpm"], "--cycles 8")],
    "sweep fig02 --cycles 6": [
        "--over engine.frequency=140:150:2", "--scatter pressure.mean=22e4:26e4 --samples 2",
        "--law law.py:PI --target 20 --over kp=1:2:2", "--target 20", "--limits 0:1e5",
        *beside(["--set pressure.mean=2e5", "--cycles 9", "--direction up", "--duration 0.3"],
                "--over engine.frequency=140:150:2"),
        *beside(["--orders 120", *SOLVED, "--units rpm"],
                "--over engine.frequency=140:150:1"),
        *beside(["--samples 3", "--seed 2", "--quantiles 0.3", "--every-sample"],
                "--scatter pressure.mean=22e4:26e4 --samples 2")],
    "linearise slip --frequencies 10:20:2": [
        "--set engine.mean_torque=290", "--slip 20", "--mean", "--input engine_torque", "--output shaft_torque",
        "--frequencies 10:30:2", "--controller 1e5,1e6", "--units rpm"],
    "analyse R": [
        "--scene slip", "--frequency 75", "--run 2", "--from 0.2", "--to 0.5", "--columns slip_speed=x", "--discard 9",
        "--target 8", "--band 30 | --target 8", "--limits 0:1e5 | --target 8", "--verify", "--damping", "--orders",
        "--spectrum", "--pulses 2",
        *RECORDED, "--units rpm"],
    f"identify T.csv --scene fig02 --free {MU_K}": [
        "--noise slip_speed=3", "--hold linear | --noise slip_speed=1", "--scene my.yaml",
        "--set driveline.damping=0.60001", f"--free {MU_K}=0.23", f"--likelihood {MU_K}",
        "--units rpm | --free initial.slip_speed", *TABLED, *RECORDED],
    f"continue fig02 --set pressure.amplitude=0 --over {MU_K}=0.235:0.25": [
        "--set driveline.damping=0.5", f"--over {MU_K}=0.24:0.25", "--period 1", "--seeds my.json", "--at 0.24",
        "--second pressure.mean=24e4:26e4", "--units rpm | --at 0.24",
        f"--switch | --set pressure.mean=225e3 --set engine.frequency=139.4274 --over {MU_K}=0.2316:0.2352 --period 1"],
    "basins fig02 --set pressure.amplitude=0 --set driveline.damping=20 --plane initial.slip_speed=0:300:2 "
    "--plane initial.plate_angle=0:0.2:2": [
        "--set driveline.damping=21", "--plane initial.plate_speed=0:1:2", f"--over {MU_K}=0.23:0.24:2", "--cycles 9",
        "--boundary", "--units rpm"]}


def options_of(verb):
    """The long names of all options of a verb."""
    groups = next(a for a in build_parser(verb)._actions if isinstance(a, argparse._SubParsersAction))
    return {action.option_strings[-1] for action in groups.choices[verb]._actions if action.option_strings}


def without_times(values):
    """A JSON without what differs from run to run."""
    if isinstance(values, dict):
        return {key: without_times(each) for key, each in values.items()
                if key not in ("command", "environment", "elapsed_s", "seconds")}
    return [without_times(each) for each in values] if isinstance(values, list) else values


SEEN = {}
"""Results, words and pictures that each line gave."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a recording, a table, a scene and a style."""
    made = tmp_path_factory.mktemp("options")
    (made / "my.mplstyle").write_text("xtick.labelsize: 11.25\n")
    (made / "my.yaml").write_text(load_scene("fig02").with_values({"engine.mean_torque": 300.01}).text())
    rows = ticked(load_scene("fig02"), 300)
    bag(made / "R", rows, "fig02")
    t, _, _, flywheel, plate, torque, *_ = np.array(rows[:60]).T
    slip = flywheel - plate
    np.savetxt(made / "T.csv", np.column_stack([1e-9 * t, slip, torque, slip.round(3)]), delimiter=",",
               header="t,slip_speed,engine_torque,rounded", comments="")
    return made


@pytest.fixture
def seen(folder, monkeypatch, capsys, pictures):
    """Function that runs a line in the folder and returns what a user sees of it: words, results, arrays, picture."""
    monkeypatch.chdir(folder)

    def run(line):
        if line not in SEEN:
            for path in folder.glob("a.*"):
                path.unlink()
            status = main([*shlex.split(line), "--json", "a.json"])
            out, err = capsys.readouterr()
            files = {path.suffix: path.read_bytes() for path in folder.glob("a.*")}
            arrays = dict(np.load("a.npz")) if ".npz" in files else {}
            looks = [(*drawn.get_size_inches(), *((text.get_text(), text.get_size()) for text in drawn.findobj(Text)))
                     for drawn in pictures]  # Sizes and words.
            SEEN[line] = (status, err.count("\n"), re.sub(r"[\d.e-]+ s\b", "", out),
                          without_times(json.loads(files.get(".json", "{}"))),
                          {name: array.shape for name, array in arrays.items()}, looks)
            pictures.clear()
        return SEEN[line]

    return run


def test_every_option_has_a_row():
    assert set(VERBS) == ELSEWHERE | {base.split()[0] for base in OPTIONS}
    for base, rows in OPTIONS.items():
        given = options_of(base.split()[0])
        assert {row.split()[0] for row in rows} == given - FILES - SAME - set(DRAWN.split())


@pytest.mark.parametrize(("base", "row"), [(base, row) for base, rows in OPTIONS.items() for row in rows],
                         ids=lambda text: " ".join(text.split()[:2]))
def test_an_option_changes_something_or_is_refused(base, row, seen):
    option, _, both = row.partition(" | ")
    without = seen(f"{base} {both}")
    found = seen(f"{base} {both} {option}")
    if found[0] == 2:
        assert found[1:3] == (1, "")
    else:
        assert without[0] == 0 or base.startswith("sweep")  # Without a range or a scatter a sweep is refused.
        assert found[0] in (0, 1)
        assert found != without


@pytest.mark.parametrize("base", OPTIONS)
def test_a_picture_has_the_given_style_width_and_title(base, seen):
    words = {"sweep": "--over engine.frequency=140:150:2", "simulate": "--cycles 8"}.get(base.split()[0], "")
    *_, drawn = seen(f"{base} {words} --plot a.png {DRAWN}")
    for width, _, *texts in drawn:
        assert width == style.width_of("column") < style.width_of("page")
        assert "Mine" in {text for text, _ in texts}
        assert 11.25 in {size for _, size in texts}
    assert drawn


@pytest.mark.parametrize("base", OPTIONS)
def test_a_verb_is_the_same_twice(base, seen):
    """Otherwise the test above would not notice an option without effect."""
    assert seen(f"{base}  ") == seen(f"{base} ")
