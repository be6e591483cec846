"""Node that sends harmonic engine torque and pressure commands at a fixed rate, as a load.

`python -m tcc_sim.nodes.commander --ros-args -p rate:=1000.0`; the commands are those of the scene fig02.
"""

from __future__ import annotations

if __name__ == "__main__":
    from tcc_sim.nodes.executables import commander

    raise SystemExit(commander())

import math

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Float64

from tcc_sim.messages import cdr
from tcc_sim.nodes import signals
from tcc_sim.nodes.children import SENDING
from tcc_sim.nodes.middleware import COMMANDS, await_peer
from tcc_sim.nodes.options import CommanderOptions
from tcc_sim.nodes.pacing import Pacer
from tcc_sim.nodes.parameters import declared
from tcc_sim.nodes.process import log, run_node
from tcc_sim.scene import load_scene

MET_WITHIN = 10.0
"""Longest real time to connect to a driveline before the first command, s; Fast DDS may take 3 s."""


def main(args: list[str] | None = None) -> int:
    """Send commands until SIGINT or SIGTERM."""
    return run_node("commander", lambda: rclpy.create_node("commander"), send, args)


def send(node: Node) -> int:
    """Send the commands of fig02, one of each input per period."""
    rate = declared(node, CommanderOptions).rate
    system = load_scene("fig02").system
    engine, pressure = system.engine, system.pressure
    torques = node.create_publisher(Float64, "engine_torque", COMMANDS)
    pressures = node.create_publisher(FluidPressure, "actuation_pressure", COMMANDS)
    await_peer(lambda: torques.get_subscription_count() and pressures.get_subscription_count(), MET_WITHIN)
    signals.end_in_order()
    log(node, SENDING)
    pacer = Pacer(1.0 / rate)
    tick = 0
    while pacer.wait(signals.end_requested.is_set):
        t = tick / rate
        torques.publish(cdr.float64(engine.mean_torque + engine.torque_amplitude * math.sin(engine.frequency * t)))
        swing = math.sin(pressure.frequency_ratio * engine.frequency * t + pressure.phase)
        pressures.publish(cdr.fluid_pressure(0, pressure.mean + pressure.amplitude * swing))
        tick += 1
    return 0
