"""Show a running driveline live in Rerun, in bounded memory, and report missed states."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node

from tcc_sim.analysis.loop.control import CycleMeans, Event, joined_means
from tcc_sim.analysis.measured.engine_clock import Scheduled
from tcc_sim.analysis.measured.stream import CycleStream
from tcc_sim.errors import InputError, TccError, counted
from tcc_sim.messages import cdr, held
from tcc_sim.nodes.executables import deferred, node_of_command
from tcc_sim.nodes.middleware import wait_until
from tcc_sim.nodes.track import SILENCE, Track
from tcc_sim.recording.announcements import simulation_ns, zeros_of
from tcc_sim.scene import Scene, parse_scene
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.topics import HELD_INPUTS, shown, stamped, topic
from tcc_sim.trajectory import Floats, modes_of
from tcc_sim.views.rerun_stream import RerunStream

DRAIN_PERIOD, LOOK = 0.1, 1.0
"""Real time between two times of taking messages, and between two looks at their publishers, s."""
FILE_PERIOD = 2.0
"""Real time between two writes to a file, s. Rerun stores an index of each write: 0.4 MB a minute with this value at
1 kHz, 7 MB with 0.1 s.
"""
DISCOVERY_LIMIT = 5.0
"""Longest real time to receive a driveline's scene, s."""
WEB_PERIOD, WEB_HISTORY = 0.5, 2.0
"""Real time between two updates of a browser, and time shown in its time series, s. Where new data came, Rerun draws
the axis of the picture before: a browser without a graphics processor, which draws two pictures a second, would show
no line in a shorter window.
"""
SUMMARY_PERIOD = 1.0
"""Real time between two summaries, s."""
RECENT_CYCLES = 100
"""Largest number of engine cycles that a summary covers."""
Signal = tuple[NDArray[np.int64], Floats]
WATCHED = "scene", "joint_states", "held", *(row.name for row in stamped())
"""Topics from which everything is shown: what the inputs held, and since when, is on `held`."""


