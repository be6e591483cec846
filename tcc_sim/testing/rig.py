"""A driveline node and the nodes under test in one process, stepped by the answers, with faults on request."""

from __future__ import annotations

import time
from collections.abc import Mapping

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

from tcc_sim.errors import InputError, one_line
from tcc_sim.messages import cdr
from tcc_sim.nodes.driveline import DrivelineNode
from tcc_sim.nodes.loop_topics import CommandedInput
from tcc_sim.nodes.middleware import LATCHED, poll, subscribe
from tcc_sim.plant.closed_loop import MOST_TICKS, Samples
from tcc_sim.plant.sensors import Sensors
from tcc_sim.plant.timed_changes import TimedChanges, changes_of
from tcc_sim.scene import SceneLike, as_scene
from tcc_sim.testing.faults import Faults, Line
from tcc_sim.testing.run import ControllerFailed, LockstepRun, Worker
from tcc_sim.testing.under_test import UnderTest
from tcc_sim.topics import FAR_END, FLUID_PRESSURE, INPUTS, topic

PATIENCE = 20.0
"""Real time, s, that an answer may take."""
LOOK = 0.005
"""Real time, s, that the nodes under test are waited for at a time."""
PAUSE = 0.05
"""Real time, s, of a pause."""
SERVED = 20
"""Ticks between two looks at what is asked of the driveline's services, which take longer than a tick; counted, so that
a run is the same each time.
"""


