"""Requests of other threads to the real-time loop, carried out between two ticks or withdrawn."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Outcome:
    """Outcome of a request: whether it was done, and the reason if it was not."""

    done: bool
    why: str = ""

    def __bool__(self) -> bool:
        return self.done


@dataclass
class Request:
    """Request to the loop; the thread that acquires `claim` first carries it out or withdraws it, then sets `done`."""

    action: Callable[[], bool]
    claim: threading.Lock = field(default_factory=threading.Lock)
    done: threading.Event = field(default_factory=threading.Event)
    outcome: Outcome = Outcome(False)

    def carry_out(self) -> None:
        """Call the action unless the request was withdrawn; an exception becomes the outcome and does not end the loop.
        """
        if not self.claim.acquire(blocking=False):
            return
        try:
            self.outcome = Outcome(self.action())
        except Exception as error:
            self.outcome = Outcome(False, str(error) or type(error).__name__)
        self.done.set()
