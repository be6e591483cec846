"""Layout of a run in Rerun: names, colours, the axes of the phase portrait, and the blueprint; and the layout file
beside a recording, with which Rerun shows the signals of the MCAP file without conversion.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.errors import InputError, require
from tcc_sim.topics import FLOAT64, FLUID_PRESSURE, INT8, TOPICS, Topic, shown
from tcc_sim.trajectory import Floats
from tcc_sim.views import style

ELAPSED = "elapsed"
"""Timeline of the views: simulation time that continues to rise when a reset sets simulation time back."""
SIMULATION = "sim_time"
STATES = {-1: ("slip -", style.RED), 0: ("stick", style.GREY), 1: ("slip +", style.BLUE)}
UNKNOWN = 9
"""State of a sample whose slip speed is unknown."""
SIGNALS = {"mean_slip": "control/mean", **{row.name: row.view for row in shown()}}
"""Entity paths of the signals of a controller's test: cycle means, and topics that hold each value until the next one.
"""
LINES = {**{row.view: (f"{row.name.replace('_', ' ')} ({row.unit})", style.PURPLE) for row in shown()},
         "slip/speed": ("slip speed (rad/s)", style.BLUE), "plate/angle": ("plate angle (rad)", style.GREEN),
         "plate_speed/speed": ("plate speed (rad/s)", style.PURPLE),
         "torque/engine": ("engine torque (N m)", style.ORANGE),
         "torque/friction": ("friction torque (N m)", style.BLUE),
         "torque/engine_command": ("engine torque commanded (N m)", style.YELLOW),
         "control/mean": ("cycle mean of the slip speed (rad/s)", style.BLUE),
         "control/target": ("target (rad/s)", style.RED), "pressure/applied": ("applied (Pa)", style.GREEN),
         "pressure/command": ("commanded (Pa)", style.ORANGE)}
"""Names and colours of lines, by entity path."""
MARKS = {"cycles/largest": ("largest slip speed (rad/s)", style.BLUE, "circle", 3.0),
         "cycles/smallest": ("smallest slip speed (rad/s)", style.RED, "circle", 3.0),
         "event/mark": ("event", style.RED, "diamond", 6.0)}
HISTORY_CYCLES = 8
"""Number of engine cycles before the cursor in the time series; zoom out to see more."""
CONTROL_CYCLES = 400
"""Number of engine cycles before the cursor in the views of target and pressure."""
PORTRAIT_CYCLES = 100
"""Number of engine cycles before the cursor in the phase portrait."""
ANGLE_TICKS, SPEED_TICKS = 2, 3
"""Number of intervals between ticks of the phase portrait's axes; its labels must not overlap at 1280 x 800 pixels."""
WIDTH = 2.1
"""Width of the phase portrait's box; its height is 1."""
BOUNDS = (-0.42, WIDTH + 0.2), (-0.28, 1.48)
"""Ranges of the view around the box, x and y (downwards), with room for the labels."""
PARTS = {FLOAT64: ("std_msgs.msg.Float64:message", ".data"), INT8: ("std_msgs.msg.Int8:message", ".data"),
         FLUID_PRESSURE: ("Measurements:values", None)}
"""Component that Rerun's MCAP reader makes of a message, and the selector of its number, by message type."""
VIEWS = {"Slip speed (rad/s)": ("slip", "control"), "Torques (N m)": ("torque",),
         "Stick and slip: -1, 0, 1": ("state",), "Actuation pressure (Pa)": ("pressure",),
         "Far end of the shaft (rad/s)": ("far_end",)}
"""Panels of `Topic.view` in each time series view."""


