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
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.compiler import CompileResult

from tcc_sim.errors import one_line
from tcc_sim.solvers.compiling.kernel_text import Reach

SECONDS_PER_BYTE = 2.2e-4
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
    named = numba.config.CACHE_DIR or os.environ.get("XDG_CACHE_HOME", "")
    return Path(named) if numba.config.CACHE_DIR or os.path.isabs(named) else Path.home() / ".cache"


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


def _check(path: str) -> None:
    """Raise UnusableFile unless a file of the cache is one's own and as it was written."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o022:
            raise UnusableFile(f"{path} is not a file of one's own")
        content = file.read()
    if len(content) < _CHECKSUM or hashlib.sha256(content[:-_CHECKSUM]).digest() != content[-_CHECKSUM:]:
        raise UnusableFile(f"{path} is damaged")


class _Hashed:
    """A file that is written with the checksum of what went into it."""

    def __init__(self, file: Any) -> None:
        self._file = file
        self._hash = hashlib.sha256()

    def write(self, data: bytes) -> int:
        """Write and count in."""
        self._hash.update(data)
        return int(self._file.write(data))

    def finish(self) -> None:
        """Write the checksum."""
        self._file.write(self._hash.digest())


class _Files(IndexDataCacheFile):  # type: ignore[misc]
    """Numba's pair of index and data file, each checked before it is loaded."""

    def _load_index(self) -> Any:
        with suppress(FileNotFoundError):
            _check(self._index_path)
        return super()._load_index()

    def _load_data(self, name: str) -> Any:
        _check(self._data_path(name))
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[Any]:
        with super()._open_for_write(filepath) as file:
            os.fchmod(file.fileno(), 0o600)
            hashed = _Hashed(file)
            yield hashed
            hashed.finish()

    def _pair(self) -> tuple[Path, Path]:
        """Both files."""
        return Path(self._index_path), Path(self._data_path(self._data_name(1)))

    def remove(self) -> None:
        """Take the pair away."""
        for path in self._pair():
            path.unlink(missing_ok=True)

    def used(self) -> None:
        """Note that the pair is in use, once a day."""
        for path in self._pair():
            with suppress(OSError):
                if time.time() - path.stat().st_mtime > DAY:
                    os.utime(path)


def remove_unused(place: Path, now: float) -> None:
    """Remove the files of a cache that were last used more than KEPT before `now`, s since 1970."""
    for path in place.glob("*.nb[ic]"):
        with suppress(OSError):
            if now - path.lstat().st_mtime > KEPT:
                path.unlink()


class KernelCache(FunctionCache):  # type: ignore[misc]
    """What a Numba dispatcher asks for compiled code and gives it to: one pair of files for each kind of arguments.

    The key is all that the kernel can reach (`Reach`), how it is compiled, Numba's version and the processor. Nothing
    is read or walked before the kernel is first called.
    """

    def __init__(self, function: FunctionType, options: dict[str, Any], how: str) -> None:
        self._py_func = function
        self._options = options
        self._how = how

    @property
    def cache_path(self) -> str:
        """The directory; empty where there is none."""
        return str(directory() or "")

    @cached_property
    def reach(self) -> Reach:
        """What the kernel can call."""
        return Reach(self._py_func, numba.__version__, self._how, sorted(map(repr, self._options.items())))

    def enable(self) -> None:
        """It is always on."""

    def disable(self) -> None:
        """It is always on."""

    def flush(self) -> None:
        """Compiled code of another text has another name, so nothing is ever out of date."""

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """The compiled code for these arguments, or None where it is to be compiled, which is announced once."""
        target_context.refresh()
        found = None
        if directory() is not None:
            key = self._index_key(sig, target_context.codegen())
            files = self._files(sig, key)
            try:
                data = files.load(key)
                found = CompileResult._rebuild(target_context, *data) if data is not None else None
                files.used()
            except Exception as error:
                tell("damage", f"a kernel is compiled anew, since the cache is of no use: {_reason(error)}")
                with suppress(OSError):
                    files.remove()
        if found is None:
            self._announce()
        return found

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Keep compiled code."""
        fixed = all(lifted.can_cache for lifted in data.lifted) and not data.library.has_dynamic_globals
        place = directory()
        if place is None or not fixed:
            return
        remove_unused(place, time.time())
        key = self._index_key(sig, data.codegen)
        try:
            self._files(sig, key).save(key, data._reduce())
        except Exception as error:
            tell("cache", f"compiled kernels are not kept: {_reason(error)}")

    def _files(self, sig: Any, key: Any) -> _Files:
        """The pair of files for one kind of arguments."""
        kind = hashlib.sha256(repr((str(sig), key[1:])).encode()).hexdigest()[:16]
        name = f"{self._py_func.__module__.rpartition('.')[2]}.{self._py_func.__qualname__}"
        safe = "".join(c if c.isalnum() or c in "._" else "_" for c in name)[:80]
        return _Files(self.cache_path, f"{safe}-{self.reach.digest[:24]}-{kind}", self.reach.digest)

    def _announce(self) -> None:
        """Say that kernels are being compiled, where it takes a while."""
        seconds = SECONDS_PER_BYTE * self.reach.size
        if seconds >= WORTH_SAYING:
            kept = "once" if directory() is not None else "in every process, since they cannot be kept"
            tell("compiling", f"compiling kernels for this kind of scene, about {seconds:.0f} s, {kept}")


def _reason(error: BaseException) -> str:
    """What went wrong, in one sentence."""
    name = getattr(error, "filename", None)
    return f"{name}: {error.strerror}" if name and isinstance(error, OSError) else str(error) or type(error).__name__
