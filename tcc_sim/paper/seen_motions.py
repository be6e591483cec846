"""The motions that sweeps came to, settled where they settle at all, and the branches through them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from tcc_sim.paper.evidence import LATER, later
from tcc_sim.studies.branches import Branch
from tcc_sim.studies.driveline_map import DrivelineMap
from tcc_sim.studies.progress import progress_bar
from tcc_sim.studies.shooting import Window
from tcc_sim.studies.survey import LONGEST, Seen, survey
from tcc_sim.studies.sweep import Curve, Sweep


def seen_in(sweep: Sweep) -> list[Seen]:
    """The motions of a sweep; what has not settled within its cycles goes on, as the claims have it."""
    return [seen for k in range(len(sweep.curve.values)) if (seen := _seen(sweep, k)) is not None]


def _seen(sweep: Sweep, k: int) -> Seen | None:
    """One motion of a sweep, settled where it settles at all."""
    value, record = sweep.curve.values[k], sweep.records[k]
    if record is None or record["max_slip_speed"] is None:
        return None
    if record.get("settled", True):
        return Seen(value, np.array(record["final"]), record["final_cycle"], record["period"], record["max_slip_speed"])
    settled = later(sweep.curve.at(k), record)
    if settled is None:
        return None
    found, final = settled
    return Seen(value, np.array([final.slip_speed, final.plate_angle, final.plate_speed]),
                record["final_cycle"] + LATER, found.period if found.settled else 0, found.max_slip_speed)


def surveyed(curve: Curve, seen: Sequence[Seen], progress: bool = False, longest: int = LONGEST) -> list[Branch]:
    """The branches through motions along a curve, over the range of its values.

    Parameters
    ----------
    progress : show a count of points on a terminal
    longest : period followed, in periods of the excitation
    """
    of = DrivelineMap(curve.system, (curve.key,))
    with counted(progress) as tick:
        return survey(of, Window(min(curve.values), max(curve.values)), curve.key, seen, tick,
                      longest=longest)


@contextmanager
def counted(progress: bool) -> Iterator[Callable[[Any], None]]:
    """A function to call with every point; it moves a count where that is wanted and standard error is a terminal."""
    with progress_bar("point", shown=progress) as bar:
        def tick(station: Any) -> None:
            bar.set_postfix_str(f"{station.value:.6g}, period {station.orbit.period}", refresh=False)
            bar.update()

        yield tick
