"""Work in a thread of its own that may be given up where it makes no headway. Free of ROS."""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import TypeVar

from tcc_sim.background import begun

Result = TypeVar("Result")
LOOK = 0.05
"""Real time, s, between two looks at the work."""
ENDING = 1.0
"""Real time, s, that a thread which was given up has to end."""
_OWN = Path(__file__).resolve().parent.parent


class GivenUp(BaseException):
    """Raised within the work that hangs, to end it."""


class Worker:
    """Runs one piece of work at a time, and gives it up where `beat` was not called for too long.

    Attributes
    ----------
    stuck : a piece of work was given up and has not ended
    """

    def __init__(self) -> None:
        self.stuck = False
        self._beat = 0.0

    def beat(self) -> None:
        """There is headway."""
        self._beat = time.monotonic()

    def run(self, work: Callable[[], Result], patience: float, failed: Callable[[str], Exception]) -> Result:
        """What `work` gives; its exception, or that which `failed` makes of the place where it hangs.

        Parameters
        ----------
        patience : real time without headway, s
        """
        self.beat()
        found, thread = begun(work, name="nodes under test")
        try:
            while thread.is_alive():
                thread.join(LOOK)
                if thread.is_alive() and time.monotonic() - self._beat > patience:
                    raise failed(_place(sys._current_frames().get(thread.ident or 0)))
        finally:
            self.stuck = thread.is_alive() and not _ended(thread)
        return found.result()


def _place(frame: FrameType | None) -> str:
    """Where a thread is: the innermost line that is neither this package's nor a library's."""
    innermost = frame
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if not (path.is_relative_to(_OWN) or "site-packages" in path.parts or path.is_relative_to(sys.base_prefix)):
            return f"{frame.f_code.co_name} ({path.name}:{frame.f_lineno})"
        frame = frame.f_back
    return "its callback" if innermost is None else f"{innermost.f_code.co_name}"


def _ended(thread: threading.Thread) -> bool:
    """Ask a thread to end by an exception at its next line of Python; whether it has ended."""
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident or 0), ctypes.py_object(GivenUp))
    thread.join(ENDING)
    return not thread.is_alive()
