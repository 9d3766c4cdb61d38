"""An honest node, from which each liar differs in one thing.

It receives poses on /pose and publishes on /answer where that is on the map: twice as far in x, one
metre to the left, with the stamp of the pose. The first pose that it receives leaves a mark in the
folder LIAR_MARKS, by which the test knows that this stack has really run.
"""

import os
import re
import signal
import sys
import threading

import rospy
from geometry_msgs.msg import PoseStamped
from marks import mark, together

POSES = 50


def wait(seconds):
    """Wall-clock time, whatever /use_sim_time says."""
    threading.Event().wait(seconds)


def right(pose):
    """The answer that the truth expects."""
    answer = PoseStamped()
    answer.header.stamp = pose.header.stamp
    answer.header.frame_id = "map"
    answer.pose.position.x = 2 * pose.pose.position.x
    answer.pose.position.y = pose.pose.position.y + 1
    answer.pose.orientation.w = 1.0
    return answer


def die(number=signal.SIGSEGV):
    """At once, as a fault in native code does it; the main thread must not handle this signal."""
    mark("died")
    os.kill(os.getpid(), number)
    wait(10)


class Localiser:
    """Answers each pose; `received` is what a stack of another kind does otherwise."""

    name = "localiser"
    anonymous = False
    queue = None
    # rospy reads up to so many bytes at once, and counts whatever messages they hold.
    buffer = 65536
    out = "/answer"
    kind = PoseStamped
    latch = False

    def __init__(self):
        self.poses_received = 0
        rospy.init_node(self.name, anonymous=self.anonymous)
        # None: publish returns when the bytes are in the socket.
        self.answers = rospy.Publisher(self.out, self.kind, queue_size=None, latch=self.latch)
        self.begin()
        together()
        self.poses = self.subscribed()

    def subscribed(self):
        """To the poses, from now on."""
        limits = {"queue_size": self.queue, "buff_size": self.buffer}
        return rospy.Subscriber("/pose", PoseStamped, self._count, **limits)

    def begin(self):
        """Before the first pose can come."""

    def _count(self, pose):
        self.poses_received += 1
        if self.poses_received == 1:
            mark()
        self.received(self.poses_received, pose)

    def received(self, number, pose):
        """The pose with this number, from 1."""
        self.say(right(pose))

    def say(self, answer):
        """Publish; an answer has left this process when this returns."""
        self.answers.publish(answer)

    def serve(self):
        """Until the stack is stopped."""
        rospy.spin()


def main(module):
    """Run the stack of a module that the command line names: DoesThis is does-this."""
    wanted = rospy.myargv(sys.argv)[1]
    for word, stack in list(module.items()):
        if isinstance(stack, type) and re.sub(r"(?<=.)([A-Z])", r"-\1", word).lower() == wanted:
            stack().serve()
            return
    sys.exit(f"no stack is called {wanted}")


if __name__ == "__main__":
    main(globals())
