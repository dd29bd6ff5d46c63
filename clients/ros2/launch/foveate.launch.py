"""ros2 launch foveate_ros foveate.launch.py image:=/camera/image_raw camera_info:=/camera/camera_info profile:=fast"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

TOPICS = {"image": "/camera/image_raw", "camera_info": "/camera/camera_info"}


def generate_launch_description() -> LaunchDescription:
    arguments = {**TOPICS, "profile": "balanced"}
    declared = [DeclareLaunchArgument(name, default_value=default) for name, default in arguments.items()]
    node = Node(
        package="foveate_ros",
        executable="foveate_node",
        parameters=[{"profile": LaunchConfiguration("profile")}],
        remappings=[(name, LaunchConfiguration(name)) for name in TOPICS],
    )
    return LaunchDescription([*declared, node])
