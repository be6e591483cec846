"""A topic that is added to the table appears in layouts, in the live watcher and in the stream of a recording."""

from pathlib import Path

import numpy as np
import pytest

from tcc_sim import topics
from tcc_sim.recording.commands import signal_types
from tcc_sim.topics import FLOAT64, Topic
from tcc_sim.views import recording_layout, rerun_layout

ROW = Topic("oil_temperature", FLOAT64, "K", "out", (), "temperature of the oil", "oil/temperature")
TITLE = "Oil temperature (K)"


@pytest.fixture(autouse=True)
def added(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(topics, "TOPICS", (*topics.TOPICS, ROW))


def test_the_layout_of_a_recording_has_a_view_for_it() -> None:
    assert recording_layout.views()[TITLE] == ("/oil_temperature",)


def test_the_layout_of_a_stream_has_a_panel_for_it_where_it_is_published() -> None:
    pytest.importorskip("rerun")
    assert rerun_layout.further_panels(["oil_temperature"]) == {"oil": TITLE}
    assert rerun_layout.further_panels(["engine_torque", "target_slip_speed"]) == {}
    assert "oil/temperature" in dict(rerun_layout.looks(True))

    def names(part) -> list[str]:
        inner = part.contents if hasattr(part, "row_shares") else []
        return [name for one in inner for name in names(one)] or [part.name]

    for further in ({}, {"oil": TITLE}):
        shown = names(rerun_layout.blueprint(0.04, True, further=further).root_container)
        assert (TITLE in shown) == bool(further)


def test_the_live_watcher_subscribes_to_it() -> None:
    pytest.importorskip("rclpy")
    from tcc_sim.messages import cdr
    from tcc_sim.nodes.watcher import readers

    assert readers()["oil_temperature"][1](cdr.float64(300.0)) == (None, 300.0)
    assert {"shaft_torque", "output_speed", "applied_pressure", "target_slip_speed", "held"} <= readers().keys()
    assert not {"slip_speed", "friction_torque", "stick_slip_state", "joint_states"} & readers().keys()


def test_the_stream_of_a_recording_reads_and_sends_it(tmp_path: Path) -> None:
    rerun_stream = pytest.importorskip("tcc_sim.views.rerun_stream")
    pytest.importorskip("rerun")
    from interpreter import rerun_rows

    assert signal_types()["oil_temperature"] == FLOAT64
    assert "applied_pressure" not in signal_types()  # Its values have stamps.
    with rerun_stream.RerunStream("made up", 0.04, file=tmp_path / "run.rrd", controlled=True,
                                  topics=["oil_temperature"]) as stream:
        at = np.array([1_000_000, 2_000_000])
        stream.samples(at, *(np.zeros(2),) * 5, np.zeros(2, np.int8))
        stream.control({"oil_temperature": (at, np.array([300.0, 301.0]))})
    assert rerun_rows(tmp_path / "run.rrd")["/oil/temperature"] >= 2


def test_ticks_and_names_of_the_portrait_stand_at_their_axes() -> None:
    """Every label is below or left of its tick, within the bounds of the view; round numbers end the axes."""
    axes = rerun_layout.PhaseAxes.around(np.array([0.03, -2.9]), np.array([0.38, 5.7]))
    assert (axes.angle, axes.speed) == ((0.0, 0.4), (-5.0, 10.0))
    assert rerun_layout.PhaseAxes.around(np.array([0.0, -5.0]), np.array([0.4, 10.0])) == axes
    positions, texts = axes.labels()
    at = dict(zip(texts, positions))
    width = rerun_layout.WIDTH
    for text, x in (("0.2", 0.5 * width), ("0.4", width)):
        assert at[text] == pytest.approx((x, 1.11))
    for text, y in (("10", 0.0), ("5", 1.0 / 3.0), ("-5", 1.0)):
        assert at[text] == pytest.approx((-0.19, y - 0.07))
    assert at["plate angle (rad)"] == pytest.approx((0.5 * width, 1.29))
    assert at["slip speed (rad/s)"] == pytest.approx((0.1, -0.265))
    (left, right), (top, bottom) = rerun_layout.BOUNDS
    assert all(left < x < right and top < y < bottom for x, y in positions)
    box, *ticks = axes.strips()
    assert box == [(0.0, 0.0), (0.0, 1.0), (width, 1.0)]
    np.testing.assert_allclose(ticks, [
        *([(x, 1.0), (x, 1.02)] for x in (0.0, 0.5 * width, width)),
        *([(0.0, y), (-0.02, y)] for y in (1.0, 2.0 / 3.0, 1.0 / 3.0, 0.0))], atol=1e-12)
