"""The driveline tick by tick: solver, kernel, held inputs, and the check of a tick's real time, without ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.actuator import Actuator
from tcc_sim.model.groups import Driveline, Pressure
from tcc_sim.model.parameters import QUANTITIES, System
from tcc_sim.model.profile import START, Origin, along, phase_at, profile_of
from tcc_sim.model.quantity import apart
from tcc_sim.scene import Scene
from tcc_sim.solvers.fixed_step import Reached, Stepper
from tcc_sim.solvers.terms import Terms, for_ticks, holding, stick_speed_of, substeps, terms_from, terms_of
from tcc_sim.topics import HELD_INPUTS, INPUTS, topic

SHARE = 0.5
"""Fraction of a tick's real time allowed for the sub-steps of commands and changes while running, by their cost at
warm-up. The rest is a margin for publishing, for states with more iterations and for a shared processor. A scene that
needs more from the start may use up to the whole tick.
"""
MEASURED, REPEATS = 200, 5
"""Sub-steps in one timing measurement, and number of measurements, of which the shortest counts."""
COMMAND_RANGES = {name: QUANTITIES[topic(name).key] for name in HELD_INPUTS}
"""Unit and range of the commands by topic."""
SMALL_PRESSURE = 1000.0
"""Pressure below which the user may have meant bar, Pa."""


def check_command(name: str, value: float, admit: Callable[[float], None] = lambda _: None) -> None:
    """Raise InputError if the driveline must refuse a command.

    name : topic of the input
    value : commanded value, in the unit of the input
    admit : function that raises InputError if a value within the range cannot be applied now
    """
    meant = COMMAND_RANGES[name]
    if not meant.low <= value <= meant.high:
        raise InputError(f"{name} command of {apart(value, meant.low, meant.high)} {meant.unit} refused; it must be "
                         f"{meant.interval()}")
    try:
        admit(value)
    except InputError as error:
        raise InputError(f"{name} command of {value:g} {meant.unit} refused: {error}") from None


def doubt_of(name: str, largest: float) -> str:
    """Return a sentence if the largest command on a topic is plausible only in another unit; else empty."""
    if name != INPUTS[1] or not 0.0 < abs(largest) < SMALL_PRESSURE:
        return ""
    return f"the largest {name} command is {largest:g} Pa; the unit is Pa: {largest:g} bar would be {largest * 1e5:g}"


class Reading(NamedTuple):
    """State after a tick with all values that are published (`topics.TOPICS`), in SI units, angles in rad.

    stick_slip_state : -1 negative slip, 0 stick, 1 positive slip
    applied_pressure, commanded_pressure : pressure at the plates, and pressure commanded to the actuator, Pa
    shaft_torque : C23 (theta2' - theta3') + K23 (theta2 - theta3), N m
    output_angle, output_speed : theta3 and theta3' of the shaft's far end
    """

    stamp_ns: int
    flywheel_angle: float
    plate_angle: float
    flywheel_speed: float
    plate_speed: float
    engine_torque: float
    friction_torque: float
    slip_speed: float
    stick_slip_state: int
    applied_pressure: float
    commanded_pressure: float
    shaft_torque: float
    output_angle: float
    output_speed: float


class Plant:
    """Driveline that is solved tick by tick.

    Raises InputError: the real-time solver cannot run the scene.

    `clock` returns the time for measuring the cost of a sub-step, s.
    """

    def __init__(self, scene: Scene, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self.stepper = Stepper(scene.system, 1.0 / scene.operation.rate)
        self._stamp_step = 1e9 / scene.operation.rate
        self._scene_terms = self._terms = terms_of(scene.system)
        self.origin = START
        self._follow(scene)
        self._torque: float | None = None
        self._pressure: float | None = None
        pressure = scene.system.pressure
        self._actuator = Actuator(pressure, self.stepper.step) if pressure.actuated else None
        self._press(pressure.mean, pressure.mean)
        self._cost: dict[tuple[bool, int], float] = {}
        self._share = SHARE

    def warm_up(self) -> None:
        """Compile or load the kernels of the scene and of every change of it, time them once, and check that a tick can
        be computed in its real time.

        Raises InputError: in real time, a tick takes too long.
        """
        if self._cost:
            return
        for terms in self._variants():
            self.stepper.warm_up(terms)
            self._cost[_kind_of(terms)] = self._measured(terms)
        self._share = max(SHARE, min(1.0, self._needed(self.scene, self._scene_terms)))
        self.check(self.scene)

    def _variants(self) -> list[Terms]:
        """Return terms of every kind of kernel to which a change leads: with a profile, which keeps the phases after a
        change of the frequency, and with an exponential.
        """
        system = self.scene.system
        own = [self._scene_terms, terms_from(system, Origin(0.0, 0.0, 1.0))]
        if system.friction.curve is None:
            own += [terms._replace(stribeck=(0.0, 1.0)) for terms in own]
        return list({_kind_of(terms): terms for terms in reversed(own)}.values())

    def check(self, scene: Scene) -> None:
        """Raise InputError if `scene` cannot be computed with the held inputs or with their fallbacks."""
        if (scene.system.friction.curve is None) != (self.scene.system.friction.curve is None):
            raise InputError("friction.slip_speeds: a running driveline can change a friction table, but cannot add or "
                             "remove one; restart the driveline")
        terms, _ = self._after(scene)
        highest = {self._actuator.highest} if self._actuator is not None else set[float]()
        for pressure in {self._pressure, None} | highest:
            self._afford(scene, with_commands(scene.system, terms, self._torque, pressure))

    def check_pressure(self, pressure: float) -> None:
        """Raise InputError if a commanded pressure, Pa, needs too many sub-steps."""
        self._afford(self.scene, with_commands(self.scene.system, self._terms, self._torque, pressure))

    def use(self, scene: Scene) -> None:
        """Apply changed parameters together from the next tick on.

        Raises InputError: `check` refuses the scene; nothing changes.
        """
        self.check(scene)
        self._terms, self.origin = self._after(scene)
        self._follow(scene)
        self._hold(self._torque, self._pressure)
        if self._actuator is not None:
            self._press(self._actuator.pressure, self._actuator.pressure)

    def hold(self, torque: float | None, pressure: float | None) -> None:
        """Hold a commanded engine torque (N m) and pressure (Pa) from the next tick on; None for the scene's values.

        If the scene has an actuator, the pressure is the actuator's command.

        Raises InputError: a tick needs too many sub-steps; the earlier values stay held.
        """
        if (torque, pressure) != (self._torque, self._pressure):
            self._hold(torque, pressure)
            self._torque, self._pressure = torque, pressure

    def _hold(self, torque: float | None, pressure: float | None) -> None:
        self.stepper.hold(self._terms, torque,
                          None if pressure is None else self.scene.system.torque_per_pressure * pressure)

    def move_far_end(self, speed: float | None) -> None:
        """Hold the speed of the shaft's far end, rad/s, from the next tick on; None stops it where it is."""
        if speed is not None or self.stepper.far_end is not None:
            self.stepper.move_far_end(speed or 0.0)

    def reset(self) -> None:
        """Return to the initial state at simulation time 0 without held inputs."""
        self.stepper.reset(self.scene.system)
        self.origin, system = START, self.scene.system
        self._terms = terms_of(system)
        self._torque = self._pressure = None
        self.stepper.use(self._terms)
        if self._actuator is not None:
            self._actuator.reset(system.pressure.mean)
            self._press(system.pressure.mean, system.pressure.mean)

    @property
    def stamp_ns(self) -> int:
        """Simulation time of the current state, ns."""
        return self.stamp_of(self.stepper.tick)

    def stamp_of(self, tick: int) -> int:
        """Return the simulation time of a tick, ns."""
        return round(tick * self._stamp_step)

    def advance(self) -> Reading:
        """Solve one tick and return the state after it."""
        if self._actuator is not None:
            self._press(*self._actuator.advance(self._commanded_pressure()))
        return self._read(self.stepper.advance())

    def reading(self) -> Reading:
        """Return the current state."""
        return self._read(self.stepper.now())

    def _press(self, before: float, after: float) -> None:
        """Set the actuator's pressure at the start and the end of the next tick, Pa."""
        if self._actuator is not None:
            system = self.scene.system
            self._hold(self._torque, largest(system.pressure, before, after))
            self.stepper.press(before, after, system.torque_per_pressure)

    def _commanded_pressure(self) -> float:
        return self.scene.system.pressure.mean if self._pressure is None else self._pressure

    @property
    def actuated(self) -> bool:
        """Whether an actuator stands between commanded and applied pressure."""
        return self._actuator is not None

    @property
    def pressures(self) -> tuple[float, float]:
        """Commanded pressure, and pressure at the plates at the end of the tick, Pa."""
        if self._actuator is not None:
            return self._commanded_pressure(), self._actuator.pressure
        applied = self._pressure
        if applied is None:
            t = self.stepper.tick * self.stepper.step
            applied = pressure_at(t, self.scene.system, self._terms, self.origin.lead)
        return applied, applied

    def _read(self, reached: Reached) -> Reading:
        v, plate_angle, plate_speed, flywheel_angle, engine, friction, _ = reached
        commanded, applied = self.pressures
        output_angle, output_speed = self.stepper.far_end or (0.0, 0.0)
        shaft = shaft_torque(self.scene.system.driveline, plate_angle - output_angle, plate_speed - output_speed)
        return Reading(self.stamp_of(self.stepper.tick), flywheel_angle, plate_angle, v + plate_speed, plate_speed,
                       engine, friction, v, side_of_slip(v, self._stick_speed), applied, commanded, shaft, output_angle,
                       output_speed)

    def _follow(self, scene: Scene) -> None:
        """Store the values of `scene` that every tick needs."""
        self.scene = scene
        self._stick_speed = stick_speed_of(terms_of(scene.system))

    def _after(self, scene: Scene) -> tuple[Terms, Origin]:
        """Return the terms of `scene` from the next tick on, and the origin with which the phases stay continuous."""
        t = self.stepper.tick * self.stepper.step
        origin = origin_after(self.scene.system, scene.system, self.origin, t)
        return terms_from(scene.system, origin), origin

    def _afford(self, scene: Scene, terms: Terms) -> None:
        """Raise InputError if a tick needs more sub-steps than the solver or the tick's real time allows."""
        share = self._needed(scene, terms)
        if share > self._share:
            step, count = self.stepper.step, substeps(terms, self.stepper.step)
            period = step / scene.operation.real_time_factor * 1e3
            raise InputError(f"a tick of {step * 1e3:g} ms needs {count} sub-steps, which take {share * period:.3g} ms "
                             f"on this machine; in real time at most {self._share * period:.3g} ms are allowed "
                             "(no limit offline, in lock-step and with real_time_factor 0)")

    def _needed(self, scene: Scene, terms: Terms) -> float:
        """Return the fraction of a tick's real time for its sub-steps, 0 without a limit; InputError as `substeps`."""
        count = substeps(terms, self.stepper.step)
        operation = scene.operation
        if operation.real_time_factor == 0.0 or operation.pacing == "lockstep":
            return 0.0
        cost = self._cost.get(_kind_of(terms), 0.0)
        return count * cost * operation.real_time_factor / self.stepper.step

    def _measured(self, terms: Terms) -> float:
        """Return the time of a sub-step, the longer of slip and stick, s."""
        longest = 0.0
        for slip_speed in (self.scene.system.initial.slip_speed, 0.0):
            state = self.stepper.state.copy()
            state[0] = slip_speed
            shortest = np.inf
            for _ in range(REPEATS):
                began = self._clock()
                self.stepper.run_apart(terms, state, MEASURED)
                shortest = min(shortest, (self._clock() - began) / MEASURED)
            longest = max(longest, shortest)
        return float(longest)


