"""Nodes of a launch file: one in a namespace with a remapped topic, with Bagpipe's parameters."""

from launch import LaunchDescription
from launch.substitutions import EnvironmentVariable
from launch_ros.actions import ComposableNodeContainer, Node
from launch_ros.descriptions import ComposableNode


def component(kind, name, remappings):
    """A node of the container, which hands messages over within its process where it can."""
    return ComposableNode(
        package="bagpipe_nodes",
        plugin=f"bagpipe_nodes::{kind}",
        name=name,
        remappings=remappings,
        extra_arguments=[{"use_intra_process_comms": True}],
    )


def generate_launch_description():
    answering = Node(
        package="bagpipe_nodes",
        executable="node",
        arguments=["single", "Answering"],
        namespace="front",
        remappings=[("in", "/in"), ("out", "answers")],
        parameters=[EnvironmentVariable("BAGPIPE_PARAMETERS")],
    )
    container = ComposableNodeContainer(
        package="rclcpp_components",
        executable="component_container",
        name="container",
        namespace="",
        composable_node_descriptions=[
            component("Passing", "first", [("in", "/front/answers"), ("out", "/mid")]),
            component("Passing", "second", [("in", "/mid"), ("out", "/out")]),
        ],
    )
    return LaunchDescription([answering, container])
