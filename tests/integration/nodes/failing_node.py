"""failing_node.py STATUS COUNT: a node of rclpy that leaves the graph in order and ends with
STATUS, behind its answer to as many messages of /in; of 0 messages it publishes alone."""

import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_msgs.msg import String

status, count = map(int, sys.argv[1:])
rclpy.init()
node = Node("failing")
out = node.create_publisher(String, "out" if count else "other", 1000)
received = []


def answer(message: Imu) -> None:
    received.append(message)
    out.publish(String(data=str(len(received))))


if count:
    node.create_subscription(Imu, "in", answer, 1000)
executor = SingleThreadedExecutor()
executor.add_node(node)
while len(received) < count:
    executor.spin_once()
executor.shutdown()
node.destroy_node()
rclpy.shutdown()
sys.exit(status)
