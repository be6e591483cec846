"""`explain` shows what a scene builds and leaves out; the paper's closed forms against numbers worked out by hand."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from documents import valid

from tcc_sim.cli import main
from tcc_sim.output.explanation import closed_form_lines, closed_forms, explain
from tcc_sim.scene import load_scene
from tcc_sim.topics import topic


def test_the_minimal_scene_leaves_out_what_it_does_not_have() -> None:
    found = explain(load_scene("minimal"))
    assert found["terms"]["held"] == ["engine torque sine", "smoothing tanh"]
    assert set(found["terms"]["left_out"]) == {"engine torque harmonics 2, 3, ...", "pressure sine",
                                               "Stribeck exponential",
                                               "pressure clamp", "profiles in time"}
    kernel = found["kernel"]
    assert (kernel["stribeck"], kernel["pulsation"], kernel["harmonics"]) == ("left out",) * 3
    assert {"rclpy", "mcap", "matplotlib", "rerun"} <= set(found["modules"]["left_out"])
    assert set(found["topics"]["left_out"]) == {"engine_torque", "actuation_pressure", "applied_pressure",
                                                "input_source", "/clock"}
    assert found["step"]["sub_steps"] == 10


def test_arrays_that_a_kernel_is_given_are_told_by_their_size() -> None:
    """A profile has a row of eight numbers for each of its two pieces; it was called an array of sines."""
    scene = load_scene("runup")
    pieces = scene.system.profile
    assert pieces is not None
    assert pieces.shape == (2, 8)
    assert explain(scene)["kernel"]["profile"] == "array of 2 by 8 numbers"


@pytest.mark.parametrize(("name", "sines"), [("minimal", 3.0), ("stick", 3.0), ("fig02", 6.0)])
def test_a_kernel_calls_nothing_for_terms_that_its_scene_does_not_have(name: str, sines: float) -> None:
    """SDIRK3 has three stages, each with one engine torque and one load; one sine more a stage for every harmonic."""
    step = explain(load_scene(name))["step"]
    own, general = step["own_calls"], step["general_calls"]
    assert own["sines"] == sines
    assert general["sines"] == 9.0
    falling = load_scene(name).system.friction_ratio > 1.0
    assert (own["exponentials"] > 0.0) is falling


def test_the_set_valued_law_has_no_smoothing_and_no_real_time_step() -> None:
    scene = load_scene("minimal").with_values({"friction.law": "set_valued"})
    found = explain(scene)
    assert found["solver"] == "event_driven"
    assert "smoothing tanh" in found["terms"]["left_out"]
    assert found["step"] is None


@pytest.mark.parametrize(("name", "values", "created"), [
    ("joint_states", {}, True), ("slip_speed", {}, True), ("slip_speed", {"publish_scalars": False}, False),
    ("/clock", {}, False), ("/clock", {"publish_clock": True}, True), ("engine_torque", {}, False),
    ("engine_torque", {"engine.source": "topic"}, True), ("applied_pressure", {"pressure.source": "topic"}, True),
    ("/diagnostics", {"publish_diagnostics": False}, False)])
def test_a_topic_is_there_where_its_switch_says_so(name: str, values: dict[str, object], created: bool) -> None:
    assert topic(name).wanted(load_scene("fig02").with_values(values).value) is created


def test_cost_is_measured_where_it_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "cost.json"
    assert main(["explain", "minimal", "--cost", "--json", str(file)]) == 0
    step = valid("explain", json.loads(file.read_text()))["step"]
    assert list(step["terms_s"]) == ["engine torque sine"]
    assert step["ratio"] == pytest.approx(step["general_s"] / step["own_s"])
    assert "of it engine torque sine" in capsys.readouterr().out


def test_the_command_prints_and_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "explained.json"
    assert main(["explain", "fig02", "--json", str(file)]) == 0
    out = capsys.readouterr().out
    for words in ("Stribeck exponential", "33 sub-steps in a tick of 1 ms"):
        assert words in out
    found = valid("explain", json.loads(file.read_text()))
    assert found["name"] == "fig02"
    assert "own_s" not in found["step"]
    assert main(["explain", "fig02", "--json", str(file)]) == 2
    assert main(["explain", "fig20"]) == 2


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
