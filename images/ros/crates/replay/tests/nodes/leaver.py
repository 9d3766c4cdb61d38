"""Subscribes to a std_msgs/String topic after a word on another one, or leaves after n.

leaver.py <topic> <messages to hear before leaving>
"""

import os
import sys
import threading

import rospy
from std_msgs.msg import String

enough = threading.Event()
arguments = rospy.myargv(sys.argv)
heard = 0


def say(line: str) -> None:
    """One write for each line: callbacks of several topics run on several threads."""
    sys.stdout.write(line + "\n")


def word(message: String) -> None:
    global heard
    heard += 1
    if heard == int(arguments[2]):
        enough.set()


rospy.init_node("leaver", disable_signals=True)
rospy.Subscriber(arguments[1], String, word)
enough.wait()
say(f"leaving {heard}")
os._exit(0)
