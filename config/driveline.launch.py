"""Start the driveline, and if asked a recorder and the slip controller: `ros2 launch tcc_sim driveline.launch.py -s`
lists the arguments.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "scene": ("commands", "name of a bundled scene, or a scene file"),
    "record": ("", "directory that the recorder creates; empty: no recorder"),
    "controller": ("false", "true starts the slip controller; its parameters are its defaults"),
    "use_sim_time": ("false", "true makes the driveline publish /clock, for nodes with use_sim_time"),
    "namespace": ("", "namespace of all nodes"),
}
"""Default and description of every launch argument."""


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes that the launch arguments ask for; the driveline waits for the others."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    switches = {name: given[name].lower() in ("true", "1", "yes") for name in ("controller", "use_sim_time")}
    others = [("recorder_node", "recorder", {"output": given["record"]})] if given["record"] else []
    if switches["controller"]:
        others.append(("slip_controller_node", "slip_controller", {}))
    driveline = {"scene": given["scene"], "wait_for_subscribers": len(others),
                 "publish_clock": switches["use_sim_time"]}
    return [Node(package="tcc_sim", executable=executable, name=name, namespace=given["namespace"], output="screen",
                 parameters=[parameters])
            for executable, name, parameters in [*others, ("driveline_node", "driveline", driveline)]]


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the nodes."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
