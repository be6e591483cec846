"""Kernels that an installation compiles ahead: those of the pages' commands, which the verbs themselves use."""

from __future__ import annotations

import dataclasses
import itertools
import re
import shlex
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tcc_sim.cli import main
from tcc_sim.cli.verbs import VERBS
from tcc_sim.compiling.compiled import Kernel
from tcc_sim.model.profile import Inputs
from tcc_sim.scene import bundled_scenes, load_scene, parse_assignments, parse_profiles, parse_scene
from tcc_sim.study.cli import ahead
from tcc_sim.study.cli.ahead import (
    find_sections,
    judge_section,
    make_ticks,
    make_windows,
    map_cycle,
    solve_cycle,
    solve_figures,
)

ROOT = Path(__file__).resolve().parents[3]
OF_VERB = {
    "simulate": [solve_cycle, judge_section], "sweep": [solve_cycle, judge_section],
    "continue": [solve_cycle, map_cycle],
    "basins": [solve_cycle, map_cycle, find_sections], "linearise": [solve_cycle, map_cycle, make_ticks],
    "demo": [make_ticks], "realtime": [make_ticks], "fmu": [make_ticks],
    "identify": [make_windows], "figure": [solve_figures]}
"""Uses that a verb makes of its scene."""
LONG = {"claims", "precision", "stability"}
"""Verbs that run for minutes, of which compiling is a small part."""
WITHOUT = {"scenes", "explain", "analyse", "recover", "watch", "control", "plot"}
"""Verbs without kernels, or with those of a recording's scene or of the judge, which are those of other commands."""
PAGES = (ROOT / "README.md", *sorted((ROOT / ".github" / "guide").glob("*.md")))
LINES = sorted({line for page in PAGES
                for line in re.findall(r"^    (?:\S*/)?tcc-sim (.*)$", page.read_text(), re.MULTILINE)}
               | {verb.example for verb in VERBS.values()})


@contextmanager
def called():
    """Names of the kernels that are called meanwhile."""
    names, entry = set(), Kernel.entry

    def noted(self, kind, arguments, words):
        names.add(self.file_name(kind))
        return entry(self, kind, arguments, words)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Kernel, "entry", noted)
        yield names


@pytest.fixture(scope="module")
def shipped():
    """Names of the kernels that are compiled ahead."""
    with called() as names:
        for use, scenes in ahead.USES:
            for name in scenes:
                use(ahead.named_scene(name))
    return names


def options(words, name):
    """Values of an option of a command."""
    return [value for word, value in itertools.pairwise(words) if word == name]


def file_of_page(name):
    """Scene in a file that the pages make: as they show it, or as `scenes --show` writes it."""
    for page in PAGES:
        shown = re.search(rf"`{name}`:\n\n```yaml\n(.*?)```", page.read_text(), re.S)
        if shown:
            scene = parse_scene(shown[1], name)
            with_harmonics = {"engine.harmonic_amplitudes": [0.0], "engine.harmonic_phases": [0.0]}
            return scene if "engine.harmonic_amplitudes" in shown[1] else scene.with_values(with_harmonics)
    for line in LINES:
        words, _, made = line.partition(" > ")
        if made == name:
            return scene_of(shlex.split(words))
    return load_scene({"mine.yaml": "controlled", "car.yaml": "minimal"}[name])


def scene_of(words):
    """Scene of a command: its file or name with what its options change, or the verb's own."""
    name = next((word for word in words[1:] if word in bundled_scenes() or word.endswith(".yaml")), None)
    if "friction.curve" in options(words, "--free"):
        return ahead.named_scene("curve")
    if name is None or words[0] == "identify":
        return load_scene({"demo": "commands", "realtime": "commands", "figure": "minimal", "identify": "controlled",
                           "simulate": "commands"}[words[0]])
    scene = file_of_page(name) if name.endswith(".yaml") else load_scene(name)
    scene = scene.with_values({**parse_assignments(options(words, "--set")),
                               **parse_profiles(options(words, "--profile"))})
    if not options(words, "--inputs"):
        return scene
    held = Inputs(np.array([[0.0, 300.0, 0.0]]), np.array([[0.0, 1e5, 0.0]]), 1.0)
    return dataclasses.replace(scene, system=dataclasses.replace(scene.system, inputs=held))


