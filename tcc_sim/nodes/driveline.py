"""The driveline node: parameters, services and diagnostics around the real-time loop.

`ros2 run tcc_sim driveline_node`, or `python -m tcc_sim.nodes.driveline`.
"""

from __future__ import annotations

import gc
import sys
import time
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from tcc_sim.errors import InputError
from tcc_sim.messages import cdr
from tcc_sim.nodes import parameters
from tcc_sim.nodes.diagnostics import Diagnostics
from tcc_sim.nodes.loop import RealTimeLoop
from tcc_sim.nodes.polling import LATCHED, hold_signals, release_signals, run
from tcc_sim.nodes.processes import CLOCK_STARTED
from tcc_sim.recording.scene_records import holding_from
from tcc_sim.scene import Scene

SWITCH_INTERVAL = 1e-4
"""How long, s, another thread may hold the interpreter before the real-time loop asks for it."""
HOUSEKEEPING = 0.1
"""Longest time, s, between two looks at refusals and failures."""


class DrivelineNode(Node):
    """The driveline as a ROS 2 node. Physics and topics run in `loop`; this class is what happens beside them."""

    def __init__(self, **options: Any) -> None:
        super().__init__("driveline", automatically_declare_parameters_from_overrides=True, **options)
        self.scene = parameters.declare(self)
        self.loop = RealTimeLoop(self, self.scene)
        self._scene_publisher = self.create_publisher(String, "scene", LATCHED)
        self._scene_text, self._changed = self.scene.text(), False
        self._scene_publisher.publish(cdr.string(self._scene_text))
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.add_post_set_parameters_callback(self._after_set_parameters)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/step", self._on_step)
        self.diagnostics = Diagnostics(self, self.loop) if self.scene.operation.publish_diagnostics else None
        self._announced = False
        self._warned: dict[str, tuple[int, float]] = {}

    def start(self) -> None:
        """Warm up, then start the clock."""
        self.loop.start()
        self.get_logger().info(
            f"scene {self.scene.name}, {self.scene.operation.rate:g} Hz, {self.loop.stepper.substeps} sub-steps a tick")

    def housekeeping(self) -> None:
        """Diagnostics when they are due, throttled warnings, and the failure of the loop if there was one."""
        if self.diagnostics is not None:
            self.diagnostics.publish_when_due()
        now = time.monotonic()
        if self.loop.clock_started.is_set() and not self._announced and self.context.ok():
            self._announced = True
            self.get_logger().info(CLOCK_STARTED)
        for command in self.loop.commands:
            count, when = self._warned.get(command.name, (0, -1.0))
            if command.refused > count and now - when >= 1.0:
                self._warned[command.name] = (command.refused, now)
                self.get_logger().warning(f"{command.refusal} ({command.refused} refused so far)")
        if self.loop.failure is not None:
            raise self.loop.failure

    def destroy_node(self) -> None:
        """Stop the loop, then destroy everything."""
        loop: RealTimeLoop | None = getattr(self, "loop", None)
        if loop is not None:
            loop.stop()
        super().destroy_node()

    def _on_set_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Check all changes of a request together and apply them at a tick boundary."""
        try:
            parameters.check_text(changes, self.scene)
            after = parameters.changed(self.scene, changes)
            self.loop.check(after)
        except InputError as error:
            return parameters.refused(error)
        text = after.text()
        if after != self.scene and not self.loop.request(lambda: self._take(after, text)):
            return parameters.refused(InputError("the real-time loop did not take the change within 1 s"))
        return parameters.accepted()

    def _after_set_parameters(self, changes: list[Parameter]) -> None:
        """Let scene_text follow what was changed."""
        text = self.scene.text()
        if text != self.get_parameter(parameters.TEXT).value:
            self.set_parameters([Parameter(parameters.TEXT, value=text)])

    def _take(self, scene: Scene, text: str) -> bool:
        """In the loop, between two ticks: run `scene` from the next tick on, and say so before that tick's state.

        States and scenes are sent by one thread, so a recording has them in the order in which they came into force.
        """
        self.loop.use(scene)
        self.scene, self._scene_text, self._changed = scene, text, True
        self._say(self.loop.next_stamp_ns)
        return True

    def _restart(self) -> bool:
        """In the loop: start again with the parameters as they are, which hold from stamp 0 of the new run on."""
        if self._changed:
            self._say(0)
        return self.loop.reset()

    def _say(self, stamp_ns: int) -> None:
        """Say the scene as it was changed, and the stamp of the first state that it leads to."""
        self.loop.send(self._scene_publisher, cdr.string(holding_from(self._scene_text, stamp_ns, self.loop.general)))

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """~/reset."""
        response.success = self.loop.request(self._restart)
        response.message = "at the initial state, simulation time 0" if response.success else "the real-time loop did not answer"
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """~/pause."""
        response.success = self.loop.request(lambda: self.loop.pause(request.data))
        response.message = "paused" if self.loop.paused else "running"
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """~/step."""
        response.success = self.loop.request(self.loop.single_step)
        response.message = f"at tick {self.loop.stepper.tick}" if response.success else "not paused"
        return response


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run("driveline_node", _spin, args)


def _spin() -> int:
    """Build the node and run it until the context ends."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    hold_signals()
    node = DrivelineNode()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        release_signals()
        node.start()
        gc.collect()
        gc.freeze()
        while rclpy.ok():
            executor.spin_once(timeout_sec=HOUSEKEEPING)
            node.housekeeping()
    except RuntimeError:
        # Publishing fails in the moment between a signal and the end of the loop.
        if rclpy.ok():
            raise
    finally:
        node.destroy_node()
    return 0


if __name__ == "__main__":
    sys.exit(main())
