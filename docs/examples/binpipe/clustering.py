"""Obstacles in a LiDAR scan: leave the ground out, join what is near; ROS and Bagpipe unseen."""

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

CELL = 0.5  # metres: the ground is estimated in cells of four times this
GROUND = 0.4  # metres above the lowest point of a cell still are ground
REACH, FARTHEST = 0.6, 60.0  # metres between neighbours, and from the sensor
LEAST = 30  # points


def layout_of(offsets: dict[str, int], point_step: int) -> np.dtype:
    """How x, y and z lie in a point of a sensor_msgs/PointCloud2, whose other fields are skipped.

    `offsets` has those of the message's `fields` by name.
    """
    return np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": ["<f4"] * 3,
            "offsets": [offsets[axis] for axis in "xyz"],
            "itemsize": point_step,
        }
    )


def points_of(data: bytes, layout: np.dtype) -> np.ndarray:
    """The points of a cloud, of shape n x 3, in metres."""
    points = np.frombuffer(data, layout)
    return np.stack([points[axis] for axis in "xyz"], axis=1)


def above_ground(points: np.ndarray) -> np.ndarray:
    """The near points that stand higher than the lowest of their cell."""
    near = points[np.linalg.norm(points[:, :2], axis=1) < FARTHEST]
    cells = np.floor(near[:, :2] / (4 * CELL)).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    lowest = np.full(cell.max() + 1, np.inf)
    np.minimum.at(lowest, cell, near[:, 2])
    return near[near[:, 2] > lowest[cell] + GROUND]


def clusters(points: np.ndarray, least: int = LEAST) -> Iterator[np.ndarray]:
    """Sets of at least so many points that are joined by steps of REACH, the largest first."""
    pairs = cKDTree(points).query_pairs(REACH, output_type="ndarray")
    edges = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points), len(points)))
    _, labels = connected_components(edges, directed=False)
    sizes = np.bincount(labels)
    for label in np.argsort(-sizes, kind="stable"):
        if sizes[label] < least:
            return
        yield points[labels == label]
