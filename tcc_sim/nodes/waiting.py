"""Warnings for a driveline's log and diagnostics: missing commands, unsuitable or several publishers, missing
subscribers.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy

from tcc_sim.errors import counted
from tcc_sim.nodes.loop import RealTimeLoop
from tcc_sim.nodes.loop_topics import CommandedInput
from tcc_sim.topics import topic

PATIENCE = 1.0
"""Real time after which a fallback or a wait causes a warning, s."""


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
            missing = {command.name: f"no command on {self._topic(command)}, the fallback applies "
                       f"({self._fallback(command)}); {self.publishers(command)}"
                       for command in loop.commands if command.fallen_back}
        if loop.clock_started.is_set() and (clock := loop.clock.sentence()):
            missing["/clock"] = clock
        now = self._clock()
        slow = {command.name for command in loop.waits_for if not command.fallen_back}
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
        followers = set(loop.clock.followers)
        for command in loop.commands:
            senders = self._node.get_publishers_info_by_topic(self._topic(command))
            names = {f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in senders}
            command.timed = bool(names) and names <= followers
            if command.unstamped and not command.timed and command is not loop.far_end:
                sentences[command.name] = (
                    f"commands on {command.name} have no stamp, so each counts as the answer to the newest state, and "
                    "a timer of the wall clock acts more often than it says; stamp them with the state, or give their "
                    "node use_sim_time and set command_period to its timer's period")
        return sentences

    def publishers(self, command: CommandedInput) -> str:
        """Return the publishers on the topic of an input as text: type, quality of service, why they do not match."""
        row, name = topic(command.name), self._topic(command)
        sentences = []
        for info in self._node.get_publishers_info_by_topic(name):
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
        return f"{counted(len(sentences), 'publisher')} on {name}{colon}{', '.join(sentences)}{refused}"

    def _topic(self, command: CommandedInput) -> str:
        name: str = command.subscription.topic_name
        return name

    def _fallback(self, command: CommandedInput) -> str:
        if command is self._loop.far_end:
            return "the shaft's far end stands still"
        return str(self._loop.scene.value(f"{topic(command.name).key.partition('.')[0]}.fallback"))
