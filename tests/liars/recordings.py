"""The drives that the liars are played: fifty poses in two seconds, and what is true of them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

POSES = 50
STEP_NS = 40_000_000
# July 2017, a tenth of a second after the recorder's start for the drive that begins at zero.
IN_2017 = 1_500_000_000 * 10**9
AT_ZERO = 40_000_000
IN_2040 = (2**31 + 60_000_000) * 10**9

_STORE = get_typestore(Stores.ROS1_NOETIC)
_POSE = "geometry_msgs/msg/PoseStamped"


def write_all(folder: Path) -> None:
    """`drive`, `zero` and `later` differ in their time; `warm` is twice as long."""
    folder.mkdir(parents=True, exist_ok=True)
    _write(folder / "drive.bag", IN_2017, POSES)
    _write(folder / "zero.bag", AT_ZERO, POSES)
    _write(folder / "later.bag", IN_2040, POSES)
    _write(folder / "warm.bag", IN_2017, 2 * POSES)
    (folder / "number.txt").write_text("12")


def _write(path: Path, begin: int, poses: int) -> None:
    path.unlink(missing_ok=True)
    with Writer(path) as writer:
        connections = {
            topic: writer.add_connection(topic, _POSE, typestore=_STORE, callerid="/recorded")
            for topic in ("/pose", "/truth", "/answer")
        }
        for number in range(poses):
            time = begin + number * STEP_NS
            # What is true, the old software has answered as well, a little later.
            answered = {"/pose": (1.0, 0.0, 0), "/truth": (2.0, 1.0, 0), "/answer": (2.0, 1.0, 1)}
            for topic, (scale, y, late) in answered.items():
                message = _pose(number, time, scale * number, y, topic)
                data = _STORE.serialize_ros1(message, _POSE)
                writer.write(connections[topic], time + late * 1_000_000, data)


def _pose(number: int, time: int, x: float, y: float, topic: str) -> Any:
    kinds: dict[str, Callable[..., Any]] = dict(_STORE.types)
    stamp = kinds["builtin_interfaces/msg/Time"](_signed(time // 10**9), time % 10**9)
    frame = "odom" if topic == "/pose" else "map"
    return kinds[_POSE](
        kinds["std_msgs/msg/Header"](number, stamp, frame),
        kinds["geometry_msgs/msg/Pose"](
            kinds["geometry_msgs/msg/Point"](x, y, 0.0),
            kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        ),
    )


def _signed(seconds: int) -> int:
    """ROS 1 counts seconds up to 2106, and rosbags writes the same four bytes as signed."""
    return seconds - 2**32 if seconds >= 2**31 else seconds
