"""Periodic motions of scenes by other programs: multipliers by SciPy, and values by AUTO-07p."""

import numpy as np
from differences import difference
from oracle import tangent_map
from piecewise import Piecewise

from tcc_sim.model.parameters import replace

DOUBLING = 0.777332549
FOLDS = 0.667984629, 0.918464437
"""mu_k/mu_s at which the motion of period one doubles, and at which that of period two folds, for the smoothed law at
omega/omega_n = 0.36 under a constant load of 225 kPa: by AUTO-07p (the table in `.github/paper/motions.md`).
"""


def multipliers(system, x, cycles):
    """Floquet multipliers of the periodic motion through x at phase 0, which must close: from variational equations, or
    under the set-valued law from differences of the motion from event to event.
    """
    if system.friction.law == "smoothed":
        end, matrix = tangent_map(system, x, 0, cycles)
    else:
        def moved(y):
            start = dict(zip(("initial.slip_speed", "initial.plate_angle", "initial.plate_speed"), map(float, y)))
            length = cycles * system.cycle
            return Piecewise(replace(system, start)).run(length, np.array([length]), slices=12 * cycles)[0][-1, :3]

        end, held = moved(x), int(x[0] == 0.0)  # In stick the map is one of plate angle and speed.
        matrix = np.column_stack([difference(lambda d, u=unit: moved(x + d * u), step)[held:]
                                  for unit, step in list(zip(np.eye(3), (1e-3, 1e-5, 1e-3)))[held:]])
    np.testing.assert_allclose(end, x, rtol=1e-7, atol=1e-7)
    return np.linalg.eigvals(matrix)
