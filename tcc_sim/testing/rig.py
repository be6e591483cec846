"""Run a driveline node and the nodes under test in one process in lock-step, with optional faults."""

from __future__ import annotations

import ctypes
import math
import random
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TypeVar

from rclpy.clock import ROSClock
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.timer import Timer
from std_msgs.msg import Float64, Float64MultiArray

from tcc_sim.analysis.loop.tracking import Limits, checked_limits
from tcc_sim.background import begun
from tcc_sim.errors import InputError, TccError, counted, one_line
from tcc_sim.messages import cdr
from tcc_sim.model.groups import PRESSURE_MAXIMUM
from tcc_sim.model.parameters import with_whole_lists
from tcc_sim.model.quantity import Options, quantity
from tcc_sim.nodes.driveline import DrivelineNode
from tcc_sim.nodes.loop_topics import CommandedInput
from tcc_sim.nodes.middleware import LATCHED, poll, subscribe
from tcc_sim.plant.closed_loop import MOST_TICKS, LockstepRun, Samples, TimedChanges, changes_of
from tcc_sim.plant.sensors import Schedule, Sensors
from tcc_sim.scene import SceneLike, as_scene
from tcc_sim.topics import FAR_END, FLUID_PRESSURE, INPUTS, LIMITS, topic

Result = TypeVar("Result")
_PACKAGE = Path(__file__).resolve().parent.parent
PATIENCE = 20.0
"""Largest real time for an answer, s."""
LOOK = 0.005
"""Real time of one wait for the nodes under test, s."""
CHECKED, ENDING = 0.05, 1.0
"""Real time between two checks whether the nodes hang, and in which an abandoned thread must end, s."""
PAUSE = 0.05
"""Default length of a pause, s of real time."""
SERVED = 20
"""Ticks between two checks for requests to the driveline's services; a check takes longer than a tick. Counting ticks
instead of time keeps runs identical.
"""
MOST_CALLBACKS = 1000
"""Largest number of callbacks executed when no answer is awaited; a node may produce them without end."""


class ControllerFailed(TccError, AssertionError):
    """A node under test died, hangs or does not answer; the message names it and the simulation time."""


@dataclass(frozen=True)
class Faults(Options):
    """Rates of faults: each kind with number n hits one random command of every n on each topic; 0 for none."""

    drop: int = quantity(0, "the command never arrives", low=0)
    delay: int = quantity(0, "the command arrives `delay_ticks` later, after commands sent meanwhile", low=0)
    duplicate: int = quantity(0, "the command arrives again in the next tick", low=0)
    corrupt: int = quantity(0, "the command is NaN, infinite, out of range, or truncated", low=0)
    delay_ticks: int = quantity(3, "length of a delay, ticks", low=1)
    seed: int = quantity(0, "seed; runs with equal seeds are identical", low=0)


class Line:
    """Channel of one topic's commands, which delivers each in the tick in which it was sent unless a fault hits it."""

    def __init__(self, name: str, faults: Faults) -> None:
        self._delay_ticks = faults.delay_ticks
        self._schedules = {kind: Schedule(getattr(faults, kind), f"{faults.seed} {name} {kind}")
                           for kind in ("drop", "delay", "duplicate", "corrupt")}
        self._draw = random.Random(f"{faults.seed} {name}")
        self._waiting: list[tuple[int, bool, bytes]] = []

    def send(self, data: bytes, tick: int) -> None:
        """Send a serialised command that answers the state of `tick`."""
        hit = {kind: schedule.hits() for kind, schedule in self._schedules.items()}
        if hit["drop"]:
            return
        data = self._corrupted(data) if hit["corrupt"] else data
        self._waiting.append((tick + (self._delay_ticks if hit["delay"] else 0), hit["delay"], data))
        if hit["duplicate"]:
            self._waiting.append((tick + 1, False, data))

    def deliver(self, tick: int) -> list[bytes]:
        """Return the commands that arrive before the tick after the state of `tick`, delayed ones last."""
        due = [data for late in (False, True) for when, delayed, data in self._waiting
               if when <= tick and delayed == late]
        self._waiting = [row for row in self._waiting if row[0] > tick]
        return due

    def _corrupted(self, data: bytes) -> bytes:
        """Return the command with an invalid value, or truncated."""
        value = self._draw.choice((math.nan, math.inf, -2.0 * PRESSURE_MAXIMUM, 2.0 * PRESSURE_MAXIMUM, None))
        if value is None:
            return data[:-5]
        try:
            return cdr.fluid_pressure(cdr.read_fluid_pressure(data)[0], value)
        except ValueError:
            return cdr.float64(value)


