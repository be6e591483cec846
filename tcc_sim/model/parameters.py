"""Parameters of the driveline: all groups of scene keys, and access by key.

Every field of a group is a scene key, `group.field`. SI units, angles in rad. Sign convention of the whole package:
slip speed is flywheel speed minus clutch plate speed, and a positive friction torque slows the flywheel and drives the
plate.

The speed of the crankshaft is a key too: engine.frequency = engine.order engine.speed. A system keeps the speeds that
were given (`System.speeds`), so that a change of engine.order keeps them and changes the frequency. A frequency that
was given stays as it is. Single numbers of lists are keys: `engine.harmonic_amplitudes[1]` is the first number, of
harmonic 2. A list that has a profile (`model.quantity.PROFILES`) takes a profile of one of its numbers: `KEY[n]_times`
and `KEY[n]_values`; the others stay as the scene has them.
"""

from __future__ import annotations

import dataclasses
import difflib
import itertools
import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tcc_sim.errors import InputError
from tcc_sim.model.groups import TABLE, TABULATED, Clutch, Converter, Driveline, Engine, Friction, Initial, Pressure
from tcc_sim.model.quantity import PROFILES, Group, Quantity, Value, number_in, number_of
from tcc_sim.result import KEY_UNITS

if TYPE_CHECKING:
    from tcc_sim.model.profile import Floats, Inputs

SPEED, FREQUENCY, ORDER = "engine.speed", "engine.frequency", "engine.order"
DERIVED = {
    SPEED: Quantity("speed of the crankshaft: engine.frequency over engine.order", "rad/s",
                    label=r"crankshaft speed $\omega/n$"),
    f"{SPEED}_times": Quantity("times at which engine.speed_values hold, the first 0", "s"),
    f"{SPEED}_values": Quantity("speed of the crankshaft at these times, linear between them", "rad/s")}
"""The key and those of its profile, with their meanings."""
KEY_UNITS[SPEED] = "rad/s"
Speeds = Mapping[str, float | tuple[float, ...]]
"""Speeds of the crankshaft by key, rad/s: one, or those of its profile."""


def frequency_key(key: str) -> str:
    """Return the key of the frequency that a key of the speed defines; any other key as it is."""
    return key.replace(SPEED, FREQUENCY) if key in DERIVED else key


def with_frequency(values: Mapping[str, object], engine: Engine, kept: Speeds) -> tuple[Mapping[str, object], Speeds]:
    """Return scene values with speeds, given or kept, replaced by frequencies, and the speeds that are now given.

    Raises InputError: engine.frequency is given beside engine.speed, or a value is no speed.
    """
    given = [key for key in DERIVED if key in values]
    frequencies = [name for key in DERIVED if (name := frequency_key(key)) in values]
    if given and frequencies:
        raise InputError(f"{given[0]} and {frequencies[0]} are both given, and engine.frequency is engine.order times "
                         "engine.speed; remove one of them")
    speeds = {} if frequencies else dict(kept)
    if not given and not (speeds and ORDER in values):
        return values, speeds
    if given:
        speeds.setdefault(SPEED, engine.frequency / engine.order)
        speeds.update((key, _speed(key, values[key])) for key in given if not key.endswith("_times"))
    try:
        order = number_in(values.get(ORDER, engine.order), "")
    except TypeError:
        return values, speeds  # The order itself is refused later.
    changes = {frequency_key(key): value for key, value in values.items()}
    for key, speed in speeds.items():
        changes[frequency_key(key)] = [order * x for x in speed] if isinstance(speed, tuple) else order * speed
    return changes, speeds


def _speed(key: str, value: object) -> float | tuple[float, ...]:
    """Return a speed, or each of several, in rad/s."""
    try:
        if isinstance(value, (list, tuple)):
            return tuple(number_in(each, "rad/s") for each in value)
        return number_in(value, "rad/s")
    except TypeError:
        raise InputError(f"{key} is {value!r}; it must be a number in rad/s, or one with rpm or hz behind it") from None


