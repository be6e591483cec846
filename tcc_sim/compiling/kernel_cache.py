"""Compiled code on disk, under a digest of the source of all kernels: with the package, and in a private directory.

Like Python's own files of compiled code, a kernel is used as long as the text of ROOMS, from which all kernels are
made, is that from which it was compiled, by the same compiler for the same processor. Whoever edits that text compiles
again the kernels that he uses. The age of a file does not count.

Loading compiled code runs it, so every file has a checksum. The private directory is used only if nobody else can write
to it or put another one in its place: every folder from the root on belongs to root or to the user, and no group and
nobody else may write to it. A file in the package is used only if it is no more writable than the folder it is in.
Whatever is wrong with a file means one line on standard error and code that is compiled without it.
"""

from __future__ import annotations

import fcntl
import hashlib
import multiprocessing
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

from tcc_sim.errors import one_line

Loaded = TypeVar("Loaded")

PACKAGE = Path(__file__).parents[1]
ROOMS = ("analysis/repetition.py", "analysis/settings.py", "compiling", "model", "polynomials", "solvers",
         "trajectory.py")
"""Files and folders of the package from which kernels are made."""
DAY = 86400.0
UNUSED_AFTER = 30.0 * DAY
"""Time, s, after which an unused file is removed; kernels of another version are never used again."""
WAITED, LOOK = 60.0, 0.05
"""Longest time to wait for another process that compiles the same kernel, and time between two looks, s."""
SHIPPED = Path(__file__).with_name("shipped")
"""Directory in the package of the code that the installation compiled."""
_CHECKSUM = hashlib.sha256().digest_size
used: set[str] = set()
"""Names of the kernels that this process has asked for."""
announced: set[str] = set()
"""Kinds of messages that were printed; compilations are announced unless "compiling" is among them."""


@cache
def source_digest(package: Path = PACKAGE) -> str:
    """Return the SHA-256 of the text of a package's ROOMS, as hexadecimal digits."""
    text = hashlib.sha256()
    for room in ROOMS:
        place = package / room
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            text.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return text.hexdigest()


class UnusableFile(Exception):
    """A file of the cache cannot be loaded; the message gives the reason."""


def print_once(kind: str, sentence: str) -> None:
    """Print a message on standard error, one of each kind, in the first process of a command only."""
    if kind not in announced:
        _print(sentence)
    announced.add(kind)


def _print(sentence: str) -> None:
    """Print a message on standard error, in the first process of a command only."""
    if multiprocessing.parent_process() is None and sys.stderr is not None:
        with suppress(OSError, ValueError):
            sys.stderr.write(f"tcc-sim: {one_line(sentence)}\n")
            sys.stderr.flush()


@cache
def directory() -> Path | None:
    """Return the directory for compiled kernels; print a line and return None if it cannot be trusted.

    It is `tcc_sim` in NUMBA_CACHE_DIR, else in XDG_CACHE_HOME, else in ~/.cache, and is made with mode 0700.
    """
    try:
        base = _base()
        place = base.resolve() / "tcc_sim"
        reason = _distrust_parents(place) if base.is_absolute() else f"it is given as {base}, which is not absolute"
        if not reason:
            for folder in (*reversed(place.parents), place):
                with suppress(FileExistsError):
                    folder.mkdir(mode=0o700)
            reason = _distrust_parents(place) or _distrust(place)
        if not reason:
            if stat.S_IMODE(place.stat().st_mode) != 0o700:
                place.chmod(0o700)
            return place
    except (OSError, RuntimeError, ValueError) as error:
        place = Path(getattr(error, "filename", None) or "~/.cache")
        reason = getattr(error, "strerror", None) or str(error)
    print_once("cache", f"kernels are compiled without a cache: {place}: {reason}")
    return None


def _base() -> Path:
    """Return the user's cache directory; a relative XDG_CACHE_HOME is ignored, as its specification requires."""
    given, named = os.environ.get("NUMBA_CACHE_DIR", ""), os.environ.get("XDG_CACHE_HOME", "")
    return Path(given) if given else Path(named) if os.path.isabs(named) else Path.home() / ".cache"


def _distrust(place: Path) -> str:
    """Return why another user might have written to a directory; empty if none could."""
    status = place.lstat()
    if not stat.S_ISDIR(status.st_mode):
        return "it is not a directory"
    if status.st_uid != os.geteuid():
        return "it belongs to somebody else"
    if status.st_mode & 0o022:
        return "others can write to it; remove it, or make it mode 0700 if you trust what is in it"
    return ""


