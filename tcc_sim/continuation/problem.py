"""Protocol of the systems whose motions are followed: a map from cycle to cycle, with derivatives and observations.

A textbook map is one instance, a scene of the driveline another (`DrivelineMap`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

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
    coarse : cheaper and nearly the same map, for guesses; or the map itself

    `evaluate` raises ArithmeticError where the system cannot be solved and ValueError outside its range.
    """

    dimension: int
    scales: Floats
    amplitude_scale: float
    forcing_period: int
    piecewise: bool
    divisible: bool

    @property
    def coarse(self) -> ParameterMap:
        """Nearly the same map, cheaper."""

    def evaluate(self, x: Floats, values: Values, first: float, cycles: float) -> Image:
        """The state after `cycles` cycles from `x` at the start of cycle `first`, with derivatives."""

    def evaluate_each(self, states: Floats, values: Values, firsts: Sequence[float],
                      cycles: Sequence[float]) -> list[Image]:
        """`evaluate` for several states (m, n), each with its start and its length."""

    def margins(self, x: Floats, values: Values, first: float, cycles: float) -> Margins:
        """Distances of these cycles from another event sequence."""


FAILURES = (ArithmeticError, ValueError, np.linalg.LinAlgError)
"""Exceptions of a map where it has no value; continuation then takes a smaller step."""
