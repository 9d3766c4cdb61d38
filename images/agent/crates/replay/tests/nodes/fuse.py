"""Answers once a std_msgs/String has come on each of its topics, or on every n-th of one.

fuse.py <answer> <n> <topic>...
The answer names the words and the (simulated) time at which the last of them came.
"""

import sys
import threading

import rospy
from std_msgs.msg import String

arguments = rospy.myargv(sys.argv)
every = int(arguments[2])
lock = threading.Lock()
waiting: dict[str, list[str]] = {name: [] for name in arguments[3:]}
groups = 0


def word(message: String, name: str) -> None:
    global groups
    with lock:
        waiting[name].append(message.data)
        if not all(waiting.values()):
            return
        words = [queue.pop(0) for queue in waiting.values()]
        groups += 1
        if groups % every == 0:
            out.publish(f"{'+'.join(words)} at {rospy.get_rostime().to_nsec()}")


rospy.init_node("fuse", disable_signals=True)
out = rospy.Publisher(arguments[1], String, queue_size=None)
for topic in arguments[3:]:
    rospy.Subscriber(topic, String, word, topic)
threading.Event().wait()