class Watcher:
    """Receiver of a driveline's messages, which passes them to a view.

    It updates the view every `period` seconds of real time, and passes sentences for the user to `say`.
    """

    def __init__(self, node: Node, say: Callable[[str], Any], period: float = 0.0) -> None:
        self._node, self._say = node, say
        self._period, self._shown = period, -math.inf
        self._tracks = {name: Track(node, node.resolve_topic_name(name), topic(name).type, topic(name).latched)
                        for name in WATCHED}
        self._waiting: dict[str, list[bytes]] = {name: [] for name in WATCHED[1:]}
        self._looked = -math.inf
        self.states = 0
        self._reported, self._reported_at = 0, 0.0
        self._last_stamp = -1
        self._recent: deque[tuple[float, float]] = deque(maxlen=RECENT_CYCLES)
        self._summarised = -math.inf
        self._zeros = zeros_of(())
        scene = wait_until(self._scene, DISCOVERY_LIMIT)
        if scene is None:
            raise TccError(f"no driveline published its scene on {node.resolve_topic_name('scene')} within "
                           f"{DISCOVERY_LIMIT:g} s")
        self.scene = scene
        self._stick_speed = stick_speed_of(terms_of(self.scene.system))
        self._cycles = CycleStream(self.scene.system)
        self._last: dict[str, float] = {}
        self._run, self._sources = b"", ""
        self._means = CycleMeans(Scheduled(self.scene.system.cycle))

    @property
    def lost(self) -> int:
        """Number of states that were sent and did not arrive."""
        return self._tracks["joint_states"].lost

    def _scene(self) -> Scene | None:
        scene = None
        for data, _ in self._tracks["scene"].take():
            try:
                text = cdr.read_string(data)
                scene = parse_scene(text, "driveline")
                self._zeros = np.union1d(self._zeros, zeros_of([text]))
            except (ValueError, InputError) as error:
                self._say(f"a scene could not be read: {error}")
        return scene

    def view(self, **where: Any) -> RerunStream:
        """Return a Rerun stream for this driveline, to one of `file`, `spawn` or `url` as in RerunStream."""
        system = self.scene.system
        name = self._node.resolve_topic_name("driveline")
        commanded = "topic" in (system.engine.source, system.pressure.source)
        controlled = commanded or self._node.count_publishers("target_slip_speed") > 0
        given = [row.name for row in shown() if self._node.count_publishers(row.name) > 0]
        return RerunStream(name, system.cycle, controlled=controlled, topics=given, say=self._say, **where)

    def drain(self, view: RerunStream, everything: bool = False) -> None:
        """Take the messages that have arrived, and show them if an update is due or `everything` is set."""
        scene, now = self._scene(), time.monotonic()
        if scene is not None:
            self.scene, self._stick_speed = scene, stick_speed_of(terms_of(scene.system))
        if now - self._looked >= LOOK:
            self._looked = now
            for name, track in self._tracks.items():
                offered = self._node.get_publishers_info_by_topic(track.topic)
                self._waiting.get(name, []).extend(data for data, _ in track.follow(offered))
        for name, waiting in self._waiting.items():
            waiting += [data for data, _ in self._tracks[name].take()]
        if self._waiting["joint_states"] and (everything or now - self._shown >= self._period):
            self._shown, taken = now, self._waiting
            self._waiting = {name: [] for name in taken}
            rows = cdr.own_records(taken["joint_states"], "joint_states")
            stamps = simulation_ns(cdr.stamps(rows), self._zeros)
            cuts = 1 + np.flatnonzero(np.diff(stamps) < 0)
            for piece in np.split(np.arange(len(rows)), cuts):
                self._show(view, stamps[piece], rows[piece])
            view.control(*self._signals(taken))
        if everything or now - self._summarised >= SUMMARY_PERIOD:
            self._summarised = now
            view.text(self.summary())
        self._report()

    def summary(self) -> str:
        """Return what is watched and the figures of the last cycles as Markdown, in few lines."""
        scene, system = self.scene, self.scene.system
        torque = "commanded" if system.engine.source == "topic" else f"{system.engine.mean_torque:g} N m on average"
        pressure = "commanded" if system.pressure.source == "topic" else f"{system.pressure.mean:g} Pa on average"
        lines = [f"**{self._node.resolve_topic_name('driveline')}**, {max(self._last_stamp, 0) * 1e-9:.1f} s at "
                 f"{scene.operation.rate:g} Hz: {counted(self.states, 'state')} shown, {self.lost} missed"]
        if self._recent:
            largest, stick = np.array(self._recent).T
            lines += [f"last {counted(len(largest), 'cycle')}: largest slip speed {largest.max():.4g} rad/s, "
                      f"{100.0 * stick.mean():.3g} % of the time in stick"]
        lines += [f"{system.friction.law} friction, engine torque {torque}, pressure {pressure}",
                  scene.description or scene.name]
        return "  \n".join(lines)

    def _show(self, view: RerunStream, stamps: NDArray[np.int64], rows: NDArray[np.void]) -> None:
        fresh = np.diff(stamps, prepend=np.int64(self._last_stamp)) != 0
        new_run = bool(len(stamps) and stamps[0] < self._last_stamp)
        stamps, rows = stamps[fresh], rows[fresh]
        if not len(stamps):
            return
        self._last_stamp = int(stamps[-1])
        column = {name: rows[name].astype(np.float64) for name in topic("joint_states").fields}
        slip_speed = column["flywheel_speed"] - column["plate_speed"]
        sampled = (slip_speed, column["plate_angle"], column["plate_speed"], column["engine_torque"],
                   column["friction_torque"])
        pieces = self._cycles.feed(stamps, *sampled, system=self.scene.system)
        view.samples(stamps, *sampled, modes_of(slip_speed, self._stick_speed), new_run=new_run,
                     longest=self._cycles.continuity.longest)
        self.states += len(stamps)
        for piece in pieces:
            view.cycles(piece.cycles, piece.first)
            cycles = piece.cycles
            lengths = self.scene.system.cycle if cycles.starts is None else np.diff(cycles.starts)
            self._recent.extend(zip(cycles.largest.tolist(), (cycles.stick_time / lengths).tolist()))
        if new_run:
            self._means.restart()
        view.control({"mean_slip": joined_means(self._means.feed(stamps.astype(np.float64) * 1e-9, slip_speed))})
        # No figures are computed at the end, so cycles are not stored.
        del self._cycles.runs[:-1]
        for run in self._cycles.runs:
            run.pieces.clear()

    def _signals(self, taken: Mapping[str, Sequence[bytes]]) -> tuple[dict[str, Signal], list[Event]]:
        """Return the changes of the signals of `topics.shown` (name -> stamps in ns, values), and the changes of the
        sources of inputs, in serialised messages that state their simulation times.
        """
        events, signals = list[Event](), dict[str, Signal]()
        reports, _ = held.LAYOUT.records(taken["held"])
        reports = reports[np.isfinite(reports["values"][:, :held.HEAD]).all(axis=1)]
        if len(reports):
            known, self._run = self._run, reports["run"][-1]
            table = reports["values"][np.isin(reports["run"], (known, self._run))]  # Latched ones of earlier runs come.
            for report in table.tolist():
                text = held.sources_in_words(report)
                events += [Event(report[held.TIME] * 1e-9, text)] * (text not in ("", self._sources))
                self._sources = text
            for name in HELD_INPUTS:
                commanded = table[:, held.index_in_held(name, "source")] == held.COMMAND
                values = np.where(commanded, table[:, held.index_in_held(name, "value")], math.nan)
                signals[name] = table[:, held.TIME].astype(np.int64), values
        for carrier in stamped():
            rows = cdr.own_records(taken[carrier.name], carrier.name)
            stamps = simulation_ns(cdr.stamps(rows), self._zeros)
            signals |= {row.name: (stamps, rows[row.fields[0]].astype(np.float64)) for row in shown()
                        if row.fields and row.fields[0] in carrier.fields}
        return {name: self._changes(name, *signal) for name, signal in signals.items() if len(signal[0])}, events

    def _changes(self, name: str, stamps: NDArray[np.int64], values: Floats) -> Signal:
        """Return the known values that differ from the one before."""
        new = values != np.append(self._last.get(name, math.nan), values[:-1])
        self._last[name] = float(values[-1])
        return stamps[new & np.isfinite(values)], values[new & np.isfinite(values)]

    def _report(self) -> None:
        """Report missed states at most once a second, and once that no states arrive."""
        now = time.monotonic()
        missed = self.lost
        if missed > self._reported and now - self._reported_at >= 1.0:
            self._say(f"missed {counted(missed - self._reported, 'state')}, {missed} in all")
            self._reported, self._reported_at = missed, now
        if self._tracks["joint_states"].fell_silent():
            self._say(f"no states for {SILENCE:g} s: paused, stopped, or waiting for subscribers")


