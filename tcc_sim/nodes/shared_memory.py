"""What a killed process leaves in Fast DDS's shared memory, which would hang every later node: removed before a node
is created, and a limit for the creation where it cannot be. Free of rclpy.

A participant opens or creates the file of its port, `/dev/shm/fastdds_portN`, and waits minutes for one that another
process has begun and will never finish; it holds the interpreter meanwhile. A process that lives holds a lock of one of
the files beside it or has them mapped. Fast DDS's own tool, `fastdds shm clean`, judges by the lock alone, so it does
not see what has none yet.
"""

from __future__ import annotations

import fcntl
import os
import re
import select
import signal
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tcc_sim.nodes import signals

FOLDER = Path("/dev/shm")
CREATED_WITHIN = 30.0
"""Real time, s, that the creation of a node may take; it takes some 30 ms on a quiet machine."""
_FILE = re.compile(r"(?:sem\.)?(fastdds_(?:port\d{1,5}|[0-9a-z]{16}))(?:_el|_sl|_mutex)?")
_LOCKS = ("_el", "_sl")
_WHOLE = 2
"""First word of a segment that is whole, as Boost.Interprocess marks it."""


def remove_ownerless(folder: Path = FOLDER, mapped: Callable[[], set[str]] | None = None) -> list[str]:
    """Remove the segments that no process holds; their names. What belongs to another user stays.

    Where several processes start at once, one of them may have made a segment anew under a name that another has just
    found without an owner: only the very file that was looked at is removed.

    Parameters
    ----------
    folder : where the segments are
    mapped : gives the files that processes have mapped; None: looks for them
    """
    found: defaultdict[str, dict[Path, os.stat_result]] = defaultdict(dict)
    for path in folder.glob("*fastdds_*"):
        if match := _FILE.fullmatch(path.name):
            with suppress(OSError):
                found[match[1]][path] = path.stat()
    loose = [name for name in found if not any(_locked(folder / f"{name}{end}") for end in _LOCKS)]
    held = (mapped or _mapped)() if loose else set()
    removed = []
    for name in loose:
        if held.isdisjoint(map(str, found[name])):
            for path, seen in found[name].items():
                with suppress(OSError):
                    if os.path.samestat(path.stat(), seen):
                        path.unlink()
                        removed.append(path.name)
    return removed


def _locked(path: Path) -> bool:
    """Whether a process holds the lock of a file."""
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
    """Files of Fast DDS that some process has mapped."""
    found: set[str] = set()
    for maps in Path("/proc").glob("[0-9]*/maps"):
        with suppress(OSError):
            found.update(re.findall(r"\S*fastdds_\S+", maps.read_text(errors="replace")))
    return found


def unfinished(folder: Path = FOLDER) -> list[Path]:
    """Ports that were begun and never finished: whoever opens one waits for it."""
    found = []
    for path in sorted(folder.glob("fastdds_port*")):
        if path.name.removeprefix("fastdds_port").isdigit():
            with suppress(OSError):
                if int.from_bytes(path.open("rb").read(4), sys.byteorder) < _WHOLE:
                    found.append(path)
    return found


@contextmanager
def creation(within: float = CREATED_WITHIN) -> Iterator[None]:
    """For the creation of a node: ownerless segments are gone, a signal ends the process at once, and so does a child
    of it with a sentence on standard error where the creation takes longer than `within` seconds.

    Nothing in this process could do so: the middleware holds the interpreter while it waits.
    """
    remove_ownerless()
    reading, writing = os.pipe()
    with signals.left_to_the_system():
        guard = os.fork()
        if not guard:
            os.close(writing)
            _guard(reading, within)
        os.close(reading)
        try:
            yield
        finally:
            os.close(writing)
            os.waitpid(guard, 0)


def _guard(reading: int, within: float) -> None:
    """In the child: end with the parent's creation, or end the parent."""
    if not select.select([reading], [], [], within)[0]:
        left = ", ".join(map(str, unfinished()))
        remove = (f"a process that was killed or stopped has left {left} unfinished: remove that" if left else
                  "if a process was killed before, remove /dev/shm/*fastdds_* once no node runs")
        os.write(2, f"tcc-sim: the middleware was not ready within {within:g} s; {remove}, and start again\n".encode())
        os.kill(os.getppid(), signal.SIGKILL)
    os._exit(0)
