"""The drives that the liars are played: fifty poses in two seconds, and what is true of them."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tests import ros2_recording

POSES = 50
STEP_NS = 40_000_000
# July 2017, a tenth of a second after the recorder's start for the drive that begins at zero.
IN_2017 = 1_500_000_000 * 10**9
AT_ZERO = 40_000_000
IN_2040 = (2**31 + 60_000_000) * 10**9

# Of each topic: what n is multiplied by for the nth pose's x, its y, and how late it is, in ms.
TOPICS = {"/pose": (1.0, 0.0, 0), "/truth": (2.0, 1.0, 0), "/answer": (2.0, 1.0, 1)}

_STORE = get_typestore(Stores.ROS1_NOETIC)
_STORE2 = get_typestore(Stores.ROS2_HUMBLE)
_POSE = "geometry_msgs/msg/PoseStamped"


def write_all(folder: Path) -> None:
    """`drive`, `zero` and `later` differ in their time; `warm` is twice as long."""
    folder.mkdir(parents=True, exist_ok=True)
    _write(folder / "drive.bag", IN_2017, POSES)
    _write(folder / "zero.bag", AT_ZERO, POSES)
    _write(folder / "later.bag", IN_2040, POSES)
    _write(folder / "warm.bag", IN_2017, 2 * POSES)
    (folder / "number.txt").write_text("12")
    _write_mcap(folder / "drive.mcap", IN_2017, POSES)
    _write_mcap(folder / "zero.mcap", AT_ZERO, POSES)
    _write_mcap(folder / "warm.mcap", IN_2017, 2 * POSES)


def _write(path: Path, begin: int, poses: int) -> None:
    path.unlink(missing_ok=True)
    with Writer(path) as writer:
        connections = {
            topic: writer.add_connection(topic, _POSE, typestore=_STORE, callerid="/recorded")
            for topic in TOPICS
        }
        for topic, number, time, late, message in _messages(_STORE, begin, poses):
            data = _STORE.serialize_ros1(message(number), _POSE)
            writer.write(connections[topic], time + late, data)


def _write_mcap(path: Path, begin: int, poses: int) -> None:
    """The same, recorded by ROS 2."""
    definition, _ = _STORE2.generate_msgdef(_POSE, ros_version=2)
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="ros2", library="tests")
        schema = writer.register_schema(_POSE, "ros2msg", definition.encode())
        qos = {"offered_qos_profiles": ros2_recording.QOS}
        channels = {
            topic: writer.register_channel(topic, "cdr", schema, metadata=qos) for topic in TOPICS
        }
        for topic, number, time, late, message in _messages(_STORE2, begin, poses):
            data = bytes(_STORE2.serialize_cdr(message(), _POSE))
            writer.add_message(channels[topic], time + late, data, time + late, number)
        writer.finish()


def _messages(store: Typestore, begin: int, poses: int) -> Iterator[tuple[Any, ...]]:
    """Topic, number, time and lateness in ns of each message, and what makes it."""
    for number in range(poses):
        time = begin + number * STEP_NS
        # What is true, the old software has answered as well, a little later.
        for topic, (scale, y, late) in TOPICS.items():
            pose = partial(_pose, store, time, scale * number, y, topic)
            yield topic, number, time, late * 1_000_000, pose


def _pose(store: Typestore, time: int, x: float, y: float, topic: str, *number: int) -> Any:
    """`number` is the header's in ROS 1, which ROS 2 has not."""
    kinds: dict[str, Callable[..., Any]] = dict(store.types)
    stamp = kinds["builtin_interfaces/msg/Time"](_signed(time // 10**9), time % 10**9)
    frame = "odom" if topic == "/pose" else "map"
    return kinds[_POSE](
        kinds["std_msgs/msg/Header"](*number, stamp, frame),
        kinds["geometry_msgs/msg/Pose"](
            kinds["geometry_msgs/msg/Point"](x, y, 0.0),
            kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        ),
    )


def _signed(seconds: int) -> int:
    """ROS 1 counts seconds up to 2106, and rosbags writes the same four bytes as signed."""
    return seconds - 2**32 if seconds >= 2**31 else seconds
