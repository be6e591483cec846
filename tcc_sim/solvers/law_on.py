"""The text of the friction law (`model.friction`) on rows of nodes and on numbers that carry their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from tcc_sim.compiling.compiled import rebound
from tcc_sim.compiling.unrolled import exp, limited, magnitude, with_sign
from tcc_sim.model import friction


class LawText(NamedTuple):
    """The functions of `model.friction` of these names, on other numbers than floats and arrays."""

    exponentials_at: Callable[..., Any]
    step_and_rest: Callable[..., Any]
    with_slope: Callable[..., Any]
    smoothed_coefficient: Callable[..., Any]
    sliding: Callable[..., Any]


def law_on(decaying: Callable[[Any], Any], size: Callable[[Any], Any] = magnitude,
           tanh: Callable[[Any], Any] | None = None) -> LawText:
    """Return the law with other functions for the exponential of -a |v|, for |v| and for tanh."""
    exponentials_at = rebound(friction.exponentials_at, decayed=rebound(friction.decayed, exp=decaying))
    return LawText(exponentials_at, rebound(friction.step_and_rest, exp=exp, magnitude=magnitude, with_sign=with_sign),
               friction.with_slope,
               rebound(friction.smoothed_coefficient, exponentials_at=exponentials_at, magnitude=size, tanh=tanh),
               rebound(friction.sliding, exponentials_at=exponentials_at))


def continued(x: Any) -> Any:
    """Return e^x of a staged function for x = -a |v|, which a |v| continued through v = 0 may take above 0, up to 1."""
    return exp(limited(x, -700.0, 1.0))


STAGED = law_on(continued)
"""The law on names of staged functions (`compiling.unrolled`), single or in rows, or on plain numbers."""
