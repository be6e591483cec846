"""Drawing of a figure of the paper from its JSON."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tcc_sim.paper.drawings import draw
from tcc_sim.views.stored import Record

ARRAYS = ("t", "slip_speed", "plate_angle", "friction_torque", "engine_torque", "saturation_torque", "state",
          "coefficient", "slope", "near_slip_speed", "near_coefficient", "near_slope", "near_set_valued")
"""Keys of the samples of curves and panels."""
NUMBERS = ("peak_slip_speed", "first_half")
"""Keys of numbers for which null in JSON means NaN."""


def draw_stored(path: Path, values: Record, title: str, width: float) -> Path:
    """Draw a figure from its JSON."""
    for part in (values, *(values.curves or ()), *(values.panels or ()), *(values.steady or ())):
        for name in ARRAYS:
            if isinstance(getattr(part, name), list):
                vars(part)[name] = np.array([np.nan if x is None else x for x in getattr(part, name)])
        vars(part).update({name: np.nan for name in NUMBERS if name in part and part[name] is None})
        vars(part)["behind"] = part if part.branches is not None else None
    vars(values)["numbers"] = values
    draw(values, path, title, width)  # type: ignore[arg-type]
    return path
