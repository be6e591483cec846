"""A run as a stream to Rerun: columns batch by batch while it is read, laid out by a blueprint."""

from __future__ import annotations

import re
import socket
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import InputError, MissingPackage
from tcc_sim.trajectory import Cycles, Floats
from tcc_sim.views import style

ELAPSED = "elapsed"
"""The timeline of the views: simulation time, going on where a reset sets simulation time back."""
SIMULATION = "sim_time"
STATES = {-1: "slip -", 0: "stick", 1: "slip +"}
_STATE_COLOURS = {"slip -": style.RED, "stick": style.GREY, "slip +": style.BLUE}
_LINES = {"torque/engine": ("engine torque (N m)", style.ORANGE),
          "torque/friction": ("friction torque (N m)", style.BLUE),
          "slip/speed": ("slip speed (rad/s)", style.BLUE), "plate/angle": ("plate angle (rad)", style.GREEN),
          "plate_speed/speed": ("plate speed (rad/s)", style.PURPLE)}
_MARKS = {"cycles/largest": ("largest slip speed (rad/s)", style.BLUE),
          "cycles/smallest": ("smallest slip speed (rad/s)", style.RED)}
HISTORY_CYCLES = 8
"""Engine cycles before the cursor that the time series show; zoom out to see more."""
PORTRAIT_CYCLES = 100
"""Engine cycles before the cursor that the phase portrait shows."""
_URL = re.compile(r"rerun(?:\+https?)?://(\[[0-9a-fA-F:]+\]|[^\s/:]+):([0-9]{1,5})/proxy")
_ANSWER_TIMEOUT = 3.0
"""Longest wait for a viewer to answer, s."""
_TIMEOUT = 60.0
"""Longest wait for a viewer to take what was sent, s."""


