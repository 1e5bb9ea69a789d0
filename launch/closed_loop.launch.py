"""Start a module, a controller of its angle and, with record:=BAG, the recorder of the node.

ros2 launch sma_sim closed_loop.launch.py [alpha_target:=0.05] [record:=BAG] [params_file:=FILE] [namespace:=NAME]
"""

import sys

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def generate_launch_description():
    """The module's launch file (its arguments are ours too) and the controller; all stop when one does."""
    share = get_package_share_directory('sma_sim')
    target = ParameterValue(LaunchConfiguration('alpha_target'), value_type=float)
    return LaunchDescription(
        [
            DeclareLaunchArgument('alpha_target', default_value='0.0', description='wanted angle [rad]'),
            IncludeLaunchDescription(share + '/launch/module.launch.py'),
            Node(
                executable=share + '/examples/controller.py',
                prefix=f'"{sys.executable}"',
                name='alpha_controller',
                exec_name='alpha_controller',
                namespace=LaunchConfiguration('namespace'),
                parameters=[{'alpha_target': target}],
                output='screen',
            ),
            RegisterEventHandler(OnProcessExit(on_exit=[Shutdown(reason='a part of the loop has ended')])),
        ]
    )