class GivenUp(BaseException):
    """Exception raised in a hanging thread to end it."""


class Worker:
    """Thread that runs one function at a time and abandons it if `beat` is not called for too long.

    Attributes
    ----------
    stuck : whether an abandoned function has not ended
    """

    def __init__(self) -> None:
        self.stuck = False
        self._beat = 0.0
        self._abandoned: list[threading.Thread] = []

    def beat(self) -> None:
        """Report progress; an abandoned function ends here."""
        if threading.current_thread() in self._abandoned:
            raise GivenUp
        self._beat = time.monotonic()

    def run(self, work: Callable[[], Result], patience: float, failed: Callable[[str], Exception]) -> Result:
        """Return the result of `work`, or raise its exception, or `failed(place)` if it hangs at a place in the code.

        patience : longest real time without progress, s
        """
        self.beat()
        outcome, thread = begun(work, name="nodes under test")
        try:
            while thread.is_alive():
                thread.join(CHECKED)
                if thread.is_alive() and time.monotonic() - self._beat > patience:
                    raise failed(_innermost_line(sys._current_frames().get(thread.ident or 0)))
        finally:
            self._abandoned += [thread] * thread.is_alive()
            self.stuck = thread.is_alive() and not _ended(thread)
        return outcome.result()


def _innermost_line(frame: FrameType | None) -> str:
    innermost = frame
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if not (path.is_relative_to(_PACKAGE) or "site-packages" in path.parts or path.is_relative_to(sys.base_prefix)):
            return f"{frame.f_code.co_name} ({path.name}:{frame.f_lineno})"
        frame = frame.f_back
    return "its callback" if innermost is None else f"{innermost.f_code.co_name}"


def _ended(thread: threading.Thread) -> bool:
    """Raise GivenUp in a thread at its next line of Python; return whether the thread has ended.

    A thread that blocks outside of Python keeps the exception. CPython 3.11 then never enters a traced function again,
    so under coverage or a debugger this thread is not traced meanwhile, and takes the exception back.
    """
    trace = sys.gettrace()
    sys.settrace(None)
    _raise_in(thread.ident, GivenUp)
    thread.join(ENDING)
    if thread.is_alive():
        _raise_in(thread.ident, None)
        with suppress(GivenUp):  # The interpreter's mark of a kept exception goes when one is raised.
            _raise_in(threading.get_ident(), GivenUp)
            time.sleep(0.0)
    sys.settrace(trace)
    return not thread.is_alive()


def _raise_in(ident: int | None, exception: type[BaseException] | None) -> None:
    """Let a thread raise an exception at its next line of Python; None takes it back."""
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(ident or 0), exception and ctypes.py_object(exception))


