"""Remove shared memory of Fast DDS that killed processes leave behind and that would hang later nodes, without rclpy.

A participant opens or creates the file of its port, `/dev/shm/fastdds_portN`. It waits minutes for a file that another
process has begun and will never finish, and blocks the interpreter meanwhile. A living process holds a lock of one of
the files beside it or has them mapped. Fast DDS's own tool, `fastdds shm clean`, checks only the lock, so it misses
files without a lock.
"""

from __future__ import annotations

import fcntl
import os
import re
import sys
import time
from collections import defaultdict
from contextlib import suppress
from pathlib import Path

from tcc_sim.errors import TccError
from tcc_sim.nodes.children import FIRST_PORT, PORTS

FOLDER = Path("/dev/shm")
FINISHED_WITHIN = 30.0
"""Longest real time for another process to finish a port, s; it takes some 30 ms on an idle machine."""
LOOK = 0.05
"""Real time between two checks of the ports, s."""
_FILE = re.compile(r"(?:sem\.)?(fastdds_(?:port\d{1,5}|[0-9a-z]{16}))(?:_el|_sl|_mutex)?")
_LOCKS = ("_el", "_sl")
_WHOLE = 2
"""First word of a finished segment, as Boost.Interprocess marks it."""


def remove_ownerless(folder: Path = FOLDER) -> list[str]:
    """Remove the segments that no process holds, except those of other users, and return their names.

    If several processes start at once, one may recreate a segment under a name that another has just found ownerless:
    a file is removed only if it is still the file that was checked.
    """
    files: defaultdict[str, dict[Path, os.stat_result]] = defaultdict(dict)
    for path in folder.glob("*fastdds_*"):
        if match := _FILE.fullmatch(path.name):
            with suppress(OSError):
                files[match[1]][path] = path.stat()
    loose = [name for name in files if not any(_locked(folder / f"{name}{end}") for end in _LOCKS)]
    held = _mapped() if loose else set()
    removed = []
    for name in loose:
        if held.isdisjoint(map(str, files[name])):
            for path, seen in files[name].items():
                with suppress(OSError):
                    if os.path.samestat(path.stat(), seen):
                        path.unlink()
                        removed.append(path.name)
    return removed


def _locked(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDWR)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


def _mapped() -> set[str]:
    mapped: set[str] = set()
    for maps in Path("/proc").glob("[0-9]*/maps"):
        with suppress(OSError):
            mapped.update(re.findall(r"/.*fastdds_\S+", maps.read_text(errors="replace")))
    return mapped


def unfinished(domain: int, folder: Path = FOLDER) -> list[Path]:
    """Return the unfinished ports of a ROS domain, for which every process that opens one waits."""
    paths = []
    for port in range(FIRST_PORT + PORTS * domain, FIRST_PORT + PORTS * (domain + 1)):
        path = folder / f"fastdds_port{port}"
        with suppress(OSError):
            if int.from_bytes(path.open("rb").read(4), sys.byteorder) < _WHOLE:
                paths.append(path)
    return paths


def clear(domain: int, within: float = FINISHED_WITHIN) -> None:
    """Remove ownerless segments, and wait until living processes have finished their ports of a domain.

    Raises TccError: a port is not finished within `within` seconds because its process was stopped.
    """
    end = time.monotonic() + within
    while True:
        remove_ownerless()
        left = unfinished(domain)
        if not left:
            return
        if time.monotonic() > end:
            raise TccError(f"the middleware would wait for {', '.join(map(str, left))}, which a stopped process has "
                           f"left unfinished for {within:g} s: end that process or remove the file, and start again")
        time.sleep(LOOK)
