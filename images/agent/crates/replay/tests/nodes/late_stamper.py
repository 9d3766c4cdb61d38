"""Relays JointStates by stamp, and holds every n-th one back until the next one has come.

late_stamper.py <in> <out> <n>
"""

import sys
import threading

import rospy
from sensor_msgs.msg import JointState

arguments = rospy.myargv(sys.argv)
every = int(arguments[3])
seen = 0
held: JointState | None = None


def relay(message: JointState) -> None:
    global seen, held
    seen += 1
    if seen % every == 0:
        held = message
        return
    if held is not None:
        out.publish(held)
        held = None
    out.publish(message)


rospy.init_node("late_stamper", disable_signals=True)
out = rospy.Publisher(arguments[2], JointState, queue_size=None)
rospy.Subscriber(arguments[1], JointState, relay)
threading.Event().wait()
