"""Methods that others would use: SciPy's, and classical Runge-Kutta. For comparison, not for work."""
