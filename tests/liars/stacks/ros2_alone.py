"""Stacks that only ROS 2 has: ros2_alone.py WHICH."""

import rospy
from geometry_msgs.msg import PoseStamped
from localiser import Localiser, main, right, wait
from marks import mark
from rosgraph_msgs.msg import Clock


class Deaf(Localiser):
    """Counts, and takes nothing that is played."""

    def __init__(self):
        rospy.init_node(self.name)
        self.answers = rospy.Publisher("/status", PoseStamped)


class SlowExecutor(Localiser):
    """Two seconds for each pose, which wait in a queue of a thousand."""

    queue = 1000

    def received(self, number, pose):
        wait(2)
        self.say(right(pose))


class SleepsBetween(Localiser):
    """Its thread takes a pose, answers, and then sleeps where no callback runs."""

    queue = 1
    pause = 2.0

    def begin(self):
        rospy.pause_between(self.pause)


class ClockOnly(Localiser):
    """Knows the recording by heart."""

    def __init__(self):
        rospy.init_node(self.name)
        self.answers = rospy.Publisher(self.out, self.kind)
        self.clock = rospy.Subscriber("/clock", Clock, self._tick)

    def _tick(self, clock):
        mark()
        answer = right(PoseStamped())
        answer.header.stamp = clock.clock
        self.say(answer)


class WaitsForTime(Localiser):
    """One thread for callbacks and for time, as where a node is executed by one."""

    def received(self, number, pose):
        while rospy.Time.now() <= pose.header.stamp and not rospy.is_shutdown():
            wait(0.01)
        self.say(right(pose))


class SubscribesAgain(Localiser):
    def received(self, number, pose):
        # Before it answers: the next pose may come with the answer.
        if number % 10 == 0:
            self.poses.unregister()
            self.poses = self.subscribed()
        self.say(right(pose))


if __name__ == "__main__":
    main(globals())
