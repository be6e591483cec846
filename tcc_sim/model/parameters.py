"""The parameters of the driveline: its groups of scene keys together, and keys by name.

Every field of a group is a scene key, `group.field`. SI units, angles in rad. The sign convention of the whole package:
slip speed is flywheel speed minus clutch plate speed, and a positive friction torque slows the flywheel and drives the
plate.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tcc_sim.errors import InputError
from tcc_sim.model.elements import with_whole_lists
from tcc_sim.model.groups import TABULATED, Clutch, Driveline, Engine, Friction, Initial, Pressure
from tcc_sim.model.quantity import PROFILES, Group, Quantity, Value, number_of
from tcc_sim.result import KEY_UNITS

if TYPE_CHECKING:
    from tcc_sim.model.profile import Floats, Inputs


@dataclass(frozen=True)
class System:
    """One driveline with its friction law, excitation and initial state. Frozen; every group is checked.

    Examples
    --------
    >>> import tcc_sim
    >>> system = tcc_sim.System()
    >>> system.pressure.frequency_ratio, round(system.cycle, 6)
    (1.0, 0.041888)
    """

    driveline: Driveline = Driveline()
    friction: Friction = Friction()
    clutch: Clutch = Clutch()
    engine: Engine = Engine()
    pressure: Pressure = Pressure()
    initial: Initial = Initial()
    inputs: Inputs | None = None
    """Torque and pressure from data instead of the scene's own."""

    @cached_property
    def profile(self) -> Floats | None:
        """What varies in time besides the sines, as `profile_of` says; None where nothing does."""
        if not self.varying:
            return None
        from tcc_sim.model.profile import profile_of
        return profile_of(self.engine, self.pressure, self.inputs)

    def cycle_start(self, number: Any) -> Any:
        """When engine cycles of these numbers, an array or one, start: where phi = 2 pi n; s."""
        if self.profile is None:
            return number * self.cycle
        from tcc_sim.model.profile import time_at

        return time_at(self.profile, 2.0 * math.pi * number)

    def cycles_until(self, t: float) -> float:
        """Engine cycles passed at time t, s: phi/(2 pi)."""
        if self.profile is None:
            return t / self.cycle
        from tcc_sim.model.profile import phase_at

        return float(phase_at(self.profile, t)) / (2.0 * math.pi)

    def whole_cycles(self, first: int, duration: float) -> int:
        """Whole engine cycles in so many seconds from the start of cycle `first` on."""
        if self.profile is None:
            return int(duration / self.cycle * (1.0 + 1e-12))
        return int(self.cycles_until(float(self.cycle_start(first)) + duration) * (1.0 + 1e-12)) - first

    @property
    def varying(self) -> list[str]:
        """What the profile holds, as keys."""
        return [f"{key}_times" for key in PROFILES if self._times(key)] + (["inputs"] if self.inputs else [])

    def _times(self, key: str) -> tuple[float, ...]:
        """The times of a key's profile; none where it has none."""
        group, name = key.split(".")
        found: tuple[float, ...] = getattr(getattr(self, group), f"{name}_times")
        return found

    @property
    def span(self) -> float:
        """The last time that a profile or the inputs tell of, s; 0 where there are none."""
        end = self.inputs.end if self.inputs else 0.0
        return max(t[-1] for t in (*map(self._times, PROFILES), (end,)) if t)

    def check_repeats(self, what: str) -> None:
        """Raise InputError, which says who can, where the excitation does not repeat and `what` needs that it does."""
        if self.profile is not None:
            raise InputError(f"{what} needs an excitation that repeats, and this scene has {', '.join(self.varying)}; "
                             "simulate and the driveline node solve it")

    @property
    def friction_ratio(self) -> float:
        """mu_s/mu_k: above 1 where friction falls with slip speed, below 1 where it rises."""
        return self.friction.static / self.friction.kinetic

    @property
    def largest_friction_ratio(self) -> float:
        """Bound of the friction coefficient at any slip speed over mu_k, at least 1."""
        from tcc_sim.model.friction import largest_ratio

        return largest_ratio(self.friction.stribeck)

    @property
    def torque_per_pressure(self) -> float:
        """mu_k A R of (5b), N m/Pa: saturation torque per pressure."""
        return self.friction.kinetic * self.clutch.area * self.clutch.radius

    @property
    def saturation_mean(self) -> float:
        """Tsm of (5b), N m."""
        return self.torque_per_pressure * self.pressure.mean

    @property
    def saturation_amplitude(self) -> float:
        """Tsp of (5b), N m; 0 where the pressure comes from a topic and falls back to its mean."""
        return self.torque_per_pressure * self.pressure.amplitude if self.pressure.harmonic else 0.0

    @property
    def inverse_inertia(self) -> float:
        """beta = 1/I1 + 1/I2, 1/(kg m^2)."""
        return 1.0 / self.driveline.flywheel_inertia + 1.0 / self.driveline.plate_inertia

    @property
    def natural_frequency(self) -> float:
        """omega_n = sqrt(K23/I2), rad/s (17c)."""
        return math.sqrt(self.driveline.stiffness / self.driveline.plate_inertia)

    @property
    def stuck_natural_frequency(self) -> float:
        """omega_sn = sqrt(K23/(I1 + I2)), rad/s: (27) as (28) then uses it (the print misplaces the root). Below it the
        positive slip falls into the first half of the engine cycle, above it into the second.
        """
        return math.sqrt(self.driveline.stiffness / (self.driveline.flywheel_inertia + self.driveline.plate_inertia))

    @property
    def cycle(self) -> float:
        """One engine cycle 2 pi/omega, s; the shortest where omega varies in time."""
        return 2.0 * math.pi / max(self.engine.frequency_values or (self.engine.frequency,))


