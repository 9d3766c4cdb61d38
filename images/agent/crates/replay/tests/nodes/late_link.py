"""Relays JointStates, and connects to a publisher only some time after it has subscribed.

late_link.py <in> <out> <seconds>
"""

import sys
import threading
from typing import Any

import rospy
from rospy.impl.masterslave import ROSHandler
from sensor_msgs.msg import JointState

arguments = rospy.myargv(sys.argv)
connect = ROSHandler._connect_topic


def connect_late(handler: ROSHandler, *details: Any) -> Any:
    threading.Event().wait(float(arguments[3]))
    return connect(handler, *details)


ROSHandler._connect_topic = connect_late
rospy.init_node("late_link", disable_signals=True)
out = rospy.Publisher(arguments[2], JointState, queue_size=None)
rospy.Subscriber(arguments[1], JointState, out.publish)
threading.Event().wait()
