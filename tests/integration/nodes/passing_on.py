"""passing_on.py: passes each message of /in on to /between, from when somebody subscribes there."""

import contextlib
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import Imu

rclpy.init()
node = rclpy.create_node("passing_on")
between = node.create_publisher(Imu, "between", 1000)
while not between.get_subscription_count():
    time.sleep(0.02)
node.create_subscription(Imu, "in", between.publish, 10)
with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(node)
