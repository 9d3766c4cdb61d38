"""Stacks whose numbers are none: figures.py WHICH."""

import math

from localiser import Localiser, main, right

NAN = math.nan


class NanFromTheTenth(Localiser):
    def received(self, number, pose):
        answer = right(pose)
        if number >= 10:
            answer.pose.position.x = NAN
        self.say(answer)


class NanOnce(Localiser):
    at = 25
    value = NAN

    def received(self, number, pose):
        answer = right(pose)
        if number == self.at:
            answer.pose.position.x = self.value
        self.say(answer)


class NanFirst(NanOnce):
    at = 1


class NanLast(NanOnce):
    at = 50


class InfinityOnce(NanOnce):
    value = math.inf


class MinusInfinityOnce(NanOnce):
    value = -math.inf


class HugeOnce(NanOnce):
    """Its square is no number any more."""

    value = 1e300


class NanInTheSecondField(Localiser):
    def received(self, number, pose):
        answer = right(pose)
        if number == 25:
            answer.pose.position.y = NAN
        self.say(answer)


class NanEverywhere(Localiser):
    def received(self, number, pose):
        answer = right(pose)
        answer.pose.position.x = answer.pose.position.y = NAN
        self.say(answer)


class NanHeading(Localiser):
    """Where it is, is right; which way it looks is not known."""

    def received(self, number, pose):
        answer = right(pose)
        answer.pose.orientation.z = NAN
        self.say(answer)


class NoHeading(Localiser):
    """A rotation of all zeros is none, and reads as a heading of 0."""

    def received(self, number, pose):
        answer = right(pose)
        answer.pose.orientation.w = 0.0
        self.say(answer)


class TurnedRound(Localiser):
    """Where it is, is right, and it looks back."""

    def received(self, number, pose):
        answer = right(pose)
        answer.pose.orientation.z, answer.pose.orientation.w = 1.0, 0.0
        self.say(answer)


class OneOffset(Localiser):
    """Numbers that are plainly wrong: the answer is the pose itself."""

    def received(self, number, pose):
        answer = right(pose)
        answer.pose = pose.pose
        self.say(answer)


class NanNobodyJudges(Localiser):
    """A field that no criterion reads is no number: that is what many drivers say for unknown."""

    def received(self, number, pose):
        answer = right(pose)
        answer.pose.position.z = NAN
        self.say(answer)


if __name__ == "__main__":
    main(globals())
