"""Show a running driveline live in Rerun, in bounded memory, and report missed states."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import QoSProfile

from tcc_sim.analysis.control import CycleMeans, Event, joined_means
from tcc_sim.analysis.engine_clock import Uniform
from tcc_sim.analysis.stream import CycleStream
from tcc_sim.errors import InputError, TccError, counted
from tcc_sim.messages import cdr, held
from tcc_sim.nodes import signals
from tcc_sim.nodes.middleware import (
    CHANGES,
    COMMANDS,
    LATCHED,
    SequenceNumbers,
    message_class,
    poll,
    publisher_of,
    states,
    subscribe,
)
from tcc_sim.nodes.process import node_of_command
from tcc_sim.recording.announcements import simulation_ns, zeros_of
from tcc_sim.scene import Scene, parse_scene
from tcc_sim.solvers.terms import stick_speed_of, terms_of
from tcc_sim.topics import FLOAT64, JOINT_STATE, shown, topic
from tcc_sim.trajectory import Floats, modes_of
from tcc_sim.views.rerun_stream import RerunStream

DEPTH = 20_000
"""Depth of the queue of states; Fast DDS stores 5000, 1 s at 5 kHz."""
DRAIN_PERIOD = 0.1
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
SILENCE = 3.0
"""Real time without states after which the watcher reports it, s."""
MOST_WAITING = 20_000
"""Largest number of messages of a topic that wait for the next states."""
Signal = tuple[NDArray[np.int64], Floats]


Reader = Callable[[bytes], tuple[int | None, Any]]
"""Function that returns stamp (ns, or None) and content of a message."""


def readers() -> dict[str, tuple[QoSProfile, Reader]]:
    """Return the watched topics with their quality of service and reader: those that a viewer shows by themselves, and
    the sources of the inputs.
    """
    out: dict[str, tuple[QoSProfile, Reader]] = {"held": (CHANGES, _read_sources)}
    for row in shown():
        command = row.direction == "in"
        profile = COMMANDS if command else LATCHED if row.latched else states(MOST_WAITING)
        read: Reader = _read_number if row.type == FLOAT64 else _read_command if command else cdr.read_fluid_pressure
        out[row.name] = profile, read
    return out


def _read_sources(data: bytes) -> tuple[int, str]:
    """Read the sources of the inputs."""
    values = held.read_held(data)[1]
    return int(values[held.TIME]), held.sources_in_words(values.tolist())


def _read_number(data: bytes) -> tuple[None, float]:
    """Read a number, which has no stamp."""
    return None, cdr.read_float64(data)


def _read_command(data: bytes) -> tuple[None, float]:
    """Read a commanded pressure; its stamp is that of the state that it answers."""
    return None, cdr.read_fluid_pressure(data)[1]


def _subscribed(node: Node, name: str, profile: QoSProfile) -> Any:
    """Create a polled subscription."""
    return subscribe(node, message_class(topic(name).type), name, profile)


class ControlWatch:
    """Watcher of commands, target, applied pressure and sources of the inputs, which assigns them to states.

    Parameters
    ----------
    node : node in the driveline's namespace
    cycle : engine cycle over which the slip speed is averaged, s
    """

    def __init__(self, node: Node, cycle: float) -> None:
        self._readers = {name: read for name, (_, read) in readers().items()}
        self._subscriptions = {name: _subscribed(node, name, profile)
                               for name, (profile, _) in readers().items()}
        self._waiting: dict[str, deque[tuple[int, int | None, Any]]] = {
            name: deque(maxlen=MOST_WAITING) for name in self._readers}
        self._means = CycleMeans(Uniform(cycle))
        self._applied, self._sources = math.nan, ""

    def poll(self) -> None:
        """Take the messages that have arrived; ignore messages that cannot be read."""
        for name, subscription in self._subscriptions.items():
            for data, info in poll(subscription, MOST_WAITING):
                with suppress(ValueError):
                    self._waiting[name].append((info["received_timestamp"] or time.time_ns(),
                                                *self._readers[name](data)))

    def aligned(self, stamp_ns: NDArray[np.int64], received_ns: NDArray[np.int64], slip_speed: Floats, *,
                new_run: bool, zeros: NDArray[np.int64]) -> tuple[dict[str, Signal], list[Event]]:
        """Return the signals (name -> stamps in ns, values) and events received up to the last of the next states.

        A message without simulation time gets the stamp of the first state received after it.

        Parameters
        ----------
        stamp_ns, received_ns, slip_speed : (n,) arrays of the states, all of one run: simulation time and time of
            receipt, ns, and slip speed, rad/s
        new_run : whether simulation time has started again
        zeros : stamps of simulation time 0, as in `simulation_ns`
        """
        signals: dict[str, Signal] = {}
        events: list[Event] = []
        for name, waiting in self._waiting.items():
            stamps, values = [], []
            while waiting and waiting[0][0] <= received_ns[-1]:
                received, stamp, value = waiting.popleft()
                if new_run and received < received_ns[0] and topic(name).fields:
                    continue  # It is sent after its state, so this one belongs to the run that has ended.
                place = int(np.searchsorted(received_ns, received))
                stamps.append(int(stamp_ns[place]) if stamp is None else stamp)
                values.append(value)
            times = simulation_ns(np.array(stamps, dtype=np.int64), zeros)
            if name == "held":
                for time, text in zip(times.tolist(), values):
                    events += [Event(time * 1e-9, text)] * (text not in ("", self._sources))
                    self._sources = text
            elif values:
                signals[name] = times, np.array(values)
        if "applied_pressure" in signals:
            stamps_of, pressure = signals["applied_pressure"]
            changed = np.diff(pressure, prepend=self._applied) != 0.0
            self._applied = float(pressure[-1])
            signals["applied_pressure"] = stamps_of[changed], pressure[changed]
        if new_run:
            self._means.restart()
        signals["mean_slip"] = joined_means(self._means.feed(stamp_ns.astype(np.float64) * 1e-9, slip_speed))
        return signals, events


class Watcher:
    """Receiver of a driveline's messages, which passes them to a view.

    Parameters
    ----------
    node : node in the driveline's namespace
    say : function that takes a sentence for the user
    period : real time between two updates of the view, s
    """

    def __init__(self, node: Node, say: Callable[[str], Any], period: float = 0.0) -> None:
        self._node, self._say = node, say
        self._period, self._shown = period, -math.inf
        self._waiting: list[tuple[NDArray[np.void], NDArray[np.int64]]] = []
        self._scenes = _subscribed(node, "scene", LATCHED)
        self._states = _subscribed(node, "joint_states", QoSProfile(depth=DEPTH))
        self.heard = self.states = 0
        self.numbers = SequenceNumbers()
        self._reported, self._reported_at = 0, 0.0
        self._last_stamp = -1
        self._heard, self._silent = time.monotonic(), False
        self._recent: deque[tuple[float, float]] = deque(maxlen=RECENT_CYCLES)
        self._summarised = -math.inf
        self._zeros = zeros_of(())
        self.scene = self._await_scene()
        self._stick_speed = stick_speed_of(terms_of(self.scene.system))
        self._cycles = CycleStream(self.scene.system)
        self._control = ControlWatch(node, self.scene.system.cycle)

    def _await_scene(self) -> Scene:
        """Wait for the current scene; raise TccError if no driveline publishes one."""
        end = time.monotonic() + DISCOVERY_LIMIT
        while time.monotonic() < end:
            scene = self._scene()
            if scene is not None:
                return scene
            time.sleep(0.02)
        name = self._node.resolve_topic_name("scene")
        raise TccError(f"no driveline published its scene on {name} within {DISCOVERY_LIMIT:g} s")

    def _scene(self) -> Scene | None:
        """Return the newest scene since the last call, or None."""
        scene = None
        for data, _ in poll(self._scenes):
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
        scene = self._scene()
        if scene is not None:
            self.scene, self._stick_speed = scene, stick_speed_of(terms_of(scene.system))
        taken, now = self._taken(), time.monotonic()
        self._control.poll()
        if len(taken[0]):
            self._heard = now
            self.heard += len(taken[0])
            self._waiting.append(taken)
        if self._waiting and (everything or now - self._shown >= self._period):
            self._shown = now
            rows, received = (np.concatenate(column) for column in zip(*self._waiting))
            self._waiting.clear()
            stamps = simulation_ns(cdr.stamps(rows), self._zeros)
            cuts = 1 + np.flatnonzero(np.diff(stamps) < 0)
            for piece in np.split(np.arange(len(rows)), cuts):
                self._show(view, stamps[piece], rows[piece], received[piece])
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
                 f"{scene.operation.rate:g} Hz: {counted(self.states, 'state')} shown, {self.numbers.lost} missed"]
        if self._recent:
            largest, stick = np.array(self._recent).T
            lines += [f"last {counted(len(largest), 'cycle')}: largest slip speed {largest.max():.4g} rad/s, "
                      f"{100.0 * stick.mean():.3g} % of the time in stick"]
        lines += [f"{system.friction.law} friction, engine torque {torque}, pressure {pressure}",
                  scene.description or scene.name]
        return "  \n".join(lines)

    def _taken(self) -> tuple[NDArray[np.void], NDArray[np.int64]]:
        """Return the arrived states (except other layouts) and their times of receipt (ns); count lost ones."""
        taken = poll(self._states, DEPTH)
        for _, info in taken:
            number, who = info.get("publication_sequence_number") or 0, publisher_of(info)
            if number and who:
                self.numbers.count(who, number)
        rows, right = cdr.own_records([data for data, _ in taken], JOINT_STATE)
        times = np.array([info["received_timestamp"] or time.time_ns() for _, info in taken], dtype=np.int64)
        return rows, times[right]

    def _show(self, view: RerunStream, stamps: NDArray[np.int64], rows: NDArray[np.void],
              received: NDArray[np.int64]) -> None:
        """Show states of one run."""
        fresh = np.diff(stamps, prepend=np.int64(self._last_stamp)) != 0
        new_run = bool(stamps[0] < self._last_stamp)
        stamps, rows, received = stamps[fresh], rows[fresh], received[fresh]
        if not len(stamps):
            return
        self._last_stamp = int(stamps[-1])
        column = {name: rows[name].astype(np.float64) for name in topic("joint_states").fields}
        slip_speed = column["flywheel_speed"] - column["plate_speed"]
        sampled = (slip_speed, column["plate_angle"], column["plate_speed"], column["engine_torque"],
                   column["friction_torque"])
        pieces = self._cycles.feed(stamps, *sampled)
        view.samples(stamps, *sampled, modes_of(slip_speed, self._stick_speed), new_run=new_run,
                     longest=self._cycles.continuity.longest)
        self.states += len(stamps)
        for piece in pieces:
            view.cycles(piece.cycles, piece.first)
            cycles = piece.cycles
            lengths = self.scene.system.cycle if cycles.starts is None else np.diff(cycles.starts)
            self._recent.extend(zip(cycles.largest.tolist(), (cycles.stick_time / lengths).tolist()))
        view.control(*self._control.aligned(stamps, received, slip_speed, new_run=new_run,
                                            zeros=self._zeros))
        # No figures are computed at the end, so cycles are not stored.
        del self._cycles.runs[:-1]
        for run in self._cycles.runs:
            run.pieces.clear()

    def _report(self) -> None:
        """Report missed states at most once a second, and once that no states arrive."""
        now = time.monotonic()
        missed = self.numbers.lost
        if missed > self._reported and now - self._reported_at >= 1.0:
            self._say(f"missed {counted(missed - self._reported, 'state')}, {missed} in all")
            self._reported, self._reported_at = missed, now
        silent = now - self._heard > SILENCE
        if silent and not self._silent:
            self._say(f"no states for {SILENCE:g} s: paused, stopped, or waiting for subscribers")
        self._silent = silent


def watch(namespace: str, say: Callable[[str], Any], web: bool = False, **where: Any) -> str:
    """Show a running driveline until KeyboardInterrupt and return a summary sentence.

    Parameters
    ----------
    namespace : namespace of the driveline
    say : function that takes a sentence for the user
    web : whether the viewer is a browser
    where : one of `file`, `spawn` or `url`, as in RerunStream

    Raises
    ------
    TccError
        No driveline publishes its scene.
    InputError
        The namespace is not valid, the file cannot be created, or no viewer answers at the URL, or it has gone.
    MissingPackage
        rerun-sdk is not installed.
    """
    with node_of_command("watcher", namespace) as node:
        watcher = Watcher(node, say, WEB_PERIOD if web else FILE_PERIOD if where.get("file") is not None else 0.0)
        with watcher.view(**where, history=WEB_HISTORY if web else 0.0) as view:
            what = watcher.scene.description or "a scene"
            say(f"watching {node.resolve_topic_name('driveline')}: {what}; Ctrl-C ends it")
            try:
                while True:
                    # A signal must not interrupt between taking and showing messages.
                    with signals.deferred():
                        watcher.drain(view)
                    time.sleep(DRAIN_PERIOD)
            except KeyboardInterrupt:
                watcher.drain(view, everything=True)
    left_out = f", {view.left_out} left out by the viewer" if view.left_out else ""
    return f"{counted(watcher.states - view.left_out, 'state')} shown, {watcher.numbers.lost} missed{left_out}"
