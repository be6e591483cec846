"""Exceptions of the package, and the text of messages. Wrong input ends a command with status 2, others with 1."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

LONGEST_SENTENCE = 1000
"""Longest error message, characters; the middle of a longer one is left out."""


def printable(text: str) -> str:
    """Return `text` with unprintable characters escaped.

    Text from a file, a topic or a command line passes through this function before it reaches a terminal.
    """
    return text if text.isprintable() else "".join(c if c.isprintable() else c.encode("unicode_escape").decode()
                                                   for c in text)


def one_line(text: str) -> str:
    """Return `text` in printable characters, without its middle if it is too long."""
    if len(text) > LONGEST_SENTENCE:
        half = LONGEST_SENTENCE // 2
        text = f"{text[:half]} ... {text[-half:]}"
    return printable(text)


def counted(number: int, thing: str) -> str:
    """Return a number with its noun: 1 message, 2 messages, 3 branches."""
    return f"{number} {thing}{'' if number == 1 else 'es' if thing.endswith('ch') else 's'}"


def given_in(options: Mapping[str, object]) -> list[str]:
    """Return the names of the options that are given: all but those that are None or off; 0 is given."""
    return [name for name, value in options.items() if value is not None and value is not False]


class TccError(Exception):
    """Base class of the exceptions of this package."""


class InputError(TccError, ValueError):
    """Wrong input. The message names the value, its unit and the allowed range, always in one line."""

    def __init__(self, sentence: object) -> None:
        super().__init__(one_line(str(sentence)))


class OutOfRange(InputError):
    """Wrong input that a search may meet: a value out of its range, one that needs more steps than a method allows, or
    one without a motion of the requested kind.
    """


class RecordingError(InputError):
    """A recording cannot be read, or an output must not be written."""


class NumericalFailure(TccError, ArithmeticError):
    """A solver stopped before the end; the message gives the reason."""


class MissingPackage(TccError, ImportError):
    """An optional package is not installed; the message names the extra of this package that installs it."""


def check_folder(path: Path) -> None:
    """Raise InputError if the directory of a file does not exist."""
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no directory {path.parent}")


def check_suffix(path: Path, suffixes: Iterable[str], prefix: str = "") -> None:
    """Raise InputError if a file has none of the suffixes; `prefix` precedes its name in the message."""
    *first, last = suffixes
    if path.suffix not in (*first, last):
        raise InputError(f"{prefix}{path} must end in {', '.join(first)}{' or ' if first else ''}{last}")


EXTRAS = {"matplotlib": ("matplotlib", "view"), "rerun": ("rerun-sdk", "view"),
          "distributed": ("distributed", "cluster"), "pandas": ("pandas", "table"),
          "pyarrow": ("pyarrow", "table"), "asammdf": ("asammdf", "mf4"), "fmpy": ("FMPy", "fmu"),
          "nptdms": ("npTDMS", "tdms"), "rosbags": ("rosbags", "bags")}
"""Optional packages by module: name for pip, and the extra of this package that installs it."""


def require(module: str, what: str) -> None:
    """Raise MissingPackage if an optional package is not installed; call this before any computation.

    module : a key of EXTRAS
    what : option or output that needs the package, for the message
    """
    if importlib.util.find_spec(module) is None:
        package, extra = EXTRAS[module]
        raise MissingPackage(f"{what} needs {package}, which is not installed; "
                             f"pip install 'tcc_sim[{extra}]' brings it")


REQUIRED = {"numpy": "numpy", "scipy": "scipy", "numba": "numba", "llvmlite": "numba", "yaml": "PyYAML", "tqdm": "tqdm",
            "mcap": "mcap", "zstandard": "zstandard", "lz4": "lz4"}
"""Packages that this one always needs, by module: the name for pip."""


def missing_package(error: ModuleNotFoundError) -> MissingPackage | None:
    """Return what to say where a package is absent that pip would have installed; None for any other module."""
    package = REQUIRED.get((error.name or "").partition(".")[0])
    if package is None:
        return None
    recording = dict.fromkeys(("mcap", "lz4", "zstandard"), "'mcap>=1.5,<2' lz4 zstandard")
    wanted = {"numba": "'numba>=0.62,<0.69'", **recording}.get(package, package)
    return MissingPackage(f"the Python package {package} is not installed; python3 -m pip install {wanted} brings it "
                          "(into a virtual environment made with --system-site-packages where pip refuses)")


class WorkersLost(TccError):
    """All workers of a sweep are gone; `sweeps` holds the results up to then."""

    def __init__(self, sentence: str) -> None:
        super().__init__(sentence)
        self.sweeps: list[Any] = []


class SweepInterrupted(KeyboardInterrupt):
    """Ctrl-C during a sweep; `sweeps` holds the results up to then."""

    def __init__(self, sweeps: list[Any]) -> None:
        super().__init__("interrupted")
        self.sweeps = sweeps
