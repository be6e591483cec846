"""The tableau of the three-stage Radau IIA method against what defines it."""

import numpy as np
import pytest

from tcc_sim.solvers.radau_step import FILTER, MATRIX, NODES


def test_it_is_the_collocation_method_of_radaus_nodes():
    """Its nodes are the roots of the second derivative of x^2 (x - 1)^3, and it integrates x^0 to x^2 exactly."""
    polynomial = np.polynomial.Polynomial([0.0, 0.0, 1.0]) * np.polynomial.Polynomial([-1.0, 1.0]) ** 3
    assert np.sort(polynomial.deriv(2).roots().real) == pytest.approx(np.asarray(NODES), abs=1e-7)
    for k in range(3):
        assert MATRIX @ np.asarray(NODES) ** k == pytest.approx(np.asarray(NODES) ** (k + 1) / (k + 1), abs=1e-14)


def test_the_filter_of_the_error_is_its_real_eigenvalue():
    """Hairer and Wanner, IV.8: the error estimate is multiplied with (I - h gamma0 J)^-1."""
    values = np.linalg.eigvals(MATRIX)
    assert float(values[np.abs(values.imag) < 1e-12].real[0]) == pytest.approx(FILTER, rel=1e-13)
