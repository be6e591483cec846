"""Protocol of the systems whose motions are followed: a map from cycle to cycle, with derivatives and observations.

A textbook map is one instance, a scene of the driveline another (`DrivelineMap`). Changes of the event sequence of a
motion are the bifurcations that only set-valued friction has: grazing-, crossing-, switching- and adding-sliding
(M. di Bernardo, P. Kowalczyk, A. Nordmark, Bifurcations of dynamical systems with sliding, Physica D 170 (2002)).
Sequences are compared as rings: an event that passes phase 0 changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tcc_sim.errors import OutOfRange

REPEATS = 8  # most changes of one kind at once (a symmetric motion has pairs of them)

Floats = NDArray[np.float64]
Values = tuple[float, ...]
"""Values of the free parameters, in the order of the map's keys."""


class Observation(NamedTuple):
    """Observation of a motion over some cycles.

    largest : the largest size of the motion (for the driveline |slip speed|, rad/s)
    stick_fraction : 0 to 1
    events : the sequence of modes, such as "S+S"; empty for a map without
    amplitudes : the largest size in each cycle, which can change much where the section hardly moves
    """

    largest: float
    stick_fraction: float
    events: str
    amplitudes: tuple[float, ...] = ()


UNSEEN = Observation(0.0, 0.0, "")
"""Observation where there is nothing to observe."""


class Image(NamedTuple):
    """Image of a state after some cycles, with derivatives.

    value : (n,) state after them
    derivatives : (n, n + P) with respect to the state before them, and to the free parameters
    seen : observation of these cycles
    amplitude_gradient : (N, n + P) derivatives of the N observed amplitudes, likewise, if the map has them
    """

    value: Floats
    derivatives: Floats
    seen: Observation = UNSEEN
    amplitude_gradient: Floats | None = None

    @property
    def jacobian(self) -> Floats:
        """(n, n) derivative with respect to the state before."""
        return self.derivatives[:, :len(self.value)]


class Margin(NamedTuple):
    """Distance of a motion from a change of its event sequence, relative to a natural size.

    slopes : (n + P,) derivatives of the value by the state and the free parameters
    grows : whether stick's margin grows where slip ends
    """

    value: float
    slopes: Floats
    grows: bool = False


Margins = Mapping[str, Margin]
"""Margins of a motion that has them, by name.

grazing : smallest |slip speed| at an extremum within slip
arrival : r Ts - |lambda| where slip ends, the one nearest to 0, negative where slip goes on the other way
stick : smallest margin r Ts - |lambda| at a minimum within stick
"""


class ParameterMap(Protocol):
    """A map with free parameters, from the start of cycle `first` over `cycles` cycles.

    dimension : number of states n
    scales : (n,) natural sizes of the states, in which distances are measured
    amplitude_scale : natural size of `Observation.largest` and of the amplitudes
    forcing_period : cycles after which the map repeats (1 where it is the same in every cycle)
    piecewise : whether the event sequence changes the map (set-valued friction)
    divisible : whether `first` and `cycles` of `evaluate` may be parts of cycles

    `evaluate` raises ArithmeticError where the system cannot be solved and ValueError outside its range.
    """

    dimension: int
    scales: Floats
    amplitude_scale: float
    forcing_period: int
    piecewise: bool
    divisible: bool

    def evaluate(self, x: Floats, values: Values, first: float, cycles: float) -> Image:
        """The state after `cycles` cycles from `x` at the start of cycle `first`, with derivatives."""

    def evaluate_each(self, states: Floats, values: Values, firsts: Sequence[float],
                      cycles: Sequence[float]) -> list[Image]:
        """`evaluate` for several states (m, n), each with its start and its length."""

    def margins(self, x: Floats, values: Values, first: float, cycles: float) -> Margins:
        """Distances of these cycles from another event sequence."""


FAILURES = (ArithmeticError, OutOfRange, np.linalg.LinAlgError)
"""Exceptions of a map where it has no value; continuation then takes a smaller step. A refusal is none of them."""


def ring(events: str) -> str:
    """The event sequence of a periodic motion as a ring: first and last mode joined, in the least rotation."""
    if len(events) > 1 and events[0] == events[-1]:
        events = events[:-1]
    return min(events[k:] + events[:k] for k in range(len(events))) if events else events


RULES: dict[str, tuple[tuple[str, str], ...]] = {
    "adding_sliding": (("S+S", "S"), ("S-S", "S")),
    "grazing_sliding": (("+S+", "+"), ("-S-", "-"), ("+-+", "+"), ("-+-", "-")),
    "crossing_sliding": (("+S-", "+-"), ("-S+", "-+")),
    "switching_sliding": (("+-S", "+S"), ("-+S", "-S")),
}
"""By kind, parts of the longer sequence with the parts of the shorter one that replace them."""


def _reduced(longer: str, rules: tuple[tuple[str, str], ...], shorter: str) -> bool:
    """Whether replacing parts of the ring `longer`, once or more, gives the ring `shorter`."""
    texts = {longer}
    for _ in range(REPEATS):
        texts = {new for text in texts for pattern, by in rules for new in _replaced(text, pattern, by)}
        if shorter in texts:
            return True
    return False


def _replaced(text: str, pattern: str, by: str) -> set[str]:
    """The rings in which `by` replaces `pattern` at one of its places on the ring `text`."""
    out = set()
    for k in range(len(text)):
        turned = text[k:] + text[:k]
        if turned.startswith(pattern):
            out.add(ring(by + turned[len(pattern):]))
        elif len(turned) == len(pattern) - 1 and turned + turned[0] == pattern:
            out.add(by[0])
    return out


MARGINS = {"adding_sliding": "stick", "grazing_sliding": "grazing", "crossing_sliding": "arrival",
           "switching_sliding": "arrival", "stick_border": "stick"}
"""By kind, the margin that vanishes."""


def kind_of_change(before: str, after: str, near: Sequence[Margins]) -> str:
    """The kind of bifurcation between two event sequences; of several the one with the least of the margins `near`."""
    longer, shorter = sorted((ring(before), ring(after)), key=len, reverse=True)
    if shorter == "S":
        return "stick_border"
    # Both an interval of slip and one of stick that vanish make S+S of S+S+S.
    kinds = [kind for kind, rules in RULES.items() if _reduced(longer, rules, shorter)]
    kind = min(kinds or list(RULES)[:3], key=lambda kind: margin_residual(kind, near))
    if kinds or kind != "crossing_sliding":
        return kind
    arrival = min((m["arrival"] for m in near if "arrival" in m), key=lambda m: abs(m.value))
    return "switching_sliding" if arrival.grows else kind


def margin_residual(kind: str, near: Sequence[Margins]) -> float:
    """The least size of the margin that vanishes at a bifurcation of this kind, relative to its natural size."""
    return min((abs(m[MARGINS[kind]].value) for m in near if MARGINS[kind] in m), default=math.inf)


def differ(one: str, two: str) -> bool:
    """Whether two event sequences differ as rings."""
    return ring(one) != ring(two)
