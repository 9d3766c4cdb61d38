"""Stacks that say where they are and where others are: traffic.py WHICH."""

import math

import rospy
from geometry_msgs.msg import Pose, PoseArray
from localiser import Localiser, main
from nav_msgs.msg import Odometry


class KeepsAway(Localiser):
    """Twenty metres from the only other car, all the time."""

    out = "/ego"
    kind = Odometry
    ego_frame = obstacle_frame = "map"

    def begin(self):
        self.obstacles = rospy.Publisher("/obstacles", PoseArray, queue_size=None)

    def received(self, number, pose):
        self.say_ego(number, pose)
        self.say_obstacles(number, pose)

    def say_ego(self, number, pose):
        ego = Odometry()
        ego.header.stamp = pose.header.stamp
        ego.header.frame_id = self.ego_frame
        ego.pose.pose.position.x = self.place(number, pose)
        ego.pose.pose.orientation.w = 1.0
        self.say(ego)

    def place(self, number, pose):
        return pose.pose.position.x

    def say_obstacles(self, number, pose):
        others = PoseArray()
        others.header.stamp = pose.header.stamp
        others.header.frame_id = self.obstacle_frame
        other = Pose()
        other.position.x = pose.pose.position.x + 20
        other.orientation.w = 1.0
        others.poses.append(other)
        self.obstacles.publish(others)


class NanPlace(KeepsAway):
    """Is nowhere for most of the drive."""

    def place(self, number, pose):
        return math.nan if number > 10 else pose.pose.position.x


class SeesOnce(KeepsAway):
    """Sees the other car at first, and never again."""

    def say_obstacles(self, number, pose):
        if number == 1:
            super().say_obstacles(number, pose)


class BlindAtTheEnd(KeepsAway):
    """Looks for others in the first fifth of the drive, and never again."""

    def say_obstacles(self, number, pose):
        if number <= 10:
            super().say_obstacles(number, pose)


class OtherFrames(KeepsAway):
    """Compares metres from the map with metres from the car."""

    obstacle_frame = "base_link"


if __name__ == "__main__":
    main(globals())
