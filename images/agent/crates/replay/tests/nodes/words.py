"""Prints every std_msgs/String of the named topics, and answers it on /answer.

words.py <topic>...
"""

import sys
import threading

import rospy
from std_msgs.msg import String


def say(line: str) -> None:
    """One write for each line: callbacks of several topics run on several threads."""
    sys.stdout.write(line + "\n")


def word(message: String) -> None:
    say(f"word {message.data}")
    out.publish(message)


rospy.init_node("words", disable_signals=True)
out = rospy.Publisher("/answer", String, queue_size=None)
state = rospy.Publisher("/state", String, queue_size=None, latch=True)
state.publish("ready")
for name in rospy.myargv(sys.argv)[1:]:
    rospy.Subscriber(name, String, word)
threading.Event().wait()
