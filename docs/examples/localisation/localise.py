"""A ROS node that says where the robot is: an EKF over its wheels' odometry and its IMU.

Subscribes to `imu` (sensor_msgs/Imu) and `wheels` (nav_msgs/Odometry, of which only the twist
is used) and publishes `pose` (nav_msgs/Odometry) for each of the wheels' messages, and `attitude`
(geometry_msgs/QuaternionStamped) for each of the IMU's. Its private parameters are the fields of
ekf.Noise.
"""

import dataclasses
import threading

import numpy as np
import rospy
from ekf import Filter, Noise, matrix_of, quaternion
from geometry_msgs.msg import Point, Quaternion, QuaternionStamped, Vector3
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu


class Localisation:
    """Both inputs into one filter; rospy calls back on a thread for each topic."""

    def __init__(self) -> None:
        noise = {
            field.name: float(rospy.get_param(f"~{field.name}", field.default))
            for field in dataclasses.fields(Noise)
        }
        self._filter = Filter(Noise(**noise))
        self._lock = threading.Lock()
        self._pose = rospy.Publisher("pose", Odometry, queue_size=None)
        self._attitude = rospy.Publisher("attitude", QuaternionStamped, queue_size=None)
        rospy.Subscriber("imu", Imu, self._see_imu, tcp_nodelay=True)
        rospy.Subscriber("wheels", Odometry, self._see_wheels, tcp_nodelay=True)

    def _see_imu(self, imu: Imu) -> None:
        q, rate = imu.orientation, imu.angular_velocity
        with self._lock:
            self._filter.advance(imu.header.stamp.to_sec())
            self._filter.see_imu(matrix_of(q.x, q.y, q.z, q.w), np.array([rate.x, rate.y, rate.z]))
            answer = QuaternionStamped(quaternion=self._orientation())
        answer.header.stamp, answer.header.frame_id = imu.header.stamp, "odom"
        self._attitude.publish(answer)

    def _see_wheels(self, wheels: Odometry) -> None:
        twist = wheels.twist.twist
        with self._lock:
            self._filter.advance(wheels.header.stamp.to_sec())
            self._filter.see_wheels(twist.linear.x, twist.angular.z)
            answer = Odometry(child_frame_id=wheels.child_frame_id)
            answer.pose.pose.position = Point(*self._filter.position)
            answer.pose.pose.orientation = self._orientation()
            answer.pose.covariance = list(self._filter.covariance[:6, :6].ravel())
            answer.twist.twist.linear = Vector3(*self._filter.velocity)
            answer.twist.twist.angular = Vector3(*self._filter.rate)
        answer.header.stamp, answer.header.frame_id = wheels.header.stamp, "odom"
        self._pose.publish(answer)

    def _orientation(self) -> Quaternion:
        return Quaternion(*quaternion(self._filter.attitude))


if __name__ == "__main__":
    rospy.init_node("localisation")
    localisation = Localisation()
    rospy.spin()