def watch(namespace: str, say: Callable[[str], Any], web: bool = False, **where: Any) -> str:
    """Show a running driveline until KeyboardInterrupt and return a summary sentence.

    Raises TccError: no driveline publishes its scene. Raises InputError: the namespace is not valid, the file cannot be
    created, or no viewer answers at the URL, or it has gone. Raises MissingPackage: rerun-sdk is not installed.

    web : whether the viewer is a browser
    where : one of `file`, `spawn` or `url`, as in RerunStream
    """
    with node_of_command("watcher", namespace) as node:
        watcher = Watcher(node, say, WEB_PERIOD if web else FILE_PERIOD if where.get("file") is not None else 0.0)
        with watcher.view(**where, history=WEB_HISTORY if web else 0.0) as view:
            what = watcher.scene.description or "a scene"
            say(f"watching {node.resolve_topic_name('driveline')}: {what}; Ctrl-C ends it")
            try:
                while True:
                    # A signal must not interrupt between taking and showing messages.
                    with deferred():
                        watcher.drain(view)
                    time.sleep(DRAIN_PERIOD)
            except KeyboardInterrupt:
                watcher.drain(view, everything=True)
    left_out = f", {view.left_out} left out by the viewer" if view.left_out else ""
    return f"{counted(watcher.states - view.left_out, 'state')} shown, {watcher.lost} missed{left_out}"
