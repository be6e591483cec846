"""Run a control law and the driveline in one loop, with the ticks of the lock-step node, without ROS; runs of both."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tcc_sim.analysis.loop import BAND
from tcc_sim.analysis.loop.control import Control, CycleMeans, Steps, handovers, joined_means
from tcc_sim.analysis.loop.tracking import Limits, Loop, Tracking, checked_limits, loop_of, target_steps
from tcc_sim.analysis.measured.engine_clock import EngineClock, Scheduled, Tracked, clock_of_scene
from tcc_sim.errors import InputError, counted
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import Origin, phase_at, profile_of
from tcc_sim.plant.driveline import Plant, Reading, check_command
from tcc_sim.plant.sensors import Sensor, Sensors
from tcc_sim.scene import SceneLike, as_scene, meaning_of
from tcc_sim.topics import FAR_END, INPUTS, topic
from tcc_sim.trajectory import Floats, Trajectory, integral

SAME = ("slip_speed", "plate_angle", "plate_speed", "engine_torque", "friction_torque", "flywheel_angle",
        "applied_pressure")
"""Names that fields of a Reading share with fields of a ControlledRun."""
MOST_TICKS = 100_000_000
Answer = float | tuple[float | None, ...] | None
"""A pressure (Pa), or engine torque (N m) and pressure, or these two and the speed of the shaft's far end (rad/s); None
leaves an input to the scene, and the far end still.
"""


@dataclass(frozen=True, repr=False)
class ControlledRun(Trajectory):
    """Trajectory of a driveline under commands: the initial state and a sample for every tick.

    commands : (n,) arrays by topic of every input that the scene takes as a topic: the value held during the tick
        before each sample, Pa or N m; NaN where the scene's fallback applied, and for the initial state
    applied_pressure : (n,) array, pressure at the plates, Pa
    refused : number of refused commands
    refusal : reason of the last refusal
    received : (n,) array, number of accepted pressure commands up to each sample
    turns : (n,) array, phase of the excitation, periods, where its frequency was changed during the run; else None
    before : mean slip speed of the last engine cycle before the run, rad/s; NaN at a start
    """

    commands: dict[str, Floats] = field(default_factory=dict)
    applied_pressure: Floats = field(default_factory=lambda: np.empty(0))
    refused: int = 0
    refusal: str = ""
    received: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    turns: Floats | None = None
    before: float = math.nan

    def tracking_of(self, target: float | Mapping[float, float], since: int = 0, limits: Limits | None = None,
                    band: float = BAND) -> Tracking:
        """Judge how the slip speed was held at a target from the sample `since` on.

        Parameters
        ----------
        target : slip speed to hold, rad/s; or slip speeds by the time, s, from which each holds, such as
            ``{0.0: 20.0, 3.0: 40.0}``
        since : a sample; the step to the target counts from the last engine cycle before it
        limits : smallest and largest pressure that the controller commands, Pa; None if unknown
        band : least error that counts, rad/s
        """
        return self._tracking(target_steps(target), since, checked_limits(limits), band)

    def _tracking(self, reference: Steps, since: int, limits: Limits | None = None,
                  band: float = BAND) -> Tracking:
        commands = None
        if "actuation_pressure" in self.commands and len(self.received):
            new = np.diff(self.received[since:])
            applied = int(np.count_nonzero(new))
            commands = applied, int(new.sum()) - applied
        return self._loop(reference, limits, band).tracking(
            float(self.t[since]), float(self.t[-1]), stepped=None if since else True, commands=commands)

    def _loop(self, reference: Steps, limits: Limits | None = None, band: float = BAND) -> Loop:
        return loop_of(self, self.clock, reference, self.applied_pressure, limits, band, self.before)

    @property
    def last_mean(self) -> float:
        """Mean slip speed of the last engine cycle's time, rad/s; NaN if the run is shorter."""
        since = float(self.t[-1]) - self.cycle
        if since < self.t[0] - 1e-9:
            return math.nan
        area = integral(self.slip_speed, self.t)
        return float(area[-1] - np.interp(since, self.t, area)) / self.cycle

    @property
    def clock(self) -> EngineClock:
        """Start times of the engine cycles, also where the frequency was changed during the run."""
        if self.turns is None:
            return Scheduled(self.cycle) if self.system is None else clock_of_scene(self.system)
        numbers = np.arange(math.ceil(self.turns[0] - 1e-9), math.floor(self.turns[-1] + 1e-9) + 1)
        starts = np.interp(numbers, self.turns, self.t)
        return Tracked(float(np.median(np.diff(starts))) if len(starts) > 1 else self.cycle, {0: (numbers, starts)})

    @property
    def control(self) -> Control:
        """Cycle means of the slip speed, target, and commanded and applied pressure, for pictures."""
        running = CycleMeans(self.clock)
        ends, means = joined_means(running.feed(self.t, self.slip_speed))
        # A sample has the command of the tick before it.
        held = {name: Steps(self.t[:-1], values[1:]) for name, values in self.commands.items()}
        commanded, applied = held.get("actuation_pressure", Steps.none()), Steps(self.t[:-1], self.applied_pressure[1:])
        return Control(ends.astype(np.float64) * 1e-9, means, self.target_steps(), commanded, applied)

    def target_steps(self) -> Steps:
        """Return the target slip speed, rad/s; none here."""
        return Steps.none()

    def columns(self) -> dict[str, Any]:
        """Return the samples by name, with the commands of every input and the applied pressure."""
        return {**super().columns(), **self.commands, "applied_pressure": self.applied_pressure}

    def _text(self) -> str:
        refused = f"; {counted(self.refused, 'command')} refused" if self.refused else ""
        return f"{super()._text()}{refused}"


