"""A ROS node that finds pedestrians in a camera's frames (walking.py has the detector).

Subscribes to `camera` (sensor_msgs/CompressedImage) and publishes, for each frame, `pedestrians`
(geometry_msgs/PolygonStamped) with the frame's own header: four corners for each pedestrian, in
pixels, z the certainty of the detector. A frame in which nobody walks has no corners.
"""

import cv2
import numpy as np
import rospy
from geometry_msgs.msg import Point32, PolygonStamped
from sensor_msgs.msg import CompressedImage
from walking import pedestrians


def corners(box: list[int], certainty: float) -> list[Point32]:
    """Clockwise from the upper left, as a picture is looked at."""
    left, top, width, height = box
    right, bottom = left + width, top + height
    around = [(left, top), (right, top), (right, bottom), (left, bottom)]
    return [Point32(float(x), float(y), certainty) for x, y in around]


def main() -> None:
    """Answer each frame until ROS ends."""
    rospy.init_node("pedestrians")
    least = float(rospy.get_param("~least_certainty", 0.0))
    publisher = rospy.Publisher("pedestrians", PolygonStamped, queue_size=None)

    def answer(frame: CompressedImage) -> None:
        image = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            rospy.logerr("a frame of %d bytes is no picture that OpenCV can read", len(frame.data))
            return
        found = PolygonStamped(header=frame.header)
        for box, certainty in pedestrians(image):
            if certainty >= least:
                found.polygon.points += corners(box, certainty)
        publisher.publish(found)

    rospy.Subscriber("camera", CompressedImage, answer, buff_size=1 << 24)
    rospy.spin()


if __name__ == "__main__":
    main()
