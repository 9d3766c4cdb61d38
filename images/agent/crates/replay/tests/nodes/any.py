"""Subscribes to topics of any type and says how many messages and bytes came.

any.py <topic>...
"""

import sys
import threading

import rospy

lock = threading.Lock()
seen = 0
volume = 0


def take(message: rospy.AnyMsg) -> None:
    global seen, volume
    with lock:
        seen += 1
        volume += len(message._buff)
        sys.stdout.write(f"seen {seen}\nbytes {volume}\n")


rospy.init_node("any", disable_signals=True)
for name in rospy.myargv(sys.argv)[1:]:
    rospy.Subscriber(name, rospy.AnyMsg, take)
threading.Event().wait()