def refuse_rpm(key: str, value: object) -> None:
    """Raise InputError for the frequency of the excitation in rpm: an engine in rpm is the crankshaft's speed."""
    texts = [each for each in (value if isinstance(value, (list, tuple)) else [value]) if isinstance(each, str)]
    if key in (FREQUENCY, f"{FREQUENCY}_values") and any("rpm" in text.lower() for text in texts):
        raise InputError(f"{key} is {texts[0]}; it is the frequency of the excitation, in rad/s or hz: give the "
                         f"crankshaft's speed in rpm as {SPEED}={texts[0]}")


_ELEMENT = re.compile(r"([\w.]+)\[(\d+)\](_times|_values)?")


def list_of(key: str) -> str:
    """Return the key of the list whose number, or times or values of a number, `key` names; else `key` itself."""
    match = _ELEMENT.fullmatch(key)
    return key if match is None else match[1] + (match[3] or "")


def index_of(key: str, whole: Any) -> int:
    """Return the index of the number that `key` names in its list; InputError if the list has no such number."""
    name, _, number = key.partition("[")
    place = int(number.partition("]")[0])
    if not isinstance(whole, Sequence) or isinstance(whole, str):
        if name.endswith("_values") and frequency_key(name) != name:
            raise InputError(f"{key}: a scene holds the speeds as frequencies; give {frequency_key(name)}[{place}], "
                             f"which is {ORDER} times the speed, or the whole {name}")
        raise InputError(f"{key}: {name} is not a list")
    if not 1 <= place <= len(whole):
        has = f"has {len(whole)} values, [1] to [{len(whole)}]" if whole else "is empty"
        raise InputError(f"{name}[{place}] does not exist: {name} {has}; give the whole list first")
    return place - 1


def with_whole_lists(values: Mapping[str, object], value_of: Callable[[str], Any]) -> Mapping[str, object]:
    """Return scene values with single numbers of lists replaced by the whole lists.

    value_of : returns the present value of a key

    Raises InputError: the list has no such number, a value is not a number, or the profiles of the numbers do not
    match.
    """
    if not any("[" in key for key in values):
        return values
    out = {key: value for key, value in values.items() if not _ELEMENT.fullmatch(key)}
    profiles: dict[str, dict[int, dict[str, Any]]] = defaultdict(lambda: defaultdict(dict))
    for key, value in values.items():
        match = _ELEMENT.fullmatch(key)
        if match is None:
            continue
        whole, part = match[1], match[3]
        now: Any = out.get(whole, value_of(whole))
        place = index_of(key, now)
        if part is not None:
            profiles[whole][place][part] = value
            continue
        try:
            out[whole] = [*now[:place], number_of(value), *now[place + 1:]]
        except TypeError:
            raise InputError(f"{key} is {value!r}; it must be a number") from None
    for whole, profile_lists in profiles.items():
        now = out.get(whole, value_of(whole))
        assert isinstance(now, Sequence)
        out.update(_profile(whole, profile_lists, now))
    return out


def _profile(whole: str, given: Mapping[int, Mapping[str, Any]], now: Sequence[float]) -> dict[str, object]:
    """Return times and values of a list in which some numbers, by index, have profiles and the others are constant."""
    for place, part in given.items():
        times, values = (part.get(name, []) for name in ("_times", "_values"))
        if whole not in PROFILES or not len(times) == len(values) > 0:
            raise InputError(f"{whole}[{place + 1}] has {len(times)} times and {len(values)} values of a profile; it "
                             f"must have as many of both, and the lists with profiles are "
                             f"{', '.join(key for key in PROFILES if key.endswith('s'))}")
    import numpy as np

    times = np.unique(np.concatenate([part["_times"] for part in given.values()]))
    rows = np.tile(np.array(now, dtype=np.float64), (len(times), 1))
    for place, part in given.items():
        rows[:, place] = np.interp(times, part["_times"], part["_values"])
    return {f"{whole}_times": times.tolist(), f"{whole}_values": rows.ravel().tolist()}


