"""The driveline node: parameters, services and diagnostics around the real-time loop.

`ros2 run tcc_sim driveline_node`, or `python -m tcc_sim.nodes.driveline`.
"""

from __future__ import annotations

if __name__ == "__main__":
    from tcc_sim.nodes.executables import driveline_node

    raise SystemExit(driveline_node())

import gc
import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import ReliabilityPolicy
from std_srvs.srv import SetBool, Trigger

from tcc_sim.errors import InputError, counted, one_line
from tcc_sim.nodes import executables, parameters
from tcc_sim.nodes.children import CLOCK_STARTED
from tcc_sim.nodes.executables import Spinner, Throttle, deliver, run_node
from tcc_sim.nodes.loop import Outcome, RealTimeLoop
from tcc_sim.nodes.loop_topics import LONGEST_QUIET, CommandedInput, joining
from tcc_sim.nodes.middleware import DIAGNOSTICS
from tcc_sim.nodes.parameters import TEXT
from tcc_sim.plant.driveline import doubt_of
from tcc_sim.recording.announcements import LATE_SHARE
from tcc_sim.scene import Scene
from tcc_sim.topics import FAR_END, INPUTS, TARGET, topic

SWITCH_INTERVAL = 1e-4
"""Time after which the real-time loop interrupts another thread in the interpreter, s."""
DOUBTED_AFTER = 0.5
"""Simulation time after which commands that are too small for their unit cause a warning, s: a ramp begins at 0."""
DIAGNOSTICS_PERIOD = 1.0
"""Real time between two messages on /diagnostics, s."""
PATIENCE = 1.0
"""Real time after which a fallback or a wait causes a warning, s."""


