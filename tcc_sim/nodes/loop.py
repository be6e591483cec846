"""The real-time loop: a thread that paces, takes commands, steps the driveline and publishes.

Commands that arrive between two ticks are held during the next tick (zero-order hold), so a controller that answers
the state of tick k before the next deadline acts on the interval from k to k + 1. Torques and pressure in a message are
those of the tick that ended. While the loop waits, it carries out requests. No request and no message can end it.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, TimeoutError
from contextlib import ExitStack
from typing import Any, NamedTuple

from rclpy.node import Node

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr, held
from tcc_sim.model.profile import START
from tcc_sim.nodes.loop_topics import CommandedInput, JointCommands, Outputs, SimulationClock, joining
from tcc_sim.nodes.middleware import wait_until
from tcc_sim.nodes.pacing import Pacer, attend, prepare_thread, tick_time_of
from tcc_sim.plant.driveline import Plant, Reading
from tcc_sim.recording.announcements import holding_from
from tcc_sim.scene import Scene
from tcc_sim.topics import FAR_END, HELD_INPUTS, INPUTS, TARGET, topic

SETTLED, LOOK = 0.3, 0.02
"""Real time without a new subscription that completes the subscribers, and between checks or attempts to send, s."""
LOCKSTEP_LOOK, LOCKSTEP_REST, LOCKSTEP_EAGER = 2e-5, 1e-3, 0.05
"""Real time between two checks for a command in lock-step, s: at first, and after LOCKSTEP_EAGER seconds of waiting."""


class Outcome(NamedTuple):
    """Outcome of a request: whether it was done, and the reason if it was not."""

    done: bool
    why: str = ""

    def __bool__(self) -> bool:
        return self.done


class RealTimeLoop:
    """The driveline of one node in real time."""

    def __init__(self, node: Node, scene: Scene) -> None:
        self._node, self._context = node, node.context
        self.plant = Plant(scene)
        self.pacer = Pacer(tick_time_of(scene.operation.rate, scene.operation.real_time_factor))
        self.paused = False
        self.stick_ticks = self.slip_ticks = 0
        self.late: list[float] = []
        """Simulation times of the first late tick and of the last one after it, s."""
        self.failure: BaseException | None = None
        self.refused_wishes: list[str] = []
        self.clock_started = threading.Event()
        self._requests: queue.SimpleQueue[tuple[Future[Outcome], Callable[[], object]]] = queue.SimpleQueue()
        self._stopping, self._wake = False, threading.Event()
        self._thread = threading.Thread(target=self._run, name="real_time_loop", daemon=True)
        self.inputs = {name: CommandedInput(node, topic(name), admit)
                       for name, admit in zip(INPUTS, (lambda _: None, self.plant.check_pressure))
                       if topic(name).wanted(scene.value)}
        """Inputs by topic; output_speed, and target_slip_speed, which acts on nothing, may join later."""
        self.commands = list(self.inputs.values())
        """Inputs that act."""
        self._joints = JointCommands(node, self.commands) if self.inputs else None
        self.outputs = Outputs(node, scene)
        self.clock = SimulationClock(node, self.outputs, scene.operation)
        self._answer_ticks = scene.operation.answer_ticks
        for command in self.commands:
            command.period_ns = self.plant.stamp_of(self._answer_ticks)
        self._unanswered: list[CommandedInput] | None = None
        self._waits_since = 0.0
        self._beat = max(1, math.floor(held.BEAT * scene.operation.rate + 1e-9))
        self._number, self._told = 0, -self._beat
        self._seen: tuple[int, float | None, tuple[bool, ...]] = 0, None, ()
        self._text, self._changed = scene.text(), False
        self._announce(0)

    @property
    def scene(self) -> Scene:
        """The current scene."""
        return self.plant.scene

    @property
    def waits_for(self) -> list[CommandedInput]:
        """Inputs for whose answer to the state lock-step waits now."""
        return self._unanswered or []

    @property
    def running(self) -> bool:
        """Whether the thread is alive."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Compile or load the kernels of the scene and of its changes, time them, and start the thread.

        Raises InputError: the scene cannot be computed in real time on this machine.
        """
        self.plant.warm_up()
        self._thread.start()
        if priority := self.scene.operation.thread_priority:
            attend(priority, (self._thread.native_id,))

    def stop(self) -> None:
        """End the thread and wait for its end, which takes at most one sleep slice."""
        self._stopping = True
        self._wake.set()
        if self.running:
            self._thread.join(timeout=1.0)
            if self.scene.operation.thread_priority:
                attend(0)

    def attach(self, joined: CommandedInput) -> None:
        """Report target_slip_speed or output_speed on `held` from the next tick on; apply the latter and publish
        output_state.
        """
        self.inputs[joined.name] = joined
        self.outputs.report_inputs()
        if joined.name == TARGET:
            return
        self.commands.append(joined)
        self.plant.stepper.move_far_end(0.0)
        if self.outputs.add("output_state") and (
                self.outputs.patient or not self.clock_started.is_set()):
            self.outputs.meet("output_state")

    def detach(self) -> None:
        """Let the shaft's far end stand still from the next tick on; output_state continues."""
        left = self.inputs.pop(FAR_END)
        self.commands = [command for command in self.commands if command is not left]
        self._unanswered = self._unanswered and [command for command in self._unanswered if command is not left]
        self.plant.move_far_end(None)

    def meet(self) -> None:
        """Take target_slip_speed and output_speed if they have publishers, after connecting; publish /clock if due."""
        for name in TARGET, FAR_END:
            if name not in self.inputs and (joined := joining(self._node, name)) is not None:
                wait_until(joined.subscription.get_publisher_count)
                self.attach(joined)
        if self.clock.due:
            self.clock.begin()

    def request(self, action: Callable[[], object], timeout: float = 1.0) -> Outcome:
        """Request that the loop calls `action` between two ticks; withdraw the request after `timeout` seconds.

        An action refuses by returning a false value other than None or by an exception, whose message becomes the
        outcome's. Without a running thread the action is called at once.
        """
        request: Future[Outcome] = Future()
        self._requests.put((request, action))
        if self.running:
            self._wake.set()
        else:
            self._serve()
        try:
            return request.result(timeout)
        except TimeoutError:
            late = Outcome(False, f"the real-time loop did not answer within {timeout:g} s")
            return late if request.cancel() else request.result()

    def reset(self) -> None:
        """Return to the initial state at simulation time 0."""
        running = self.clock_started.is_set()
        if running:
            self._report_inputs(held.ENDED)
        for command in self.inputs.values():
            command.reset()
        self.plant.reset()
        self._unanswered = None
        if running:
            self._begin_at_zero(again=True)

    def pause(self, paused: bool) -> None:
        """Pause or resume; simulation time stops while paused."""
        if paused and not self.paused and self.clock_started.is_set():
            self._report_inputs(held.PAUSED)
        self.paused = paused
        if not paused:
            self.pacer.anchor()
            self._waits_since = time.monotonic()

    def single_step(self) -> bool:
        """Make one tick while paused; return False while running."""
        if ready := self.paused and self.clock_started.is_set():
            self.step()
        return ready

    def begin(self) -> None:
        """Publish the initial state, if the owner steps the loop instead of its thread."""
        self.plant.warm_up()
        self.meet()
        self.clock_started.set()
        self._begin_at_zero()

    def step(self) -> None:
        """Make one tick with the commands that have arrived."""
        self._poll()
        self._tick()

    def command(self, values: Mapping[str, float]) -> None:
        """Hold commanded values from the next tick on, by the topic of each input; none if one of them is refused.

        Raises InputError: an input follows the scene or does not exist, or a value is out of its range or cannot be
        computed.
        """
        inputs = {command.name: command for command in self.commands}
        for name, value in values.items():
            if name not in inputs:
                raise InputError(f"{name}: the driveline takes {' and '.join(inputs) or 'no input'} from commands; set "
                                 "engine.source or pressure.source to topic at its start")
            inputs[name].check(value)
        tick = self.plant.stepper.tick
        if self.scene.operation.pacing == "lockstep":
            self._answered(tick)
        for name, value in values.items():
            inputs[name].hold(value, tick)
        self._unanswered = self._unanswered and [c for c in self._unanswered if c.name not in values]

    def use(self, scene: Scene, text: str) -> None:
        """Apply changed parameters together from the next tick on, and publish the scene before that tick's state;
        raise InputError if they cannot be computed.
        """
        self.plant.use(scene)
        self._text, self._changed = text, True
        self._announce(self.plant.stamp_of(self.plant.stepper.tick + 1))
        period = tick_time_of(scene.operation.rate, scene.operation.real_time_factor) * 1e9
        if period != self.pacer.period_ns:
            self.pacer.period_ns = period
            self.pacer.anchor()

    def _run(self) -> None:
        try:
            wishes = self.scene.operation
            self.refused_wishes = prepare_thread(wishes.thread_priority, wishes.cpu_affinity, wishes.lock_memory)
            if not self._await_subscribers():
                return
            self.meet()
            self._begin_at_zero()
            self.pacer.anchor()
            self.clock_started.set()
            with ExitStack() as stack:
                inputs: list[Any] = [*self.commands, *([] if self._joints is None else [self._joints])]
                for handle in (*self.outputs.handles(), *(one.subscription.handle for one in inputs)):
                    stack.enter_context(handle)
                while not self._stopping:
                    self._serve()
                    if not self.outputs.flush():
                        self._rest(LOOK)
                    elif self.paused:
                        self._rest(None)
                    elif self._due():
                        self._tick()
                self._report_inputs(held.ENDED)
        except BaseException as error:
            # A signal ends the context first; the publishing error after it is not a failure.
            if not self._stopping and self._context.ok():
                self.failure = error

    def _serve(self) -> None:
        """Carry out the waiting requests that were not withdrawn; an exception becomes the outcome."""
        while not self._requests.empty():
            request, action = self._requests.get()
            if request.set_running_or_notify_cancel():
                try:
                    request.set_result(Outcome(bool((done := action()) is None or done)))
                except Exception as error:
                    request.set_result(Outcome(False, str(error) or type(error).__name__))

    def _rest(self, seconds: float | None) -> None:
        self._wake.wait(seconds)
        self._wake.clear()

    def _interrupted(self) -> bool:
        return self._stopping or not self._requests.empty()

    def _due(self) -> bool:
        """Wait until the next tick is due and take its commands; return False if a request comes first."""
        if self.commands and self.scene.operation.pacing == "lockstep":
            return self._answered(self.plant.stepper.tick)
        late = self.pacer.late_ticks
        if self.pacer.period_ns > 0.0 and not self.pacer.wait(self._interrupted):
            return False
        if self.pacer.late_ticks > late:
            self.late = [*self.late[:1], 1e-9 * self.plant.stamp_of(self.plant.stepper.tick + 1)]
        self._poll()
        return True

    def _poll(self) -> None:
        """Take the commands that have arrived; without one for command_timeout the fallback applies."""
        operation = self.scene.operation
        limit = operation.command_timeout * operation.rate if operation.command_timeout > 0.0 else math.inf
        if self._joints is not None:
            self._joints.poll(self.plant.stepper.tick)
        for command in self.commands:
            command.poll(self.plant.stepper.tick, limit)

    def _answered(self, tick: int) -> bool:
        """Return whether lock-step has every command that answers this state, or has waited for command_timeout."""
        now = time.monotonic()
        if self._unanswered is None:
            due = tick % self._answer_ticks == 0
            self._unanswered = [command for command in self.commands if tick >= command.since
                                and (due or command.name == FAR_END)]  # The far end answers every state.
            self._waits_since = now
        stamp = self.plant.stamp_of(tick) + self.outputs.zero_ns
        joined = self._joints.poll(tick, stamp) if self._joints is not None and self._unanswered else []
        self._unanswered = [c for c in self._unanswered if c not in joined and not c.answered(tick, stamp)]
        timeout = self.scene.operation.command_timeout
        if self._unanswered and 0.0 < timeout < now - self._waits_since:
            for command in self._unanswered:
                command.fall_back()
            self._unanswered = []
        if self._unanswered:
            time.sleep(LOCKSTEP_LOOK if now - self._waits_since < LOCKSTEP_EAGER else LOCKSTEP_REST)
            return False
        return True

    def _tick(self) -> None:
        if TARGET in self.inputs:
            self.inputs[TARGET].poll(self.plant.stepper.tick, math.inf)
        if self.commands:
            torque, pressure, speed = (self.inputs[name].value if name in self.inputs else None
                                       for name in (*INPUTS, FAR_END))
            self.plant.hold(torque, pressure)
            self.plant.move_far_end(speed)
            for command in self.commands:
                command.acted()
        self._unanswered = None
        self._publish(self.plant.advance())

    def _begin_at_zero(self, again: bool = False) -> None:
        """Publish the initial state, after the scene if that or the run has changed or stamps count from another time.
        """
        moved = self.outputs.begin_at_zero(again)
        self._number, self._told = 0, -self._beat
        if moved or self._changed:
            self._announce(0)
        self._publish(self.plant.reading())

    def _announce(self, time_ns: int) -> None:
        """Publish the scene with its run and the simulation time of the first state computed with it."""
        text = holding_from(self._text, time_ns, self.plant.origin if time_ns else START, self.outputs.zero_ns,
                            self.outputs.run, self._node.get_fully_qualified_name())
        self.outputs.say("scene", cdr.string(text))

    def _report_inputs(self, after: int = held.GOES_ON) -> None:
        """Publish the inputs of the tick that ended, if something has changed, they are due, or the run stops."""
        plant, tick, inputs = self.plant, self.plant.stepper.tick, self.inputs.values()
        applied = plant.pressures[1] if plant.actuated else None
        seen = sum(one.events for one in inputs), applied, tuple(one.value is None for one in inputs)
        if seen == self._seen and not after and tick - self._told < self._beat:
            return
        self._seen, self._told, self._number = seen, tick, self._number + 1
        values: list[float] = [tick, plant.stamp_ns, self._number, after]
        for name in HELD_INPUTS:
            absent = (held.SCENE if name in INPUTS else held.NOBODY, *[math.nan] * 4, *[0] * 5)
            report = self.inputs[name].report(self.outputs.zero_ns) if name in self.inputs else absent
            values += report if applied is None or name != INPUTS[1] else (*report[:2], applied, *report[3:])
        self.outputs.say("held", held.held_message(self.outputs.run, values))

    def _publish(self, reading: Reading) -> None:
        if reading.stick_slip_state:
            self.slip_ticks += 1
        else:
            self.stick_ticks += 1
        self._report_inputs()
        self.outputs.state(reading)

    def _await_subscribers(self) -> bool:
        """Wait for wait_for_subscribers subscribers, and until no more appear; return False if the loop must stop."""
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
