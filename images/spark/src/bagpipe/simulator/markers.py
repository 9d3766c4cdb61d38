"""The static scene as visualization_msgs/MarkerArray, for the stack's map and for people."""

import math
from dataclasses import dataclass
from typing import Any

from bagpipe.simulator.messages import FRAME, MARKERS, typestore
from bagpipe.simulator.scenario import Barrier, Scene

_CUBE, _LINES = 1, 5
_WHITE, _GREY = (1.0, 1.0, 1.0, 1.0), (0.5, 0.5, 0.5, 1.0)
# The road begins behind the start, where cars come from.
_BEHIND = 200.0


def markers(scene: Scene, time: int) -> bytes:
    """Lane borders (`lanes`), stop lines (`stop_lines`) and barriers (`barriers`), in metres."""
    half = scene.lane_width / 2
    left = (scene.lanes - 1) * scene.lane_width + half
    borders = [lane * scene.lane_width - half for lane in range(scene.lanes + 1)]
    listed = [_lines("lanes", time, [((-_BEHIND, y), (scene.length, y)) for y in borders])]
    stops = [((line.x, -half), (line.x, left)) for line in scene.stop_lines]
    if stops:
        listed.append(_lines("stop_lines", time, stops))
    listed += [_barrier(number, time, barrier) for number, barrier in enumerate(scene.barriers)]
    store = typestore()
    array = store.types["visualization_msgs/msg/MarkerArray"](markers=listed)
    return bytes(store.serialize_ros1(array, MARKERS.replace("/", "/msg/")))


Point = tuple[float, float]


def _lines(namespace: str, time: int, lines: list[tuple[Point, Point]]) -> Any:
    point = typestore().types["geometry_msgs/msg/Point"]
    points = [point(x=float(x), y=float(y), z=0.0) for line in lines for x, y in line]
    return _marker((namespace, 0), time, _LINES, _Placed((0.15, 0.0, 0.0)), points)


def _barrier(number: int, time: int, barrier: Barrier) -> Any:
    placed = _Placed(
        (barrier.length, barrier.width, 1.0), (barrier.x, barrier.y, 0.5), barrier.heading, _GREY
    )
    return _marker(("barriers", number), time, _CUBE, placed, [])


@dataclass(frozen=True)
class _Placed:
    """Where a marker is, how large, and in which colour; lines are where their points are."""

    scale: tuple[float, float, float]
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: float = 0.0
    colour: tuple[float, float, float, float] = _WHITE


def _marker(name: tuple[str, int], time: int, kind: int, placed: _Placed, points: list[Any]) -> Any:
    types = typestore().types
    seconds, rest = divmod(time, 1_000_000_000)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
    half = placed.heading / 2
    turned = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
    return types["visualization_msgs/msg/Marker"](
        header=types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id=FRAME),
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
    )
