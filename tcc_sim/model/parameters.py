"""The parameters of the driveline: Table 1 of Duan and Singh, with units and allowed ranges.

Every field of a group is a scene key, `group.field`. SI units, angles in rad. The sign convention of the whole package:
slip speed is flywheel speed minus clutch plate speed, and a positive friction torque slows the flywheel and drives the
plate. The defaults are those of Fig. 2.
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
from tcc_sim.model.quantity import LATEST, PROFILES, Group, Quantity, Value, apart, number_of, quantity

if TYPE_CHECKING:
    from tcc_sim.model.course import Floats, Inputs

FIG02_PRESSURE = 500.0 / (0.24 * 0.08 * 0.1)
"""Mean pressure, Pa, at which Tsm = 500 N m with mu_k = 0.8 mu_s, as the caption of Fig. 2 states."""
PRESSURE_MAXIMUM, TORQUE_MAXIMUM = 1e7, 1e5


@dataclass(frozen=True)
class Driveline(Group):
    """The linear part of equations (1): two inertias, and the spring and damper that hold the plate."""

    flywheel_inertia: float = quantity(0.20, "flywheel inertia I1", "kg m^2", 1e-6, 1e3)
    plate_inertia: float = quantity(0.02, "clutch plate inertia I2 (friction shoe and pressure plate)", "kg m^2", 1e-6,
                                    1e3)
    damping: float = quantity(0.6, "driveline viscous damping C23", "N m s/rad", 0.0, 1e4)
    stiffness: float = quantity(3000.0, "driveline stiffness K23", "N m/rad", 0.0, 1e8, above=True)


@dataclass(frozen=True)
class Friction(Group):
    """The friction law: (6) set-valued, (7) smoothed."""

    law: str = quantity("smoothed", "friction law: (7) smoothed or (6) set_valued", choices=("smoothed", "set_valued"))
    static_coefficient: float = quantity(0.3, "static friction coefficient mu_s", "", 0.0, 2.0, above=True, live=True)
    kinetic_coefficient: float = quantity(0.24, "kinetic friction coefficient mu_k, at most mu_s", "", 0.0, 2.0,
                                          above=True, live=True)
    decay: float = quantity(2.0, "decay alpha of the friction coefficient with slip speed", "s/rad", 0.0, 1e3)
    smoothing: float = quantity(50.0, "smoothing factor sigma of law (7)", "s/rad", 1.0, 1e12)

    def check_together(self) -> None:
        """Raise InputError unless mu_s/mu_k is 1 to 20."""
        if self.kinetic_coefficient > self.static_coefficient:
            raise InputError("friction.kinetic_coefficient is "
                             f"{apart(self.kinetic_coefficient, self.static_coefficient)}; it must be at most "
                             f"friction.static_coefficient, {apart(self.static_coefficient, self.kinetic_coefficient)}")
        if self.static_coefficient > 20.0 * self.kinetic_coefficient:
            raise InputError(f"friction.kinetic_coefficient is {self.kinetic_coefficient:g}; it must be at least one "
                             f"twentieth of friction.static_coefficient, {self.static_coefficient:g}")


@dataclass(frozen=True)
class Clutch(Group):
    """The geometry that turns pressure into torque."""

    area: float = quantity(0.08, "pressure area A", "m^2", 0.0, 10.0, above=True)
    radius: float = quantity(0.1, "friction moment arm R", "m", 0.0, 10.0, above=True)


@dataclass(frozen=True)
class Excitation(Group):
    """A part of the excitation, which the scene gives or commands on a topic do."""

    source: str = quantity("harmonic", "where it comes from: the scene, or commands", choices=("harmonic", "topic"))
    fallback: str = quantity("mean", "with source topic, what applies until the first command and after a time-out: "
                             "the mean, or the scene's own harmonic course at simulation time",
                             choices=("mean", "harmonic"))

    @property
    def harmonic(self) -> bool:
        """Whether the scene's own course ever applies: always, or as the fallback beside commands."""
        return "harmonic" in (self.source, self.fallback)


