"""relay_type.py TYPE IN OUT: publishes each message again as it came; knows nothing of others."""

import sys

import roslib.message
import rospy

kind, recorded, relayed = rospy.myargv(sys.argv)[1:]
message = roslib.message.get_message_class(kind)
rospy.init_node("relay_type")
# rospy numbers the headers that it publishes, from 1 in every process: a state, so not for us.
message._has_header = False
publisher = rospy.Publisher(relayed, message, queue_size=None)
rospy.Subscriber(recorded, message, publisher.publish)
rospy.spin()
