"""A ROS node that finds the obstacles in a LiDAR's scans (clustering.py has the algorithm).

Subscribes to `points` (sensor_msgs/PointCloud2) and publishes, for each scan, `obstacles`
(geometry_msgs/PoseArray): the middles of the clusters, the largest cluster first, in the sensor's
frame. The stamp is the time at which the scan came in, so that a recording whose own stamps are
of another day still shows how long the answer took. `~least_points` is what a cluster needs.
"""

import numpy as np
import rospy
from clustering import LEAST, above_ground, clusters, layout_of, points_of
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from sensor_msgs.msg import PointCloud2


def obstacles(points: np.ndarray, least: int) -> list[Pose]:
    """The middle of each cluster's bounding box."""
    middles = [(c.min(axis=0) + c.max(axis=0)) / 2 for c in clusters(above_ground(points), least)]
    return [Pose(Point(*map(float, middle)), Quaternion(w=1.0)) for middle in middles]


def main() -> None:
    """Answer each scan until ROS ends."""
    rospy.init_node("obstacles")
    least = int(rospy.get_param("~least_points", LEAST))
    publisher = rospy.Publisher("obstacles", PoseArray, queue_size=None)

    def answer(cloud: PointCloud2) -> None:
        came = rospy.Time.now()
        offsets = {field.name: field.offset for field in cloud.fields}
        found = PoseArray(
            poses=obstacles(points_of(cloud.data, layout_of(offsets, cloud.point_step)), least)
        )
        found.header.stamp, found.header.frame_id = came, cloud.header.frame_id
        publisher.publish(found)

    # rospy hands scans over one by one, and keeps those that wait: none is left out.
    rospy.Subscriber("points", PointCloud2, answer, buff_size=1 << 24)
    rospy.spin()


if __name__ == "__main__":
    main()
