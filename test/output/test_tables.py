"""Tables on a terminal: what a sweep shows of its results at any width."""

from __future__ import annotations

import re
from functools import cache

import pytest

import tcc_sim
from tcc_sim.output.tables import sweep_lines

MU_K = "friction.kinetic_coefficient"


@cache
def swept() -> tcc_sim.Sweep:
    """Runaway, a period, none found, and not settled: by the paper below 0.5556 of mu_s slip grows without bound."""
    return tcc_sim.sweep("chaos", MU_K, [0.15, 0.205, 0.24, 0.3], cycles=60)


@pytest.mark.parametrize("width", [None, 60, 80, 200])
def test_a_sweep_shows_each_of_its_results_at_every_width(width: int | None) -> None:
    sweep, lines = swept(), sweep_lines(swept(), width)
    assert width is None or max(map(len, lines)) <= width
    shown: dict[str, list[str]] = {name: [] for name in ("max_slip_speed", "period", "stick_fraction", "regime")}
    names: list[str] = []
    for line in lines:
        words = line.split()
        if words[:1] == ["kinetic_coefficient"]:
            names = words[1:]
        elif words and re.match(r"0\.\d", words[0]):
            for name, word in zip(names, words[1:]):
                shown[name].append(word)
    columns = sweep.columns()
    assert [float(word) for word in shown["max_slip_speed"]] == pytest.approx(columns["max_slip_speed"], rel=1e-6)
    assert [float(word) for word in shown["stick_fraction"]] == pytest.approx(columns["stick_fraction"], abs=5e-5)
    assert shown["regime"] == list(columns["regime"])
    kinds = [columns[name] for name in ("runaway", "transient", "period")]
    for word, runaway, transient, period in zip(shown["period"], *kinds):
        assert ("runaway" in word) == runaway
        assert runaway or ("*" in word) == transient
        assert runaway or not period or int(word.strip("*")) == period
    assert True in columns["runaway"]
    assert max(columns["period"]) > 0