GROUPS: dict[str, type[Group]] = {"driveline": Driveline, "friction": Friction, "clutch": Clutch, "engine": Engine,
                                  "pressure": Pressure, "initial": Initial}

QUANTITIES: dict[str, Quantity] = {
    f"{name}.{item.name}": item.metadata["quantity"] for name,
    group in GROUPS.items() for item in dataclasses.fields(group)}
"""Every scene key of the model with its meaning."""

KEY_UNITS.update({key: meaning.unit for key, meaning in QUANTITIES.items()})

_FIELDS = [item.name for item in dataclasses.fields(System)]
_PLACES = [(key, *key.split(".")) for key in QUANTITIES]
DEFAULTS: dict[str, Value] = {key: getattr(GROUPS[group], name) for key, group, name in _PLACES}


def values_of(system: System) -> Iterator[tuple[str, Value]]:
    """Every scene key of `system` with its value, in the order of QUANTITIES."""
    for key, group, name in _PLACES:
        yield key, getattr(getattr(system, group), name)


def unknown_key(key: str, known: Mapping[str, object] | list[str], kind: str = "a scene key") -> InputError:
    """The error for a key that does not exist, with the nearest one that does; `kind` says what it would be."""
    if "temperature" in key:
        return InputError(f"{key} is not {kind}: temperature is no state of this model; sweep over friction tables "
                          "that were measured at several temperatures instead")
    near = difflib.get_close_matches(key[:100], list(known), n=1, cutoff=0.5)
    return InputError(f"{key} is not {kind}" + (f"; did you mean {near[0]}?" if near else ""))


def coerce(key: str, value: object) -> Value:
    """A value as read from a file or a command line, as the type of `key`; an integer serves as a float."""
    if key not in QUANTITIES:
        raise unknown_key(key, QUANTITIES)
    quantity_, default = QUANTITIES[key], DEFAULTS[key]
    if isinstance(default, tuple):
        if not isinstance(value, (list, tuple)):
            raise InputError(f"{key} is {value!r}; it must be a list of numbers, each {quantity_.interval()}")
        try:
            out: Value = tuple(number_of(x) for x in value)
        except TypeError:
            raise InputError(f"{key} is {value!r}; it must be a list of numbers, each {quantity_.interval()}") from None
    elif isinstance(default, str):
        out = value if isinstance(value, str) else repr(value)
    else:
        try:
            out = number_of(value)
        except TypeError:
            raise InputError(f"{key} is {value!r}; it must be a number, {quantity_.interval()}") from None
    quantity_.check(key, out)
    return out


def replace(system: System, values: Mapping[str, object]) -> System:
    """`system` with the given scene keys changed, checked together; `KEY[n]` is number n of a list, from 1.

    Raises
    ------
    InputError
        An unknown key (with the nearest valid one), a wrong type, or a value out of its range.
    """
    changes: dict[str, dict[str, Value]] = {}
    values = with_whole_lists(values, lambda key: dict(values_of(system)).get(key))
    for key, value in values.items():
        checked = coerce(key, value)
        if key in PROFILES and f"{key}_times" in system.varying and f"{key}_times" not in values:
            raise InputError(f"{key} is not used where {key}_times is given; change that profile instead")
        if key in TABULATED and system.friction.slip_speeds and "friction.slip_speeds" not in values:
            raise InputError(f"{key} is not used where friction.slip_speeds and friction.coefficients are given; "
                             "change that table instead")
        group, name = key.split(".")
        changes.setdefault(group, {})[name] = checked
    out = object.__new__(System)  # Its fields are known to be right; a branch asks for one for every motion.
    for name in _FIELDS:
        own = getattr(system, name)
        vars(out)[name] = own.changed(changes[name]) if name in changes else own
    return out
