"""Execute the callbacks of the nodes under test one by one; a failure of a node fails the test with one sentence."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import ROSClock
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.node import Node
from rclpy.timer import Timer

from tcc_sim.errors import InputError
from tcc_sim.testing.run import ControllerFailed

MOST_CALLBACKS = 1000
"""Largest number of callbacks executed when no answer is awaited; a node may produce them without end."""


class UnderTest:
    """The nodes that a test has added.

    Parameters
    ----------
    context : ROS 2 context of the driveline
    now : function that returns the simulation time as text
    beat : function called before and after every callback
    collect : function that takes the commands that have arrived, and returns the topics of those

    Attributes
    ----------
    nodes : node -> its name, stored because a destroyed node has none
    """

    def __init__(self, context: Context, now: Callable[[], str], beat: Callable[[], None],
                 collect: Callable[[], list[str]]) -> None:
        self.nodes: dict[Node, str] = {}
        self._context, self._now, self._beat, self._collect = context, now, beat, collect
        self._executor = SingleThreadedExecutor(context=context)

    @property
    def names(self) -> str:
        """Names of the nodes, as text."""
        return " or ".join(self.nodes.values()) or "no node"

    @property
    def timed(self) -> set[str]:
        """Names of the nodes that follow /clock: their timers decide when they send."""
        return {name for node, name in self.nodes.items() if node.get_parameter("use_sim_time").value}

    def add(self, node: Node) -> None:
        """Add a node.

        Raises InputError: the node has another ROS 2 context and would not receive the driveline's messages.
        """
        if node.context is not self._context:
            raise InputError(f"{node.get_name()} has another ROS 2 context; create it with the default context")
        self._executor.add_node(node)
        self.nodes[node] = node.get_name()

    def spin(self, seconds: float) -> bool:
        """Execute one callback that is ready within `seconds`; return whether there was one.

        Raises ControllerFailed: the callback raised, shut ROS 2 down, or destroyed its node; or it is that of a timer
        of the wall clock and sent a command.
        """
        try:
            callback, entity, owner = self._executor.wait_for_ready_callbacks(timeout_sec=seconds)
        except TimeoutException:
            return False
        except ShutdownException:
            raise ControllerFailed(f"{self.names} shut ROS 2 down at {self._now()}") from None
        self._beat()
        if on_wall_clock := _on_wall_clock(entity):
            self._collect()
        try:
            callback()
        except SystemExit as error:
            raise ControllerFailed(f"{self.names} called sys.exit({error.code!r}) at {self._now()}") from _cut(error)
        self._beat()
        failure = callback.exception()
        self._check_alive()
        if failure is not None:
            raise ControllerFailed(f"{self.names} died at {self._now()}: {type(failure).__name__}: "
                                   f"{failure}") from _cut(failure)
        if on_wall_clock and (sent := self._collect()):
            name, period = self.nodes.get(owner, self.names), entity.timer_period_ns * 1e-9
            raise ControllerFailed(f"{name} sends {' and '.join(sent)} from a timer of the wall clock ({period:g} s), "
                                   "which answers no state: give the node use_sim_time, which puts its timers on "
                                   "/clock, or send from its subscription")
        return True

    def settle(self) -> None:
        """Execute callbacks until none is ready."""
        idle, most = 0, len(self.timed)
        for _ in range(MOST_CALLBACKS):
            # A message on /clock makes timers ready only at the next call.
            idle = 0 if self.spin(0.0) else idle + 1
            if idle > most:
                break

    def shutdown(self) -> None:
        """Shut the executor down; the nodes' owner destroys them."""
        self._executor.shutdown()

    def _check_alive(self) -> None:
        if not self._context.ok():
            raise ControllerFailed(f"{self.names} shut ROS 2 down at {self._now()}")
        for node, name in self.nodes.items():
            try:
                with node.handle:
                    pass
            except InvalidHandle:
                raise ControllerFailed(f"{name} destroyed itself at {self._now()}") from None


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
