"""Every exception of the package. Wrong input ends a command with status 2, anything else with status 1."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable
from pathlib import Path
from typing import Any

LONGEST_SENTENCE = 1000
"""Characters of a refusal; what wrong input holds beyond that is left out."""


def printable(text: str) -> str:
    """`text` in printable characters, the others escaped: everything that comes from a file, a topic or a command line
    passes through here before it reaches a terminal.
    """
    return text if text.isprintable() else "".join(c if c.isprintable() else c.encode("unicode_escape").decode()
                                                   for c in text)


def one_line(text: str) -> str:
    """`text` in printable characters; the middle of what is too long is left out."""
    if len(text) > LONGEST_SENTENCE:
        half = LONGEST_SENTENCE // 2
        text = f"{text[:half]} ... {text[-half:]}"
    return printable(text)


def counted(number: int, thing: str) -> str:
    """A number and what it counts: 1 message, 2 messages, 3 branches."""
    return f"{number} {thing}{'' if number == 1 else 'es' if thing.endswith('ch') else 's'}"


class TccError(Exception):
    """Base of every exception that this package raises on purpose."""


class InputError(TccError, ValueError):
    """Wrong input: the sentence names the value, its unit and the allowed range, in one line whatever the input was."""

    def __init__(self, sentence: object) -> None:
        super().__init__(one_line(str(sentence)))


class RecordingError(InputError):
    """A recording that cannot be read, or an output that must not be written."""


class NumericalFailure(TccError, ArithmeticError):
    """A solver stopped before the end; `status` says why in a sentence."""


class MissingPackage(TccError, ImportError):
    """An optional package is not installed; the sentence names the extra that brings it."""


def check_folder(path: Path) -> None:
    """Raise InputError where a file has no directory to be in."""
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no directory {path.parent}")


def check_suffix(path: Path, suffixes: Iterable[str], prefix: str = "") -> None:
    """Raise InputError where a file has none of some suffixes; `prefix` stands before its name in the sentence."""
    *first, last = suffixes
    if path.suffix not in (*first, last):
        raise InputError(f"{prefix}{path} must end in {', '.join(first)}{' or ' if first else ''}{last}")


EXTRAS = {"matplotlib": ("matplotlib", "view"), "rerun": ("rerun-sdk", "view"),
          "distributed": ("distributed", "cluster"), "pandas": ("pandas", "table")}
"""Optional packages by the name of their module: name for pip, and the extra that brings it."""


def require(module: str, what: str) -> None:
    """Raise MissingPackage where an optional package is not installed; call it before anything is computed or written.

    Parameters
    ----------
    module : a key of EXTRAS
    what : that needs it, for the sentence
    """
    if importlib.util.find_spec(module) is None:
        package, extra = EXTRAS[module]
        raise MissingPackage(f"{what} needs {package}, which is not installed; "
                             f"pip install 'tcc_sim[{extra}]' brings it")


class WorkersLost(TccError):
    """Those who did the work are gone; `sweeps` holds what a sweep had done until then."""

    def __init__(self, sentence: str) -> None:
        super().__init__(sentence)
        self.sweeps: list[Any] = []


class SweepInterrupted(KeyboardInterrupt):
    """Ctrl-C during a sweep; `sweeps` holds what was done until then."""

    def __init__(self, sweeps: list[Any]) -> None:
        super().__init__("interrupted")
        self.sweeps = sweeps


class BasinsInterrupted(KeyboardInterrupt):
    """Ctrl-C while basins were worked out; what was done stands in their file, where one was given."""

    def __init__(self) -> None:
        super().__init__("interrupted")
