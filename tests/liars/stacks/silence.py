"""Stacks that say too little, or only when nobody asks: silence.py WHICH."""

import rospy
from geometry_msgs.msg import PoseStamped
from localiser import POSES, Localiser, main, right, wait
from marks import mark
from std_msgs.msg import String


class Nothing(Localiser):
    def received(self, number, pose):
        pass


class NothingAtAll(Localiser):
    """It does not even say that it could."""

    def __init__(self):
        rospy.init_node(self.name)
        rospy.Subscriber("/pose", PoseStamped, lambda _: None)
        mark()


class OnlyAfterTheEnd(Localiser):
    """Silent in the window; 70 messages while the recording is ended."""

    def received(self, number, pose):
        if number == POSES:
            for _ in range(70):
                self.say(right(pose))


class TwoAnswers(Localiser):
    most = 2

    def received(self, number, pose):
        if number <= self.most:
            self.say(right(pose))


class OneAnswer(TwoAnswers):
    most = 1


class FirstHalf(TwoAnswers):
    most = 25


class OnlyTheLast(Localiser):
    def received(self, number, pose):
        if number == POSES:
            self.say(right(pose))


class EveryTenth(Localiser):
    def received(self, number, pose):
        if number % 10 == 1:
            self.say(right(pose))


class OnlyInTheLeadIn(TwoAnswers):
    """The lead-in has 25 poses; what it proves is nothing."""

    most = 24


class AheadInTheLeadIn(Localiser):
    """Answers 24 poses of the lead-in as if they came a second later, and is silent then."""

    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp += rospy.Duration(1)
        if number <= 24:
            self.say(answer)


class WrongTopic(Localiser):
    out = "/answers"


class Elsewhere(Localiser):
    out = "/debug/answer"


class AlarmOnly(Localiser):
    """Says that it lives, and does nothing."""

    out = "/alive"
    kind = String

    def received(self, number, pose):
        self.say(String("alive"))


class Hangs(Localiser):
    """A deadlock in the callback of the 25th pose."""

    def received(self, number, pose):
        if number == 25:
            wait(600)
        self.say(right(pose))


class RaisesFromThe10th(Localiser):
    """rospy catches what a callback raises, says so, and lives on."""

    def received(self, number, pose):
        if number >= 10:
            raise ValueError("no solution")
        self.say(right(pose))


class GoalAtOnce(Localiser):
    """Says in the beginning where it should be in the end, and nothing more."""

    def received(self, number, pose):
        if number == 1:
            goal = right(pose)
            goal.pose.position.x = 2.0 * (POSES - 1)
            self.say(goal)


class LeavesThePose(Localiser):
    """Does not receive the second half: unsubscribed."""

    buffer = 1

    def received(self, number, pose):
        self.say(right(pose))
        if number == 25:
            self.poses.unregister()


class Bursts(Localiser):
    """Ten answers at once after ten poses, with the stamps of what each one answers."""

    def begin(self):
        self.kept = []

    def received(self, number, pose):
        self.kept.append(right(pose))
        if number % 10 == 0:
            for answer in self.kept:
                self.say(answer)
            self.kept = []


if __name__ == "__main__":
    main(globals())