def origin_after(before: System, after: System, origin: Origin, t: float) -> Origin:
    """Return the origin with which the phases of engine and load stay continuous if one system takes the place of
    another at time t, s.
    """
    if before.engine.frequency == after.engine.frequency and (
            before.pressure.frequency_ratio == after.pressure.frequency_ratio):
        return origin
    phase = float(phase_at(profile_of(before.engine, before.pressure, before.inputs, origin), t))
    lead = origin.lead + (before.pressure.frequency_ratio - after.pressure.frequency_ratio) * phase
    if before.engine.frequency == after.engine.frequency:
        return origin._replace(lead=lead)
    return Origin(t, phase, lead)


def with_commands(system: System, terms: Terms, torque: float | None, pressure: float | None) -> Terms:
    """Return `terms` of a system with a commanded torque, N m, and pressure, Pa, in place of the scene's."""
    return holding(terms, torque, None if pressure is None else system.torque_per_pressure * pressure)


def largest(pressure: Pressure, before: float, after: float) -> float:
    """Return the largest pressure in a tick, Pa, in which the actuator's pressure goes from one value to another."""
    return max(before, after) if pressure.lagged else after


def pressure_at(t: float, system: System, terms: Terms, lead: float) -> float:
    """Return the pressure at time t by the scene's own excitation, Pa, with the load's angle ahead by `lead` rad."""
    pressure = system.pressure
    amplitude = pressure.amplitude if pressure.harmonic else 0.0
    if terms.profile is None:
        mean, angle = pressure.mean, pressure.frequency_ratio * (system.engine.frequency * t)
    else:
        turned, _, load = along(terms.profile, t)
        mean, angle = float(load) / system.torque_per_pressure, pressure.frequency_ratio * float(turned) + lead
    return max(0.0, mean + amplitude * math.sin(angle + pressure.phase)) if amplitude > 0.0 else mean


def shaft_torque(driveline: Driveline, angle: float, speed: float) -> float:
    """Return the torque of the shaft, N m, by the angle and speed of the plate relative to the shaft's far end."""
    return driveline.damping * speed + driveline.stiffness * angle


def side_of_slip(slip_speed: float, stick_speed: float) -> int:
    """Return 0 for stick, and 1 or -1 for positive or negative slip."""
    return 0 if abs(slip_speed) <= stick_speed else 1 if slip_speed > 0.0 else -1


def _kind_of(terms: Terms) -> tuple[bool, int]:
    """Return what selects the kernel of a tick among the changes of one scene."""
    return terms.profile is None, len(for_ticks(terms).stribeck or ())
