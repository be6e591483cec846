"""Version of the running code, which results, recordings and resumable files carry."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from pathlib import Path

from tcc_sim import __version__


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
