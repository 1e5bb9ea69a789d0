"""Two simulated modules, in the namespaces left and right: `ros2 launch sma_sim two_modules.launch.py`."""

from launch.actions import OpaqueFunction

from launch import LaunchDescription
from sma_sim.ros.launching import declared, module_arguments, refuse_unknown, two_modules


def start(context):
    """All that was asked for; nothing runs before every argument was checked."""
    refuse_unknown(__file__)
    given = module_arguments(context)
    return two_modules(given)


def generate_launch_description():
    return LaunchDescription([*declared(), OpaqueFunction(function=start)])
