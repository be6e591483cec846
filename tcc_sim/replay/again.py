"""The picture of `analyse` again, from its JSON: the recording that it names is read once more."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tcc_sim.recording.window import Window
from tcc_sim.replay.recorded import read
from tcc_sim.replay.replay import replay
from tcc_sim.views import style
from tcc_sim.views.plots import plot
from tcc_sim.views.stored import Record, option_of


def draw_again(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw what `analyse --plot` draws; InputError or RecordingError where the recording is not there any more."""
    words = values.command
    run, discard = (None if (text := option_of(words, name)) is None else int(text) for name in ("--run", "--discard"))
    start, end, frequency = (None if (text := option_of(words, name)) is None else float(text)
                             for name in ("--from", "--to", "--frequency"))
    recording = read(words[1], option_of(words, "--scene"))
    found: Any = replay(recording, discard=discard, frequency=frequency, window=Window(run, start, end))
    if found.scene.system.profile is not None:
        found = recording.trajectory(found.run, start, end)
    drawn: Path = plot(found, path, "page" if style.wide(width) else "column", title=title, force=True)
    return drawn
