"""A subscriber whose queue is short and whose callback takes its time.

slow.py <topic> <queue> <seconds in the callback>
"""

import sys
import threading

import rospy
from std_msgs.msg import String

arguments = rospy.myargv(sys.argv)
seen = 0


def word(_message: String) -> None:
    global seen
    threading.Event().wait(float(arguments[3]))
    seen += 1
    sys.stdout.write(f"seen {seen}\n")


rospy.init_node("slow", disable_signals=True)
rospy.Subscriber(arguments[1], String, word, queue_size=int(arguments[2]))
threading.Event().wait()
