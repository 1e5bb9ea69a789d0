"""Start a simulated module: `ros2 launch sma_sim module.launch.py [params_file:=FILE] [namespace:=NAME] [record:=BAG]`."""

import sys
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def start(context):
    """The node with its parameter file and, after it so that it wins, the bag."""
    file = LaunchConfiguration('params_file').perform(context)
    record = LaunchConfiguration('record').perform(context).replace("'", "''")
    if not Path(file).is_file():  # launch itself would only warn, and the node run with its defaults
        raise RuntimeError(f'params_file: there is no file {file}')
    node = Node(
        executable=sys.executable,  # pip puts no scripts where ROS looks for them; this finds the node of any install
        arguments=['-m', 'sma_sim.ros.main'],
        exec_name='sma_module_sim',
        namespace=LaunchConfiguration('namespace'),
        ros_arguments=['--params-file', file, *(['-p', f"node.record:='{record}'"] if record else [])],
        output='screen',
    )
    return [node]


def generate_launch_description():
    """Arguments and the node."""
    default = get_package_share_directory('sma_sim') + '/config/module.yaml'
    return LaunchDescription(
        [
            DeclareLaunchArgument('params_file', default_value=default, description='ROS 2 parameter file'),
            DeclareLaunchArgument('namespace', default_value='', description='namespace of the topics'),
            DeclareLaunchArgument('record', default_value='', description='bag that the node writes; empty: none'),
            OpaqueFunction(function=start),
        ]
    )