@dataclass(frozen=True)
class Engine(Excitation):
    """Engine torque Te = Tm + Tp sin(omega t) + sum over n >= 2 of Tpn sin(n omega t + phi_n), Section 2.2."""

    mean_torque: float = quantity(300.0, "mean engine torque Tm", "N m", -TORQUE_MAXIMUM, TORQUE_MAXIMUM, live=True)
    torque_amplitude: float = quantity(250.0, "amplitude Tp of the first harmonic", "N m", 0.0, TORQUE_MAXIMUM,
                                       live=True)
    frequency: float = quantity(150.0, "angular frequency omega of the first harmonic; an engine cycle is 2 pi/omega",
                                "rad/s", 1e-3, 1e5, live=True)
    harmonic_amplitudes: tuple[float, ...] = quantity((), "amplitudes of harmonics 2, 3, ... of omega", "N m",
                                                      0.0, TORQUE_MAXIMUM)
    harmonic_phases: tuple[float, ...] = quantity((), "phases of harmonics 2, 3, ... of omega", "rad", -100.0, 100.0)
    frequency_times: tuple[float, ...] = quantity((), "times at which engine.frequency_values hold, the first 0", "s",
                                                  0.0, LATEST)
    frequency_values: tuple[float, ...] = quantity((), "omega at these times, linear between them and constant "
                                                   "afterwards; engine.frequency is then not used", "rad/s", 1e-3, 1e5)
    mean_torque_times: tuple[float, ...] = quantity((), "times at which engine.mean_torque_values hold, the first 0",
                                                    "s", 0.0, LATEST)
    mean_torque_values: tuple[float, ...] = quantity((), "Tm at these times, likewise in the place of "
                                                     "engine.mean_torque", "N m", -TORQUE_MAXIMUM, TORQUE_MAXIMUM)

    def check_together(self) -> None:
        """Raise InputError unless profiles and harmonics have as many values in each list."""
        self.check_profile("frequency")
        self.check_profile("mean_torque")
        if len(self.harmonic_amplitudes) != len(self.harmonic_phases):
            raise InputError(f"engine.harmonic_phases has {len(self.harmonic_phases)} values; it must have as many as "
                             f"engine.harmonic_amplitudes, {len(self.harmonic_amplitudes)}")
        if len(self.harmonic_amplitudes) > 32:
            raise InputError(f"engine.harmonic_amplitudes has {len(self.harmonic_amplitudes)} values; at most 32 are "
                             "allowed")


@dataclass(frozen=True)
class Pressure(Excitation):
    """Actuation pressure P = Pm + Pp sin(omega_f t + psi), equation (3), never below 0."""

    mean: float = quantity(FIG02_PRESSURE, "mean pressure Pm", "Pa", 0.0, PRESSURE_MAXIMUM, live=True)
    amplitude: float = quantity(FIG02_PRESSURE / 5.0, "pressure amplitude Pp; the sum is clamped at 0", "Pa", 0.0,
                                PRESSURE_MAXIMUM, live=True)
    frequency_ratio: float = quantity(1.0, "omega_f/omega", "", 0.0, 100.0, above=True, live=True)
    phase: float = quantity(0.0, "pressure phase psi relative to the engine torque", "rad", -100.0, 100.0, live=True)
    mean_times: tuple[float, ...] = quantity((), "times at which pressure.mean_values hold, the first 0", "s", 0.0,
                                             LATEST)
    mean_values: tuple[float, ...] = quantity((), "Pm at these times, linear between them and constant afterwards; "
                                              "pressure.mean is then not used", "Pa", 0.0, PRESSURE_MAXIMUM)

    def check_together(self) -> None:
        """Raise InputError unless the profile has as many values as times."""
        self.check_profile("mean")


