"""A scene of the driveline as a map from engine cycle to engine cycle, with some of its keys as free parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.equations import interface_torque
from tcc_sim.model.parameters import DEFAULTS, System, replace, unknown_key, values_of
from tcc_sim.model.sines import common_cycles
from tcc_sim.solvers import solve
from tcc_sim.solvers.smoothed.stroboscopic import Prepared, Stroboscopic
from tcc_sim.solvers.terms import terms_of
from tcc_sim.studies import differences
from tcc_sim.studies.maps import Floats, Image, Margins, Observation, Values
from tcc_sim.trajectory import State, Trajectory, event_sequence

RTOL = 1e-12
SCALES = (10.0, 0.1, 10.0)
"""Natural sizes of slip speed (rad/s), plate angle (rad) and plate speed (rad/s)."""
DENSE = 2000
"""Samples per engine cycle in which margins are looked for."""
EXACTLY_STUCK = 1e-12
"""Slip speed, rad/s, below which the set-valued law is taken to stick."""

DERIVATIVES: dict[str, Callable[..., Any]] = {"set_valued": differences.stroboscopic_map}
"""Where the map with its derivatives comes from, for the law that has no step of its own here."""


class DrivelineMap:
    """`ParameterMap` of one scene; states are slip speed, plate angle and plate speed at phase 0 of the engine.

    Raises
    ------
    InputError
        A key that is no number, that only says where a solution starts, or that would make the excitation aperiodic.
    """

    dimension = 3
    height_scale = 10.0

    def __init__(self, system: System, keys: Sequence[str]) -> None:
        for key in keys:
            _check_key(system, key)
        self.system, self.keys = system, tuple(keys)
        self.scales = np.array(SCALES)
        self.piecewise = system.friction.law == "set_valued"
        self.forcing_period = common_cycles(system)
        if self.forcing_period == 0:
            raise InputError(f"pressure.frequency_ratio is {system.pressure.frequency_ratio:g}; periodic motions need "
                             "a ratio of whole numbers up to 1000")
        self.divisible = not self.piecewise
        self._made: tuple[Values, System] | None = None
        self._prepared: tuple[Values, Prepared] | None = None
        self._last: tuple[Any, Stroboscopic] | None = None

    def system_at(self, values: Values) -> System:
        """The scene's system with the free keys at `values`."""
        if self._made is None or self._made[0] != values:
            self._made = values, replace(self.system, dict(zip(self.keys, values)))
        return self._made[1]

    def evaluate(self, x: Floats, values: Values, first: float, cycles: float) -> Image:
        """The state `cycles` cycles on, with derivatives by the state and by the free keys."""
        if self.divisible:
            return self._image(self._passed(x, values, first, cycles), cycles)
        system = self.system_at(values)
        exact = DERIVATIVES[system.friction.law](system, self._settled(x), cycles, start_cycle=first, rtol=RTOL,
                                                 parameters=self.keys)
        if not np.isfinite(exact.state).all():
            raise ArithmeticError("the state is not finite")
        return Image(exact.state, exact.derivative, exact.by_parameter)

    def evaluate_each(self, states: Floats, values: Values, firsts: Sequence[float],
                      cycles: Sequence[float]) -> list[Image]:
        """`evaluate` for several starts."""
        if not self.divisible:
            return [self.evaluate(*each) for each in zip(states, [values] * len(states), firsts, cycles)]
        return [self._image(found, count) for found, count in zip(self._each(states, values, firsts, cycles), cycles)]

    def _image(self, found: Stroboscopic, cycles: float) -> Image:
        """A smoothed motion as the map's image."""
        climb = np.concatenate([found.heights_by_state, found.heights_by_parameter], axis=1)
        return Image(found.state, found.derivative, found.by_parameter, self._seen(found, cycles), climb)

    def observe(self, x: Floats, values: Values, first: int, cycles: int) -> Observation:
        """Largest |slip speed|, stick fraction and event sequence."""
        if self.divisible:
            return self._seen(self._passed(x, values, first, cycles), cycles)
        solved = self.solved(x, values, first, cycles)
        kept, moves = solved.cycles, solved.transitions
        assert kept is not None
        heights = np.maximum(kept.highest, -kept.lowest)
        return Observation(float(heights.max()), float(kept.stick_time.sum()) / (cycles * solved.cycle),
                           event_sequence(moves.before, moves.after, int(solved.state[0])),
                           tuple(heights.tolist()))

    def _passed(self, x: Floats, values: Values, first: float, cycles: float) -> Stroboscopic:
        """The smoothed motion with all there is to know of it; the last one is kept for who asks again."""
        asked = x.tobytes(), values, first, cycles
        if self._last is None or self._last[0] != asked:
            self._last = asked, self._each(x[None], values, [first], [cycles])[0]
        return self._last[1]

    def _each(self, states: Floats, values: Values, firsts: Sequence[float],
              cycles: Sequence[float]) -> list[Stroboscopic]:
        """Smoothed motions from several starts."""
        if self._prepared is None or self._prepared[0] != values:
            self._prepared = values, Prepared(self.system_at(values), self.keys, RTOL)
        found = self._prepared[1].each(states, firsts, [first + count for first, count in zip(firsts, cycles)])
        if not all(np.isfinite(part.state).all() for part in found):
            raise ArithmeticError("the state is not finite")
        return found

    def _seen(self, found: Stroboscopic, cycles: float) -> Observation:
        """What is seen of a smoothed motion."""
        assert self._prepared is not None
        heights = found.heights.tolist()
        return Observation(max(heights), found.stick_time / (cycles * self._prepared[1].period), found.events,
                           tuple(heights))

    def solved(self, x: Floats, values: Values, first: int, cycles: int, samples: int = 0) -> Trajectory:
        """The trajectory itself."""
        x = self._settled(x)
        return solve(self.system_at(values), cycles=cycles, start_cycle=first, rtol=RTOL, samples_per_cycle=samples,
                     state=State(float(x[0]), float(x[1]), float(x[2]))).raise_for_status()

    def margins(self, x: Floats, values: Values, first: int, cycles: int) -> Margins:
        """Distances of the motion from grazing, from the edge of stick where slip ends, and from the end of stick."""
        system = self.system_at(values)
        run = self.solved(x, values, first, cycles, DENSE)
        terms, ratio = terms_of(system), system.friction_ratio
        strength = ratio * run.saturation_torque
        need = interface_torque(run.plate_angle, run.plate_speed, run.engine_torque, terms.linear)
        margin = (strength - np.abs(need)) / max(float(strength.max()), 1e-300)
        speed = np.abs(run.slip_speed) / self.height_scale
        slips = run.state != 0
        grazing = _smallest_dip(speed, slips & (speed > 0.0))
        stick = _smallest_dip(margin, ~slips)
        ends = np.flatnonzero(np.isin(run.transitions.before, (-1, 1)))
        arrival, grows = np.inf, False
        for k in ends:
            i = min(max(int(np.searchsorted(run.t, run.transitions.time[k])), 1), len(run.t) - 1)
            fraction = (run.transitions.time[k] - run.t[i - 1]) / (run.t[i] - run.t[i - 1])
            size = abs(float(margin[i - 1] + fraction * (margin[i] - margin[i - 1])))
            if size < arrival:
                arrival, grows = size, bool(margin[i] > margin[i - 1])
        return Margins(grazing, arrival, grows, stick)

    def _settled(self, x: Floats) -> Floats:
        """`x`, with a slip speed that differs from 0 by rounding only at 0 under the set-valued law."""
        if self.piecewise and x[0] != 0.0 and abs(x[0]) < EXACTLY_STUCK:
            x = x.copy()
            x[0] = 0.0
        return x


