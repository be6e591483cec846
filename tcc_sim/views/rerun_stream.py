"""Stream of a run to Rerun: columns, sent batch by batch while the run is read, and a blueprint."""

from __future__ import annotations

import math
import os
import re
import socket
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures import wait as wait_for
from contextlib import AbstractContextManager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.loop.control import Event
from tcc_sim.background import begun
from tcc_sim.errors import InputError, TccError
from tcc_sim.output.files import new_file
from tcc_sim.trajectory import Cycles, Floats
from tcc_sim.views import rerun_layout as layout
from tcc_sim.views import style

_URL = re.compile(r"rerun(?:\+https?)?://(\[[0-9a-fA-F:]+\]|[^\s/:]+):([0-9]{1,5})/proxy")
ROOM, LAYOUT = 1 << 20, 1 << 17
"""Bytes that are written to test whether the disk is full: after a failure, and before the layout is sent."""
_ANSWER_TIMEOUT = 3.0
"""Longest wait for a viewer to answer, s."""
_STALLED = 10.0
"""Longest wait for a file to grow, and of a live stream for its viewer at the end, s: Rerun does not always report that
its writer has ended.
"""
_FLUSH_PERIOD = 0.5
"""Least time between two questions to a viewer whether it has received what was sent, s."""
_ENDING = 3.0
"""Longest wait for Rerun to end after a failure, s: sometimes it waits for ever for a writer that has ended."""


