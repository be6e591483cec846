"""Draw the picture of `analyse` again from its JSON, by reading the recording named there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tcc_sim.recording.window import Window
from tcc_sim.replay.recorded import read
from tcc_sim.replay.replay import replay
from tcc_sim.views import style
from tcc_sim.views.plots import plot
from tcc_sim.views.stored import Record, arguments_in


def draw_again(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw what `analyse --plot` draws; raise InputError or RecordingError if the recording no longer exists."""
    given = arguments_in(vars(values))
    recording = read(given.recording, given.scene, given.joints)
    found: Any = replay(recording, discard=given.discard, frequency=given.frequency,
                        window=Window(given.run, given.start, given.end))
    if found.scene.system.profile is not None:
        found = recording.trajectory(found.run, given.start, given.end)
    drawn: Path = plot(found, path, "page" if style.wide(width) else "column", title=title, force=True)
    return drawn
