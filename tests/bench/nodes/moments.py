"""Answers each message on /joint_states with the moments of this process, on /moments."""

import json
import time

begun = time.time()

import rospy  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import String  # noqa: E402

imported = time.time()
rospy.init_node("moments")
publisher = rospy.Publisher("/moments", String, queue_size=None)


def answer(_message):
    moments = {"begun": begun, "imported": imported, "registered": registered}
    publisher.publish(json.dumps(moments | {"received": time.time()}))


rospy.Subscriber("/joint_states", JointState, answer)
registered = time.time()
rospy.spin()
