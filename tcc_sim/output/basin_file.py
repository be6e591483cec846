"""The labels and cycles of basins as a NumPy file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.basins.compute import Axis, Basins
from tcc_sim.output.files import draft


def write_basins(path: Path, found: Sequence[Basins], over: Axis | None) -> None:
    """Write `labels` and `cycles`, (second, first) arrays, and the values of both axes; `over` adds a first axis.

    Labels: -1 undecided, -2 runaway, else an index into the attractors of the JSON.
    """
    labels, cycles = np.stack([one.labels for one in found]), np.stack([one.cycles for one in found])
    first, second = found[0].plane
    arrays: dict[str, Any] = {"first_values": np.array(first.values), "second_values": np.array(second.values)}
    if over is None:
        labels, cycles = labels[0], cycles[0]
    else:
        arrays["over_values"] = np.array(over.values)
    with draft(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, labels=labels, cycles=cycles, **arrays)
