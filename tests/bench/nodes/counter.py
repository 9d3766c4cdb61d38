"""Counts messages until none has come for a while, as counter.cpp does, with rospy."""

import sys
import threading
import time

import rospy
from std_msgs.msg import String

topic, expected = rospy.myargv(sys.argv)[1], int(rospy.myargv(sys.argv)[2])
seen = 0
first = last = 0.0


def say(line: str) -> None:
    """One whole line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def count(_message: String) -> None:
    global seen, first, last  # noqa: PLW0603 - as rospy's callbacks are
    last = time.perf_counter()
    if seen == 0:
        first = last
    seen += 1


rospy.init_node("counter", disable_signals=True)
rospy.Subscriber(topic, String, count)
say("ready")
pause = threading.Event()
while seen < expected and not (seen and time.perf_counter() - last > 2):
    pause.wait(0.05)
say(f"received {seen} seconds {last - first:.9f}")
pause.wait()
