"""Topics of the real-time loop: commands that are polled, checked and held, and states that are sent."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from operator import itemgetter
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from tcc_sim import topics
from tcc_sim.errors import InputError
from tcc_sim.messages import cdr, held
from tcc_sim.nodes import middleware
from tcc_sim.nodes.track import unsent_message
from tcc_sim.plant.driveline import Reading, check_command, doubt_of
from tcc_sim.plant.sensors import Sensors
from tcc_sim.scene import Operation, Scene

HISTORY = 0.25
"""Duration of the messages that a publisher stores for a slow reader in real time, s."""
GRACE = 0.01
"""Real time for which lock-step waits for the answer to a state after one to an older state of the same period, s."""
QUIET, LONGEST_QUIET = 0.3, 3.0
"""Real time without a message after which a node that joins lock-step has answered, and longest wait, s."""


class CommandedInput(middleware.SequenceNumbers):
    """One commanded input with zero-order hold: the newest valid command applies from the next tick on.

    Before the first command, and after command_timeout without one, the scene's fallback applies.

    `admit` raises InputError if a value within the range cannot be applied now.

    Attributes
    ----------
    value : the command in SI units; None if the fallback applies
    acts : first tick that the command acts on; NaN without
    refusal : reason of the last refusal
    since : first tick for whose state lock-step waits for an answer
    unstamped : number of commands without a stamp that lock-step took as answers
    timed : whether the publishers follow /clock, so that their timers decide when they send
    period_ns : time between two answers that lock-step waits for, ns
    """

    def __init__(self, node: Node, row: topics.Topic, admit: Callable[[float], None] = lambda _: None,
                 qos: QoSProfile = middleware.COMMANDS) -> None:
        super().__init__()
        self.name, self._admit = row.name, admit
        self.value: float | None = None
        self.received = self.superseded = self.refused = self.timeouts = 0
        self.acts, self._stamp_ns, self._fresh = math.nan, math.nan, False
        self._who = self._sender = 0
        self._publishers: dict[bytes, int] = {}
        self._counts_before = (0, 0, 0, 0)
        self.refusal = ""
        self._largest, self._first_tick = 0.0, 0
        self._last_tick = self.since = self.unstamped = self.period_ns = 0
        self.timed, self._early = False, (b"", math.inf)
        self._stamped = row.type == topics.FLUID_PRESSURE
        self.subscription: Any = middleware.subscribe(node, middleware.message_class(row.type), row.name, qos)
        self.topic: str = self.subscription.topic_name
        self._take = middleware.taker(self.subscription)

    def doubt(self, tick: int, after: float) -> str:
        """Return a sentence on a probable wrong unit if all commands in more than `after` ticks suggest it; else empty.
        """
        return doubt_of(self.name, self._largest) if self.received and tick - self._first_tick > after else ""

    def reset(self) -> None:
        """Return to the fallback, as before the first command of a run, whose counts begin."""
        self.value, self._last_tick, self.since = None, 0, 0
        self._fresh, self._counts_before = False, self._counts
        self._publishers.clear()

    def acted(self) -> None:
        """Note that a tick begins: the next command supersedes none."""
        self._fresh = False

    @property
    def _counts(self) -> tuple[int, int, int, int]:
        return self.received, self.superseded, self.refused, self.lost

    @property
    def events(self) -> int:
        """Number that grows with every event that `report` shows."""
        return self.received + self.refused + self.timeouts + self.lost

    def report(self, zero_ns: int) -> tuple[float, ...]:
        """Return the values of `messages.held.FIELDS`, without an actuator; `zero_ns` is the stamp of time 0."""
        counts = tuple(now - before for now, before in zip(self._counts, self._counts_before))
        if self.value is None:
            absent = held.FALLBACK if self.name in topics.INPUTS or counts[0] else held.NOBODY
            return absent, math.nan, math.nan, math.nan, math.nan, 0, *counts
        return held.COMMAND, self.value, self.value, self._stamp_ns - zero_ns, self.acts, self._who, *counts

    def poll(self, tick: int, timeout_ticks: float) -> None:
        """Take the messages that arrived before tick `tick`; the caller ensures that the subscription exists."""
        for data, info in islice(iter(self._take, None), middleware.COMMANDS.depth):  # No flood may hold a tick up.
            self._note_sender(info)
            self.accept(data, tick)
        if self.value is not None and tick - self._last_tick >= timeout_ticks:
            self.fall_back()

    def join(self, tick: int) -> None:
        """Join lock-step after the state of tick `tick` was published: take all answers to it and to earlier states, so
        that none counts as the answer to a later state.
        """
        began = last = time.monotonic()
        while time.monotonic() - last < QUIET and last - began < LONGEST_QUIET:
            before = self.received + self.refused
            self.poll(tick, math.inf)
            if self.received + self.refused > before:
                last = time.monotonic()
            time.sleep(0.01 * QUIET)
        self.since = tick + 1

    def answered(self, tick: int, stamp_ns: int) -> bool:
        """Return whether the command that answers the state of `stamp_ns` has arrived, for lock-step.

        A command with a stamp answers the state with that stamp; a command without a stamp answers the current state. A
        refused command is an answer too: the value before it holds. A timer on /clock may fire before the state of the
        same time arrives and answer an older state of the period: such a command counts if none follows within GRACE.
        """
        while taken := middleware.poll(self.subscription, most=1):
            self._note_sender(taken[0][1])
            if self.accept(taken[0][0], tick, stamp_ns):
                self._early = b"", math.inf
                return True
        data, arrived = self._early
        if time.monotonic() - arrived < GRACE or not data:
            return False
        self._early = b"", math.inf
        return self.accept(data, tick)

    def _note_sender(self, info: Mapping[str, Any]) -> None:
        publisher = self.count(info)
        self._sender = self._publishers.setdefault(publisher, len(self._publishers) + 1) if publisher else 0

    def fall_back(self) -> None:
        """Apply the fallback and count the time-out."""
        self.value = None
        self.timeouts += 1

    def accept(self, data: bytes, tick: int, answers: int | None = None) -> bool:
        """Hold the value of a serialised command from tick `tick` on, or count its refusal.

        Return False if its stamp differs from `answers`, ns, so that it answers another state.
        """
        try:
            stamp, value = cdr.read_fluid_pressure(data) if self._stamped else (0, cdr.read_float64(data))
        except ValueError as error:
            return self.refuse(f"{self.name}: {error}")
        if answers and stamp == 0:
            self.unstamped += 1
        elif answers is not None and self.timed and answers - self.period_ns < stamp < answers:
            self._early = data, time.monotonic()
            return False
        elif answers is not None and stamp != answers:
            self.refuse(f"{self.name} command with stamp {stamp * 1e-9:.9g} s refused; it must be that of the state, "
                         f"{answers * 1e-9:.9g} s")
            return False
        try:
            self.check(value)
        except InputError as error:
            return self.refuse(str(error))
        self.hold(value, tick, self._sender, stamp if stamp or (self._stamped and not tick) else math.nan)
        return True

    def check(self, value: float) -> None:
        """Raise InputError if a value must be refused."""
        check_command(self.name, value, self._admit)

    def hold(self, value: float, tick: int, sender: int = 0, stamp_ns: float = math.nan) -> None:
        """Hold a checked value from tick `tick` on; its sender is 0 and its stamp NaN where they are not known."""
        self._largest = max(self._largest, abs(value))
        self._first_tick = tick if not self.received else self._first_tick
        self.value, self._last_tick = value, tick
        self.received += 1
        self.superseded += self._fresh
        self._fresh, self.acts, self._who, self._stamp_ns = True, tick + 1, sender, stamp_ns

    def refuse(self, sentence: str) -> bool:
        """Count a refused command; the value before it holds."""
        self.refused += 1
        self.refusal = sentence
        return True


class JointCommands:
    """Commands of both inputs as efforts of joints, as ros2_control sends them, held as commands on their own topics.
    """

    def __init__(self, node: Node, inputs: Sequence[CommandedInput]) -> None:
        joints = dict(zip(topics.INPUTS, (topics.JOINT_NAMES[0], topics.CLUTCH_JOINT)))
        self._inputs = {joints[command.name]: command for command in inputs}
        self._kind = middleware.message_class(topics.JOINT_STATE)
        self.subscription: Any = middleware.subscribe(node, self._kind, topics.JOINT_COMMAND, middleware.COMMANDS)
        self._take = middleware.taker(self.subscription)

    def poll(self, tick: int, answers: int | None = None) -> list[CommandedInput]:
        """Hold the arrived commands from tick `tick` on, and return their inputs.

        In lock-step a command must have the stamp `answers` (ns) of the state that it answers, or stamp 0. A message
        that cannot be read, which may command any input, counts as refused for each and answers no state.
        """
        taken: list[CommandedInput] = []
        for data, _ in islice(iter(self._take, None), middleware.COMMANDS.depth):
            try:
                message = deserialize_message(data, self._kind)
            except Exception:  # rclpy raises various exceptions on invalid bytes.
                for one in self._inputs.values():
                    one.refuse(f"{topics.JOINT_COMMAND}: the message cannot be read")
                continue
            stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
            for joint, value in zip(message.name, message.effort):
                command = self._inputs.get(joint)
                if command is None or math.isnan(value):
                    continue
                if answers is not None and stamp not in (0, answers):
                    command.refuse(f"{topics.JOINT_COMMAND} for {joint} with stamp {stamp * 1e-9:.9g} s refused; it "
                                   f"must be that of the state, {answers * 1e-9:.9g} s")
                    continue
                taken.append(command)
                try:
                    command.check(value)
                except InputError as error:
                    command.refuse(str(error))
                else:
                    command.hold(value, tick, stamp_ns=float(stamp) if stamp else math.nan)
        return taken


def joining(node: Node, name: str) -> CommandedInput | None:
    """Return the input of a topic that has a publisher, else None; with the last target if all of its publishers are
    latched.
    """
    if not node.count_publishers(name):
        return None
    latched = name == topics.TARGET and all(one.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                                            for one in node.get_publishers_info_by_topic(name))
    return CommandedInput(node, topics.topic(name), qos=middleware.LATCHED if latched else middleware.COMMANDS)


class Outputs:
    """The publishers of one driveline; only those that the scene needs are created.

    In real time a message that the middleware refuses (at the moment when a flooded reader dies) is counted and
    dropped. If real time does not matter (`patient`: as fast as possible, or lock-step), refused messages are sent
    again in order, and the loop makes no tick before they are sent.

    Attributes
    ----------
    unsent : number of messages dropped since the start, by topic
    zero_ns : stamp of simulation time 0, ns: 0, or the wall clock's time at the first tick (`stamp: wall`)
    sensors : sensors that modify the published states; None without sensors
    run : name of the run
    """

    def __init__(self, node: Node, scene: Scene) -> None:
        operation = scene.operation
        self.patient = operation.real_time_factor == 0.0 or operation.pacing == "lockstep"
        self.unsent: Counter[str] = Counter()
        self.zero_ns, self._last_ns, self._wall = 0, 0, operation.stamp == "wall"
        self.sensors: Sensors | None = None
        self._runs = held.runs()
        self.run = next(self._runs)
        self._reported = 0
        self._node = node
        self._context = node.context
        self._waiting: deque[tuple[Any, bytes]] = deque()
        qos = middleware.states(0 if self.patient else max(10, math.ceil(HISTORY * operation.rate)))
        self._every_tick: list[tuple[str, Any, Callable[..., bytes], Callable[[Reading], Any]]] = []
        self._publishers: dict[str, Any] = {}
        self._states = qos
        for row in topics.TOPICS:
            if row.fields and row.name != topics.CLOCK_TOPIC and row.wanted(scene.value):
                self.add(row.name)
        self._publisher("scene", middleware.LATCHED)
        if topics.topic("held").wanted(scene.value):
            self.report_inputs()

    def begin_at_zero(self, again: bool) -> bool:
        """Let the next state be that of simulation time 0, of another run if `again`; return whether run or zero of the
        stamps are others than before.

        Stamps of the wall clock never decrease, also where simulation time ran ahead of it.
        """
        if again:
            self.run = next(self._runs)
        if self._wall:
            self.zero_ns = max(time.time_ns(), self._last_ns + 1)
        return self._wall or again

    def report_inputs(self) -> None:
        """Create the topic `held`, if it does not exist."""
        self._publisher("held", middleware.CHANGES)

    def add(self, name: str) -> bool:
        """Create the publisher of a topic with a message for every tick from now on; return False if it exists."""
        if name in self._publishers:
            return False
        row = topics.topic(name)
        values = itemgetter(*map(Reading._fields.index, ("stamp_ns", *row.fields)))
        self._every_tick.append((name, self._publisher(name, self._states), cdr.ENCODERS[name], values))
        return True

    def state(self, reading: Reading) -> None:
        """Send the messages of a tick."""
        if self.sensors is not None:
            reading = self.sensors.measure(reading)
        if self.zero_ns:
            self._last_ns = reading.stamp_ns + self.zero_ns
            reading = reading._replace(stamp_ns=self._last_ns)
        for name, publisher, encode, values in self._every_tick:
            if self.sensors is None or name.removesuffix("_stamped") not in self.sensors.lost:
                self._send(publisher, encode(*values(reading), frame=self.run))

    def say(self, name: str, data: bytes) -> None:
        """Send a message on one topic, in the order of the states, if the scene has the topic."""
        if name in self._publishers:
            self._send(self._publishers[name], data)

    def flush(self) -> bool:
        """Send waiting messages; return False if the middleware does not take all of them yet."""
        while self._waiting:
            if not self._taken(*self._waiting[0]):
                return False
            self._waiting.popleft()
        return True

    def tell_unsent(self) -> None:
        """Publish the number of dropped messages if it has grown; not for the loop's thread."""
        counts = dict(self.unsent)
        total = sum(counts.values())
        if total <= self._reported:
            return
        message = unsent_message(self._node.get_fully_qualified_name(), counts)
        if self._taken(self._publisher("unsent_messages", middleware.LATCHED), message):
            self._reported = total

    def subscriptions(self) -> tuple[int, int]:
        """Return the numbers of subscriptions of joint_states and of all topics with a message for every tick."""
        return (int(self._publishers["joint_states"].get_subscription_count()),
                sum(publisher.get_subscription_count() for _, publisher, *_ in self._every_tick))

    def meet(self, name: str) -> None:
        """Wait until the known subscribers of a new topic are connected, so that they receive its first message."""
        known = self._node.count_subscribers(name)
        middleware.wait_until(lambda: self._publishers[name].get_subscription_count() >= known)

    def handles(self) -> list[Any]:
        """Return the publishers' handles, which a publishing thread holds so that no publisher is destroyed in use."""
        return [publisher.handle for publisher in self._publishers.values()]

    def _publisher(self, name: str, profile: QoSProfile) -> Any:
        """Return the publisher of a topic, after creating it the first time; it sends bytes without checks."""
        if name not in self._publishers:
            kind = middleware.message_class(topics.topic(name).type)
            publisher: Any = self._node.create_publisher(kind, name, profile)
            publisher.publish = publisher.handle.publish_raw
            self._publishers[name] = publisher
        return self._publishers[name]

    def _send(self, publisher: Any, data: bytes) -> None:
        """Send a message, or queue it (`patient`), or count it as dropped."""
        if self._waiting or not self._taken(publisher, data):
            if self.patient:
                self._waiting.append((publisher, data))
            else:
                self.unsent[publisher.topic_name] += 1

    def _taken(self, publisher: Any, data: bytes) -> bool:
        try:
            publisher.publish(data)
        except RuntimeError:
            if not self._context.ok():
                raise
            return False
        return True


