"""Compiled code on disk, each file under a key of all code that it can reach: with the package, and in a private
directory.

The key is made function by function: two kernels in one file have keys of their own, and a change in a file that
a kernel calls nothing of leaves its compiled code as it is. Comments, docstrings and the places of lines do not count.
Neither does the age of a file: code that came with the package is used as long as its key is that of the source.

Loading compiled code runs it, so every file has a checksum. The private directory is used only if nobody else can write
to it or put another one in its place: every folder from the root on belongs to root or to the user, and no group and
nobody else may write to it. A file in the package is used only if it is as safe as the package's own source text.
Whatever is wrong with a file means one line on standard error and code that is compiled without it.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import multiprocessing
import os
import stat
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from enum import Enum
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any, TypeVar

import numpy as np
from llvmlite.ir import Type

from tcc_sim.errors import one_line

Loaded = TypeVar("Loaded")

ANNOUNCED_FROM = 1.0
"""Least compile time, s, that is announced."""
DAY = 86400.0
UNUSED_AFTER = 30.0 * DAY
"""Time, s, after which an unused file is removed; kernels of another version are never used again."""
WAITED, LOOK = 60.0, 0.05
"""Longest time to wait for another process that compiles the same kernel, and time between two looks, s."""
SHIPPED = Path(__file__).with_name("shipped")
"""Directory in the package of the code that the installation compiled."""
DIGITS = 24
"""Digits of a digest in a file's name."""
_CHECKSUM = hashlib.sha256().digest_size
MOST_OF_AN_INDEX = 1 << 16
"""Bytes at the end of a file that contain its index."""
new_functions: dict[str, bytes] = {}
"""Parts that this process has compiled and not stored yet."""
used: set[str] = set()
"""Names of the kernels that this process has asked for."""
announced: set[str] = set()
"""Kinds of messages that were printed; compilations are announced unless "compiling" is among them."""
_PACKAGE = __name__.partition(".")[0]
_PLAIN = (int, float, complex, str, bytes, type(None), np.generic, np.dtype, np.ufunc, range, Type)


