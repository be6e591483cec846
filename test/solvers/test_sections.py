"""Section points of many motions in one call: as each solved by itself, and NaN behind a failure."""

import numpy as np
import pytest

from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.solvers.event_driven import sections as event_driven_sections
from tcc_sim.solvers.smoothed import sections
from tcc_sim.trajectory import State

FALLING = {"friction.kinetic_coefficient": 0.225, "engine.frequency": 120.0, "pressure.frequency_ratio": 0.5}


@pytest.mark.parametrize(("law", "of", "rtol"), [("smoothed", sections.sections, 1e-8),
                                                 ("set_valued", event_driven_sections.sections, 1e-10)])
@pytest.mark.parametrize("values", [{}, {**FALLING, "pressure.amplitude": 0.0}, {**FALLING, "pressure.amplitude": 3e5}])
def test_each_motion_is_as_solved_by_itself(law, of, rtol, values):
    system = replace(System(), {"friction.law": law, **values})
    starts = np.array([[0.0, 0.1, 0.0], [120.0, 0.05, -3.0], [-40.0, 0.2, 1.0], [0.01, 0.1, 0.0]])
    found = of(system, starts, 3, 5, rtol)
    assert found.shape == (4, 6, 3)
    for start, points in zip(starts, found):
        alone = solve(system, cycles=5, start_cycle=3, state=State(*start), rtol=rtol).cycles.section
        np.testing.assert_allclose(points, alone, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("law", "of"), [("smoothed", sections.sections),
                                          ("set_valued", event_driven_sections.sections)])
def test_what_cannot_be_solved_is_nan_and_harms_no_other(law, of):
    system = replace(System(), {"friction.law": law})
    starts = np.array([[0.0, 1e308, 1e308], [50.0, 0.1, 0.0]])
    found = of(system, starts, 0, 3, 1e-8)
    assert np.isnan(found[0, 1:]).all()
    np.testing.assert_array_equal(found[1], of(system, starts[1:], 0, 3, 1e-8)[0])
