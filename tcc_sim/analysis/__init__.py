"""Trajectory or recording -> plain frozen results: maxima, sections, periods, regimes, damping."""