class RerunStream(AbstractContextManager["RerunStream"]):
    """Stream of a run to a file, a started viewer or a running one; a context manager.

    The phase portrait shows the slip speed over the plate angle. It has one strip for each engine cycle, and shows the
    last 100 cycles before the cursor with their section points, stretched so that they fill their box.

    cycle : duration of an engine cycle, s
    file : new .rrd file
    url : URL of a running viewer, rerun+http://HOST:PORT/proxy
    controlled : whether to show target and pressures, which `control` sends
    topics : names of further topics that `control` sends, which may have panels of their own
    history : least time before the cursor in the time series, s; they show some engine cycles at least
    length : length of all runs, s, where it is known
    say : function that takes a sentence, of a stream that must not wait: samples that a slow viewer does not receive
        are left out. Without it, the stream waits for the viewer.
    patience : longest wait for a viewer that takes nothing, s
    room : largest number of values sent that a viewer has not received; Rerun keeps them, and from about five times as
        many on its calls wait for the viewer

    Raise MissingPackage: rerun-sdk is not installed; InputError: none or several of `file`, `spawn` and `url` are
    given, the file exists or cannot be created, or no viewer answers at the URL; TccError: the viewer does not start.

    Every method that sends raises InputError if the viewer has gone, or without `say` takes nothing for `patience` s.
    """

    def __init__(self, name: str, cycle: float, *, file: Path | None = None,
                 spawn: bool = False, url: str | None = None, controlled: bool = False, topics: Collection[str] = (),
                 history: float = 0.0, length: float = math.inf, say: Callable[[str], Any] | None = None,
                 patience: float = 60.0, room: int = 500_000) -> None:
        if (file is not None) + spawn + (url is not None) != 1:
            raise InputError("give one of a file, a viewer to start and the URL of a running viewer")
        self._rr = layout.rerun()
        if url is not None:
            check_viewer(url)
        if file is not None:
            if any("\ud800" <= character <= "\udfff" for character in str(file)):
                raise InputError(f"{file} is not a name in UTF-8, which Rerun needs")
            new_file(file).open("xb").close()  # A wrong path is refused before the run is read.
        self._file = file
        self._cycle = cycle
        self._state: int | None = None
        self._offset_ns = 0
        self._last_ns: int | None = None
        self._strip: Floats = np.empty((0, 2))
        self._cycle_number: int | None = None
        self._mean = 0.0
        self._held: dict[str, float] = {}
        self._patience, self._room = patience, room
        self._say, self.left_out, self._stalled, self._restarted = say, 0, False, False
        self._sent = self._received = 0
        self._flushed = -math.inf
        self._asked: tuple[int, Future[None]] | None = None
        self._extents: deque[Floats] = deque(maxlen=layout.PORTRAIT_CYCLES)
        self._axes: layout.PhaseAxes | None = None
        self.recording = self._rr.RecordingStream("tcc_sim", send_properties=True)
        self.recording.set_log_time_enabled(False)
        self.recording.set_log_tick_enabled(False)
        shown = layout.blueprint(cycle, controlled, history, topics, length)
        try:
            if file is not None:
                _writable(file, LAYOUT)  # Rerun would wait for ever for a writer that ends here.
                self.recording.save(file, default_blueprint=shown)
            elif spawn:
                _open_viewer(self.recording, shown)
            else:
                self.recording.connect_grpc(url, default_blueprint=shown)
            self.recording.send_recording_name(name)
            for path, look in layout.looks(controlled):
                self._always(path, look)
        except BaseException:
            if file is not None:
                file.unlink(missing_ok=True)
            raise

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(wait=kind is None)

    def samples(self, stamp_ns: NDArray[np.int64], slip_speed: Floats, plate_angle: Floats, plate_speed: Floats,
                engine_torque: Floats, friction_torque: Floats, state: NDArray[np.int8], *,
                new_run: bool = False, longest: int = 0) -> None:
        """Send the next samples, (n,) arrays: stamps in ns that increase, rad/s, rad, rad/s, N m, N m, and -1, 0, 1.

        With `new_run`, simulation time has started again: the stream marks this and continues the time of the views.
        Where stamps are more than `longest` ns apart (0: unknown), messages were lost, and lines have a gap.
        """
        if not len(stamp_ns):
            return
        new_run = new_run or self._restarted
        if not self._takes(len(stamp_ns)):
            self._restarted, self._strip, self._cycle_number = new_run, np.empty((0, 2)), None
            return
        self._restarted = False
        if self._last_ns is None:
            self._event(int(stamp_ns[0]), "the first state that is shown", "INFO")
        elif new_run:
            self._offset_ns += self._last_ns + 1_000_000 - int(stamp_ns[0])
            self._strip, self._state, self._cycle_number = np.empty((0, 2)), None, None
            self._mark(int(stamp_ns[0]), "simulation time starts again: the driveline was reset or restarted")
        before = stamp_ns[0] if new_run or self._last_ns is None else self._last_ns
        gaps = np.flatnonzero(np.diff(stamp_ns, prepend=before) > longest) if longest else np.empty(0, np.int64)
        stamp_ns = np.insert(stamp_ns, gaps, np.append(before, stamp_ns)[gaps] + longest // 2)
        slip_speed, plate_angle, *others = (np.insert(values, gaps, math.nan) for values in (
            slip_speed, plate_angle, plate_speed, engine_torque, friction_torque))
        for path, values in zip(("slip/speed", "plate/angle", "plate_speed/speed", "torque/engine", "torque/friction"),
                                (slip_speed, plate_angle, *others)):
            self._line(path, stamp_ns, values)
        self._lanes(stamp_ns, np.where(np.isfinite(slip_speed), np.insert(state, gaps, layout.UNKNOWN), layout.UNKNOWN))
        self._orbit(stamp_ns, plate_angle, slip_speed)
        self._last_ns = int(stamp_ns[-1])

    def cycles(self, cycles: Cycles, first: int) -> None:
        """Send the results of whole engine cycles, from number `first` on, after their samples."""
        if not len(cycles) or self._stalled:
            return
        ends = (first + 1 + np.arange(len(cycles))) * self._cycle if cycles.starts is None else cycles.starts[1:]
        ends_ns = np.rint(ends * 1e9).astype(np.int64)
        for path, values in (("cycles/largest", cycles.highest), ("cycles/smallest", cycles.lowest)):
            self._line(path, ends_ns, values)
        points = self._plane(cycles.section[1:, 1], cycles.section[1:, 0])
        known = np.isfinite(points).all(axis=1)
        if known.any():
            self._send("phase/section", ends_ns[known], self._rr.Points2D.columns(positions=points[known]))

    def control(self, signals: Mapping[str, tuple[NDArray[np.int64], Floats]], events: Sequence[Event] = ()) -> None:
        """Send the signals of a controller's test, after the samples of the same time.

        signals : by name, mean_slip or that of a topic that is shown (`topics.shown`): stamps (ns) and values in the
            unit of the topic, (n,) arrays
        events : events of the current run
        """
        if self._stalled:
            return
        for name, (stamps, values) in signals.items():
            if len(stamps):
                self._line(layout.SIGNALS[name], stamps, values)
                if name != "mean_slip":
                    self._held[name] = float(values[-1])
                elif np.isfinite(values).any():
                    self._mean = float(values[np.isfinite(values)][-1])
        for name, value in self._held.items() if self._last_ns is not None else ():  # They hold up to here.
            self._line(layout.SIGNALS[name], np.array([self._last_ns]), np.array([value]))
        for event in events:
            self._mark(round(event.t * 1e9), event.text)

    def text(self, markdown: str) -> None:
        """Send the summary of the run."""
        if self._stalled:
            return
        self._always("summary", self._rr.TextDocument(markdown, media_type="text/markdown"))

    def _takes(self, count: int) -> bool:
        """Return whether the next samples can be sent; wait for the viewer, or leave them out and report that once."""
        if self._file is not None:
            return True
        since, received = time.monotonic(), self._received
        while self._ask() > self._room:
            if self._received > received:
                since, received = time.monotonic(), self._received
            if self._say is not None:
                if not self.left_out:
                    self._say("the Rerun viewer takes no more data: what it does not receive is left out and counted")
                self.left_out += count
                self._stalled = True
                return False
            if time.monotonic() - since > self._patience:
                raise InputError(f"the Rerun viewer did not take the run: nothing for {self._patience:g} s")
            if self._asked is None:  # The answer was late; the next question follows soon.
                time.sleep(0.1 * _FLUSH_PERIOD)
            else:
                wait_for([self._asked[1]], 0.1)
        self._stalled = False
        return True

    def _ask(self) -> int:
        """Return how many values that were sent the viewer may not have received; InputError if it has gone."""
        if self._asked is not None and self._asked[1].done():
            sent, answer = self._asked
            self._asked = None
            error = answer.exception()
            if error is None:
                self._received = sent
            elif "timed out" not in str(error).lower():
                raise InputError(f"the Rerun viewer has gone: {str(error).splitlines()[0]}")
        now = time.monotonic()
        if self._asked is None and self._sent > self._received and now - self._flushed > _FLUSH_PERIOD:
            self._flushed = now
            self._asked = self._sent, begun(lambda: self.recording.flush(timeout_sec=self._patience), "Rerun")[0]
        return self._sent - self._received

    def close(self, wait: bool = True) -> None:
        """End the stream, and wait until the viewer or the file has all data.

        Raise InputError: a viewer does not receive the data within `patience` s; OSError: the disk is full or fails;
        TccError: the file was not written for another reason.
        """
        ending = min(_ENDING, self._patience)
        try:
            if wait and not self._stalled:
                self._flush()
                ending = self._patience
        except Exception as error:
            reason = str(error).splitlines()[0]
            if self._file is None:
                raise InputError(f"the Rerun viewer did not take the run: {reason}") from None
            _writable(self._file)
            raise TccError(f"the Rerun file was not written: {reason}") from None
        finally:
            done, _ = begun(self.recording.disconnect, "Rerun")
            if not wait_for([done], ending).done:
                self._rr.unregister_shutdown()  # The end of the process would wait likewise.

    def _flush(self) -> None:
        """Wait until a viewer has received all data, or while the file grows."""
        if self._file is None:
            self.recording.flush(timeout_sec=self._patience if self._say is None else _STALLED)
            return
        while True:
            size = self._file.stat().st_size
            try:
                self.recording.flush(timeout_sec=_STALLED)
                return
            except Exception:
                if self._file.stat().st_size == size:
                    raise

    def _mark(self, stamp_ns: int, text: str) -> None:
        """Send an event to the log, and as a mark to the time series."""
        self._event(stamp_ns, text, "WARN")
        self.recording.log("event/mark", self._rr.Scalars(self._mean))

    def _event(self, stamp_ns: int, text: str, level: str) -> None:
        self.recording.set_time(layout.ELAPSED, duration=np.timedelta64(stamp_ns + self._offset_ns, "ns"))
        self.recording.set_time(layout.SIMULATION, duration=np.timedelta64(stamp_ns, "ns"))
        self.recording.log("events", self._rr.TextLog(text, level=level))

    def _send(self, path: str, stamp_ns: NDArray[np.int64], columns: Any) -> None:
        self._sent += len(stamp_ns)
        elapsed = stamp_ns + self._offset_ns
        self.recording.send_columns(path, columns=columns, indexes=[
            self._rr.TimeColumn(layout.ELAPSED, duration=elapsed.astype("timedelta64[ns]")),
            self._rr.TimeColumn(layout.SIMULATION, duration=stamp_ns.astype("timedelta64[ns]"))])

    def _line(self, path: str, stamp_ns: NDArray[np.int64], values: Floats) -> None:
        """Send values of a line; where one is not finite, the line ends."""
        known = np.isfinite(values)
        columns = self._rr.Scalars.columns(scalars=values[known])
        self._send(path, stamp_ns, columns if known.all() else columns.partition(known.astype(int)))

    def _plane(self, plate_angle: Floats, slip_speed: Floats) -> NDArray[np.float32]:
        """Return points of the phase portrait; the second axis of a Rerun 2D view points down."""
        return np.stack([plate_angle, -slip_speed], axis=1).astype(np.float32)

    def _lanes(self, stamp_ns: NDArray[np.int64], state: NDArray[np.int8]) -> None:
        before = np.concatenate([[127 if self._state is None else self._state], state[:-1]])
        changed = np.flatnonzero(state != before)
        self._state = int(state[-1])
        if len(changed):
            names = [layout.STATES.get(s, ("",))[0] for s in state[changed].tolist()]  # An empty one ends the lane.
            self._send("state", stamp_ns[changed], self._rr.StateChange.columns(state=names))

    def _orbit(self, stamp_ns: NDArray[np.int64], plate_angle: Floats, slip_speed: Floats) -> None:
        """Send a strip of the phase portrait for each whole engine cycle."""
        number = np.floor(stamp_ns * 1e-9 / self._cycle + 1e-9).astype(np.int64)
        points = self._plane(plate_angle, slip_speed)
        before = number[0] if self._cycle_number is None else self._cycle_number
        starts = np.flatnonzero(np.diff(number, prepend=before))
        self._cycle_number = int(number[-1])
        whole, cuts = np.concatenate([self._strip, points]), [0, *(starts + len(self._strip)).tolist()]
        strips: list[Floats] = []
        counts: list[int] = []
        for begin, end in pairwise(cuts):
            strip = whole[begin:end + 1]
            parts = [part[np.isfinite(part).all(axis=1)]
                     for part in np.split(strip, np.flatnonzero(~np.isfinite(strip).all(axis=1)))]
            strips += [part for part in parts if len(part) > 1]
            counts.append(len(strips) - sum(counts))
        self._strip = whole[cuts[-1]:]
        if strips:
            self._extents.extend(np.stack([strip.min(axis=0), strip.max(axis=0)]) for strip in strips)
            self._frame()
            self._send("phase/orbit", stamp_ns[starts], self._rr.LineStrips2D.columns(strips=strips).partition(counts))

    def _frame(self) -> None:
        """Send new axes of the portrait if its cycles exceed the present ones or use only a small part of one."""
        low, high = np.min([e[0] for e in self._extents], axis=0), np.max([e[1] for e in self._extents], axis=0)
        least, most = np.array([low[0], -high[1]]), np.array([high[0], -low[1]])
        if self._axes is not None and self._axes.hold(least, most):
            return
        axes = layout.PhaseAxes.around(least, most)
        if axes == self._axes:
            return
        self._axes = axes
        rr, (lines, places, texts), grey = self._rr, axes.drawn(), layout.rgb(style.GREY)
        self._always("phase/axes", rr.LineStrips2D(lines, colors=grey, radii=rr.Radius.ui_points(0.5)))
        self._always("phase/labels", rr.Points2D(places, labels=texts, show_labels=True, colors=grey,
                                                 radii=rr.Radius.ui_points(0.0)))
        move, scale = axes.transform()
        for path in ("phase/orbit", "phase/section"):
            self._always(path, rr.Transform3D(translation=(*move, 0.0), scale=(*scale, 1.0)))

    def _always(self, path: str, shown: Any) -> None:
        self.recording.log(path, shown, static=True)


def _writable(file: Path, room: int = ROOM) -> None:
    """Raise OSError if so many bytes cannot be added to a file, since Rerun does not report a full disk."""
    with file.open("ab") as stream:
        stream.write(bytes(room))


def _open_viewer(recording: Any, shown: Any) -> None:
    """Start the viewer of rerun-sdk, also from beside Python in an environment that is not activated."""
    folder = str(Path(sys.executable).parent)
    if folder not in os.get_exec_path():
        os.environ["PATH"] = os.pathsep.join([*os.get_exec_path(), folder])
    try:
        recording.spawn(default_blueprint=shown)
    except RuntimeError as error:
        raise TccError(f"Rerun's viewer does not start: {str(error).splitlines()[0]}") from None


def check_viewer(url: str) -> None:
    """Raise InputError if no viewer answers at a URL: a stream would wait for ever."""
    match = _URL.fullmatch(url)
    if match is None:
        raise InputError(f"{url!r} is not the URL of a Rerun viewer; it looks like rerun+http://127.0.0.1:9876/proxy")
    try:
        socket.create_connection((match[1].strip("[]"), int(match[2])), _ANSWER_TIMEOUT).close()
    except (OSError, OverflowError):
        raise InputError(f"no Rerun viewer answers at {url}") from None
