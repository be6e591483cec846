"""Measurements: error against run time, extreme cases, other programs, pacing and endurance; with their drawings.
"""
