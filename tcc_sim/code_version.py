"""Version of the running code, which results, recordings and resumable files carry."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from pathlib import Path

from tcc_sim import __version__

CHANGED_STATES = {
    (1, 1, 0): "states of a driveline in their last bits (rounding of ticks), of one with a friction table by up to "
               "1e-7 of the largest friction torque (its fit)"}
"""Recorded values that a release computes otherwise than the one before; the changelog has all figures."""


@cache
def code_version() -> str:
    """Return the release, with a digest of the package's text as its local label, such as "1.1.0+3f2a9c1b".

    Two versions are equal where the package's files have the same text, so an edited or unreleased copy differs from
    the release.
    """
    package, text = Path(__file__).parent, sha256()
    for path in sorted(path for kind in ("*.py", "*.c", "*.h", "*.yaml") for path in package.rglob(kind)):
        text.update(path.relative_to(package).as_posix().encode())
        text.update(path.read_bytes().replace(b"\r\n", b"\n"))
    return f"{__version__}+{text.hexdigest()[:8]}"


def differences_from(version: str) -> str:
    """Return a sentence on the recorded values that may differ between a version and this one; empty if both are equal.

    Parameters
    ----------
    version : version that a recording states; empty if it states none
    """
    if version == code_version():
        return ""
    head = f"recorded by {version or 'an unknown version'}, solved by {code_version()}: "
    here, there = _release(code_version()), _release(version)
    if there is None or here is None:
        return f"{head}which values differ between them is not known"
    if there > here:
        return f"{head}this one is older and does not know which values differ"
    changes = [change for release, change in sorted(CHANGED_STATES.items()) if there < release <= here]
    return f"{head}{'; '.join(changes)} may differ" if changes else f"{head}no recorded value is known to differ"


def _release(version: str) -> tuple[int, ...] | None:
    """Return the numbers of a release; None for a text of another form."""
    numbers = version.partition("+")[0].split(".")
    return tuple(map(int, numbers)) if all(one.isdecimal() and one.isascii() for one in numbers) else None
