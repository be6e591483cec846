"""Many runs by one compiled call are those of `solve`, each by itself."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest

from tcc_sim.model.parameters import System, replace
from tcc_sim.solvers import solve
from tcc_sim.solvers.runs import solve_runs
from tcc_sim.trajectory import State

FIG02 = {"pressure.mean": 260417.0, "pressure.amplitude": 52083.4, "friction.kinetic_coefficient": 0.24,
         "pressure.frequency_ratio": 0.5}
STATES = [State(5.0, 0.1, -5.0), State(-40.0, 0.0, 2.0), State(0.0, 0.1, 0.0)]


@pytest.mark.parametrize("law", ["smoothed", "set_valued"])
def test_many_runs_are_those_of_a_solve_each(law) -> None:
    """Of more and fewer runs, cycles and starts than in the call before."""
    systems = [replace(System(), {**FIG02, "friction.law": law, "engine.frequency": 110.0 + 20.0 * k})
               for k in range(3)]
    for many, cycles, first, rtol, loads_from in ((2, 3, [0, 1], None, 3), (3, 4, [0, 1, 2], 1e-9, 2),
                                                  (1, 2, [3], 1e-6, 0), (3, 2, [5, 0, 1], None, 1)):
        result = solve_runs(systems[:many], STATES[:many], first, cycles, rtol, loads_from)
        assert result.solver == ("smoothed" if law == "smoothed" else "event_driven")
        assert result.done.tolist() == [True] * many
        for k in range(many):
            run = solve(systems[k], cycles=cycles, state=STATES[k], start_cycle=first[k], rtol=rtol,
                        loads_from=loads_from)
            for one, other in zip(astuple(result.cycles(k))[:4], astuple(run.cycles)[:4]):
                np.testing.assert_array_equal(one, other)
            np.testing.assert_array_equal(result.loads[k], run.cycles.loads.columns())
            assert np.isnan(result.loads[k]).all(axis=0).tolist() == [n < loads_from for n in range(cycles)]


def test_a_run_that_fails_is_marked_and_leaves_the_others() -> None:
    systems = [replace(System(), FIG02)] * 2
    result = solve_runs(systems, [State(0.0, 1e308, 1e308), STATES[0]], [0, 0], 3, None, 0)
    assert result.done.tolist() == [False, True]
    np.testing.assert_array_equal(result.section[1], solve(systems[1], cycles=3, state=STATES[0]).cycles.section)