@dataclass(frozen=True)
class System:
    """Driveline with friction law, excitation and initial state; frozen and checked.

    Examples
    --------
    >>> import tcc_sim
    >>> system = tcc_sim.System()
    >>> system.pressure.frequency_ratio, round(system.cycle, 6)
    (1.0, 0.041888)
    """

    driveline: Driveline = Driveline()
    converter: Converter = Converter()
    friction: Friction = Friction()
    clutch: Clutch = Clutch()
    engine: Engine = Engine()
    pressure: Pressure = Pressure()
    initial: Initial = Initial()
    inputs: Inputs | None = None
    """Torque, pressure and far-end speed from data, instead of the scene's own."""
    speeds: Speeds = field(default_factory=dict, compare=False)
    """Speeds of the crankshaft that were given instead of engine.frequency."""

    @cached_property
    def profile(self) -> Floats | None:
        """Profile of the excitation (see `profile_of`); None if nothing but the sines varies in time."""
        if not self.varying:
            return None
        from tcc_sim.model.profile import profile_of
        return profile_of(self.engine, self.pressure, self.inputs)

    def cycle_start(self, number: Any) -> Any:
        """Return the start of engine cycle `number` (or an array of numbers), where phi = 2 pi number, s."""
        if self.profile is None:
            return number * self.cycle
        from tcc_sim.model.profile import time_at

        return time_at(self.profile, 2.0 * math.pi * number)

    def cycles_until(self, t: float) -> float:
        """Return the number of engine cycles up to time t (s), phi/(2 pi)."""
        if self.profile is None:
            return t / self.cycle
        from tcc_sim.model.profile import phase_at

        return float(phase_at(self.profile, t)) / (2.0 * math.pi)

    def whole_cycles(self, first: int, duration: float) -> int:
        """Return the number of whole engine cycles in `duration` s from the start of cycle `first`."""
        if self.profile is None:
            return int(duration / self.cycle * (1.0 + 1e-12))
        return int(self.cycles_until(float(self.cycle_start(first)) + duration) * (1.0 + 1e-12)) - first

    @property
    def varying(self) -> list[str]:
        """Keys that vary in time."""
        return [times for key in PROFILES if self.value(times := f"{key}_times")] + (["inputs"] if self.inputs else [])

    @property
    def span(self) -> float:
        """Last time of the profiles or the inputs, s; 0 without any."""
        ends = [times[-1] for key in PROFILES if (times := self.value(f"{key}_times"))]
        return float(max([*ends, self.inputs.end if self.inputs else 0.0]))

    def value(self, key: str) -> Any:
        """Return the value of a scene key of the model."""
        group, name = key.split(".")
        return getattr(getattr(self, group), name)

    def check_repeats(self, what: str) -> None:
        """Raise InputError if the excitation does not repeat; `what` names the analysis that needs a periodic one."""
        if self.profile is not None:
            raise InputError(f"{what} needs a periodic excitation, and this scene has {', '.join(self.varying)}; "
                             "simulate and the driveline node solve it")

    @property
    def friction_ratio(self) -> float:
        """mu_s/mu_k: above 1 where friction falls with slip speed, below 1 where it rises."""
        return self.friction.static / self.friction.kinetic

    @property
    def largest_friction_ratio(self) -> float:
        """Upper bound of the friction coefficient at any slip speed, relative to mu_k; at least 1."""
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
        """Tsp of (5b), N m; 0 for a pressure from a topic with the mean as fallback."""
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
        """Engine cycle 2 pi/omega, s; the shortest one if omega varies in time."""
        return 2.0 * math.pi / max(self.engine.frequency_values or (self.engine.frequency,))


GROUPS: dict[str, type[Group]] = {"driveline": Driveline, "converter": Converter, "friction": Friction,
                                  "clutch": Clutch, "engine": Engine, "pressure": Pressure, "initial": Initial}

QUANTITIES: dict[str, Quantity] = {f"{group}.{name}": meaning for group, kind in GROUPS.items()
                                   for name, meaning in kind.quantities().items()}
"""Scene keys of the model, with their meanings."""

KEY_UNITS.update({key: meaning.unit for key, meaning in QUANTITIES.items()})

