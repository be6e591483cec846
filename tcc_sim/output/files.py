"""Files that are written whole or not at all, and replace existing ones only on request."""

from __future__ import annotations

import errno
import json
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tcc_sim.errors import InputError, check_folder

STANDARD_OUTPUT = Path("-")
LARGEST_JSON = 1 << 30
"""Largest size of a JSON file that is read, bytes."""
FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Error numbers of a full disk."""
_NAME, _PATH = 255, 4096
"""Longest name and path on Linux, bytes, if the file system gives no limit."""


def check_name(path: Path) -> None:
    """Raise InputError if a name is longer than its file system allows."""
    whole = os.fsencode(path)
    if b"\0" in whole:
        raise InputError(f"the name {path} contains a NUL character, which no file name can contain")
    try:
        longest = os.pathconf(path.parent, "PC_NAME_MAX")
    except (OSError, ValueError):
        longest = _NAME
    if max(map(len, map(os.fsencode, path.parts)), default=0) > longest:
        raise InputError(f"the name {path.name} is too long: {longest} bytes are allowed")
    if len(whole) >= _PATH:
        raise InputError(f"{path} is too long: {_PATH - 1} bytes are allowed")


def replaceable(path: Path) -> bool:
    """Return whether a regular file exists at `path`.

    Raises InputError: a directory, a device, a pipe or a symbolic link has this name; it is never replaced.
    """
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return False
    if not stat.S_ISREG(mode):
        kinds = ((stat.S_ISDIR, "a directory"), (stat.S_ISLNK, "a symbolic link"), (stat.S_ISFIFO, "a pipe"),
                 (stat.S_ISSOCK, "a socket"))
        kind = next((word for test, word in kinds if test(mode)), "a device")
        raise InputError(f"{path} is {kind}, which is never replaced; name a file")
    return True


def new_file(path: Path, force: bool | None = None) -> Path:
    """Return `path` after checking that a file can be written there without overwriting another one.

    force : whether --force is given; None for a command without this option

    Raises InputError: the file exists and `force` is not on, a directory or another special file has this name, the
    name is too long, or its directory does not exist.
    """
    check_name(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory; name a file")
    if replaceable(path) and not force:
        raise InputError(f"{path} exists; it is not overwritten{'' if force is None else ' without --force'}")
    check_folder(path)
    return path


def new_directory(path: Path) -> Path:
    """Return `path` after checking that a directory can be created there.

    Raises InputError: the path exists, its name is too long, or its parent directory does not exist.
    """
    check_name(path)
    if os.path.lexists(path):
        raise InputError(f"{path} exists; name a directory that does not")
    if not path.absolute().parent.is_dir():
        raise InputError(f"{path}: there is no directory {path.absolute().parent}")
    return path


@contextmanager
def draft(path: Path) -> Iterator[Path]:
    """Yield the path of a draft, which becomes `path` if the `with` block succeeds and is removed otherwise.

    The draft has the same file name, in a new directory beside `path` with an unpredictable name that only this user
    can enter; so no other user can place a file or a link there. A file that appears at `path` in the meantime is not
    replaced.

    Raises InputError: no regular file is at `path`, but a directory or another special file; or a file has appeared
    there. Raises OSError: the disk is full or the folder cannot be written; the error names `path`.
    """
    check_name(path)
    existed = replaceable(path)
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.stem[:32]}.", suffix=".part", dir=path.parent))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    try:
        part = folder / path.name
        yield part
        if replaceable(path) and existed:
            part.replace(path)
        else:
            _link(part, path)
    except OSError as error:
        if (error.errno in FULL and error.filename is None) or str(error.filename).startswith(str(folder)):
            # The error must name the user's file, not the draft; the error of a full disk names no file.
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _link(part: Path, path: Path) -> None:
    """Move a finished file to an unused name; without hard links, a file may appear there between check and move."""
    try:
        os.link(part, path, follow_symlinks=False)
    except FileExistsError:
        raise InputError(f"{path} has appeared in the meantime and is not overwritten") from None
    except OSError:
        if path.exists():
            raise InputError(f"{path} has appeared in the meantime and is not overwritten") from None
        part.replace(path)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write values as JSON to a file, or to standard output for '-'."""
    text = json.dumps(values, allow_nan=False, indent=1) + "\n"
    if path == STANDARD_OUTPUT:
        sys.stdout.write(text)
        return
    with draft(path) as part:
        part.write_text(text, encoding="utf-8")


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file.

    Raises InputError: the file cannot be read, is too large, or contains no JSON object.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a regular file")
        if (size := path.stat().st_size) > LARGEST_JSON:
            raise InputError(f"{path} has {size} bytes; a JSON file of results has at most {LARGEST_JSON}")
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except InputError:
        raise
    except (ValueError, RecursionError):
        raise InputError(f"{path} is not a JSON file") from None
    if not isinstance(document, dict):
        raise InputError(f"{path} contains no JSON object")
    return document