@dataclass(frozen=True, repr=False)
class LockstepRun(ControlledRun):
    """Trajectory of a driveline under the commands of the nodes under test.

    missed : number of ticks in which an awaited input had no new command: it was dropped, late, or refused
    targets : every target slip speed, rad/s, with its first sample
    limits : smallest and largest pressure that the controller commands, Pa; None if unknown
    """

    missed: int = 0
    targets: tuple[tuple[float, int], ...] = ()
    limits: Limits | None = None

    @property
    def target(self) -> tuple[float, int] | None:
        """The last target slip speed, rad/s, and its first sample; None without a target."""
        return self.targets[-1] if self.targets else None

    def target_steps(self) -> Steps:
        """Return the target slip speed, rad/s."""
        return Steps(self.t[[sample for _, sample in self.targets]], np.array([value for value, _ in self.targets]))

    @cached_property
    def tracking(self) -> Tracking:
        """Tracking error of the slip speed's cycle means since the last jump of the target, or since commands of the
        pressure came last after a fallback of a cycle or more.

        Raises
        ------
        InputError
            There is no target.
        """
        if not self.targets:
            raise InputError("no target: no node published target_slip_speed, and run(target=...) was not given")
        reference = self.target_steps()
        jumps = self._loop(reference).jumps.t
        since = int(np.searchsorted(self.t, jumps[-1] if len(jumps) else reference.t[0]))
        if (held := self.commands.get(INPUTS[1])) is not None and len(self.t) > 1:
            cycle = round(self.cycle / float(self.t[1] - self.t[0]))
            since = max([since, *(row for row, _ in handovers(np.isfinite(held), max(cycle, 1)))])
        return self._tracking(reference, since, self.limits)


