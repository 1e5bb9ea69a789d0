"""Start a simulated module: `ros2 launch sma_sim module.launch.py [params_file:=FILE] [namespace:=NAME] [record:=BAG]`."""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def start(context):
    """The node with its parameter file; the bag as an argument, so that the file stays the last one given."""
    record = LaunchConfiguration('record').perform(context)
    node = Node(
        package='sma_sim',
        executable='sma_module_sim',
        namespace=LaunchConfiguration('namespace'),
        parameters=[LaunchConfiguration('params_file')],
        ros_arguments=['-p', f'node.record:={record}'] if record else [],
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
