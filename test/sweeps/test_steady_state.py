"""Settling a motion until it repeats, or until a limit."""

from __future__ import annotations

import numpy as np

from tcc_sim.model.parameters import replace
from tcc_sim.scene import load_scene
from tcc_sim.sweeps.steady_state import Start, solve_to_steady_state
from tcc_sim.trajectory import State, Status

FAST = replace(load_scene("slip").system, {"friction.law": "set_valued"})
BEGIN = Start(State(150.0, 0.0, 0.0), 3)


def test_a_motion_is_solved_until_its_section_repeats() -> None:
    found = solve_to_steady_state(FAST, BEGIN, 4800)
    assert found.after is not None
    section = found.cycles.section
    assert np.abs(section[found.after:] - section[-1]).max() < 1e-5 * 170.0


def test_a_motion_that_does_not_settle_is_given_up() -> None:
    found = solve_to_steady_state(load_scene("chaos").system, BEGIN, 110)
    assert found.cycles is not None
    assert (len(found.cycles), found.after, found.run.status) == (110, None, Status.DONE)