def test_every_command_on_the_pages_meets_kernels_that_are_compiled_ahead(shipped):
    """With the scene that its options and the files of its page make."""
    lacking, tried = [], 0
    for line in LINES:
        words = shlex.split(line.partition(" > ")[0], comments=True)
        assert words[0] in {*OF_VERB, *LONG, *WITHOUT}, f"{words[0]} has no row in OF_VERB"
        if words[0] in OF_VERB:
            tried += 1
            with called() as names:
                for use in OF_VERB[words[0]]:
                    use(scene_of(words))
            lacking += [f"tcc-sim {line}: {name}" for name in names - shipped]
    assert lacking == [], "ahead.USES or ahead.OTHER_SCENES lacks their scenes"
    assert tried > 60


@pytest.mark.parametrize("line", [
    "simulate fig02 --cycles 8 --discard 4", "simulate runup --orders --duration 1.6",
    "sweep fig02 --over engine.frequency=80,117",
    "sweep chaos --over friction.kinetic_coefficient=0.2,0.29 --lyapunov --cycles 30 --discard 20",
    "continue chaos --over friction.kinetic_coefficient=0.29:0.291",
    "continue chaos --over friction.kinetic_coefficient=0.29:0.291 --set friction.law=set_valued",
    "simulate minimal --profile engine.frequency=0:80,0.2:300",
    "basins chaos --set friction.kinetic_coefficient=0.29 --plane initial.slip_speed=-1:1:2 "
    "--plane initial.plate_angle=0:0.1:2",
    "linearise controlled --slip 20", "figure 2 --quick"])
def test_a_verb_calls_only_kernels_that_are_compiled_ahead(shipped, line, tmp_path, monkeypatch, pictures):
    monkeypatch.chdir(tmp_path)
    with called() as names:
        assert main(line.split()) == 0
    assert names
    assert names - shipped == set()


def test_what_cannot_be_compiled_ahead_is_reported_and_leaves_the_rest(monkeypatch, capsys):
    monkeypatch.setattr(ahead, "USES", ((make_ticks, ("no_such_scene", "fig02")), *ahead.USES[1:]))
    monkeypatch.setattr(ahead, "PARTS", (slice(0, 1),))
    ahead.make(0)
    out, err = capsys.readouterr()
    assert err.startswith("tcc_sim: not compiled ahead: make_ticks of no_such_scene: ")
    assert err.count("\n") == 1
    assert "fixed_step.tick-" in out


def test_the_parts_of_the_work_are_all_of_it():
    parts = [ahead.USES[part] for part in ahead.PARTS]
    assert [use for part in parts for use in part] == list(ahead.USES)
    assert all(parts)
    assert ahead.named_scene("fig02") == load_scene("fig02")
    assert ahead.named_scene("set_valued").system.friction.law == "set_valued"
    for name, (base, changes) in ahead.OTHER_SCENES.items():
        assert ahead.named_scene(name) == load_scene(base).with_values(changes)


def test_kernels_are_shipped_from_both_workers_and_from_the_package(tmp_path, monkeypatch):
    """A folder holds them and nothing else; a name without a file is left out."""
    shipped, folder, started = tmp_path / "shipped", tmp_path / "a" / "kernels", []
    shipped.mkdir()
    (shipped / "old").write_bytes(b"1")
    folder.mkdir(parents=True)
    (folder / "other").write_bytes(b"2")

    class Worker:
        def __init__(self, words, stdout, text, env):
            started.append(words[1:])
            assert (stdout, text) == (ahead.subprocess.PIPE, True)
            made = Path(env["NUMBA_CACHE_DIR"], "tcc_sim")
            made.mkdir(exist_ok=True)
            (made / f"new{words[-1]}").write_bytes(words[-1].encode())
            self.names = f"old new{words[-1]} nowhere"

        def communicate(self):
            return self.names, None

    monkeypatch.setattr(ahead.subprocess, "Popen", Worker)
    monkeypatch.setattr(ahead.kernel_cache, "SHIPPED", shipped)
    assert ahead.ship(folder) == 3
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {"old": b"1", "new0": b"0", "new1": b"1"}
    assert started == [["-m", "tcc_sim.study.cli.ahead", "part", "0"], ["-m", "tcc_sim.study.cli.ahead", "part", "1"]]


def test_the_module_ships_into_a_folder_or_makes_a_part(monkeypatch, capsys):
    made = []
    monkeypatch.setattr(ahead, "ship", lambda folder: made.append(folder) or 7)
    monkeypatch.setattr(ahead, "make", made.append)
    ahead.run(["a/folder"])
    ahead.run(["part", "1"])
    assert made == [Path("a/folder"), 1]
    assert capsys.readouterr() == ("", "tcc_sim: 7 kernels compiled ahead\n")
