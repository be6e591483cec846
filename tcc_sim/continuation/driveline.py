"""A scene of the driveline as a map from engine cycle to engine cycle, with some of its keys as free parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from tcc_sim.continuation.problem import Floats, Image, Margin, Margins, Observation, Values
from tcc_sim.continuation.settings import DEFAULTS as SETTINGS
from tcc_sim.errors import InputError
from tcc_sim.model.elements import list_of
from tcc_sim.model.parameters import DEFAULTS, System, replace, unknown_key, values_of
from tcc_sim.model.sines import common_cycles
from tcc_sim.solvers.engine import GRADIENT, GROWS, SCALES, VALUE
from tcc_sim.solvers.event_driven.margins import ARRIVAL, GRAZING, STUCK
from tcc_sim.solvers.stroboscopic import Prepared
from tcc_sim.sweeps.steady_state import settled_from_start
from tcc_sim.trajectory import Cycles


class DrivelineMap:
    """`ParameterMap` of one scene; states are slip speed, plate angle and plate speed at phase 0 of the engine.

    Raises
    ------
    InputError
        A key that is no number, that only says where a solution starts, or that would make the excitation aperiodic.
    """

    dimension, scales, amplitude_scale, divisible = 3, SCALES, 10.0, True

    def __init__(self, system: System, keys: Sequence[str], tolerance: float = SETTINGS.solver_tolerance) -> None:
        system.check_repeats("a map of the section")
        for key in keys:
            _check_key(system, key, keys)
        self.system, self.keys, self.tolerance = system, tuple(keys), tolerance
        self.piecewise = system.friction.law == "set_valued"
        self.forcing_period = common_cycles(system)
        if self.forcing_period == 0:
            raise InputError(f"pressure.frequency_ratio is {system.pressure.frequency_ratio:g}; periodic motions need "
                             "a ratio of whole numbers up to 1000")
        self._made: tuple[Values, System] | None = None
        self._prepared: tuple[Values, Prepared] | None = None
        self._last: tuple[Any, Image] | None = None
        if self.piecewise:
            # A scene without derivatives is refused here.
            Prepared(system, self.keys, tolerance)

    @cached_property
    def coarse(self) -> DrivelineMap:
        """The map at the tolerance of guesses."""
        return DrivelineMap(self.system, self.keys, SETTINGS.coarse_tolerance)

    def system_at(self, values: Values) -> System:
        """The scene's system with the free keys at `values`."""
        if self._made is None or self._made[0] != values:
            self._made = values, replace(self.system, dict(zip(self.keys, values)))
        return self._made[1]

    def evaluate(self, x: Floats, values: Values, first: float, cycles: float) -> Image:
        """The state `cycles` cycles on, with derivatives by the state and by the free keys."""
        asked = x.tobytes(), values, first, cycles
        if self._last is None or self._last[0] != asked:
            self._last = asked, self.evaluate_each(x[None], values, [first], [cycles])[0]
        return self._last[1]

    def evaluate_each(self, states: Floats, values: Values, firsts: Sequence[float],
                      cycles: Sequence[float]) -> list[Image]:
        """`evaluate` for several starts, with largest |slip speed|, stick fraction and event sequence."""
        prepared, out = self._prepare(values), []
        starts = np.array([self._settled(x) for x in states]) if self.piecewise else states
        ends = [first + count for first, count in zip(firsts, cycles)]
        for found, count in zip(prepared.each(starts, firsts, ends), cycles):
            if not all(math.isfinite(number) for number in found.state.tolist()):
                raise ArithmeticError("the state is not finite")
            heights = found.heights.tolist()
            seen = Observation(max(heights), found.stick_time / (count * prepared.period), found.events, tuple(heights))
            out.append(Image(found.state, found.derivatives, seen, found.heights_derivatives))
        return out

    def _prepare(self, values: Values) -> Prepared:
        """The system at these values, ready to be evaluated at many states."""
        if self._prepared is None or self._prepared[0] != values:
            self._prepared = values, Prepared(self.system_at(values), self.keys, self.tolerance)
        return self._prepared[1]

    def settled(self, values: Values, most: int) -> tuple[Cycles, int]:
        """`settled_from_start` of the scene."""
        # The set-valued law needs the map's tolerance: a border close to the motion decides which branch is followed.
        rtol = self.tolerance if self.piecewise else None
        return settled_from_start(self.system_at(values), most, rtol=rtol)

    def margins(self, x: Floats, values: Values, first: float, cycles: float) -> Margins:
        """Distances of the motion from grazing, from the edge of stick where slip ends, and from the end of stick."""
        of, system = self._prepare(values), self.system_at(values)
        found = of.over(self._settled(x), first, first + cycles, margins=True).margins if self.piecewise else None
        if found is None:
            return {}
        strength = system.friction_ratio * (system.saturation_mean + abs(system.saturation_amplitude))
        sizes = {"grazing": (GRAZING, self.amplitude_scale), "arrival": (ARRIVAL, strength), "stick": (STUCK, strength)}
        return {name: Margin(float(found[row, VALUE]) / size, found[row, GRADIENT:] / size, bool(found[row, GROWS]))
                for name, (row, size) in sizes.items() if math.isfinite(found[row, VALUE])}

    def _settled(self, x: Floats) -> Floats:
        """`x`, where the set-valued law sets a slip speed of rounding to 0."""
        if self.piecewise and abs(x[0]) < SETTINGS.stuck:
            x = x.copy()
            x[0] = 0.0
        return x


def _check_key(system: System, key: str, among: Sequence[str]) -> None:
    """Raise InputError unless periodic motions can be followed in `key`, one `among` those that are free."""
    if list_of(key) not in DEFAULTS:
        raise unknown_key(key, DEFAULTS)
    value = dict(values_of(system)).get(key, f"a number of {list_of(key)}")
    if not isinstance(value, float):
        raise InputError(f"{key} is {value!r}; motions are followed in a key that is one number")
    if key.startswith("initial."):
        raise InputError(f"{key} is where a solution starts; periodic motions do not depend on it")
    if key == "friction.smoothing" and system.friction.law == "set_valued":
        raise InputError("friction.smoothing has no effect with friction.law set_valued")
    if key in ("pressure.frequency_ratio", "pressure.phase") and system.saturation_amplitude == 0.0 \
            and "pressure.amplitude" not in among:
        raise InputError(f"{key} has no effect where pressure.amplitude is 0")
    coefficients = {"friction.kinetic_coefficient", "friction.static_coefficient"}
    if key == "friction.decay" and system.friction_ratio == 1.0 and not coefficients & set(among):
        raise InputError("friction.decay has no effect where friction.kinetic_coefficient is "
                         "friction.static_coefficient")
    if key == "pressure.frequency_ratio":
        raise InputError("pressure.frequency_ratio cannot be followed: between ratios of whole numbers the excitation "
                         "is not periodic")
