"""Measurements: error against run time, extreme cases, other programs, pacing; with their drawings.
"""
