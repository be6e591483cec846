"""The instrument that writes the page on periodic motions, with made-up branches and basins."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NoReturn

import motions
import numpy as np
import pytest
from documents import valid
from given import curves_of
from test_figure_branches import given_curve, given_figure

from tcc_sim.model.parameters import System
from tcc_sim.study.basins.proximity import Attractor
from tcc_sim.study.basins.results import Axis, Basins
from tcc_sim.study.paper.catalogue import OMEGA_N
from tcc_sim.study.paper.figure_results import JumpBehind
from tcc_sim.study.paper.figures import KINDS


def given_basins() -> Basins:
    orbit = Attractor(2, np.zeros((2, 3)), np.zeros(2, np.int64), np.array([0.25 + 0.0j]), 49.2, 0.1)
    plane = Axis("initial.slip_speed", (0.0, 60.0)), Axis("initial.plate_angle", (0.0, 0.1))
    return Basins(plane, (orbit,), np.array([[0, 0], [0, -1]], np.int16), np.full((2, 2), 16, np.int32), 1.0, System())


@pytest.mark.usefixtures("figures")
def test_the_generator_writes_page_pictures_and_numbers(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setitem(KINDS, "orbit", lambda row, options: curves_of([given_curve()]))
    monkeypatch.setattr(motions, "basins", lambda *task, **how: [given_basins()])
    folder = tmp_path / "motions"
    assert motions.main(["--quick", "--jobs", "1", "--out", str(folder)]) == 0
    for name in ("branches", "basins"):
        picture = f"pictures/motions_{name}.png"
        assert f"({picture})" in (folder / "motions.md").read_text()
        assert (folder / picture).is_file()
    assert valid("figure", json.loads((folder / "motions_branches.json").read_text()))["curves"]
    assert valid("basins", json.loads((folder / "motions_basins.json").read_text()))["attractors"]
    assert motions.main(["--quick", "--out", str(folder)]) == 2


def test_an_interrupted_page_leaves_nothing(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    def interrupted(*row: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setitem(KINDS, "orbit", interrupted)
    assert motions.main(["--jobs", "1", "--out", str(tmp_path / "motions")]) == 130
    assert not list(tmp_path.iterdir())


def test_the_page_says_what_was_found() -> None:
    unknown = [JumpBehind(x, (x, x), (size, size - 10.0), "aperiodic", None)
               for x, size in ((15.0, 90.0), (20.0, 70.0))]
    curves = [given_curve(), given_curve(direction="up"), given_curve(jumps=unknown)]
    page = motions.motions_page(given_figure(6, "orbit", curves), given_basins())
    low, middle, share = (x / OMEGA_N for x in (20.0, 120.0, 150.0))
    for words in (f"| 1 | {low:.4f} to {share:.4f} | 2 of 4 | at the end of a range, {low:.6f}; in a canard, "
                  f"{middle:.6f} | fold {share:.6f} |", "is within 1e-11 of its value at a bifurcation",
                  f"- fold: {share:.6f} (from (13), upward)", "Of 4 jumps in three sweeps 2 are bifurcations",
                  f"- a motion without a period beside it: 2 places from {15.0 / OMEGA_N:.6f} to {low:.6f}\n",
                  "| 2 | 49.2000 | 0.250000 | 0.1 | 75.000 % |", "Undecided: 25 %",
                  "lead: 75.0 % to period 2 of 49.2 rad/s."):
        assert words in page, words
