"""Sensors between the driveline and a controller: noise, offset, resolution, delay and lost messages, without ROS.

Losses are counted by message and random numbers have a seed, so that runs repeat to the last bit.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from tcc_sim.errors import InputError
from tcc_sim.model.quantity import Options, quantity
from tcc_sim.plant.driveline import Reading

TOPICS = {"slip_speed": ("slip_speed",),
          "joint_states": ("flywheel_angle", "plate_angle", "flywheel_speed", "plate_speed", "engine_torque")}
"""Topic -> fields of a Reading that a sensor of the whole topic measures."""
SIGNALS = tuple(name for fields in TOPICS.values() for name in fields)
"""Fields of a Reading that a sensor can measure."""


@dataclass(frozen=True)
class Sensor(Options):
    """Sensor of a signal x(t): x(t - delay) + offset + noise, rounded to a multiple of `quantum`.

    Raises
    ------
    InputError
        An option is out of its range.
    """

    noise: float = quantity(0.0, "standard deviation of Gaussian noise, white from tick to tick, in the signal's unit",
                            low=0.0)
    offset: float = quantity(0.0, "constant error, in the signal's unit", low=-1e12, high=1e12)
    quantum: float = quantity(0.0, "resolution, in the signal's unit; 0: none", low=0.0)
    delay_ticks: int = quantity(0, "ticks by which the value is older than the message's stamp", low=0, high=100_000)
    drop: int = quantity(0, "one random message of every `drop` messages of the topic is lost; 0: none", low=0)
    seed: int = quantity(0, "seed; runs with equal seeds are identical", low=0)

    @staticmethod
    def of(name: str, given: Sensor | Mapping[str, float]) -> Sensor:
        """Return the sensor of a signal or topic from a Sensor or a mapping of its options.

        Raises InputError: the signal, topic or option does not exist, or the option does not apply to the signal or
        topic.
        """
        if name not in SIGNALS and name not in TOPICS:
            raise InputError(f"{name} has no sensor; sensors are of {', '.join(SIGNALS)} and joint_states")
        options = Sensor.quantities()
        for option in () if isinstance(given, Sensor) else given:
            if option not in options:
                raise InputError(f"{option} is not an option of a sensor; the options are {', '.join(options)}")
        sensor = given if isinstance(given, Sensor) else Sensor(**given)  # type: ignore[arg-type]
        if sensor.drop and name not in TOPICS:
            raise InputError(f"{name} has no drop, since only whole messages are lost; give drop to joint_states")
        if name not in SIGNALS and (sensor.noise or sensor.offset or sensor.quantum):
            raise InputError(f"{name} has no noise, offset or quantum; give them to one of its signals: "
                             f"{', '.join(TOPICS[name])}")
        return sensor


class Schedule:
    """Random choice of the messages that one kind of fault hits: one in each block of `every` messages."""

    def __init__(self, every: int, seed: str) -> None:
        self._every, self._draw = every, random.Random(seed)
        self._number = self._place = 0

    def hits(self) -> bool:
        """Return whether the next message is hit."""
        if not self._every:
            return False
        if self._number % self._every == 0:
            self._place = self._draw.randrange(self._every)
        self._number += 1
        return (self._number - 1) % self._every == self._place


class _Measured:
    """One sensor with its random state and past readings."""

    def __init__(self, name: str, sensor: Sensor) -> None:
        self._sensor, self._signals = sensor, TOPICS.get(name, (name,))
        self._draw = random.Random(f"{sensor.seed} {name} noise")
        self.drops = Schedule(sensor.drop, f"{sensor.seed} {name} drop")
        self._past: deque[Reading] = deque(maxlen=sensor.delay_ticks + 1)

    def values(self, reading: Reading) -> dict[str, float]:
        """Return the measured signals; states before the first equal the first."""
        self._past.append(reading)
        return {name: self._value(getattr(self._past[0], name)) for name in self._signals}

    def _value(self, value: float) -> float:
        sensor = self._sensor
        if sensor.noise or sensor.offset:
            value += sensor.offset + sensor.noise * self._draw.gauss(0.0, 1.0)
        return sensor.quantum * round(value / sensor.quantum) if sensor.quantum else value


class Sensors:
    """Sensors between the driveline and a controller, by the name of a signal or of a topic.

    Attributes
    ----------
    lost : topics of the last state's lost messages
    """

    def __init__(self, given: Mapping[str, Sensor | Mapping[str, float]] | None = None) -> None:
        self.lost: frozenset[str] = frozenset()
        self._sensors: dict[str, _Measured] = {}
        for name, sensor in (given or {}).items():
            self.put(name, sensor)

    def put(self, name: str, sensor: Sensor | Mapping[str, float]) -> None:
        """Set the sensor of a signal or topic from the next state on, replacing an earlier one.

        Raises InputError: as `Sensor.of`.
        """
        self._sensors[name] = _Measured(name, Sensor.of(name, sensor))

    def measure(self, reading: Reading) -> Reading:
        """Return the measured state; call it once for each state, since noise and losses depend on the count."""
        if not self._sensors:
            return reading
        self.lost = frozenset(name for name, sensor in self._sensors.items() if sensor.drops.hits())
        measured: dict[str, float] = {}
        # The sensor of a signal replaces the values of its topic's sensor.
        for name in sorted(self._sensors, key=lambda name: name in SIGNALS):
            measured |= self._sensors[name].values(reading)
        return reading._replace(**measured)  # type: ignore[arg-type]
