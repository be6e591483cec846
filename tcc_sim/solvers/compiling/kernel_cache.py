"""Compiled kernels on disk: in a directory of one's own, each file with a checksum, and never in the way.

Loading compiled code runs it, so the directory is used only if nobody else can write to it. Whatever is wrong with it
means one line on standard error and a kernel that is compiled without it.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

from tcc_sim.errors import one_line

Loaded = TypeVar("Loaded")

SECONDS_PER_BYTE = 1e-4
"""Compile time per byte of bytecode that a kernel reaches, s: measured on one core of 2.5 GHz, rounded."""
WORTH_SAYING = 1.0
"""Compile time, s, from which on it is announced."""
DAY = 86400.0
KEPT = 30.0 * DAY
"""Time, s, after which a file that nothing has used is removed; kernels of another version are never used again."""
_CHECKSUM = hashlib.sha256().digest_size
told: set[str] = set()
"""Kinds of sentences that were said."""


class UnusableFile(Exception):
    """A file of the cache that is not loaded; the sentence says why."""


def tell(kind: str, sentence: str) -> None:
    """Say something on standard error once for each kind, in the first process of a command only."""
    if kind not in told and multiprocessing.parent_process() is None and sys.stderr is not None:
        with suppress(OSError, ValueError):
            sys.stderr.write(f"tcc-sim: {one_line(sentence)}\n")
            sys.stderr.flush()
    told.add(kind)


@cache
def directory() -> Path | None:
    """The directory for compiled kernels, or None (and a line on standard error) where none can be trusted.

    It is `tcc_sim` in NUMBA_CACHE_DIR, else in XDG_CACHE_HOME, else in ~/.cache, and is made with mode 0700.
    """
    try:
        place = _base().resolve() / "tcc_sim"
        place.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            place.mkdir(mode=0o700)
        reason = _distrust(place)
        if not reason:
            if stat.S_IMODE(place.stat().st_mode) != 0o700:
                place.chmod(0o700)
            return place
    except (OSError, RuntimeError, ValueError) as error:
        place = Path(getattr(error, "filename", None) or "~/.cache")
        reason = getattr(error, "strerror", None) or str(error)
    tell("cache", f"kernels are compiled without a cache: {place}: {reason}")
    return None


def _base() -> Path:
    """Where the user keeps caches; relative names of XDG_CACHE_HOME do not count, as its specification says."""
    own, named = os.environ.get("NUMBA_CACHE_DIR", ""), os.environ.get("XDG_CACHE_HOME", "")
    return Path(own) if own else Path(named) if os.path.isabs(named) else Path.home() / ".cache"


def _distrust(place: Path) -> str:
    """Why somebody else might have written to a directory; empty where nobody can have."""
    found = place.lstat()
    if not stat.S_ISDIR(found.st_mode):
        return "it is not a directory"
    if found.st_uid != os.geteuid():
        return "it belongs to somebody else"
    if found.st_mode & 0o022:
        return "others can write to it; remove it, or make it mode 0700 if you trust what is in it"
    for parent in place.parents:
        mode = parent.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            return f"others can write to {parent}"
    return ""


def _content(path: Path) -> bytes:
    """What was kept in a file; UnusableFile unless it is one's own and as it was written."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o022:
            raise UnusableFile(f"{path} is not a file of one's own")
        content = file.read()
    if len(content) < _CHECKSUM or hashlib.sha256(content[:-_CHECKSUM]).digest() != content[-_CHECKSUM:]:
        raise UnusableFile(f"{path} is damaged")
    return content[:-_CHECKSUM]


def kept(name: str, size: int, make: Callable[[], bytes], load: Callable[[bytes], Loaded]) -> Loaded:
    """What `load` makes of what was kept under a name, or of what is made now and kept, all of it or nothing.

    size : bytes of bytecode that are compiled, by which it is announced where it takes a while
    """
    place = directory()
    if place is not None:
        path = place / name
        try:
            out = load(_content(path))
            if time.time() - path.stat().st_mtime > DAY:
                os.utime(path)
            return out
        except FileNotFoundError:
            pass
        except Exception as error:
            tell("damage", f"a kernel is compiled anew, since the cache is of no use: {_reason(error)}")
            with suppress(OSError):
                path.unlink()
    announce(size, "once" if place is not None else "in every process, since they cannot be kept")
    content = make()
    if place is not None:
        remove_unused(place, time.time())
        try:
            _write(path, content + hashlib.sha256(content).digest())
        except OSError as error:
            tell("cache", f"compiled kernels are not kept: {_reason(error)}")
    return load(content)


def announce(size: int, how_often: str) -> None:
    """Say that something is compiled, where it takes a while."""
    seconds = SECONDS_PER_BYTE * size
    if seconds >= WORTH_SAYING:
        tell("compiling", f"compiling kernels for this kind of scene, about {seconds:.0f} s, {how_often}")


def _write(path: Path, content: bytes) -> None:
    """Write a file of one's own, all of it or nothing."""
    descriptor, unfinished = tempfile.mkstemp(dir=path.parent)
    try:
        with open(descriptor, "wb") as file:
            file.write(content)
        os.replace(unfinished, path)
    except BaseException:
        os.unlink(unfinished)
        raise


def remove_unused(place: Path, now: float) -> None:
    """Remove the files of a cache that were last used more than KEPT before `now`, s since 1970."""
    for path in place.glob("*-*"):
        with suppress(OSError):
            if now - path.lstat().st_mtime > KEPT:
                path.unlink()


def _reason(error: BaseException) -> str:
    """What went wrong, in one sentence."""
    name = getattr(error, "filename", None)
    return f"{name}: {error.strerror}" if name and isinstance(error, OSError) else str(error) or type(error).__name__
