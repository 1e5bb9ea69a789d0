"""Start a simulated module: `ros2 launch sma_sim module.launch.py [params_file:=FILE] [namespace:=NAME]`."""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description():
    """The node with its parameter file."""
    default = get_package_share_directory('sma_sim') + '/config/module.yaml'
    return LaunchDescription(
        [
            DeclareLaunchArgument('params_file', default_value=default, description='ROS 2 parameter file'),
            DeclareLaunchArgument('namespace', default_value='', description='namespace of the topics'),
            Node(
                package='sma_sim',
                executable='sma_module_sim',
                namespace=LaunchConfiguration('namespace'),
                parameters=[LaunchConfiguration('params_file')],
                output='screen',
            ),
        ]
    )
