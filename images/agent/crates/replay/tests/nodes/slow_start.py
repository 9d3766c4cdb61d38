"""Computes for a while before it is a node, and then says each word that it is told.

slow_start.py <topic> <seconds>
"""

import sys
import threading
import time

import rospy
from std_msgs.msg import String

arguments = rospy.myargv(sys.argv)
end = time.monotonic() + float(arguments[2])
while time.monotonic() < end:
    pass
rospy.init_node("slow_start", disable_signals=True)
rospy.Subscriber(
    arguments[1], String, lambda word: sys.stdout.write(f"word {word.data}\n"), queue_size=None
)
threading.Event().wait()
