"""Sensors between the driveline and a controller: noise, offset, resolution, delay, and messages that are lost, by
count and with a seed, so that two runs are the same to the last bit. Free of ROS.
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
"""By topic that a sensor may be put before: the fields of a Reading that the topic alone carries."""
SIGNALS = tuple(name for fields in TOPICS.values() for name in fields)
"""Fields of a Reading that a sensor may measure."""


@dataclass(frozen=True)
class Sensor(Options):
    """How a signal is measured: x(t - delay) + offset + noise, rounded to a multiple of `quantum`.

    Raises
    ------
    InputError
        A number out of its range.
    """

    noise: float = quantity(0.0, "standard deviation of Gaussian noise, white from tick to tick, in the signal's unit",
                            low=0.0)
    offset: float = quantity(0.0, "constant error, in the signal's unit", low=-1e12, high=1e12)
    quantum: float = quantity(0.0, "resolution, in the signal's unit; 0: none", low=0.0)
    delay_ticks: int = quantity(0, "ticks by which the value is older than the message's stamp", low=0, high=100_000)
    drop: int = quantity(0, "one of every so many messages of the topic is lost; 0: none", low=0)
    seed: int = quantity(0, "two runs with the same seed are the same", low=0)

    @staticmethod
    def of(name: str, given: Sensor | Mapping[str, float]) -> Sensor:
        """A sensor before a signal or topic, as it is or by its options' names.

        Raises
        ------
        InputError
            No such signal, topic or option, or an option that the signal or the topic does not have.
        """
        if name not in SIGNALS and name not in TOPICS:
            raise InputError(f"there is no sensor of {name}; there are {', '.join(SIGNALS)} and joint_states")
        known = Sensor.quantities()
        for option in () if isinstance(given, Sensor) else given:
            if option not in known:
                raise InputError(f"{option} is no option of a sensor; there are {', '.join(known)}")
        sensor = given if isinstance(given, Sensor) else Sensor(**given)  # type: ignore[arg-type]
        if sensor.drop and name not in TOPICS:
            raise InputError(f"{name} has no drop: whole messages are lost; give drop to joint_states")
        if name not in SIGNALS and (sensor.noise or sensor.offset or sensor.quantum):
            raise InputError(f"{name} has no noise, offset or quantum; give them to one of its signals: "
                             f"{', '.join(TOPICS[name])}")
        return sensor


class Schedule:
    """Which messages one kind of fault hits: one of each `every`, at a place drawn anew for each such block."""

    def __init__(self, every: int, seed: str) -> None:
        self._every, self._draw = every, random.Random(seed)
        self._number = self._place = 0

    def hits(self) -> bool:
        """Whether the next message is hit."""
        if not self._every:
            return False
        if self._number % self._every == 0:
            self._place = self._draw.randrange(self._every)
        self._number += 1
        return (self._number - 1) % self._every == self._place


class _Measured:
    """One sensor with its memory."""

    def __init__(self, name: str, sensor: Sensor) -> None:
        self._sensor, self._signals = sensor, TOPICS.get(name, (name,))
        self._draw = random.Random(f"{sensor.seed} {name} noise")
        self._drops = Schedule(sensor.drop, f"{sensor.seed} {name} drop")
        self._past: deque[Reading] = deque(maxlen=sensor.delay_ticks + 1)

    def lost(self) -> bool:
        """Whether the next message is lost."""
        return self._drops.hits()

    def values(self, reading: Reading) -> dict[str, float]:
        """What the sensor gives for its signals; the first state stands for those before it."""
        self._past.append(reading)
        return {name: self._value(getattr(self._past[0], name)) for name in self._signals}

    def _value(self, value: float) -> float:
        sensor = self._sensor
        if sensor.noise or sensor.offset:
            value += sensor.offset + sensor.noise * self._draw.gauss(0.0, 1.0)
        return sensor.quantum * round(value / sensor.quantum) if sensor.quantum else value


class Sensors:
    """The sensors before a controller: by the name of a signal, or of a topic.

    Attributes
    ----------
    lost : topics whose message of the last state was lost
    """

    def __init__(self, given: Mapping[str, Sensor | Mapping[str, float]] | None = None) -> None:
        self.lost: frozenset[str] = frozenset()
        self._sensors: dict[str, _Measured] = {}
        for name, sensor in (given or {}).items():
            self.put(name, sensor)

    def put(self, name: str, sensor: Sensor | Mapping[str, float]) -> None:
        """Put a sensor before a signal or topic from the next state on, in the place of the one that is there.

        Raises
        ------
        InputError
            As `Sensor.of`.
        """
        self._sensors[name] = _Measured(name, Sensor.of(name, sensor))

    def measure(self, reading: Reading) -> Reading:
        """What the controller is told of a state; once a state, since noise and losses go by count."""
        if not self._sensors:
            return reading
        self.lost = frozenset(name for name, sensor in self._sensors.items() if sensor.lost())
        told: dict[str, float] = {}
        # A delay of a whole message counts where a signal has no sensor of its own.
        for name in sorted(self._sensors, key=lambda name: name in SIGNALS):
            told |= self._sensors[name].values(reading)
        return reading._replace(**told)  # type: ignore[arg-type]
