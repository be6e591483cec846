"""`explain` shows the paper's closed forms of a scene: against numbers worked out by hand."""

from __future__ import annotations

import math

import pytest

from tcc_sim.cli import main
from tcc_sim.output.closed_forms import closed_form_lines, closed_forms
from tcc_sim.scene import load_scene


def test_pure_slip_is_shown_beside_the_ticks() -> None:
    system = load_scene("slip").system
    found = closed_forms(system)
    assert found is not None
    slip = found["slip"]
    swing = 250.0 / (0.2 * 150.0)
    assert (slip["mean"], slip["amplitude"]) == pytest.approx((150.0 + swing, swing))
    assert slip["growth"] == 0.0
    assert slip["margin"] == pytest.approx(150.0)
    transient = 300.0 / (0.02 * math.sqrt(150e3 - 225.0))
    assert 150.0 - transient < slip["least"] < 150.0
    assert slip["pure_slip"] is True
    assert 0.0 < slip["tick_difference"] < 1.0
    assert "lasts for ever" in "\n".join(closed_form_lines(found))
    assert "of (14) over 500 ticks" in "\n".join(closed_form_lines(found))


def test_a_slow_engine_does_not_keep_slipping() -> None:
    found = closed_forms(load_scene("slip").with_values({"initial.slip_speed": 30.0}).system)
    assert found is not None
    assert found["slip"]["margin"] > 0.0 > found["slip"]["least"]
    assert found["slip"]["tick_difference"] is None
    assert "does not last" in "\n".join(closed_form_lines(found))
    gripping = closed_forms(load_scene("slip").with_values({"pressure.mean": 130e3}).system)
    assert gripping is not None
    assert gripping["slip"]["least"] is None
    assert "outweighs" in "\n".join(closed_form_lines(gripping))


def test_stick_and_what_has_no_closed_form() -> None:
    found = closed_forms(load_scene("stick").system)
    assert found is not None
    assert found["stick"]["sticks"] is True
    assert found["stick"]["mean"] == pytest.approx(0.1)
    falling = closed_forms(load_scene("fig02").system)
    assert falling is not None
    assert falling["slip"] is None
    assert falling["stick"]["sticks"] is False
    assert "needs mu_k = mu_s" in "\n".join(closed_form_lines(falling))
    assert closed_forms(load_scene("commands").system) is None
    assert "topic" in closed_form_lines(None)[0]
    exact = closed_forms(load_scene("slip").with_values({"friction.law": "set_valued"}).system)
    assert exact is not None
    assert exact["slip"]["pure_slip"] is True
    assert exact["slip"]["tick_difference"] is None


def test_the_command_shows_them(capsys) -> None:  # type: ignore[no-untyped-def]
    assert main(["explain", "slip"]) == 0
    assert "pure slip (15): 158.333 rad/s" in capsys.readouterr().out
