"""A module and a controller of its angle.

ros2 launch sma_sim closed_loop.launch.py alpha_target:=0.05
ros2 launch sma_sim closed_loop.launch.py demo:=true rviz:=true     # moves by itself
"""

from launch.actions import OpaqueFunction

from launch import LaunchDescription
from sma_sim.ros.launching import declared, module_actions, module_arguments, refuse_unknown, rviz_actions, share


def start(context):
    """All that was asked for; nothing runs before every argument was checked."""
    refuse_unknown(__file__)
    given = module_arguments(context)
    return [*module_actions(given), *rviz_actions(given)]


def generate_launch_description():
    return LaunchDescription(
        [
            *declared(
                controller=(
                    share('examples', 'controller.py'),
                    'Python file of a controller node, or controller or trajectory_follower of the examples',
                )
            ),
            OpaqueFunction(function=start),
        ]
    )
