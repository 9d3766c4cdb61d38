#!/usr/bin/python3
"""A driver who slows down in the dark: simulated odometry, and the frames of a recorded camera."""

import threading

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image

LANE_METRES = 3.5
BY_DAY, IN_THE_DARK = 20.0, 8.0
# The mean of a mono8 frame below which it is dark.
DARK = 60
# Every so many bytes of a frame are looked at.
SPARSE = 997


class Driver:
    """Answers every moment once, when both its frame and its odometry are there."""

    def __init__(self, publish):
        self.publish = publish
        self.turn = threading.Lock()
        self.frames = {}
        self.odometry = {}

    def see(self, frame):
        sample = bytearray(frame.data[::SPARSE])
        self.take(self.frames, frame, sum(sample) / len(sample) < DARK)

    def feel(self, odometry):
        self.take(self.odometry, odometry, odometry.pose.pose)

    def take(self, received, message, value):
        """The recording's stamps are those of the drive, so the two of a moment have the same."""
        stamp = message.header.stamp.to_nsec()
        with self.turn:
            received[stamp] = value
            if stamp in self.frames and stamp in self.odometry:
                self.drive(self.frames.pop(stamp), self.odometry.pop(stamp))

    def drive(self, dark, pose):
        command = Twist()
        command.linear.x = IN_THE_DARK if dark else BY_DAY
        lane = round(pose.position.y / LANE_METRES) * LANE_METRES
        command.angular.z = 0.3 * (lane - pose.position.y) - 2.0 * pose.orientation.z
        self.publish(command)


if __name__ == "__main__":
    rospy.init_node("driver")
    driver = Driver(rospy.Publisher("/cmd", Twist, queue_size=10).publish)
    rospy.Subscriber("/camera/image_raw", Image, driver.see, queue_size=10)
    rospy.Subscriber("/ego/odom", Odometry, driver.feel, queue_size=10)
    rospy.spin()
