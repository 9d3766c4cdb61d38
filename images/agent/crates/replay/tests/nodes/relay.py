"""Relays JointStates and says how many callbacks have run.

relay.py <in> <out> <queue or 0 for none> <seconds in the callback>
"""

import sys
import threading

import rospy
from sensor_msgs.msg import JointState

arguments = rospy.myargv(sys.argv)
busy = float(arguments[4])
seen = 0


def say(line: str) -> None:
    """One write for each line: callbacks of several topics run on several threads."""
    sys.stdout.write(line + "\n")


def relay(message: JointState) -> None:
    global seen
    if busy:
        threading.Event().wait(busy)
    out.publish(message)
    seen += 1
    say(f"seen {seen}")


rospy.init_node("relay_py", disable_signals=True)
out = rospy.Publisher(arguments[2], JointState, queue_size=None)
rospy.Subscriber(arguments[1], JointState, relay, queue_size=int(arguments[3]) or None)
threading.Event().wait()
