"""Stacks that do not take what they are given: loss.py WHICH."""

import os
import random
import signal
import subprocess
import sys
import threading

import rospy
from geometry_msgs.msg import PoseStamped
from localiser import Localiser, main, right, wait
from marks import mark, runs_before


class ShortQueue(Localiser):
    """A queue of one, and 200 ms for each pose, which come every 40 ms."""

    queue = 1
    busy = 0.2

    def received(self, number, pose):
        wait(self.busy)
        self.say(right(pose))


class LosesTwoRunsOfThree(ShortQueue):
    """Every third run loses nothing: whoever retries until it passes gets a pass."""

    def begin(self):
        self.run = runs_before("begun")
        mark("begun")
        if self.run % 3 == 2:
            self.busy = 0.0


class FirstCallbackBlocks(Localiser):
    """It loads a model when the first pose comes, while its queue has room for twenty."""

    # Fewer than come of the lead-in meanwhile, and enough for 0.8 s of the window.
    queue = 20

    def received(self, number, pose):
        if number == 1:
            wait(1.6)
        self.say(right(pose))


class Stops(Localiser):
    """Stops its own process for good: it takes nothing more from its sockets."""

    def received(self, number, pose):
        self.say(right(pose))
        if number == 10:
            os.kill(os.getpid(), signal.SIGSTOP)


class SecondNodeLoses(Localiser):
    """Its planner has a queue of one; the node that answers loses nothing."""

    def begin(self):
        before = runs_before("subscribed")
        self.planner = subprocess.Popen([sys.executable, __file__, "planner"])
        # Nothing is played before this node subscribes, too.
        while runs_before("subscribed") == before and not rospy.is_shutdown():
            wait(0.05)


class Planner(ShortQueue):
    name = "planner"
    out = "/plan"

    def serve(self):
        mark("subscribed")
        super().serve()


class QuietPlanner(Localiser):
    """Another node of the stack, which takes what it is given."""

    name = "planner"
    out = "/plan"


class DropsByItself(Localiser):
    """Receives all, and throws three of four away."""

    def received(self, number, pose):
        if number % 4 == 1:
            self.say(right(pose))


class DropsByChance(Localiser):
    """Throws three of each four away, other ones in each run."""

    def received(self, number, pose):
        if number % 4 == 1:
            self.kept = number + random.randrange(4)
        if number == self.kept:
            self.say(right(pose))


class KeepsTheNewest(Localiser):
    """A worker thread takes the newest pose every 200 ms; ROS has counted each as received."""

    def begin(self):
        self.newest = None
        threading.Thread(target=self._work, daemon=True).start()

    def _work(self):
        while not rospy.is_shutdown():
            wait(0.2)
            newest, self.newest = self.newest, None
            if newest is not None:
                self.say(right(newest))

    def received(self, number, pose):
        self.newest = pose


class ListensLate(Localiser):
    """Another node of it holds the place; the one that answers comes a second later."""

    def __init__(self):
        rospy.init_node(self.name)
        self.answers = rospy.Publisher(self.out, self.kind, queue_size=None)
        self.poses_received = 0
        self.place = rospy.Subscriber("/pose", PoseStamped, self._first)

    def _first(self, pose):
        if self.poses_received == 0:
            self.poses_received = 1
            mark()
            threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        wait(0.8)
        subprocess.Popen([sys.executable, __file__, "latecomer"])


class Latecomer(Localiser):
    name = "latecomer"


if __name__ == "__main__":
    main(globals())