class Dependencies:
    """The functions, constants and options that a function can reach.

    digest : their SHA-256, as hexadecimal digits
    seen : functions and modules among them
    kernels : bytes of bytecode of each kernel among them
    size : bytes of bytecode, to which compile time is proportional
    """

    def __init__(self, function: FunctionType, *context: object) -> None:
        self.size, self._hash = 0, hashlib.sha256()
        self.seen: dict[object, object] = {}
        self.kernels: dict[Any, int] = {}
        self._add(sys.version_info[:2], *context)
        self._take(function, set())
        self.digest = self._hash.hexdigest()

    def _add(self, *words: object) -> None:
        """Add words to the digest, each with its length."""
        for word in words:
            data = word if isinstance(word, bytes) else repr(word).encode()
            self._hash.update(len(data).to_bytes(8, "little") + data)

    def _take(self, value: Any, names: set[str]) -> None:
        """Add a value; `names` are those that the function looks up, in modules too."""
        if isinstance(getattr(value, "py_func", None), FunctionType):
            self._add(sorted(map(repr, getattr(value, "options", {}).items())))
            self.kernels[value] = len(value.py_func.__code__.co_code)
            value = value.py_func
        self._add(type(value).__name__)
        if isinstance(value, FunctionType | type | BuiltinFunctionType):
            self._add(value.__module__, value.__qualname__)
        if isinstance(value, FunctionType | ModuleType):
            key = id(value), isinstance(value, ModuleType) and tuple(sorted(names))
            if key in self.seen:
                return
            self.seen[key] = value
        if isinstance(value, FunctionType):
            names = self._code(value.__code__, value.__doc__)
            named = {name: value.__globals__[name] for name in sorted(names) if name in value.__globals__}
            cells = [cell.cell_contents for cell in value.__closure__ or ()]
            for item in (*named.items(), value.__defaults__, *cells):
                self._take(item, names)
        elif isinstance(value, ModuleType):  # Of modules outside this package add only kernels and numbers.
            self._add(value.__name__)
            of_package = value.__name__.startswith(_PACKAGE)
            for name in sorted(names & vars(value).keys()):
                item = vars(value)[name]
                if item is not value and (of_package or hasattr(item, "py_func") or isinstance(item, _PLAIN)):
                    self._take((name, item), names)
        elif isinstance(value, tuple | list):
            self._add(len(value))
            for item in value:
                self._take(item, names)
        elif isinstance(value, np.ndarray):
            self._add(value.dtype, value.shape, value.tobytes())
        elif isinstance(value, type):
            self._add(list(value) if issubclass(value, Enum) else getattr(value, "_fields", ()))
            for base in value.__mro__:
                if base.__module__.startswith(_PACKAGE):
                    self._methods(base)
        elif isinstance(value, dict):
            self._take(tuple(value.items()), names)
        elif isinstance(value, _PLAIN):
            self._add(value)
        elif not isinstance(value, BuiltinFunctionType):
            raise TypeError(f"a kernel reaches {value!r}, which is neither source nor a constant")

    def _methods(self, kind: type) -> None:
        """Add the functions that a class of the package defines, which staged functions run while compiling."""
        size = self.size  # They become no code by themselves.
        for name, item in sorted(vars(kind).items(), key=lambda each: each[0]):
            item = getattr(item, "fget", None) or getattr(item, "__func__", item)
            if isinstance(item, FunctionType) and item.__module__ == kind.__module__:
                self._take((name, item), set())
        self.size = size

    def _code(self, code: CodeType, documentation: str | None = None) -> set[str]:
        """Add the instructions and constants of a code object; return the names that it looks up."""
        self.size += len(code.co_code)
        self._add(code.co_code, code.co_names, code.co_varnames, code.co_freevars)
        names = set(code.co_names)
        for number, constant in enumerate(code.co_consts):
            if isinstance(constant, CodeType):
                names |= self._code(constant)
            elif number or constant != documentation:
                self._add(constant)
        return names


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


