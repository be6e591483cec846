"""Settling a motion: until it repeats, until a caller closes its orbit, or until it is given up."""

from __future__ import annotations

import numpy as np

from tcc_sim.model.parameters import replace
from tcc_sim.scene import load_scene
from tcc_sim.sweeps.steady_state import Settling, Start, settle
from tcc_sim.trajectory import State, Status

FAST = replace(load_scene("slip").system, {"friction.law": "set_valued"})
BEGIN = Start(State(150.0, 0.0, 0.0), 3)


def test_a_motion_is_solved_until_its_section_repeats() -> None:
    found = settle(FAST, BEGIN)
    assert found.cycles is not None
    assert found.after is not None
    section = found.cycles.section
    assert np.abs(section[found.after:] - section[-1]).max() < 1e-5 * 170.0
    assert found.end == (State(*section[-1]), 3 + len(found.cycles))


def test_a_motion_that_does_not_settle_is_given_up() -> None:
    found = settle(load_scene("chaos").system, BEGIN, Settling(most=110))
    assert found.cycles is not None
    assert (len(found.cycles), found.after, found.run.status) == (110, None, Status.DONE)


def test_a_closed_orbit_ends_it() -> None:
    asked = []

    def closed(state: State, cycle: int, period: int) -> State | None:
        asked.append((cycle, period))
        return State(1.0, 2.0, 3.0) if cycle >= 103 else None

    found = settle(load_scene("chaos").system, BEGIN, closed=closed)
    assert found.end == (State(1.0, 2.0, 3.0), 103)
    assert [cycle for cycle, _ in asked] == [53, 78, 103]