class SimulationClock:
    """Publisher of /clock, active with `publish_clock`, and in lock-step if a node with use_sim_time subscribes.

    It stays inactive if another node publishes /clock.

    Attributes
    ----------
    published : whether the driveline publishes /clock
    """

    def __init__(self, node: Node, outputs: Outputs, operation: Operation) -> None:
        self._node, self._outputs = node, outputs
        self._wanted, self._lockstep = operation.publish_clock, operation.pacing == "lockstep"
        self._topic = node.resolve_topic_name(topics.CLOCK_TOPIC)
        self.published = False

    @property
    def followers(self) -> list[str]:
        """Names of the other nodes with use_sim_time, for which rclpy and rclcpp subscribe with best effort; others,
        such as a recorder, subscribe reliably.
        """
        me = self._node.get_fully_qualified_name()
        listeners = self._node.get_subscriptions_info_by_topic(self._topic)
        return [name for name in middleware.nodes_of(
            one for one in listeners if one.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT) if name != me]

    def note_timed(self, commands: Iterable[CommandedInput]) -> None:
        """Note for each input whether all of its publishers follow /clock."""
        followers = set(self.followers)
        for command in commands:
            names = set(middleware.nodes_of(self._node.get_publishers_info_by_topic(command.topic)))
            command.timed = bool(names) and names <= followers

    @property
    def rivals(self) -> list[str]:
        """Names of the other nodes that publish /clock."""
        names = middleware.nodes_of(self._node.get_publishers_info_by_topic(self._topic))
        me = self._node.get_fully_qualified_name()
        if self.published and me in names:
            names.remove(me)
        return names

    @property
    def due(self) -> bool:
        """Whether the driveline should publish /clock and does not yet."""
        return not self.published and (self._wanted or (self._lockstep and bool(self.followers))) and not self.rivals

    def begin(self, stamp_ns: int | None = None) -> None:
        """Publish /clock from the next state on, and `stamp_ns`, the simulation time of the last state, if given.

        Known subscribers are connected first, except by a driveline that runs in real time.
        """
        self._outputs.add(topics.CLOCK_TOPIC)
        self.published = True
        if self._lockstep or stamp_ns is None:
            self._outputs.meet(topics.CLOCK_TOPIC)
        if stamp_ns is not None:
            self._outputs.say(topics.CLOCK_TOPIC, cdr.clock(stamp_ns + self._outputs.zero_ns))

    def sentence(self) -> str:
        """Return a warning about the clock; empty without a problem."""
        rivals = ", ".join(self.rivals)
        if rivals and self.published:
            return f"{self._topic} is published by {rivals} too, and simulation time jumps: end one of them"
        if rivals and self._wanted:
            return f"{self._topic} is published by {rivals} already, so this node does not publish it"
        followers = ", ".join(self.followers)
        if followers and not rivals and not self.published and not self._lockstep:
            return f"{followers} with use_sim_time waits for {self._topic}, which nobody publishes: set publish_clock"
        return ""
