"""Layout file beside a recording, with which Rerun shows the signals of the MCAP file without conversion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tcc_sim import topics
from tcc_sim.errors import InputError
from tcc_sim.topics import FLOAT64, FLUID_PRESSURE, INT8, Topic
from tcc_sim.views.rerun_layout import rerun

SUFFIX = ".rbl"
PARTS = {FLOAT64: ("std_msgs.msg.Float64:message", ".data"), INT8: ("std_msgs.msg.Int8:message", ".data"),
         FLUID_PRESSURE: ("Measurements:values", None)}
"""Component that Rerun's MCAP reader makes of a message, and the selector of its number, by message type."""
PANELS = {"Slip speed (rad/s)": ("slip", "control"), "Torques (N m)": ("torque",),
          "Stick and slip: -1, 0, 1": ("state",), "Actuation pressure (Pa)": ("pressure",),
          "Far end of the shaft (rad/s)": ("far_end",)}
"""Panels of `Topic.view` in each time series view."""
JOINTS = "/joint_states"
"""Topic that Rerun draws as lines without a mapping."""


def views() -> dict[str, tuple[str, ...]]:
    """Return the topics of each time series view; a topic whose panel has none gets one."""
    rows = [row for row in topics.TOPICS if row.view and row.type in PARTS]
    known = {panel for panels in PANELS.values() for panel in panels}
    further = {f"{row.name.replace('_', ' ').capitalize()} ({row.unit})": (row.panel,) for row in rows
               if row.panel not in known}
    return {title: tuple(f"/{row.name}" for row in rows if row.panel in panels)
            for title, panels in (PANELS | further).items()}


def layout_path(recording: Path) -> Path:
    """Return the path of a recording's layout: its first MCAP file with another suffix.

    Raises
    ------
    InputError
        No MCAP file is there.
    """
    files = [recording] if recording.is_file() else sorted(recording.glob("*.mcap"))
    if not files:
        raise InputError(f"{recording} holds no MCAP file")
    return files[0].with_suffix(SUFFIX)


def write_layout(recording: Path) -> Path:
    """Write the layout beside a recording, and return its path.

    Rerun applies a layout to the application of its name, which is the stem of an MCAP file.

    Parameters
    ----------
    recording : an MCAP file, or a directory with one

    Raises
    ------
    InputError
        No MCAP file is there, the layout exists, or it cannot be written.
    MissingPackage
        rerun-sdk is not installed.
    """
    path = layout_path(recording)
    rrb = rerun().blueprint
    shown_views = [rrb.TimeSeriesView(origin="/", name=name, contents=list(given),
                                overrides={topic: _style_of_line(_row(topic)) for topic in given})
             for name, given in views().items()]
    shown_views.append(rrb.TimeSeriesView(origin=JOINTS, name="Joint states"))
    shown = rrb.Blueprint(rrb.Vertical(*shown_views), collapse_panels=True, auto_views=False)
    try:
        path.open("xb").close()
        shown.save(path.stem, str(path))
    except FileExistsError:
        raise InputError(f"{path} exists already and is not overwritten") from None
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from None
    return path


def _row(path: str) -> Topic:
    return next(row for row in topics.TOPICS if row.name == path[1:])


def _style_of_line(row: Topic) -> Any:
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    component, selector = PARTS[row.type]
    return rerun().SeriesLines(names=row.name.replace("_", " ")).visualizer(mappings=[VisualizerComponentMapping(
        "Scalars:scalars", source_kind=ComponentSourceKind.SourceComponent, source_component=component,
        selector=selector)])
