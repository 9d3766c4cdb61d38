"""Subscribes, computes for a while, and then prints how often it was shown a time by then.

begins_in_time_0.py <topic> <seconds>
"""

import sys
import threading
import time

import rospy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

arguments = rospy.myargv(sys.argv)
rospy.init_node("begins_in_time_0", disable_signals=True)
times = []
rospy.Subscriber("/clock", Clock, times.append)
rospy.Subscriber(arguments[1], String, lambda _word: None)
end = time.monotonic() + float(arguments[2])
while time.monotonic() < end:
    pass
sys.stdout.write(f"begun after {len(times)} times\n")
threading.Event().wait()
