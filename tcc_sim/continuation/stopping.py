"""Why a branch or a curve ends: a value with its sentence, as `Status` is one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class StopReason(Enum):
    """Each with its sentence: the parameter's `name` and `value`, a `limit` that was met, `what` special point."""

    RANGE = "{name} reached {value:.9g}, the end of the range"
    CLOSED = "closed: back at its first point, {name} = {value:.9g}"
    DOUBLING = "ended in a period doubling of motions of a shorter period at {name} = {value:.9g}"
    BEGAN = "began in the period doubling at {name} = {value:.9g}"
    CANARD = ("ended at {name} = {value:.9g}: beyond it a multiplier is above {limit:g}, a canard, which double "
              "precision does not resolve")
    CANARD_CURVE = ("ended at {name} = {value:.9g}: beyond it a disturbance grows by more than {limit:g} along a part "
                    "of the motion, a canard, which double precision does not resolve")
    FAMILY = ("met a family of motions with a multiplier of exactly 1 at {name} = {value:.9g}: no branch can be "
              "followed through it")
    POINTS = "stopped after {limit:g} points at {name} = {value:.9g}"
    TRIES = "given up after {limit:g} steps tried at {name} = {value:.9g}: no progress"
    STEP = ("no further point was found beyond {name} = {value:.9g}: no step, however short, met a residual of "
            "{limit:g}")
    SPECIAL = "ended in a {what} at {name} = {value:.9g}"
    INTERRUPTED = "interrupted at {name} = {value:.9g}"


@dataclass(frozen=True)
class End:
    """One end of a branch: the reason, and the parameter there."""

    reason: StopReason
    name: str
    value: float
    limit: float = 0.0
    what: str = ""

    def __str__(self) -> str:
        """The sentence."""
        return self.reason.value.format(name=self.name, value=self.value, limit=self.limit, what=self.what)
