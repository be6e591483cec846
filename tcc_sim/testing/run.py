"""Result of a driveline under test, and detection of nodes that hang, without ROS."""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import FrameType
from typing import TypeVar

import numpy as np

from tcc_sim.analysis.loop.control import Steps, handovers
from tcc_sim.analysis.loop.tracking import Limits, Tracking
from tcc_sim.background import begun
from tcc_sim.errors import InputError, TccError
from tcc_sim.plant.closed_loop import ControlledRun
from tcc_sim.topics import INPUTS

Result = TypeVar("Result")
LOOK = 0.05
"""Real time between two checks of the work, s."""
ENDING = 1.0
"""Real time in which an abandoned thread must end, s."""
_PACKAGE = Path(__file__).resolve().parent.parent


class ControllerFailed(TccError, AssertionError):
    """A node under test died, hangs or does not answer; the message names it and the simulation time."""


@dataclass(frozen=True, repr=False)
class LockstepRun(ControlledRun):
    """Trajectory of a driveline under the commands of the nodes under test.

    missed : number of ticks in which an awaited input had no new command: it was dropped, late, or refused
    targets : every target slip speed, rad/s, with its first sample
    limits : smallest and largest pressure that the controller commands, Pa; None if unknown
    """

    missed: int = 0
    targets: tuple[tuple[float, int], ...] = ()
    limits: Limits | None = None

    @property
    def target(self) -> tuple[float, int] | None:
        """The last target slip speed, rad/s, and its first sample; None without a target."""
        return self.targets[-1] if self.targets else None

    def target_steps(self) -> Steps:
        """Return the target slip speed, rad/s."""
        return Steps(self.t[[sample for _, sample in self.targets]], np.array([value for value, _ in self.targets]))

    @cached_property
    def tracking(self) -> Tracking:
        """Tracking error of the slip speed's cycle means since the last jump of the target, or since commands of the
        pressure came last after a fallback of a cycle or more.

        Raises
        ------
        InputError
            There is no target.
        """
        if not self.targets:
            raise InputError("no target: no node published target_slip_speed, and run(target=...) was not given")
        reference = self.target_steps()
        jumps = self._loop(reference).jumps.t
        since = int(np.searchsorted(self.t, jumps[-1] if len(jumps) else reference.t[0]))
        if (held := self.commands.get(INPUTS[1])) is not None and len(self.t) > 1:
            cycle = round(self.cycle / float(self.t[1] - self.t[0]))
            since = max([since, *(row for row, _ in handovers(np.isfinite(held), max(cycle, 1)))])
        return self._tracking(reference, since, self.limits)


class GivenUp(BaseException):
    """Exception raised in a hanging thread to end it."""


class Worker:
    """Thread that runs one function at a time and abandons it if `beat` is not called for too long.

    Attributes
    ----------
    stuck : whether an abandoned function has not ended
    """

    def __init__(self) -> None:
        self.stuck = False
        self._beat = 0.0
        self._abandoned: list[threading.Thread] = []

    def beat(self) -> None:
        """Report progress; an abandoned function ends here."""
        if threading.current_thread() in self._abandoned:
            raise GivenUp
        self._beat = time.monotonic()

    def run(self, work: Callable[[], Result], patience: float, failed: Callable[[str], Exception]) -> Result:
        """Return the result of `work`, or raise its exception, or `failed(place)` if it hangs at a place in the code.

        patience : longest real time without progress, s
        """
        self.beat()
        outcome, thread = begun(work, name="nodes under test")
        try:
            while thread.is_alive():
                thread.join(LOOK)
                if thread.is_alive() and time.monotonic() - self._beat > patience:
                    raise failed(_innermost_line(sys._current_frames().get(thread.ident or 0)))
        finally:
            self._abandoned += [thread] * thread.is_alive()
            self.stuck = thread.is_alive() and not _ended(thread)
        return outcome.result()


def _innermost_line(frame: FrameType | None) -> str:
    innermost = frame
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if not (path.is_relative_to(_PACKAGE) or "site-packages" in path.parts or path.is_relative_to(sys.base_prefix)):
            return f"{frame.f_code.co_name} ({path.name}:{frame.f_lineno})"
        frame = frame.f_back
    return "its callback" if innermost is None else f"{innermost.f_code.co_name}"


def _ended(thread: threading.Thread) -> bool:
    """Raise GivenUp in a thread at its next line of Python; return whether the thread has ended.

    A thread that blocks outside of Python keeps the exception. CPython 3.11 then never enters a traced function again,
    so under coverage or a debugger this thread is not traced meanwhile, and takes the exception back.
    """
    trace = sys.gettrace()
    sys.settrace(None)
    _raise_in(thread.ident, GivenUp)
    thread.join(ENDING)
    if thread.is_alive():
        _raise_in(thread.ident, None)
        with suppress(GivenUp):  # The interpreter's mark of a kept exception goes when one is raised.
            _raise_in(threading.get_ident(), GivenUp)
            time.sleep(0.0)
    sys.settrace(trace)
    return not thread.is_alive()


def _raise_in(ident: int | None, exception: type[BaseException] | None) -> None:
    """Let a thread raise an exception at its next line of Python; None takes it back."""
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(ident or 0), exception and ctypes.py_object(exception))
