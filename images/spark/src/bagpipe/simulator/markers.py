"""The static scene as visualization_msgs/MarkerArray, for the stack's map and for people."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from bagpipe.simulator.messages import FRAME, MARKERS
from bagpipe.simulator.scenario import Barrier, Scene
from bagpipe.simulator.serialisation import Serialisation

_CUBE, _LINES = 1, 5
_WHITE, _GREY = (1.0, 1.0, 1.0, 1.0), (0.5, 0.5, 0.5, 1.0)
# The road begins behind the start, where cars come from.
_BEHIND = 200.0


def markers(own: Serialisation, scene: Scene, time: int) -> bytes:
    """Lane borders (`lanes`), stop lines (`stop_lines`) and barriers (`barriers`), in metres."""
    half = scene.lane_width / 2
    left = (scene.lanes - 1) * scene.lane_width + half
    borders = [lane * scene.lane_width - half for lane in range(scene.lanes + 1)]
    made = _Markers(own, time)
    listed = [made.lines("lanes", [((-_BEHIND, y), (scene.length, y)) for y in borders])]
    stops = [((line.x, -half), (line.x, left)) for line in scene.stop_lines]
    if stops:
        listed.append(made.lines("stop_lines", stops))
    listed += [made.barrier(number, barrier) for number, barrier in enumerate(scene.barriers)]
    array = own.types.types["visualization_msgs/msg/MarkerArray"](markers=listed)
    return own.serialised(array, MARKERS)


Point = tuple[float, float]


@dataclass(frozen=True)
class _Placed:
    """Where a marker is, how large, and in which colour; lines are where their points are."""

    scale: tuple[float, float, float]
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: float = 0.0
    colour: tuple[float, float, float, float] = _WHITE


class _Markers:
    """Makes markers of one moment, of the types that one ROS has."""

    def __init__(self, own: Serialisation, time: int) -> None:
        self._own, self._types, self._time = own, own.types.types, time

    def lines(self, namespace: str, lines: list[tuple[Point, Point]]) -> Any:
        point = self._types["geometry_msgs/msg/Point"]
        points = [point(x=float(x), y=float(y), z=0.0) for line in lines for x, y in line]
        return self._marker((namespace, 0), _LINES, _Placed((0.15, 0.0, 0.0)), points)

    def barrier(self, number: int, barrier: Barrier) -> Any:
        placed = _Placed(
            (barrier.length, barrier.width, 1.0),
            (barrier.x, barrier.y, 0.5),
            barrier.heading,
            _GREY,
        )
        return self._marker(("barriers", number), _CUBE, placed, [])

    def _marker(self, name: tuple[str, int], kind: int, placed: _Placed, points: list[Any]) -> Any:
        types = self._types
        half = placed.heading / 2
        turned = types["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=math.sin(half), w=math.cos(half)
        )
        return types["visualization_msgs/msg/Marker"](
            header=self._header(self._time, FRAME),
            ns=name[0],
            id=name[1],
            type=kind,
            action=0,
            pose=types["geometry_msgs/msg/Pose"](
                position=types["geometry_msgs/msg/Point"](*placed.at), orientation=turned
            ),
            scale=types["geometry_msgs/msg/Vector3"](*placed.scale),
            color=types["std_msgs/msg/ColorRGBA"](*placed.colour),
            lifetime=types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0),
            frame_locked=False,
            points=points,
            colors=[],
            text="",
            mesh_resource="",
            mesh_use_embedded_materials=False,
            **self._only_in_ros2(),
        )

    def _header(self, time: int, frame: str) -> Any:
        seconds, rest = divmod(time, 1_000_000_000)
        stamp = self._types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
        only_in_ros1 = {"seq": 0} if self._own.ros_version == 1 else {}
        return self._types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **only_in_ros1)

    def _only_in_ros2(self) -> dict[str, Any]:
        if self._own.ros_version == 1:
            return {}
        nothing = np.zeros(0, np.uint8)
        texture = self._types["sensor_msgs/msg/CompressedImage"]
        return {
            "texture_resource": "",
            "texture": texture(header=self._header(0, ""), format="", data=nothing),
            "uv_coordinates": [],
            "mesh_file": self._types["visualization_msgs/msg/MeshFile"](filename="", data=nothing),
        }
