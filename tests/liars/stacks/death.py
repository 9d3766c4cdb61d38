"""Stacks that do not live until the end: death.py WHICH."""

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time

import rosgraph
import rospy
from geometry_msgs.msg import PoseStamped
from localiser import POSES, Localiser, die, main, right, wait
from marks import has_ended, mark, runs_before


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


class LeavesForAnother(LeavesAfter40):
    """Does not subscribe before the one that takes its name is about to."""

    def begin(self):
        while not runs_before("ready"):
            wait(0.01)
        super().begin()


class TakesItsName(LeavesAfter40):
    """Waits, with all that it needs, until the one whose name it takes has ended."""

    def __init__(self):
        mark("ready")
        while not has_ended("died"):
            wait(0.01)
        super().__init__()


class StandsIn(Localiser):
    """Answers behind another node's last pose, and holds the play until that has left."""

    name = "planner"
    answered = 40

    def begin(self):
        self.alone = False

    def received(self, number, pose):
        if pose.pose.position.x < self.answered:
            return
        while not self.alone and not rospy.is_shutdown():
            wait(0.01)
            self.alone = self.has_left()
        self.say(right(pose))

    def has_left(self):
        if not has_ended("died"):
            return False
        # Bagpipe notes an end on a thread that may have to wait for a processor.
        wait(2)
        return True


class StandsInForTheLiving(StandsIn):
    """The same for one that has left the graph behind 20 poses, and lives on."""

    answered = 20

    def has_left(self):
        return bool(runs_before("left"))


class OutlivesIt(Localiser):
    """Reports on /status until the one that left is up again, which keeps the case open."""

    name = "planner"
    out = "/status"

    def begin(self):
        # The play may begin once it subscribes.
        while not runs_before("up"):
            wait(0.01)
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

    buffer = 1

    def received(self, number, pose):
        self.say(right(pose))
        if number == 45:
            threading.Thread(target=rospy.signal_shutdown, args=("tired",)).start()
            # However late that thread runs, this node takes no more poses.
            while not rospy.is_shutdown():
                wait(0.01)

    def serve(self):
        rospy.spin()
        wait(600)


class AwaitsThePlanner(Localiser):
    """Does not subscribe before the one that leaves is in the graph."""

    def begin(self):
        while not runs_before("up"):
            wait(0.01)


class HoldsUntilItLeaves(AwaitsThePlanner):
    """Answers no pose before the one that leaves at the first has left."""

    def received(self, number, pose):
        while not self.has_left() and not rospy.is_shutdown():
            wait(0.01)
        super().received(number, pose)

    def has_left(self):
        return runs_before("died")


class AwaitsItsLeave(AwaitsThePlanner):
    """Is at work behind the last pose, for 9 s at the most, until the one that leaves has left."""

    # The drain has 10.
    most = 9

    def received(self, number, pose):
        super().received(number, pose)
        if number == POSES:
            mark("last")
            threading.Thread(target=self._work, daemon=True).start()

    def _work(self):
        end = time.monotonic() + self.most
        while time.monotonic() < end and not runs_before("left"):
            pass


class AwaitsBothLeaves(HoldsUntilItLeaves, AwaitsItsLeave):
    """Answers no pose before the one that has left is up again, and awaits that it leaves again."""

    def has_left(self):
        return runs_before("up") > 1


class StaysBehind(Localiser):
    """Answers no pose before its launcher has ended."""

    def begin(self):
        self.launcher = os.getppid()

    def received(self, number, pose):
        while os.getppid() == self.launcher and not rospy.is_shutdown():
            wait(0.01)
        self.say(right(pose))


class Reporter:
    """A node that only publishes, on /status."""

    def __init__(self):
        rospy.init_node("planner")
        self.reports = rospy.Publisher("/status", PoseStamped, queue_size=None)
        mark("up")

    def serve(self):
        rospy.spin()

    def leave(self, by, word):
        """Leaves the graph once another stack's process has left its mark."""
        while not runs_before(by):
            wait(0.01)
        rospy.signal_shutdown("tired")
        mark(word)


class FailsAtTheStart(Reporter):
    """Ends with status 1 before the play begins, as where a parameter is missing."""

    def serve(self):
        mark("died")
        raise KeyError("~map")


class DoneAtTheStart(Reporter):
    """Has done what it had to before the play begins."""

    def serve(self):
        mark("died")


class EndedAtTheStart(Reporter):
    """Is ended by SIGTERM before the play begins, as by a script."""

    def serve(self):
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        die(signal.SIGTERM)


class AwaitsItsEnd(Localiser):
    """Does not subscribe before the one that ends at the start has ended."""

    def begin(self):
        while not has_ended("died"):
            wait(0.01)
        # Bagpipe notes an end on a thread that may have to wait for a processor.
        wait(1)


class LeavesQuietly(Reporter):
    """Leaves at the first pose; its process ends well when it is asked to."""

    def serve(self):
        signal.signal(signal.SIGINT, lambda *_: os._exit(0))
        self.leave("ran", "died")
        wait(600)


class LivesTwice(Reporter):
    """Leaves at the first pose and ends well; restarted, it leaves behind the last one."""

    def serve(self):
        if runs_before("up") == 1:
            self.leave("ran", "died")
            os._exit(0)
        self.leave("last", "left")
        wait(600)


class GivesItsNameAway(Reporter):
    """Leaves at the first pose and lives on; another process of it leaves behind the last one."""

    def serve(self):
        if runs_before("up") == 1:
            self.leave("ran", "died")
            subprocess.run([sys.executable, *sys.argv], check=False)
            wait(600)
        self.leave("last", "left")
        os._exit(0)


class HoldsTheLock(Reporter):
    """Computes in native code that lets no other thread run, for 1.5 s at a time."""

    until = "never"

    def serve(self):
        native = ctypes.PyDLL(None)
        while not runs_before(self.until) and not rospy.is_shutdown():
            native.usleep(1_500_000)


class HoldsTheLockAndFails(HoldsTheLock):
    """Does so when the play begins; behind the last pose it leaves and ends with status 3."""

    until = "ran"

    def serve(self):
        super().serve()
        self.leave("last", "left")
        mark("died")
        os._exit(3)


class DoneAndBroken(Localiser):
    """Leaves behind its last answer, and breaks in its destructors when it is asked to end."""

    number = signal.SIGSEGV

    def begin(self):
        self.over = threading.Event()

    def received(self, number, pose):
        self.say(right(pose))
        if number == POSES:
            self.over.set()

    def serve(self):
        self.over.wait()
        # Bagpipe looks at once who is there behind the last pose, as soon as it gets a processor.
        wait(3)
        rospy.signal_shutdown("done")
        mark("died")
        signal.signal(signal.SIGINT, lambda *_: os.kill(os.getpid(), self.number))
        wait(600)


class TakesItsTime(Localiser):
    """50 ms for each pose, which all have room in its queue."""

    queue = 1000

    def received(self, number, pose):
        wait(0.05)
        self.say(right(pose))


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
