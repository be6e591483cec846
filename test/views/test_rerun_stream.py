"""Output to Rerun: a file that its own tool accepts, with every sample, written during the stream; a layout."""

from __future__ import annotations

import math
import os
import socket
import sys
import threading
from collections import Counter
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk
from interpreter import python, rerun_rows

from tcc_sim.analysis.control import Event
from tcc_sim.errors import InputError, TccError
from tcc_sim.topics import TOPICS
from tcc_sim.trajectory import Cycles
from tcc_sim.views import rerun_layout as layout
from tcc_sim.views import rerun_stream
from tcc_sim.views.recording_layout import JOINTS, PARTS, views, write_layout
from tcc_sim.views.rerun_layout import PhaseAxes
from tcc_sim.views.rerun_stream import RerunStream

CYCLE = 0.05


@pytest.fixture(autouse=True)
def _home(tmp_path_factory, monkeypatch):
    """Rerun's tool keeps its settings in the home directory."""
    monkeypatch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
    pytest.importorskip("rerun")


def rerun_tool(*arguments):
    return python("-m", "rerun_cli", "rrd", *map(str, arguments))


def batch(first, count):
    stamps = np.arange(first, first + count) * 1_000_000
    v = 20.0 * np.sin(2.0 * np.pi * stamps * 1e-9 / CYCLE)
    return stamps, v, 0.01 * v, v, 300.0 + v, 2.0 * v, np.sign(np.round(v)).astype(np.int8)


def cycles_of(count):
    return Cycles(np.ones((count + 1, 3)), np.full(count, 20.0), np.full(count, -20.0), np.zeros(count))


