"""Stacks that do not live until the end: death.py WHICH."""

import os
import signal
import subprocess
import sys
import threading

import rosgraph
import rospy
from geometry_msgs.msg import PoseStamped
from localiser import POSES, Localiser, die, main, right, wait
from marks import mark, runs_before


class SegfaultAfterTheLast(Localiser):
    at = POSES
    number = signal.SIGSEGV

    def begin(self):
        if self.number == signal.SIGTERM:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)

    def received(self, number, pose):
        self.say(right(pose))
        if number == self.at:
            die(self.number)


class SegfaultInTheMidst(SegfaultAfterTheLast):
    at = 25


class KilledAfterTheLast(SegfaultAfterTheLast):
    """As by the kernel, where memory is short."""

    number = signal.SIGKILL


class AbortAfterTheLast(SegfaultAfterTheLast):
    number = signal.SIGABRT


class TerminatedAfterTheLast(SegfaultAfterTheLast):
    """Not by Bagpipe."""

    number = signal.SIGTERM


class StatusThree(Localiser):
    at = POSES
    status = 3

    def received(self, number, pose):
        self.say(right(pose))
        if number == self.at:
            print("the map is gone", file=sys.stderr, flush=True)
            mark("died")
            os._exit(self.status)


class LeavesAfter40(StatusThree):
    """Status 0, as if it were done, with ten poses to come."""

    at = 40
    status = 0

    def begin(self):
        mark("up")


class OutlivesIt(Localiser):
    """Reports on /status until the one that left is up again, which keeps the case open."""

    name = "planner"
    out = "/status"

    def begin(self):
        threading.Thread(target=self._report, daemon=True).start()

    def received(self, number, pose):
        pass

    def _report(self):
        while not rospy.is_shutdown():
            if runs_before("up") == runs_before("died"):
                self.say(PoseStamped())
            wait(0.05)


class DoneAfterTheLast(StatusThree):
    """Status 0 when the last pose is answered."""

    status = 0


class RaisesInMain(Localiser):
    def received(self, number, pose):
        self.say(right(pose))
        if number == POSES:
            self.over.set()

    def begin(self):
        self.over = threading.Event()

    def serve(self):
        while not self.over.wait(0.02):
            pass
        mark("died")
        raise RuntimeError("the optimiser diverged")


class LeavesTheGraph(Localiser):
    """Shuts its node down, and its process lives on."""

    def received(self, number, pose):
        self.say(right(pose))
        if number == 45:
            threading.Thread(target=rospy.signal_shutdown, args=("tired",)).start()

    def serve(self):
        rospy.spin()
        wait(600)


class AwaitsThePlanner(Localiser):
    """Does not subscribe before the one that leaves is in the graph."""

    def begin(self):
        while not runs_before("up"):
            wait(0.01)


class LeavesQuietly:
    """A node that only publishes leaves at the first pose; its process ends well when asked to."""

    def __init__(self):
        rospy.init_node("planner")
        self.reports = rospy.Publisher("/status", PoseStamped, queue_size=None)
        signal.signal(signal.SIGINT, lambda *_: os._exit(0))
        mark("up")

    def serve(self):
        while not runs_before("ran"):
            wait(0.01)
        rospy.signal_shutdown("tired")
        mark("died")
        wait(600)


class HelperDies(Localiser):
    """What computes for it crashes after half of the poses; it answers on as if nothing was."""

    number = signal.SIGSEGV

    def begin(self):
        self.helper = subprocess.Popen(["/usr/bin/sleep", "600"])

    def received(self, number, pose):
        self.say(right(pose))
        if number == 25:
            mark("died")
            self.helper.send_signal(self.number)


class HelperEnded(HelperDies):
    """Ends its own helper as it should, by SIGTERM, and starts another."""

    number = signal.SIGTERM

    def received(self, number, pose):
        super().received(number, pose)
        if number == 25:
            self.helper.wait()
            self.helper = subprocess.Popen(["/usr/bin/sleep", "600"])


class ChildSaysNo(Localiser):
    """A child whose status 1 is an answer, as grep's is."""

    def received(self, number, pose):
        if number == 25:
            subprocess.run(["/usr/bin/grep", "-q", "nowhere", "/dev/null"], check=False)
        self.say(right(pose))


class SlowToEnd(Localiser):
    """Writes its map when it is stopped, which takes a second."""

    def serve(self):
        rospy.on_shutdown(lambda: wait(1))
        rospy.spin()


class KillsTheMaster(Localiser):
    """ROS keeps the connections that stand, so that the answers go on."""

    def received(self, number, pose):
        if number == 25:
            os.kill(rosgraph.Master("/localiser").getPid(), signal.SIGKILL)
        self.say(right(pose))


if __name__ == "__main__":
    main(globals())
