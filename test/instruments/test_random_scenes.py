"""The random suite: every part is drawn, some scenes agree, and a package with another damping would not."""

from __future__ import annotations

import pytest
import random_scenes
from random_scenes import HOLDS, draw, main


def test_every_part_is_drawn_with_every_hold() -> None:
    words = {word for seed in range(200) for word in draw(seed).words}
    assert {"smoothed", "set_valued", "slow slip", "coupling", "falls", "rises", "no slope", "sines", "pulsation",
            "profiles", "inputs", "actuator", "far end", *(f"hold {hold}" for hold in HOLDS)} <= words
    assert any(word.startswith("table with 1.0%") for word in words)
    assert draw(5) == draw(5) != draw(6)


def test_scenes_agree_with_the_other_integrator(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(6, 8) == 0
    assert "6 scenes in" in capsys.readouterr().out


def test_a_wrong_package_differs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    original = random_scenes.simulate
    monkeypatch.setattr(random_scenes, "simulate", lambda scene, **rest: original(
        scene.with_values({"driveline.damping": 0.63}), **rest))
    assert main(4, 8) >= 3
    assert "seed 8: " in capsys.readouterr().out