class Samples:
    """Collector of a driveline's states and commands, tick by tick."""

    def __init__(self, plant: Plant) -> None:
        self._names = [name for name in INPUTS if topic(name).wanted(plant.scene.value)]
        self._readings: list[Reading] = []
        self._systems: list[tuple[int, System, Origin]] = []
        self._rest: list[tuple[float | None, ...]] = []

    def __len__(self) -> int:
        return len(self._readings)

    @property
    def begins_later(self) -> bool:
        """Whether the first sample is not that of a start or a reset."""
        return self._readings[0].stamp_ns > 0

    def add(self, plant: Plant, reading: Reading, held: Mapping[str, float | None], received: int) -> None:
        """Add the current state, the commands of the tick before it, and the number of pressure commands so far."""
        system = plant.scene.system
        if not self._systems or self._systems[-1][1] is not system:
            self._systems.append((len(self._readings), system, plant.origin))
        self._readings.append(reading)
        self._rest.append((system.torque_per_pressure, received, *map(held.get, INPUTS)))

    def columns(self, plant: Plant) -> dict[str, object]:
        """Return the fields of a ControlledRun that come from the samples."""
        columns = {name: np.array(column) for name, column in zip(Reading._fields, zip(*self._readings))}
        per_pressure, received, *held = np.array(self._rest, dtype=np.float64).T
        system = plant.scene.system
        far = {name: columns[name] for name in ("output_angle", "output_speed") if plant.stepper.far_end is not None}
        return {
            **far,
            **{name: columns[name] for name in SAME}, "t": columns["stamp_ns"] / 1e9,
            "saturation_torque": per_pressure * columns["applied_pressure"],
            "state": columns["stick_slip_state"].astype(np.int8), "cycle": system.cycle, "solver": "fixed_step",
            "received": received.astype(np.int64), "turns": self._turns(columns["stamp_ns"] / 1e9),
            "system": system,
            "systems": tuple((columns["stamp_ns"][first] / 1e9, held) for first, held, _ in self._systems),
            "commands": {name: values for name, values in zip(INPUTS, held) if name in self._names}}

    def _turns(self, t: Floats) -> Floats | None:
        """Return the phase of the excitation at each sample, periods; None if its frequency was not changed."""
        if len({system.engine.frequency for _, system, _ in self._systems}) < 2 and not self._systems[0][2].time:
            return None
        turns, ends = np.empty(len(t)), [*(first for first, *_ in self._systems[1:]), len(t)]
        for (first, system, origin), end in zip(self._systems, ends):
            profile = profile_of(system.engine, system.pressure, system.inputs, origin)
            turns[first:end] = phase_at(profile, t[first:end]) / (2.0 * math.pi)
        return turns


def changes_of(values: Mapping[str, object] | None, more: Mapping[str, object]) -> dict[str, object]:
    """Return live scene keys with their values; keys of `more` have __ in place of the dot."""
    changes = {**(values or {}), **{key.replace("__", "."): value for key, value in more.items()}}
    for key in changes:
        if not meaning_of(key).live:
            raise InputError(f"{key} cannot change while the driveline runs")
    return changes


class TimedChanges:
    """Schedule of changes of scene keys at simulation times, each a whole number of ticks."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._changes: dict[int, dict[str, object]] = {}

    def add(self, t: float, changes: Mapping[str, object], tick: int = 0) -> None:
        """Schedule a change at time t, s: the tick that begins at t is the first with the new values.

        Raises InputError: the time is not a whole number of ticks or has passed, or a key does not exist or cannot
        change in a run.
        """
        changes = changes_of(changes, {})
        if not 0.0 <= t * self._rate < 1e15 or (t * self._rate + 1e-6) % 1.0 > 2e-6:
            raise InputError(f"a change at {t:g} s is not possible; it must be a whole number of ticks of "
                             f"{1.0 / self._rate:g} s")
        at = round(t * self._rate)
        if at < tick:
            raise InputError(f"a change at {t:g} s is not possible; the run is at {tick / self._rate:g} s")
        self._changes.setdefault(at, {}).update(changes)

    def due(self, tick: int) -> dict[str, object] | None:
        """Remove and return the changes before the tick with this number; None without any."""
        return self._changes.pop(tick, None) if self._changes else None


class _Held:
    """Commands held from the answers of a control law.

    values : held command by topic; None for the scene's fallback, and for a far end that stands still
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.values: dict[str, float | None] = dict.fromkeys((*INPUTS, FAR_END))
        self._taken = [name for name in self.values if topic(name).wanted(plant.scene.value)]
        self.received = self.refused = 0
        self.refusal = ""

    def take(self, answer: Answer) -> None:
        """Apply an answer from the next tick on; a refused value leaves the value before it."""
        given = answer if isinstance(answer, tuple) else (None, answer)
        if len(given) not in (2, 3):
            raise InputError(f"the law answered {answer!r}; it must answer a pressure, (torque, pressure) or (torque, "
                             "pressure, output_speed)")
        for name, value in zip(self.values, (*given, None)):
            number = self._number(name, value)
            try:
                if number is not None:
                    check_command(name, number, self._press if name == INPUTS[1] else lambda _: None)
            except InputError as error:
                self.refused, self.refusal = self.refused + 1, str(error)
            else:
                self.values[name] = number
                self.received += name == INPUTS[1] and number is not None
        torque, pressure, speed = self.values.values()
        self._plant.hold(torque, pressure)
        self._plant.move_far_end(speed)

    def _press(self, pressure: float) -> None:
        self._plant.hold(self.values[INPUTS[0]], pressure)

    def _number(self, name: str, value: object) -> float | None:
        """Return a value of an answer as a number or None; raise InputError if it is neither."""
        if value is None:
            return None
        if name not in self._taken:
            group = topic(name).key.partition(".")[0]
            raise InputError(f"the law answered {name} {value!r}, which the scene sets; answer None to use the scene's "
                             f"value, or set {group}.source=topic to let the law command it")
        try:
            return float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"the law answered {name} {value!r}; it must be a number or None") from None


