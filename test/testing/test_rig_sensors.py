"""Sensors in the kit: node and law receive the same values to the last bit, and lost messages have no answer."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64

import tcc_sim
from tcc_sim.errors import InputError
from tcc_sim.plant.driveline import Reading

SENSORS = {"flywheel_speed": {"noise": 0.5, "quantum": 0.125, "seed": 4}, "plate_speed": {"offset": 0.2},
           "joint_states": {"delay_ticks": 5, "drop": 7, "seed": 2}}


class FromStates(Node):
    """Answers every joint state, from its two speeds."""

    def __init__(self) -> None:
        super().__init__("from_states")
        self.publisher = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(JointState, "joint_states", self.on_state, 10)

    def on_state(self, state: JointState) -> None:
        command = FluidPressure(fluid_pressure=pressure_of(state.velocity[0] - state.velocity[1]))
        command.header.stamp = state.header.stamp
        self.publisher.publish(command)


class FromSlip(Node):
    """Answers every slip speed."""

    def __init__(self) -> None:
        super().__init__("from_slip")
        self.publisher = self.create_publisher(FluidPressure, "actuation_pressure", 10)
        self.create_subscription(
            Float64, "slip_speed",
            lambda slip: self.publisher.publish(FluidPressure(fluid_pressure=pressure_of(slip.data))), 10)


def pressure_of(slip: float) -> float:
    return min(max(9e4 + 800.0 * (slip - 20.0), 0.0), 4e5)


def test_a_node_and_its_law_with_the_same_sensors_give_the_same_bits(driveline: Any) -> None:
    plant = driveline("controlled")
    plant.add(FromStates())
    for name, options in SENSORS.items():
        plant.sensor(name, **options)
    run = plant.run(seconds=0.3)

    def law(reading: Reading) -> float:
        return pressure_of(reading.flywheel_speed - reading.plate_speed)

    alone = tcc_sim.closed_loop("controlled", law, 0.3, sensors=SENSORS)
    assert run.slip_speed.tobytes() == alone.slip_speed.tobytes()
    assert run.commands["actuation_pressure"].tobytes() == alone.commands["actuation_pressure"].tobytes()
    assert run.slip_speed.tobytes() != tcc_sim.closed_loop("controlled", law, 0.3).slip_speed.tobytes()
    assert run.missed == 0


def test_the_slip_speed_has_a_sensor_that_may_be_changed_between_runs(driveline: Any) -> None:
    plant = driveline("controlled")
    plant.add(FromSlip())
    plant.sensor("slip_speed", offset=10.0, drop=4)
    first = plant.run(ticks=40)
    plant.sensor("slip_speed", offset=-10.0)
    second = plant.run(ticks=40)
    held = first.commands["actuation_pressure"]
    true = [pressure_of(slip + 10.0) for slip in first.slip_speed]
    missing = [tick for tick in range(40) if held[tick + 1] != true[tick]]
    assert [tick // 4 for tick in missing] == list(range(10))
    # The state between the runs was sent before the sensor was changed.
    assert second.commands["actuation_pressure"][2:].tolist() == [
        pressure_of(slip - 10.0) for slip in second.slip_speed[1:-1]]


def test_a_wrong_sensor_is_refused(driveline: Any) -> None:
    with pytest.raises(InputError, match="slip has no sensor; sensors are of slip_speed, "):
        driveline("controlled").sensor("slip", noise=1.0)
