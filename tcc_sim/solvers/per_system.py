"""What follows from a system alone, kept for the systems that were asked for last: a short solve costs less than to
work it out again.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import Any, TypeVar, cast

from tcc_sim.model.parameters import System

Function = TypeVar("Function", bound=Callable[..., Any])
MOST = 64
"""Results kept; a sweep asks for a system a few times in a row, and never again."""


def per_system(function: Function) -> Function:
    """Keep what a function of a system, and of numbers, gave for the very same object; whoever asks must not change it.

    Systems are frozen, and to compare two of them field by field would cost more than most of what is kept.
    """
    kept: dict[tuple[Any, ...], tuple[System, Any]] = {}
    changing = Lock()

    @wraps(function)
    def found(system: System, *numbers: Any) -> Any:
        key = id(system), *numbers
        known = kept.get(key)
        if known is not None:
            return known[1]
        result = function(system, *numbers)
        with changing:
            while len(kept) >= MOST:
                del kept[next(iter(kept))]
            kept[key] = system, result  # The system is kept too, so that no other one gets its address.
        return result

    return cast(Function, found)