class Rig:
    """One driveline for a test: it waits for the commands that answer a state before it makes the next tick.

    Parameters
    ----------
    scene : a scene or a system, its name or its file
    changes : scene keys to change first
    rate : ticks a second, Hz
    faults : what happens to commands on their way
    patience : real time, s, that an answer may take before the test fails

    Raises
    ------
    InputError
        A scene that the real-time solver cannot run, or wrong changes or faults.
    """

    def __init__(self, scene: SceneLike, changes: Mapping[str, object] | None = None, rate: float = 1000.0,
                 faults: Faults | Mapping[str, int] | None = None, patience: float = PATIENCE) -> None:
        wanted = as_scene(scene).with_values({"publish_clock": True, **(changes or {}), "rate": rate,
                                              "pacing": "lockstep"})
        self._patience = patience
        self._lines = {**{name: Line(name, Faults.of(faults)) for name in INPUTS}, FAR_END: Line(FAR_END, Faults())}
        try:
            self._node = DrivelineNode(wanted)
        except RuntimeError as error:
            raise InputError(f"ROS 2 refuses the driveline: {one_line(str(error))}; a node that is there already may "
                             "publish one of its topics with another type") from None
        self._loop, self._plant = self._node.loop, self._node.loop.plant
        self._requests = SingleThreadedExecutor(context=self._node.context)
        self._requests.add_node(self._node)
        self._target_topic = subscribe(self._node, Float64, "target_slip_speed", LATCHED)
        self._timed: set[str] = set()
        self._target: float | None = None
        self._worker = Worker()
        self._changes = TimedChanges(rate)
        self._under_test = UnderTest(self._node.context, self._now, self._worker.beat)
        self._closed = False

    def add(self, node: Node) -> Node:
        """Put a node under test: it is spun while the driveline runs, and destroyed at the end; gives it back.

        Raises
        ------
        InputError
            A node of another ROS 2 context, which would not hear the driveline.
        """
        self._under_test.add(node)
        return node

    def run(self, seconds: float | None = None, ticks: int | None = None, target: float | None = None) -> LockstepRun:
        """Make so many ticks, each once the commands that answer the state before it are there.

        Parameters
        ----------
        seconds, ticks : one of the two; simulated time, of which whole ticks are taken
        target : slip speed that the controller is to hold, rad/s, where it does not publish target_slip_speed

        Returns
        -------
        LockstepRun, a Trajectory with a sample for every tick and the state at which this run began; the nodes under
        test have done by then what its last state lets them do

        Raises
        ------
        InputError
            Not one of the two, or a number of ticks that no run has.
        ControllerFailed
            A node under test died, hangs, or does not answer.
        """
        if (seconds is None) == (ticks is None):
            raise InputError("give either seconds or ticks")
        wanted = (seconds or 0.0) * self._node.scene.operation.rate if ticks is None else ticks
        if not 0.5 < wanted <= MOST_TICKS or ticks not in (None, round(wanted)):
            raise InputError(f"{seconds if ticks is None else ticks} is no run; it must have whole ticks, at most "
                             f"{MOST_TICKS}, and at least one")
        return self._worker.run(lambda: self._run(round(wanted), target), self._patience, self._failed)

    def change(self, values: Mapping[str, object] | None = None, **more: object) -> None:
        """Change parameters from the next tick on, all or none: ``change({"engine.mean_torque": 300.0})``, or
        ``change(engine__mean_torque=300.0)``.

        Raises
        ------
        InputError
            The driveline refuses; in its own words.
        """
        changes = changes_of(values, more)
        self._plant.warm_up()
        if self._plant.needs_general(self._node.scene.with_values(changes)):
            self._plant.warm_up_general()
        result = self._node.set_parameters_atomically([Parameter(key, value=value) for key, value in changes.items()])
        if not result.successful:
            raise InputError(result.reason)

    def at(self, t: float, values: Mapping[str, object] | None = None, **more: object) -> None:
        """Change parameters at the simulation time t, s, of a run to come: ``at(1.5, engine__mean_torque=300.0)``. The
        tick that begins then is the first with the new values.

        Raises
        ------
        InputError
            A time that is no whole number of ticks or that has passed, or a key or value that no scene has.
        """
        changes = changes_of(values, more)
        self._node.scene.with_values(changes)
        self._changes.add(t, changes, self._plant.stepper.tick)

    def sensor(self, name: str, **options: float) -> None:
        """Put a sensor before a signal of joint_states, slip_speed or joint_states from the next state on, in the place
        of the one that is there: ``sensor("slip_speed", noise=0.3, delay_ticks=5)``. A run keeps the true states.

        Parameters
        ----------
        options : noise, offset, quantum (in the signal's unit), delay_ticks, drop, seed, as `plant.sensors.Sensor`

        Raises
        ------
        InputError
            No such signal or option, or a number out of its range.
        """
        outputs = self._loop.outputs
        outputs.sensors = outputs.sensors or Sensors()
        outputs.sensors.put(name, options)

    def pause(self, seconds: float = PAUSE) -> None:
        """Let the driveline stand still for so many seconds of real time, in which the nodes under test are spun."""
        end = time.monotonic() + seconds

        def spin() -> None:
            while (left := end - time.monotonic()) > 0.0:
                self._under_test.spin(min(left, LOOK))
                self._requests.spin_once(timeout_sec=0.0)

        self._worker.run(spin, self._patience + seconds, self._failed)

    def close(self) -> None:
        """Destroy the driveline and every node under test."""
        if self._closed:
            return
        self._closed = True
        if self._worker.stuck:  # A node that hangs holds the executor.
            return
        self._under_test.shutdown()
        self._requests.shutdown()
        for node in [*self._under_test.nodes, self._node]:
            node.destroy_node()

    def _run(self, count: int, target: float | None) -> LockstepRun:
        """In the worker: the ticks of one run."""
        commands = self._begin()
        samples = Samples(self._plant)
        samples.add(self._plant, self._plant.reading(), *self._held())
        before = {command.name: command.refused for command in commands}
        missed, said = 0, self._asked_for(target, None, 0)
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
            samples.add(self._plant, self._plant.reading(), *self._held())
            said = self._asked_for(target, said, len(samples) - 1)
            self._worker.beat()
        self._under_test.settle()
        refused = sum(command.refused - before[command.name] for command in commands)
        return LockstepRun(**samples.columns(self._plant), refused=refused, missed=missed,  # type: ignore[arg-type]
                         refusal=next((command.refusal for command in commands if command.refusal), ""), target=said)

    def _begin(self) -> list[CommandedInput]:
        """The commands that are waited for; the initial state is said when those who take part are there."""
        self._loop.meet()
        commands = [command for command in self._loop.commands if command.subscription.get_publisher_count()]
        if self._loop.commands and not commands:
            names = " and ".join(command.name for command in self._loop.commands)
            raise ControllerFailed(f"no node that was added publishes {names}, which the scene "
                                   f"{self._node.scene.name} takes")
        timed = self._under_test.timed
        self._timed = {command.name for command in commands if timed and timed >= {
            info.node_name for info in self._node.get_publishers_info_by_topic(command.name)}}
        if not self._loop.clock_started.is_set():
            self._loop.begin()
        return commands

    def _awaited(self, commands: list[CommandedInput]) -> list[CommandedInput]:
        """The commands that must answer the state: once a command_period, and of nodes that follow the states.

        A node with use_sim_time follows /clock: its timers decide when it sends. A lost message has no answer. A
        vehicle answers every state.
        """
        sensors = self._loop.outputs.sensors
        due = self._plant.stepper.tick % self._node.scene.operation.answer_ticks == 0 and not (
            sensors and sensors.lost)
        return [command for command in commands
                if command.name not in self._timed and (due or command.name == FAR_END)]

    def _await_answers(self, commands: list[CommandedInput], awaited: list[CommandedInput]) -> None:
        """Spin the nodes under test until every command that must answer the state is there, and take the others."""
        plant = self._plant
        tick, stamp, since = plant.stepper.tick, plant.stamp_ns, time.monotonic()
        missing, others = list(awaited), 0
        if len(missing) < len(commands) or not commands:
            self._under_test.settle()
            for command in commands:
                if command not in awaited:
                    for data, _ in poll(command.subscription):
                        self._lines[command.name].send(data, tick)
        while missing:
            for command in tuple(missing):
                for data, _ in poll(command.subscription):
                    self._lines[command.name].send(data, tick)
                    if _answers(command.name, data, stamp):
                        missing = [other for other in missing if other is not command]
                    else:
                        others += 1
            if missing:
                if time.monotonic() - since > self._patience:
                    raise ControllerFailed(self._no_answer(missing[0].name, others))
                self._under_test.spin(LOOK)
                if time.monotonic() - since > LOOK:
                    self._requests.spin_once(timeout_sec=0.0)
            self._worker.beat()

    def _deliver(self, commands: list[CommandedInput], awaited: list[CommandedInput]) -> int:
        """Hand over what arrives before the next tick; how many of the awaited inputs have nothing new."""
        tick, missed = self._plant.stepper.tick, 0
        for command in commands:
            received = command.received
            for data in self._lines[command.name].deliver(tick):
                command.accept(data, tick)
            missed += command in awaited and command.received == received
        return missed

    def _held(self) -> tuple[float | None, float | None]:
        """Engine torque and pressure that hold."""
        return tuple(None if command is None else command.value  # type: ignore[return-value]
                     for command in (self._loop.engine_command, self._loop.pressure_command))

    def _asked_for(self, given: float | None, said: tuple[float, int] | None, sample: int) -> tuple[float, int] | None:
        """The target, as given or as last published, rad/s, and the sample from which on it is another than `said`."""
        for data, _ in poll(self._target_topic):
            self._target = cdr.read_float64(data)
        target = self._target if given is None else given
        return said if target is None or (said is not None and said[0] == target) else (target, sample)

    def _now(self) -> str:
        """Simulation time in words."""
        return f"{self._plant.stamp_ns * 1e-9:.9g} s of simulated time"

    def _no_answer(self, name: str, others: int) -> str:
        """The sentence for a state that nobody answers."""
        sent = f"; it sent {others} with the stamps of other states" if others else ""
        return (f"{self._under_test.names} did not answer the state of {self._now()} on {name} within "
                f"{self._patience:g} s{sent}: a command answers with the stamp of the state, or with stamp 0")

    def _failed(self, where: str) -> ControllerFailed:
        """The exception for a callback that does not return."""
        return ControllerFailed(f"{self._under_test.names} hangs at {self._now()}: for {self._patience:g} s it has not "
                                f"come back from {where}")


def _answers(name: str, data: bytes, stamp: int) -> bool:
    """Whether a command answers the state of this stamp, ns: by its own stamp, or by count where it has none."""
    if topic(name).type != FLUID_PRESSURE:
        return True
    try:
        return cdr.read_fluid_pressure(data)[0] in (0, stamp)
    except ValueError:
        return True
