"""What a driveline under test did, and what fails a test: nodes that die, do not answer, or hang in their thread, which
is then given up. Free of ROS.
"""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import FrameType
from typing import TypeVar

import numpy as np

from tcc_sim.analysis.control import Steps, Tracking
from tcc_sim.background import begun
from tcc_sim.errors import InputError, TccError
from tcc_sim.plant.closed_loop import ControlledRun

Result = TypeVar("Result")
LOOK = 0.05
"""Real time, s, between two looks at the work."""
ENDING = 1.0
"""Real time, s, that a thread which was given up has to end."""
_OWN = Path(__file__).resolve().parent.parent


class ControllerFailed(TccError, AssertionError):
    """A node under test died, hangs or does not answer; the sentence says which, and when."""


@dataclass(frozen=True, repr=False)
class LockstepRun(ControlledRun):
    """What a driveline did under the commands of the nodes under test.

    missed : ticks in which an awaited input had no new command: it was dropped, late, or refused
    target : slip speed that was asked for, rad/s, and the sample from which on; None where nobody said it
    """

    missed: int = 0
    target: tuple[float, int] | None = None

    def target_steps(self) -> Steps:
        """The target slip speed from the sample on at which it was last changed, rad/s."""
        return Steps.none() if self.target is None else Steps(self.t[self.target[1]:][:1], np.array([self.target[0]]))

    @cached_property
    def tracking(self) -> Tracking:
        """How well the slip speed's mean over each engine cycle held the target since it was last changed.

        Raises
        ------
        InputError
            Nobody said a target.
        """
        if self.target is None:
            raise InputError("no target: no node published target_slip_speed, and run(target=...) was not given")
        target, since = self.target
        return self.tracking_of(target, since)


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
