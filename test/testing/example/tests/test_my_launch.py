import time
import unittest

import pytest

pytest.importorskip("launch_testing", reason="launch_testing comes with an installed ROS 2")

import launch_testing
import launch_testing.actions
import rclpy
from launch import LaunchDescription
from launch_ros.actions import Node
from sensor_msgs.msg import JointState


@pytest.mark.launch_test
def generate_test_description():
    return LaunchDescription([
        Node(package="tcc_sim", executable="driveline_node", parameters=[{
            "scene": "controlled", "pacing": "lockstep", "command_period": 0.005, "wait_for_subscribers": 2}]),
        Node(package="my_clutch", executable="timed_controller", parameters=[{"use_sim_time": True}]),
        launch_testing.actions.ReadyToTest(),
    ])


class TestWhileRunning(unittest.TestCase):
    def test_it_holds_its_target(self):
        slip = []
        with rclpy.init():
            node = rclpy.create_node("listener")
            node.create_subscription(
                JointState, "joint_states", lambda state: slip.append(state.velocity[0] - state.velocity[1]), 5000)
            end = time.monotonic() + 120.0
            while len(slip) < 2400 and time.monotonic() < end:
                rclpy.spin_once(node, timeout_sec=1.0)
        assert abs(sum(slip[1400:2400]) / 1000 - 20.0) < 0.5


@launch_testing.post_shutdown_test()
class TestAfterwards(unittest.TestCase):
    def test_every_process_ends_with_status_0(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
