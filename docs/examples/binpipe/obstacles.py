"""User logic: cluster the obstacles in the LiDAR readings of a bag (sensor_msgs/PointCloud2).

A record is a whole bag. For each scan, points near the ground are left out and the rest is
joined wherever two points are near; each cluster becomes a record that holds its points
(float32 x, y, z) and has its centre and size in millimetres as fields.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from clustering import above_ground, clusters, layout_of, points_of
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from bagpipe import binpipe

store = get_typestore(Stores.ROS1_NOETIC)


def scans(path: Path) -> Iterator[tuple[int, np.ndarray]]:
    """(bag time in ns, points of shape n x 3 in metres) of each point cloud."""
    with Reader(path) as reader:
        clouds = [c for c in reader.connections if c.msgtype == "sensor_msgs/msg/PointCloud2"]
        for connection, time, data in reader.messages(connections=clouds):
            cloud = store.deserialize_ros1(data, connection.msgtype)
            offsets = {field.name: field.offset for field in cloud.fields}
            layout = layout_of(offsets, cloud.point_step)
            yield time, points_of(cloud.data, layout)


for record in binpipe.read():
    with tempfile.NamedTemporaryFile(suffix=".bag") as file:
        for piece in record.pieces():
            file.write(piece)
        file.flush()
        for time, points in scans(Path(file.name)):
            for obstacle in clusters(above_ground(points)):
                low, high = obstacle.min(axis=0), obstacle.max(axis=0)
                centre = [round(float(value) * 1000) for value in (low + high) / 2]
                extent = [round(float(value) * 1000) for value in high - low]
                binpipe.write(
                    obstacle.astype("<f4").tobytes(),
                    time=time, points=len(obstacle),
                    x=centre[0], y=centre[1], z=centre[2],
                    length=extent[0], width=extent[1], height=extent[2],
                )  # fmt: skip