class Rig:
    """A driveline in lock-step with the nodes under test: each tick waits for the commands that answer the last state.

    Parameters
    ----------
    scene : a scene or a system, its name or its file
    changes : scene keys with new values
    rate : tick rate, Hz
    faults : faults of commands between the nodes and the driveline
    patience : real time for an answer after which the test fails, s

    Raises
    ------
    InputError
        The real-time solver cannot run the scene, or the changes or faults are wrong.
    """

    def __init__(self, scene: SceneLike, changes: Mapping[str, object] | None = None, rate: float = 1000.0,
                 faults: Mapping[str, int] | None = None, patience: float = PATIENCE) -> None:
        wanted = as_scene(scene).with_values({"publish_clock": True, **(changes or {}), "rate": rate,
                                              "pacing": "lockstep"})
        if wanted.operation.stamp != "simulation":
            raise InputError(f"stamp is {wanted.operation.stamp}; the test kit counts simulated time: set stamp to "
                             "simulation in the changes")
        self._patience = patience
        names = Faults.quantities()
        for name in faults or {}:
            if name not in names:
                raise InputError(f"{name} is not a fault; the faults are {', '.join(names)}")
        spoilt = Faults(**(faults or {}))
        self._lines = {**{name: Line(name, spoilt) for name in INPUTS}, FAR_END: Line(FAR_END, Faults())}
        try:
            self._node = DrivelineNode(wanted)
        except RuntimeError as error:
            raise InputError(f"ROS 2 refuses the driveline: {one_line(str(error))}; another node may already publish "
                             "one of its topics with another type") from None
        self._loop, self._plant = self._node.loop, self._node.loop.plant
        self._requests = SingleThreadedExecutor(context=self._node.context)
        self._requests.add_node(self._node)
        self._target_topic = subscribe(self._node, Float64, "target_slip_speed", LATCHED)
        self._limits_topic = subscribe(self._node, Float64MultiArray, LIMITS, LATCHED)
        self._limits: Limits | None = None
        self._target: float | None = None
        self._last_mean = math.nan
        self._worker = Worker()
        self._changes = TimedChanges(rate)
        self._commands: list[CommandedInput] = []
        self._followers = 0
        self._arrived: dict[str, list[bytes]] = {}
        self._tested: dict[Node, str] = {}
        """Names of the nodes under test, which a destroyed node no longer tells."""
        self._callbacks = SingleThreadedExecutor(context=self._node.context)
        self._closed = False

    def add(self, node: Node) -> Node:
        """Add a node under test and return it: `run` executes its callbacks, and `close` destroys it.

        Raises
        ------
        InputError
            The node has another ROS 2 context and would not receive the driveline's messages.
        """
        if node.context is not self._node.context:
            raise InputError(f"{node.get_name()} has another ROS 2 context; create it with the default context")
        self._callbacks.add_node(node)
        self._tested[node] = node.get_name()
        return node

    def run(self, seconds: float | None = None, ticks: int | None = None, target: float | None = None,
            limits: Limits | None = None) -> LockstepRun:
        """Run the driveline for a number of ticks, each after the commands that answer the last state.

        Parameters
        ----------
        seconds, ticks : length of the run, one of the two; simulated time is rounded to whole ticks
        target : slip speed to hold, rad/s, for a controller that does not publish target_slip_speed
        limits : smallest and largest pressure that the controller commands, Pa, for the run's `tracking`

        Returns
        -------
        LockstepRun, a Trajectory with the initial state of this run and a sample for every tick; the nodes under test
        have processed its last state

        Raises
        ------
        InputError
            Both or neither of seconds and ticks are given, or the number of ticks is out of range.
        ControllerFailed
            A node under test died, hangs, or does not answer.
        """
        __tracebackhide__ = True
        self._check_open()
        checked_limits(limits)
        if (seconds is None) == (ticks is None):
            raise InputError("give either seconds or ticks")
        wanted = (seconds or 0.0) * self._node.scene.operation.rate if ticks is None else ticks
        if not 0.5 < wanted <= MOST_TICKS or ticks not in (None, round(wanted)):
            raise InputError(f"a run of {f'{seconds:g} s' if ticks is None else f'{ticks} ticks'} is not possible; it "
                             f"must be a whole number of ticks, 1 to {MOST_TICKS}")
        self._plant.warm_up()  # Kernels compile before the nodes' time for an answer begins.
        return self._done(lambda: self._run(round(wanted), target, limits), self._patience)

    def change(self, values: Mapping[str, object] | None = None, **more: object) -> None:
        """Change parameters together from the next tick on: ``change({"engine.mean_torque": 300.0})``, or
        ``change(engine__mean_torque=300.0)``.

        Raises
        ------
        InputError
            The driveline refuses the changes; the message is the driveline's.
        """
        self._check_open()
        changes = with_whole_lists(changes_of(values, more), self._node.scene.value)
        self._node.scene.with_values(changes)
        self._plant.warm_up()
        result = self._node.set_parameters_atomically([Parameter(key, value=value) for key, value in changes.items()])
        if not result.successful:
            raise InputError(result.reason)

    def at(self, t: float, values: Mapping[str, object] | None = None, **more: object) -> None:
        """Schedule a change of parameters at simulation time t, s: ``at(1.5, engine__mean_torque=300.0)``.

        The tick that begins at t is the first with the new values.

        Raises
        ------
        InputError
            The time is not a whole number of ticks or has passed, or a key or value is not valid for a scene.
        """
        changes = changes_of(values, more)
        self._node.scene.with_values(changes)
        self._changes.add(t, changes, self._plant.stepper.tick)

    def sensor(self, name: str, **options: float) -> None:
        """Set the sensor of a signal or topic: ``sensor("slip_speed", noise=0.3, delay_ticks=5)``.

        It acts from the next state on and replaces an earlier sensor of the same name. `run` returns the true states.

        Parameters
        ----------
        name : slip_speed, joint_states, or a signal of joint_states
        options : noise, offset, quantum (in the signal's unit), delay_ticks, drop, seed, as `plant.sensors.Sensor`

        Raises
        ------
        InputError
            The signal or option does not exist, or a number is out of its range.
        """
        outputs = self._loop.outputs
        outputs.sensors = outputs.sensors or Sensors()
        outputs.sensors.put(name, options)

    def pause(self, seconds: float = PAUSE) -> None:
        """Execute callbacks of the nodes under test for `seconds` of real time while simulation time is stopped."""
        __tracebackhide__ = True
        self._check_open()
        end = time.monotonic() + seconds

        def spin() -> None:
            while (left := end - time.monotonic()) > 0.0:
                self._spin(min(left, LOOK))
                self._requests.spin_once(timeout_sec=0.0)

        self._done(spin, self._patience + seconds)

    def close(self) -> None:
        """Destroy the driveline and every node under test."""
        if self._closed:
            return
        self._closed = True
        if self._worker.stuck:  # A hanging node still blocks the executor.
            return
        self._callbacks.shutdown()
        self._requests.shutdown()
        for node in [*self._tested, self._node]:
            node.destroy_node()

    def _done(self, work: Callable[[], Result], patience: float) -> Result:
        """Return the result of work in the worker's thread; the frames of a failure's traceback are those of the test.
        """
        __tracebackhide__ = True
        try:
            return self._worker.run(work, patience, self._failed)
        except ControllerFailed as error:
            failed = error
        raise failed.with_traceback(None)

    def _check_open(self) -> None:
        """Raise InputError after `close`, which starting another driveline in the same test calls too."""
        if self._closed:
            raise InputError("this driveline is closed: by close(), or because the test has started another one")

    def _run(self, count: int, target: float | None, limits: Limits | None) -> LockstepRun:
        commands = self._begin()
        samples = Samples(self._plant)
        self._add(samples)
        before = {command.name: command.refused for command in commands}
        missed, targets = 0, list[tuple[float, int]]()
        self._take_target(target, targets, 0)
        for _ in range(count):
            if self._plant.stepper.tick % SERVED == 0:
                self._requests.spin_once(timeout_sec=0.0)
            awaited = self._awaited(commands)
            self._await_answers(commands, awaited)
            missed += self._deliver(commands, awaited)
            if (changes := self._changes.due(self._plant.stepper.tick)) is not None:
                self.change(changes)
            self._loop.step()
            self._loop.outputs.flush()
            self._add(samples)
            self._take_target(target, targets, len(samples) - 1)
            self._worker.beat()
        self._settle()
        for data, _ in poll(self._limits_topic):
            with suppress(ValueError):
                self._limits = cdr.read_pressure_limits(data)
        refused = sum(command.refused - before[command.name] for command in commands)
        run = LockstepRun(**samples.columns(self._plant), refused=refused, missed=missed,  # type: ignore[arg-type]
                          refusal=next((command.refusal for command in commands if command.refusal), ""),
                          targets=tuple(targets), limits=limits or self._limits,
                          before=self._last_mean if samples.begins_later else math.nan)
        self._last_mean = run.last_mean
        return run

    def _begin(self) -> list[CommandedInput]:
        """Return the inputs with a publisher, and publish the initial state once."""
        self._loop.meet()
        commands = [command for command in self._loop.commands if command.subscription.get_publisher_count()]
        for command in self._loop.commands:
            if command not in commands and self._node.count_publishers(command.name):
                raise ControllerFailed(f"no command on {command.name} can arrive: "
                                       f"{self._node.waiting.publishers(command)}")
        if self._loop.commands and not commands:
            names = " and ".join(command.name for command in self._loop.commands)
            raise ControllerFailed(f"no node under test publishes {names}, which the scene {self._node.scene.name} "
                                   "takes as a topic")
        self._commands = commands
        self._loop.clock.note_timed(commands)
        self._followers = len(self._loop.clock.followers)
        if not self._loop.clock_started.is_set():
            self._loop.begin()
        return commands

    def _awaited(self, commands: list[CommandedInput]) -> list[CommandedInput]:
        """Return the inputs whose commands must answer the current state, which is once per command_period.

        Nodes with use_sim_time follow /clock: their timers decide when they send. A lost message needs no answer. The
        far end is commanded at every state.
        """
        sensors = self._loop.outputs.sensors
        due = self._plant.stepper.tick % self._node.scene.operation.answer_ticks == 0 and not (
            sensors and sensors.lost)
        return [command for command in commands if not command.timed and (due or command.name == FAR_END)]

    def _await_answers(self, commands: list[CommandedInput], awaited: list[CommandedInput]) -> None:
        """Execute callbacks of the nodes under test until all awaited commands have arrived; take others too."""
        plant = self._plant
        tick, stamp, since = plant.stepper.tick, plant.stamp_ns, time.monotonic()
        missing, others = list(awaited), 0
        if len(missing) < len(commands) or not commands:
            self._settle()
            for command in commands:
                if command not in awaited:
                    for data in self._taken(command):
                        self._lines[command.name].send(data, tick)
        while missing:
            for command in tuple(missing):
                for data in self._taken(command):
                    self._lines[command.name].send(data, tick)
                    if _answers(command.name, data, stamp):
                        missing = [other for other in missing if other is not command]
                    else:
                        others += 1
            if missing:
                if time.monotonic() - since > self._patience:
                    raise ControllerFailed(self._no_answer(missing[0].name, others))
                self._spin(LOOK)
                if time.monotonic() - since > LOOK:
                    self._requests.spin_once(timeout_sec=0.0)
            self._worker.beat()

    def _collect(self) -> list[str]:
        """Take the commands that have arrived, and return the names of their topics."""
        commands = []
        for command in self._commands:
            arrived = [data for data, _ in poll(command.subscription)]
            self._arrived.setdefault(command.name, []).extend(arrived)
            commands += [command.name] * bool(arrived)
        return commands

    def _taken(self, command: CommandedInput) -> list[bytes]:
        self._collect()
        return self._arrived.pop(command.name, [])

    def _deliver(self, commands: list[CommandedInput], awaited: list[CommandedInput]) -> int:
        """Deliver the commands due before the next tick; return how many awaited inputs have no new command."""
        tick, missed = self._plant.stepper.tick, 0
        for command in commands:
            received = command.received
            for data in self._lines[command.name].deliver(tick):
                command.accept(data, tick)
            missed += command in awaited and command.received == received
        return missed

    def _add(self, samples: Samples) -> None:
        """Add the current state with the commands held in the tick before it."""
        held = self._loop.inputs
        received = held[INPUTS[1]].received if INPUTS[1] in held else 0
        samples.add(self._plant, self._plant.reading(), {name: one.value for name, one in held.items()}, received)

    def _take_target(self, given: float | None, targets: list[tuple[float, int]], sample: int) -> None:
        """Append the target (given or last published), rad/s, with its first sample if it is new."""
        for data, _ in poll(self._target_topic):
            self._target = cdr.read_float64(data)
        target = self._target if given is None else given
        if target is not None and (not targets or targets[-1][0] != target):
            targets.append((target, sample))

    def _spin(self, seconds: float) -> bool:
        """Execute one callback that is ready within `seconds`; return whether there was one.

        Raises ControllerFailed: the callback raised, shut ROS 2 down, or destroyed its node; or it is that of a timer
        of the wall clock and sent a command.
        """
        try:
            callback, entity, owner = self._callbacks.wait_for_ready_callbacks(timeout_sec=seconds)
        except TimeoutException:
            return False
        except ShutdownException:
            raise ControllerFailed(f"{self._names} shut ROS 2 down at {self._now()}") from None
        self._worker.beat()
        if on_wall_clock := _on_wall_clock(entity):
            self._collect()
        try:
            callback()
        except SystemExit as error:
            raise ControllerFailed(f"{self._names} called sys.exit({error.code!r}) at {self._now()}") from _cut(error)
        self._worker.beat()
        failure = callback.exception()
        self._check_alive()
        if failure is not None:
            raise ControllerFailed(f"{self._names} died at {self._now()}: {type(failure).__name__}: "
                                   f"{failure}") from _cut(failure)
        if on_wall_clock and (sent := self._collect()):
            name, period = self._tested.get(owner, self._names), entity.timer_period_ns * 1e-9
            raise ControllerFailed(f"{name} sends {' and '.join(sent)} from a timer of the wall clock ({period:g} s), "
                                   "which answers no state: give the node use_sim_time, which puts its timers on "
                                   "/clock, or send from its subscription")
        return True

    def _settle(self) -> None:
        """Execute callbacks until none is ready."""
        idle = 0
        for _ in range(MOST_CALLBACKS):
            # A message on /clock makes timers ready only at the next call.
            idle = 0 if self._spin(0.0) else idle + 1
            if idle > self._followers:
                break

    def _check_alive(self) -> None:
        if not self._node.context.ok():
            raise ControllerFailed(f"{self._names} shut ROS 2 down at {self._now()}")
        for node, name in self._tested.items():
            try:
                with node.handle:
                    pass
            except InvalidHandle:
                raise ControllerFailed(f"{name} destroyed itself at {self._now()}") from None

    @property
    def _names(self) -> str:
        return " or ".join(self._tested.values()) or "no node"

    def _now(self) -> str:
        return f"{self._plant.stamp_ns * 1e-9:.9g} s of simulated time"

    def _no_answer(self, name: str, others: int) -> str:
        sent = f"; {counted(others, 'command')} had the stamp of another state" if others else ""
        return (f"{self._names} did not answer the state of {self._now()} on {name} within "
                f"{self._patience:g} s{sent}; a command must have the stamp of the state, or stamp 0")

    def _failed(self, where: str) -> ControllerFailed:
        return ControllerFailed(f"{self._names} hangs at {self._now()}: for {self._patience:g} s it has not "
                                f"returned from {where}")


def _answers(name: str, data: bytes, stamp: int) -> bool:
    """Return whether a command answers the state with this stamp, ns: by its stamp, or any without one."""
    if topic(name).type != FLUID_PRESSURE:
        return True
    try:
        return cdr.read_fluid_pressure(data)[0] in (0, stamp)
    except ValueError:
        return True


def _cut(error: BaseException) -> BaseException:
    """Return the exception of a callback without the frames of the executor that called it."""
    frames = error.__traceback__
    while frames is not None and frames.tb_frame.f_globals["__name__"].partition(".")[0] in ("rclpy", "tcc_sim"):
        frames = frames.tb_next
    return error.with_traceback(frames or error.__traceback__)


def _on_wall_clock(entity: object) -> bool:
    """Return whether what is ready is a timer that does not follow /clock."""
    if not isinstance(entity, Timer):
        return False
    clock = entity.clock
    return not (isinstance(clock, ROSClock) and clock.ros_time_is_active)