class RerunStream:
    """Sends a run to a file, to a viewer that it starts, or to a running one. Use it in a `with`.

    The phase portrait has the plate angle times the natural frequency omega_n on its first axis, so that both are
    speeds, and the slip speed upwards. Every engine cycle is a strip of it; the last 100 cycles before the cursor are
    shown with their section points.

    Parameters
    ----------
    name : of the run, as the viewer shows it
    cycle : engine cycle, s
    natural_frequency : omega_n, rad/s
    file : a new .rrd file
    spawn : start a viewer
    url : of a running viewer, rerun+http://HOST:PORT/proxy

    Raises
    ------
    MissingPackage
        rerun-sdk is not installed.
    InputError
        None or several of `file`, `spawn` and `url`, a file that exists or cannot be created, or a URL where no viewer
        answers.
    """

    def __init__(self, name: str, cycle: float, natural_frequency: float, *, file: Path | None = None,
                 spawn: bool = False,
                 url: str | None = None) -> None:
        if (file is not None) + spawn + (url is not None) != 1:
            raise InputError("give one of a file, a viewer to start and the URL of a running viewer")
        self._rr = _rerun()
        if url is not None:
            _answers(url)
        if file is not None:
            _create(file)
        self._cycle = cycle
        self._frequency = natural_frequency
        self._state: int | None = None
        self._elapsed_ns = 0
        self._offset_ns = 0
        self._last_ns: int | None = None
        self._strip: Floats = np.empty((0, 2))
        self._cycle_number: int | None = None
        self._recording = self._rr.RecordingStream("tcc_sim", send_properties=True)
        self._recording.set_log_time_enabled(False)
        self._recording.set_log_tick_enabled(False)
        layout = _blueprint(cycle)
        if file is not None:
            self._recording.save(file, default_blueprint=layout)
        elif spawn:
            self._recording.spawn(default_blueprint=layout)
        else:
            self._recording.connect_grpc(url, default_blueprint=layout)
        self._recording.send_recording_name(name)
        self._names()

    def __enter__(self) -> RerunStream:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close(wait=kind is None)

    def samples(self, stamp_ns: NDArray[np.int64], slip_speed: Floats, plate_angle: Floats, plate_speed: Floats,
                engine_torque: Floats, friction_torque: Floats, state: NDArray[np.int8], *,
                new_run: bool = False) -> None:
        """Send the next samples, (n,) arrays: stamps in ns that increase, rad/s, rad, rad/s, N m, N m, and -1, 0, 1.

        With `new_run` simulation time has started again: it is marked, and the views go on after it.
        """
        if not len(stamp_ns):
            return
        if new_run and self._last_ns is not None:
            self._offset_ns = self._elapsed_ns + 1_000_000 - int(stamp_ns[0])
            self._strip, self._state, self._cycle_number = np.empty((0, 2)), None, None
            self._at(self._elapsed_ns, int(stamp_ns[0]))
            self._recording.log("events",
                                self._rr.TextLog("simulation time starts again: the driveline was reset or restarted",
                                                           level="WARN"))
        index = self._index(stamp_ns)
        for path, values in (("torque/engine", engine_torque), ("torque/friction", friction_torque),
                             ("slip/speed", slip_speed),
                             ("plate/angle", plate_angle), ("plate_speed/speed", plate_speed)):
            self._recording.send_columns(path, indexes=index, columns=self._rr.Scalars.columns(scalars=values))
        self._lanes(stamp_ns, state)
        self._orbit(stamp_ns, plate_angle, slip_speed)
        self._last_ns = int(stamp_ns[-1])
        self._elapsed_ns = self._last_ns + self._offset_ns

    def cycles(self, cycles: Cycles, first: int) -> None:
        """Send what whole engine cycles, from number `first` on, came to; the samples of them were sent before."""
        if not len(cycles):
            return
        ends = np.rint((first + 1 + np.arange(len(cycles))) * self._cycle * 1e9).astype(np.int64)
        index = self._index(ends)
        for path, values in (("cycles/largest", cycles.highest), ("cycles/smallest", cycles.lowest)):
            self._recording.send_columns(path, indexes=index, columns=self._rr.Scalars.columns(scalars=values))
        points = self._plane(cycles.section[1:, 1], cycles.section[1:, 0])
        self._recording.send_columns("phase/section", indexes=index,
                                     columns=self._rr.Points2D.columns(positions=points))

    def text(self, markdown: str) -> None:
        """Send the summary of the run."""
        self._recording.log("summary", self._rr.TextDocument(markdown, media_type="text/markdown"), static=True)

    def close(self, wait: bool = True) -> None:
        """Hand over what was sent.

        Raises
        ------
        InputError
            A viewer does not take it within 60 s.
        """
        try:
            if wait:
                self._recording.flush(timeout_sec=_TIMEOUT)
        except Exception as error:
            raise InputError(f"the Rerun viewer did not take the run: {str(error).splitlines()[0]}") from None
        finally:
            self._recording.disconnect()

    def _index(self, stamp_ns: NDArray[np.int64]) -> list[Any]:
        """Both timelines for rows of columns."""
        elapsed, simulation = stamp_ns + self._offset_ns, stamp_ns
        return [self._rr.TimeColumn(ELAPSED, duration=elapsed.astype("timedelta64[ns]")),
                self._rr.TimeColumn(SIMULATION, duration=simulation.astype("timedelta64[ns]"))]

    def _at(self, elapsed_ns: int, stamp_ns: int) -> None:
        """Both timelines for what is logged next."""
        self._recording.set_time(ELAPSED, duration=np.timedelta64(elapsed_ns, "ns"))
        self._recording.set_time(SIMULATION, duration=np.timedelta64(stamp_ns, "ns"))

    def _plane(self, plate_angle: Floats, slip_speed: Floats) -> NDArray[np.float32]:
        """Points of the phase portrait; the second axis of a Rerun 2D view points down."""
        return np.stack([self._frequency * plate_angle, -slip_speed], axis=1).astype(np.float32)

    def _lanes(self, stamp_ns: NDArray[np.int64], state: NDArray[np.int8]) -> None:
        """Send changes of state."""
        before = np.concatenate([[127 if self._state is None else self._state], state[:-1]])
        changed = np.flatnonzero(state != before)
        self._state = int(state[-1])
        if len(changed):
            self._recording.send_columns("state", indexes=self._index(stamp_ns[changed]),
                                         columns=self._rr.StateChange.columns(
                state=[STATES[s] for s in state[changed].tolist()]))

    def _orbit(self, stamp_ns: NDArray[np.int64], plate_angle: Floats, slip_speed: Floats) -> None:
        """Send a strip of the phase portrait for each engine cycle that is whole."""
        number = np.floor(stamp_ns * 1e-9 / self._cycle + 1e-9).astype(np.int64)
        points = self._plane(plate_angle, slip_speed)
        before = number[0] if self._cycle_number is None else self._cycle_number
        starts = np.flatnonzero(np.diff(number, prepend=before))
        self._cycle_number = int(number[-1])
        strips, ends = [], []
        for part, end in zip(np.split(points, starts), [*starts.tolist(), None]):
            self._strip = np.concatenate([self._strip, part])
            if end is not None:
                strips.append(np.concatenate([self._strip, points[end:end + 1]]))
                ends.append(end)
                self._strip = np.empty((0, 2))
        if strips:
            self._recording.send_columns("phase/orbit", indexes=self._index(stamp_ns[ends]),
                                         columns=self._rr.LineStrips2D.columns(strips=strips))

    def _names(self) -> None:
        """Send names, units and colours once."""
        rr = self._rr
        for path, (name, colour) in _LINES.items():
            self._recording.log(path, rr.SeriesLines(names=name, colors=_rgb(colour), widths=1.5), static=True)
        for path, (name, colour) in _MARKS.items():
            self._recording.log(path,
                                rr.SeriesPoints(names=name, colors=_rgb(colour), markers="circle", marker_sizes=3.0),
                                static=True)
        self._recording.log("state", rr.StateConfiguration(values=list(_STATE_COLOURS), labels=list(_STATE_COLOURS),
                                                           colors=[_rgb(c) for c in _STATE_COLOURS.values()]),
                            static=True)
        self._recording.log("phase/orbit",
                            rr.LineStrips2D.from_fields(colors=_rgb(style.BLUE), radii=rr.Radius.ui_points(0.4)),
                            static=True)
        self._recording.log("phase/section",
                            rr.Points2D.from_fields(colors=_rgb(style.RED), radii=rr.Radius.ui_points(3.0)),
                            static=True)


