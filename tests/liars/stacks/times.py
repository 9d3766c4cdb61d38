"""Stacks whose stamps lie, or look as if they did: times.py WHICH."""

import genpy
import rospy
from localiser import Localiser, main, right, wait


class WallClock(Localiser):
    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp = rospy.Time.now()
        self.say(answer)


class HourAhead(Localiser):
    ahead = 3600.0

    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp += genpy.Duration.from_sec(self.ahead)
        self.say(answer)


class SlowAndAhead(HourAhead):
    """300 ms late, and its stamps say that it was early."""

    ahead = 0.6

    def received(self, number, pose):
        rospy.Timer(rospy.Duration(0.3), lambda _: HourAhead.received(self, number, pose), True)


class DayBehind(HourAhead):
    """A day before the recording: no time of this case at all."""

    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp -= genpy.Duration(86400)
        self.say(answer)


class ZeroStamps(Localiser):
    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp = genpy.Time()
        self.say(answer)


class MostlyZero(Localiser):
    """Two stamps look well; the others can't be judged."""

    def received(self, number, pose):
        answer = right(pose)
        if number > 2:
            answer.header.stamp = genpy.Time()
        self.say(answer)


class Backward(Localiser):
    """Its clock runs from the first pose into the past."""

    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp -= genpy.Duration.from_sec(2 * 0.04 * (number - 1))
        self.say(answer)


class After2106(Localiser):
    """The last second that a stamp can hold."""

    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp = genpy.Time(2**32 - 1, 0)
        self.say(answer)


class After2038(Localiser):
    """Negative, where somebody reads the seconds as a signed number."""

    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp = genpy.Time(2**31 + 7, 0)
        self.say(answer)


class OneStamp(Localiser):
    """All answers have the stamp of the first pose."""

    def received(self, number, pose):
        if number == 1:
            self.first = pose.header.stamp
        answer = right(pose)
        answer.header.stamp = self.first
        self.say(answer)


class FarFutureThenSilent(Localiser):
    """One answer whose stamp is beyond all that will be waited for."""

    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp += genpy.Duration(3600)
        if number == 1:
            self.say(answer)


class FarFutureNow(Localiser):
    """The right answers, and before each one of the far future, which ends each wait."""

    def received(self, number, pose):
        ahead = right(pose)
        ahead.header.stamp += genpy.Duration(3600)
        self.say(ahead)
        rospy.Timer(rospy.Duration(0.05), lambda _: self.say(right(pose)), True)


class OldStamps(Localiser):
    """Nobody can wait for it by stamp: each is of the pose before."""

    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp -= genpy.Duration.from_sec(0.04)
        self.say(answer)


class LateButRight(Localiser):
    """Half a second behind, with the stamps of what it answers."""

    def received(self, number, pose):
        rospy.Timer(rospy.Duration(0.5), lambda _: self.say(right(pose)), True)


class SimulatedTime(Localiser):
    """Goes by /clock, and stamps with it."""

    def received(self, number, pose):
        answer = right(pose)
        answer.header.stamp = rospy.Time.now()
        self.say(answer)


class SlowButRight(Localiser):
    """Ten milliseconds for each pose."""

    def received(self, number, pose):
        wait(0.01)
        self.say(right(pose))


if __name__ == "__main__":
    main(globals())
