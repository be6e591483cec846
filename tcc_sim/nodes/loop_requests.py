"""What other threads ask of the real-time loop: done between two ticks, or withdrawn."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Outcome:
    """What came of a request: whether it was done, and else why not."""

    done: bool
    why: str = ""

    def __bool__(self) -> bool:
        return self.done


@dataclass
class Request:
    """Something asked of the loop between two ticks. Who takes `claim` first does it or withdraws it; then `done` is
    set.
    """

    action: Callable[[], bool]
    claim: threading.Lock = field(default_factory=threading.Lock)
    done: threading.Event = field(default_factory=threading.Event)
    outcome: Outcome = Outcome(False)

    def carry_out(self) -> None:
        """Do it unless it was withdrawn; an action that fails is an answer, not the end of the loop."""
        if not self.claim.acquire(blocking=False):
            return
        try:
            self.outcome = Outcome(self.action())
        except Exception as error:
            self.outcome = Outcome(False, str(error) or type(error).__name__)
        self.done.set()
