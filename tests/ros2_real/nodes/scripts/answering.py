#!/usr/bin/env python3
"""Answers each message of in on out, in Python; with the parameter `deaf` no SIGINT ends it.

With `wall_ms` a timer of the machine's clock does nothing that often, with `sim_ms` one of
the node's clock. Its queue has room for `depth` messages. The first so many (`sleeps`) callbacks
sleep for 0.4 s.
"""

import contextlib
import signal
import time

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_msgs.msg import String


class Answering(Node):
    def __init__(self):
        super().__init__("answering")
        self.threads = self.declare_parameter("threads", 1).value
        if self.declare_parameter("deaf", False).value:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        self.sleeps = self.declare_parameter("sleeps", 0).value
        group = ReentrantCallbackGroup() if self.threads > 1 else None
        self.out = self.create_publisher(String, "out", 1000)
        depth = self.declare_parameter("depth", 10).value
        self.subscription = self.create_subscription(
            Imu, "in", self.answer, depth, callback_group=group
        )

        for name, clock in (
            ("wall_ms", Clock(clock_type=ClockType.STEADY_TIME)),
            ("sim_ms", self.get_clock()),
        ):
            if period := self.declare_parameter(name, 0).value:
                self.create_timer(period / 1000, self.tick, clock=clock)

    def tick(self):
        pass

    def answer(self, message):
        if self.sleeps > 0:
            self.sleeps -= 1
            time.sleep(0.4)
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        text = f"{stamp} {message.angular_velocity.z:f}"
        if self.get_parameter("use_sim_time").value:
            text += f" {self.get_clock().now().nanoseconds}"
        self.out.publish(String(data=text))


def main():
    rclpy.init()
    node = Answering()
    executor = MultiThreadedExecutor(node.threads) if node.threads > 1 else SingleThreadedExecutor()
    executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
