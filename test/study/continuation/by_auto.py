"""Values of mu_k/mu_s at which AUTO-07p finds bifurcations of the smoothed law at omega/omega_n = 0.36 under a constant
load of 225 kPa: the table in `.github/paper/motions.md`.
"""

DOUBLING = 0.777332549
"""Motion of period one."""
FOLDS = 0.667984629, 0.918464437
"""Motion of period two."""
