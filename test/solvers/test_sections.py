"""Section points of many motions in one call: as each solved by itself, and NaN behind a failure."""

import numpy as np
import pytest

from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.solvers.stroboscopic import SCALES, sections
from tcc_sim.trajectory import Orbits, State

FALLING = {"friction.kinetic_coefficient": 0.225, "engine.frequency": 120.0, "pressure.frequency_ratio": 0.5}


@pytest.mark.parametrize(("law", "rtol"), [("smoothed", 1e-8), ("set_valued", 1e-10)])
@pytest.mark.parametrize("values", [{}, {**FALLING, "pressure.amplitude": 0.0}, {**FALLING, "pressure.amplitude": 3e5}])
def test_each_motion_is_as_solved_by_itself(law, rtol, values):
    system = replace(System(), {"friction.law": law, **values})
    starts = np.array([[0.0, 0.1, 0.0], [120.0, 0.05, -3.0], [-40.0, 0.2, 1.0], [0.01, 0.1, 0.0]])
    found = sections(system, starts, 3, 5, rtol)
    assert found.shape == (4, 6, 3)
    for start, points in zip(starts, found):
        alone = solve(system, cycles=5, start_cycle=3, state=State(*start), rtol=rtol).cycles.section
        np.testing.assert_allclose(points, alone, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_what_cannot_be_solved_is_nan_and_harms_no_other(law):
    system = replace(System(), {"friction.law": law})
    starts = np.array([[0.0, 1e308, 1e308], [50.0, 0.1, 0.0]])
    found = sections(system, starts, 0, 3, 1e-8)
    assert np.isnan(found[0, 1:]).all()
    np.testing.assert_array_equal(found[1], sections(system, starts[1:], 0, 3, 1e-8)[0])


@pytest.mark.parametrize(("law", "rtol"), [("smoothed", 1e-8), ("set_valued", 1e-10)])
def test_a_motion_ends_behind_two_points_by_places_that_follow_each_other_at_their_phase(law, rtol):
    system = replace(System(), {"friction.law": law, **FALLING})
    start = np.array([[120.0, 0.05, -3.0]])
    whole = sections(system, start, 3, 8, rtol)[0]
    points, reach = whole[[6, 5]] / SCALES, np.full(2, 1e-10)
    for cycle, following, end in (([1, 0], [1, 0], 6), ([0, 1], [1, 0], 8), ([1, 0], [0, 1], 8)):
        orbits = Orbits(points, reach, np.array(cycle), np.array(following), 2)
        found = sections(system, start, 3, 8, rtol, orbits)[0]
        np.testing.assert_allclose(found[:end + 1], whole[:end + 1], rtol=0.0, atol=1e-6)
        assert np.isnan(found[end + 1:]).all()
