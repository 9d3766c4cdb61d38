#!/usr/bin/python3
"""The software under test of this example: a planner that keeps its lane and its distance.

It looks ahead in its own lane only, as many a first planner does: a car that changes into its
lane from beside, or that comes up from behind, surprises it. Decision and control are plain
Python; ROS is only around them.
"""

import math
import threading

import rospy
from geometry_msgs.msg import PoseArray, Twist
from nav_msgs.msg import Odometry

LANE_METRES = 3.5
CRUISE = 20.0
# Half the widths of two cars and some room: who is nearer to our course than this is in our lane.
IN_LANE_METRES = 2.0
# From middle to middle: a car's length and a gap.
STAND_OFF_METRES = 8.0
BRAKING = 6.0


def decide(ego, obstacles):
    """The speed and yaw rate to ask for. `ego` is (x, y, heading), `obstacles` (x, y, speed)s."""
    x, y, heading = ego
    lane = round(y / LANE_METRES) * LANE_METRES
    speed = CRUISE
    for ox, oy, pace in obstacles:
        ahead = ox - x
        if ahead > 0 and abs(oy - y) < IN_LANE_METRES:
            # As fast as lets us brake behind it, if it goes on as it does.
            room = max(ahead - STAND_OFF_METRES, 0.0)
            speed = min(speed, max(pace, 0.0) + math.sqrt(2 * BRAKING * room))
            if ahead < STAND_OFF_METRES:
                speed = min(speed, max(pace - 2.0, 0.0))
    return speed, 0.3 * (lane - y) - 1.0 * heading


class Tracks:
    """How fast each obstacle moves along the road: between two of its places in the list."""

    def __init__(self):
        self.before = None

    def update(self, seconds, points):
        """(x, y, speed) of each point; the first time nobody moves."""
        known = self.before
        self.before = (seconds, points)
        if known is None or len(known[1]) != len(points) or seconds <= known[0]:
            return [(x, y, 0.0) for x, y in points]
        passed = seconds - known[0]
        return [
            (x, y, (x - old) / passed) for (x, y), (old, _) in zip(points, known[1], strict=True)
        ]


class Planner:
    """Answers every moment once, when both its odometry and its obstacles are there."""

    def __init__(self, publish):
        self.publish = publish
        self.tracks = Tracks()
        self.odometry = None
        self.obstacles = None

    def receive(self, odometry=None, obstacles=None):
        """Take in (time, what was received); answer when the times meet."""
        self.odometry = odometry or self.odometry
        self.obstacles = obstacles or self.obstacles
        if not self.odometry or not self.obstacles or self.odometry[0] != self.obstacles[0]:
            return
        seconds, ego = self.odometry
        self.publish(*decide(ego, self.tracks.update(seconds, self.obstacles[1])))


def main():
    """A rospy node on the simulator's own names."""
    rospy.init_node("planner")
    commands = rospy.Publisher("/cmd", Twist, queue_size=10)
    # rospy calls each topic's callbacks on a thread of its own.
    turn = threading.Lock()

    def steer(speed, yaw_rate):
        command = Twist()
        command.linear.x, command.angular.z = speed, yaw_rate
        commands.publish(command)

    planner = Planner(steer)

    def receive_odometry(message):
        pose = message.pose.pose
        heading = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
        with turn:
            planner.receive(
                odometry=(
                    message.header.stamp.to_sec(),
                    (pose.position.x, pose.position.y, heading),
                )
            )

    def receive_obstacles(message):
        points = [(pose.position.x, pose.position.y) for pose in message.poses]
        with turn:
            planner.receive(obstacles=(message.header.stamp.to_sec(), points))

    rospy.Subscriber("/ego/odom", Odometry, receive_odometry, queue_size=10)
    rospy.Subscriber("/obstacles", PoseArray, receive_obstacles, queue_size=10)
    rospy.spin()


if __name__ == "__main__":
    main()
