"""Stacks that say something else than was asked, or let somebody else say it: wrong.py WHICH."""

import subprocess
import sys

import rospy
from geometry_msgs.msg import Point, PointStamped, PoseStamped
from localiser import Localiser, main, right, wait
from marks import mark, runs_before
from std_msgs.msg import String


class OfTheRobot(Localiser):
    """Numbers of the map in the frame of the robot."""

    frame = "base_link"

    def received(self, number, pose):
        answer = right(pose)
        answer.header.frame_id = self.frame
        self.say(answer)


class NoFrame(OfTheRobot):
    frame = ""


class FrameChanges(Localiser):
    """The second half in another frame, with the same numbers."""

    def received(self, number, pose):
        answer = right(pose)
        if number > 25:
            answer.header.frame_id = "odom"
        self.say(answer)


class PointInPlace(Localiser):
    """A point where a pose was promised."""

    kind = PointStamped

    def received(self, number, pose):
        answer = right(pose)
        self.say(PointStamped(header=answer.header, point=answer.pose.position))


class TextInPlace(Localiser):
    kind = String

    def received(self, number, pose):
        self.say(String("x=1"))


class WithoutHeader(Localiser):
    """It is not known when it was measured."""

    kind = Point

    def received(self, number, pose):
        self.say(right(pose).pose.position)


class SaysNothing(Localiser):
    """Receives all and publishes nothing; what is on its topic is from another publisher."""

    def begin(self):
        self.old = rospy.Subscriber("/answer", PoseStamped, lambda _: None)

    def received(self, number, pose):
        pass


class FeedsItself(Localiser):
    """Publishes poses of its own beside the recording's, and answers the recording's alone."""

    def begin(self):
        self.own = rospy.Publisher("/pose", PoseStamped, queue_size=None)

    def received(self, number, pose):
        if pose.header.frame_id != "own":
            self.say(right(pose))
            pose.header.frame_id = "own"
            self.own.publish(pose)


class NamesakeAnswers(Localiser):
    """A second node takes its name; the ROS master sends the first one away."""

    def received(self, number, pose):
        self.say(right(pose))
        if number == 25:
            before = runs_before("namesake")
            subprocess.Popen([sys.executable, __file__, "namesake"])
            # However slowly it starts, it is there before the last pose is answered.
            while runs_before("namesake") == before and not rospy.is_shutdown():
                wait(0.02)


class Namesake(Localiser):
    def begin(self):
        mark("namesake")


if __name__ == "__main__":
    main(globals())
