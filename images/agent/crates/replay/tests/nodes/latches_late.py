"""Is connected to before it latches, as rospy can be, and publishes "ready" on /state then.

rospy registers a topic first and latches it after: the wait is where the scheduler can put one.
"""

import threading
import time

import rospy
from std_msgs.msg import String

SECONDS = 20
latch = rospy.topics._PublisherImpl.enable_latch


def once_connected(publisher) -> None:
    end = time.monotonic() + SECONDS
    while publisher.resolved_name == "/state" and not publisher.has_connections():
        if time.monotonic() > end:
            raise SystemExit("nobody has connected")
        time.sleep(0.005)
    latch(publisher)


rospy.topics._PublisherImpl.enable_latch = once_connected
rospy.init_node("latches_late", disable_signals=True)
state = rospy.Publisher("/state", String, queue_size=None, latch=True)
state.publish("ready")
rospy.Subscriber("/talk", String, lambda _: None)
threading.Event().wait()
