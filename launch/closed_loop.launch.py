"""Start a module, a controller of its angle and, with record:=BAG, the recorder of the node.

ros2 launch sma_sim closed_loop.launch.py [alpha_target:=0.05] [record:=BAG] [params_file:=FILE] [namespace:=NAME]
"""

import sys

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

SHARE = get_package_share_directory('sma_sim')
MODULE, CONTROLLER = SHARE + '/launch/module.launch.py', SHARE + '/examples/controller.py'
PARAMETERS = SHARE + '/config/module.yaml'


def start(context):
    """The module, then the example as it was installed, by the Python that runs this."""
    text = LaunchConfiguration('alpha_target').perform(context)
    try:
        target = float(text)
    except ValueError as error:  # said before anything runs: launch leaves behind what it has started
        raise RuntimeError(f'alpha_target:={text}: expected an angle in rad, such as 0.05') from error
    controller = Node(
        executable=sys.executable,
        arguments=[CONTROLLER],
        name='alpha_controller',
        exec_name='alpha_controller',
        namespace=LaunchConfiguration('namespace'),
        parameters=[{'alpha_target': target}],
        output='screen',
    )
    return [IncludeLaunchDescription(MODULE), controller]


def generate_launch_description():
    """All stop when one does. The other arguments are those of module.launch.py, said here for --show-args."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('alpha_target', default_value='0.0', description='wanted angle [rad]'),
            DeclareLaunchArgument('params_file', default_value=PARAMETERS, description='ROS 2 parameter file'),
            DeclareLaunchArgument('namespace', default_value='', description='namespace of the topics'),
            DeclareLaunchArgument('record', default_value='', description='bag that the node writes; empty: none'),
            RegisterEventHandler(OnProcessExit(on_exit=[Shutdown(reason='a part of the loop has ended')])),
            OpaqueFunction(function=start),
        ]
    )
