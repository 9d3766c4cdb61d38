"""A subscriber whose first callback takes long and whose queue holds one message.

begins_late.py <topic> <bytes read at once> <seconds of the first callback> <seconds of each other>
"""

import sys
import threading

import rospy
from std_msgs.msg import String

arguments = rospy.myargv(sys.argv)
pauses = [float(arguments[3])]


def word(message: String) -> None:
    threading.Event().wait(pauses.pop() if pauses else float(arguments[4]))
    sys.stdout.write(f"word {message.data}\n")


rospy.init_node("begins_late", disable_signals=True)
rospy.Subscriber(arguments[1], String, word, queue_size=1, buff_size=int(arguments[2]))
threading.Event().wait()
