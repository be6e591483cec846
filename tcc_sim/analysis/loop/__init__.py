"""A run under control -> target, errors, manoeuvres, and the verdict on its end."""

BAND = 0.1
"""Least band that counts as settled, and least jump of a target and amplitude of an oscillation that count, rad/s."""
