"""Fixtures of the study's tests."""

from pictures import drawn

__all__ = ["drawn"]
