"""Output to Rerun: a file that its own tool accepts, with every sample; a layout; viewers that refuse, hang or go."""

from __future__ import annotations

import errno
import os
import re
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driveline_bags import bag, ticked
from full_disk import full_disk
from interpreter import python
from pictures import passes, rerun_line, shown_in_rerun

from tcc_sim.analysis.loop.control import Event
from tcc_sim.cli import main
from tcc_sim.errors import InputError
from tcc_sim.scene import load_scene
from tcc_sim.topics import TOPICS
from tcc_sim.trajectory import Cycles

pytest.importorskip("rerun", reason="rerun is not installed")
from tcc_sim.views.rerun_layout import write_layout
from tcc_sim.views.rerun_stream import RerunStream

CYCLE = 0.05
SIGNALS = ("/torque/engine", "/torque/friction", "/slip/speed", "/plate/angle", "/plate_speed/speed")


@pytest.fixture(autouse=True)
def _home(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rerun's tool keeps its settings in the home directory."""
    monkeypatch.setenv("HOME", str(tmp_path_factory.mktemp("home")))


def batch(first: int, count: int) -> tuple[Any, ...]:
    """Samples, 1 kHz, of a slip speed of 20 rad/s."""
    stamps = np.arange(first, first + count) * 1_000_000
    v = 20.0 * np.sin(2.0 * np.pi * stamps * 1e-9 / CYCLE)
    return stamps, v, 0.01 * v, v, 300.0 + v, 2.0 * v, np.sign(np.round(v)).astype(np.int8)


def cycles_of(count: int) -> Cycles:
    """Cycles of this motion."""
    return Cycles(np.ones((count + 1, 3)), np.full(count, 20.0), np.full(count, -20.0), np.zeros(count))


def printed(path: Path) -> str:
    """All chunks, with every value, as printed by Rerun."""
    done = python("-m", "rerun_cli", "rrd", "print", "-vvv", str(path))
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_file_is_accepted_and_has_every_sample(tmp_path: Path) -> None:
    """A second run goes on behind the first in the time of the views."""
    path = tmp_path / "run.rrd"
    with RerunStream("by hand", CYCLE, file=path) as stream:
        for first in range(0, 1000, 125):
            stream.samples(*batch(first, 125))
        stream.cycles(cycles_of(19), 0)
        stream.samples(*batch(0, 500), new_run=True)
        stream.cycles(cycles_of(9), 0)
        stream.text("# Summary")
        stream.recording.flush(timeout_sec=20.0)
        assert path.stat().st_size > 1500 * 5 * 8  # It is written while it is fed.
    assert python("-m", "rerun_cli", "rrd", "verify", str(path)).returncode == 0
    shown = shown_in_rerun(path)
    one, two = batch(0, 1000), batch(0, 500)
    for entity, first, second in zip(SIGNALS, (one[4], one[5], one[1], one[2], one[3]),
                                     (two[4], two[5], two[1], two[2], two[3])):
        t, values = rerun_line(shown[entity])
        np.testing.assert_array_equal(values, np.concatenate([first, second]))
        assert (np.diff(t) > 0.0).all()
    states = [values[0] for at, values in shown["/state"] if np.isfinite(at)]
    assert states.count("stick") == sum(np.count_nonzero(np.diff(s == 0, prepend=False) & (s == 0))
                                        for s in (one[6], two[6]))
    assert passes(rerun_line(shown["/cycles/largest"]), CYCLE * np.arange(1, 20), np.full(19, 20.0)) == 19
    strips = [strip for at, rows in shown["/phase/orbit"] if np.isfinite(at) for strip in rows]
    assert len(strips) == 28
    assert all(np.ptp(np.array(strip)[:, 0]) == pytest.approx(0.4, rel=0.01) for strip in strips[:19])


def test_a_controllers_signals_and_events_are_in_the_file(tmp_path: Path) -> None:
    """Signals hold to the end of the run; a topic without a panel of the layout has one of its own."""
    path, at = tmp_path / "run.rrd", np.array([100, 300]) * 1_000_000
    further = next(row for row in TOPICS if row.name == "shaft_torque")
    with RerunStream("by hand", CYCLE, file=path, controlled=True, topics=[further.name, "output_speed"]) as stream:
        stream.samples(*batch(0, 500))
        stream.control({"mean_slip": (at, np.array([3.0, 4.0])), "target_slip_speed": (at[:1], np.array([20.0])),
                        "applied_pressure": (at, np.array([2e5, 3e5])), further.name: (at, np.array([30.0, 31.0])),
                        "output_speed": (at, np.array([1.0, 2.0]))}, [Event(0.25, "pressure falls back")])
        stream.samples(*batch(0, 500), new_run=True)
    shown = shown_in_rerun(path)
    for entity, (t, values) in {"/control/mean": ([0.1, 0.3], [3.0, 4.0]),
                                "/control/target": ([0.1, 0.499], [20.0] * 2),
                                "/pressure/applied": ([0.1, 0.3, 0.499], [2e5, 3e5, 3e5]),
                                f"/{further.view}": ([0.1, 0.3, 0.499], [30.0, 31.0, 31.0])}.items():
        np.testing.assert_allclose(rerun_line(shown[entity]), [t, values])
    assert [at for at, _ in shown["/event/mark"] if np.isfinite(at)] == pytest.approx([0.25, 0.5])
    every = printed(path)
    for words in ("pressure falls back", "reset or restarted", "Target and cycle mean (rad/s)",
                  "Actuation pressure (Pa)", "Output speed (rad/s)"):
        assert words in every


def test_a_short_run_fills_its_panels(tmp_path: Path) -> None:
    """No time series begins before the run, which ends at the cursor."""
    scene = load_scene("commands")
    bag(tmp_path / "run", ticked(scene, 3000, pressure=lambda k: 2e5), scene, targets=[(10, 20.0)])
    assert main(["analyse", str(tmp_path / "run"), "--frequency", "150", "--rrd", str(tmp_path / "a.rrd")]) == 0
    begins = [1e-9 * int(number) for number in re.findall(r"\[\{start: \{CursorRelative=-(\d+)\}",
                                                          printed(tmp_path / "a.rrd"))]
    assert len(begins) > 6
    assert max(begins) == pytest.approx(2.999)
    assert min(begins) == pytest.approx(8.0 * 2.0 * np.pi / 150.0)


def test_what_cannot_be_shown_is_refused_and_changes_no_file(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.write_text("mine")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        silent = f"rerun+http://127.0.0.1:{unused.getsockname()[1]}/proxy"
        for where in ({"file": path}, {"file": tmp_path / "no" / "run.rrd"}, {}, {"file": path, "spawn": True},
                      {"url": "http://example.org"}, {"url": silent}):
            with pytest.raises(InputError):
                RerunStream("by hand", CYCLE, **where)
    assert path.read_text() == "mine"
    with full_disk(10_000), pytest.raises(OSError, match=os.strerror(errno.EFBIG)):
        RerunStream("run", CYCLE, file=tmp_path / "b.rrd")
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]


def test_a_viewer_that_hangs_up_is_named() -> None:
    with socket.socket() as viewer:
        viewer.bind(("127.0.0.1", 0))
        viewer.listen()
        url = f"rerun+http://127.0.0.1:{viewer.getsockname()[1]}/proxy"
        stream = RerunStream("run", CYCLE, url=url, room=1000)
        with pytest.raises(InputError, match="viewer"), stream:  # noqa: PT012
            viewer.shutdown(socket.SHUT_RDWR)
            for first in range(0, 100_000, 500):
                stream.samples(*batch(first, 500))


@pytest.fixture
def viewer() -> Iterator[str]:
    """URL of a viewer that takes a connection and reads nothing."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        yield f"rerun+http://127.0.0.1:{listener.getsockname()[1]}/proxy"


def test_samples_that_a_viewer_does_not_receive_are_left_out_and_reported_once(viewer: str) -> None:
    """Rerun's calls would block for ever; the stream goes on."""
    said: list[str] = []
    stream = RerunStream("run", CYCLE, url=viewer, say=said.append, room=5000, patience=0.2)
    for first in range(0, 5000, 500):
        stream.samples(*batch(first, 500))
        stream.cycles(cycles_of(10), first // 50)
        stream.text("summary")
    assert len(said) == 1
    assert stream.left_out == 4000
    stream.close(wait=False)


def test_a_stream_of_a_recording_ends_where_its_viewer_takes_nothing(viewer: str) -> None:
    stream = RerunStream("run", CYCLE, url=viewer, room=5000, patience=0.2)
    with pytest.raises(InputError, match=r"0\.2 s"):  # noqa: PT012
        for first in range(0, 100_000, 500):
            stream.samples(*batch(first, 500))
    assert stream.left_out == 0
    done = threading.Thread(target=stream.close, kwargs={"wait": False}, daemon=True)
    done.start()
    done.join(20.0)
    assert not done.is_alive()


def test_the_layout_beside_a_recording_has_every_number_and_the_name_of_the_file(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        write_layout(tmp_path)
    (tmp_path / "mine_0.mcap").write_bytes(b"")
    path = write_layout(tmp_path)
    assert path == tmp_path / "mine_0.rbl"
    text = printed(path)
    assert "mine_0" in path.read_bytes().decode(errors="replace")
    for row in TOPICS:
        if row.view and row.type.rpartition("/")[2] in ("Float64", "Int8", "FluidPressure"):
            assert f"/{row.name}" in text
    with pytest.raises(InputError):
        write_layout(tmp_path / "mine_0.mcap")
