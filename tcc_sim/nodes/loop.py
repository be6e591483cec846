"""The real-time loop: a thread of its own that paces, takes commands, steps the driveline and publishes.

One tick goes: wait for the deadline, take what has arrived, step, publish. Commands that arrive between two ticks apply
from the next tick on and are held through it (zero-order hold), so a controller that answers the state of tick k before
the next deadline acts on the interval from k to k + 1. What a message says of torques and pressure is what the tick
that ended applied.

Whatever the loop waits for (subscribers, a deadline, a command in lock-step, a reader that is slow), it does what is
asked of it meanwhile; and nothing that is asked of it or sent to it ends it.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack

from rclpy.node import Node

from tcc_sim.messages import cdr
from tcc_sim.nodes.loop_requests import Outcome, Request
from tcc_sim.nodes.loop_topics import CommandedInput, Outputs
from tcc_sim.nodes.pacing import Pacer, attend, prepare_thread, tick_time_of
from tcc_sim.nodes.simulation_clock import SimulationClock, await_peer
from tcc_sim.plant.driveline import Plant, Reading
from tcc_sim.recording.announcements import source_text
from tcc_sim.scene import Scene
from tcc_sim.topics import FAR_END, topic

SETTLED = 0.3
"""Real time, s, without a new subscription, after which those waited for count as complete."""
LOOK = 0.02
"""Real time, s, between two looks for subscribers, and between two tries to send what a reader was too slow for."""
LOCKSTEP_LOOK, LOCKSTEP_REST, LOCKSTEP_EAGER = 2e-5, 1e-3, 0.05
"""Real time, s, between two looks for a command in lock-step: at first, and after so many seconds in vain."""


class RealTimeLoop:
    """The driveline of one node in real time.

    Parameters
    ----------
    node : owner of the publishers and subscriptions; only what the scene needs is created
    scene : what to run
    """

    def __init__(self, node: Node, scene: Scene) -> None:
        self._node, self._context = node, node.context
        self.plant = Plant(scene)
        self.pacer = Pacer(tick_time_of(scene.operation.rate, scene.operation.real_time_factor))
        self.paused = False
        self.stick_ticks = self.slip_ticks = 0
        self.failure: BaseException | None = None
        self.refused_wishes: list[str] = []
        self.clock_started = threading.Event()
        self._requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._stopping, self._wake = False, threading.Event()
        self._thread = threading.Thread(target=self._run, name="real_time_loop", daemon=True)
        self._compiler = threading.Thread(target=self.plant.warm_up_general, name="compiler", daemon=True)
        engine, pressure = topic("engine_torque"), topic("actuation_pressure")
        self.engine_command = CommandedInput(node, engine) if engine.wanted(scene.value) else None
        self.pressure_command = (CommandedInput(node, pressure, self.plant.check_pressure)
                                 if pressure.wanted(scene.value) else None)
        self.commands: list[CommandedInput] = [c for c in (self.engine_command, self.pressure_command) if c is not None]
        self._inputs = tuple(self.commands)
        self.far_end: CommandedInput | None = None
        self.outputs = Outputs(node, scene)
        self.clock = SimulationClock(node, self.outputs, scene.operation)
        self._answer_ticks = scene.operation.answer_ticks
        self._unanswered: list[CommandedInput] | None = None
        self._waits_since = 0.0
        self._said_commanded: list[bool] = []

    @property
    def scene(self) -> Scene:
        """What runs."""
        return self.plant.scene

    @property
    def waits_for(self) -> list[CommandedInput]:
        """Inputs whose answer to the state lock-step waits for now."""
        return [*(self._unanswered or ())]

    def start(self) -> None:
        """Compile and measure the scene's kernel, then start the thread; what only changes while running may need is
        compiled beside it.

        Raises
        ------
        InputError
            The scene cannot be computed in real time on this machine.
        """
        self.plant.warm_up()
        if self.scene.operation.publish_shaft_torque:
            self.plant.warm_up_far_end()
        self._thread.start()
        self._compiler.start()
        priority = self.scene.operation.thread_priority
        if priority:
            attend(priority, (self._thread.native_id, self._compiler.native_id))

    def stop(self) -> None:
        """End the thread; returns when it has ended, at most after one sleep slice."""
        self._stopping = True
        self._wake.set()
        if self.running:
            self._thread.join(timeout=1.0)
            if self.scene.operation.thread_priority:
                attend(0)

    @property
    def vehicle_waits(self) -> bool:
        """Whether somebody publishes output_speed, which is not taken yet."""
        return self.far_end is None and self._node.count_publishers(FAR_END) > 0

    def attach(self, far_end: CommandedInput) -> bool:
        """Take output_speed from the next tick on, and say where the shaft's far end is."""
        if self.far_end is None:
            self.far_end = far_end
            self.commands.append(far_end)
            self.plant.stepper.move_far_end(0.0)
            self.outputs.add("output_state", cdr.output_state)
        return True

    def meet(self) -> None:
        """Take output_speed where somebody publishes it, once what that needs is compiled and the two have met; publish
        /clock where it is due.
        """
        if self.vehicle_waits:
            far_end = CommandedInput(self._node, topic(FAR_END))
            self.plant.warm_up_far_end()
            await_peer(far_end.subscription.get_publisher_count)
            self.attach(far_end)
        if self.clock.due:
            self.clock.begin()

    @property
    def running(self) -> bool:
        """Whether the thread is alive."""
        return self._thread.is_alive()

    def request(self, action: Callable[[], bool], timeout: float = 1.0) -> Outcome:
        """Have the loop do `action` between two ticks; it is withdrawn where it was not done after `timeout` seconds.

        An action refuses by False or by an exception, whose sentence is then the outcome's. Where no thread runs the
        loop it is done at once.
        """
        asked = Request(action)
        if not self.running:
            asked.carry_out()
            return asked.outcome
        self._requests.put(asked)
        self._wake.set()
        if not asked.done.wait(timeout) and asked.claim.acquire(blocking=False):
            return Outcome(False, f"the real-time loop did not answer within {timeout:g} s")
        asked.done.wait(timeout)
        return asked.outcome

    def reset(self) -> bool:
        """Back to the initial state at simulation time 0."""
        for command in self.commands:
            command.reset()
        self.plant.reset()
        self._unanswered, self._said_commanded = None, []
        if self.clock_started.is_set():
            self._publish(self.plant.reading())
        return True

    def pause(self, paused: bool) -> bool:
        """Stop or resume; simulated time stands still while paused."""
        self.paused = paused
        if not paused:
            self.pacer.anchor()
            self._waits_since = time.monotonic()
        return True

    def single_step(self) -> bool:
        """One tick while paused; False while running."""
        if not (self.paused and self.clock_started.is_set()):
            return False
        self.step()
        return True

    def begin(self) -> None:
        """The initial state, where the loop is stepped by its owner and not by its thread."""
        self.plant.warm_up()
        self.meet()
        self.clock_started.set()
        self._publish(self.plant.reading())

    def step(self) -> None:
        """One tick with the commands that have arrived."""
        for command in self.commands:
            command.poll(self.plant.stepper.tick, self._timeout_ticks())
        self._tick()

    def use(self, scene: Scene) -> bool:
        """Take changed parameters from the next tick on, all or none; InputError where they cannot be computed."""
        before, factor = self.scene.operation.real_time_factor, scene.operation.real_time_factor
        self.plant.use(scene)
        if factor != before:
            self.pacer.period_ns = tick_time_of(scene.operation.rate, factor) * 1e9
            self.pacer.anchor()
        return True

    def _run(self) -> None:
        """The thread."""
        try:
            wishes = self.scene.operation
            self.refused_wishes = prepare_thread(wishes.thread_priority, wishes.cpu_affinity, wishes.lock_memory)
            if not self._await_subscribers():
                return
            self.meet()
            self._publish(self.plant.reading())
            self.pacer.anchor()
            self.clock_started.set()
            with ExitStack() as held:
                for handle in (*self.outputs.handles(), *(command.subscription.handle for command in self.commands)):
                    held.enter_context(handle)
                while not self._stopping:
                    self._serve()
                    if not self.outputs.flush():
                        self._rest(LOOK)
                    elif self.paused:
                        self._rest(None)
                    elif self._due():
                        self._tick()
        except BaseException as error:
            # A signal ends the context first; what publishing says to that is no failure.
            if not self._stopping and self._context.ok():
                self.failure = error

    def _serve(self) -> None:
        """Do what was asked."""
        while not self._requests.empty():
            self._requests.get().carry_out()

    def _rest(self, seconds: float | None) -> None:
        """Wait until something is asked, or for so many seconds."""
        self._wake.wait(seconds)
        self._wake.clear()

    def _interrupted(self) -> bool:
        """Whether there is something else to do than to wait."""
        return self._stopping or not self._requests.empty()

    def _due(self) -> bool:
        """Wait for what the next tick waits for, with its commands taken; False where something else comes first."""
        tick = self.plant.stepper.tick
        if self.commands and self.scene.operation.pacing == "lockstep":
            return self._answered(tick)
        if self.pacer.period_ns > 0.0 and not self.pacer.wait(self._interrupted):
            return False
        for command in self.commands:
            command.poll(tick, self._timeout_ticks())
        return True

    def _answered(self, tick: int) -> bool:
        """Lock-step: whether every command that answers this state is there, or was waited for long enough."""
        now = time.monotonic()
        if self._unanswered is None:
            due = self._inputs if tick % self._answer_ticks == 0 else ()  # A vehicle answers every state.
            self._unanswered = [c for c in self.commands if tick >= c.since and (c is self.far_end or c in due)]
            self._waits_since = now
        stamp = self.plant.stamp_of(tick)
        self._unanswered = [c for c in self._unanswered if not c.answered(tick, stamp)]
        timeout = self.scene.operation.command_timeout
        if self._unanswered and 0.0 < timeout < now - self._waits_since:
            for command in self._unanswered:
                command.fall_back()
            self._unanswered = []
        if self._unanswered:
            time.sleep(LOCKSTEP_LOOK if now - self._waits_since < LOCKSTEP_EAGER else LOCKSTEP_REST)
            return False
        return True

    def _timeout_ticks(self) -> float:
        """Ticks without a command after which the fallback applies."""
        operation = self.scene.operation
        return operation.command_timeout * operation.rate if operation.command_timeout > 0.0 else math.inf

    def _tick(self) -> None:
        """Step with the commands as they are, publish."""
        if self.commands:
            self.plant.hold(_value(self.engine_command), _value(self.pressure_command))
            self.plant.move_far_end(_value(self.far_end))
        self._unanswered = None
        self._publish(self.plant.advance())

    def _publish(self, reading: Reading) -> None:
        """Publish the state of a tick, stamped with simulation time."""
        if reading.stick_slip_state:
            self.slip_ticks += 1
        else:
            self.stick_ticks += 1
        if self._inputs:
            self._say_source(reading.stamp_ns)
        self.outputs.state(reading)

    def _say_source(self, stamp_ns: int) -> None:
        """Say which inputs a command holds, where that is other than what was said."""
        commanded = [command.value is not None for command in self._inputs]
        if commanded != self._said_commanded:
            self._said_commanded = commanded
            source = source_text(dict(zip((command.name for command in self._inputs), commanded)))
            self.outputs.say("input_source", cdr.header(stamp_ns, source))

    def _await_subscribers(self) -> bool:
        """Wait for the subscribers that were asked for, and until no more of them appear; False when told to stop."""
        wanted = self.scene.operation.wait_for_subscribers
        seen, since = -1, time.monotonic()
        while wanted and not self._stopping:
            self._serve()
            joint_states, count = self.outputs.subscriptions()
            now = time.monotonic()
            if count != seen:
                seen, since = count, now
            elif joint_states >= wanted and now - since >= SETTLED:
                break
            self._rest(LOOK)
        return not self._stopping


def _value(command: CommandedInput | None) -> float | None:
    """What a command holds, None where the scene's own input applies."""
    return None if command is None else command.value
