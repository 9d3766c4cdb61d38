"""Relays messages of any type, with the type that they come with.

anything.py <in> <out>
"""

import sys
import threading

import rospy

publishers: dict[str, rospy.Publisher] = {}


def relay(message: rospy.AnyMsg) -> None:
    """A publisher of the input's own type is made with the first message."""
    header = message._connection_header

    class Same(rospy.AnyMsg):
        _type = header["type"]
        _md5sum = header["md5sum"]
        _full_text = header["message_definition"]

    if out not in publishers:
        publishers[out] = rospy.Publisher(out, Same, queue_size=None)
        # The recorder finds the new topic within a moment; nothing may be said before.
        while publishers[out].get_num_connections() == 0 and not rospy.is_shutdown():
            threading.Event().wait(0.01)
    same = Same()
    same._buff = message._buff
    publishers[out].publish(same)


source, out = rospy.myargv(sys.argv)[1:3]
rospy.init_node("anything", disable_signals=True)
rospy.Subscriber(source, rospy.AnyMsg, relay, buff_size=1 << 24)
threading.Event().wait()
