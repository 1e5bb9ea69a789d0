"""A simulated module: `ros2 launch sma_sim module.launch.py [model:=mas] [namespace:=NAME] ...` (--show-args lists all)."""

from launch.actions import OpaqueFunction

from launch import LaunchDescription
from sma_sim.ros.launching import declared, module_actions, module_arguments, refuse_unknown, rviz_actions


def start(context):
    """All that was asked for; nothing runs before every argument was checked."""
    refuse_unknown(__file__)
    given = module_arguments(context)
    return [*module_actions(given), *rviz_actions(given)]


def generate_launch_description():
    return LaunchDescription([*declared(), OpaqueFunction(function=start)])