def _content(path: Path) -> tuple[bytes, dict[str, tuple[int, int]]]:
    """Read a file: all of it, and its index. UnusableFile is raised unless it is undamaged and belongs to the user
    alone, or, in the package, is as safe as this module.
    """
    shipped = path.parent == SHIPPED
    follow = 0 if shipped else os.O_NOFOLLOW
    with open(os.open(path, os.O_RDONLY | follow | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
        status, owners, writable = os.fstat(file.fileno()), {os.geteuid()}, 0
        if shipped:
            source = os.stat(__file__)
            owners, writable = {*owners, 0, source.st_uid}, source.st_mode & 0o022
        if not stat.S_ISREG(status.st_mode) or status.st_uid not in owners or status.st_mode & 0o022 & ~writable:
            raise UnusableFile(f"{path} is not a private file")
        content = file.read()
    if hashlib.sha256(content[:-_CHECKSUM]).digest() != content[-_CHECKSUM:]:
        raise UnusableFile(f"{path} is damaged")
    if not shipped and time.time() - status.st_mtime > DAY:
        os.utime(path)
    return content, _index(content)


def _index(end: bytes) -> dict[str, tuple[int, int]]:
    """Return start and size of the code in a file and of each lowered function behind it, from the end of the file."""
    size = int.from_bytes(end[-_CHECKSUM - 8:-_CHECKSUM], "little")
    index: dict[str, tuple[int, int]] = json.loads(end[-_CHECKSUM - 8 - size:-_CHECKSUM - 8])
    return index


def _whole(code: bytes, functions: dict[str, bytes]) -> bytes:
    """Return the content of a file: the code of a kernel, which has no name in the index, and lowered functions."""
    index, start = {}, 0
    for name, content in (("", code), *functions.items()):
        index[name] = start, len(content)
        start += len(content)
    head = json.dumps(index).encode()
    out = b"".join((code, *functions.values(), head, len(head).to_bytes(8, "little")))
    return out + hashlib.sha256(out).digest()


def load_or_build(name: str, seconds: Callable[[], float], make: Callable[[], bytes],
                  load: Callable[[bytes], Loaded]) -> Loaded:
    """Load the stored kernel of this name, from the package or the private directory, or make and store it with the new
    lowered functions; `seconds` estimates the time.
    """
    used.add(name)
    if (out := _stored(SHIPPED / name, load)) is not None:
        return out
    place = directory()
    if place is None:
        announce(seconds(), "in every process, since they cannot be kept")
        return load(make())
    path = place / name
    if (out := _stored(path, load)) is not None:
        return out
    announce(seconds(), "once")
    with _alone(place / f"tmp.{name}"):
        if (out := _stored(path, load)) is not None:  # Another process has made it meanwhile.
            return out
        code = make()
        remove_unused(place, time.time())
        try:
            _write(path, _whole(code, new_functions))
            stored_functions().update(dict.fromkeys(new_functions, path))
            new_functions.clear()
        except OSError as error:
            print_once("cache", f"compiled kernels are not kept: {_reason(error)}")
        return load(code)


def _stored(path: Path, load: Callable[[bytes], Loaded]) -> Loaded | None:
    """Return the stored kernel; None, after a line on standard error, if its file is of no use. Such a file is removed
    from the private directory.
    """
    try:
        content, index = _content(path)
        start, size = index[""]
        return load(content[start:start + size])
    except FileNotFoundError:
        pass
    except Exception as error:
        where = "the code in the package" if path.parent == SHIPPED else "the cache"
        print_once("damage", f"a kernel is compiled anew, since {where} is of no use: {_reason(error)}")
        if path.parent != SHIPPED:
            with suppress(OSError):
                path.unlink()
    return None


@cache
def stored_functions() -> dict[str, Path]:
    """Return the files of the lowered functions that are stored when this process first asks, and of those that it has
    stored.
    """
    files: dict[str, Path] = {}
    for path in (path for place in (directory(), SHIPPED) if place is not None for path in place.glob("*-*-*")):
        with suppress(OSError, ValueError), open(path, "rb") as file:
            file.seek(max(0, path.stat().st_size - MOST_OF_AN_INDEX))
            files |= dict.fromkeys(_index(file.read()), path)
    return files


@cache
def _read_once(path: Path) -> tuple[bytes, dict[str, tuple[int, int]]]:
    """Return the content of a file and its index; both are empty if it is of no use."""
    try:
        return _content(path)
    except (OSError, ValueError, UnusableFile):
        return b"", {}


def stored_function(name: str) -> bytes | None:
    """Return a stored lowered function; None if there is none."""
    if name in stored_functions():
        content, index = _read_once(stored_functions()[name])
        if name in index:
            start, size = index[name]
            return zlib.decompress(content[start:start + size])
    return None


def keep_function(name: str, content: bytes) -> None:
    """Store a lowered function with the next kernel."""
    new_functions[name] = zlib.compress(content)


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


def announce(seconds: float, how_often: str) -> None:
    """Announce a compilation that takes a while."""
    if seconds >= ANNOUNCED_FROM and "compiling" not in announced:
        _print(f"compiling kernels for this kind of scene, about {seconds:.0f} s, {how_often}")


def announce_unkept(seconds: float, version: str, tested: tuple[str, str]) -> None:
    """Announce a compilation by a version of Numba whose code cannot be kept."""
    first, last = tested
    above = f"{last.partition('.')[0]}.{int(last.partition('.')[2]) + 1}"
    print_once("compiling", f"Numba {version} compiles in every process, about {seconds:.0f} s now; "
                            f"python3 -m pip install 'numba>={first},<{above}' brings one whose kernels are kept")


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
