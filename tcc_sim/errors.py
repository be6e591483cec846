"""Every exception of the package. Wrong input ends a command with status 2, anything else with status 1."""

from __future__ import annotations

from typing import Any


class TccError(Exception):
    """Base of every exception that this package raises on purpose."""


class InputError(TccError, ValueError):
    """Wrong input: the sentence names the value, its unit and the allowed range."""


class RecordingError(InputError):
    """A recording that cannot be read, or an output that must not be written."""


class NumericalFailure(TccError, ArithmeticError):
    """A solver stopped before the end; `status` says why in a sentence."""


class MissingPackage(TccError, ImportError):
    """An optional package is not installed; the sentence names the extra that brings it."""


class SweepInterrupted(KeyboardInterrupt):
    """Ctrl-C during a sweep; `sweeps` holds what was done until then."""

    def __init__(self, sweeps: list[Any]) -> None:
        super().__init__("interrupted")
        self.sweeps = sweeps
