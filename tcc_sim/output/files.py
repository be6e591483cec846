"""New files that appear whole or not at all, and never over existing ones unless that was asked for."""

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

from tcc_sim.errors import InputError

STANDARD_OUTPUT = Path("-")
FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""What a disk says that takes no more."""
_NAME, _PATH = 255, 4096
"""Bytes of a name and of a whole path that Linux allows, where the file system does not say."""


def check_name(path: Path, reserve: int = 0) -> None:
    """Raise InputError where a name is longer than its file system allows, with `reserve` bytes to be added to it."""
    whole = os.fsencode(path)
    if b"\0" in whole:
        raise InputError(f"the name {path} has a NUL in it, which no file can have")
    try:
        longest = os.pathconf(path.parent, "PC_NAME_MAX")
    except (OSError, ValueError):
        longest = _NAME
    name = max(os.fsencode(path.name), *map(os.fsencode, path.parts), b"", key=len)
    if len(name) > longest or len(os.fsencode(path.name)) + reserve > longest:
        kept = f", and {reserve} of them are needed here" if reserve else ""
        raise InputError(f"the name {path.name} is too long: {longest} bytes are allowed{kept}")
    if len(whole) + reserve >= _PATH:
        raise InputError(f"{path} is too long: {_PATH - 1} bytes are allowed")


def replaceable(path: Path) -> bool:
    """Whether something is at `path`.

    Raises
    ------
    InputError
        What is there is no regular file (a directory, a device, a pipe, a symbolic link), so that nothing may take its
        place.
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


def new_directory(path: Path) -> Path:
    """`path`, once it is sure that it does not exist and can be created.

    Raises
    ------
    InputError
        It exists, its name is too long, or it has no directory to be in.
    """
    check_name(path)
    if os.path.lexists(path):
        raise InputError(f"{path} exists; name a directory that does not")
    if not path.absolute().parent.is_dir():
        raise InputError(f"{path}: there is no directory {path.absolute().parent}")
    return path


@contextmanager
def draft(path: Path) -> Iterator[Path]:
    """A path of the same name that takes the place of `path` when the `with` ends well and is removed otherwise.

    It lies in a new directory beside `path` that only this user can enter, with a name that nobody can know before, so
    whatever opens it neither finds a file nor follows a link that somebody else put there. What appears at `path`
    meanwhile is not replaced.

    Raises
    ------
    InputError
        Something is at `path` that is no regular file, or a file has appeared there.
    OSError
        With the name `path`, where the disk takes no more.
    """
    check_name(path)
    existed = replaceable(path)
    folder = Path(tempfile.mkdtemp(prefix=f".{path.stem[:32]}.", suffix=".part", dir=path.parent))
    try:
        part = folder / path.name
        yield part
        if replaceable(path) and existed:
            part.replace(path)
        else:
            _link(part, path)
    except OSError as error:
        if (error.errno in FULL and error.filename is None) or str(error.filename).startswith(str(folder)):
            # The user knows the file by its own name, not by the draft's, and a full disk names none.
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _link(part: Path, path: Path) -> None:
    """Put a finished file where none is; where the file system knows no second names, as near to that as it allows."""
    try:
        os.link(part, path, follow_symlinks=False)
    except FileExistsError:
        raise InputError(f"{path} has appeared meanwhile and is not overwritten") from None
    except OSError:
        if path.exists():
            raise InputError(f"{path} has appeared meanwhile and is not overwritten") from None
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
    """The object that a JSON file holds.

    Raises
    ------
    InputError
        There is no such file, or it holds something else.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise InputError(f"{path} is no JSON") from None
    if not isinstance(found, dict):
        raise InputError(f"{path} holds no JSON object")
    return found