@dataclass(frozen=True)
class Initial(Group):
    """Initial state; the default is (13) with Omega_e = 150 rad/s. The flywheel angle starts at the plate angle."""

    slip_speed: float = quantity(150.0, "initial slip speed", "rad/s", -1e5, 1e5)
    plate_angle: float = quantity(0.0, "initial plate angle theta2", "rad", -1e3, 1e3)
    plate_speed: float = quantity(0.0, "initial plate speed", "rad/s", -1e5, 1e5)


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
    def course(self) -> Floats | None:
        """What varies in time besides the sines, as `course.course_of` says; None where nothing does."""
        if not self.varying:
            return None
        from tcc_sim.model.course import course_of
        return course_of(self.engine, self.pressure, self.inputs)

    def cycle_start(self, number: Any) -> Any:
        """When engine cycles of these numbers, an array or one, start: where phi = 2 pi n; s."""
        if self.course is None:
            return number * self.cycle
        from tcc_sim.model.course import time_at

        return time_at(self.course, 2.0 * math.pi * number)

    def cycles_until(self, t: float) -> float:
        """Engine cycles passed at time t, s: phi/(2 pi)."""
        if self.course is None:
            return t / self.cycle
        from tcc_sim.model.course import phase_at

        return float(phase_at(self.course, t)) / (2.0 * math.pi)

    def whole_cycles(self, first: int, duration: float) -> int:
        """Whole engine cycles in so many seconds from the start of cycle `first` on."""
        if self.course is None:
            return int(duration / self.cycle * (1.0 + 1e-12))
        return int(self.cycles_until(float(self.cycle_start(first)) + duration) * (1.0 + 1e-12)) - first

    @property
    def varying(self) -> list[str]:
        """What the course holds, as keys."""
        given = self.engine.frequency_times, self.engine.mean_torque_times, self.pressure.mean_times
        return [f"{key}_times" for key, times in zip(PROFILES, given) if times] + (["inputs"] if self.inputs else [])

    @property
    def span(self) -> float:
        """The last time that a profile or the inputs tell of, s; 0 where there are none."""
        e, end = self.engine, self.inputs.end if self.inputs else 0.0
        return max(t[-1] for t in (e.frequency_times, e.mean_torque_times, self.pressure.mean_times, (end,)) if t)

    def check_repeats(self, what: str) -> None:
        """Raise InputError, which says who can, where the excitation does not repeat and `what` needs that it does."""
        if self.course is not None:
            raise InputError(f"{what} needs an excitation that repeats, and this scene has {', '.join(self.varying)}; "
                             "simulate and the driveline node solve it")

    @property
    def friction_ratio(self) -> float:
        """mu_s/mu_k, at least 1."""
        return self.friction.static_coefficient / self.friction.kinetic_coefficient

    @property
    def torque_per_pressure(self) -> float:
        """mu_k A R of (5b), N m/Pa: saturation torque per pressure."""
        return self.friction.kinetic_coefficient * self.clutch.area * self.clutch.radius

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

_FIELDS = [item.name for item in dataclasses.fields(System)]
_PLACES = [(key, *key.split(".")) for key in QUANTITIES]
DEFAULTS: dict[str, Value] = {key: getattr(GROUPS[group], name) for key, group, name in _PLACES}


def values_of(system: System) -> Iterator[tuple[str, Value]]:
    """Every scene key of `system` with its value, in the order of QUANTITIES."""
    for key, group, name in _PLACES:
        yield key, getattr(getattr(system, group), name)


def unknown_key(key: str, known: Mapping[str, object] | list[str], kind: str = "a scene key") -> InputError:
    """The error for a key that does not exist, with the nearest one that does; `kind` says what it would be."""
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
    """`system` with the given scene keys changed, checked together.

    Raises
    ------
    InputError
        An unknown key (with the nearest valid one), a wrong type, or a value out of its range.
    """
    changes: dict[str, dict[str, Value]] = {}
    for key, value in values.items():
        checked = coerce(key, value)
        if key in PROFILES and f"{key}_times" in system.varying and f"{key}_times" not in values:
            raise InputError(f"{key} is not used where {key}_times is given; change that profile instead")
        group, name = key.split(".")
        changes.setdefault(group, {})[name] = checked
    out = object.__new__(System)  # Its fields are known to be right; a branch asks for one for every motion.
    for name in _FIELDS:
        own = getattr(system, name)
        vars(out)[name] = own.changed(changes[name]) if name in changes else own
    return out
