"""Compiled code on disk, under a digest of the source of all kernels: with the package, and in a private directory.

Like Python's own files of compiled code, a kernel is used as long as the text of ROOMS, from which all kernels are
made, is that from which it was compiled, by the same compiler for the same processor. Whoever edits that text compiles
again the kernels that he uses. The age of a file does not count.

Loading compiled code runs it, so every file has a checksum, and is loaded only if it belongs to the user and nobody
else may write to it or to the private directory. A file in the package is used only if it is no more writable than the
folder it is in. Whatever is wrong with a file means one line on standard error and code that is compiled without it.
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

from llvmlite import binding

from tcc_sim.errors import TccError, one_line

Loaded = TypeVar("Loaded")

PACKAGE = Path(__file__).parents[1]
ROOMS = ("analysis/repetition.py", "compiling", "model", "polynomials", "solvers", "trajectory.py")
"""Files and folders of the package from which kernels are made."""
UNUSED_AFTER = 30.0 * 86400.0
"""Time, s, after which an unused file is removed; kernels of another version are never used again."""
SHIPPED = Path(__file__).with_name("shipped")
"""Directory in the package of the code that the installation compiled."""
OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH
used: set[str] = set()
"""Names of the kernels that this process has asked for."""
announced: set[str] = set()
"""Kinds of messages that were printed; compilations are announced unless "compiling" is among them."""
LEVEL = "x86-64-v3"
NEEDED = "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"
"""LLVM's names of the features of LEVEL that earlier levels lack (x86-64 psABI, Table 3.1)."""


@cache
def processor() -> tuple[str, str, str]:
    """Return the compiler's target: LLVM's names of architecture and system, of the processor, and of further features.

    It is LEVEL where the present processor has it, so that code serves other machines too: kernels are as fast as those
    for the very processor, and have the same bits. NUMBA_CPU_NAME and NUMBA_CPU_FEATURES choose another target.
    """
    triple, features = binding.get_process_triple(), binding.get_host_cpu_features()
    named, given_features = os.environ.get("NUMBA_CPU_NAME", ""), os.environ.get("NUMBA_CPU_FEATURES", "")
    if named or given_features:
        return triple, named or binding.get_host_cpu_name(), given_features
    if triple.startswith("x86_64") and all(features.get(feature) for feature in NEEDED):
        return triple, LEVEL, ""
    return triple, binding.get_host_cpu_name(), features.flatten()


@cache
def source_digest(package: Path = PACKAGE) -> str:
    """Return the SHA-256 of the text of a package's ROOMS, as hexadecimal digits."""
    text = hashlib.sha256()
    for room in ROOMS:
        place = package / room
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            text.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return text.hexdigest()


def print_once(kind: str, sentence: str) -> None:
    """Print a message on standard error, one of each kind, in the first process of a command only."""
    if kind not in announced and multiprocessing.parent_process() is None and sys.stderr is not None:
        with suppress(OSError, ValueError):
            sys.stderr.write(f"tcc-sim: {one_line(sentence)}\n")
            sys.stderr.flush()
    announced.add(kind)


@cache
def directory() -> Path | None:
    """Return the directory for compiled kernels; print a line and return None if it cannot be trusted.

    It is `tcc_sim` in NUMBA_CACHE_DIR, else in XDG_CACHE_HOME, else in ~/.cache, and is made with mode 0700. A relative
    XDG_CACHE_HOME is ignored, as its specification requires.
    """
    given, named = os.environ.get("NUMBA_CACHE_DIR", ""), os.environ.get("XDG_CACHE_HOME", "")
    try:
        base = Path(given) if given else Path(named) if os.path.isabs(named) else Path.home() / ".cache"
        if not base.is_absolute():
            raise TccError(f"{base} is not an absolute path")
        place = base / "tcc_sim"
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        place.mkdir(mode=0o700, exist_ok=True)
        status = place.lstat()
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & OTHERS_MAY_WRITE:
            raise TccError(f"{place} is not a directory of yours to which only you can write; remove it, or make it "
                           "mode 0700 if you trust it")
        return place
    except (OSError, RuntimeError, ValueError, TccError) as error:
        print_once("cache", f"kernels are compiled without a cache: {error}")
        return None


def load_or_build(name: str, make: Callable[[], bytes], load: Callable[[bytes], Loaded],
                  shipped: Path = SHIPPED) -> Loaded:
    """Load the stored kernel of this name, from the package or the private directory, or make and store it.

    `shipped` is the package's folder of kernels.
    """
    used.add(name)
    if (out := _stored(shipped / name, load)) is not None:
        return out
    place = directory()
    if place is not None and (out := _stored(place / name, load)) is not None:
        with suppress(OSError):
            os.utime(place / name)  # It counts as used.
        return out
    print_once("compiling", "compiling kernels for this kind of scene, up to half a minute, "
               + ("once" if place else "in every process, since they cannot be kept"))
    code = make()
    if place is not None:
        try:
            _keep(place / name, code + hashlib.sha256(code).digest())
        except OSError as error:
            print_once("cache", f"compiled kernels are not kept: {error}")
    return load(code)


def _stored(path: Path, load: Callable[[bytes], Loaded]) -> Loaded | None:
    """Return a stored kernel; None if there is none, or, after a line on standard error, if its file is of no use."""
    try:
        with open(path, "rb") as file:
            status, folder, content = os.fstat(file.fileno()), os.stat(path.parent), file.read()
        if status.st_uid not in (os.geteuid(), 0, folder.st_uid) or status.st_mode & ~folder.st_mode & OTHERS_MAY_WRITE:
            raise TccError("others can write to it")
        code, checksum = content[:-32], content[-32:]
        if hashlib.sha256(code).digest() != checksum:
            raise TccError("it is damaged")
        return load(code)
    except FileNotFoundError:
        pass
    except Exception as error:
        print_once("damage", f"a kernel is compiled anew, since {path} is of no use: {error}")
    return None


def _keep(path: Path, content: bytes) -> None:
    """Write a private file atomically; remove kernels, and remains of writes, unused for UNUSED_AFTER, beside it."""
    for other in path.parent.glob("*-*"):
        with suppress(OSError):
            if time.time() - other.lstat().st_mtime > UNUSED_AFTER:
                other.unlink()
    descriptor, unfinished = tempfile.mkstemp(prefix=f"{path.name}.", dir=path.parent)
    try:
        with open(descriptor, "wb") as file:
            file.write(content)
        os.replace(unfinished, path)
    except BaseException:
        os.unlink(unfinished)
        raise
