"""Relays JointStates by stamp, and gives every n-th one another stamp.

stamper.py <in> <out> <n> <seconds of the other stamp>
"""

import sys
import threading

import genpy
import rospy
from sensor_msgs.msg import JointState

arguments = rospy.myargv(sys.argv)
every = int(arguments[3])
seen = 0


def relay(message: JointState) -> None:
    global seen
    seen += 1
    if seen % every == 0:
        message.header.stamp = genpy.Time(int(arguments[4]), 0)
    out.publish(message)


rospy.init_node("stamper", disable_signals=True)
out = rospy.Publisher(arguments[2], JointState, queue_size=None)
rospy.Subscriber(arguments[1], JointState, relay)
threading.Event().wait()