def _distrust_parents(place: Path) -> str:
    """Return why another user might replace a folder that leads to `place`; empty if none can.

    In a sticky folder others can rename or remove only their own.
    """
    user, below = os.geteuid(), place
    for parent in place.parents:
        if not os.path.lexists(parent):
            continue
        status = parent.lstat()
        if not stat.S_ISDIR(status.st_mode):
            return f"{parent} is not a directory"
        if status.st_uid not in (0, user):
            return f"{parent} belongs to somebody else"
        if status.st_mode & 0o022:
            whose = below.lstat().st_uid if os.path.lexists(below) else user
            if not (status.st_mode & stat.S_ISVTX and whose == user):
                return f"others can write to {parent}"
        below = parent
    return ""


def _content(path: Path, shipped: bool) -> bytes:
    """Read the code in a file. UnusableFile is raised unless the file is undamaged and belongs to the user alone, or,
    shipped, is as safe as the folder that holds it.
    """
    follow = 0 if shipped else os.O_NOFOLLOW
    with open(os.open(path, os.O_RDONLY | follow | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
        status, owners, writable = os.fstat(file.fileno()), {os.geteuid()}, 0
        if shipped:
            folder = os.stat(path.parent)
            owners, writable = {*owners, 0, folder.st_uid}, folder.st_mode & 0o022
        if not stat.S_ISREG(status.st_mode) or status.st_uid not in owners or status.st_mode & 0o022 & ~writable:
            raise UnusableFile(f"{path} is not a private file")
        content = file.read()
    code = content[:-_CHECKSUM]
    if hashlib.sha256(code).digest() != content[-_CHECKSUM:]:
        raise UnusableFile(f"{path} is damaged")
    if not shipped and time.time() - status.st_mtime > DAY:
        os.utime(path)
    return code


def load_or_build(name: str, make: Callable[[], bytes], load: Callable[[bytes], Loaded],
                  shipped: Path = SHIPPED) -> Loaded:
    """Load the stored kernel of this name, from the package or the private directory, or make and store it.

    `shipped` is the package's folder of kernels.
    """
    used.add(name)
    if (out := _stored(shipped / name, load, shipped=True)) is not None:
        return out
    place = directory()
    if place is None:
        announce("in every process, since they cannot be kept")
        return load(make())
    path = place / name
    if (out := _stored(path, load)) is not None:
        return out
    announce("once")
    with _alone(place / f"tmp.{name}"):
        if (out := _stored(path, load)) is not None:  # Another process has made it meanwhile.
            return out
        code = make()
        remove_unused(place, time.time())
        try:
            _write(path, code + hashlib.sha256(code).digest())
        except OSError as error:
            print_once("cache", f"compiled kernels are not kept: {_reason(error)}")
        return load(code)


def _stored(path: Path, load: Callable[[bytes], Loaded], shipped: bool = False) -> Loaded | None:
    """Return the stored kernel; None, after a line on standard error, if its file is of no use. Such a file is removed
    from the private directory.
    """
    try:
        return load(_content(path, shipped))
    except FileNotFoundError:
        pass
    except Exception as error:
        where = "the code in the package" if shipped else "the cache"
        print_once("damage", f"a kernel is compiled anew, since {where} is of no use: {_reason(error)}")
        if not shipped:
            with suppress(OSError):
                path.unlink()
    return None


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Hold a file's lock, for which other processes that want the same kernel wait, at most WAITED."""
    try:
        descriptor = os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError:
        yield
        return
    end = time.monotonic() + WAITED
    try:
        while time.monotonic() < end:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                time.sleep(LOOK)
            except OSError:  # The file system has no locks.
                break
        yield
    finally:
        os.close(descriptor)
        with suppress(OSError):
            path.unlink()


def announce(how_often: str) -> None:
    """Announce, once, that kernels are compiled."""
    print_once("compiling", f"compiling kernels for this kind of scene, up to half a minute, {how_often}")


def _write(path: Path, content: bytes) -> None:
    """Write a private file atomically."""
    descriptor, unfinished = tempfile.mkstemp(prefix="tmp", dir=path.parent)
    try:
        with open(descriptor, "wb") as file:
            file.write(content)
        os.replace(unfinished, path)
    except BaseException:
        os.unlink(unfinished)
        raise


def remove_unused(place: Path, now: float) -> None:
    """Remove files unused for UNUSED_AFTER before `now`, s since 1970, and remains of writes killed a day before."""
    for pattern, age in (("*-*", UNUSED_AFTER), ("tmp*", DAY)):
        for path in place.glob(pattern):
            with suppress(OSError):
                if now - path.lstat().st_mtime > age:
                    path.unlink()


def _reason(error: BaseException) -> str:
    """Return an error's message."""
    name = getattr(error, "filename", None)
    return f"{name}: {error.strerror}" if name and isinstance(error, OSError) else str(error) or type(error).__name__