def closed_loop(scene: SceneLike, law: Callable[[Reading], Answer], seconds: float,
                rate: float = 1000.0, *, sensors: Mapping[str, Sensor | Mapping[str, float]] | None = None,
                at: Mapping[float, Mapping[str, object]] | None = None) -> ControlledRun:
    """Run a control law in closed loop with the driveline, one call per tick, or per command_period.

    A node with this law in lock-step with the driveline's node gives the same states to the last bit.

    An answer is held during the tick after the state that it answers. A value that the node would refuse, because it is
    out of range or its pressure needs too many sub-steps, is refused here too: the value before it is held, the refusal
    is counted, and a warning reports it at the end. A law with memory is an object with `__call__`.

    Parameters
    ----------
    scene : a scene or a system, its name or its file; the law commands the inputs whose source is topic
    law : function of the state (a Reading) that returns a pressure (Pa), or engine torque (N m) and pressure, or these
        and the speed of the shaft's far end (rad/s); None for the scene's fallback
    seconds : simulated time, rounded to whole ticks
    rate : tick rate, Hz
    sensors : sensors by signal (slip_speed, flywheel_speed, plate_speed, flywheel_angle, plate_angle, engine_torque) or
        topic (joint_states, slip_speed), each with noise, offset, quantum, delay_ticks, drop, seed. If a message of a
        state is lost, the law is not called and its last answer is held. The result has the true states
    at : scene keys that change at a time, s, with their new values: ``{1.5: {"engine.mean_torque": 250.0}}``

    Returns
    -------
    ControlledRun, a Trajectory with a sample for every tick, with `commands` and `applied_pressure`

    Raises
    ------
    InputError
        The real-time solver cannot run the scene; a duration, rate or sensor option is out of its range; or an answer
        is not a number or is for an input that the scene sets.

    Examples
    --------
    >>> import tcc_sim
    >>> def proportional(reading):
    ...     return 80e3 + 2e3 * (reading.slip_speed - 20.0)
    >>> run = tcc_sim.closed_loop("controlled", proportional, seconds=2.0)
    >>> run
    <ControlledRun by fixed_step: 2001 samples over 2 s; reached the end>
    >>> bool(12.0 < run.slip_speed[1000:].mean() < 40.0)
    True
    """
    scene = as_scene(scene).with_values({"rate": rate, "pacing": "lockstep"})
    if not 0.0 <= seconds * rate <= MOST_TICKS:
        raise InputError(f"seconds is {seconds:g}; it must be 0 to {MOST_TICKS / rate:g} s at {rate:g} Hz")
    plant = Plant(scene)
    held, samples, reading = _Held(plant), Samples(plant), plant.reading()
    measuring, changes = Sensors(sensors), TimedChanges(rate)
    for t, values in (at or {}).items():
        changes.add(t, values)
    samples.add(plant, reading, held.values, 0)
    for tick in range(round(seconds * rate)):
        measured = measuring.measure(reading)
        if tick % scene.operation.answer_ticks == 0 and not measuring.lost:
            held.take(law(measured))
        if due := changes.due(tick):
            plant.use(plant.scene.with_values(due))
        reading = plant.advance()
        samples.add(plant, reading, held.values, held.received)
    if held.refused:
        warnings.warn(f"{held.refusal} ({held.refused} refused)", stacklevel=2)
    return ControlledRun(**samples.columns(plant), refused=held.refused, refusal=held.refusal)  # type: ignore[arg-type]
