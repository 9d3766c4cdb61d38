"""Prints every clock message, and the time at which each std_msgs/String came."""

import sys
import threading

import rospy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

rospy.init_node("clock_reader", disable_signals=True)
out = rospy.Publisher("/answer", String, queue_size=None, latch=False)
ticks = []


def say(line: str) -> None:
    """One write for each line: callbacks of several topics run on several threads."""
    sys.stdout.write(line + "\n")


def tick(message: Clock) -> None:
    ticks.append(message.clock.to_nsec())
    say(f"clock {message.clock.to_nsec()}")


def word(message: String) -> None:
    say(f"word {message.data}")
    out.publish(message)


rospy.Subscriber("/clock", Clock, tick)
rospy.Subscriber("/words", String, word)
threading.Event().wait()
