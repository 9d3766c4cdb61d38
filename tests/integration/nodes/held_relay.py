"""held_relay.py TYPE IN OUT COUNT GATE: publishes each message again, the one after COUNT of them
only once there is a file GATE."""

import itertools
import sys
import threading
from pathlib import Path

import roslib.message
import rospy

kind, recorded, relayed, count, gate = rospy.myargv(sys.argv)[1:]
message = roslib.message.get_message_class(kind)
rospy.init_node("held_relay")
message._has_header = False
publisher = rospy.Publisher(relayed, message, queue_size=None)
never = threading.Event()
numbers = itertools.count()


def relay(received):
    held = next(numbers) == int(count)
    while held and not Path(gate).exists() and not rospy.is_shutdown():
        never.wait(0.02)
    publisher.publish(received)


rospy.Subscriber(recorded, message, relay)
rospy.spin()