def _check_key(system: System, key: str) -> None:
    """Raise InputError unless periodic motions can be followed in `key`."""
    if key not in DEFAULTS:
        raise unknown_key(key, DEFAULTS)
    value = dict(values_of(system))[key]
    if not isinstance(value, float):
        raise InputError(f"{key} is {value!r}; motions are followed in a key that is one number")
    if key.startswith("initial."):
        raise InputError(f"{key} is where a solution starts; periodic motions do not depend on it")
    if key == "friction.smoothing" and system.friction.law == "set_valued":
        raise InputError("friction.smoothing has no effect with friction.law set_valued")
    if key == "pressure.frequency_ratio" and system.saturation_amplitude == 0.0:
        raise InputError("pressure.frequency_ratio has no effect where pressure.amplitude is 0")
    if key == "pressure.frequency_ratio":
        raise InputError("pressure.frequency_ratio cannot be followed: between ratios of whole numbers the excitation "
                         "is not periodic")


def _smallest_dip(size: Floats, within: Any) -> float:
    """The smallest interior local minimum of `size` where `within` holds, by a parabola; inf where there is none."""
    inner = within[1:-1] & within[:-2] & within[2:] & (size[1:-1] <= size[:-2]) & (size[1:-1] < size[2:])
    best = np.inf
    for i in np.flatnonzero(inner) + 1:
        a, b, c = float(size[i - 1]), float(size[i]), float(size[i + 1])
        bend = a - 2.0 * b + c
        best = min(best, b - (c - a) ** 2 / (8.0 * bend) if bend > 0.0 else b)
    return float(best)