class DrivelineNode(Node):
    """The driveline as a ROS 2 node: parameters, services, logging; physics and topics run in `loop`.

    Without a scene it takes the one of its parameters.
    """

    def __init__(self, scene: Scene | None = None, **options: Any) -> None:
        super().__init__("driveline", **options)
        scene = parameters.declare(self, scene)
        for sentence in scene.warnings():
            self.get_logger().warning(sentence)
        self.loop = RealTimeLoop(self, scene)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._after_set_parameters)
        loop, stepper = self.loop, self.loop.plant.stepper
        self.create_service(Trigger, "~/reset", self._does(
            lambda _: loop.reset(), lambda _: "at the initial state, simulation time 0"))
        self.create_service(SetBool, "~/pause", self._does(
            lambda request: loop.pause(request.data), lambda _: "paused" if loop.paused else "running"))
        self.create_service(Trigger, "~/step", self._does(
            lambda _: loop.single_step(), lambda outcome: f"at tick {stepper.tick}" if outcome else "not paused"))
        self.create_service(SetParametersAtomically, "~/command", self._on_command)
        self.waiting = Waiting(self, self.loop)
        self.diagnostics = Diagnostics(self, loop, self.waiting) if scene.operation.publish_diagnostics else None
        self._announced = False
        self._vehicle: CommandedInput | None = None
        self._throttle = Throttle(self)

    @property
    def scene(self) -> Scene:
        """The current scene."""
        return self.loop.scene

    def start(self) -> None:
        """Compile the kernels, then start the clock.

        Raises InputError: the scene cannot be computed in real time on this machine.
        """
        self.loop.start()
        self.get_logger().info(f"scene {self.scene.name}, {self.scene.operation.rate:g} Hz, "
                               f"{counted(self.loop.plant.stepper.substeps, 'sub-step')} a tick")

    def housekeeping(self) -> None:
        """Publish diagnostics when due, log throttled warnings, and raise the failure of the loop if there was one."""
        loop, pacer, throttled = self.loop, self.loop.pacer, self._throttle.warn
        if self.diagnostics is not None:
            self.diagnostics.publish_when_due()
        loop.outputs.tell_unsent()
        self._look_for_vehicle()
        started = loop.clock_started.is_set()
        if started and TARGET not in loop.inputs and (target := joining(self, TARGET)) is not None:
            loop.request(lambda: loop.attach(target))
        if started and loop.clock.due:
            loop.request(lambda: loop.clock.begin(loop.plant.stamp_ns))
        if started and not self._announced:
            self._announced = True
            self.get_logger().info(CLOCK_STARTED)
            for sentence in loop.refused_wishes:
                self.get_logger().warning(sentence)
        for command in loop.commands:
            if doubt := command.doubt(loop.plant.stepper.tick, DOUBTED_AFTER * self.scene.operation.rate):
                self._throttle.once(f"{command.name} unit", doubt)
            throttled(f"{command.name} refused", command.refusal, command.refused)
            throttled(f"{command.name} time-outs", f"no command on {command.name} within command_timeout; the fallback "
                      "applied", command.timeouts)
        for what, sentence in self.waiting.sentences().items():
            throttled(what, sentence)
        for name, sentence in self.waiting.unstamped().items():
            self._throttle.once(f"{name} stamps", sentence)
        throttled("missed ticks", f"the real-time loop was {pacer.missed_by:.3g} s late, as after a pause of the "
                  "process; ticks were missed in real time, none in simulation time", pacer.missed_ticks)
        if self.diagnostics is not None and self.diagnostics.lateness:
            self._throttle.once("late ticks", self.diagnostics.lateness)
        if loop.failure is not None:
            raise loop.failure

    def _look_for_vehicle(self) -> None:
        """Subscribe to output_speed once its first message is there, until its last publisher has gone."""
        loop = self.loop
        attached = loop.inputs.get(FAR_END)
        if self._vehicle is None and loop.clock_started.is_set() and attached is None:
            self._vehicle = joining(self, FAR_END)
        if (far_end := self._vehicle) is not None and attached is None:
            far_end.poll(0, math.inf)
            if far_end.received + far_end.refused:
                loop.request(lambda: self._attach(far_end), timeout=2.0 * LONGEST_QUIET)
        elif attached is not None and not self.count_publishers(FAR_END) and loop.request(loop.detach):
            self._vehicle = None
            self.destroy_subscription(attached.subscription)

    def _attach(self, far_end: CommandedInput) -> None:
        """Take output_speed from now on; called in the loop."""
        if self.scene.operation.pacing == "lockstep":
            far_end.join(self.loop.plant.stepper.tick)
        self.loop.attach(far_end)

    def destroy_node(self) -> None:
        """Stop the loop, then destroy the node."""
        loop: RealTimeLoop | None = getattr(self, "loop", None)
        if loop is not None:
            loop.stop()
        super().destroy_node()

    def _on_set_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Check all changes of a request together and apply them between two ticks."""
        try:
            after = parameters.changed(self.scene, changes)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        if after == self.scene:
            return SetParametersResult(successful=True)
        text = after.text()
        before = self.scene.warnings()
        outcome = self.loop.request(lambda: self.loop.use(after, text))
        for sentence in after.warnings():
            if outcome.done and sentence not in before:
                self.get_logger().warning(sentence)
        return SetParametersResult(successful=outcome.done, reason=one_line(outcome.why))

    def _after_set_parameters(self, changes: list[Parameter]) -> None:
        """Update scene_text after a change."""
        text = self.scene.text()
        if text != self.get_parameter(TEXT).value:
            self.set_parameters([Parameter(TEXT, value=text)])

    def _on_command(self, request: Any, response: Any) -> Any:
        """Hold commanded values, parameters with the names of the inputs, and answer with how long they hold."""
        values = {item.name: parameter_value_to_python(item.value) for item in request.parameters}
        for name, value in values.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                response.result.reason = f"{name} command {value!r} refused; it must be a number"
                return response
        outcome = self.loop.request(lambda: self.loop.command(values))
        timeout = self.scene.operation.command_timeout
        held = f"held for {timeout:g} s of simulated time (command_timeout)" if timeout else (
            "held until the next command")
        notes = [f"{held}, once the driveline goes on: it is paused" if self.loop.paused else held]
        for command in self.loop.commands:
            if command.name in values:
                if others := command.subscription.get_publisher_count():
                    notes.append(f"{counted(others, 'publisher')} on {command.topic}: the newest command counts")
                if doubt := doubt_of(command.name, values[command.name]):
                    notes.append(doubt.partition("; ")[2])
        response.result.successful = outcome.done
        response.result.reason = "; ".join(notes) if outcome else one_line(outcome.why)
        return response

    def _does(self, action: Callable[[Any], object], sentence: Callable[[Outcome], str]) -> Callable[[Any, Any], Any]:
        """Return a service callback that requests an action of the loop and answers with its outcome."""
        def answer(request: Any, response: Any) -> Any:
            outcome = self.loop.request(lambda: action(request))
            response.success, response.message = outcome.done, outcome.why or sentence(outcome)
            return response

        return answer


class Waiting:
    """Warnings about a driveline that waits.

    `clock` returns real time, s.
    """

    def __init__(self, node: Node, loop: RealTimeLoop, clock: Callable[[], float] = time.monotonic) -> None:
        self._node, self._loop, self._clock = node, loop, clock
        self._since: dict[tuple[str, int], float] = {}

    def sentences(self) -> dict[str, str]:
        """Return sentences for the log by subject, for each condition that has lasted for PATIENCE.

        Lock-step waits for one command on each topic, whoever publishes it, so a topic is one subject. Where an earlier
        command holds, each state begins a new wait.
        """
        loop = self._loop
        wanted = loop.scene.operation.wait_for_subscribers
        if not loop.clock_started.is_set():
            subscribers = loop.outputs.subscriptions()[0]
            name = self._node.resolve_topic_name("joint_states")
            missing = {"subscribers": f"the first tick waits for wait_for_subscribers {wanted}; "
                       f"{name} has {counted(subscribers, 'subscriber')}"} if subscribers < wanted else {}
        elif loop.paused:
            missing = {}
        elif loop.waits_for:
            state = f"the state of {loop.plant.stamp_ns * 1e-9:.9g} s"
            missing = {command.name: f"lock-step waits for a command that answers {state}; {self.publishers(command)}"
                       for command in loop.waits_for}
        else:
            missing = {command.name: f"no command on {command.topic}, the fallback applies "
                       f"({self._fallback(command)}); {self.publishers(command)}"
                       for command in loop.commands if command.value is None}
        if loop.clock_started.is_set() and (clock := loop.clock.sentence()):
            missing["/clock"] = clock
        now = self._clock()
        slow = {command.name for command in loop.waits_for if command.value is not None}
        waits = {what: (what, loop.plant.stamp_ns if what in slow else -1) for what in missing}
        self._since = {wait: self._since.get(wait, now) for wait in waits.values()}
        sentences = {what: f"{sentence}; since {now - since:.0f} s" for what, sentence in missing.items()
                     if now - (since := self._since[waits[what]]) >= PATIENCE}
        for command in loop.commands:
            count = command.subscription.get_publisher_count()
            if count > 1:
                sentences[f"{command.name} publishers"] = (f"{count} publishers send commands and the newest command "
                                                           f"counts: {self.publishers(command)}")
        return sentences

    def unstamped(self) -> dict[str, str]:
        """Return a sentence for each input whose commands lock-step takes without knowing which state they answer."""
        loop, sentences = self._loop, dict[str, str]()
        if loop.scene.operation.pacing != "lockstep":
            return sentences
        loop.clock.note_timed(loop.commands)
        for command in loop.commands:
            if command.unstamped and not command.timed and command.name != FAR_END:
                sentences[command.name] = (
                    f"commands on {command.name} have no stamp, so each counts as the answer to the newest state, and "
                    "a timer of the wall clock acts more often than it says; stamp them with the state, or give their "
                    "node use_sim_time and set command_period to its timer's period")
        return sentences

    def publishers(self, command: CommandedInput) -> str:
        """Return the publishers on the topic of an input as text: type, quality of service, why they do not match."""
        row, sentences = topic(command.name), []
        for info in self._node.get_publishers_info_by_topic(command.topic):
            profile = info.qos_profile
            best_effort = profile.reliability == ReliabilityPolicy.BEST_EFFORT
            wrong = (f", which is not {row.type}" if info.topic_type != row.type else
                     ", which does not match: publish reliably" if best_effort else "")
            kind = "" if info.topic_type == row.type else f"{info.topic_type}, "
            sentences.append(f"{info.node_name} ({kind}{profile.reliability.name.lower().replace('_', ' ')}, "
                             f"{profile.durability.name.lower().replace('_', ' ')}{wrong})")
        refused = f"; {counted(command.refused, 'command')} refused, the last: {command.refusal}" if (
            command.refused) else ""
        colon = ": " if sentences else ""
        return f"{counted(len(sentences), 'publisher')} on {command.topic}{colon}{', '.join(sentences)}{refused}"

    def _fallback(self, command: CommandedInput) -> str:
        if command.name == FAR_END:
            return "the shaft's far end stands still"
        return str(self._loop.scene.value(f"{topic(command.name).key.partition('.')[0]}.fallback"))


class Diagnostics:
    """Publisher of the node's state on /diagnostics once a second: rate, lateness, iterations, commands, regime.

    Counts are since the start. `clock` returns real time, s.

    Attributes
    ----------
    lateness : sentence on the ticks since the message before, if many were late; else empty
    """

    def __init__(self, node: Node, loop: RealTimeLoop, waiting: Waiting,
                 clock: Callable[[], float] = time.monotonic) -> None:
        self._node, self._loop, self.waiting, self._clock = node, loop, waiting, clock
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", DIAGNOSTICS)
        self._since = clock()
        self._due = self._since + DIAGNOSTICS_PERIOD
        self._counts: Counter[str] = Counter()
        self.lateness = ""

    def publish_when_due(self) -> None:
        """Publish if a second has passed; a message that the middleware refuses is dropped."""
        now = self._clock()
        if now < self._due:
            return
        self._due += DIAGNOSTICS_PERIOD * (math.floor((now - self._due) / DIAGNOSTICS_PERIOD) + 1)
        message = DiagnosticArray(status=[self._status(now)])
        message.header.stamp = self._node.get_clock().now().to_msg()
        with suppress(RuntimeError):
            self._publisher.publish(message)

    def _status(self, now: float) -> DiagnosticStatus:
        loop, pacer, operation = self._loop, self._loop.pacer, self._loop.scene.operation
        stepper = loop.plant.stepper
        counts = Counter(stick=loop.stick_ticks, slip=loop.slip_ticks, paced=pacer.ticks, late=pacer.late_ticks,
                         missed=pacer.missed_ticks, lost=sum(command.lost for command in loop.commands))
        new, self._counts = counts - self._counts, counts
        stick, slip = new["stick"], new["slip"]
        rate, self._since = (stick + slip) / (now - self._since), now
        still = "paused" if loop.paused else "waiting"
        regime = still if not stick + slip else "stick" if not slip else "slip" if not stick else "stick-slip"
        middle, high = np.percentile(pacer.latenesses(), (50, 99)) if pacer.ticks else (0.0, 0.0)
        share = new["late"] / new["paced"] if new["paced"] else 0.0
        self.lateness = "" if share <= LATE_SHARE else (
            f"{100.0 * share:.3g} % of the ticks were late by more than a period of {pacer.period_ns * 1e-6:.3g} ms; "
            f"since the start at most by {pacer.lateness_max:.3g} s")
        values = {
            "scene": loop.scene.name, "simulation time (s)": f"{stepper.tick * stepper.step:.3f}",
            "regime": regime,
            "rate (Hz)": f"{rate:.1f}", "rate wanted (Hz)": f"{operation.rate * (operation.real_time_factor or 1.0):g}",
            "real-time factor": f"{rate / operation.rate:.4f}",
            "missed ticks": str(pacer.missed_ticks), "late ticks": str(pacer.late_ticks),
            "paced ticks": str(pacer.ticks), "late share": f"{share:.4f}",
            "first late tick (s)": f"{loop.late[0]:.6f}" if loop.late else "",
            "last late tick (s)": f"{loop.late[-1]:.6f}" if loop.late else "",
            "messages not sent": str(sum(dict(loop.outputs.unsent).values())),
            "lateness p50 (s)": f"{middle:.6f}", "lateness p99 (s)": f"{high:.6f}",
            "lateness max (s)": f"{pacer.lateness_max:.6f}",
            "sub-steps per tick": str(stepper.substeps), "iterations max": str(stepper.iterations_most),
            "iterations bound": str(stepper.iterations_bound)}
        for command in loop.commands:
            values |= {f"{command.name} listeners": str(self._node.count_subscribers(command.name)),
                       f"{command.name} publishers": self.waiting.publishers(command),
                       f"{command.name} received": str(command.received),
                       f"{command.name} refused": str(command.refused),
                       f"{command.name} lost": str(command.lost),
                       f"{command.name} last refusal": command.refusal,
                       f"{command.name} time-outs": str(command.timeouts),
                       f"{command.name} source": "fallback" if command.value is None else "topic"}
        if INPUTS[1] in loop.inputs:
            commanded, applied = loop.plant.pressures
            values |= {"commanded pressure (Pa)": f"{commanded:.6g}", "applied pressure (Pa)": f"{applied:.6g}"}
        waiting = [c.name for c in loop.commands if c.value is None]
        wrong = []
        if new["lost"]:
            wrong.append(f"{counted(new['lost'], 'command')} lost or replaced before a tick could take them")
        if new["missed"]:
            wrong.append(f"{counted(new['missed'], 'tick')} missed in real time")
        if self.lateness:
            wrong.append(self.lateness)
        if waiting:
            wrong.append(f"no command on {' and '.join(waiting)}; the scene's fallback applies")
        return DiagnosticStatus(level=DiagnosticStatus.WARN if wrong else DiagnosticStatus.OK,
                                name=f"{self._node.get_fully_qualified_name()}: driveline",
                                hardware_id=loop.outputs.run, message="; ".join(wrong) or regime,
                                values=[KeyValue(key=k, value=v) for k, v in values.items()])


def spin(node: DrivelineNode) -> None:
    """Run callbacks and housekeeping until the context ends."""
    spinner = Spinner(node)
    with suppress(ExternalShutdownException):
        while True:
            spinner.once()
            node.housekeeping()


def main() -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node(DrivelineNode, _run)


def _run(node: DrivelineNode) -> int:
    sys.setswitchinterval(SWITCH_INTERVAL)
    node.loop.plant.warm_up()
    executables.end_in_order()
    node.start()
    gc.collect()
    gc.freeze()
    spin(node)
    node.loop.stop()
    if node.loop.outputs.patient:
        deliver(node, node.loop.outputs.flush)
    return 0