_FIELDS = [item.name for item in dataclasses.fields(System)]
_PLACES = [(key, *key.split(".")) for key in QUANTITIES]
DEFAULTS: dict[str, Value] = {key: getattr(GROUPS[group], name) for key, group, name in _PLACES}


def values_of(system: System) -> Iterator[tuple[str, Value]]:
    """Yield every scene key of `system` with its value, in the order of QUANTITIES."""
    for key, group, name in _PLACES:
        yield key, getattr(getattr(system, group), name)


def given_values(system: System) -> dict[str, object]:
    """Return all that was given for a system: the values of its keys, and the speeds that changes of its order keep."""
    return {**dict(values_of(system)), **system.speeds}


def unknown_key(key: str, known: Mapping[str, object] | list[str], kind: str = "a scene key") -> InputError:
    """Return the error for an unknown key, with the nearest valid one; `kind` is the expected kind of name."""
    if "temperature" in key:
        return InputError(f"{key} is not {kind}: temperature is no state of this model; sweep over friction tables "
                          "that were measured at several temperatures instead")
    near = difflib.get_close_matches(key[:100], list(known), n=1, cutoff=0.5)
    return InputError(f"{key} is not {kind}" + (f"; did you mean {near[0]}?" if near else ""))


def refuse_related(keys: Sequence[str]) -> None:
    """Raise InputError if a command varies two keys of which one defines the other."""
    for first, second in itertools.combinations(keys, 2):
        whole = first if "[" not in first else second if "[" not in second else ""
        if first != second and (frequency_key(first) == frequency_key(second)
                                or whole == list_of(first) == list_of(second)):
            raise InputError(f"{first} and {second} are both varied, and one defines the other; remove one of them")


def coerce(key: str, value: object) -> Value:
    """Convert a value from a file or a command line to the type of `key`; integers become floats."""
    if key not in QUANTITIES:
        raise unknown_key(key, [*QUANTITIES, *DERIVED])
    quantity_, default = QUANTITIES[key], DEFAULTS[key]
    refuse_rpm(key, value)
    if isinstance(default, tuple):
        if not isinstance(value, (list, tuple)):
            raise InputError(f"{key} is {value!r}; it must be a list of numbers, each {quantity_.interval()}")
        try:
            out: Value = tuple(number_in(x, quantity_.unit) for x in value)
        except TypeError:
            raise InputError(f"{key} is {value!r}; it must be a list of numbers, each {quantity_.interval()}") from None
    elif isinstance(default, str):
        out = value if isinstance(value, str) else repr(value)
    else:
        try:
            out = number_in(value, quantity_.unit)
        except TypeError:
            raise InputError(f"{key} is {value!r}; it must be a number, {quantity_.interval()}") from None
    quantity_.check(key, out)
    return out


def replace(system: System, values: Mapping[str, object]) -> System:
    """Return `system` with some scene keys changed and checked together; `KEY[n]` is number n of a list, from 1.

    Raises InputError: a key is unknown (the message suggests the nearest one), a type is wrong, or a value is out of
    range.
    """
    changes: dict[str, dict[str, Value]] = {}
    changed, speeds = with_frequency(values, system.engine, system.speeds)
    changed = with_whole_lists(changed, lambda key: dict(values_of(system)).get(key))
    for key in values:
        varied = list_of(frequency_key(key))
        profile = f"{varied}_times"
        if varied in PROFILES and profile in system.varying and profile not in changed:
            raise InputError(f"{key} is not used where {profile} is given; change that profile instead")
        if key in TABULATED and system.friction.slip_speeds and TABLE[0] not in values:
            raise InputError(f"{key} is not used where friction.slip_speeds and friction.coefficients are given; "
                             "change that table instead")
    for key, value in changed.items():
        checked = coerce(key, value)
        group, name = key.split(".")
        changes.setdefault(group, {})[name] = checked
    out = object.__new__(System)  # The fields are already checked; continuation makes a system for every motion.
    for name in _FIELDS:
        settings = getattr(system, name)
        vars(out)[name] = settings.changed(changes[name]) if name in changes else settings
    vars(out)["speeds"] = speeds
    return out
