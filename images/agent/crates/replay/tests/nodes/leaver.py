"""Subscribes to a std_msgs/String topic, and leaves after n messages.

leaver.py <topic> <messages to hear before leaving>
"""

import os
import sys
import threading

import rospy
from std_msgs.msg import String

arguments = rospy.myargv(sys.argv)
heard = 0


def word(message: String) -> None:
    """Leaves at once: rospy calls a connection's callbacks one after the other."""
    global heard
    heard += 1
    if heard == int(arguments[2]):
        sys.stdout.write(f"leaving {heard}\n")
        sys.stdout.flush()
        os._exit(0)


rospy.init_node("leaver", disable_signals=True)
rospy.Subscriber(arguments[1], String, word)
threading.Event().wait()
