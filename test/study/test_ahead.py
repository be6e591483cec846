"""Kernels that an installation compiles ahead: those of the pages' commands, which the verbs themselves use."""

from __future__ import annotations

import re
import shlex
from contextlib import contextmanager
from pathlib import Path

import pytest

from tcc_sim.cli import main
from tcc_sim.cli.verbs import VERBS
from tcc_sim.compiling.compiled import Kernel
from tcc_sim.scene import bundled_scenes, load_scene
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

ROOT = Path(__file__).resolve().parents[2]
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
LINES = sorted({line for page in (ROOT / "README.md", *sorted((ROOT / ".github" / "guide").glob("*.md")))
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
                use(load_scene(name))
    return names


def test_every_command_on_the_pages_meets_kernels_that_are_compiled_ahead(shipped):
    tried = 0
    for line in LINES:
        words = shlex.split(line.partition(" > ")[0], comments=True)
        scene = next((word for word in words if word in bundled_scenes()), None)
        assert words[0] in {*OF_VERB, *LONG, *WITHOUT}, f"{words[0]} has no row in OF_VERB"
        if scene is not None and words[0] in OF_VERB:
            tried += 1
            with called() as names:
                for use in OF_VERB[words[0]]:
                    use(load_scene(scene))
            assert names - shipped == set(), f"tcc-sim {line}: ahead.USES lacks {scene} for {words[0]}"
    assert tried > 30


@pytest.mark.parametrize("line", [
    "simulate fig02 --cycles 8 --discard 4", "simulate runup --orders", "sweep fig02 --over engine.frequency=80,117",
    "sweep chaos --over friction.kinetic_coefficient=0.2,0.21 --lyapunov --cycles 30 --discard 20",
    "continue chaos --over friction.kinetic_coefficient=0.29:0.291",
    "basins chaos --plane initial.slip_speed=-1:1:2 --plane initial.plate_angle=0:0.1:2",
    "linearise controlled --slip 20", "figure 2"])
def test_a_verb_calls_only_kernels_that_are_compiled_ahead(shipped, line, tmp_path, monkeypatch):
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