def _blueprint(cycle: float) -> Any:
    """The last cycles of torques, slip, lanes and plate on the left; phase portrait, maxima and summary on the right.
    """
    rrb = _rerun().blueprint

    def before(cycles: float) -> tuple[Any, Any]:
        """From so many engine cycles before the cursor to the cursor."""
        boundary = rrb.TimeRangeBoundary
        return boundary.cursor_relative(seconds=-cycles * cycle), boundary.cursor_relative(seconds=0.0)

    def history(origin: str, name: str) -> Any:
        """A time series that follows the cursor."""
        legend = rrb.PlotLegend(visible=origin == "torque")
        return rrb.TimeSeriesView(origin=origin, name=name, axis_x=recent(), plot_legend=legend)

    def recent() -> Any:
        """The time axis of the histories."""
        return rrb.TimeAxis(view_range=rrb.TimeRange(*before(HISTORY_CYCLES)))

    start, end = before(PORTRAIT_CYCLES)
    histories = rrb.Vertical(
        history("torque", "Torques (N m)"), history("slip", "Slip speed (rad/s)"),
        rrb.StateTimelineView(origin="state", name="Stick and slip", time_view=recent()),
        history("plate", "Plate angle (rad)"), history("plate_speed", "Plate speed (rad/s)"),
        row_shares=[3, 3, 1.2, 2, 2])
    figures = rrb.Vertical(
        rrb.Spatial2DView(origin="phase", name="Phase portrait and section: omega_n x plate angle, slip speed (rad/s)",
                          time_ranges=rrb.VisibleTimeRange(ELAPSED, start=start, end=end)),
        rrb.TimeSeriesView(origin="cycles", name="Largest and smallest slip speed of each cycle (rad/s)",
                           plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop)),
        rrb.Tabs(rrb.TextDocumentView(origin="summary", name="Summary"),
                 rrb.TextLogView(origin="events", name="Events")),
        row_shares=[4, 3, 2])
    return rrb.Blueprint(rrb.Horizontal(histories, figures, column_shares=[3, 2]),
                         rrb.TimePanel(timeline=ELAPSED, state="collapsed", play_state="following"),
                         collapse_panels=True, auto_views=False)


def _create(file: Path) -> None:
    """Create the file, so that a wrong path is known before anything is read."""
    try:
        file.open("xb").close()
    except FileExistsError:
        raise InputError(f"{file} exists already and is not overwritten") from None
    except OSError as error:
        raise InputError(f"{file} cannot be written: {error.strerror}") from None


def _answers(url: str) -> None:
    """Raise InputError unless something answers at the URL of a viewer: a stream would wait for it for ever."""
    found = _URL.fullmatch(url)
    if found is None:
        raise InputError(f"{url!r} is not the URL of a Rerun viewer; it looks like rerun+http://127.0.0.1:9876/proxy")
    try:
        socket.create_connection((found[1].strip("[]"), int(found[2])), _ANSWER_TIMEOUT).close()
    except (OSError, OverflowError):
        raise InputError(f"no Rerun viewer answers at {url}") from None


def _rgb(colour: str) -> list[int]:
    """The three bytes of #RRGGBB."""
    return [int(colour[k:k + 2], 16) for k in (1, 3, 5)]


def _rerun() -> Any:
    """The module rerun, or MissingPackage with the extra that brings it."""
    try:
        import rerun
        import rerun.blueprint
    except ImportError:
        raise MissingPackage("Rerun needs rerun-sdk: install tcc_sim[view]") from None
    return rerun
