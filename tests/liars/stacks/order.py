"""Stacks that repeat, keep, mix up, or prepare their answers: order.py WHICH."""

import rospy
from geometry_msgs.msg import PoseStamped
from localiser import POSES, Localiser, main, right, wait


class EachFiveTimes(Localiser):
    """Ten answers, five times each: as many messages as there should be."""

    def received(self, number, pose):
        if number % 5 == 1:
            for _ in range(5):
                self.say(right(pose))


class FirstAgainAndAgain(Localiser):
    """The first answer, to every pose."""

    def received(self, number, pose):
        if number == 1:
            self.first = right(pose)
        self.say(self.first)


class StaleWithFreshStamps(Localiser):
    """What it knew at the tenth pose, stamped as if it knew it now."""

    def received(self, number, pose):
        answer = right(pose)
        if number > 10:
            answer.pose = self.known.pose
        else:
            self.known = answer
        self.say(answer)


class OneBehind(Localiser):
    """The content of the answer before, under the stamp of this pose."""

    def begin(self):
        self.before = None

    def received(self, number, pose):
        answer = right(pose)
        if self.before is not None:
            answer.pose = self.before
        self.before = right(pose).pose
        self.say(answer)


class Twice(Localiser):
    """Each answer twice, wrong the first time."""

    def received(self, number, pose):
        wrong = right(pose)
        wrong.pose.position.x += 100
        self.say(wrong)
        self.say(right(pose))


class PairsSwapped(Localiser):
    """Every second pose is answered before the one that came before it, with right stamps."""

    def received(self, number, pose):
        if number % 2 == 1:
            self.kept = right(pose)
        else:
            self.say(right(pose))
            self.say(self.kept)


class Latched(Localiser):
    """One answer before the first pose, kept for whoever asks; and never another one."""

    latch = True

    def begin(self):
        self.say(self.prepared())

    def prepared(self):
        answer = PoseStamped()
        answer.header.frame_id = "map"
        answer.pose.orientation.w = 1.0
        return answer

    def received(self, number, pose):
        pass


class LatchedGoal(Latched):
    """It has arrived before it has started."""

    def prepared(self):
        answer = super().prepared()
        answer.pose.position.x = 2.0 * (POSES - 1)
        answer.pose.position.y = 1.0
        return answer


class LatchedMap(Localiser):
    """What a map server does: one message, latched, and right."""

    out = "/map_frame"
    latch = True

    def begin(self):
        answer = PoseStamped()
        answer.header.frame_id = "map"
        self.say(answer)

    def received(self, number, pose):
        pass


class SaysReadyFirst(Localiser):
    """A status before the first pose, then the answers."""

    def begin(self):
        self.status = rospy.Publisher("/status", PoseStamped, queue_size=None, latch=True)
        self.status.publish(PoseStamped())
        wait(0.2)


class Anonymous(Localiser):
    """Its name has a number of the process and the time in it."""

    anonymous = True


if __name__ == "__main__":
    main(globals())
