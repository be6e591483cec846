"""Polynomials over a step: values, crossings and extremes, found with certainty."""
