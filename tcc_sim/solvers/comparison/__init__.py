"""Methods for comparison: SciPy's, and classical Runge-Kutta."""