@dataclass(frozen=True)
class PhaseAxes:
    """Axes of the phase portrait by their ticks, rad and rad/s; the first and the last one are the ends of the box."""

    angle: tuple[float, ...]
    speed: tuple[float, ...]

    @staticmethod
    def around(low: Floats, high: Floats) -> PhaseAxes:
        """Return axes that contain `low` to `high`, (2,) arrays: plate angle (rad), slip speed (rad/s)."""
        least = np.maximum(1e-6 * np.maximum(np.abs(low), np.abs(high)), 1e-9)  # Single precision has seven digits.
        middle, half = 0.5 * (low + high), 0.5 * np.maximum(high - low, least)
        (left, right), (bottom, top) = zip((middle - half).tolist(), (middle + half).tolist())
        return PhaseAxes(_ticks(left, right, ANGLE_TICKS), _ticks(bottom, top, SPEED_TICKS))

    def hold(self, low: Floats, high: Floats) -> bool:
        """Return whether `low` to `high` is inside and not in a small part of either axis."""
        first, last = np.array([[ticks[0], ticks[-1]] for ticks in (self.angle, self.speed)]).T
        return bool(((first <= low) & (high <= last) & (high - low >= 0.3 * (last - first))).all())

    def transform(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return translation and scale that take (plate angle, -slip speed) into the box."""
        scale = WIDTH / (self.angle[-1] - self.angle[0]), 1.0 / (self.speed[-1] - self.speed[0])
        return (-self.angle[0] * scale[0], self.speed[-1] * scale[1]), scale

    def drawn(self) -> tuple[list[list[tuple[float, float]]], list[tuple[float, float]], list[str]]:
        """Return both axes as lines with a short line at every tick, and positions and texts of the labels at the ticks
        and of the names, which hang below their positions.
        """
        (right, down), (across, along) = self.transform()
        xs, ys = [right + across * a for a in self.angle], [down - along * v for v in self.speed]
        lines = [[(0.0, 0.0), (0.0, 1.0), (WIDTH, 1.0)], *([(x, 1.0), (x, 1.02)] for x in xs),
                 *([(0.0, y), (-0.02, y)] for y in ys)]
        places = [*((x, 1.11) for x in xs), *((-0.19, y - 0.07) for y in ys), (0.5 * WIDTH, 1.29), (0.1, -0.265)]
        return lines, places, [*(f"{x:.6g}" for x in (*self.angle, *self.speed)), "plate angle (rad)",
                               "slip speed (rad/s)"]


def _ticks(low: float, high: float, intervals: int) -> tuple[float, ...]:
    """Return round numbers at even distances, the first at or below `low` and the last at or above `high`."""
    raw = max(high - low, 1e-12) / intervals
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw * (1.0 - 1e-9))
    return tuple(k * step for k in range(math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9) + 1))


def blueprint(cycle: float, controlled: bool, least: float, topics: Collection[str], length: float) -> Any:
    """Return the blueprint: torques, slip, mode and plate on the left; portrait, maxima, events, summary on the right.

    In a test of a controller, its target and the pressures over more cycles replace the plate. The time series show
    `least` seconds, or HISTORY_CYCLES engine cycles where these are longer, but no more than the `length` of all runs,
    s, so that a short run fills them. Panels of further `topics` follow.
    """
    rrb = rerun().blueprint

    def before(cycles: float) -> tuple[Any, Any]:
        """Return the range from some engine cycles before the cursor to the cursor."""
        cursor = rrb.TimeRangeBoundary.cursor_relative
        return cursor(seconds=-min(max(cycles * cycle, least), length)), cursor(seconds=0.0)

    def history(origin: str, name: str, cycles: float = HISTORY_CYCLES, marked: bool = False) -> Any:
        """Return a time series that follows the cursor, optionally with the events marked in it."""
        legend = rrb.PlotLegend(visible=origin in ("torque", "control", "pressure"))
        contents = ["$origin/**", "/event/**"] if marked else "$origin/**"
        recent = rrb.TimeAxis(view_range=rrb.TimeRange(*before(cycles)))
        return rrb.TimeSeriesView(origin=origin, name=name, axis_x=recent, plot_legend=legend, contents=contents)

    plate = [history("plate", "Plate angle (rad)"), history("plate_speed", "Plate speed (rad/s)")]
    control = [history("control", "Target and cycle mean (rad/s)", CONTROL_CYCLES, marked=True),
               history("pressure", "Actuation pressure (Pa)", CONTROL_CYCLES)]
    rows = [history("torque", "Torques (N m)"), history("slip", "Slip speed (rad/s)", marked=True),
            rrb.StateTimelineView(origin="state", name="Stick and slip", time_view=rrb.TimeAxis(
                view_range=rrb.TimeRange(*before(HISTORY_CYCLES))))]
    further = {row.panel: title_of(row) for row in reversed(shown())
               if row.name in topics and row.panel not in ("torque", "slip", "control", "pressure")}
    last = [history(panel, title, CONTROL_CYCLES) for panel, title in further.items()]
    histories = rrb.Vertical(*rows, *(control if controlled else plate), *last,
                             row_shares=[3, 3, 1.6, *((3, 2.5) if controlled else (2, 2)), *(2 for _ in last)])
    start, end = before(PORTRAIT_CYCLES)
    figures = rrb.Vertical(
        rrb.Spatial2DView(origin="phase", name=f"Phase portrait and section of the last {PORTRAIT_CYCLES} cycles",
                          visual_bounds=rrb.VisualBounds2D(x_range=BOUNDS[0], y_range=BOUNDS[1]),
                          time_ranges=rrb.VisibleTimeRange(ELAPSED, start=start, end=end)),
        rrb.TimeSeriesView(origin="cycles", name="Largest and smallest slip speed of each cycle (rad/s)",
                           plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop)),
        *([rrb.Horizontal(*plate)] if controlled else []),
        rrb.Tabs(rrb.TextDocumentView(origin="summary", name="Summary"),
                 rrb.TextLogView(origin="events", name="Events")),
        row_shares=[4, 3, *([2] if controlled else []), 2])
    return rrb.Blueprint(rrb.Horizontal(histories, figures, column_shares=[3, 2]),
                         rrb.TimePanel(timeline=ELAPSED, state="collapsed", play_state="following"),
                         collapse_panels=True, auto_views=False)


def rgb(colour: str) -> list[int]:
    """Return the three bytes of #RRGGBB."""
    return [int(colour[k:k + 2], 16) for k in (1, 3, 5)]


def rerun() -> Any:
    """Return the module rerun; raise MissingPackage, which names the extra, if it is not installed."""
    require("rerun", "Rerun")
    import rerun
    import rerun.blueprint

    return rerun


def looks(controlled: bool) -> Iterator[tuple[str, Any]]:
    """Yield entity paths and components that are sent once: names, units and colours."""
    rr = rerun()
    for path, (name, colour) in LINES.items():
        held = {"interpolation_mode": "StepAfter"} if path in {row.view for row in shown()} else {}
        if controlled or not held or path.startswith("torque"):
            yield path, rr.SeriesLines(names=name, colors=rgb(colour), widths=1.5, **held)
    for path, (name, colour, marker, size) in MARKS.items():
        yield path, rr.SeriesPoints(names=name, colors=rgb(colour), markers=marker, marker_sizes=size)
    names, colours = zip(*STATES.values())
    yield "state", rr.StateConfiguration(values=names, labels=names, colors=list(map(rgb, colours)))
    yield "phase/orbit", rr.LineStrips2D.from_fields(colors=rgb(style.BLUE), radii=rr.Radius.ui_points(0.4))
    yield "phase/section", rr.Points2D.from_fields(colors=rgb(style.RED), radii=rr.Radius.ui_points(3.0))


def write_layout(recording: Path) -> Path:
    """Write the layout beside a recording, and return its path: the first MCAP file with the suffix .rbl.

    Rerun applies a layout to the application of its name, which is the stem of an MCAP file.

    recording : an MCAP file, or a directory with one

    Raise InputError: no MCAP file is there, the layout exists, or it cannot be written; MissingPackage: rerun-sdk is
    not installed.
    """
    files = [recording] if recording.is_file() else sorted(recording.glob("*.mcap"))
    if not files:
        raise InputError(f"{recording} holds no MCAP file")
    path, rrb = files[0].with_suffix(".rbl"), rerun().blueprint
    rows = [row for row in TOPICS if row.view and row.type in PARTS]
    views = {title: [row for row in rows if row.panel in panels] for title, panels in VIEWS.items()}
    views |= {title_of(row): [row] for row in rows if not any(row in part for part in views.values())}
    series = [rrb.TimeSeriesView(origin="/", name=title, contents=[f"/{row.name}" for row in part],
                                 overrides={f"/{row.name}": _line_of(row) for row in part})
              for title, part in views.items()]
    series.append(rrb.TimeSeriesView(origin="/joint_states", name="Joint states"))  # Rerun draws it without a mapping.
    blueprint = rrb.Blueprint(rrb.Vertical(*series), collapse_panels=True, auto_views=False)
    try:
        path.open("xb").close()
        blueprint.save(path.stem, str(path))
    except FileExistsError:
        raise InputError(f"{path} exists already and is not overwritten") from None
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from None
    return path


def title_of(row: Topic) -> str:
    """Return the title of a panel of one topic."""
    return f"{row.name.replace('_', ' ').capitalize()} ({row.unit})"


def _line_of(row: Topic) -> Any:
    """Return the look of a topic as a line, with the component of its messages."""
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    component, selector = PARTS[row.type]
    return rerun().SeriesLines(names=row.name.replace("_", " ")).visualizer(mappings=[VisualizerComponentMapping(
        "Scalars:scalars", source_kind=ComponentSourceKind.SourceComponent, source_component=component,
        selector=selector)])
