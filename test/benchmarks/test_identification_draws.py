"""Draws of the identification: one of each scene, and a run that goes on where it was interrupted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tcc_sim.benchmarks import identification_draws
from tcc_sim.benchmarks.identification_draws import KEYS, OUTSIDE, Draw, main, one_draw


@pytest.mark.parametrize("scene", ["fig02", "chaos"])
def test_a_draw_converges_from_its_first_start(scene: str) -> None:
    """Starts 10 % off in random directions; a window that sticks must not lead the fit astray on the way."""
    found = one_draw(scene, 1, 0.6)
    assert found.accepted
    assert found.starts == 1
    assert max(map(abs, found.missed.values())) < OUTSIDE


def test_an_interrupted_run_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    made = []

    def drawn(scene: str, seed: int) -> Draw:
        made.append((scene, seed))
        missed = {key: 5.0 if seed == 2 and key == KEYS[0] else 0.1 for key in KEYS}
        return Draw(scene, seed, seed != 1, 1.0, 1, 2.0, missed, dict.fromkeys(KEYS, "identified"))

    monkeypatch.setattr(identification_draws, "one_draw", drawn)
    path = tmp_path / "draws.jsonl"
    for count in (1, 3):
        main([str(path), str(count), "fig02"])
    assert made == [("fig02", seed) for seed in range(3)]
    assert [json.loads(line)["seed"] for line in path.read_text().splitlines()] == [0, 1, 2]
    row = capsys.readouterr().out.splitlines()[-1]
    # Two of three converged; 9 of their 10 intervals cover, and the one that does not is far off and not flagged.
    assert [cell.strip() for cell in row.split("|")[2:6]] == ["3", "66.7 %", "0", "2.0"]
    assert "0.900" in row
    assert row.endswith("| 5.00 | 1 |")
