"""The real-time loop: a thread of its own that paces, takes commands, steps the driveline and publishes.

One tick goes: wait for the deadline, take what has arrived, step, publish. Commands that arrive between two ticks apply
from the next tick on and are held through it (zero-order hold), so a controller that answers the state of tick k before
the next deadline acts on the interval from k to k + 1. What a message says of torques and pressure is what the tick
that ended applied.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64, Int8

from tcc_sim.messages import cdr
from tcc_sim.nodes.inputs import Command, engine_torque_command, pressure_command
from tcc_sim.nodes.pacing import Pacer
from tcc_sim.nodes.polling import states
from tcc_sim.scene import Scene
from tcc_sim.solvers.fixed_step import Stepper, substeps
from tcc_sim.solvers.terms import Terms, general_terms, stick_speed_of, terms_of

HISTORY = 0.25
"""Seconds of messages that a publisher keeps for a slow reader."""
SETTLED = 0.3
"""Real time, s, without a new subscription, after which the subscribers waited for count as complete."""


@dataclass
class Request:
    """Something asked of the loop between two ticks. Who takes `claim` first does it or withdraws it; then `done` is
    set.
    """

    action: Callable[[], bool]
    claim: threading.Lock = field(default_factory=threading.Lock)
    done: threading.Event = field(default_factory=threading.Event)
    result: bool = False


class RealTimeLoop:
    """The driveline of one node in real time.

    Parameters
    ----------
    node : owner of the publishers and subscriptions; only what the scene needs is created
    scene : what to run
    """

    def __init__(self, node: Node, scene: Scene) -> None:
        self.scene = scene
        self._context = node.context
        operation = scene.operation
        self.stepper = Stepper(scene.system, 1.0 / operation.rate)
        self.pacer = Pacer(self._period(scene))
        self.paused = self.general = False
        self.stick_ticks = self.slip_ticks = self.unsent_messages = 0
        self.failure: BaseException | None = None
        self._stamp_step = 1e9 / operation.rate
        self._own = terms_of(scene.system)
        self._general = general_terms(scene.system)
        self._terms = self._own
        self._stick_speed = stick_speed_of(self._own)
        self._requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._stop = threading.Event()
        self.clock_started = threading.Event()
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, name="real_time_loop", daemon=True)
        engine, pressure = scene.system.engine, scene.system.pressure
        self.engine_command = engine_torque_command(node, engine.mean_torque) if engine.source == "topic" else None
        self.pressure_command = pressure_command(node, pressure.mean) if pressure.source == "topic" else None
        self.commands: list[Command] = [c for c in (self.engine_command, self.pressure_command) if c is not None]
        qos = states(0 if operation.real_time_factor == 0.0 else max(10, math.ceil(HISTORY * operation.rate)))
        self._joint_states = node.create_publisher(JointState, "joint_states", qos)
        publishers: list[tuple[bool, Any, str]] = [
            (self.pressure_command is not None, FluidPressure, "applied_pressure"),
            (operation.publish_scalars, Float64, "slip_speed"), (operation.publish_scalars, Float64, "friction_torque"),
            (operation.publish_scalars, Int8, "stick_slip_state"), (operation.publish_clock, Clock, "/clock")]
        made = [node.create_publisher(kind, name, qos) if on else None for on, kind, name in publishers]
        self._applied_pressure, self._slip_speed, self._friction_torque, self._state, self._clock = made
        self._publishers = [self._joint_states, *(p for p in made if p is not None)]

    def start(self) -> None:
        """Warm the kernels up, then start the thread."""
        self.stepper.warm_up(self._own, self._general)
        self._thread.start()

    def stop(self) -> None:
        """End the thread; returns when it has ended, at most after one sleep slice."""
        self._stop.set()
        self._wake.set()
        if self.running:
            self._thread.join(timeout=1.0)

    @property
    def next_stamp_ns(self) -> int:
        """Stamp of the state that the next tick leads to."""
        return round((self.stepper.tick + 1) * self._stamp_step)

    @property
    def running(self) -> bool:
        """Whether the thread is alive."""
        return self._thread.is_alive()

    def request(self, action: Callable[[], bool], timeout: float = 1.0) -> bool:
        """Have the loop do `action` between two ticks; its result, or False where it was withdrawn after `timeout`
        seconds.
        """
        asked = Request(action)
        self._requests.put(asked)
        self._wake.set()
        if not asked.done.wait(timeout) and asked.claim.acquire(blocking=False):
            return False
        return asked.done.wait(timeout) and asked.result

    def reset(self) -> bool:
        """Back to the initial state at simulation time 0."""
        self.stepper.reset(self.scene.system)
        for command in self.commands:
            command.reset()
        self._apply_inputs()
        self._publish()
        return True

    def pause(self, paused: bool) -> bool:
        """Stop or resume; simulated time stands still while paused."""
        self.paused = paused
        if not paused:
            self.pacer.anchor()
        return True

    def single_step(self) -> bool:
        """One tick while paused; False while running."""
        if not self.paused:
            return False
        self._tick()
        return True

    def use(self, scene: Scene) -> bool:
        """Take changed parameters from the next tick on. The kernel must be one that was warmed up."""
        own, general = terms_of(scene.system), general_terms(scene.system)
        self.general = any((a is None) != (b is None) for a, b in zip(own, self._own))
        self._terms = general if self.general else own
        self._stick_speed = stick_speed_of(own)
        self.scene = scene
        if self.engine_command is not None:
            self.engine_command.replace_fallback(scene.system.engine.mean_torque)
        if self.pressure_command is not None:
            self.pressure_command.replace_fallback(scene.system.pressure.mean)
        self._apply_inputs()
        self.pacer.period_ns = self._period(scene) * 1e9
        self.pacer.anchor()
        return True

    def check(self, scene: Scene) -> None:
        """Raise InputError where the real-time solver cannot run `scene`."""
        substeps(terms_of(scene.system), self.stepper.step)

    @staticmethod
    def _period(scene: Scene) -> float:
        """Real time of a tick, s; 0 where it is as fast as possible."""
        factor = scene.operation.real_time_factor
        return 1.0 / (scene.operation.rate * factor) if factor > 0.0 else 0.0

    def _run(self) -> None:
        """The thread."""
        try:
            if not self._await_subscribers():
                return
            self._publish()
            self.pacer.anchor()
            self.clock_started.set()
            stopped, lockstep = self._stop.is_set, self.scene.operation.pacing == "lockstep"
            while not stopped():
                while not self._requests.empty():
                    asked = self._requests.get()
                    if asked.claim.acquire(blocking=False):
                        asked.result = asked.action()
                        asked.done.set()
                if self.paused:
                    self._wake.wait()
                    self._wake.clear()
                    continue
                if not lockstep and self.pacer.period_ns > 0.0:
                    self.pacer.wait(stopped)
                    if stopped():
                        return
                self._tick(lockstep)
        except BaseException as error:
            # A signal ends the context first; what publishing says to that is no failure.
            if not self._stop.is_set() and self._context.ok():
                self.failure = error

    def _tick(self, lockstep: bool = False) -> None:
        """Take commands, step, publish."""
        if self.commands:
            tick, timeout = self.stepper.tick, self.scene.operation.command_timeout
            limit = timeout * self.scene.operation.rate if timeout > 0.0 else math.inf
            for command in self.commands:
                if lockstep:
                    command.await_one(tick, round(tick * self._stamp_step), timeout, self._stop.is_set)
                else:
                    command.poll(tick, limit)
            self._apply_inputs()
        self.stepper.advance()
        self._publish()

    def _apply_inputs(self) -> None:
        """Put the held commands into the terms of the next tick."""
        terms: Terms = self._terms
        if self.engine_command is not None:
            terms = terms._replace(mean_torque=self.engine_command.value)
        if self.pressure_command is not None:
            terms = terms._replace(mean_load=self.scene.system.torque_per_pressure * self.pressure_command.value)
        if terms is not self.stepper.terms:
            self.stepper.use(terms)

    def _publish(self) -> None:
        """Publish the state of this tick, stamped with simulation time."""
        stepper = self.stepper
        v, plate_angle, plate_speed, flywheel_angle = stepper.state.tolist()
        engine, friction = stepper.torques()
        stamp = round(stepper.tick * self._stamp_step)
        self.send(self._joint_states,
                  cdr.joint_state(stamp, flywheel_angle, plate_angle, v + plate_speed, plate_speed, engine,
                                                      friction))
        state = 0 if abs(v) <= self._stick_speed else 1 if v > 0.0 else -1
        if state:
            self.slip_ticks += 1
        else:
            self.stick_ticks += 1
        if self._slip_speed is not None and self._friction_torque is not None and self._state is not None:
            self.send(self._slip_speed, cdr.float64(v))
            self.send(self._friction_torque, cdr.float64(friction))
            self.send(self._state, cdr.int8(state))
        if self._applied_pressure is not None and self.pressure_command is not None:
            self.send(self._applied_pressure, cdr.fluid_pressure(stamp, self.pressure_command.value))
        if self._clock is not None:
            self.send(self._clock, cdr.clock(stamp))

    def send(self, publisher: Any, data: bytes) -> None:
        """Publish; what the middleware refuses (it does in the moment when a flooded reader dies) is counted, not
        fatal.
        """
        try:
            publisher.publish(data)
        except RuntimeError:
            if not self._context.ok():
                raise
            self.unsent_messages += 1

    def _await_subscribers(self) -> bool:
        """Wait for the subscribers that were asked for, and until no more of them appear; False when told to stop."""
        wanted = self.scene.operation.wait_for_subscribers
        seen, since = -1, time.monotonic()
        while wanted and not self._stop.is_set():
            count = sum(p.get_subscription_count() for p in self._publishers)
            now = time.monotonic()
            if count != seen:
                seen, since = count, now
            elif self._joint_states.get_subscription_count() >= wanted and now - since >= SETTLED:
                break
            self._stop.wait(0.02)
        return not self._stop.is_set()
