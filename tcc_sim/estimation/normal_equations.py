"""Normal equations of multiple shooting: a band for the windows' starts with a border for the parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from tcc_sim.trajectory import Floats


class Normal(NamedTuple):
    """Normal equations of m windows, each of which depends on its start, the next start and the P parameters.

    diagonal : (m, 3, 3) of the starts
    following : (m - 1, 3, 3) of a start (rows) and the next one (columns)
    border : (m, 3, P) of the starts and the parameters
    corner : (P, P) of the parameters
    slope, slope_by_key : (m, 3), (P,) right-hand sides
    """

    diagonal: Floats
    following: Floats
    border: Floats
    corner: Floats
    slope: Floats
    slope_by_key: Floats

    def holding(self, held: NDArray[np.bool_]) -> Normal:
        """Return the equations with some parameters, (P,), held."""
        free = ~held
        return self._replace(border=self.border * free, corner=self.corner * np.outer(free, free) + np.diag(1.0 * held),
                             slope_by_key=self.slope_by_key * free)

    def solved(self, damping: float) -> tuple[Floats, Floats]:
        """Return steps of the starts and of the parameters with Levenberg's damping; raise LinAlgError if singular."""
        solved = self.by_starts(damping)
        squares, slope = self.by_keys(solved, damping)
        by_key = -np.linalg.inv(squares) @ slope
        return -solved[..., -1] - solved[..., :-1] @ by_key, by_key

    def by_starts(self, damping: float) -> Floats:
        """Solve the starts' equations for the columns of the parameters and for the slope, (m, 3, P + 1)."""
        m, size = len(self.diagonal), len(self.corner)
        banded = np.zeros((6, 3 * m))   # as SciPy's solveh_banded takes it: the diagonal is the last row
        for i in range(3):
            for j in range(3):
                if j >= i:
                    banded[5 + i - j, j::3] = self.diagonal[:, i, j]
                banded[2 + i - j, 3 + j::3] = self.following[:, i, j]
        banded[5] *= 1.0 + damping
        banded[5] += 1e-300
        right = np.concatenate([self.border.reshape(3 * m, size), self.slope.reshape(3 * m, 1)], axis=1)
        return np.asarray(solveh_banded(banded, right)).reshape(m, 3, size + 1)

    def by_keys(self, solved: Floats, damping: float) -> tuple[Floats, Floats]:
        """Return the equations of the parameters (P, P), (P,) after the elimination of the starts, `by_starts`."""
        size = len(self.corner)
        both = np.concatenate(self.border).T @ np.concatenate(solved)
        corner = self.corner + damping * np.diag(np.diag(self.corner))
        return corner - both[:, :size], self.slope_by_key - both[:, size]