def test_the_file_is_accepted_and_holds_every_sample(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunStream("by hand", CYCLE, file=path) as stream:
        for first in range(0, 1000, 125):
            stream.samples(*batch(first, 125))
        stream.cycles(cycles_of(19), 0)
        stream.samples(*batch(0, 500), new_run=True)
        stream.cycles(cycles_of(9), 0)
        stream.text("# Summary")
    checked = rerun_tool("verify", path)
    assert checked.returncode == 0, checked.stderr
    result = rerun_rows(path)
    static = 1
    for entity in ("/torque/engine", "/torque/friction", "/slip/speed", "/plate/angle", "/plate_speed/speed"):
        assert result[entity] == 1500 + static
    for entity in ("/cycles/largest", "/cycles/smallest"):
        assert result[entity] == 28 + static
    for entity in ("/phase/section", "/phase/orbit"):
        assert result[entity] == 28 + static + 1  # Its place in the box.
    assert result["/events"] == 2
    states = [batch(0, 1000)[6], batch(0, 500)[6]]
    assert result["/state"] == sum(1 + np.count_nonzero(np.diff(s)) for s in states) + static


def test_it_streams_while_it_is_fed(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunStream("by hand", CYCLE, file=path) as stream:
        for first in range(0, 200_000, 50_000):
            stream.samples(*batch(first, 50_000))
        stream.recording.flush(timeout_sec=20.0)
        assert path.stat().st_size > 200_000 * 5 * 8
        stream.samples(*batch(200_000, 1000))


def test_an_existing_file_is_not_overwritten(tmp_path):
    path = tmp_path / "run.rrd"
    path.write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        RerunStream("by hand", CYCLE, file=path)
    assert path.read_text() == "mine"
    with pytest.raises(InputError, match="cannot be written"):
        RerunStream("by hand", CYCLE, file=tmp_path / "no" / "run.rrd")


def test_what_ends_before_anything_is_shown_leaves_no_file(monkeypatch, tmp_path):
    def interrupted(*words):
        raise KeyboardInterrupt

    monkeypatch.setattr(layout, "blueprint", interrupted)
    with pytest.raises(KeyboardInterrupt):
        RerunStream("run", 0.04, file=tmp_path / "run.rrd")
    assert list(tmp_path.iterdir()) == []


def test_one_goal_and_a_url_that_answers():
    with pytest.raises(InputError, match="one of"):
        RerunStream("by hand", CYCLE)
    with pytest.raises(InputError, match="is not the URL"):
        RerunStream("by hand", CYCLE, url="http://example.org")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        with pytest.raises(InputError, match="no Rerun viewer answers"):
            RerunStream("by hand", CYCLE, url=f"rerun+http://127.0.0.1:{unused.getsockname()[1]}/proxy")


def printed(path):
    """All chunks, with every value, as printed by Rerun."""
    done = rerun_tool("print", "-vvv", path)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_phase_portrait_has_axes_in_its_units_and_nothing_is_clipped(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunStream("by hand", CYCLE, file=path) as stream:
        for first in range(0, 1000, 125):
            stream.samples(*batch(first, 125))
    every = printed(path)
    assert all(text in every for text in ("plate angle (rad)", "slip speed (rad/s)", "0.2", "-20", "20"))
    # The orbit of `batch` is |v| <= 20 rad/s, |angle| <= 0.2 rad: the axes are +-0.2 rad and +-20 rad/s.
    move, scale = PhaseAxes.around(np.array([-0.2, -20.0]), np.array([0.2, 20.0])).transform()
    assert move == pytest.approx((0.5 * layout.WIDTH, 0.5))
    assert scale == pytest.approx((layout.WIDTH / 0.4, 1.0 / 40.0))


@pytest.mark.parametrize(("low", "high"), [((-0.03, 0.0), (0.24, 36.4)), ((0.1, -1e-4), (0.1, 1e-4)),
                                           ((0.06661, 11.7), (0.06673, 28.4)), ((-3.0, -150.0), (2.0, 151.0)),
                                           ((0.0, 0.0), (0.0, 0.0))])
def test_axes_are_round_fill_the_box_and_their_labels_do_not_overlap(low, high):
    low, high = np.array(low), np.array(high)
    axes = PhaseAxes.around(low, high)
    move, scale = np.array(axes.transform())
    corners = move + scale * np.array([[low[0], -high[1]], [high[0], -low[1]]])
    assert (corners >= -1e-9).all()
    assert (corners <= np.array([layout.WIDTH, 1.0]) + 1e-9).all()
    places, texts = axes.labels()
    across, along = axes.places()
    assert len(texts) == len(places) == len(across) + len(along) + 2
    assert [float(text) for _, text in across] == pytest.approx([(x - move[0]) / scale[0] for x, _ in across], abs=1e-5)
    assert [float(text) for _, text in along] == pytest.approx([(move[1] - y) / scale[1] for y, _ in along], abs=1e-5)
    # The view is at least 512 x 236 pixels; a label is 24 pixels high, and 5.5 a letter and 16 wide.
    (left, right), (top, bottom) = layout.BOUNDS
    pixels = min(512.0 / (right - left), 236.0 / (bottom - top))
    boxes = [(x - (2.75 * len(text) + 8.0) / pixels, y, x + (2.75 * len(text) + 8.0) / pixels, y + 24.0 / pixels)
             for (x, y), text in zip(places, texts)]
    assert all(left <= x0 and x1 <= right and top <= y0 and y1 <= bottom for x0, y0, x1, y1 in boxes)
    assert not [(a, b) for a, b in combinations(boxes, 2)
                if a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]]
    if (high > low).all():
        assert axes.hold(low, high)
        assert not axes.hold(low, high + 3.0 * (high - low))
        for axis in (0, 1):
            small = high.copy()
            small[axis] = low[axis] + 0.05 * (high - low)[axis]
            assert not axes.hold(low, small)


def panels(part):
    """The views of a blueprint."""
    return [view for inner in part.contents for view in panels(inner)] if hasattr(part, "row_shares") else [part]


@pytest.mark.parametrize("controlled", [False, True])
def test_no_panel_is_empty_after_the_first_two_cycles(controlled, tmp_path):
    path = tmp_path / "run.rrd"
    with RerunStream("by hand", CYCLE, file=path, controlled=controlled) as stream:
        stream.samples(*batch(0, 101))
        stream.cycles(cycles_of(2), 0)
        at, value = np.array([100_000_000]), np.ones(1)
        stream.control(dict.fromkeys(["mean_slip", *(["applied_pressure"] if controlled else [])], (at, value)))
        stream.text("what is watched")
    result, looks = rerun_rows(path), Counter(f"/{entity}" for entity, _ in layout.looks(controlled))
    shown = panels(layout.blueprint(CYCLE, controlled).root_container)
    assert len(shown) == (11 if controlled else 9)
    assert [view.name for view in shown if not any(
        result[entity] > looks[entity] for entity in result if f"{entity}/".startswith(f"/{view.origin}/"))] == []


def test_a_controllers_test_is_in_the_file_and_in_the_layout(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunStream("by hand", CYCLE, file=path, controlled=True) as stream:
        stream.samples(*batch(0, 500))
        at = np.array([100, 300]) * 1_000_000
        stream.control({"mean_slip": (at, np.array([3.0, 4.0])), "target_slip_speed": (at[:1], np.array([20.0])),
                        "applied_pressure": (at, np.array([2e5, 3e5])), "actuation_pressure": (at[1:], np.array([3e5])),
                        "engine_torque": (at[1:], np.array([310.0]))},
                       [Event(0.25, "pressure falls back: no command for 0.5 s")])
        stream.samples(*batch(0, 500), new_run=True)
    result, every = rerun_rows(path), printed(path)
    static = 1
    expected = {"/control/mean": 2, "/control/target": 2, "/pressure/applied": 3, "/pressure/command": 2,
                "/torque/engine_command": 2, "/event/mark": 2}
    assert {entity: result[entity] for entity in expected} == {entity: n + static for entity, n in expected.items()}
    assert result["/events"] == 3
    for words in ("pressure falls back: no command for 0.5 s", "reset or restarted", "Target and cycle mean (rad/s)",
                  "Actuation pressure (Pa)"):
        assert words in every
    with RerunStream("by hand", CYCLE, file=tmp_path / "plain.rrd") as stream:
        stream.samples(*batch(0, 500))
    assert "Actuation pressure (Pa)" not in printed(tmp_path / "plain.rrd")


def test_the_viewer_is_found_beside_python_and_one_that_does_not_start_is_one_line(monkeypatch):
    """`.venv/bin/tcc-sim watch` in an environment that is not activated."""
    import rerun

    searched: list[list[str]] = []

    def spawn(self: object, **options: object) -> None:
        searched.append(os.get_exec_path())
        raise RuntimeError("Failed to find Rerun Viewer executable in PATH.\n\n  You can install it")

    monkeypatch.setenv("PATH", "/usr/bin")
    monkeypatch.setattr(rerun.RecordingStream, "spawn", spawn)
    with pytest.raises(TccError, match=r"^Rerun's viewer does not start: Failed to find [^\n]* in PATH\.$"):
        RerunStream("run", 0.04, spawn=True)
    assert searched == [["/usr/bin", str(Path(sys.executable).parent)]]


def test_a_file_is_waited_for_as_long_as_it_grows(monkeypatch, tmp_path):
    stream, waits = RerunStream("run", CYCLE, file=tmp_path / "run.rrd"), []
    stream.recording.flush(timeout_sec=20.0)

    def flush(timeout_sec):
        waits.append(timeout_sec)
        if len(waits) < 4:
            with (tmp_path / "run.rrd").open("ab") as file:
                file.write(b"more")
        raise RuntimeError("Flush timed out")

    monkeypatch.setattr(stream.recording, "flush", flush)
    with pytest.raises(TccError, match="the Rerun file was not written: Flush timed out"):
        stream.close()
    assert waits == [rerun_stream._STALLED] * 4


def test_a_rerun_that_does_not_end_is_left_behind(monkeypatch, tmp_path):
    """Rerun sometimes waits for ever for a writer that has ended, and again at the end of the process."""
    import rerun

    left, unregistered = threading.Event(), []
    monkeypatch.setattr(rerun_stream, "_ENDING", 0.05)
    monkeypatch.setattr(rerun, "unregister_shutdown", lambda: unregistered.append(True))
    stream = RerunStream("run", CYCLE, file=tmp_path / "run.rrd")
    disconnect = stream.recording.disconnect
    monkeypatch.setattr(stream.recording, "disconnect", left.wait)
    stream.close(wait=False)
    assert unregistered == [True]
    left.set()
    disconnect()


def test_a_disk_that_has_no_room_for_the_layout_is_refused_at_once(tmp_path):
    """Rerun waits for ever for a writer that ends while the layout is sent."""
    with full_disk(10_000), pytest.raises(OSError, match="File too large"):
        RerunStream("run", CYCLE, file=tmp_path / "run.rrd")


def test_a_viewer_that_hangs_up_is_named():
    with socket.socket() as viewer:
        viewer.bind(("127.0.0.1", 0))
        viewer.listen()
        url = f"rerun+http://127.0.0.1:{viewer.getsockname()[1]}/proxy"
        with pytest.raises(InputError, match="viewer did not take the run"), RerunStream("run", CYCLE, url=url):
            viewer.shutdown(socket.SHUT_RDWR)


@pytest.fixture
def viewer():
    """URL of a viewer that takes a connection and reads nothing."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        yield f"rerun+http://127.0.0.1:{listener.getsockname()[1]}/proxy"


@pytest.fixture
def impatient(monkeypatch):
    """Short waits, and room for two batches."""
    for name, value in {"MOST_WAITING": 5000, "_FLUSH_PERIOD": 0.0, "_TIMEOUT": 0.2, "_ENDING": 0.05}.items():
        monkeypatch.setattr(rerun_stream, name, value)


def test_samples_that_a_viewer_does_not_receive_are_left_out_and_reported_once(viewer, impatient, monkeypatch):
    """Rerun's calls would block for ever; the stream goes on where the viewer reads again."""
    said, reads = [], threading.Event()
    stream = RerunStream("run", CYCLE, url=viewer, say=said.append)
    monkeypatch.setattr(stream.recording, "flush", lambda timeout_sec: reads.wait(60.0))
    for first in range(0, 5000, 500):
        stream.samples(*batch(first, 500))
        stream.cycles(cycles_of(10), first // 50)
        stream.text("summary")
    assert said == ["the Rerun viewer takes no more data: what it does not receive is left out and counted"]
    assert stream.left_out == 4000
    assert stream._sent < 2 * 2600  # Two batches, each of five signals, and what is drawn of each cycle.
    stream.samples(*batch(0, 500), new_run=True)
    reads.set()
    while stream._ask():
        pass
    shown = stream._elapsed_ns
    stream.samples(*batch(500, 500))
    assert stream.left_out == 4500
    assert stream._elapsed_ns == shown + 500 * 1_000_000  # A restart that was left out is shown when the viewer reads.
    stream.close(wait=False)


def test_a_stream_of_a_recording_waits_for_its_viewer_and_ends_where_it_takes_nothing(viewer, impatient, monkeypatch):
    answers = [None, None]
    stream = RerunStream("run", CYCLE, url=viewer)

    def flush(timeout_sec):
        if not answers:
            raise RuntimeError("Flush timed out")
        answers.pop()

    monkeypatch.setattr(stream.recording, "flush", flush)
    shown = iter(range(0, 100_000, 500))
    with pytest.raises(InputError, match=r"the Rerun viewer did not take the run: nothing for 0\.2 s"):  # noqa: PT012
        for first in shown:
            stream.samples(*batch(first, 500))
    assert 1000 < next(shown) < 10_000
    assert stream.left_out == 0
    stream.close(wait=False)


@pytest.mark.parametrize("say", [None, print])
def test_a_viewer_that_has_gone_ends_the_stream(say, viewer, impatient, monkeypatch):
    """Rerun prints an error and drops what is sent from then on."""
    stream = RerunStream("run", CYCLE, url=viewer, say=say)

    def flush(timeout_sec):
        raise RuntimeError("gRPC connection severed: transport error\nmore")

    monkeypatch.setattr(stream.recording, "flush", flush)
    shown = iter(range(0, 100_000, 500))
    with pytest.raises(InputError, match=r"the Rerun viewer has gone: gRPC connection severed: transport error$"):  # noqa: PT012
        for first in shown:
            stream.samples(*batch(first, 500))
    assert next(shown) < 10_000
    stream.close(wait=False)


def test_the_layout_has_every_signal_and_the_name_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "mine_0.mcap").write_bytes(b"")
    path = write_layout(tmp_path)
    assert path == tmp_path / "mine_0.rbl"
    assert b"mine_0" in path.read_bytes()
    text = printed(path)
    for topics in (*views().values(), [JOINTS]):
        for topic in topics:
            assert topic in text, topic
    for component in ("std_msgs.msg.Float64:message", "std_msgs.msg.Int8:message", "Measurements:values"):
        assert component in text
    with pytest.raises(InputError, match=r"mine_0\.rbl exists already and is not overwritten"):
        write_layout(tmp_path / "mine_0.mcap")


def test_every_number_with_a_place_in_a_viewer_is_in_the_layout() -> None:
    shown = [topic for topics in views().values() for topic in topics]
    assert sorted(shown) == sorted(f"/{row.name}" for row in TOPICS if row.view and row.type in PARTS)
    assert {row.name for row in TOPICS if row.type in PARTS and not row.view} == set()


def test_a_directory_without_a_recording_gets_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no MCAP file"):
        write_layout(tmp_path)


def test_ticks_are_round_and_stand_outside_of_the_box() -> None:
    for raw in np.geomspace(0.011, 97.0, 40):
        step = layout._step(0.0, 4.0 * float(raw), 4)
        assert raw * (1.0 - 1e-9) <= step <= 2.5 * raw  # The smallest of 1, 2 and 5 times powers of ten.
        assert round(step / 10.0 ** math.floor(math.log10(step) + 1e-9), 6) in (1.0, 2.0, 5.0)
    assert layout._step(0.0, 4.0, 4) == 1.0
    axes = PhaseAxes((-0.1, 0.3), (-20.0, 60.0))
    across, along = axes.places()
    ticks = [[(x, 1.0), (x, 1.02)] for x, _ in across] + [[(0.0, y), (-0.02, y)] for y, _ in along]
    assert axes.strips()[1:] == ticks
